"""Exact 360-bin range profiles by a one-dimensional z-buffer (numba kernels only).

Each segment covers an interval of bearings; within it 1/range is linear in (cos, sin) of the bearing, so a profile is
a maximum of 1/range over segments. Segments are visited front to back from a per-tile list, so far walls are skipped
as soon as every bin is closer than anything that can follow.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

BINS = 360
"""Bins of a profile; bin b looks along plan bearing b degrees."""
NOTHING = 1e-3
"""1/range of a bin that hits no wall: 1 km."""


@njit(cache=True, parallel=True)
def tile_lists(centres, half, segments):  # type: ignore[no-untyped-def]
    """For each square tile the segments sorted by their least distance to it.

    Args:
        centres: (T, 2) m.
        half: half diagonal of a tile, m.
        segments: (S, 4) m.

    Returns:
        (T, S) int32 order and (T, S) float32 least distance to any point of the tile, m.
    """
    n, s = centres.shape[0], segments.shape[0]
    order = np.empty((n, s), np.int32)
    distance = np.empty((n, s), np.float32)
    for t in prange(n):
        d = np.empty(s)
        for k in range(s):
            ax, ay = segments[k, 0] - centres[t, 0], segments[k, 1] - centres[t, 1]
            dx, dy = segments[k, 2] - segments[k, 0], segments[k, 3] - segments[k, 1]
            u = -(ax * dx + ay * dy) / (dx * dx + dy * dy)
            u = min(1.0, max(0.0, u))
            d[k] = max(0.0, math.hypot(ax + u * dx, ay + u * dy) - half)
        index = np.argsort(d)
        for k in range(s):
            order[t, k] = index[k]
            distance[t, k] = d[index[k]]
    return order, distance


@njit(cache=True, parallel=True)
def cast_profiles(positions, tile, order, distance, segments):  # type: ignore[no-untyped-def]
    """Range profiles of positions, exact at the bin bearings.

    Args:
        positions: (P, 2) m.
        tile: (P,) tile of each position.
        order: (T, S) from :func:`tile_lists`.
        distance: (T, S) from :func:`tile_lists`.
        segments: (S, 4) m.

    Returns:
        (P, 360) float32, m.
    """
    cosine = np.empty(BINS)
    sine = np.empty(BINS)
    for b in range(BINS):
        cosine[b] = math.cos(math.radians(b))
        sine[b] = math.sin(math.radians(b))
    n = positions.shape[0]
    out = np.empty((n, BINS), np.float32)
    for i in prange(n):
        _cast_one(positions[i, 0], positions[i, 1], order[tile[i]], distance[tile[i]], segments, cosine, sine, out[i])
    return out


@njit(cache=True)
def _cast_one(x, y, order, distance, segments, cosine, sine, out):  # type: ignore[no-untyped-def]
    inverse = np.full(BINS, NOTHING)
    visited = 0
    for q in range(order.shape[0]):
        if visited >= 16:
            visited = 0
            nearest = inverse[0]
            for b in range(1, BINS):
                nearest = min(nearest, inverse[b])
            if distance[q] * nearest > 1.0:
                break
        visited += 1
        k = order[q]
        ax, ay = segments[k, 0] - x, segments[k, 1] - y
        bx, by = segments[k, 2] - x, segments[k, 3] - y
        cross = ax * by - ay * bx
        if abs(cross) < 1e-12:
            continue  # seen edge-on
        if cross < 0.0:
            ax, ay, bx, by, cross = bx, by, ax, ay, -cross
        start = math.degrees(math.atan2(ay, ax))
        stop = math.degrees(math.atan2(by, bx))
        if stop < start:
            stop += 360.0
        fx, fy = (bx - ax) / cross, (by - ay) / cross
        for b in range(int(math.ceil(start - 1e-9)), int(math.floor(stop + 1e-9)) + 1):
            j = b % BINS
            inverse[j] = max(inverse[j], cosine[j] * fy - sine[j] * fx)
    for b in range(BINS):
        out[b] = 1.0 / inverse[b]
