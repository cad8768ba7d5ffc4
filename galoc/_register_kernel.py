"""Numba kernels that register a wall chain to the map: corner assignment and Gauss-Newton over (x, y, heading, scale).

The chain's nodes live on the level plane as (m, s) with a joint covariance (tilt, height ratio and pixel noise already
in it). A map corner at body coordinates (right, forward) = (x, z) is predicted at ``m = x / z, s = exp(g) / z``, g the
log scale; a map wall is a straight line there. A node that is no map corner only has to lie on a wall: its covariance
is opened along that line.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from galoc._linalg_kernel import cholesky, cholesky_inverse, cholesky_solve
from galoc._visibility_kernel import NEAR, cast, nearby, ray_cost, unseen_corners, visible_corners, within

ON_CORNER, ON_WALL, OUTLIER = 0, 1, 2
ALONG_WALL = 0.3
"""Standard deviation, on the level plane, of where a node may lie along its wall when it is no map corner."""
OUTLIER_SD = 1.0
"""The same in both directions for a node that nothing in the map explains."""
ROUNDS = 5


@njit(cache=True, error_model="numpy")
def assign(  # type: ignore[no-untyped-def]
    pose, segments, corners, nodes, cov, is_corner, side, slack_m, slack_az, slack_g, map_sd, corner_share, state, data,
    seen, far, moved,
):  # fmt: skip
    """Choose for every node what it is in the map: a corner, a point on a wall, or nothing.

    ``state`` (N,) gets the choice; ``data`` (N, 4) a corner's (x, y) or a wall's (point x, y, normal x, y).
    Returns the log prior of the choices.
    """
    n = nodes.shape[0]
    x, y, heading, g = pose[0], pose[1], pose[2], pose[3]
    c, s = math.cos(heading), math.sin(heading)
    scale = math.exp(g)
    low, high = nodes[0, 0], nodes[0, 0]
    for i in range(n):
        low, high = min(low, nodes[i, 0]), max(high, nodes[i, 0])
    count = visible_corners(segments, corners, x, y, heading, low - 0.5, high + 0.5, seen, far, moved)
    total = 0.0
    for i in range(n):
        m, d = nodes[i, 0], nodes[i, 1]
        z0 = scale / max(d, 1e-3)
        wide = slack_m * slack_m / (z0 * z0)
        vmm = cov[2 * i, 2 * i] + wide + (slack_az * (1.0 + m * m)) ** 2
        vms = cov[2 * i, 2 * i + 1]
        vss = cov[2 * i + 1, 2 * i + 1] + d * d * (wide + slack_g * slack_g)
        # Nothing in the map explains it.
        best = math.log(0.02) - math.log(2.0 * math.pi * OUTLIER_SD * OUTLIER_SD)
        state[i] = OUTLIER
        # On a wall: seen just beside the node, on the side where its wall is.
        sd_m = math.sqrt(cov[2 * i, 2 * i])
        for turn in range(3 if side[i] != 0 else 4):
            # A nearer wall may still hide it there, so look a little further too.
            if side[i] != 0:
                at = m + side[i] * (0.004 + (0.5, 1.5, 3.0)[turn] * sd_m)
            else:
                at = m + (2 * (turn % 2) - 1) * (0.004 + (0.5 + turn // 2) * sd_m)
            wx, wy = c + at * s, s - at * c
            reach, k = cast(segments, x, y, wx, wy, far, moved)
            if k < 0:
                continue
            nx, ny = -(segments[k, 3] - segments[k, 1]), segments[k, 2] - segments[k, 0]
            size = math.hypot(nx, ny)
            nx, ny = nx / size, ny / size
            away = nx * (segments[k, 0] - x) + ny * (segments[k, 1] - y)
            if abs(away) < 1e-6:
                continue
            slope = scale * (nx * s - ny * c) / away
            e = d - scale * (nx * (c + m * s) + ny * (s - m * c)) / away
            v = vss - 2.0 * slope * vms + slope * slope * vmm + (map_sd * d / z0) ** 2
            if not v > 0.0:
                continue
            value = -0.5 * e * e / v - 0.5 * math.log(2.0 * math.pi * v) - math.log(2.5 * ALONG_WALL)
            value += math.log(0.98 * (1.0 - corner_share)) if is_corner[i] else math.log(0.98)
            if value > best:
                best = value
                state[i] = ON_WALL
                data[i, 0], data[i, 1], data[i, 2], data[i, 3] = segments[k, 0], segments[k, 1], nx, ny
        if is_corner[i]:
            for q in range(count):
                em, es = m - seen[q, 0], d - scale / seen[q, 1]
                extra = map_sd * map_sd / (seen[q, 1] * seen[q, 1])
                a, b, r = vmm + extra, vms, vss + d * d * extra
                det = a * r - b * b
                if not det > 0.0:
                    continue
                value = -0.5 * (r * em * em - 2.0 * b * em * es + a * es * es) / det
                value -= 0.5 * math.log(det) + math.log(2.0 * math.pi)
                value += math.log(0.98 * corner_share)
                if value > best:
                    best = value
                    state[i] = ON_CORNER
                    k = int(seen[q, 2])
                    data[i, 0], data[i, 1] = corners[k, 0], corners[k, 1]
        if state[i] == ON_CORNER:
            total += math.log(0.98 * corner_share)
        elif state[i] == OUTLIER:
            total += math.log(0.02)
        else:
            total += math.log(0.98 * (1.0 - corner_share)) if is_corner[i] else math.log(0.98)
    return total


@njit(cache=True, error_model="numpy")
def linearize(pose, nodes, cov, state, data, map_sd, e, jac, big):  # type: ignore[no-untyped-def]
    """Residuals (2N,), Jacobian (2N, 4) of the predictions, and the opened covariance (2N, 2N)."""
    n = nodes.shape[0]
    x, y, heading, g = pose[0], pose[1], pose[2], pose[3]
    c, s = math.cos(heading), math.sin(heading)
    scale = math.exp(g)
    for p in range(2 * n):
        e[p] = 0.0
        for q in range(4):
            jac[p, q] = 0.0
        for q in range(2 * n):
            big[p, q] = cov[p, q]
    for i in range(n):
        m, d = nodes[i, 0], nodes[i, 1]
        if state[i] == OUTLIER:
            big[2 * i, 2 * i] += OUTLIER_SD * OUTLIER_SD
            big[2 * i + 1, 2 * i + 1] += OUTLIER_SD * OUTLIER_SD
            continue
        if state[i] == ON_CORNER:
            dx, dy = data[i, 0] - x, data[i, 1] - y
            z = max(c * dx + s * dy, NEAR)
            mp = (s * dx - c * dy) / z
            sp = scale / z
            e[2 * i], e[2 * i + 1] = m - mp, d - sp
            jac[2 * i, 0], jac[2 * i, 1], jac[2 * i, 2] = (-s + mp * c) / z, (c + mp * s) / z, 1.0 + mp * mp
            jac[2 * i + 1, 0], jac[2 * i + 1, 1] = sp * c / z, sp * s / z
            jac[2 * i + 1, 2], jac[2 * i + 1, 3] = sp * mp, sp
            extra = map_sd * map_sd / (z * z)
            big[2 * i, 2 * i] += extra
            big[2 * i + 1, 2 * i + 1] += sp * sp * extra
            continue
        nx, ny = data[i, 2], data[i, 3]
        away = nx * (data[i, 0] - x) + ny * (data[i, 1] - y)
        if abs(away) < 0.02:
            away = 0.02 if away >= 0.0 else -0.02
        sp = scale * (nx * (c + m * s) + ny * (s - m * c)) / away
        slope = scale * (nx * s - ny * c) / away
        e[2 * i + 1] = d - sp
        jac[2 * i + 1, 0], jac[2 * i + 1, 1] = sp * nx / away, sp * ny / away
        jac[2 * i + 1, 2] = scale * (nx * (-s + m * c) + ny * (c + m * s)) / away
        jac[2 * i + 1, 3] = sp
        open2 = ALONG_WALL * ALONG_WALL
        big[2 * i, 2 * i] += open2
        big[2 * i, 2 * i + 1] += open2 * slope
        big[2 * i + 1, 2 * i] += open2 * slope
        big[2 * i + 1, 2 * i + 1] += open2 * slope * slope + (map_sd * d * d / scale) ** 2


@njit(cache=True, error_model="numpy")
def register(  # type: ignore[no-untyped-def]
    start, segments, far, corners, nodes, cov, is_corner, side, prior_precision, map_sd, corner_share, slack
):
    """Register one chain from one start pose.

    Args:
        start: (4,) x, y (m), heading (rad), log scale; also the prior's mean.
        segments: (S, 4) m, the near ones, nearest to the start first.
        far: (S,) m, their distances to the start.
        corners: (C, 2) m.
        nodes: (N, 2) m, s.
        cov: (2N, 2N).
        is_corner: (N,) whether the node is a real corner.
        side: (N,) where its wall is: -1 left, 1 right, 0 both.
        prior_precision: (4, 4) of the prior about the start.
        map_sd: m.
        corner_share: how often a seen corner is a corner of the map.
        slack: how far the start may be off, in multiples of (0.07 m, 0.6 deg).

    Returns:
        pose (4,), information (4, 4), log evidence, number of nodes on corners, number of outliers.
    """
    n, size = nodes.shape[0], start.shape[0]
    pose = start.copy()
    state = np.zeros(n, np.int64)
    data = np.zeros((n, 4))
    seen = np.empty((64, 3))
    e = np.empty(2 * n)
    jac = np.empty((2 * n, 4))
    big = np.empty((2 * n, 2 * n))
    white = np.empty(2 * n)
    columns = np.empty((4, 2 * n))
    info, damped = np.empty((4, 4)), np.empty((4, 4))
    grad = np.empty(4)
    offset = np.empty(4)
    log_prior, evidence = 0.0, -1e18
    for round_ in range(ROUNDS + 1):
        ease = slack * (1.0, 0.5, 0.25, 0.0, 0.0, 0.0)[round_]
        log_prior = assign(
            pose, segments, corners, nodes, cov, is_corner, side, 0.07 * ease, 0.01 * ease, 0.08 * ease, map_sd,
            corner_share, state, data, seen, far, math.hypot(pose[0] - start[0], pose[1] - start[1]),
        )  # fmt: skip
        for _ in range(2):
            linearize(pose, nodes, cov, state, data, map_sd, e, jac, big)
            if not cholesky(big, 2 * n):
                return pose, info, -1e18, 0, n
            for k in range(2 * n):
                white[k] = e[k]
                for q in range(4):
                    columns[q, k] = jac[k, q]
            cholesky_solve(big, white, 2 * n)
            for q in range(4):
                cholesky_solve(big, columns[q], 2 * n)
            for q in range(4):
                offset[q] = pose[q] - start[q]
            offset[2] = (offset[2] + math.pi) % (2.0 * math.pi) - math.pi
            square = 0.0
            for k in range(2 * n):
                square += e[k] * white[k]
            for q in range(4):
                grad[q] = 0.0
                for k in range(2 * n):
                    grad[q] += jac[k, q] * white[k]
                for r in range(4):
                    grad[q] -= prior_precision[q, r] * offset[r]
                    square += offset[q] * prior_precision[q, r] * offset[r]
                    v = prior_precision[q, r]
                    for k in range(2 * n):
                        v += jac[k, q] * columns[r, k]
                    info[q, r] = v
            if round_ == ROUNDS:
                log_det = 0.0
                for k in range(2 * n):
                    log_det += math.log(big[k, k])
                evidence = -0.5 * square - log_det - n * math.log(2.0 * math.pi) + log_prior
                break
            for q in range(4):
                for r in range(4):
                    damped[q, r] = info[q, r]
                damped[q, q] = damped[q, q] * 1.001 + 1e-3
            if not cholesky(damped, size):
                return pose, info, -1e18, 0, n
            cholesky_solve(damped, grad, size)
            shrink = 1.0
            step = math.hypot(grad[0], grad[1])
            if step > 0.25:
                shrink = 0.25 / step
            if abs(grad[2]) * shrink > 0.08:
                shrink = 0.08 / abs(grad[2])
            for q in range(4):
                pose[q] += shrink * grad[q]
    matched, lost = 0, 0
    for i in range(n):
        if state[i] == ON_CORNER:
            matched += 1
        elif state[i] == OUTLIER:
            lost += 1
    return pose, info, evidence, matched, lost


@njit(cache=True, error_model="numpy")
def register_all(  # type: ignore[no-untyped-def]
    starts, segments, corners, nodes, cov, is_corner, side, prior_precision, map_sd, corner_share, slack, reach,
    azimuths, seen, sd, least, ray_weight, saturation, unseen_cost,
):  # fmt: skip
    """Register from many starts.

    Returns:
        (C, 4) poses, (C, 4, 4) covariances, (C,) log mass: the evidence with contradictions charged and the pose
        integrated out (Laplace), (C, 2) counts of matched and lost nodes.
    """
    count, size = starts.shape
    poses = np.empty((count, 4))
    covs = np.zeros((count, 4, 4))
    mass = np.empty(count)
    counts = np.empty((count, 2), np.int64)
    buffer = np.empty((64, 3))
    for c in range(count):
        local, far = nearby(segments, starts[c, 0], starts[c, 1], reach)
        local_corners = within(corners, starts[c, 0], starts[c, 1], reach)
        pose, info, evidence, matched, lost = register(
            starts[c], local, far, local_corners, nodes, cov, is_corner, side, prior_precision, map_sd,
            corner_share, slack,
        )  # fmt: skip
        counts[c, 0], counts[c, 1] = matched, lost
        mass[c] = -1e18
        for q in range(size):
            poses[c, q] = pose[q]
        if evidence <= -1e17 or not cholesky(info, size):
            continue
        inverse = cholesky_inverse(info, size)
        mass[c] = evidence
        for q in range(size):
            mass[c] -= math.log(info[q, q])
            for r in range(size):
                covs[c, q, r] = inverse[q, r]
        moved = math.hypot(pose[0] - starts[c, 0], pose[1] - starts[c, 1])
        mass[c] -= 0.5 * ray_weight * ray_cost(pose, local, azimuths, seen, sd, least, saturation, far, moved)
        if unseen_cost > 0.0:
            missing = unseen_corners(pose, local, local_corners, nodes, cov, azimuths, sd, buffer, far, moved)
            mass[c] -= unseen_cost * missing
    return poses, covs, mass, counts
