"""From rooms to walls: a floorplan with true wall thickness, doors and windows.

Rooms are polygons that meet at wall centrelines and together cover the storey. Shrinking every room by half a wall
leaves the walls as what remains of the footprint, so all corners, at any angle, come out clean.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from shapely import LineString, Point, Polygon, unary_union
from shapely.geometry.base import BaseGeometry

from galoc import Floorplan, GalocError, Opening

GRID_M = 1e-4
"""Coordinates are rounded to this, m: the same plan on every machine."""
_REACH = 0.01
"""How far a door's cut reaches into the rooms on either side, m, so that no sliver stays."""

Room = Sequence[tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Hole:
    """A door or window to be cut, placed on the wall nearest to its centre."""

    kind: str
    """"door" or "window"."""
    x: float
    """Centre, m; need not lie exactly on the wall."""
    y: float
    """Centre, m."""
    width: float
    """Clear width, m."""
    bottom: float
    """Sill height, m."""
    top: float
    """Head height, m."""


def door(x: float, y: float, width: float = 0.9, top: float = 2.05) -> Hole:
    """A door centred near (x, y), m."""
    return Hole("door", x, y, width, 0.0, top)


def window(x: float, y: float, width: float, bottom: float = 0.9, top: float = 2.1) -> Hole:
    """A window centred near (x, y), m."""
    return Hole("window", x, y, width, bottom, top)


def rectangle(x1: float, y1: float, x2: float, y2: float) -> list[tuple[float, float]]:
    """Corners of an axis-aligned rectangle, counter-clockwise, m."""
    return [(x1, y1), (x2, y1), (x2, y2), (x1, y2)]


@dataclass(frozen=True, slots=True, eq=False)
class Shell:
    """Rooms and footprint of a storey, before doors are cut."""

    rooms: tuple[Polygon, ...]
    """Room polygons between wall centrelines, m."""
    inner: float
    """Thickness of walls between rooms, m."""
    outer: float
    """Thickness of outside walls, m."""
    solids: tuple[Polygon, ...] = ()
    """Pillars, chimneys and notches that stand in the rooms, m."""

    @classmethod
    def from_rooms(cls, rooms: Sequence[Room], inner: float, outer: float, solids: Sequence[Room] = ()) -> Shell:
        """Shell from vertex lists.

        Raises:
            GalocError: a room that is not a simple polygon.
        """
        polygons = tuple(Polygon(room) for room in rooms)
        for index, polygon in enumerate(polygons):
            if not polygon.is_valid or polygon.area < 0.5:
                raise GalocError(f"room {index} of {polygon.area:.2f} m2", "a simple polygon above 0.5 m2", "Fix it.")
        return cls(polygons, inner, outer, tuple(Polygon(solid) for solid in solids))

    @property
    def footprint(self) -> BaseGeometry:
        """Everything up to the outer faces of the outside walls."""
        grown = unary_union([room.buffer(1e-6, join_style="mitre") for room in self.rooms])
        storey = grown.simplify(GRID_M / 2.0)  # joins between rooms leave steps of 1e-6 m that would grow spurs
        return storey.buffer(self.outer - self.inner / 2.0 - 1e-6, join_style="mitre", mitre_limit=3.0)

    @property
    def interiors(self) -> tuple[BaseGeometry, ...]:
        """Each room's clear floor between wall faces, solids taken out."""
        return _interiors(self)

    def place(self, hole: Hole) -> Opening:
        """The opening that a hole becomes on its nearest wall.

        Raises:
            GalocError: no wall within 0.3 m, or the hole does not fit between the wall's ends or misses the room.
        """
        centre = Point(hole.x, hole.y)
        edges = [edge for room in self.rooms for edge in _edges(room)]
        edge = min(edges, key=lambda e: (e.distance(centre), -e.length))
        (x1, y1), (x2, y2) = edge.coords
        direction = np.array([x2 - x1, y2 - y1]) / edge.length
        foot = np.array([x1, y1]) + direction * edge.project(centre)
        normal = np.array([direction[1], -direction[0]])
        sides = [any(r.contains(Point(foot + s * 0.05 * normal)) for r in self.rooms) for s in (1, -1)]
        shared = all(sides)
        thickness = self.inner if shared else self.outer
        if not shared:  # outside walls are thickened outwards only
            foot = foot + (1 if sides[1] else -1) * (self.outer - self.inner) / 2.0 * normal
        half = direction * hole.width / 2.0
        ends = np.round(np.concatenate([foot - half, foot + half]) / GRID_M) * GRID_M
        ax, ay, bx, by = ends.tolist()
        opening = Opening(hole.kind, ax, ay, bx, by, thickness, hole.bottom, hole.top)
        if edge.distance(centre) > 0.3 or not self._fits(opening, normal, sides):
            raise GalocError(
                f"a {hole.kind} of {hole.width:g} m at ({hole.x:g}, {hole.y:g})",
                "a place on a straight wall, clear of corners and solids on every side that is a room",
                "Move the opening or make it narrower.",
            )
        return opening

    def _fits(self, opening: Opening, normal: NDArray[np.float64], sides: list[bool]) -> bool:
        """Whether the opening's full width borders free floor on each side that is a room."""
        ends = np.array([[opening.x1, opening.y1], [opening.x2, opening.y2]])
        interiors = self.interiors
        for sign, inside in zip((1, -1), sides, strict=True):
            line = LineString(ends + sign * (opening.thickness / 2.0 + _REACH) * normal)
            if inside and not any(line.within(room) for room in interiors):
                return False
        return any(sides)

    def build(self, holes: Sequence[Hole], ceiling_height: float, name: str, notes: str = "") -> Floorplan:
        """Cut the holes and return the plan: both faces of every wall, jambs at doors, windows as openings only."""
        openings = tuple(self.place(hole) for hole in holes)
        return build_plan(self, openings, ceiling_height, name, notes)


@lru_cache(maxsize=4)
def _interiors(shell: Shell) -> tuple[BaseGeometry, ...]:
    solid = unary_union(list(shell.solids))
    half = shell.inner / 2.0
    shrunk = (room.buffer(-half, join_style="mitre", mitre_limit=3.0) for room in shell.rooms)
    return tuple(room.difference(solid) for room in shrunk)


def build_plan(
    shell: Shell, openings: Sequence[Opening], ceiling_height: float, name: str, notes: str = ""
) -> Floorplan:
    """Plan of a shell whose openings are already placed.

    Raises:
        GalocError: the rooms do not form one storey.
    """
    footprint = shell.footprint
    cuts = [_cut(opening) for opening in openings if opening.kind == "door"]
    free = unary_union([*shell.interiors, *cuts])
    if not isinstance(footprint, Polygon):
        raise GalocError(f"rooms of {name!r} that lie apart", "one connected storey", "Let the rooms share walls.")
    walls = footprint.difference(free)
    return Floorplan(
        segments=boundary_segments(walls),
        ceiling_height=ceiling_height,
        openings=tuple(openings),
        outline=np.array(_ring(footprint.exterior.coords)),
        name=name,
        notes=notes,
    )


def boundary_segments(solid: BaseGeometry) -> NDArray[np.float64]:
    """(S, 4) boundary of polygons, m: rounded, collinear pieces merged, in a fixed order."""
    rows: list[list[float]] = []
    for part in getattr(solid, "geoms", [solid]):
        if part.area < 1e-4:
            continue
        for ring in (part.exterior, *part.interiors):
            points = _ring(ring.coords)
            rows += [[*a, *b] for a, b in zip(points, points[1:] + points[:1], strict=True)]
    return np.array(sorted(rows)).reshape(-1, 4)


def _ring(coords: Sequence[tuple[float, ...]]) -> list[tuple[float, float]]:
    """Vertices of a closed ring, rounded, without repeats and without vertices on a straight line."""
    rounded = [(round(c[0] / GRID_M) * GRID_M, round(c[1] / GRID_M) * GRID_M) for c in coords[:-1]]
    rounded = [(round(x, 6) + 0.0, round(y, 6) + 0.0) for x, y in rounded]
    points = [p for i, p in enumerate(rounded) if p != rounded[i - 1]]
    kept = True
    while kept and len(points) > 3:
        bent = [p for i, p in enumerate(points) if not _straight(points[i - 1], p, points[(i + 1) % len(points)])]
        kept = len(bent) < len(points)
        points = bent
    start = points.index(min(points))
    return points[start:] + points[:start]


def _straight(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """Whether b lies within a rounding step of the line from a to c."""
    ux, uy = c[0] - a[0], c[1] - a[1]
    length = math.hypot(ux, uy)
    return length < GRID_M or abs(ux * (b[1] - a[1]) - uy * (b[0] - a[0])) / length < 1.5 * GRID_M


def _edges(room: Polygon) -> list[LineString]:
    points = list(room.exterior.coords)
    return [LineString([a, b]) for a, b in zip(points, points[1:], strict=False)]


def _cut(opening: Opening) -> BaseGeometry:
    """Floor area of a door, reaching slightly into both rooms."""
    line = LineString([(opening.x1, opening.y1), (opening.x2, opening.y2)])
    return line.buffer(opening.thickness / 2.0 + _REACH, cap_style="flat")
