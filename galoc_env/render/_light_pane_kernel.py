"""Numba kernels for the light of windows.

From afar a pane is a few spots. Nearby, and above all for what stands on its edge, it is a polygon of known size: its
share of what a point sees is exact, and only the part of it that is hidden is found with rays.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from galoc_env.render._light_ray_kernel import FAINT, LEAN, aim, crossing, point, stopped
from galoc_env.render._sight_kernel import outline, spots_in_sight

SIDE = 2
"""Spots along each side of a pane."""
NEAR = 3.0
"""A pane is far where the square of its distance is beyond this times its area."""
GRAZE = 0.3
"""So close to a pane's plane its spots say little of what is hidden: the rays that look all round do, m."""


@njit(**LEAN)
def _angle(s, c):  # type: ignore[no-untyped-def]
    """Angle from 0 to pi with sine and cosine in proportion to s >= 0 and c, to 1e-5; no library's rounding in it."""
    big, small = max(s, abs(c)), min(s, abs(c))
    x = small / big if big > 0.0 else 0.0
    y = x * x
    a = x * (0.9998660 + y * (-0.3302995 + y * (0.1801410 + y * (-0.0851330 + y * 0.0208351))))
    a = 0.5 * math.pi - a if s > abs(c) else a
    return math.pi - a if c < 0.0 else a


@njit(**LEAN)
def _edge(n, ax, ay, az, bx, by, bz):  # type: ignore[no-untyped-def]
    """What the edge from a to b adds to the sum of Lambert's formula."""
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    s = math.sqrt(x * x + y * y + z * z)
    if s < 1e-12:
        return 0.0
    return (n[0] * x + n[1] * y + n[2] * z) / s * _angle(s, ax * bx + ay * by + az * bz)


@njit(**LEAN)
def seen_share(world, g, p, n):  # type: ignore[no-untyped-def]
    """Part of the light that falls on a surface with normal n at p, if all round were as bright as facet g, from g."""
    edge_first, edges = world[1], world[2]
    start, end = edge_first[g], edge_first[g + 1]
    x, y, z = point(world, g, edges[end - 1, 3], edges[end - 1, 4], 0.0)
    ax, ay, az = x - p[0], y - p[1], z - p[2]
    a = n[0] * ax + n[1] * ay + n[2] * az
    down_x = down_y = down_z = up_x = up_y = up_z = total = 0.0
    for k in range(start, end):
        x, y, z = point(world, g, edges[k, 3], edges[k, 4], 0.0)
        bx, by, bz = x - p[0], y - p[1], z - p[2]
        b = n[0] * bx + n[1] * by + n[2] * bz
        # Of an edge that goes below the horizon only the part above counts.
        if (a > 0.0) != (b > 0.0):
            t = a / (a - b)
            cx, cy, cz = ax + t * (bx - ax), ay + t * (by - ay), az + t * (bz - az)
            if a > 0.0:
                total += _edge(n, ax, ay, az, cx, cy, cz)
                down_x, down_y, down_z = cx, cy, cz
            else:
                total += _edge(n, cx, cy, cz, bx, by, bz)
                up_x, up_y, up_z = cx, cy, cz
        elif a > 0.0:
            total += _edge(n, ax, ay, az, bx, by, bz)
        ax, ay, az, a = bx, by, bz, b
    # Along the horizon, from where the outline goes down to where it comes up.
    total += _edge(n, down_x, down_y, down_z, up_x, up_y, up_z)
    return abs(total) / (2.0 * math.pi)


@njit(**LEAN)
def _by_rays(world, p, s, g, fan, step, hits):  # type: ignore[no-untyped-def]
    """Of the rays from p that aim at facet g, how many there are and how many get there."""
    aimed, arrived = 0, 0
    for i in range(0, hits.shape[0], step):
        dx, dy, dz = aim(s, fan[i])
        if crossing(world[0], world[1], world[2], g, p[0], p[1], p[2], dx, dy, dz, 1e3) > 0.0:
            aimed += 1
            arrived += 1 if hits[i] == -3 - g else 0
    return aimed, arrived


@njit(**LEAN)
def _share(p, n, pane, spot):  # type: ignore[no-untyped-def]
    """Light of a spot as a part of a pane's power: that of a disc seen from its axis, right from near and far."""
    above = pane[0] * p[0] + pane[1] * p[1] + pane[2] * p[2] - pane[3]
    dx, dy, dz = spot[0] - p[0], spot[1] - p[1], spot[2] - p[2]
    towards = n[0] * dx + n[1] * dy + n[2] * dz
    if above <= 1e-4 or towards <= 0.0:
        return 0.0
    d2 = dx * dx + dy * dy + dz * dz
    return towards * above / d2 * pane[4] / (math.pi * d2 + pane[4])


@njit(**LEAN)
def _by_spots(world, p, n, pane, spots, memory, slot):  # type: ignore[no-untyped-def]
    """Part of a pane that is seen from p, by its spots (K, 3); -1 if none of them faces p."""
    total, seen = 0.0, 0.0
    for k in range(spots.shape[0]):
        share = _share(p, n, pane, spots[k])
        total += share
        dx, dy, dz = spots[k, 0] - p[0], spots[k, 1] - p[1], spots[k, 2] - p[2]
        if share > 0.0 and not stopped(world, p[0], p[1], p[2], dx, dy, dz, memory, slot + k):
            seen += share
    return seen / total if total > 0.0 else -1.0


@njit(**LEAN)
def is_near(p, pane, per):  # type: ignore[no-untyped-def]
    """Whether a pane of ``per`` spots is near a point."""
    dx, dy, dz = pane[8] - p[0], pane[9] - p[1], pane[10] - p[2]
    return dx * dx + dy * dy + dz * dz < NEAR * pane[4] * per


@njit(cache=True)
def daylight(world, points, facet, odd, order, panes, pane_facet, spots, fans, fan, few, hits):  # type: ignore[no-untyped-def]
    """Light of windows.

    Args:
        world: see :func:`trace`.
        points: (M, 3) m.
        facet: (M,) that each lies on; -1 for a point that does not matter.
        odd: (M,) 0 or 1, which neighbours have differently.
        order: (M,) in which points of one facet follow each other.
        panes: (P, 11) plane, area of a spot, power and centre.
        pane_facet: (P,) facet of each.
        spots: (P, K, 3) m, where the light of each pane starts.
        fans: as ``directions`` of :func:`galoc_env.render._bounce_kernel.look_round`.
        fan: as there.
        few: as there.
        hits: what that gives.

    Returns:
        (M, 3).
    """
    out, corners, per = np.zeros((points.shape[0], 3)), np.empty((16, 3)), spots.shape[1]
    memory = np.full(panes.shape[0] * per, -1)
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
            _far(world, points[m], world[0][f, :3], panes, spots, some[:found], odd[m], memory, out[m])
        for i in range(panes.shape[0]):
            if is_near(points[m], panes[i], per):
                rays, step = fans[fan[m]], 2 if few[m] else 1
                part = _near(world, points[m], f, panes[i], pane_facet[i], spots[i], rays, step, hits[m], memory, i)
                for c in range(3):
                    out[m, c] += part * panes[i, 5 + c]
    return out


@njit(**LEAN)
def _near(world, p, f, pane, g, spots, fan, step, hits, memory, i):  # type: ignore[no-untyped-def]
    """Light of pane i, which is facet g, at a point p of facet f near it, as a part of its power."""
    s = world[0][f]
    above = pane[0] * p[0] + pane[1] * p[1] + pane[2] * p[2] - pane[3]
    if above <= 1e-4:
        return 0.0
    share = seen_share(world, g, p, s[:3])
    if share * max(pane[5], pane[6], pane[7]) < FAINT:
        return 0.0
    part = -1.0
    if above > GRAZE:
        part = _by_spots(world, p, s[:3], pane, spots, memory, i * spots.shape[0])
    if part < 0.0:
        aimed, arrived = _by_rays(world, p, s, g, fan, step, hits)
        if aimed > 0:
            part = arrived / aimed
        elif above <= GRAZE:
            part = _by_spots(world, p, s[:3], pane, spots, memory, i * spots.shape[0])
    return share * max(0.0, part)


@njit(**LEAN)
def _far(world, p, n, panes, spots, which, odd, memory, out):  # type: ignore[no-untyped-def]
    """Add the light of some spots of window panes; spot k of pane i has the number i K + k.

    Every second spot will do: ``odd`` says which; neighbours use the others.
    """
    per = spots.shape[1]
    for j in which:
        i, k = j // per, j % per
        if (k + k // SIDE) % 2 != odd or is_near(p, panes[i], per):
            continue
        share = 2.0 * _share(p, n, panes[i], spots[i, k])
        if share * max(panes[i, 5], panes[i, 6], panes[i, 7]) * per < FAINT:
            continue
        dx, dy, dz = spots[i, k, 0] - p[0], spots[i, k, 1] - p[1], spots[i, k, 2] - p[2]
        if not stopped(world, p[0], p[1], p[2], dx, dy, dz, memory, j):
            for c in range(3):
                out[c] += share * panes[i, 5 + c]
