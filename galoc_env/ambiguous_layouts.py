"""Layouts in which one view cannot tell where one is: rows of like rooms, twin flats, corridors alike from both ends.

Each is drawn in a frame of its own, the corridor along x; :mod:`galoc_env.ambiguous` turns it any way round.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from galoc_env.ambiguous_ends import ENDS, draw_end
from galoc_env.ambiguous_parts import Array, Part, Ring, box, half_turn, joined, shift
from galoc_env.wall_builder import Hole, door, window

MAX_ROW_M = 18.0
"""Length of a row of rooms at most, m."""
HALL_M = (1.5, 1.9)
"""Width of corridors and halls, m."""


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """A building, and which of its parts look alike."""

    whole: Part
    """Everything."""
    original: tuple[Ring, ...]
    """The rooms of which there are copies."""
    motions: tuple[Array, ...]
    """Rigid motions (3,) that take the original onto each copy."""


@dataclass(frozen=True, slots=True)
class Fittings:
    """Sizes that a whole building shares."""

    door_m: float
    """Clear width of doors, m."""
    head_m: float
    """Height of doors, m."""
    sill_m: float
    """Lower edge of windows, m."""
    window_m: float
    """Upper edge of windows, m."""

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Fittings:
        """Sizes drawn at random."""
        low, high = (0.8, 2.0, 0.5, 2.05), (1.0, 2.1, 1.1, 2.25)
        return cls(*(round(float(value), 2) for value in rng.uniform(low, high)))

    def door(self, x: float, y: float) -> Hole:
        """A door at (x, y), m."""
        return door(x, y, self.door_m, self.head_m)

    def window(self, x: float, y: float, width: float) -> Hole:
        """A window at (x, y), m."""
        return window(x, y, round(width, 2), self.sill_m, self.window_m)


def repeated(rng: np.random.Generator, fit: Fittings) -> Layout:
    """A row of 3 to 6 like rooms on one side of a corridor, more often on both, as in a hotel or a school."""
    count = int(rng.integers(3, 7))
    width = _cm(rng, 3.0, min(4.4, MAX_ROW_M / count))
    depth, hall = _cm(rng, 3.6, 4.8), _cm(rng, *HALL_M)
    end, both = count * width, rng.random() < 0.6
    room, steps = _room(rng, fit, width, depth), [shift(i * width, 0.0) for i in range(count)]
    row, motions = _copies(room, steps), steps
    if both:
        turn = half_turn(end / 2.0, -hall / 2.0)
        motions = steps + [turn - step for step in steps]
        return Layout(row + row.by(turn) + _passage(rng, end, hall), room.rooms, tuple(motions[1:]))
    wide = _cm(rng, 0.8, 1.4)
    holes = tuple(fit.window((i + 0.5) * width, -hall, wide) for i in range(count))
    return Layout(row + _passage(rng, end, hall) + Part(holes=holes), room.rooms, tuple(motions[1:]))


def twins(rng: np.random.Generator, fit: Fittings) -> Layout:
    """Two like flats on one side of a hall or face to face across it (half a turn apart), or two on either side."""
    width, hall = _cm(rng, 6.2, 7.2), _cm(rng, *HALL_M)
    flat = _flat(rng, fit, width)
    abreast, facing = ((2, 1), (1, 2), (2, 2))[int(rng.integers(3))]
    end, steps = abreast * width, [shift(i * width, 0.0) for i in range(abreast)]
    turn = half_turn(end / 2.0, -hall / 2.0)
    motions = steps + [turn - step for step in steps] * (facing - 1)
    return Layout(_copies(flat, motions) + _passage(rng, end, hall), flat.rooms, tuple(motions[1:]))


def corridor(rng: np.random.Generator, fit: Fittings) -> Layout:
    """Rooms of two sorts along a long corridor, and the same again half a turn away."""
    depth, hall = _cm(rng, 3.4, 4.6), _cm(rng, *HALL_M)
    widths = [_cm(rng, 3.0, 4.4) for _ in range(2)]
    sorts = [_room(rng, fit, width, depth) for width in widths]
    side, end = Part(), 0.0
    for sort in rng.integers(2, size=int(rng.integers(3, 5))):
        side += sorts[sort].by(shift(end, 0.0))
        end = round(end + widths[sort], 2)
    motion = half_turn(end / 2.0, -hall / 2.0)
    return Layout(side + side.by(motion) + _passage(rng, end, hall), side.rooms, (motion,))


FAMILIES = {"repeated": repeated, "twins": twins, "corridor": corridor}
"""How each kind is drawn."""


def _passage(rng: np.random.Generator, end: float, hall: float) -> Part:
    """A corridor from 0 to end below y = 0 whose right-hand end is unlike the left."""
    kinds = [str(kind) for kind in rng.permutation(ENDS)[: 1 if rng.random() < 0.7 else 2]]
    floor, beyond = [box(0.0, -hall, end, 0.0)], Part()
    for index, kind in enumerate(kinds):
        part = draw_end(rng, end, hall, kind)
        part = part.by(half_turn(end / 2.0, -hall / 2.0)) if index else part
        floor += [ring for ring in part.rooms if kind != "stairs"]
        beyond += part if kind == "stairs" else Part()
    return Part((joined(*floor),)) + beyond


def _copies(part: Part, motions: list[Array]) -> Part:
    """All copies of a part."""
    return sum((part.by(motion) for motion in motions), Part())


def _flat(rng: np.random.Generator, fit: Fittings, width: float) -> Part:
    """A flat of three or four rooms above y = 0, its entry below."""
    front, back = _cm(rng, 3.2, 4.2), _cm(rng, 3.0, 3.8)
    cuts = [_cm(rng, 3.0, width - 3.0), _cm(rng, 3.0, width - 3.0)]
    top, whole = round(front + back, 2), rng.random() < 0.5
    edges = [0.0, width] if whole else [0.0, cuts[0], width]
    rooms = [box(a, 0.0, b, front) for a, b in pairwise(edges)]
    rooms += [box(0.0, front, cuts[1], top), box(cuts[1], front, width, top)]
    entry = _cm(rng, 0.8, edges[1] - 0.8)
    doors = [fit.door(entry, 0.0), fit.door(_cm(rng, 0.8, min(edges[1], cuts[1]) - 0.8), front)]
    doors += [fit.door(_cm(rng, max(edges[-2], cuts[1]) + 0.8, width - 0.8), front)]
    if not whole:
        doors += [fit.door(cuts[0], _cm(rng, 0.8, front - 0.8))]
    middles = (cuts[1] / 2.0, (cuts[1] + width) / 2.0)
    panes = [fit.window(x, top, _cm(rng, 1.0, 1.7)) for x in middles]
    x1, deep = _cm(rng, 0.0, 0.4), _cm(rng, 0.4, 0.7)
    closet = box(x1, round(top - deep, 2), round(x1 + deep, 2), top) if x1 < 0.2 else box(0.0, 0.0, 0.5, deep)
    return Part(tuple(rooms), tuple(doors + panes), (closet,) if entry > 1.2 or x1 < 0.2 else ())


def _room(rng: np.random.Generator, fit: Fittings, width: float, depth: float) -> Part:
    """A room from (0, 0) to (width, depth): door below, window above, now and then a closet away from the door."""
    place, right = _cm(rng, 0.8, width / 2.0 - 0.1), rng.random() < 0.5
    wide, deep, low, chance = _cm(rng, 0.6, 1.1), _cm(rng, 0.4, 0.7), rng.random() < 0.5, rng.random()
    pane = fit.window(width / 2.0, depth, _cm(rng, 1.0, 0.45 * width - 0.2))
    closet = box(width - wide, 0.0, width, deep) if low else box(width - deep, depth - wide, width, depth)
    room = Part((box(0.0, 0.0, width, depth),), (fit.door(place, 0.0), pane), (closet,) if chance < 0.6 else ())
    return room.moved(np.diag([-1.0, 1.0]), np.array([width, 0.0])) if right else room


def _cm(rng: np.random.Generator, low: float, high: float) -> float:
    """A length drawn at random, m, whole centimetres."""
    return round(float(rng.uniform(low, high)), 2)
