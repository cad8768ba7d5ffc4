"""Numba kernel that merges triangles of one plane into convex polygons."""

from __future__ import annotations

import numpy as np
from numba import njit

STRAIGHT = 1e-5
"""A corner whose sine is below this is none: neighbouring edges continue each other."""


@njit(cache=True)
def root(parent, k):  # type: ignore[no-untyped-def]
    """Which stands for all that k has been joined with; ``parent`` is flattened on the way."""
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@njit(cache=True)
def _bend(direction, normal, a, b):  # type: ignore[no-untyped-def]
    """Sine of the left turn from half-edge a to half-edge b, and whether it is a straight continuation."""
    ax, ay, az = direction[a, 0], direction[a, 1], direction[a, 2]
    bx, by, bz = direction[b, 0], direction[b, 1], direction[b, 2]
    f = a // 3
    sine = (ay * bz - az * by) * normal[f, 0] + (az * bx - ax * bz) * normal[f, 1] + (ax * by - ay * bx) * normal[f, 2]
    ahead = ax * bx + ay * by + az * bz > 0.0
    return sine, ahead and abs(sine) < STRAIGHT


@njit(cache=True)
def _corners(direction, normal, following, start, skip_from, skip_to):  # type: ignore[no-untyped-def]
    """True corners met from half-edge ``start`` on, up to the one that follows ``skip_from`` or ``skip_to``."""
    count = 0
    h = start
    while h != skip_from and h != skip_to:
        n = following[h]
        if n != skip_from and n != skip_to:
            _, straight = _bend(direction, normal, h, n)
            count += 0 if straight else 1
        h = n
    return count


@njit(cache=True)
def _chain(following, previous, twin, h):  # type: ignore[no-untyped-def]
    """First and last half-edge of the chain around h that the same two polygons share."""
    start, end = h, h
    while twin[previous[start]] == following[twin[start]] and previous[start] != h:
        start = previous[start]
    while twin[following[end]] == previous[twin[end]] and following[end] != h:
        end = following[end]
    return start, end


@njit(cache=True)
def merge(direction, normal, area, twin, order, most):  # type: ignore[no-untyped-def]
    """Hertel and Mehlhorn: take out shared edges, in the given order, wherever both of their ends stay convex.

    Half-edge 3 f + k runs from corner k of triangle f to the next one. Two faces may share a chain of edges that
    continue each other; it goes as a whole.

    Args:
        direction: (3 F, 3) unit vector of each half-edge.
        normal: (F, 3) unit normal of each triangle.
        area: (F,) of each triangle.
        twin: (3 F,) the same edge seen from the other triangle of the same group; -1 for none.
        order: (E,) half-edges to try.
        most: corners of a polygon at most.

    Returns:
        Half-edges whose starts are the corners of the polygons, one polygon after the other; (N + 1,) where each
        begins; (N,) the largest triangle in each.
    """
    faces = area.shape[0]
    following, previous = np.empty(3 * faces, np.int64), np.empty(3 * faces, np.int64)
    parent, any_edge, largest = np.empty(faces, np.int64), np.empty(faces, np.int64), np.empty(faces, np.int64)
    for f in range(faces):
        parent[f], any_edge[f], largest[f] = f, 3 * f, f
        for k in range(3):
            following[3 * f + k], previous[3 * f + k] = 3 * f + (k + 1) % 3, 3 * f + (k + 2) % 3
    gone = np.zeros(3 * faces, np.bool_)
    changed = True
    while changed:
        changed = False
        for e in range(order.shape[0]):
            h = order[e]
            if gone[h]:
                continue
            a, b = root(parent, h // 3), root(parent, twin[h] // 3)
            if a == b:
                continue
            start, end = _chain(following, previous, twin, h)
            a_last, b_first = previous[start], following[twin[start]]
            b_last, a_first = previous[twin[end]], following[end]
            sine0, straight0 = _bend(direction, normal, a_last, b_first)
            sine1, straight1 = _bend(direction, normal, b_last, a_first)
            if not (straight0 or sine0 >= STRAIGHT) or not (straight1 or sine1 >= STRAIGHT):
                continue
            count = _corners(direction, normal, following, a_first, start, h)
            count += _corners(direction, normal, following, b_first, twin[end], twin[h])
            if count + (0 if straight0 else 1) + (0 if straight1 else 1) > most:
                continue
            k = start
            gone[k] = gone[twin[k]] = True
            while k != end:
                k = following[k]
                gone[k] = gone[twin[k]] = True
            following[a_last], previous[b_first] = b_first, a_last
            following[b_last], previous[a_first] = a_first, b_last
            parent[b], any_edge[a] = a, a_last
            if area[largest[b]] > area[largest[a]]:
                largest[a] = largest[b]
            changed = True
    return _loops(direction, normal, following, parent, any_edge, largest)


@njit(cache=True)
def _loops(direction, normal, following, parent, any_edge, largest):  # type: ignore[no-untyped-def]
    """What :func:`merge` returns."""
    faces = parent.shape[0]
    corner, first, chosen = np.empty(3 * faces, np.int64), np.zeros(faces + 1, np.int64), np.empty(faces, np.int64)
    count, polygons = 0, 0
    for f in range(faces):
        if parent[f] != f:
            continue
        h = any_edge[f]
        while True:
            n = following[h]
            _, straight = _bend(direction, normal, h, n)
            if not straight:
                corner[count] = n
                count += 1
            h = n
            if h == any_edge[f]:
                break
        if count - first[polygons] < 3:  # a sliver
            count = first[polygons]
            continue
        chosen[polygons] = largest[f]
        polygons += 1
        first[polygons] = count
    return corner[:count], first[: polygons + 1], chosen[:polygons]
