"""Lamps on the ceilings, what they shed, and the sun."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from galoc_env.scene.light import Lamp, Lighting, Sun
from galoc_env.scene.mesh import FITTING, MeshBuilder
from galoc_env.scene.openings import Hole
from galoc_env.scene.rooms import REST, Rooms
from galoc_env.scene.solids import SolidPainter
from galoc_env.scene.styles import tinge
from galoc_env.scene.windows import inner_side

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan

Array = NDArray[np.float64]

MAX_LAMPS = 60
"""Most lamps of a plan: light costs time for each."""
AREA_PER_LAMP = 17.0
"""Larger rooms have more than one, m2."""
HEAD_ROOM = 2.02
"""A lamp hangs no lower than this, m."""
BRIGHT = 0.1
"""Rooms with windows of this share of their area, or more, may be lit by daylight alone."""
POWER_PER_AREA, POWER = 0.17, (1.5, 2.9)
"""Power of a lamp for each m2 that it has to light; least and most."""
MOST_UP, LOWEST = 0.5, 1.92
"""Light on the ceiling above a lamp, for which its light may sit lower than its body, but not below this height (m)."""
SUN_POWER = (2.2, 2.0, 1.6)
"""Light of the sun on a surface that faces it."""


def draw_sun(holes: list[Hole], rng: np.random.Generator) -> Sun | None:
    """On every other day the sun shines, then into one of the windows at least."""
    shines, bearing, elevation, power, which = rng.uniform(size=5)
    if shines < 0.5:
        return None
    fronts = [hole for hole in holes if hole.opening.kind == "window" and inner_side(hole)]
    if fronts:
        front = fronts[int(which * len(fronts))]
        out = -inner_side(front) * front.normal
        bearing = math.atan2(out[1], out[0]) / (2 * math.pi) + 0.32 * (bearing - 0.5)
    strength = 0.85 + 0.3 * power
    red, green, blue = (strength * c for c in SUN_POWER)
    return Sun(2 * math.pi * float(bearing), math.radians(15.0 + 40.0 * float(elevation)), (red, green, blue))


def add_lamps(
    builder: MeshBuilder,
    plan: Floorplan,
    rooms: Rooms,
    holes: list[Hole],
    lighting: Lighting,
    rng: np.random.Generator,
) -> tuple[Lamp, ...]:
    """A lamp in every room, more in large ones: one instance each; those that are switched on."""
    spaces = [(number, _spots(room), room.area) for number, room in enumerate(rooms.polygons)]
    elsewhere = [(REST, [spot], AREA_PER_LAMP) for spot in _spots_elsewhere(plan, rooms)]
    spaces = elsewhere + spaces if len(elsewhere) > len(spaces) else spaces + elsewhere  # the larger part first
    pane = _window_areas(holes)
    lamps: list[Lamp] = []
    for number, places, area in spaces:
        own = np.random.default_rng(rng.integers(1 << 31))
        on = own.uniform() > (0.3 if pane.get(number, 0.0) > BRIGHT * area else 0.03)
        aside = own.uniform(-0.3, 0.3, 2)  # builders do not measure
        spots = [(x + aside[0], y + aside[1]) for x, y in places][: max(MAX_LAMPS - len(lamps), 0)]
        kind, look = _KINDS[int(own.integers(len(_KINDS)))], int(own.integers(1 << 31))
        if rooms.use(number) in ("kitchen", "bath", "hall", "office") and own.uniform() < 0.6:
            kind = _disc if own.uniform() < 0.6 else _row
        warm = own.uniform() ** 1.5
        colour = np.array([1.0, 0.97, 0.93]) * (1 - warm) + np.array([1.12, 0.86, 0.60]) * warm
        each = POWER_PER_AREA * area / max(len(spots), 1)
        # Neighbours light each other's part of a large room.
        power = own.uniform(0.8, 1.25) * min(max(each, POWER[0]), POWER[1]) * (0.6 + 0.4 / max(len(spots), 1))
        shown = 1.0 - (0.5 if on else 0.3) * (1.0 - colour / colour.max())  # lit, it is brighter than white
        for x, y in spots:
            paint = SolidPainter(
                builder, lighting, x, y, float(own.uniform(0, math.pi)), 1.0, builder.new_instance(FITTING)
            )
            glow = 1.25 if on else 0.0
            height = kind(paint, plan.ceiling_height, glow, shown, np.random.default_rng(look))
            paint.flush()
            if on:
                red, green, blue = (float(power * c) for c in colour)
                lamps.append(Lamp(x, y, _light_height(plan.ceiling_height, height, power), (red, green, blue)))
    return tuple(lamps)


def _window_areas(holes: list[Hole]) -> dict[int, float]:
    """Area of the windows of each room that has any, m2."""
    areas: dict[int, float] = {}
    for hole in holes:
        if hole.opening.kind == "window":
            for room in hole.rooms:
                areas[room] = areas.get(room, 0.0) + hole.opening.width * (hole.opening.top - hole.opening.bottom)
    return areas


def _light_height(ceiling: float, height: float, power: float) -> float:
    """Height of a lamp's light, m: below its body where the ceiling above it would be burnt white.

    A fifth of its light goes straight up, and is ``MOST_UP`` on the ceiling. Shades that shine cast no shadow.
    """
    below = math.sqrt(max(0.2 * power / MOST_UP - 0.09, 0.0))
    return min(height, max(ceiling - below, LOWEST))


def _spots(room: Any) -> list[tuple[float, float]]:
    """Where the lamps of a room hang, m: in its middle, or in a row or grid over it."""
    import shapely

    count = max(1, min(8, round(room.area / AREA_PER_LAMP)))
    if count > 1:
        corners = np.array(shapely.minimum_rotated_rectangle(room).exterior.coords)[:4]
        a, b = corners[1] - corners[0], corners[3] - corners[0]
        if np.hypot(*a) < np.hypot(*b):
            a, b = b, a
        across = max(1, round(math.sqrt(count * np.hypot(*b) / np.hypot(*a))))
        along = math.ceil(count / across)
        u, v = np.meshgrid((np.arange(along) + 0.5) / along, (np.arange(across) + 0.5) / across)
        points = corners[0] + u.reshape(-1, 1) * a + v.reshape(-1, 1) * b
        inside = shapely.contains(shapely.buffer(room, -0.4), shapely.points(points))
        if inside.any():
            return [(float(x), float(y)) for x, y in points[inside]]
    middle = room.centroid if room.buffer(-0.3).contains(room.centroid) else room.representative_point()
    return [(middle.x, middle.y)]


def _spots_elsewhere(plan: Floorplan, rooms: Rooms) -> list[tuple[float, float]]:
    """Where lamps hang in a building whose walls enclose no rooms: in the widest place of each square, m."""
    space = plan.free_space()
    row, col = np.nonzero(space.inside & (space.clearance > 0.5))
    keep = slice(None, None, 4)
    points = (space.origin + (np.stack([col, row], axis=1) + 0.5) * space.resolution)[keep]
    clearance = space.clearance[row, col][keep]
    out = rooms.at(points) == REST
    points, clearance = points[out], clearance[out]
    area = 4 * len(points) * space.resolution**2
    if area < 4.0:
        return []
    pitch = max(4.5, math.sqrt(2.0 * area / MAX_LAMPS))
    square = np.floor((points - points.min(axis=0)) / pitch).astype(np.int64)
    number = square[:, 0] * (square[:, 1].max() + 1) + square[:, 1]
    order = np.lexsort((-np.round(clearance, 6), number))
    first = order[np.unique(number[order], return_index=True)[1]]
    return [(float(x), float(y)) for x, y in points[first]]


def _drop(ceiling: float, wanted: float, body: float) -> float:
    """Height of the lower end of a hanging lamp whose body is ``body`` high, m."""
    return max(min(ceiling - wanted, ceiling - body - 0.05), min(HEAD_ROOM, ceiling - body - 0.02))


def _cord(paint: SolidPainter, low: float, ceiling: float) -> None:
    paint.prism("lacquer", (0, 0, low, ceiling - 0.02), (0.005, 0.005), 0.25, sides=4)
    paint.prism("lacquer", (0, 0, ceiling - 0.025, ceiling), (0.05, 0.05), 0.95, sides=8)


def _globe(paint: SolidPainter, ceiling: float, glow: float, colour: Array, rng: np.random.Generator) -> float:
    """A ball of milk glass on a cord."""
    r = rng.uniform(0.11, 0.2)
    low = _drop(ceiling, rng.uniform(0.45, 0.9), 2 * r)
    angle = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 7)
    profile = np.column_stack([r * np.cos(angle), low + r + r * np.sin(angle)])
    paint.lathe("shade", (0, 0), profile, colour, sides=10, glow=glow)
    _cord(paint, low + 2 * r, ceiling)
    return float(low + r)


def _drum(paint: SolidPainter, ceiling: float, glow: float, colour: Array, rng: np.random.Generator) -> float:
    """A cloth shade, straight or tapered, with a diffuser below."""
    r, h, taper = rng.uniform(0.16, 0.28), rng.uniform(0.16, 0.3), rng.uniform(0.5, 1.0)
    low = _drop(ceiling, rng.uniform(0.45, 0.85), h)
    tint = colour * tinge(rng, 0.3)
    paint.prism("shade", (0, 0, low, low + h), (r, taper * r), tint, sides=14, glow=0.8 * glow)
    _cord(paint, low + h, ceiling)
    return float(low + h / 2)


def _dome(paint: SolidPainter, ceiling: float, glow: float, colour: Array, rng: np.random.Generator) -> float:
    """A metal shade that lets light out only below."""
    r, h = rng.uniform(0.14, 0.26), rng.uniform(0.12, 0.22)
    low = _drop(ceiling, rng.uniform(0.5, 0.95), h)
    tint = tinge(rng, 0.7, (0.3, 1.0))
    profile = [(r, low), (r * 0.9, low + 0.3 * h), (0.5 * r, low + 0.7 * h), (0.12 * r, low + h)]
    paint.lathe("lacquer", (0, 0), profile, tint, sides=12)
    paint.prism("shade", (0, 0, low - 0.01, low), (0.9 * r, 0.98 * r), colour, sides=12, glow=1.15 * glow)
    _cord(paint, low + h, ceiling)
    return float(low - 0.06)


def _disc(paint: SolidPainter, ceiling: float, glow: float, colour: Array, rng: np.random.Generator) -> float:
    """A flat lamp on the ceiling, round or square."""
    r, h = rng.uniform(0.14, 0.26), rng.uniform(0.05, 0.1)
    sides, low = 14 if rng.uniform() < 0.6 else 4, ceiling - h
    paint.lathe("shade", (0, 0), [(0.85 * r, low), (r, low + 0.3 * h), (r, ceiling - 0.015)], colour, sides=sides,
                low=True, glow=glow)  # fmt: skip
    paint.prism("metal", (0, 0, ceiling - 0.015, ceiling), (1.03 * r, 1.03 * r), 0.8, sides=sides)
    return float(ceiling - 0.42)  # as much lower as keeps the ceiling from glaring


def _row(paint: SolidPainter, ceiling: float, glow: float, colour: Array, rng: np.random.Generator) -> float:
    """A rail with spots that point down."""
    count, tint, gap = int(rng.integers(2, 5)), np.full(3, rng.choice((0.15, 0.7, 1.0))), 0.32
    reach = gap * (count - 1) / 2
    paint.box("metal", (-reach - 0.1, -0.02, ceiling - 0.03), (reach + 0.1, 0.02, ceiling), tint, hide="Z")
    for x in np.linspace(-reach, reach, count):
        spot = paint.at((float(x), 0.0, ceiling - 0.08), tilt=rng.uniform(-0.4, 0.4), roll=rng.uniform(-0.4, 0.4))
        spot.lathe("metal", (0, 0), [(0.045, -0.09), (0.04, 0.02)], tint, sides=8)
        spot.lathe("shade", (0, 0), [(0.038, -0.095), (0.045, -0.09)], colour, sides=8, low=True, high=False,
                   glow=1.2 * glow)  # fmt: skip
    return float(ceiling - 0.55)


_KINDS = (_globe, _drum, _drum, _dome, _disc, _row)
