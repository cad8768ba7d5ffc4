"""What furniture is made of: materials and tints, some of them close to the wall's own tone."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Skin = tuple[str, Array]
"""Material and tint."""

CLOTHS = ("fabric", "weave", "velvet", "check", "ticking")
TIMBERS = ("wood", "oak", "walnut", "pine")
TOPS = ("marble", "granite", "concrete")
TILES = ("metro", "mosaic", "wall_tiles", "tiles")
RUGS = ("rug", "rug", "loop_carpet", "carpet")
"""What a home's :class:`Stock` is drawn from."""
BLACK, GREY = np.full(3, 0.1), np.full(3, 0.45)
"""Tints of lacquer."""
# Mean colour of the wall materials relative to lacquer; painted furniture takes it on.
_WALL_TONE = {
    "plaster": (0.967, 0.955, 0.933),
    "rough_plaster": (0.95, 0.94, 0.92),
    "stripes": (0.91, 0.88, 0.825),
    "damask": (0.845, 0.87, 0.858),
}


@dataclass(frozen=True, slots=True)
class Stock:
    """The few materials that all furniture of a home is made of: each more costs a texture."""

    cloths: tuple[str, ...] = CLOTHS[:2]
    """For seats and cushions."""
    timbers: tuple[str, ...] = TIMBERS[:2]
    """For frames and fronts."""
    top: str = TOPS[0]
    """For worktops of stone."""
    tiles: str = TILES[0]
    """For walls behind worktops, and bathtubs."""
    rug: str = RUGS[0]
    """For rugs."""


def draw_stock(rng: np.random.Generator) -> Stock:
    """A home's materials."""
    cloths = tuple(str(name) for name in rng.choice(CLOTHS[1:], size=1, replace=False))
    timbers = tuple(str(name) for name in rng.choice(TIMBERS, size=2, replace=False))
    top, tiles, rug = (str(rng.choice(names)) for names in (TOPS, TILES, RUGS))
    return Stock(("fabric", *cloths), timbers, top, tiles, rug)


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """Source of all choices about how one piece looks, and what it stands before."""

    rng: np.random.Generator
    """Choices of this piece; pieces that belong together draw the same."""
    wall: str = "plaster"
    """Material of the room's walls."""
    wall_tint: Array | None = None
    """(3,) tint of the room's walls; None: white."""
    stock: Stock = field(default_factory=Stock)
    """What this home's furniture is made of."""

    def chance(self, share: float) -> bool:
        """True with this probability."""
        return bool(self.rng.uniform() < share)

    def between(self, low: float, high: float) -> float:
        """A number from a range."""
        return float(self.rng.uniform(low, high))

    def tone(self) -> Array:
        """(3,) tint that makes lacquer look like the room's wall, within a few per cent."""
        wall = np.ones(3) if self.wall_tint is None else self.wall_tint
        return np.asarray(wall * _WALL_TONE.get(self.wall, (0.96, 0.96, 0.96)) * self.rng.uniform(0.95, 1.03))

    def cloth(self) -> Skin:
        """Upholstery: a muted colour on one of the home's cloths."""
        tint = muted(self.rng)
        return str(self.rng.choice(self.stock.cloths)), tint

    def linen(self) -> Skin:
        """Bed linen: often white."""
        if self.chance(0.4):
            return "fabric", np.full(3, self.rng.uniform(1.05, 1.18))
        return "fabric", 1.1 * muted(self.rng)

    def timber(self) -> Skin:
        """Wood in some tone."""
        name = str(self.rng.choice(self.stock.timbers))
        return name, self.rng.uniform(0.75, 1.05) * np.array([1.0, self.rng.uniform(0.94, 1), 0.94])

    def wicker(self) -> str:
        """The material of baskets: coarse cloth where the home has any, else wood."""
        return "weave" if "weave" in self.stock.cloths else self.stock.timbers[0]

    def front(self, wall: float = 0.3, white: float = 0.25) -> Skin:
        """Fronts of cupboards: in the wall's tone, white, coloured or wooden; the first two with these shares."""
        draw = self.rng.uniform()
        if draw < wall:
            return "lacquer", self.tone()
        if draw < wall + white:
            return "lacquer", np.full(3, self.rng.uniform(0.9, 1.0))
        if draw < wall + white + 0.12:
            return "lacquer", 0.95 * muted(self.rng)
        return self.timber()

    def metal(self) -> Skin:
        """Handles, legs and taps: bright or black."""
        return (
            ("metal", np.full(3, self.rng.uniform(0.85, 1.05))) if self.chance(0.6) else ("lacquer", np.full(3, 0.13))
        )


def muted(rng: np.random.Generator) -> Array:
    """(3,) a muted random colour, as a factor on light grey."""
    hue, depth = rng.uniform(0, 2 * math.pi), 0.5 * rng.uniform() ** 1.5 + 0.04
    return np.asarray(rng.uniform(0.5, 1.05) * (1.0 - depth * (0.5 + 0.5 * np.cos(hue + np.array([0.0, 2.1, 4.2])))))


def skin(name: str, tint: float | Array = 1.0) -> Skin:
    """A material with its tint."""
    return name, np.broadcast_to(np.asarray(tint, np.float64), (3,))
