"""Numba kernel of the corner-distance profiles: how far each bearing of a position is from a visible map corner."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from galoc.raycast import BINS, NEAR_BIN, bearing_deg

FAR_DEG = 12.0
"""A bearing without a visible map corner within this has none."""
CODE_DEG = 0.05
"""Step in which corner distances are stored, degrees."""
BLOCK = 32
"""Positions that share one set of buffers."""


@njit(cache=True, parallel=True)
def corner_distances(positions, ranges, corners):  # type: ignore[no-untyped-def]
    """Angle from each whole degree of bearing to the nearest visible map corner, cut at ``FAR_DEG``.

    Args:
        positions: (P, 2) m.
        ranges: (P, 360) profiles, m.
        corners: (C, 2) m.

    Returns:
        (P, 360) uint8, in steps of ``CODE_DEG``.
    """
    count, total = positions.shape[0], corners.shape[0]
    out = np.empty((count, BINS), np.uint8)
    xs, ys = corners[:, 0].copy(), corners[:, 1].copy()
    for block in prange((count + BLOCK - 1) // BLOCK):
        near = np.empty(BINS)
        sight = np.empty(BINS + 1)
        bearing, distance = np.empty(total), np.empty(total)
        for p in range(block * BLOCK, min((block + 1) * BLOCK, count)):
            for b in range(BINS + 1):  # seen unless both neighbouring rays end before it
                sight[b] = 1.02 * max(ranges[p, b % BINS], ranges[p, (b + 1) % BINS]) + 0.05
            for c in range(total):
                dx, dy = xs[c] - positions[p, 0], ys[c] - positions[p, 1]
                distance[c] = math.sqrt(dx * dx + dy * dy)
                bearing[c] = bearing_deg(dx, dy)
            near[:] = FAR_DEG
            for c in range(total):
                if 0.05 <= distance[c] <= sight[int(bearing[c] + NEAR_BIN)]:
                    _mark(near, bearing[c])
            for b in range(BINS):
                out[p, b] = np.uint8(near[b] / CODE_DEG + 0.5)
    return out


@njit(cache=True)
def _mark(near, bearing):  # type: ignore[no-untyped-def]
    """Enter a corner at this bearing, degrees."""
    low, reach = int(bearing), int(FAR_DEG)
    for k in range(low - reach, low + reach + 2):
        b = k % BINS
        near[b] = min(near[b], abs(k - bearing))
