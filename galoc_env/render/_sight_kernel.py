"""Numba kernels that say what cannot be seen from a whole facet, so that no ray is spent on it."""

from __future__ import annotations

import numpy as np
from numba import njit

from galoc_env.render._light_ray_kernel import LEAN, crossing, place, stopped, trace

LIFT = 0.003
"""Light is measured this far off a facet, m."""
COVER = 0.03
"""A facet with another one closer before it than this is measured before that one, m."""
NARROW = 0.3
"""Two walls that face each other this closely enclose what nobody sees, m."""
PARALLEL = 0.95
"""... if the cosine of the angle between them is at least this: rooms have acute corners."""


@njit(**LEAN)
def _look_out(world, wall, f):  # type: ignore[no-untyped-def]
    """Whether a facet is hidden, see :func:`survey`, and how far off it light is to be measured, m."""
    s = world[0]
    n = s[f, :3]
    close, covered, off = 0, 0, 0.0
    for k in range(5):
        # Not at the very corners: walls reach through floor and ceiling, and into each other.
        u = s[f, 12] * (0.5 if k == 4 else 0.1 + 0.8 * (k % 2))
        v = s[f, 13] * (0.5 if k == 4 else 0.1 + 0.8 * (k // 2))
        p = place(world, f, u, v, LIFT)
        g, t = trace(world, p[0], p[1], p[2], n[0], n[1], n[2], 1e3, False)
        facing = 0.0 if g < 0 else s[g, 0] * n[0] + s[g, 1] * n[1] + s[g, 2] * n[2]
        close += 1 if g >= 0 and wall[f] and wall[g] and t < NARROW and abs(facing) > PARALLEL else 0
        if g >= 0 and t < COVER and facing > 0.0:
            covered += 1
            off = max(off, t)
    # Three of five: the end of a wall may look along the inside of another one.
    return close >= 3, (LIFT + off + LIFT if covered >= 3 else LIFT)


@njit(cache=True)
def survey(world, lit, wall):  # type: ignore[no-untyped-def]
    """(N,) facets that face away from all rooms: walls towards another one close by, as in the core of a wall.

    What faces the void is not left out: plans have gaps, and there is no telling inside from outside then.

    Also sets how far off each facet light is measured: a frame behind a picture shows, though most of it is covered.

    Args:
        world: see :func:`trace`.
        lit: (N,) facets to look at.
        wall: (N,) which are walls.
    """
    out = np.zeros(lit.shape[0], np.bool_)
    for f in range(lit.shape[0]):
        if lit[f]:
            out[f], world[0][f, 16] = _look_out(world, wall, f)
    return out


@njit(**LEAN)
def outline(world, f, out):  # type: ignore[no-untyped-def]
    """Points (K, 3) into ``out`` between which all texels of a facet lie; gives K."""
    s, edge_first, edges = world[0][f], world[1], world[2]
    count = 0
    if s[14] == 1.0:
        for k in range(4):
            p = place(world, f, s[12] * (k % 2), s[13] * (k // 2), s[16])
            out[k, 0], out[k, 1], out[k, 2] = p
        return 4
    for k in range(edge_first[f], edge_first[f + 1]):
        p = place(world, f, edges[k, 3], edges[k, 4], s[16])
        out[count, 0], out[count, 1], out[count, 2] = p
        count += 1
    return count


@njit(**LEAN)
def _covers(world, g, points, count, spots):  # type: ignore[no-untyped-def]
    """Whether facet g hides all spots (S, 3) from all points: then it does so from all between them, being convex."""
    if g < 0:
        return False
    for i in range(count):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for k in range(spots.shape[0]):
            dx, dy, dz = spots[k, 0] - x, spots[k, 1] - y, spots[k, 2] - z
            if crossing(world[0], world[1], world[2], g, x, y, z, dx, dy, dz, 1.0) < 0.0:
                return False
    return True


@njit(**LEAN)
def _out_of_sight(world, points, count, spots, memory, slot):  # type: ignore[no-untyped-def]
    """Whether one facet hides all spots from all points; ``memory`` says what is tried first."""
    if _covers(world, memory[slot], points, count, spots):
        return True
    for i in (0, count - 1):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if not stopped(world, x, y, z, spots[0, 0] - x, spots[0, 1] - y, spots[0, 2] - z, memory, slot):
            return False
        if _covers(world, memory[slot], points, count, spots):
            return True
    return False


@njit(**LEAN)
def _nearest(points, count, x, y, z):  # type: ignore[no-untyped-def]
    """Square of the distance from a place to the box around an outline: nothing in that is nearer, m^2."""
    d2 = 0.0
    for c in range(3):
        low = high = points[0, c]
        for k in range(1, count):
            low, high = min(low, points[k, c]), max(high, points[k, c])
        at = x if c == 0 else y if c == 1 else z
        off = max(0.0, low - at, at - high)
        d2 += off * off
    return d2


@njit(cache=True)
def lamps_in_sight(world, f, points, count, lamps, memory, some, look, faint):  # type: ignore[no-untyped-def]
    """Which lamps (L, 7) may light a facet with this outline: their numbers into ``some``; gives their count.

    Without ``look`` only those behind the facet, and too far off to shed more than ``faint``, are left out.
    """
    ball, n, found = np.empty((6, 3)), world[0][f], 0
    for i in range(lamps.shape[0]):
        front = n[0] * lamps[i, 0] + n[1] * lamps[i, 1] + n[2] * lamps[i, 2] - n[3]
        if front <= 0.0:
            continue
        power = max(lamps[i, 3], lamps[i, 4], lamps[i, 5])
        if power < faint * _nearest(points, count, lamps[i, 0], lamps[i, 1], lamps[i, 2]):
            continue
        for k in range(6 if look else 0):
            for c in range(3):
                ball[k, c] = lamps[i, c] + (lamps[i, 6] * (1 - 2 * (k % 2)) if c == k // 2 else 0.0)
        if not look or not _out_of_sight(world, points, count, ball, memory, 4 * i):
            some[found] = i
            found += 1
    return found


@njit(cache=True)
def spots_in_sight(world, f, points, count, panes, spots, memory, some, look):  # type: ignore[no-untyped-def]
    """As :func:`lamps_in_sight` for the spots (P, K, 3) of panes (P, 11); spot k of pane i has the number i K + k."""
    n, found, per = world[0][f], 0, spots.shape[1]
    for i in range(panes.shape[0]):
        above = -1.0
        for k in range(count):
            up = panes[i, 0] * points[k, 0] + panes[i, 1] * points[k, 1] + panes[i, 2] * points[k, 2] - panes[i, 3]
            above = max(above, up)
        if above <= 1e-4:
            continue
        for k in range(per):
            front = n[0] * spots[i, k, 0] + n[1] * spots[i, k, 1] + n[2] * spots[i, k, 2] - n[3]
            slot = i * per + k
            if front > 0.0 and (not look or not _out_of_sight(world, points, count, spots[i, k : k + 1], memory, slot)):
                some[found] = slot
                found += 1
    return found
