"""Numba kernels: what of a map is seen from a pose, and how far that contradicts an observation.

Where segments come from :func:`nearby`, with their distances ``far``, a search ends once all that follow are farther
than what was found. ``far`` holds where they were sorted; ``moved`` is the way from there. Without ``far`` segments may
come in any order.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

NEAR = 0.08
"""Nothing nearer than this is predicted, m."""


@njit(cache=True, error_model="numpy")
def cast(segments, x, y, c, s, far=None, moved=0.0):  # type: ignore[no-untyped-def]
    """Range and index of the first segment along (c, s), in multiples of that vector; (inf, -1) for none."""
    best, index = np.inf, -1
    size = math.hypot(c, s)
    for k in range(segments.shape[0]):
        if far is not None:
            if far[k] - moved > best * size:
                break
        x0, y0 = segments[k, 0] - x, segments[k, 1] - y
        dx, dy = segments[k, 2] - segments[k, 0], segments[k, 3] - segments[k, 1]
        den = c * dy - s * dx
        if den == 0.0:
            continue
        t = (x0 * dy - y0 * dx) / den
        if t <= 1e-9 or t >= best:
            continue
        u = (x0 * s - y0 * c) / den
        if u < -1e-9 or u > 1.0 + 1e-9:
            continue
        best, index = t, k
    return best, index


@njit(cache=True, error_model="numpy")
def nearby(segments, x, y, reach):  # type: ignore[no-untyped-def]
    """Segments that come within ``reach`` of (x, y), nearest first: what hides something is found early.

    Returns:
        (C, 4) segments and (C,) their distances, m.
    """
    order, distance, count = np.empty(segments.shape[0], np.int64), np.empty(segments.shape[0]), 0
    for k in range(segments.shape[0]):
        ax, ay = segments[k, 0] - x, segments[k, 1] - y
        dx, dy = segments[k, 2] - segments[k, 0], segments[k, 3] - segments[k, 1]
        u = min(1.0, max(0.0, -(ax * dx + ay * dy) / (dx * dx + dy * dy)))
        px, py = ax + u * dx, ay + u * dy
        square = px * px + py * py
        if square <= reach * reach:
            order[count], distance[count] = k, math.sqrt(square)
            count += 1
    sort_both(distance[:count], order[:count])
    near = np.empty((count, 4))
    for i in range(count):
        for q in range(4):
            near[i, q] = segments[order[i], q]
    return near, distance[:count]


@njit(cache=True, error_model="numpy")
def within(points, x, y, reach):  # type: ignore[no-untyped-def]
    """The points (C, 2) that come within ``reach`` of (x, y)."""
    out, count = np.empty(points.shape), 0
    for k in range(points.shape[0]):
        dx, dy = points[k, 0] - x, points[k, 1] - y
        if dx * dx + dy * dy <= reach * reach:
            out[count, 0], out[count, 1] = points[k, 0], points[k, 1]
            count += 1
    return out[:count]


@njit(cache=True, error_model="numpy")
def sort_both(keys, values):  # type: ignore[no-untyped-def]
    """Sort keys in place and values along with them (Shell's sort: compiles in a tenth of the time of numpy's)."""
    gap = 1
    while gap < keys.shape[0]:
        gap = 3 * gap + 1
    while gap > 1:
        gap //= 3
        for i in range(gap, keys.shape[0]):
            key, value, j = keys[i], values[i], i
            while j >= gap and keys[j - gap] > key:
                keys[j], values[j] = keys[j - gap], values[j - gap]
                j -= gap
            keys[j], values[j] = key, value


@njit(cache=True, error_model="numpy")
def blocker(segments, x, y, dx, dy, limit, first, far=None, moved=0.0):  # type: ignore[no-untyped-def]
    """Index of a segment that crosses the way from (x, y) along (dx, dy) before ``limit`` of its length; -1 for none.

    Segment ``first`` is tried first: what hides one thing often hides the next.
    """
    length = limit * math.hypot(dx, dy)
    for n in range(-1 if segments.shape[0] > 0 else 0, segments.shape[0]):
        k = n if n >= 0 else first
        if far is not None:
            if n >= 0 and far[n] - moved > length:
                break
        x0, y0 = segments[k, 0] - x, segments[k, 1] - y
        ex, ey = segments[k, 2] - segments[k, 0], segments[k, 3] - segments[k, 1]
        den = dx * ey - dy * ex
        if den == 0.0:
            continue
        t = (x0 * ey - y0 * ex) / den
        if t <= 1e-9 or t >= limit:
            continue
        u = (x0 * dy - y0 * dx) / den
        if -1e-9 <= u <= 1.0 + 1e-9:
            return k
    return -1


@njit(cache=True, error_model="numpy")
def visible_corners(segments, corners, x, y, heading, m_low, m_high, out, far=None, moved=0.0):  # type: ignore[no-untyped-def]
    """Map corners seen within [m_low, m_high] as rows (m, z, corner index) of ``out``; returns their number."""
    c, s = math.cos(heading), math.sin(heading)
    count, last = 0, 0
    for k in range(corners.shape[0]):
        dx, dy = corners[k, 0] - x, corners[k, 1] - y
        z = c * dx + s * dy
        if z < NEAR or count >= out.shape[0]:
            continue
        m = (s * dx - c * dy) / z
        if m < m_low or m > m_high:
            continue
        limit = 1.0 - 0.03 / math.hypot(dx, dy) - 0.005
        found = blocker(segments, x, y, dx, dy, limit, last, far, moved)
        if found >= 0:
            last = found
            continue
        out[count, 0], out[count, 1], out[count, 2] = m, z, k
        count += 1
    return count


@njit(cache=True, error_model="numpy")
def ray_cost(pose, segments, azimuths, seen, sd, least, saturation, far=None, moved=0.0):  # type: ignore[no-untyped-def]
    """Sum of robust squared residuals of the rays at a pose.

    Nodes say how well walls fit; rays, that nothing stands between the nodes.
    """
    x, y, heading, g = pose[0], pose[1], pose[2], pose[3]
    total = 0.0
    for i in range(azimuths.shape[0]):
        if not sd[i] > 0.0:
            continue
        b = heading - azimuths[i]
        reach, k = cast(segments, x, y, math.cos(b), math.sin(b), far, moved)
        # A map without a wall there contradicts a wall that is seen, fully.
        e = max(math.log(reach) - seen[i] - g, least[i]) / sd[i] if k >= 0 else 1e3
        total += e * e * saturation / (e * e + saturation)
    return total


@njit(cache=True, error_model="numpy")
def unseen_corners(  # type: ignore[no-untyped-def]
    pose, segments, corners, nodes, cov, azimuths, sd, seen, far=None, moved=0.0
):
    """Map corners that should be seen on the known walls and are not: their number at a pose."""
    n = nodes.shape[0]
    count = visible_corners(segments, corners, pose[0], pose[1], pose[2], -20.0, 20.0, seen, far, moved)
    missing = 0.0
    for q in range(count):
        m = seen[q, 0]
        azimuth = math.atan(m)
        covered = False
        for i in range(azimuths.shape[0]):
            if sd[i] > 0.0 and abs(azimuths[i] - azimuth) < 0.02:
                covered = True
                break
        if not covered:
            continue
        for i in range(n):
            if abs(nodes[i, 0] - m) < 3.0 * math.sqrt(cov[2 * i, 2 * i]) + 0.02 * (1.0 + m * m):
                covered = False
                break
        if covered:
            missing += 1.0
    return missing
