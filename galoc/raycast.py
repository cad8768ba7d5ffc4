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
NEAR_BIN = 1e-4
"""More than the error of :func:`bearing_deg`, degrees."""
ON_RAY = 1e-11
"""Sine of the angle, about, within which an end point lies on a ray: both walls that meet on a ray stop it."""
LEAST, MOST = 32, 128
"""Segments visited between two looks at whether anything that follows can matter: as many as before, within these."""
VECTOR = {"nnan", "ninf", "nsz"}
"""What LLVM must be told to vectorise minima; nothing that changes a rounding."""


@njit(cache=True, fastmath=VECTOR)
def bearing_deg(x, y):  # type: ignore[no-untyped-def]
    """Bearing of (x, y) in [0, 360] degrees to 1.5e-5 degrees; unlike ``atan2`` it can be vectorised. 0 for (0, 0)."""
    a, b = abs(x), abs(y)
    t = min(a, b) / max(max(a, b), 1e-300)
    u = t * t
    angle = 4.562095973183682 + u * (-1.9253754674771242 + u * 0.3902853370713309)
    angle = 11.349042190215293 + u * (-7.582144801088957 + u * angle)
    angle = t * (57.29555672732843 + u * (-19.08944578793006 + u * angle))
    angle = 90.0 - angle if b > a else angle
    angle = 180.0 - angle if x < 0.0 else angle
    return 360.0 - angle if y < 0.0 else angle


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
    out = np.empty((positions.shape[0], BINS), np.float32)
    by_tile, first, cosine, sine = _prepared(tile, order.shape[0])
    for t in prange(order.shape[0]):
        mine = by_tile[first[t] : first[t + 1]]
        _cast_tile(positions, mine, order[t], distance[t], segments, cosine, sine, out)
    return out


@njit(cache=True)
def _prepared(tile, tiles):  # type: ignore[no-untyped-def]
    """Positions by tile, the first of each tile, and the directions of the bins."""
    first = np.zeros(tiles + 1, np.int64)
    for t in tile:
        first[t + 1] += 1
    for t in range(tiles):
        first[t + 1] += first[t]
    free = first.copy()
    by_tile = np.empty(tile.shape[0], np.int64)
    for i in range(tile.shape[0]):
        by_tile[free[tile[i]]] = i
        free[tile[i]] += 1
    cosine, sine = np.empty(2 * BINS), np.empty(2 * BINS)
    for b in range(2 * BINS):
        cosine[b], sine[b] = math.cos(math.radians(b % BINS)), math.sin(math.radians(b % BINS))
    return by_tile, first, cosine, sine


@njit(cache=True)
def _cast_tile(positions, mine, order, distance, segments, cosine, sine, out):  # type: ignore[no-untyped-def]
    """Cast from the positions ``mine``, all of one tile."""
    ends = np.empty((4, order.shape[0]))
    for q in range(order.shape[0]):
        for e in range(4):
            ends[e, q] = segments[order[q], e]
    inverse, span, before = np.empty(2 * BINS), np.empty((2, MOST)), np.empty(2 * BINS + 1, np.int32)
    for i in mine:
        _cast_one(positions[i, 0], positions[i, 1], ends, distance, cosine, sine, inverse, span, before, out[i])


@njit(cache=True, fastmath=VECTOR)
def _cast_one(x, y, ends, distance, cosine, sine, inverse, span, before, out):  # type: ignore[no-untyped-def]
    count = distance.shape[0]
    inverse[:] = NOTHING  # unrolled: a wall across bearing 0 covers one run of bins
    stop = 0
    while stop < count:
        start = stop
        # before[b]: how many of the bins 0..b-1 are farther than whatever follows can be near
        if not _still_open(inverse, distance[start], before):
            break
        stop = min(start + min(max(start, LEAST), MOST), count)
        _spans(x, y, ends[0, start:stop], ends[1, start:stop], ends[2, start:stop], ends[3, start:stop], span)
        for q in range(stop - start):
            low, high = int(span[0, q]), int(span[1, q])
            if low > high or before[low] == before[high + 1]:
                continue
            ax, ay = ends[0, start + q] - x, ends[1, start + q] - y
            bx, by = ends[2, start + q] - x, ends[3, start + q] - y
            cross = ax * by - ay * bx
            if abs(cross) < 1e-12:
                continue  # seen edge-on
            if cross < 0.0:
                ax, ay, bx, by, cross = bx, by, ax, ay, -cross
            if sine[low] * ax - cosine[low] * ay < -ON_RAY * (abs(ax) + abs(ay)):
                low += 1
            if low <= high and cosine[high] * by - sine[high] * bx < -ON_RAY * (abs(bx) + abs(by)):
                high -= 1
            fx, fy = (bx - ax) / cross, (by - ay) / cross
            near, c, s = inverse[low : high + 1], cosine[low : high + 1], sine[low : high + 1]
            for j in range(near.shape[0]):
                near[j] = max(near[j], c[j] * fy - s[j] * fx)
    for b in range(BINS):
        out[b] = 1.0 / max(inverse[b], inverse[b + BINS])


@njit(cache=True, fastmath=VECTOR)
def _still_open(inverse, distance, before):  # type: ignore[no-untyped-def]
    """Count the bins that a wall at this distance could still shorten."""
    total = 0
    for b in range(BINS):
        before[b] = total
        nearest = max(inverse[b], inverse[b + BINS])
        inverse[b] = nearest
        inverse[b + BINS] = nearest
        total += distance * nearest <= 1.0
    for b in range(BINS + 1):
        before[b + BINS] = total + before[b] if b < BINS else 2 * total
    return total > 0


@njit(cache=True, fastmath=VECTOR)
def _spans(x, y, x1, y1, x2, y2, span):  # type: ignore[no-untyped-def]
    """First and last whole degree that each segment may cover; a first above the last where it covers none."""
    low, high = span[0], span[1]
    for q in range(x1.shape[0]):
        ax, ay, bx, by = x1[q] - x, y1[q] - y, x2[q] - x, y2[q] - y
        a, b = bearing_deg(ax, ay), bearing_deg(bx, by)
        back = ax * by - ay * bx < 0.0
        start = b if back else a
        end = a if back else b
        end = end + 360.0 if end < start - NEAR_BIN else end
        low[q] = math.ceil(start - NEAR_BIN)
        high[q] = math.floor(end + NEAR_BIN)
