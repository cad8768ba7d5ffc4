"""Numba kernels of the batch solvers: bare ceiling/floor pairs, many frames of equal N."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from galoc._chain_kernel import POINT, levelling_matrix
from galoc._chain_solve import height_ratio, solve_chain


@njit(cache=True)
def tls_batch(ceiling, floor, ceiling_seen, floor_seen, gravity, sd, intrinsics, k0, k_sd, s0):  # type: ignore[no-untyped-def]
    """Closed-form solution of B frames of N pairs: the start of :func:`solve_batch`, on its own.

    Arguments as in :func:`solve_batch`.

    Returns:
        m (B, N), s (B, N), k (B,).
    """
    frames, n = ceiling.shape[0], ceiling.shape[1]
    ms = np.empty((frames, n))
    ss = np.empty((frames, n))
    ks = np.empty(frames)
    y = np.empty((n, 2))
    there = np.empty((n, 2), np.bool_)
    fx, fy, cx, cy = intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3]
    for f in range(frames):
        cr, sr = math.cos(gravity[f, 0]), math.sin(gravity[f, 0])
        cp, sp = math.cos(gravity[f, 1]), math.sin(gravity[f, 1])
        a = b = c = 0.0
        for i in range(n):
            m, count, clipped, rows = 0.0, 0, 0.0, 0
            for r in range(2):
                there[i, r] = False
                if not (ceiling_seen[f, i] if r == 0 else floor_seen[f, i]):
                    continue
                q0 = ((ceiling[f, i, 0] if r == 0 else floor[f, i, 0]) - cx) / fx
                q1 = ((ceiling[f, i, 1] if r == 0 else floor[f, i, 1]) - cy) / fy
                along, turned = cr * q0 - sr * q1, sr * q0 + cr * q1
                ahead = sp * turned + cp
                rows += 1
                clipped += along / max(ahead, 1e-3)
                if ahead < 1e-3:
                    continue  # beside or behind the level camera: no point of the plane
                there[i, r] = True
                m += along / ahead
                count += 1
                y[i, r] = (cp * turned - sp) / ahead
            ms[f, i] = m / count if count > 0 else (clipped / rows if rows > 0 else 0.0)
            if there[i, 0]:
                y[i, 0] = -y[i, 0]
            if there[i, 0] and there[i, 1]:
                a += y[i, 0] * y[i, 0]
                b += y[i, 0] * y[i, 1]
                c += y[i, 1] * y[i, 1]
        k = height_ratio(a, b, c, k0, k_sd, sd / fx)
        hc, hf = math.exp(-0.5 * k), math.exp(0.5 * k)
        for i in range(n):
            s = s0
            if there[i, 0] and there[i, 1]:
                s = max((hc * y[i, 0] + hf * y[i, 1]) / (hc * hc + hf * hf), 0.02)
            elif there[i, 0]:
                s = max(y[i, 0] / hc, 0.02)
            elif there[i, 1]:
                s = max(y[i, 1] / hf, 0.02)
            ss[f, i] = s
        ks[f] = k
    return ms, ss, ks


@njit(cache=True)
def solve_batch(  # type: ignore[no-untyped-def]
    ceiling, floor, ceiling_seen, floor_seen, gravity, sd, intrinsics, imu_sd, k0, k_sd, s0, s_sd, drops, scale_free
):
    """Solve B frames of N pairs each.

    Args:
        ceiling: (B, N, 2) px.
        floor: (B, N, 2) px.
        ceiling_seen: (B, N) bool.
        floor_seen: (B, N) bool.
        gravity: (B, 2) rad.
        sd: px.
        intrinsics: (4,).
        imu_sd: rad.
        k0: prior mean of k.
        k_sd: prior sd of k.
        s0: prior mean of an inverse depth.
        s_sd: its sd.
        drops: pairs the gate may refuse.
        scale_free: estimate the noise from the residuals.

    Returns:
        theta (B, 2N+4), covariance (B, 2N, 2N), flagged (B, N), noise factor (B,) (-1: not solved).
    """
    frames, n = ceiling.shape[0], ceiling.shape[1]
    size = 2 * n + 4
    thetas = np.empty((frames, size))
    covs = np.zeros((frames, 2 * n, 2 * n))
    flagged = np.zeros((frames, n), np.bool_)
    factors = np.ones(frames)
    prior = np.empty(size)
    prior_sd = np.empty(size)
    walls = np.zeros((0, 2), np.int64)
    for f in range(frames):
        count = 0
        for i in range(n):
            count += int(ceiling_seen[f, i]) + int(floor_seen[f, i])
        kind = np.full(count, POINT, np.int64)
        a = np.empty(count, np.int64)
        row = np.empty(count, np.int64)
        uv = np.zeros((count, 3))
        sds = np.full(count, sd)
        rot = levelling_matrix(gravity[f, 0], gravity[f, 1])
        t = 0
        for i in range(n):
            m, seen = 0.0, 0.0
            for r in range(2):
                if not (ceiling_seen[f, i] if r == 0 else floor_seen[f, i]):
                    continue
                u = ceiling[f, i, 0] if r == 0 else floor[f, i, 0]
                v = ceiling[f, i, 1] if r == 0 else floor[f, i, 1]
                a[t], row[t], uv[t, 0], uv[t, 1] = i, r, u, v
                t += 1
                q0, q1 = (u - intrinsics[2]) / intrinsics[0], (v - intrinsics[3]) / intrinsics[1]
                r2 = max(rot[2, 0] * q0 + rot[2, 1] * q1 + rot[2, 2], 1e-3)
                m += (rot[0, 0] * q0 + rot[0, 1] * q1 + rot[0, 2]) / r2
                seen += 1.0
            prior[2 * i], prior_sd[2 * i] = (m / seen if seen > 0.0 else 0.0), 10.0
            prior[2 * i + 1], prior_sd[2 * i + 1] = s0, s_sd
        prior[2 * n], prior_sd[2 * n] = k0, k_sd
        prior[2 * n + 1], prior_sd[2 * n + 1] = gravity[f, 0], imu_sd
        prior[2 * n + 2], prior_sd[2 * n + 2] = gravity[f, 1], imu_sd
        prior[2 * n + 3], prior_sd[2 * n + 3] = 0.0, 10.0
        theta, cov, use, factor = solve_chain(
            n, kind, a, a, row, uv, sds, a, intrinsics, prior, prior_sd, walls, False, drops, scale_free
        )
        thetas[f] = theta
        covs[f] = cov[: 2 * n, : 2 * n]
        factors[f] = factor
        for t in range(count):
            if not use[t]:
                flagged[f, a[t]] = True
    return thetas, covs, flagged, factors
