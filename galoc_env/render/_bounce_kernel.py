"""Numba kernels for light that comes back from other surfaces.

It changes slowly, so it is found at a few points of every surface. What stands on a floor darkens it within a hand's
breadth, though: that is found for each of its texels.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from galoc_env.render._light_ray_kernel import LEAN, aim, place, trace


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
            dx, dy, dz = aim(s, directions[fan[m], i])
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


@njit(**LEAN)
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


@njit(cache=True)
def contact(world, floor, bodies, directions, reach, step, size, first):  # type: ignore[no-untyped-def]
    """How close to bodies the texels of floors are: (T,) 0 in the open to 1 under or inside a body.

    The same rays from every texel: along a straight edge all get the same.

    Args:
        world: see :func:`trace`.
        floor: (N,) facets to look at; others have 0.
        bodies: (N,) facets that count.
        directions: (R, 4) along u, v and the normal, and the weight; weights add up to 1.
        reach: what is farther away does not count, m.
        step: (N, 2) m between texels.
        size: (N, 2) columns and rows of texels.
        first: (N + 1,) first texel of each facet.
    """
    out, sheets = np.zeros(first[-1]), world[0]
    for f in range(floor.shape[0]):
        s = sheets[f]
        for k in range(size[f, 0] * size[f, 1] if floor[f] else 0):
            p = place(world, f, (k % size[f, 0]) * step[f, 0], (k // size[f, 0]) * step[f, 1], s[16])
            near = 0.0
            for i in range(directions.shape[0]):
                dx, dy, dz = aim(s, directions[i])
                g, t = trace(world, p[0], p[1], p[2], dx, dy, dz, reach, False)
                if g >= 0 and bodies[g]:
                    near += directions[i, 3] * (1.0 - t / reach)
                    if sheets[g, 0] * dx + sheets[g, 1] * dy + sheets[g, 2] * dz > 0.0:
                        near = 1.0  # inside something
                        break
            out[first[f] + k] = near
    return out
