"""Numba kernels that follow rays through facets in a grid of cells. Only + - * / sqrt: the same on every machine."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

LEAN: dict[str, Any] = {"cache": True, "_nrt": False}
"""Options of kernels that make no arrays. Numba then does not count the references to those that they are given: each
count is an atomic step, and all of them together took as long as the rays."""
FAINT = 0.006
"""Light below this is not worth a ray."""
TINY = 1e-9
"""A ray crosses no cell's side along an axis in which its direction is less than this."""


@njit(**LEAN)
def _overlaps(sheet, cell_low, cell):  # type: ignore[no-untyped-def]
    """Whether a facet's plane passes a cell."""
    middle, reach = 0.0, 1e-6
    for k in range(3):
        half = 0.5 * cell
        middle += sheet[k] * (cell_low[k] + half)
        reach += abs(sheet[k]) * half
    return abs(middle - sheet[3]) <= reach


@njit(cache=True)
def fill_grid(sheets, boxes, low, cell, size):  # type: ignore[no-untyped-def]
    """Lists of the facets in each cell.

    Args:
        sheets: (N, 17) facets, see :func:`trace`.
        boxes: (N, 2, 3) m.
        low: (3,) m, corner of the grid.
        cell: edge of a cell, m.
        size: (3,) cells along x, y, z.

    Returns:
        (cells + 1,) where each cell's list begins, and the lists.
    """
    first = np.zeros(size[0] * size[1] * size[2] + 1, np.int64)
    items = np.empty(0, np.int32)
    at, a, b = np.empty(3), np.empty(3, np.int64), np.empty(3, np.int64)
    for step in range(2):
        if step == 1:
            first = np.cumsum(first)
            items = np.empty(first[-1], np.int32)
        for f in range(sheets.shape[0]):
            for k in range(3):
                a[k] = max(0, min(size[k] - 1, int(math.floor((boxes[f, 0, k] - 1e-6 - low[k]) / cell))))
                b[k] = max(0, min(size[k] - 1, int(math.floor((boxes[f, 1, k] + 1e-6 - low[k]) / cell))))
            for z in range(a[2], b[2] + 1):
                for y in range(a[1], b[1] + 1):
                    for x in range(a[0], b[0] + 1):
                        at[0], at[1], at[2] = low[0] + x * cell, low[1] + y * cell, low[2] + z * cell
                        if _overlaps(sheets[f], at, cell):
                            index = (z * size[1] + y) * size[0] + x
                            if step == 0:
                                first[index + 1] += 1
                            else:
                                first[index] -= 1
                                items[first[index]] = f
        if step == 0:
            # The second pass counts down from each list's end.
            first[:-1] = first[1:]
            first[-1] = 0
    return first, items


@njit(cache=True, inline="always")
def crossing(sheets, edge_first, edges, f, ox, oy, oz, dx, dy, dz, most):  # type: ignore[no-untyped-def]
    """Where the ray o + t d meets facet f, from either side: t in (0, most), or -1."""
    s = sheets[f]
    slope = s[0] * dx + s[1] * dy + s[2] * dz
    ahead = s[3] - s[0] * ox - s[1] * oy - s[2] * oz
    if slope < 0.0:
        slope, ahead = -slope, -ahead
    if ahead <= 0.0 or ahead >= most * slope:  # most facets end here, before the division
        return -1.0
    t = ahead / slope
    px, py, pz = ox + t * dx, oy + t * dy, oz + t * dz
    u = s[4] * px + s[5] * py + s[6] * pz - s[7]
    if u < 0.0 or u > s[12]:
        return -1.0
    v = s[8] * px + s[9] * py + s[10] * pz - s[11]
    if v < 0.0 or v > s[13]:
        return -1.0
    if s[14] == 0.0:
        for k in range(edge_first[f], edge_first[f + 1]):
            if edges[k, 0] * u + edges[k, 1] * v + edges[k, 2] < 0.0:
                return -1.0
    return t


@njit(**LEAN)
def trace(world, ox, oy, oz, dx, dy, dz, most, any_hit):  # type: ignore[no-untyped-def]
    """First facet on the ray o + t d with t in (0, most), whichever side it turns to the ray.

    Args:
        world: (sheets, edge_first, edges, low, cell, size, first, items). A sheet (17,) is a facet: its plane (4), the
            axes and offsets of its in-plane coordinates u (4) and v (4), its extent in u and v, 1 if it is a
            rectangle, 1 if it stops light, and how far off it light is measured. ``edges`` are half planes in u, v;
            the rest is the grid.
        ox: start, m.
        oy: start, m.
        oz: start, m.
        dx: direction.
        dy: direction.
        dz: direction.
        most: largest t.
        any_hit: any facet that stops light will do, not only the first; those that do not are passed through.

    Returns:
        Facet (-1: none) and t.
    """
    sheets, edge_first, edges, low, cell, size, first, items = world
    x, y, z = (ox - low[0]) / cell, (oy - low[1]) / cell, (oz - low[2]) / cell
    ix, iy, iz = int(math.floor(x)), int(math.floor(y)), int(math.floor(z))
    found, best = -1, most
    step_x, step_y, step_z = 1 if dx > 0 else -1, 1 if dy > 0 else -1, 1 if dz > 0 else -1
    wide_x = cell / abs(dx) if abs(dx) > TINY else 1e30
    wide_y = cell / abs(dy) if abs(dy) > TINY else 1e30
    wide_z = cell / abs(dz) if abs(dz) > TINY else 1e30
    next_x = wide_x * (ix + 1 - x if dx > 0 else x - ix)
    next_y = wide_y * (iy + 1 - y if dy > 0 else y - iy)
    next_z = wide_z * (iz + 1 - z if dz > 0 else z - iz)
    while 0 <= ix < size[0] and 0 <= iy < size[1] and 0 <= iz < size[2]:
        index = (iz * size[1] + iy) * size[0] + ix
        for k in range(first[index], first[index + 1]):
            f = items[k]
            if any_hit and sheets[f, 15] == 0.0:
                continue
            # A sheet seen from both sides is two facets in one place: the one that faces the ray counts.
            t = crossing(sheets, edge_first, edges, f, ox, oy, oz, dx, dy, dz, best + 1e-7)
            if t > 0.0:
                if any_hit:
                    return f, t
                faces = sheets[f, 0] * dx + sheets[f, 1] * dy + sheets[f, 2] * dz < 0.0
                if t < best - 1e-7 or faces:
                    found, best = f, t
        if next_x <= next_y and next_x <= next_z:
            if next_x > best:
                break
            next_x += wide_x
            ix += step_x
        elif next_y <= next_z:
            if next_y > best:
                break
            next_y += wide_y
            iy += step_y
        else:
            if next_z > best:
                break
            next_z += wide_z
            iz += step_z
    return found, best


@njit(**LEAN)
def stopped(world, ox, oy, oz, dx, dy, dz, memory, slot):  # type: ignore[no-untyped-def]
    """Whether something stops light between o and o + d. What did so last for this slot is tried first."""
    f = memory[slot]
    if f >= 0 and crossing(world[0], world[1], world[2], f, ox, oy, oz, dx, dy, dz, 1.0) > 0.0:
        return True
    f, _ = trace(world, ox, oy, oz, dx, dy, dz, 1.0, True)
    if f >= 0:
        memory[slot] = f
    return f >= 0


@njit(**LEAN)
def point(world, f, u, v, lift):  # type: ignore[no-untyped-def]
    """Point at (u, v) in the plane of facet f, lifted off it, m."""
    s = world[0][f]
    # The plane's own axes turn (u, v) back into a point.
    a, b, c = u + s[7], v + s[11], s[3] + lift
    return (
        a * s[4] + b * s[8] + c * s[0],
        a * s[5] + b * s[9] + c * s[1],
        a * s[6] + b * s[10] + c * s[2],
    )


@njit(**LEAN)
def aim(s, ray):  # type: ignore[no-untyped-def]
    """World direction of a ray that is given along u, v and the normal of the facet of sheet s."""
    a, b, h = ray[0], ray[1], ray[2]
    return (
        a * s[4] + b * s[8] + h * s[0],
        a * s[5] + b * s[9] + h * s[1],
        a * s[6] + b * s[10] + h * s[2],
    )


@njit(**LEAN)
def place(world, f, u, v, lift):  # type: ignore[no-untyped-def]
    """As :func:`point`, pulled inside the facet's outline."""
    s, edge_first, edges = world[0][f], world[1], world[2]
    inset = min(0.03, 0.25 * min(s[12], s[13]))
    if s[14] == 0.0:
        u, v = _inside(edge_first[f], edge_first[f + 1], edges, inset, u, v)
    else:
        u, v = max(inset, min(s[12] - inset, u)), max(inset, min(s[13] - inset, v))
    return point(world, f, u, v, lift)


@njit(**LEAN)
def _inside(start, end, edges, inset, u, v):  # type: ignore[no-untyped-def]
    """(u, v) moved to lie inside a polygon, off its edges as far as ``inset`` and its size allow."""
    mid_u = mid_v = 0.0
    for k in range(start, end):
        mid_u += edges[k, 3] / (end - start)
        mid_v += edges[k, 4] / (end - start)
    for k in range(start, end):
        inset = min(inset, 0.5 * (edges[k, 0] * mid_u + edges[k, 1] * mid_v + edges[k, 2]))
    for _ in range(3):  # the nearest point, nearly
        for k in range(start, end):
            off = inset - (edges[k, 0] * u + edges[k, 1] * v + edges[k, 2])
            if off > 0.0:
                u += off * edges[k, 0]
                v += off * edges[k, 1]
    back = 0.0
    for k in range(start, end):
        here = edges[k, 0] * u + edges[k, 1] * v + edges[k, 2]
        middle = edges[k, 0] * mid_u + edges[k, 1] * mid_v + edges[k, 2]
        if here < inset:
            back = max(back, (inset - here) / max(middle - here, 1e-12))
    back = min(back, 1.0)
    return u + back * (mid_u - u), v + back * (mid_v - v)
