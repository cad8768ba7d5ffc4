"""Plants, lamps, rugs and things that lie about."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from galoc_env.furniture import Furniture
from galoc_env.scene.furniture_palette import BLACK, Look, Skin, muted, skin
from galoc_env.scene.solids import SolidPainter

Array = NDArray[np.float64]

BARK = np.array([0.36, 0.25, 0.16])
"""Tint of lacquer for stems; half of it for earth."""
SHADE_GLOW = 1.25
"""Brightness of a lampshade with its lamp on."""


def plant(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """A pot with a bush of broad leaves, a tree, or long blades."""
    radius, top = min(item.length, item.width) / 2 - 0.01, item.height
    pot = min(0.32 * top, 0.42) * look.between(0.8, 1.1)
    wide = radius * look.between(0.5, 0.75)
    body = _pot(look)
    profile = ((0.72 * wide, 0), (wide, 0.85 * pot), (wide, pot), (0.86 * wide, pot), (0.82 * wide, pot - 0.03))
    paint.lathe(body[0], (0, 0), profile, body[1], sides=10, high=False)
    paint.lathe("lacquer", (0, 0), ((0.84 * wide, pot - 0.04), (0.8 * wide, pot - 0.035)), 0.5 * BARK, sides=8)
    green = np.array([look.between(0.75, 1.15), look.between(0.85, 1.15), look.between(0.7, 1.1)])
    design = int(look.rng.integers(3))
    (_bush, _tree, _blades)[design](paint, look, (radius, pot, top), green)


def _pot(look: Look) -> Skin:
    draw = look.rng.uniform()
    if draw < 0.35:
        return "lacquer", np.full(3, look.between(0.85, 1.0))
    if draw < 0.6:
        return "lacquer", np.array([0.72, 0.42, 0.3]) * look.between(0.85, 1.1)
    if draw < 0.8:
        return skin(look.wicker(), np.array([0.85, 0.68, 0.48]))
    return "lacquer", 0.8 * muted(look.rng)


def leaf_sheets(base: Array, direction: Array, length: Array, width: Array, droop: Array) -> Array:
    """(2 N, 4, 3) m: leaves of two quads each, bent downwards in the middle.

    Args:
        base: (N, 3) where the leaves begin, m.
        direction: (N, 3) unit vectors.
        length: (N,) m.
        width: (N,) m.
        droop: (N,) share of the length that the tip sinks by.
    """
    side = np.stack([-direction[:, 1], direction[:, 0], np.zeros(len(base))], axis=1)
    side /= np.maximum(np.linalg.norm(side, axis=1), 1e-6)[:, None]
    middle = base + 0.5 * length[:, None] * direction
    tip = base + length[:, None] * direction
    tip[:, 2] -= droop * length
    half, narrow = 0.5 * width[:, None] * side, 0.12 * width[:, None] * side
    inner = np.stack([base - narrow, middle - half, middle + half, base + narrow], axis=1)
    outer = np.stack([middle - half, tip - 0.5 * narrow, tip + 0.5 * narrow, middle + half], axis=1)
    return np.concatenate([inner, outer])


def _grow(
    paint: SolidPainter, leaves: tuple[Array, Array, Array, Array, Array], reach: float, top: float, tint: Array
) -> None:
    """Draw leaves, pulled back inside the piece's cylinder and below its top."""
    sheets = leaf_sheets(*leaves)
    r = np.hypot(sheets[..., 0], sheets[..., 1])
    sheets[..., :2] *= np.minimum(1.0, reach / np.maximum(r, 1e-6))[..., None]
    sheets[..., 2] = np.clip(sheets[..., 2], 0.03, top)
    half = len(sheets) // 2
    shade = np.arange(half) % 2 == 0
    for mine, factor in ((np.tile(shade, 2), 1.0), (np.tile(~shade, 2), 0.82)):
        paint.sheets("leaves", sheets[mine], factor * tint)


def _directions(rng: np.random.Generator, count: int, low: float, high: float) -> Array:
    """(N, 3) unit vectors all around, with elevations from a range, rad."""
    bearing = 2.4 * np.arange(count) + rng.uniform(0, 6.3) + rng.normal(0, 0.2, count)
    rise = rng.uniform(low, high, count)
    return np.stack([np.cos(bearing) * np.cos(rise), np.sin(bearing) * np.cos(rise), np.sin(rise)], axis=1)


def _bush(paint: SolidPainter, look: Look, size: tuple[float, float, float], tint: Array) -> None:
    radius, pot, top = size
    n = 16
    height = np.linspace(0.0, 1.0, n)
    ways = _directions(look.rng, n, -0.1, 0.5)
    ways[:, 2] += 0.9 * height**2
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    base = np.zeros((n, 3))
    base[:, 2] = pot + (0.72 * (top - pot)) * height
    base[:, :2] = 0.25 * radius * ways[:, :2]
    length = radius * (1.05 - 0.25 * height) * look.rng.uniform(0.8, 1.15, n)
    _grow(paint, (base, ways, length, 0.5 * length, look.rng.uniform(0.1, 0.45, n)), radius, top, tint)
    paint.tube(
        "lacquer", (0, 0, pot - 0.05), (0, 0, pot + 0.7 * (top - pot)), (0.012, 0.007), BARK, sides=4, ends=False
    )


def _tree(paint: SolidPainter, look: Look, size: tuple[float, float, float], tint: Array) -> None:
    radius, pot, top = size
    n, crown = 19, pot + 0.45 * (top - pot)
    paint.tube("lacquer", (0, 0, pot - 0.05), (0.02, 0.01, 0.75 * top), (0.02, 0.012), BARK, sides=5, ends=False)
    ways = _directions(look.rng, n, -0.4, 1.2)
    base = 0.3 * radius * ways
    base[:, 2] = crown + (top - crown) * look.rng.uniform(0.05, 0.75, n)
    length = radius * look.rng.uniform(0.6, 0.95, n)
    _grow(paint, (base, ways, length, 0.55 * length, look.rng.uniform(0.1, 0.5, n)), radius, top, tint)
    for k in range(0, n, 6):
        stem = (float(base[k, 0]), float(base[k, 1]), float(base[k, 2]))
        paint.tube("lacquer", (0.01, 0, crown - 0.1), stem, (0.008, 0.005), BARK, sides=3, ends=False)


def _blades(paint: SolidPainter, look: Look, size: tuple[float, float, float], tint: Array) -> None:
    radius, pot, top = size
    n = 13
    ways = _directions(look.rng, n, 1.0, 1.5)
    base = np.zeros((n, 3))
    base[:, :2] = 0.3 * radius * ways[:, :2]
    base[:, 2] = pot - 0.03
    length = (top - pot) * look.rng.uniform(0.6, 1.0, n)
    width = np.clip(0.1 * length, 0.04, 0.09)
    _grow(paint, (base, ways, length, width, look.rng.uniform(0.0, 0.12, n)), radius, top, tint)


def table_lamp(paint: SolidPainter, look: Look, height: float, radius: float) -> None:
    """A lamp that stands at the frame's origin: foot, stem and a shade that may shine."""
    foot = look.metal() if look.chance(0.5) else _pot(look)
    paint.lathe(foot[0], (0, 0), ((0.6 * radius, 0), (0.55 * radius, 0.02), (0.2 * radius, 0.04)), foot[1], sides=8)
    paint.lathe(
        foot[0], (0, 0), np.array([(0.3, 0.05), (0.12, 0.6)]) * np.array([radius, height]), foot[1], sides=5, high=False
    )
    shade(paint, look, (0.55 * height, height), radius)


def shade(paint: SolidPainter, look: Look, span: tuple[float, float], radius: float) -> None:
    """A lampshade between two heights; open below and above, seen from inside too."""
    glow = SHADE_GLOW if look.chance(0.5) else 0.0
    warm = np.array([1.15, 1.06, 0.88]) if look.chance(0.75) else 0.9 * muted(look.rng)
    upper = radius * look.between(0.6, 1.0)
    paint.lathe("fabric", (0, 0), ((radius, span[0]), (upper, span[1])), warm, sides=10, low=True, high=True, glow=glow)


def lamp(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """Floor lamp: on a straight stem, on three legs, or bent over."""
    radius, top = min(item.length, item.width) / 2, item.height
    frame = look.metal() if look.chance(0.7) else look.timber()
    deep = look.between(0.22, 0.32)
    design = int(look.rng.integers(3))
    if design == 0:
        paint.lathe(frame[0], (0, 0), ((0.75 * radius, 0), (0.7 * radius, 0.03)), frame[1], sides=12)
        paint.tube(frame[0], (0, 0, 0.03), (0, 0, top - 0.5 * deep), (0.014, 0.012), frame[1], ends=False)
        shade(paint, look, (top - deep, top), radius)
    elif design == 1:
        for k in range(3):
            c, s = math.cos(2.094 * k), math.sin(2.094 * k)
            end = (0.95 * radius * c, 0.95 * radius * s, 0.0)
            paint.tube(frame[0], end, (0.05 * c, 0.05 * s, top - deep), (0.014, 0.012), frame[1], ends=False)
        shade(paint, look, (top - deep, top), radius)
    else:
        paint.lathe(frame[0], (-0.3 * radius, 0), ((0.65 * radius, 0), (0.65 * radius, 0.025)), frame[1], sides=12)
        points = [(-0.6, 0.02), (-0.7, 0.6), (-0.55, 0.9), (-0.15, 1.0), (0.3, 0.95)]
        for (x0, z0), (x1, z1) in zip(points[:-1], points[1:], strict=True):
            start, end = (x0 * radius, 0.0, z0 * top), (x1 * radius, 0.0, z1 * (top - 0.01))
            paint.tube(frame[0], start, end, (0.012, 0.012), frame[1], sides=4)
        shade(paint.at((0.3 * radius, 0, 0)), look, (0.95 * top - 0.2, 0.95 * top), 0.65 * radius)


def rug(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """A flat rug with a border, round or rectangular; bodies walk over it."""
    cloth, border = look.cloth(), look.cloth()
    name = look.stock.rug if look.chance(0.75) else cloth[0]
    a, b, top = item.length / 2, item.width / 2, item.height
    if look.chance(0.2) and abs(item.length - item.width) < 0.4:
        r = min(a, b)
        paint.lathe(name, (0, 0), ((r, 0), (r, top)), cloth[1], sides=16)
        return
    paint.box(name, (-a, -b, 0), (a, b, top), border[1] if look.chance(0.5) else 0.8 * cloth[1])
    edge = look.between(0.06, 0.25)
    paint.box(name, (-a + edge, -b + edge, top), (a - edge, b - edge, top + 0.002), cloth[1], hide="zxXyY")


def basket(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """A laundry or paper basket, a stack of boxes, or toys."""
    a, b, top = item.length / 2, item.width / 2, item.height
    r = min(a, b)
    design = int(look.rng.integers(3))
    if design == 0:
        made = skin(look.wicker(), np.array([0.9, 0.74, 0.55]) * look.between(0.8, 1.1))
        profile = ((0.8 * r, 0), (r, 0.9 * top), (r, top), (0.9 * r, top), (0.75 * r, 0.3 * top))
        paint.lathe(made[0], (0, 0), profile, made[1], sides=12)
    elif design == 1:
        card = np.array([0.78, 0.62, 0.44]) * look.between(0.85, 1.1)
        paint.box("lacquer", (-a, -b, 0), (a, b, 0.6 * top), card)
        small = paint.at((0, 0, 0.6 * top), turn=look.between(-0.3, 0.3))
        small.box("lacquer", (-0.65 * a, -0.6 * b, 0), (0.65 * a, 0.6 * b, 0.4 * top), 0.95 * card, hide="z")
    else:
        made = look.front(0.1, 0.4)
        paint.frustum(made[0], (-a, -b, 0), (a, b, 0.5 * top), (0, 0), made[1], foot=(0.03, 0.03))
        for k in range(3):
            toy = paint.at((look.between(-0.4, 0.4) * a, (k - 1) * 0.5 * b, 0.5 * top - 0.02), turn=look.between(0, 3))
            s = 0.28 * r
            toy.box("lacquer", (-s, -s, 0), (s, s, look.between(0.2, 0.5) * top), muted(look.rng), hide="z")


def coat_rack(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """A stand with hooks, and coats on some of them."""
    radius, top = min(item.length, item.width) / 2, item.height
    frame = look.timber() if look.chance(0.6) else ("lacquer", BLACK)
    for k in range(4):
        c, s = math.cos(1.571 * k + 0.785), math.sin(1.571 * k + 0.785)
        paint.tube(frame[0], (0.95 * radius * c, 0.95 * radius * s, 0), (0, 0, 0.28), (0.016, 0.016), frame[1], sides=4)
        paint.tube(
            frame[0],
            (0, 0, top - 0.22),
            (0.7 * radius * c, 0.7 * radius * s, top - 0.08),
            (0.01, 0.01),
            frame[1],
            sides=4,
        )
        if look.chance(0.6):
            cloth = look.cloth()
            coat = paint.at((0.5 * radius * c, 0.5 * radius * s, 0), turn=1.571 * k + 0.785)
            low, w, d = look.between(0.5, 0.95), 0.62 * radius, 0.3 * radius
            rings = [
                [(-d, -0.9 * w, low), (d, -0.9 * w, low), (d, 0.9 * w, low), (-d, 0.9 * w, low)],
                [(-d, -w, top - 0.45), (d, -w, top - 0.45), (d, w, top - 0.45), (-d, w, top - 0.45)],
                [(-0.3 * d, -0.2 * w, top - 0.12), (0.3 * d, -0.2 * w, top - 0.12),
                 (0.3 * d, 0.2 * w, top - 0.12), (-0.3 * d, 0.2 * w, top - 0.12)],
            ]  # fmt: skip
            coat.loft(cloth[0], rings, cloth[1], low=True)
    paint.tube(frame[0], (0, 0, 0.2), (0, 0, top), (0.022, 0.018), frame[1], sides=6)
