"""Numba kernel: log ranges of a wall chain and their variances."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def chain_log_ranges(m, s, covariance, walls, azimuths):  # type: ignore[no-untyped-def]
    """Nearest wall at each azimuth.

    On the level plane a wall is a straight line in (m, s): s is interpolated linearly between its ends, and
    log range = -log s - log cos(azimuth).

    Args:
        m: (N,) abscissas of the nodes.
        s: (N,) inverse depths.
        covariance: (2N, 2N) of (m_0, s_0, ...), or (0, 0) for none.
        walls: (M, 2) left and right node.
        azimuths: (R,) rad.

    Returns:
        (R,) log range (NaN: no wall), (R,) variance of it (NaN without covariance), (R,) wall index (-1: none).
    """
    count = azimuths.shape[0]
    log_range = np.full(count, np.nan)
    variance = np.full(count, np.nan)
    wall = np.full(count, -1, np.int64)
    jac = np.empty(4)
    at = np.empty(4, np.int64)
    for k in range(count):
        t = math.tan(azimuths[k])
        best, share = 0.0, 0.0
        for w in range(walls.shape[0]):
            i, j = walls[w, 0], walls[w, 1]
            width = m[j] - m[i]
            if width <= 1e-9:
                continue
            u = (t - m[i]) / width
            if u < 0.0 or u > 1.0:
                continue
            value = s[i] * (1.0 - u) + s[j] * u
            if value > best:
                best, share, wall[k] = value, u, w
        if wall[k] < 0:
            continue
        log_range[k] = -math.log(best) - math.log(math.cos(azimuths[k]))
        if covariance.shape[0] == 0:
            continue
        i, j = walls[wall[k], 0], walls[wall[k], 1]
        slope = (s[j] - s[i]) / (m[j] - m[i])
        jac[0], jac[1] = (1.0 - share) * slope / best, -(1.0 - share) / best
        jac[2], jac[3] = share * slope / best, -share / best
        at[0], at[1], at[2], at[3] = 2 * i, 2 * i + 1, 2 * j, 2 * j + 1
        v = 0.0
        for p in range(4):
            for q in range(4):
                v += jac[p] * covariance[at[p], at[q]] * jac[q]
        variance[k] = v
    return log_range, variance, wall
