"""Numba kernels for light that comes from all sides: from windows, and back from other surfaces.

It changes slowly, so it is found at a few points of every surface.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from galoc_env.render._light_ray_kernel import stopped, trace
from galoc_env.render._sight_kernel import outline, spots_in_sight

FAINT = 0.006
"""Light below this is not worth a ray."""
SIDE = 2
"""Spots along each side of a pane."""
NEAR = 2.0
"""A pane is far where the square of its distance is beyond this times its area."""


@njit(cache=True)
def daylight(world, points, facet, odd, order, panes, spots):  # type: ignore[no-untyped-def]
    """Light of windows.

    Args:
        world: see :func:`trace`.
        points: (M, 3) m.
        facet: (M,) that each lies on; -1 for a point that does not matter.
        odd: (M,) 0 or 1, which neighbours have differently.
        order: (M,) in which points of one facet follow each other.
        panes: (P, 8) plane, area of a spot and power.
        spots: (P, K, 3) m, where the light of each pane starts.

    Returns:
        (M, 3).
    """
    out, corners = np.zeros((points.shape[0], 3)), np.empty((16, 3))
    memory = np.full(panes.shape[0] * spots.shape[1], -1)
    some = np.empty(memory.shape[0], np.int64)
    last, found = -1, 0
    on = np.zeros(world[0].shape[0], np.int64)
    for f in facet:
        on[max(0, f)] += 1
    for m in order:
        f = facet[m]
        if f < 0:
            continue
        if f != last:
            count = outline(world, f, corners)
            found, last = spots_in_sight(world, f, corners, count, panes, spots, memory, some, on[f] > 3), f
        if found:
            _panes(world, points[m], world[0][f, :3], panes, spots, some[:found], odd[m], memory, out[m])
    return out


@njit(cache=True)
def _panes(world, p, n, panes, spots, which, odd, memory, out):  # type: ignore[no-untyped-def]
    """Add the light of some spots of window panes; spot k of pane i has the number i K + k.

    From afar every second spot will do: ``odd`` says which; neighbours use the others.
    """
    per = spots.shape[1]
    for j in which:
        i, k = j // per, j % per
        above = panes[i, 0] * p[0] + panes[i, 1] * p[1] + panes[i, 2] * p[2] - panes[i, 3]
        dx, dy, dz = spots[i, k, 0] - p[0], spots[i, k, 1] - p[1], spots[i, k, 2] - p[2]
        d2 = dx * dx + dy * dy + dz * dz
        towards = n[0] * dx + n[1] * dy + n[2] * dz
        if above <= 1e-4 or towards <= 0.0:
            continue
        # A disc of this area, seen from its axis; right from near and far.
        area = panes[i, 4]
        share = towards * above / d2 * area / (math.pi * d2 + area)
        if d2 > NEAR * area * per:
            if (k + k // SIDE) % 2 != odd:
                continue
            share *= 2.0
        if share * max(panes[i, 5], panes[i, 6], panes[i, 7]) * per < FAINT:
            continue
        if not stopped(world, p[0], p[1], p[2], dx, dy, dz, memory, j):
            for c in range(3):
                out[c] += share * panes[i, 5 + c]


@njit(cache=True)
def look_round(world, points, facet, fan, directions, few, step, size, first, lit):  # type: ignore[no-untyped-def]
    """What rays from every point meet first.

    Args:
        world: see :func:`trace`.
        points: (M, 3) m.
        facet: (M,) that each lies on; -1 for a point that does not matter.
        fan: (M,) set of directions of each point.
        directions: (9, R, 3) along u, v and the normal, cosine-distributed.
        few: (M,) points where every second ray will do, and stands for two.
        step: (N, 2) m between texels.
        size: (N, 2) columns and rows of texels.
        first: (N + 1,) first texel of each facet.
        lit: (N,) whether light matters on a facet.

    Returns:
        (M, R) texel met; -1 for nothing, -2 for the back of a facet, -3 - f for facet f where that is not lit.
        (M,) openness: 1 for a point with nothing near, 0 for one in a narrow corner.
    """
    rays = directions.shape[1]
    hits, openness = np.full((points.shape[0], rays), -1, np.int32), np.zeros(points.shape[0])
    sheets = world[0]
    for m in range(points.shape[0]):
        if facet[m] < 0:
            continue
        s, p, reach = sheets[facet[m]], points[m], 0.0
        for i in range(rays):
            if few[m] and i % 2 == 1:
                hits[m, i] = hits[m, i - 1]
                openness[m] += reach / rays
                continue
            a, b, h = directions[fan[m], i, 0], directions[fan[m], i, 1], directions[fan[m], i, 2]
            dx = a * s[4] + b * s[8] + h * s[0]
            dy = a * s[5] + b * s[9] + h * s[1]
            dz = a * s[6] + b * s[10] + h * s[2]
            g, t = trace(world, p[0], p[1], p[2], dx, dy, dz, 1e3, False)
            reach = min(1.0, t)
            openness[m] += reach / rays
            if g >= 0:
                hits[m, i] = _texel(sheets[g], step[g], size[g], first[g], p, dx, dy, dz, t)
                if sheets[g, 0] * dx + sheets[g, 1] * dy + sheets[g, 2] * dz > 0.0:
                    hits[m, i] = -2
                elif not lit[g]:
                    hits[m, i] = -3 - g
    return hits, openness


@njit(cache=True)
def _texel(s, step, size, first, p, dx, dy, dz, t):  # type: ignore[no-untyped-def]
    """Nearest texel to the point p + t d of a facet."""
    x, y, z = p[0] + t * dx, p[1] + t * dy, p[2] + t * dz
    u = s[4] * x + s[5] * y + s[6] * z - s[7]
    v = s[8] * x + s[9] * y + s[10] * z - s[11]
    c = min(size[0] - 1, max(0, int(u / step[0] + 0.5)))
    r = min(size[1] - 1, max(0, int(v / step[1] + 0.5)))
    return first + r * size[0] + c


@njit(cache=True)
def collect(hits, facet_of, sent, shine, light):  # type: ignore[no-untyped-def]
    """Mean of what the rays' ends send back.

    Args:
        hits: (M, R) see :func:`look_round`.
        facet_of: (T,) facet of each texel.
        sent: (N, 3) part of the light on a facet that it sends back.
        shine: (N, 3) what a facet that is not lit sends by itself.
        light: (T, 3) on each texel.

    Returns:
        (M, 3).
    """
    points, rays = hits.shape
    out = np.zeros((points, 3))
    for m in range(points):
        for i in range(rays):
            h = hits[m, i]
            if h >= 0:
                g = facet_of[h]
                for c in range(3):
                    out[m, c] += sent[g, c] * light[h, c]
            elif h <= -3:
                for c in range(3):
                    out[m, c] += shine[-3 - h, c]
        for c in range(3):
            out[m, c] /= rays
    return out
