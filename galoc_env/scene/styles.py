"""What rooms wear: materials and tints by the use of each room, and the joinery that a home shares."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

USES = ("living", "bed", "kitchen", "bath", "hall", "office", "other")
"""What rooms are used for; "other" is what no wall encloses."""
WHITE = np.ones(3)
_HALL_WIDTH = 2.1
"""Rooms narrower than this with two doors or more are halls, m."""
_GRAND = 60.0
"""Rooms larger than this (m2) are no rooms of a home: offices, shops."""

_FLOORS = {
    "living": ("planks", "dark_planks", "pale_planks", "herringbone", "herringbone", "carpet", "planks", "slabs"),
    "bed": ("carpet", "loop_carpet", "planks", "pale_planks", "dark_planks", "carpet"),
    "kitchen": ("tiles", "checker_tiles", "tiles", "planks", "slabs", "terrazzo", "pale_planks"),
    "bath": ("tiles", "mosaic", "checker_tiles", "tiles", "slabs", "terrazzo"),
    "hall": ("planks", "tiles", "herringbone", "pale_planks", "loop_carpet", "terrazzo", "checker_tiles"),
    "office": ("loop_carpet", "loop_carpet", "carpet", "terrazzo", "planks", "concrete", "tiles"),
}
_PLAIN = ("plaster",) * 6 + ("rough_plaster",) * 2
_WALLS = {
    "living": (*_PLAIN, "stripes", "damask", "geometric", "floral", "brick", "white_brick"),
    "bed": (*_PLAIN, "stripes", "floral", "floral", "damask", "geometric", "wood_panelling"),
    "kitchen": (*_PLAIN, "metro", "wall_tiles", "white_brick"),
    "bath": ("plaster", "plaster", "metro", "wall_tiles", "wall_tiles"),
    "hall": (*_PLAIN, "stripes", "damask", "white_brick"),
    "office": (*_PLAIN, "plaster", "plaster", "concrete", "white_brick"),
}
_ACCENTS = ("plaster", "plaster", "brick", "white_brick", "geometric", "damask", "floral", "wood_panelling", "concrete")


@dataclass(frozen=True, slots=True, eq=False)
class Coat:
    """A material with a factor on it."""

    name: str
    """Material."""
    tint: Array = field(default_factory=lambda: WHITE)
    """(3,) factor on its texture."""


@dataclass(frozen=True, slots=True, eq=False)
class Trim:
    """Joinery that all rooms of a home share."""

    casing: Coat = field(default_factory=lambda: Coat("lacquer"))
    """Boards around and in the doors."""
    leaf: Coat = field(default_factory=lambda: Coat("lacquer"))
    """Door leaves."""
    window: Coat = field(default_factory=lambda: Coat("lacquer"))
    """Window frames and sills."""
    casing_width: float = 0.06
    """How broad the boards on the wall around a door are, m."""
    panels: int = 0
    """Layout of the panels on a leaf; 0: none."""
    bars: tuple[int, int] = (0, 0)
    """Glazing bars of each casement: upright, level."""


@dataclass(frozen=True, slots=True, eq=False)
class Style:
    """What a room wears."""

    use: str
    """One of ``USES``: a guess."""
    floor: str
    """Material of the floor."""
    wall: str
    """Material of the walls."""
    wall_tint: Array
    """(3,) factor on the wall's texture."""
    floor_tint: Array
    """(3,) factor on the floor's texture."""
    light: float
    """Factor on the simple light: some rooms are darker than others."""
    ceiling_tint: Array = field(default_factory=lambda: WHITE)
    """(3,) factor on the ceiling's texture."""
    skirting: Coat = field(default_factory=lambda: Coat("lacquer"))
    """Board at the foot of the walls ..."""
    skirting_height: float = 0.08
    """... and its height, m; 0: none."""
    cornice: float = 0.0
    """Height of a band in the ceiling's paint at the top of the walls, m; 0: none."""
    dado: Coat | None = None
    """What the walls wear up to ``dado_height``."""
    dado_height: float = 0.0
    """m; 0: no dado."""
    accent: Coat | None = None
    """What the walls wear that face about ``accent_bearing``."""
    accent_bearing: float = 0.0
    """Plan bearing, rad."""

    def wall_coat(self, normal_xy: Sequence[float] | Array) -> Coat:
        """What a wall wears that faces a direction, above the dado."""
        if self.accent is not None:
            turn = math.atan2(normal_xy[1], normal_xy[0]) - self.accent_bearing
            if math.cos(turn) > math.cos(math.radians(20.0)):
                return self.accent
        return Coat(self.wall, self.wall_tint)

    def bands(self, normal_xy: Sequence[float] | Array, height: float) -> list[tuple[float, Coat]]:
        """What a wall of this height (m) wears, from below: the upper end of each band, and its coat."""
        wall = self.wall_coat(normal_xy)
        bands = [
            (self.skirting_height, self.skirting),
            (self.dado_height if self.dado else 0.0, self.dado or self.skirting),
            (height - self.cornice, wall),
            (math.inf, Coat("ceiling", self.ceiling_tint) if self.cornice else wall),
        ]
        return [
            (top, coat) for (top, coat), low in zip(bands, (0.0, *(b[0] for b in bands)), strict=False) if top > low
        ]


def guess_uses(polygons: Sequence[Any], doors: Sequence[Any], rng: np.random.Generator) -> list[str]:
    """Use of each room, by its size, its shape and its doors.

    Args:
        polygons: shapely polygons, largest first.
        doors: shapely centrelines.
        rng: breaks ties.
    """
    import shapely

    tree = shapely.STRtree(list(doors))
    uses, free = [], []
    for k, room in enumerate(polygons):
        count = len(tree.query(room, predicate="dwithin", distance=0.3)) if len(doors) else 0
        width = 2 * room.area / max(room.length, 1e-9) * (1.0 if room.area > 25 else 1.25)
        if room.area > _GRAND:
            uses.append("office")
        elif width < _HALL_WIDTH and count >= 2 and room.area < 25:
            uses.append("hall")
        else:
            uses.append("")
            free.append((k, count))
    if not free:
        return uses
    # The largest is lived in; of those with one door, the smallest is a bath; a kitchen is among the middling ones.
    uses[free[0][0]] = "living"
    rest = free[1:]
    small = [k for k, count in rest if count <= 1] or [k for k, _ in rest]
    if len(rest) >= 2 and polygons[small[-1]].area < 16:
        uses[small[-1]] = "bath"
    left = [k for k, _ in rest if not uses[k]]
    if left:
        uses[left[int(rng.integers(len(left)))]] = "kitchen"
    for k in left:
        if not uses[k]:
            uses[k] = "bed" if polygons[k].area > 6.5 else str(rng.choice(("bed", "hall", "bath")))
            if polygons[k].area < 3.5:
                uses[k] = "bath"
            elif polygons[k].area > 20 and rng.uniform() < 0.5:
                uses[k] = "living"
            elif rng.uniform() < 0.15:
                uses[k] = "office"
    return uses


def tinge(rng: np.random.Generator, depth: float, light: tuple[float, float] = (1.0, 1.0)) -> Array:
    """(3,) a factor near white: one random hue, at most ``depth`` deep, times a random lightness.

    Four of five are warm, blue or grey-green, as homes are.
    """
    hue = rng.uniform(0.0, 2 * math.pi)
    if rng.uniform() < 0.8:
        hue = float(rng.choice((0.45, 0.65, 0.9, 2.6, 3.6))) + rng.normal(0.0, 0.15)
    else:
        depth *= 0.6
    # White less a share of the other colours: cream at 0.6 rad, green at 2.1, blue at 3.8.
    colour = 1.0 - depth * rng.uniform() * (0.5 - 0.5 * np.cos(hue - np.array([0.0, 2.1, 4.2])))
    return np.asarray(colour * rng.uniform(*light))


def draw_style(use: str, trim: Trim, rng: np.random.Generator) -> Style:
    """A room's style."""
    table = use if use in _FLOORS else "living"
    wall, floor = str(rng.choice(_WALLS[table])), str(rng.choice(_FLOORS[table]))
    painted = wall in ("plaster", "rough_plaster")
    deep = painted and rng.uniform() < 0.12
    tint = tinge(rng, 0.5 if deep else 0.22 if painted else 0.08, (0.6, 0.9) if deep else (0.86, 1.0))
    ceiling = tinge(rng, 0.05, (0.93, 1.0))
    if painted and not deep and rng.uniform() < 0.35:
        # Wall and ceiling in nearly one paint: their edge shows by light alone. 0.96 levels the two textures.
        ceiling = np.minimum(0.96 * tint * rng.uniform(0.97, 1.03), 1.0)
    skirting = (trim.casing, trim.casing, Coat(wall, 0.96 * tint), Coat("lacquer"))[int(rng.integers(4))]
    height = 0.0 if use == "bath" or rng.uniform() < 0.08 else float(rng.choice((0.06, 0.08, 0.10, 0.14)))
    dado, dado_height = _dado(use, wall, rng)
    accent = rng.uniform() < 0.25 and painted and dado is None and use in ("living", "bed", "kitchen", "office")
    name = str(rng.choice(_ACCENTS))
    depth = (0.6, (0.4, 0.9)) if name == "plaster" else (0.1, (0.85, 1.0))
    coat = Coat(name, tinge(rng, *depth))
    return Style(
        use=use,
        floor=floor,
        wall=wall,
        wall_tint=tint,
        floor_tint=tinge(rng, 0.06, (0.72, 1.0)),
        light=float(rng.uniform(0.90, 1.0)),
        ceiling_tint=ceiling,
        skirting=skirting,
        skirting_height=height,
        cornice=float(rng.choice((0.05, 0.08, 0.14))) if rng.uniform() < 0.22 else 0.0,
        dado=dado,
        dado_height=dado_height,
        accent=coat if accent else None,
        accent_bearing=float(rng.integers(4)) * math.pi / 2,
    )


def _dado(use: str, wall: str, rng: np.random.Generator) -> tuple[Coat | None, float]:
    """Tiles in baths and kitchens, panelling or a darker paint elsewhere, where the wall above is no tiles itself."""
    chance, tall, pick = rng.uniform(), rng.uniform(0.0, 1.0), int(rng.integers(3))
    tiles = Coat(("metro", "wall_tiles", "mosaic")[pick], tinge(rng, 0.08, (0.9, 1.0)))
    if wall in ("metro", "wall_tiles"):
        return None, 0.0
    if use == "bath" and chance < 0.75:
        return tiles, float(rng.choice((1.2, 1.5, 2.0)))
    if use == "kitchen" and chance < 0.3:
        return tiles, 1.4 + 0.2 * tall
    if use in ("living", "bed", "hall") and chance < 0.12:
        coat = Coat("wood_panelling", tinge(rng, 0.05, (0.9, 1.0))) if pick else Coat(wall, tinge(rng, 0.4, (0.6, 0.9)))
        return coat, 0.85 + 0.35 * tall
    return None, 0.0


def draw_trim(rng: np.random.Generator) -> Trim:
    """A home's joinery: white, coloured or wood."""
    woods = ("wood", "oak", "pine", "walnut", "painted_wood")

    def coat(white: float) -> Coat:
        if rng.uniform() < white:
            return Coat("lacquer", tinge(rng, 0.06, (0.86, 1.0)))
        return Coat(str(rng.choice(woods)), tinge(rng, 0.08, (0.8, 1.0)))

    casing = coat(0.6)
    leaf = casing if rng.uniform() < 0.6 else coat(0.5)
    window = Coat("lacquer", np.full(3, rng.uniform(0.2, 0.4))) if rng.uniform() < 0.15 else coat(0.75)
    width, panels = float(rng.uniform(0.04, 0.11)), int(rng.integers(0, 6))
    bars = ((0, 0), (0, 0), (0, 1), (1, 1), (0, 2))[int(rng.integers(5))]
    return Trim(casing, leaf, window, width, panels, bars)
