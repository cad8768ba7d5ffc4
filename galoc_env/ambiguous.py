"""Seeded buildings in which one view often cannot tell where one is, but walking can.

Rooms, flats or whole sides of a corridor are there more than once, to the same sizes, doors and windows; one end of
the corridor that joins them is unlike the other. The same seed gives the same bytes; training and test buildings come
from disjoint seed ranges. Flats are copied by shifts and half turns, never mirrored: a mirrored copy does look
different.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from galoc import Floorplan, GalocError
from galoc_env.ambiguous_layouts import FAMILIES, Fittings, Layout
from galoc_env.ambiguous_parts import Part
from galoc_env.homes import internal_seed, rooms_connected
from galoc_env.wall_builder import Shell

Array = NDArray[np.float64]

KINDS = tuple(FAMILIES)
"""Families of buildings."""
_VERSION = 1_001
"""Part of every seed, unlike that of homes: raise it when a change alters the buildings."""
_ATTEMPTS = 60
_QUARTERS = (
    np.array([[1.0, 0.0], [0.0, 1.0]]),
    np.array([[0.0, -1.0], [1.0, 0.0]]),
    np.array([[-1.0, 0.0], [0.0, -1.0]]),
    np.array([[0.0, 1.0], [-1.0, 0.0]]),
)


@dataclass(frozen=True, slots=True, eq=False)
class Building:
    """A plan, and which of its rooms look alike."""

    plan: Floorplan
    """What :func:`generate` gives."""
    rooms: tuple[Polygon, ...]
    """All rooms, up to the centrelines of their walls, m."""
    original: tuple[Polygon, ...]
    """The rooms of which there are copies."""
    motions: tuple[Array, ...]
    """Rigid motions (3,) that take the originals to each copy: turn by the last entry about the origin, then shift."""


def generate(seed: int, *, split: str = "train", kind: str | None = None) -> Floorplan:
    """A building drawn from a seed.

    It is 10 to 25 m long. Rooms are 3 to 5 m on a side (a flat's living room up to 7.2 m), corridors 1.5 to 1.9 m
    wide, ceilings 2.4 to 3.2 m, walls 0.08 to 0.3 m. A disc of 0.3 m can get from every room into every other.

    Args:
        seed: 0 to 999 999.
        split: "train" or "test".
        kind: "repeated": like rooms in a row; "twins": two or four like flats; "corridor": half of it is the
            other half turned about, but for one end; None: drawn from the seed.

    Raises:
        GalocError: seed out of range, unknown kind or split.
    """
    return draw(seed, split=split, kind=kind).plan


def draw(seed: int, *, split: str = "train", kind: str | None = None) -> Building:
    """The building of :func:`generate` with what is alike in it; arguments and errors as there."""
    rng = np.random.default_rng([internal_seed(seed, split, kind, KINDS), _VERSION])
    drawn = KINDS[int(rng.integers(len(KINDS)))]
    for _ in range(_ATTEMPTS):
        building = _attempt(rng, kind or drawn, f"ambiguous-{split}-{int(seed)}")
        if building is not None:
            return building
    raise GalocError(f"seed {seed} that gave no sound plan", "a seed that works", "Choose another seed and report it.")


def _attempt(rng: np.random.Generator, kind: str, name: str) -> Building | None:
    """One try at a building, or None when a door does not fit or a room cannot be reached."""
    ceiling = round(float(rng.uniform(2.4, 3.2)), 2)
    # Whole centimetres: half a wall is a whole number of the builder's rounding steps, so copies round alike.
    inner, outer = (round(float(value), 2) for value in rng.uniform((0.08, 0.18), (0.18, 0.30)))
    layout = _turned(rng, FAMILIES[kind](rng, Fittings.draw(rng)))
    shell = Shell.from_rooms(layout.whole.rooms, inner, outer, layout.whole.solids)
    try:
        plan = shell.build(layout.whole.holes, ceiling, name, f"Generated ambiguous building, {kind}.")
    except GalocError:
        return None
    if not rooms_connected(plan, shell.rooms):
        return None
    return Building(plan, shell.rooms, tuple(map(Polygon, layout.original)), layout.motions)


def _turned(rng: np.random.Generator, layout: Layout) -> Layout:
    """The layout turned by quarters and perhaps mirrored as a whole, its lower left corner near the origin."""
    matrix = _QUARTERS[int(rng.integers(4))] @ np.diag([1.0, 1.0 if rng.random() < 0.5 else -1.0])
    corners = np.concatenate([np.array(ring) for ring in layout.whole.rooms]) @ matrix.T
    offset = -np.floor(corners.min(axis=0))
    original = Part(layout.original).moved(matrix, offset).rooms
    motions = tuple(_carried(motion, matrix, offset) for motion in layout.motions)
    return Layout(layout.whole.moved(matrix, offset), original, motions)


def _carried(motion: Array, matrix: Array, offset: Array) -> Array:
    """A shift or half turn, p -> s p + t, in the frame after p -> matrix p + offset."""
    sign = 1.0 if motion[2] == 0.0 else -1.0
    return np.array([*(matrix @ motion[:2] + offset - sign * offset), motion[2]])
