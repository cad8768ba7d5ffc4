"""Parts of generated buildings that are copied: rooms with their doors, windows and closets, moved as one."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, unary_union

from galoc_env.wall_builder import Hole, rectangle

Array = NDArray[np.float64]
Ring = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Part:
    """Some rooms and what is in their walls."""

    rooms: tuple[Ring, ...] = ()
    """Vertices of each room between wall centrelines, m."""
    holes: tuple[Hole, ...] = ()
    """Doors and windows."""
    solids: tuple[Ring, ...] = ()
    """Closets, chimneys and pillars, m."""

    def __add__(self, other: Part) -> Part:
        """Both together."""
        return Part(self.rooms + other.rooms, self.holes + other.holes, self.solids + other.solids)

    def moved(self, matrix: Array, shift: Array) -> Part:
        """The part after p -> matrix p + shift, with matrix (2, 2) orthogonal and shift (2,) in m."""

        def at(x: float, y: float) -> tuple[float, float]:
            # On the wall builder's rounding grid: copies stay copies there.
            u, v = matrix @ (x, y) + shift
            return round(float(u), 4), round(float(v), 4)

        def ring(points: Ring) -> Ring:
            moved = tuple(at(*point) for point in points)
            return moved if np.linalg.det(matrix) > 0 else moved[::-1]

        holes = [at(hole.x, hole.y) for hole in self.holes]
        return Part(
            tuple(map(ring, self.rooms)),
            tuple(replace(hole, x=x, y=y) for hole, (x, y) in zip(self.holes, holes, strict=True)),
            tuple(map(ring, self.solids)),
        )

    def by(self, motion: Array) -> Part:
        """The part after a rigid motion (3,): turned by the last entry about the origin, then shifted by the others."""
        return self.moved(rotation(float(motion[2])), np.asarray(motion[:2], dtype=np.float64))


def rotation(angle_rad: float) -> Array:
    """(2, 2) rotation, exact for multiples of a quarter turn."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    exact = np.array([[c, -s], [s, c]])
    return np.where(np.abs(exact - np.round(exact)) < 1e-12, np.round(exact), exact)


def half_turn(x: float, y: float) -> Array:
    """(3,) rigid motion: half a turn about a point, m."""
    return np.array([2.0 * x, 2.0 * y, math.pi])


def shift(x: float, y: float) -> Array:
    """(3,) rigid motion: a shift, m."""
    return np.array([x, y, 0.0])


def box(x1: float, y1: float, x2: float, y2: float) -> Ring:
    """Ring of an axis-aligned rectangle, m."""
    return tuple(rectangle(x1, y1, x2, y2))


def joined(*rings: Ring) -> Ring:
    """Ring around rectangles that touch."""
    whole = unary_union([Polygon(ring) for ring in rings]).simplify(1e-6).normalize()
    assert isinstance(whole, Polygon) and not whole.interiors
    return tuple((round(x, 4), round(y, 4)) for x, y in whole.exterior.coords[:-1])
