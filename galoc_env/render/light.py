"""Baked light: what reaches every light texel of a scene from lamps, windows, the sun and other surfaces."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.cache import DiskCache, content_key
from galoc_env.render._bounce_kernel import collect, contact, look_round
from galoc_env.render._light_filter_kernel import fill
from galoc_env.render._light_kernel import direct
from galoc_env.render._light_pane_kernel import SIDE, daylight
from galoc_env.render._sight_kernel import survey
from galoc_env.render._surface_kernel import smooth, spread
from galoc_env.render.facet_build import dot
from galoc_env.render.facets import Facets, build_facets
from galoc_env.render.light_surfaces import make_surfaces
from galoc_env.render.light_world import World, make_world
from galoc_env.render.textures import texture_of
from galoc_env.scene.light import Lamp, Sun
from galoc_env.scene.mesh import FURNITURE, OUTSIDE, WALL

if TYPE_CHECKING:
    from galoc_env.scene import Scene

Array = NDArray[np.float64]

VERSION = 4
"""Part of every key; counted up when the same scene gets other light."""

DAYLIGHT = (3.2, 3.5, 3.9)
"""Brightness of a window pane of glow 1, seen as a lamp: a surface that it surrounds receives this."""
AMBIENT = 0.03
"""Light everywhere, so that a room with neither lamp nor window is not black."""
RINGS, SPOKES = 3, 5
"""Rays from each point, this many times that many, that look for the light that other surfaces send back; half of them
on small or narrow ones."""
BOUNCES = 3
"""Times that light is sent back."""
GLOW = 0.3
"""Share of its brightness with which a shining face, such as a lamp shade, lights others: its lamp does the rest."""
CONTACT, REACH = 0.6, 0.45
"""Part of its light that a floor loses under a body, and how far around it that is felt, m: lamps are points here, but
real ones and their reflections are broad, and nothing looks as if it stood there without this."""
FLAT = 0.04
"""What lies lower is floor, as a rug is, m."""

_RECENT = 8
_recent: OrderedDict[str, NDArray[np.float32]] = OrderedDict()
"""Light of the last scenes, by key."""


def lit(scene: Scene) -> tuple[Facets, NDArray[np.float32]]:
    """Facets of a scene and their light, see :func:`bake`; light is kept in memory and on disk. Read-only.

    Raises:
        GalocError: a face is not finite.
    """
    facets = build_facets(scene)
    albedo = mean_colours(scene)[facets.material]
    albedo = linear(albedo * facets.tint)
    lamps, sun = _lamps(facets, scene.lamps), _sun(scene.sun)
    geometry = (facets.vertices, facets.first, facets.plane, facets.light, facets.light_size)
    key = content_key("light", VERSION, *geometry, facets.glow, facets.semantic, albedo, lamps, sun)
    light = _recent.pop(key, None)
    if light is None:
        note = f"light of {len(facets.plane)} facets"
        light = DiskCache().fetch(key, lambda: {"light": bake(facets, scene.lamps, scene.sun, albedo)}, note)["light"]
    _recent[key] = light
    while len(_recent) > _RECENT:
        _recent.popitem(last=False)
    return facets, light


def mean_colours(scene: Scene) -> Array:
    """(M, 3) mean sRGB colour (0..1) of the texture of each of ``scene.meshes``; grey where there is none."""
    out = np.full((len(scene.meshes), 3), 0.7)
    for i, mesh in enumerate(scene.meshes):
        image = texture_of(mesh)
        if image is not None:
            pixels = image[::3, ::3].reshape(-1, 3)
            # Whole numbers add up the same in any order.
            out[i] = pixels.sum(axis=0, dtype=np.int64) / (255.0 * len(pixels))
    return out


def linear(colour: ArrayLike) -> Array:
    """Linear light of sRGB values (0..1, any shape), to 1 percent, with no power function: the same everywhere."""
    c = np.clip(np.asarray(colour, np.float64), 0.0, 1.0)
    return np.asarray(c * (c * (c * 0.305306011 + 0.682171111) + 0.012522878))


def bake(facets: Facets, lamps: Sequence[Lamp], sun: Sun | None, albedo: ArrayLike = 0.6) -> NDArray[np.float32]:
    """Light on every texel.

    Args:
        facets: the scene.
        lamps: in the world frame.
        sun: or None.
        albedo: scalar, (N,) or (N, 3): part of the light (linear) that each facet sends back.

    Returns:
        (T, 3) linear light, T = ``light_first[-1]``: 1 lights a surface to its full brightness. Facets that shine
        by themselves have none.
    """
    if not len(facets.plane):
        return np.zeros((0, 3), np.float32)
    world = make_world(facets)
    lit, outside = facets.glow == 0.0, facets.semantic == OUTSIDE
    lit &= ~_hidden(facets, world, lit)
    light, buried = direct(
        world.rays, world.step, world.size, world.first, lit, outside, _lamps(facets, lamps), _sun(sun)
    )
    fill(light, buried, world.size, world.first, 2)
    part = np.asarray(albedo, np.float64)
    sent = np.broadcast_to(part[:, None] if part.ndim == 1 else part, (len(lit), 3)).copy()
    light += _soft(facets, world, light, lit, sent)
    light *= 1.0 - _contact(facets, world, lit)[:, None]
    light[~np.repeat(lit, np.diff(world.first))] = 0.0
    return light.astype(np.float32)


def _hidden(facets: Facets, world: World, lit: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) facets that nobody sees, see :func:`survey`."""
    return np.asarray(survey(world.rays, lit, facets.semantic == WALL))


def _soft(facets: Facets, world: World, light: Array, lit: NDArray[np.bool_], sent: Array) -> Array:
    """Light of windows (T, 3) and what other surfaces send back, where ``light`` is that of lamps and sun."""
    at = make_surfaces(facets, world, lit)
    which = np.flatnonzero((facets.semantic == OUTSIDE) & (facets.glow > 0))
    panes, spots = _panes(facets, which)
    fans, order = _directions(RINGS, SPOKES), np.argsort(at.facet, kind="stable")
    hits, openness = look_round(
        world.rays, at.points, at.facet, at.fan, fans, at.few, world.step, world.size, world.first, lit
    )
    soft = daylight(
        world.rays, at.points, at.facet, at.odd, order, panes, which, spots, fans, at.fan, at.few, hits
    ) + AMBIENT * openness[:, None]  # fmt: skip
    bad = (at.facet < 0) | (2 * (hits == -2).sum(axis=1) > hits.shape[1])
    shine = GLOW * facets.glow[:, None] * sent * (facets.semantic != OUTSIDE)[:, None]
    facet_of = np.repeat(np.arange(len(lit), dtype=np.int32), np.diff(world.first))
    out, back = light, np.zeros_like(soft)
    for bounce in range(BOUNCES + 1):
        both = soft + back
        fill(both, bad.copy(), at.size, at.first, 3)
        out = spread(smooth(both, at.links, at.size, at.first), at.index, at.weight)
        if bounce < BOUNCES:
            back = collect(hits, facet_of, sent, shine, light + out)
    return out


def _contact(facets: Facets, world: World, lit: NDArray[np.bool_]) -> Array:
    """(T,) part of their light that floors, and what lies flat on them, lose to the furniture that stands there."""
    height = facets.plane[:, 3] + facets.origin[2]
    floor = lit & (facets.plane[:, 2] > 0.99) & (np.abs(height) < FLAT)
    body = facets.semantic == FURNITURE
    steps, rows = np.arange(8) + 0.5, []
    for elevation, weight in ((20.0, 0.05), (45.0, 0.075)):
        flat, angle = math.cos(math.radians(elevation)), steps * (math.pi / 4)
        up, share = np.full(8, math.sin(math.radians(elevation))), np.full(8, weight)
        rows.append(np.column_stack([flat * np.cos(angle), flat * np.sin(angle), up, share]))
    directions = np.round(np.concatenate(rows), 7)
    return CONTACT * contact(world.rays, floor, body, directions, REACH, world.step, world.size, world.first)


def _lamps(facets: Facets, lamps: Sequence[Lamp]) -> Array:
    """(L, 7) for :func:`direct`."""
    rows = [(lamp.x, lamp.y, lamp.z, *lamp.power, lamp.radius) for lamp in lamps]
    table = np.array(rows, np.float64).reshape(-1, 7)
    table[:, :3] -= facets.origin
    return table


def _sun(sun: Sun | None) -> Array:
    """(6,) for :func:`direct`; rounded, since sine and cosine differ in their last digit between machines."""
    if sun is None:
        return np.zeros(6)
    flat = math.cos(sun.elevation)
    towards = (flat * math.cos(sun.bearing), flat * math.sin(sun.bearing), math.sin(sun.elevation))
    return np.array([*(round(v, 9) for v in towards), *sun.power], np.float64)


def _panes(facets: Facets, which: NDArray[np.intp]) -> tuple[Array, Array]:
    """Window panes (P, 11) and the points (P, K, 3) from which they shine, for :func:`daylight`."""
    table, spots = np.zeros((len(which), 11)), np.zeros((len(which), SIDE * SIDE, 3))
    share = (np.arange(SIDE) + 0.5) / SIDE
    for row, f in enumerate(which):
        corners = facets.vertices[facets.first[f] : facets.first[f + 1]].astype(np.float64)
        n = facets.plane[f].astype(np.float64)
        right = corners[1] - corners[0]
        right /= math.sqrt(float(dot(right, right)))
        up = np.array(
            [n[1] * right[2] - n[2] * right[1], n[2] * right[0] - n[0] * right[2], n[0] * right[1] - n[1] * right[0]]
        )
        u, v = dot(corners, right), dot(corners, up)
        area = float((u * np.roll(v, -1) - v * np.roll(u, -1)).sum()) / 2
        a = u.min() + share * (u.max() - u.min())
        b = v.min() + share * (v.max() - v.min())
        # A millimetre in front, so that its own face and its twin's do not hide it.
        spots[row] = (a[None, :, None] * right + b[:, None, None] * up + (n[3] + 1e-3) * n[:3]).reshape(-1, 3)
        power = np.array(DAYLIGHT) * float(facets.glow[f])
        table[row] = [*n, area / (SIDE * SIDE), *power, *spots[row].mean(axis=0)]
    return table, spots


@cache
def _directions(rings: int, spokes: int) -> Array:
    """(9, R, 3): nine sets of cosine-distributed directions about z, each stratified, together finer still."""
    sets = np.empty((9, rings * spokes, 3))
    for k in range(9):
        for i in range(rings * spokes):
            ring, spoke = divmod(i, spokes)
            r2 = (ring + (0.5 + 0.7548776662 * k) % 1.0) / rings
            angle = 2 * math.pi * (spoke + (0.5 * ring + 0.5698402910 * k) % 1.0) / spokes
            sets[k, i] = math.sqrt(r2) * math.cos(angle), math.sqrt(r2) * math.sin(angle), math.sqrt(1 - r2)
    return np.round(sets, 7)
