"""Numba kernels that run a whole layout solve: start values, Gauss-Newton, outlier gate, wall-direction prior."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from galoc._chain_kernel import (
    POINT,
    TIE,
    VERTICAL,
    grid_weights,
    iterate,
    levelling_matrix,
    worst_group,
)
from galoc._linalg_kernel import cholesky_inverse

WALL_SD = math.radians(0.5)
"""Spread of real walls about their grid, rad."""
GRID_SHARE = 0.8
"""Prior probability that a wall of a right-angled map is on the grid as seen (thin panels are often not)."""


@njit(cache=True, error_model="numpy")
def height_ratio(a, b, c, k0, k_sd, noise):  # type: ignore[no-untyped-def]
    """Log height ratio k from the sums ``yc yc``, ``yc yf`` and ``yf yf`` over the pairs, see :func:`tls`."""
    if not a + c > 0.0:
        return k0
    angle = 0.5 * math.atan2(2.0 * b, a - c)
    if not 0.0 < angle < math.pi / 2.0:
        return k0
    variance = noise * noise / (a + c) * 4.0 / math.sin(2.0 * angle) ** 2
    share = k_sd * k_sd / (k_sd * k_sd + variance)
    return k0 + share * (min(max(math.log(math.tan(angle)), -2.0), 2.0) - k0)


@njit(cache=True, error_model="numpy")
def tls(yc, yf, k0, k_sd, noise):  # type: ignore[no-untyped-def]
    """Total least squares in closed form: k and the inverse depths of pairs from their level-plane heights.

    The pairs satisfy ``(yc_i, yf_i) = s_i (exp(-k/2), exp(k/2))``: the first principal direction of the (N, 2) matrix.
    The direction is averaged with the prior in proportion to the precisions.

    Args:
        yc: (N,) height of the ceiling end above the horizon on the level plane.
        yf: (N,) depth of the floor end below it.
        k0: prior mean of k.
        k_sd: prior standard deviation of k.
        noise: standard deviation of yc and yf.
    """
    a = b = c = 0.0
    for i in range(yc.shape[0]):
        a += yc[i] * yc[i]
        b += yc[i] * yf[i]
        c += yf[i] * yf[i]
    k = height_ratio(a, b, c, k0, k_sd, noise)
    hc, hf = math.exp(-0.5 * k), math.exp(0.5 * k)
    s = np.empty(yc.shape[0])
    for i in range(yc.shape[0]):
        s[i] = (hc * yc[i] + hf * yf[i]) / (hc * hc + hf * hf)
    return k, s


@njit(cache=True, error_model="numpy")
def start(n, kind, a, row, uv, sd, use, intrinsics, prior, prior_sd):  # type: ignore[no-untyped-def]
    """Start values: azimuths from what is seen of each node, k and inverse depths by :func:`tls`."""
    theta = prior.copy()
    rot = levelling_matrix(prior[2 * n + 1], prior[2 * n + 2])
    y = np.zeros((n, 2))
    seen = np.zeros((n, 2))  # 0 or 1
    m_sum = np.zeros(n)
    m_count = np.zeros(n)
    noise = -1.0
    for t in range(kind.shape[0]):
        if not use[t]:
            continue
        if noise < 0.0:
            noise = sd[t] / intrinsics[0]
        if kind[t] != POINT and kind[t] != VERTICAL:
            continue
        q0, q1 = (uv[t, 0] - intrinsics[2]) / intrinsics[0], (uv[t, 1] - intrinsics[3]) / intrinsics[1]
        r2 = rot[2, 0] * q0 + rot[2, 1] * q1 + rot[2, 2]
        if r2 < 1e-3:
            continue
        i = a[t]
        m_sum[i] += (rot[0, 0] * q0 + rot[0, 1] * q1 + rot[0, 2]) / r2
        m_count[i] += 1.0
        if kind[t] == POINT:
            height = (rot[1, 0] * q0 + rot[1, 1] * q1 + rot[1, 2]) / r2
            y[i, row[t]] = -height if row[t] == 0 else height
            seen[i, row[t]] = 1.0
    full = np.empty(n, np.int64)
    both = np.empty((2, n))
    count = 0
    for i in range(n):
        if m_count[i] > 0.0:
            theta[2 * i] = m_sum[i] / m_count[i]
        if seen[i, 0] * seen[i, 1] > 0.0:
            full[count] = i
            both[0, count], both[1, count] = y[i, 0], y[i, 1]
            count += 1
    k, s = tls(both[0, :count], both[1, :count], prior[2 * n], prior_sd[2 * n], max(noise, 0.0))
    theta[2 * n] = k
    for f in range(count):
        theta[2 * full[f] + 1] = max(s[f], 0.02)
    for i in range(n):
        if seen[i, 0] != seen[i, 1]:
            which = 0 if seen[i, 0] > 0.0 else 1
            h = math.exp(-0.5 * k) if which == 0 else math.exp(0.5 * k)
            theta[2 * i + 1] = max(y[i, which] / h, 0.02)
    return theta


@njit(cache=True, error_model="numpy")
def solve_chain(  # type: ignore[no-untyped-def]
    n, kind, a, b, row, uv, sd, group, intrinsics, prior, prior_sd, walls, on_grid, drops, scale_free
):
    """Maximum-likelihood chain: start, iterate, gate the worst group while one fails, then the wall-direction prior.

    Args:
        n: nodes.
        kind: (T,) POINT, VERTICAL, LINE or TIE.
        a: (T,) node, or left node of the wall.
        b: (T,) right node of the wall (LINE), other node (TIE).
        row: (T,) 0 ceiling, 1 floor.
        uv: (T, 3) px; third column: 0 where the pixel moves along u, 1 along v (LINE).
        sd: (T,) px (TIE: on the level plane).
        group: (T,) measurements that are tested and dropped together.
        intrinsics: (4,) fx, fy, cx, cy.
        prior: (2N+4,) prior means.
        prior_sd: (2N+4,) prior standard deviations.
        walls: (M, 2) nodes of walls, for the direction prior.
        on_grid: whether the map's walls lie on one right-angled grid.
        drops: how many groups the gate may drop.
        scale_free: estimate the common pixel noise from the residuals (``sd`` gives its first guess).

    Returns:
        theta (2N+4,), covariance (2N+4, 2N+4), use (T,) bool, noise factor on ``sd``.
    """
    size = 2 * n + 4
    use = np.ones(kind.shape[0], np.bool_)
    theta = start(n, kind, a, row, uv, sd, use, intrinsics, prior, prior_sd)
    hess = np.empty((size, size))
    grad = np.empty(size)
    none = np.zeros(walls.shape[0])
    cov = np.zeros((size, size))
    sd = sd.copy()
    factor = 1.0
    for attempt in range(drops + 1):
        if not iterate(
            theta, n, kind, a, b, row, uv, sd, use, intrinsics, prior, prior_sd, walls, none, WALL_SD, hess, grad
        ):
            return theta, cov, use, -1.0
        cov = cholesky_inverse(hess, size)
        worst, value, typical, free = worst_group(theta, n, kind, a, b, row, uv, sd, use, group, intrinsics, cov)
        if scale_free:
            # Four pseudo-observations at the first guess keep small frames from trusting a lucky fit.
            rough = math.sqrt((typical * free + 4.0 / (factor * factor)) / (free + 4.0))
            for t in range(kind.shape[0]):
                if kind[t] != TIE:
                    sd[t] *= rough
            factor *= rough
            for p in range(size):
                for q in range(size):
                    cov[p, q] *= rough * rough
            value /= rough * rough
        if worst < 0 or value <= 1.0 or attempt == drops:
            break
        for t in range(kind.shape[0]):
            if group[t] == worst:
                use[t] = False
        theta = start(n, kind, a, row, uv, sd, use, intrinsics, prior, prior_sd)
    if on_grid and walls.shape[0] >= 2:
        weight, direction = grid_weights(theta, n, walls, cov, WALL_SD, GRID_SHARE)
        agree = 0.0
        for w in range(walls.shape[0]):
            agree += weight[w]
        if agree > 0.0:
            trial = theta.copy()
            trial[size - 1] = direction
            if iterate(
                trial, n, kind, a, b, row, uv, sd, use, intrinsics, prior, prior_sd, walls, weight, WALL_SD, hess, grad,
            ):  # fmt: skip
                theta = trial
                cov = cholesky_inverse(hess, size)
    return theta, cov, use, factor
