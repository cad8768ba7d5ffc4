"""Pieces that are put down together: a lounge, a bed with its tables, a dining table with chairs, a desk."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from galoc_env.furniture import MIN_GAP, Furniture
from galoc_env.furniture.kinds import KINDS_BY_NAME
from galoc_env.furniture.space import random_size

if TYPE_CHECKING:
    from galoc_env.furniture.room import FreeRoom
    from galoc_env.furniture.space import Space

CLOSE = 0.02
"""Least gap between pieces of a group, m."""
_SIDE = 0.002
"""Gap between the two parts of a corner sofa, m."""


@dataclass(frozen=True, slots=True, eq=False)
class Furnisher:
    """Puts pieces and groups into rooms until the plan holds enough."""

    room: FreeRoom
    """What is still free."""
    rng: np.random.Generator
    """Source of all choices."""
    most: int
    """Most pieces in the plan."""

    @property
    def full(self) -> bool:
        """Whether the plan holds enough."""
        return len(self.room.items) >= self.most

    def size(self, kind: str) -> tuple[float, float, float]:
        """A random size of a kind, m."""
        return random_size(kind, self.rng, self.room.plan.ceiling_height)

    def put(self, piece: Furniture | None, *, gap: float = MIN_GAP, front: float | None = None) -> Furniture | None:
        """Place a piece if it fits; returns it if so."""
        if piece is None or self.full:
            return None
        clear = KINDS_BY_NAME[piece.kind].front if front is None else front
        return piece if self.room.place(piece, front=clear, gap=gap) else None

    def single(self, kind: str, space: Space, *, tries: int = 16, corner: float = 0.5) -> Furniture | None:
        """A piece with its back to a wall of the room."""
        for _ in range(tries):
            placed = self.put(space.propose(kind, self.size(kind), self.rng, corner=corner))
            if placed is not None:
                return placed
        return None

    def beside(self, piece: Furniture, kind: str, side: float, gap: float = CLOSE) -> Furniture | None:
        """A piece on the left (``side`` = 1) or right (-1) of another, both backs in line."""
        length, width, height = self.size(kind)
        x, y = piece.place((length - piece.length) / 2, side * (piece.width / 2 + width / 2 + gap + 0.02))
        made = Furniture(kind, x, y, piece.heading, length, width, height, piece.group)
        return self.put(made, gap=gap)

    def before(self, piece: Furniture, kind: str, gap: float, left: float = 0.0) -> Furniture:
        """A piece ``gap`` m before another, turned the same way; not placed yet."""
        length, width, height = self.size(kind)
        x, y = piece.place(piece.length / 2 + gap + length / 2, left)
        return Furniture(kind, x, y, piece.heading, length, width, height, piece.group)


def lounge(work: Furnisher, space: Space) -> bool:
    """A sofa, before it a coffee table on a rug, opposite a television; armchairs, a lamp."""
    rng = work.rng
    sofa = _sofa_and_television(work, space)
    if sofa is None:
        return False
    if rng.uniform() < 0.35:
        sofa = _with_chaise(work, sofa)
    if rng.uniform() < 0.8:
        table = work.before(sofa, "coffee_table", rng.uniform(0.32, 0.45), rng.normal(0, 0.1))
        work.put(replace(table, group=0), front=0.0, gap=0.2)
        _seats_around(work, table, sofa)
        if rng.uniform() < 0.7:
            rug = work.before(sofa, "rug", -0.2)
            work.put(replace(rug, x=table.x, y=table.y, group=0), front=0.0)
    if rng.uniform() < 0.5:
        work.beside(sofa, "lamp" if rng.uniform() < 0.6 else "nightstand", 1.0 if rng.uniform() < 0.5 else -1.0)
    return True


def _sofa_and_television(work: Furnisher, space: Space) -> Furniture | None:
    """A sofa against a wall, and a television opposite: without one only where both fit nowhere."""
    rng, room = work.rng, work.room
    group = room.new_group()
    for attempt in range(40):
        sofa = space.propose("sofa", work.size("sofa"), rng, corner=0.15)
        if sofa is None:
            return None
        sofa, stand = replace(sofa, group=group), None
        opposite = space.facing(sofa.x, sofa.y, sofa.heading)
        if opposite is not None and 2.2 < opposite[2] < 6.5:
            s = opposite[1] + rng.normal(0, 0.15)
            stand = space.at_wall("tv_stand", opposite[0], s, work.size("tv_stand"))
        if attempt < 30 and (stand is None or not room.fits(stand, 0.5)):
            continue
        placed = work.put(sofa)
        if placed is not None:
            work.put(stand)
            return placed
    return None


def _with_chaise(work: Furnisher, sofa: Furniture) -> Furniture:
    """Make the sofa a corner sofa if there is room on one side."""
    length, width, _ = work.size("chaise")
    first = 1.0 if work.rng.uniform() < 0.5 else -1.0
    for side in (first, -first):
        x, y = sofa.place((length - sofa.length) / 2, side * (sofa.width / 2 + width / 2 + _SIDE))
        other = "right" if side > 0 else "left"
        chaise = Furniture("chaise", x, y, sofa.heading, length, width, sofa.height, sofa.group, other)
        if work.put(chaise, gap=0.0) is not None:
            open_sofa = replace(sofa, detail="left" if side > 0 else "right")
            work.room.swap(sofa, open_sofa)
            return open_sofa
    return sofa


def _seats_around(work: Furnisher, table: Furniture, sofa: Furniture) -> None:
    """Armchairs and footstools that face the coffee table from its ends."""
    for side in (1.0, -1.0):
        draw = work.rng.uniform()
        if draw < 0.45:
            continue
        kind = "armchair" if draw < 0.85 else "pouf"
        length, width, height = work.size(kind)
        ahead = work.rng.uniform(0.1, 0.5)
        x, y = table.place(ahead, side * (table.width / 2 + 0.4 + length / 2))
        turn = table.heading - side * (math.pi / 2 + 0.5 * ahead) + work.rng.normal(0, 0.12)
        work.put(Furniture(kind, x, y, turn, length, width, height, sofa.group), gap=0.15, front=0.0)


def sleep(work: Furnisher, space: Space) -> bool:
    """A bed with bedside tables, sometimes a rug under it or a lamp."""
    rng = work.rng
    double = space.area > 9.0 and rng.uniform() < 0.75
    group = work.room.new_group()
    for _ in range(30):
        length, width, height = work.size("bed")
        width = width if not double else max(width, rng.uniform(1.4, 1.85))
        width = width if double else min(width, rng.uniform(0.9, 1.25))
        proposed = space.propose("bed", (length, width, height), rng, corner=0.1 if double else 0.7)
        bed = work.put(replace(proposed, group=group) if proposed is not None else None)
        if bed is None:
            continue
        for side in (1.0, -1.0):
            if rng.uniform() < (0.85 if double else 0.5):
                work.beside(bed, "nightstand", side)
        if rng.uniform() < 0.4:
            rug = work.before(bed, "rug", -0.9)
            work.put(replace(rug, group=0), front=0.0)
        return True
    return False


def dine(work: Furnisher, space: Space) -> bool:
    """A table in the open with chairs around it, sometimes on a rug."""
    rng = work.rng
    if not len(space.spots):
        return False
    kind = "round_table" if rng.uniform() < 0.3 or space.area < 11.0 else "table"
    along = space.along[int(np.argmax(space.length))]
    heading = math.atan2(along[1], along[0]) + (math.pi / 2 if rng.uniform() < 0.5 else 0.0)
    for _ in range(8):
        x, y = space.spots[int(rng.integers(len(space.spots)))]
        table = work.put(Furniture(kind, float(x), float(y), heading, *work.size(kind)), front=0.9, gap=0.5)
        if table is None:
            continue
        group = work.room.new_group()
        for chair in (around if kind == "round_table" else chairs)(table, rng):
            if rng.uniform() < 0.92:
                work.put(replace(chair, group=group), front=0.0, gap=0.0)
        if rng.uniform() < 0.25:
            size = (table.length + 1.2, table.width + 1.0, 0.012)
            work.put(Furniture("rug", table.x, table.y, heading, *size), front=0.0)
        return True
    return False


def work_place(work: Furnisher, space: Space) -> bool:
    """A desk with a chair before it."""
    desk = work.single("desk", space, tries=8, corner=0.4)
    if desk is None:
        return False
    chair = chairs(desk, work.rng)[0]
    if work.rng.uniform() < 0.75:
        length, width, height = work.size("office_chair")
        x, y = desk.place(desk.length / 2 + length / 2 + work.rng.uniform(0.08, 0.2), work.rng.normal(0, 0.1))
        turn = desk.heading + math.pi + float(np.clip(work.rng.normal(0, 0.15), -0.25, 0.25))
        chair = Furniture("office_chair", x, y, turn, length, width, height)
    work.put(replace(chair, group=0), front=0.0, gap=0.0)
    return True


def chairs(table: Furniture, rng: np.random.Generator) -> list[Furniture]:
    """Chairs that face a table from both its sides, or a desk from its front."""
    made = []
    seats = 1 if table.kind == "desk" else int(table.width // 0.6)
    for side in (1.0,) if table.kind == "desk" else (1.0, -1.0):
        for seat in range(seats):
            beside = (seat - (seats - 1) / 2) * table.width / seats
            x, y = table.place(side * (table.length / 2 + 0.25 + rng.uniform(0.02, 0.15)), beside)
            heading = table.heading + (math.pi if side > 0 else 0.0) + rng.normal(0.0, 0.08)
            made.append(Furniture("chair", x, y, heading, 0.48, 0.44, 0.88))
    return made


def around(table: Furniture, rng: np.random.Generator) -> list[Furniture]:
    """Two to four chairs around a round table, each before the middle of one side of its box."""
    made = []
    for k in rng.permutation(4)[: int(rng.integers(2, 5))]:
        angle = table.heading + math.pi / 2 * int(k)
        away = table.length / 2 + 0.25 + rng.uniform(0.02, 0.15)
        x, y = table.x + away * math.cos(angle), table.y + away * math.sin(angle)
        made.append(Furniture("chair", x, y, angle + math.pi + rng.normal(0, 0.08), 0.48, 0.44, 0.88))
    return made
