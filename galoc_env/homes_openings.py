"""Doors and windows of generated homes."""

from __future__ import annotations

import numpy as np
from shapely import LineString, Polygon, line_merge, unary_union

from galoc import GalocError, Opening
from galoc_env.wall_builder import Hole, Shell

DOOR_M = (0.75, 1.0)
"""Clear width of doors."""
WIDE_M = (1.4, 2.4)
"""Clear width of doorless openings."""
WIDE_SHARE = 0.2
"""Share of connections that are doorless openings."""
EXTRA_DOOR_SHARE = 0.25
"""Share of the remaining neighbours that get a door although they are already connected."""
WINDOW_SHARE = 0.7
"""Share of outside walls with a window."""
_TRIES = 8


def draw_doors(rng: np.random.Generator, shell: Shell, ceiling: float) -> list[Opening] | None:
    """Doors that join all rooms, and some more; None when the rooms cannot be joined.

    Args:
        rng: source of randomness.
        shell: the rooms.
        ceiling: height, m.
    """
    group = list(range(len(shell.rooms)))
    doors: list[Opening] = []
    pairs = [(i, j) for i in group for j in range(i)]
    head = round(float(rng.uniform(2.0, 2.1)), 2)
    for index in rng.permutation(len(pairs)):
        i, j = pairs[index]
        spare = rng.random()
        if group[i] == group[j] and spare > EXTRA_DOOR_SHARE:
            continue
        door = _door(rng, shell, _longest(shell.rooms[i], shell.rooms[j]), head, ceiling)
        if door is not None:
            doors.append(door)
            group = [group[i] if g == group[j] else g for g in group]
    return doors if len(set(group)) == 1 else None


def draw_windows(rng: np.random.Generator, shell: Shell, ceiling: float) -> list[Opening]:
    """Windows in the outside walls."""
    top_limit = ceiling - 0.1
    windows = []
    for index, room in enumerate(shell.rooms):
        others = unary_union([r for i, r in enumerate(shell.rooms) if i != index]).buffer(1e-3)
        for wall in _pieces(room.exterior.difference(others)):
            chance, share = rng.random(), rng.uniform(0.25, 0.6)
            bottom, top = rng.uniform(0.4, 1.1), rng.uniform(2.0, 2.3)
            place = rng.uniform(0.35, 0.65)
            width = min(2.4, share * wall.length)
            if chance > WINDOW_SHARE or width < 0.6:
                continue
            hole = _hole("window", wall, place, width, bottom, min(top, top_limit))
            placed = _placed(shell, hole)
            if placed is not None:
                windows.append(placed)
    return windows


def _door(
    rng: np.random.Generator, shell: Shell, wall: LineString | None, head: float, ceiling: float
) -> Opening | None:
    """A door or a wide opening somewhere on a shared wall, where one fits."""
    if wall is None or wall.length < DOOR_M[0] + shell.inner + 0.1:
        return None
    wide = rng.random() < WIDE_SHARE and wall.length > WIDE_M[0] + shell.inner + 0.4
    for _ in range(_TRIES):
        width = rng.uniform(*(WIDE_M if wide else DOOR_M))
        top = min(head if not wide else head + rng.uniform(0.0, 0.6), ceiling - 0.05)
        margin = (width / 2.0 + shell.inner / 2.0 + 0.03) / wall.length
        place = rng.uniform(margin, 1.0 - margin) if margin < 0.5 else 0.5
        placed = _placed(shell, _hole("door", wall, place, width, 0.0, top))
        if placed is not None:
            return placed
    return None


def _hole(kind: str, wall: LineString, place: float, width: float, bottom: float, top: float) -> Hole:
    centre = wall.interpolate(place, normalized=True)
    return Hole(kind, centre.x, centre.y, round(float(width), 2), round(float(bottom), 2), round(float(top), 2))


def _placed(shell: Shell, hole: Hole) -> Opening | None:
    try:
        return shell.place(hole)
    except GalocError:
        return None


def _longest(a: Polygon, b: Polygon) -> LineString | None:
    """Longest straight stretch of wall that two rooms share."""
    shared = _pieces(a.exterior.intersection(b.exterior)) or _pieces(a.exterior.intersection(b.buffer(1e-6)))
    return max(shared, key=lambda piece: piece.length) if shared else None


def _pieces(geometry: object) -> list[LineString]:
    """Straight stretches in a geometry, in a fixed order."""
    parts = [part for part in getattr(geometry, "geoms", [geometry]) if part.geom_type in ("LineString", "LinearRing")]
    merged = line_merge(unary_union(parts)) if parts else LineString()
    lines = []
    for line in getattr(merged, "geoms", [merged]):
        points = list(line.simplify(1e-5).coords)
        lines += [LineString(pair) for pair in zip(points, points[1:], strict=False)]
    return sorted((line for line in lines if line.length > 0.1), key=lambda line: tuple(map(tuple, line.coords)))
