"""Numba kernels for surfaces: facets that continue each other in one plane share a lattice of points for soft light.

Without it every joint of two facets would show as an edge of light.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from galoc_env.render._light_ray_kernel import LEAN, place, point, trace
from galoc_env.render._merge_kernel import root
from galoc_env.render._sight_kernel import LIFT

ASIDE = 0.02
"""How far beside an edge the facet is looked for that continues another, m."""


@njit(**LEAN)
def _blocked(world, p, q):  # type: ignore[no-untyped-def]
    """Whether something stands between two points."""
    f, _ = trace(world, p[0], p[1], p[2], q[0] - p[0], q[1] - p[1], q[2] - p[2], 1.0, True)
    return f >= 0


@njit(cache=True)
def join(world, lit):  # type: ignore[no-untyped-def]
    """(N,) a number for each facet, the same for those that continue each other with nothing between them.

    Args:
        world: see :func:`trace`.
        lit: (N,) facets that matter.
    """
    sheets, edge_first, edges = world[0], world[1], world[2]
    parent = np.arange(sheets.shape[0])
    for f in range(sheets.shape[0]):
        n, start, end = sheets[f, :3], edge_first[f], edge_first[f + 1]
        for k in range(start, end if lit[f] else start):
            m = k + 1 if k + 1 < end else start
            for part in (0.1, 0.5, 0.9):
                u = edges[k, 3] + part * (edges[m, 3] - edges[k, 3])
                v = edges[k, 4] + part * (edges[m, 4] - edges[k, 4])
                q = point(world, f, u - ASIDE * edges[k, 0], v - ASIDE * edges[k, 1], LIFT)
                g, t = trace(world, q[0], q[1], q[2], -n[0], -n[1], -n[2], 2 * LIFT, False)
                if g < 0 or g == f or not lit[g] or abs(t - LIFT) > 1e-4 or root(parent, f) == root(parent, g):
                    continue
                same = n[0] * sheets[g, 0] + n[1] * sheets[g, 1] + n[2] * sheets[g, 2] > 0.99999
                p = point(world, f, u + ASIDE * edges[k, 0], v + ASIDE * edges[k, 1], LIFT)
                if same and not _blocked(world, p, q):
                    parent[root(parent, f)] = root(parent, g)
    out = np.empty(sheets.shape[0], np.int64)
    for f in range(sheets.shape[0]):
        out[f] = root(parent, f)
    return out


@njit(**LEAN)
def _at(frame, size, k):  # type: ignore[no-untyped-def]
    """Point k of a lattice: frame is its corner and the steps along columns and rows, (3, 3)."""
    c, r = k % size[0], k // size[0]
    return (
        frame[0, 0] + c * frame[1, 0] + r * frame[2, 0],
        frame[0, 1] + c * frame[1, 1] + r * frame[2, 1],
        frame[0, 2] + c * frame[1, 2] + r * frame[2, 2],
    )


@njit(cache=True)
def settle(world, frames, size, first, members, member_first, reach):  # type: ignore[no-untyped-def]
    """Lattice points, moved onto the nearest facet of their surface.

    Args:
        world: see :func:`trace`.
        frames: (S, 3, 3) corner of each lattice and its steps along columns and rows, m.
        size: (S, 2) columns and rows.
        first: (S + 1,) first point of each lattice.
        members: facets, surface by surface.
        member_first: (S + 1,) where those of each begin.
        reach: a point farther from all its facets than this is left out, m.

    Returns:
        (M, 3) points, and (M,) the facet that each lies on; -1 for one left out.
    """
    sheets = world[0]
    out, facet = np.zeros((first[-1], 3)), np.full(first[-1], -1, np.int64)
    for s in range(size.shape[0]):
        for k in range(first[s + 1] - first[s]):
            x, y, z = _at(frames[s], size[s], k)
            best, m = reach * reach, first[s] + k
            for i in range(member_first[s], member_first[s + 1]):
                f = members[i]
                e = sheets[f]
                u = e[4] * x + e[5] * y + e[6] * z - e[7]
                v = e[8] * x + e[9] * y + e[10] * z - e[11]
                if max(max(-u, u - e[12]), max(-v, v - e[13])) > reach:
                    continue
                p = place(world, f, u, v, 0.0)
                d2 = (p[0] - x) * (p[0] - x) + (p[1] - y) * (p[1] - y) + (p[2] - z) * (p[2] - z)
                if d2 < best:
                    best, facet[m] = d2, f
                    for c in range(3):
                        out[m, c] = p[c] + e[16] * e[c]
    return out, facet


@njit(cache=True)
def link(world, points, facet, size, first, check):  # type: ignore[no-untyped-def]
    """(M, 2) whether each point is one surface with the next one in its row, and in its column.

    ``check`` (S,) says for which surfaces something may stand between them: floors run on through doors.
    """
    out = np.zeros((first[-1], 2), np.bool_)
    for s in range(size.shape[0]):
        wide, high = size[s, 0], size[s, 1]
        for k in range(wide * high):
            m = first[s] + k
            for axis in range(2):
                inside = k % wide + 1 < wide if axis == 0 else k // wide + 1 < high
                j = m + (1 if axis == 0 else wide)
                if inside and facet[m] >= 0 and facet[j] >= 0:
                    out[m, axis] = not check[s] or not _blocked(world, points[m], points[j])
    return out


@njit(cache=True)
def smooth(values, links, size, first):  # type: ignore[no-untyped-def]
    """(M, 3) values with their linked neighbours, weights 1 2 1 along rows, then along columns."""
    for axis in range(2):
        out = np.empty_like(values)
        for s in range(size.shape[0]):
            wide, high = size[s, 0], size[s, 1]
            stride = 1 if axis == 0 else wide
            for k in range(wide * high):
                m = first[s] + k
                here = k % wide if axis == 0 else k // wide
                low, high_ = here > 0 and links[m - stride, axis], links[m, axis]
                for c in range(3):
                    a = values[m - stride, c] if low else values[m, c]
                    b = values[m + stride, c] if high_ else values[m, c]
                    out[m, c] = 0.25 * a + 0.5 * values[m, c] + 0.25 * b
        values = out
    return values


@njit(**LEAN)
def _cell(frame, wide, high, p):  # type: ignore[no-untyped-def]
    """Column and row of the lattice's cell around a point, and how far along each the point lies, 0 to 1."""
    x, y, along, across = 0.0, 0.0, 0.0, 0.0
    for c in range(3):
        along += frame[1, c] * frame[1, c]
        across += frame[2, c] * frame[2, c]
        x += (p[c] - frame[0, c]) * frame[1, c]
        y += (p[c] - frame[0, c]) * frame[2, c]
    x = max(0.0, min(wide - 1.0, x / along)) if wide > 1 else 0.0
    y = max(0.0, min(high - 1.0, y / across)) if high > 1 else 0.0
    column, row = min(int(x), max(0, wide - 2)), min(int(y), max(0, high - 2))
    return column, row, x - column, y - row


@njit(cache=True)
def weigh(world, points, facet, links, frames, size, first, surface, texel_step, texel_size, texel_first, lit):  # type: ignore[no-untyped-def]
    """Four lattice points around each texel and their weights, (T, 4) and (T, 4).

    Args:
        world: see :func:`trace`.
        points: see :func:`settle`.
        facet: see :func:`settle`.
        links: see :func:`link`.
        frames: see :func:`settle`.
        size: see :func:`settle`.
        first: see :func:`settle`.
        surface: (N,) of each facet; -1 for none.
        texel_step: (N, 2) m between texels.
        texel_size: (N, 2) columns and rows.
        texel_first: (N + 1,).
        lit: (N,) facets that matter.
    """
    total = texel_first[-1]
    index, weight = np.zeros((total, 4), np.int32), np.zeros((total, 4), np.float32)
    for f in range(surface.shape[0]):
        s = surface[f]
        if not lit[f] or s < 0:
            continue
        frame, wide, high = frames[s], size[s, 0], size[s, 1]
        for k in range(texel_first[f + 1] - texel_first[f]):
            t = texel_first[f] + k
            u, v = (k % texel_size[f, 0]) * texel_step[f, 0], (k // texel_size[f, 0]) * texel_step[f, 1]
            c0, r0, a, b = _cell(frame, wide, high, point(world, f, u, v, 0.0))
            seen = 0.0
            c1, r1 = min(wide - 1, c0 + 1), min(high - 1, r0 + 1)
            m = first[s] + r0 * wide + c0
            right, up = c1 - c0, (r1 - r0) * wide
            free = (right == 0 or (links[m, 0] and links[m + up, 0])) and (
                up == 0 or (links[m, 1] and links[m + right, 1])
            )
            for j in range(4):
                m = first[s] + (r1 if j // 2 else r0) * wide + (c1 if j % 2 else c0)
                w = (a if j % 2 else 1.0 - a) * (b if j // 2 else 1.0 - b)
                index[t, j] = m
                if w > 0.0 and not free:
                    q = place(world, f, u, v, world[0][f, 16])
                    if facet[m] < 0 or _blocked(world, q, points[m]):
                        w *= 1e-3  # what stands behind a wall counts only where there is nothing else
                weight[t, j] = w
                seen += w
            for j in range(4):
                weight[t, j] /= seen
    return index, weight


@njit(cache=True)
def spread(values, index, weight):  # type: ignore[no-untyped-def]
    """(T, 3): the weighted lattice values (M, 3) around each texel."""
    out = np.zeros((index.shape[0], 3))
    for t in range(index.shape[0]):
        for j in range(4):
            for c in range(3):
                out[t, c] += weight[t, j] * values[index[t, j], c]
    return out
