"""Numba kernels for light that makes sharp shadows: of lamps and the sun, on every texel."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from galoc_env.render._light_ray_kernel import FAINT, LEAN, place, stopped, trace
from galoc_env.render._sight_kernel import lamps_in_sight, outline

SHADE = 0.8
"""A lamp sends less light up, straight up by this part: else the ceiling above it would be one white spot."""
TINY = 0.15
"""On facets up to this size one point stands for all of them, m."""
CLOSE = 0.3
"""Nearer than about this a lamp is no point, and its light grows no more, m."""


@njit(**LEAN)
def _seen(world, p, lamp, memory, slot):  # type: ignore[no-untyped-def]
    """How many of four points of a lamp are seen from p."""
    dx, dy, dz = lamp[0] - p[0], lamp[1] - p[1], lamp[2] - p[2]
    d = math.sqrt(dx * dx + dy * dy + dz * dz)
    radius = lamp[6]
    # Four points of the sphere's outline, as seen from p: sideways and across.
    flat = math.sqrt(dx * dx + dy * dy)
    ax, ay = (-dy / flat, dx / flat) if flat > 1e-6 else (1.0, 0.0)
    bx, by, bz = -ay * dz / d, ax * dz / d, (ay * dx - ax * dy) / d
    short = max(0.0, 1.0 - radius / d)  # up to the sphere, not into it
    seen = 0
    for k in range(4):
        # Opposite points first; where they agree, so will the others.
        if k == 2 and seen != 1:
            return 2 * seen
        a = 0.5 * radius * (1.0 if k % 2 == 0 else -1.0)
        b = a if k < 2 else -a
        tx, ty, tz = dx + a * ax + b * bx, dy + a * ay + b * by, dz + b * bz
        if not stopped(world, p[0], p[1], p[2], short * tx, short * ty, short * tz, memory, slot + k):
            seen += 1
    return seen


@njit(**LEAN)
def _strength(n, p, lamp):  # type: ignore[no-untyped-def]
    """Light of a lamp at p on a surface with normal n, as a factor on its power."""
    dx, dy, dz = lamp[0] - p[0], lamp[1] - p[1], lamp[2] - p[2]
    d2 = dx * dx + dy * dy + dz * dz + 1e-6
    d = math.sqrt(d2)
    shade = 1.0 - SHADE * max(0.0, -dz / d)
    return shade * (n[0] * dx + n[1] * dy + n[2] * dz) / d / (d2 + CLOSE * CLOSE)


@njit(**LEAN)
def _between(seen, wide, high, c, r):  # type: ignore[no-untyped-def]
    """What the texels around (c, r) whose column and row are even, or the last, agree on; -1 if they do not."""
    c0, c1 = (c, c) if c % 2 == 0 or c == wide - 1 else (c - 1, c + 1)
    r0, r1 = (r, r) if r % 2 == 0 or r == high - 1 else (r - 1, r + 1)
    first = seen[r0 * wide + c0]
    if c0 == c1 and r0 == r1:
        return -1
    same = first == seen[r0 * wide + c1] and first == seen[r1 * wide + c0] and first == seen[r1 * wide + c1]
    return first if same else -1


@njit(**LEAN)
def _tiny(step, size):  # type: ignore[no-untyped-def]
    return max(step[0] * (size[0] - 1), step[1] * (size[1] - 1)) < TINY


@njit(cache=True)
def _add_lamp(world, f, step, size, at, lamp, memory, slot, out):  # type: ignore[no-untyped-def]
    """Light of one lamp on a facet with texels at these points (K, 3); gives the number of those in its shadow."""
    n, wide, high = world[0][f, :3], size[0], size[1]
    power = max(lamp[3], lamp[4], lamp[5])
    seen, dark = np.zeros(wide * high, np.int8), 0
    tiny = _tiny(step, size)
    if tiny:
        p = place(world, f, 0.5 * step[0] * (wide - 1), 0.5 * step[1] * (high - 1), world[0][f, 16])
        if _strength(n, p, lamp) * power >= FAINT:
            seen[:] = _seen(world, p, lamp, memory, slot)
    for even in (True, False):
        for k in range(wide * high):
            c, r = k % wide, k // wide
            if even != ((c % 2 == 0 or c == wide - 1) and (r % 2 == 0 or r == high - 1)):
                continue
            p = at[k]
            scale = _strength(n, p, lamp)
            guess = seen[k] if tiny else -1 if even else _between(seen, wide, high, c, r)
            if guess >= 0:
                seen[k] = guess
            elif scale * power >= FAINT:
                seen[k] = _seen(world, p, lamp, memory, slot)
            dark += 1 if seen[k] == 0 else 0
            for i in range(3 if seen[k] > 0 else 0):
                out[k, i] += max(0.0, scale) * lamp[3 + i] * seen[k] * 0.25
    return dark


@njit(**LEAN)
def _sunlit(world, outside, p, sun):  # type: ignore[no-untyped-def]
    """Whether the first thing towards the sun is the outdoors."""
    f, _ = trace(world, p[0], p[1], p[2], sun[0], sun[1], sun[2], 1e3, False)
    return f >= 0 and outside[f]


@njit(**LEAN)
def _buried(world, p, n):  # type: ignore[no-untyped-def]
    """Whether a point lies inside a body: what is above it turns its back."""
    f, _ = trace(world, p[0], p[1], p[2], n[0], n[1], n[2], 1e3, False)
    s = world[0]
    return f >= 0 and s[f, 0] * n[0] + s[f, 1] * n[1] + s[f, 2] * n[2] > 0.0


@njit(cache=True)
def direct(world, step, size, first, lit, outside, lamps, sun):  # type: ignore[no-untyped-def]
    """Light of lamps and the sun on every texel.

    Args:
        world: see :func:`trace`.
        step: (N, 2) m between texels.
        size: (N, 2) columns and rows.
        first: (N + 1,) first texel of each facet.
        lit: (N,) whether light matters on it.
        outside: (N,) whether it is the outdoors.
        lamps: (L, 7) place, power and radius.
        sun: (6,) direction and power; power 0 for no sun.

    Returns:
        (T, 3) light, and (T,) which texels lie inside a body.
    """
    out, buried = np.zeros((first[-1], 3)), np.zeros(first[-1], np.bool_)
    memory, some, points = np.full(4 * lamps.shape[0], -1), np.empty(lamps.shape[0], np.int64), np.empty((16, 3))
    places = np.empty((np.diff(first).max(), 3))
    shiny = max(sun[3], sun[4], sun[5]) > 0.0
    for f in range(size.shape[0]):
        if not lit[f]:
            continue
        n = world[0][f, :3]
        count = outline(world, f, points)
        found = lamps_in_sight(world, f, points, count, lamps, memory, some, not _tiny(step[f], size[f]), FAINT)
        here, dark = out[first[f] : first[f + 1]], 0
        at = places[: here.shape[0]]
        for k in range(here.shape[0] if found > 0 or shiny else 0):
            u, v = (k % size[f, 0]) * step[f, 0], (k // size[f, 0]) * step[f, 1]
            at[k, 0], at[k, 1], at[k, 2] = place(world, f, u, v, world[0][f, 16])
        for i in some[:found]:
            dark += _add_lamp(world, f, step[f], size[f], at, lamps[i], memory, 4 * i, here)
        facing = n[0] * sun[0] + n[1] * sun[1] + n[2] * sun[2]
        if shiny and facing > 0.01:
            _add_sun(world, outside, f, step[f], size[f], at, sun, facing, here)
            dark += 1
        # Of points in the dark some may lie inside a body.
        for k in range(here.shape[0] if dark > 0 else 0):
            if here[k, 0] + here[k, 1] + here[k, 2] == 0.0:
                buried[first[f] + k] = _buried(world, at[k], n)
    return out, buried


@njit(cache=True)
def _add_sun(world, outside, f, step, size, at, sun, facing, out):  # type: ignore[no-untyped-def]
    """Sunlight on a facet; texels at the edge of a patch get it by the part of their area that is lit."""
    wide, high = size[0], size[1]
    sunny = np.zeros(wide * high, np.int8)
    tiny = _tiny(step, size)
    if tiny:
        p = place(world, f, 0.5 * step[0] * (wide - 1), 0.5 * step[1] * (high - 1), world[0][f, 16])
        sunny[:] = _sunlit(world, outside, p, sun)
    for even in (True, False):
        for k in range(wide * high):
            c, r = k % wide, k // wide
            if even != ((c % 2 == 0 or c == wide - 1) and (r % 2 == 0 or r == high - 1)):
                continue
            sunny[k] = sunny[k] if tiny else -1 if even else _between(sunny, wide, high, c, r)
            if sunny[k] < 0:
                sunny[k] = _sunlit(world, outside, at[k], sun)
    for r in range(high):
        for c in range(wide):
            here, edge = sunny[r * wide + c], False
            for rr in range(max(0, r - 1), min(high, r + 2)):
                for cc in range(max(0, c - 1), min(wide, c + 2)):
                    edge = edge or sunny[rr * wide + cc] != here
            part = float(here)
            if edge:
                count = 0
                for k in range(16):
                    u = (c + ((k % 4) - 1.5) * 0.25) * step[0]
                    v = (r + ((k // 4) - 1.5) * 0.25) * step[1]
                    count += 1 if _sunlit(world, outside, place(world, f, u, v, world[0][f, 16]), sun) else 0
                part = count / 16.0
            for k in range(3):
                out[r * wide + c, k] += part * facing * sun[3 + k]
