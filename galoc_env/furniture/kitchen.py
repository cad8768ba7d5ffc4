"""Fitted kitchens: which walls their units stand along, and what each unit is."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from galoc_env.furniture import Furniture

if TYPE_CHECKING:
    from galoc_env.furniture.room import FreeRoom
    from galoc_env.furniture.space import Space

COUNTER, UPPER = 0.90, 1.45
"""Heights of the worktop and of the lower edge of wall cabinets, m."""
DEPTH = 0.62
"""Depth of the worktop, m."""
UNIT = 0.60
"""Usual width of a unit, m."""
BACK_GAP = 0.012
"""Gap between units and the walls, m."""
SEAM = 0.002
"""Gap between two pieces of a run, m; they are drawn across it."""
_LEAST, _MOST = 3, 7
"""Units of a run along one wall."""
_PIECE = 4
"""Units of one piece at most."""


@dataclass(frozen=True, slots=True)
class _Run:
    """Units side by side along one edge of a room, by growing s."""

    edge: int
    s: tuple[float, ...]
    """Middle of each unit along the edge, m."""
    width: float
    """Of each unit, m."""
    tall: tuple[bool, ...]
    """Where wall cabinets are possible: not before a window."""
    corner: tuple[bool, bool]
    """Whether the run reaches the corner at the edge's start, and at its end."""


def place_kitchen(room: FreeRoom, space: Space, rng: np.random.Generator) -> list[Furniture]:
    """Put a kitchen into a room: along its best wall, and around a corner where there is room.

    Returns:
        The pieces that were placed; none where no wall has three units' room.
    """
    top = min(2.1 if rng.uniform() < 0.6 else 2.5, room.plan.ceiling_height - 0.1)
    runs = [_longest(room, space, edge, top) for edge in range(len(space.length))]
    first = max(runs, key=lambda run: len(run.s) + rng.uniform(0.0, 1.5), default=None)
    if first is None or len(first.s) < _LEAST:
        return []
    first = _cut(first, int(rng.integers(_LEAST + 1, _MOST + 1)), rng)
    second = _around_corner(room, space, first, top, rng)
    fridge = rng.uniform() < 0.85
    units = _units(first, second, fridge, rng)
    group = room.new_group()
    pieces = _pieces(space, first, units[0], (top, rng.uniform(0.0, 1.0)))
    if second is not None:
        pieces += _pieces(space, second, units[1], (top, 0.0))
    placed = [replace(piece, group=group) for piece in pieces]
    return [piece for piece in placed if room.place(piece, front=0.6, gap=0.0)]


def _longest(room: FreeRoom, space: Space, edge: int, top: float, start: float = BACK_GAP, most: int = 12) -> _Run:
    """The longest unbroken run of units that fits along an edge from ``start`` (m) on."""
    free = float(space.length[edge]) - start - BACK_GAP
    count = min(int(free / UNIT), 12)
    if count < 1:
        return _Run(edge, (), UNIT, (), (False, False))
    width = free / count if free / count < 1.12 * UNIT else UNIT
    s = [start + (k + 0.5) * width for k in range(count)]
    low, tall = [], []
    for middle in s:
        piece = space.at_wall("kitchen", edge, middle, (DEPTH, width - SEAM, top), BACK_GAP)
        high = room.fits(piece, 0.6)
        tall.append(high)
        low.append(high or room.fits(replace(piece, kind="counter", height=COUNTER), 0.6))
    best, begin = (0, 0), 0
    for k in range(count + 1):
        if k == count or not low[k]:
            best = max(best, (k - begin, -begin))
            begin = k + 1
    size, begin = best[0], -best[1]
    kept = slice(begin, begin + min(size, most))
    ends = (begin == 0 and start == BACK_GAP, begin + size == count and width != UNIT)
    return _Run(edge, tuple(s[kept]), width, tuple(tall[kept]), ends)


def _cut(run: _Run, most: int, rng: np.random.Generator) -> _Run:
    """At most so many units; those at a corner stay."""
    if len(run.s) <= most:
        return run
    from_end = run.corner[1] and (not run.corner[0] or rng.uniform() < 0.5)
    kept = slice(len(run.s) - most, None) if from_end else slice(0, most)
    corner = (run.corner[0] and not from_end, run.corner[1] and from_end)
    return _Run(run.edge, run.s[kept], run.width, run.tall[kept], corner)


def _around_corner(room: FreeRoom, space: Space, run: _Run, top: float, rng: np.random.Generator) -> _Run | None:
    """A run along the next or the previous edge that goes on from a square inner corner of the first one."""
    if rng.uniform() < 0.35:
        return None
    count = len(space.length)
    for at_end in (False, True):
        other = (run.edge + (1 if at_end else -1)) % count
        edges = (run.edge, other) if at_end else (other, run.edge)
        meeting = space.start[edges[0]] + space.length[edges[0]] * space.along[edges[0]]
        gap = float(np.abs(meeting - space.start[edges[1]]).max())
        a, b = space.along[edges[0]], space.along[edges[1]]
        if not run.corner[at_end] or gap > 0.01 or a[0] * b[1] - a[1] * b[0] < math.cos(math.radians(4.0)):
            continue
        offset = DEPTH + BACK_GAP + SEAM
        most = int(rng.integers(2, 5))
        if at_end:
            more = _longest(room, space, other, top, offset, most)
            near = bool(more.s) and more.s[0] < offset + more.width
        else:  # the units nearest to the far end of the edge, which is this corner
            more = _from_end(room, space, other, top, (offset, most))
            near = bool(more.s)
        if near and len(more.s) >= 2:
            return replace(more, corner=(at_end, not at_end))
    return None


def _from_end(room: FreeRoom, space: Space, edge: int, top: float, rule: tuple[float, int]) -> _Run:
    """Units from ``rule[0]`` m before an edge's end backwards, as many as fit, at most ``rule[1]``."""
    offset, most = rule
    s, tall = [], []
    for k in range(most):
        middle = float(space.length[edge]) - offset - (k + 0.5) * UNIT
        if middle < UNIT / 2 + BACK_GAP:
            break
        piece = space.at_wall("kitchen", edge, middle, (DEPTH, UNIT - SEAM, top), BACK_GAP)
        high = room.fits(piece, 0.6)
        if not high and not room.fits(replace(piece, kind="counter", height=COUNTER), 0.6):
            break
        s.append(middle)
        tall.append(high)
    return _Run(edge, tuple(s[::-1]), UNIT, tuple(tall[::-1]), (False, False))


def _units(first: _Run, second: _Run | None, fridge: bool, rng: np.random.Generator) -> tuple[list[str], list[str]]:
    """A letter for each unit: F fridge, H hob and oven, S sink, W dishwasher, D door, R drawers, N blind corner."""
    units = [str(u) for u in rng.choice(list("DDDR"), size=len(first.s))]
    more = [] if second is None else [str(u) for u in rng.choice(list("DDR"), size=len(second.s))]
    free = list(range(len(units)))
    if second is not None:
        blind = len(units) - 1 if second.corner[0] else 0
        units[blind] = "N"
        free.remove(blind)
    ends = [k for k in (0, len(units) - 1) if k in free and first.tall[k]]
    if fridge and ends and len(free) > 2:
        k = ends[int(rng.integers(len(ends)))]
        units[k] = "F"
        free.remove(k)
    high = [k for k in free if first.tall[k] and 0 < k < len(units) - 1] or [k for k in free if first.tall[k]] or free
    if high:
        k = high[int(rng.integers(len(high)))]
        units[k] = "H"
        free.remove(k)
    low = [k for k in free if not first.tall[k]] or free
    if low and (not more or rng.uniform() < 0.6):
        k = low[int(rng.integers(len(low)))]
        units[k] = "S"
        free.remove(k)
        if k + 1 in free and rng.uniform() < 0.6:
            units[k + 1] = "W"
    elif more:
        more[int(rng.integers(len(more)))] = "S"
    return units, more


def _pieces(space: Space, run: _Run, units: list[str], heights: tuple[float, float]) -> list[Furniture]:
    """Neighbouring units of one sort as one piece each; ``heights``: top of the cabinets, and where the fridge ends."""
    top, share = heights
    sort = ["fridge" if u == "F" else "kitchen" if t else "counter" for u, t in zip(units, run.tall, strict=True)]
    pieces, begin = [], 0
    for k in range(1, len(units) + 1):
        if k < len(units) and sort[k] == sort[begin] and k - begin < _PIECE and sort[k] != "fridge":
            continue
        kind = sort[begin]
        middle, width = (run.s[begin] + run.s[k - 1]) / 2, (k - begin) * run.width - SEAM
        height = {"kitchen": top, "counter": COUNTER, "fridge": min(top, 1.75 + 0.5 * share)}[kind]
        piece = space.at_wall(kind, run.edge, middle, (DEPTH, width, height), BACK_GAP)
        # Units are named from the piece's right to its left, and its left is where s falls.
        pieces.append(replace(piece, detail="" if kind == "fridge" else "".join(units[begin:k])[::-1]))
        begin = k
    return pieces
