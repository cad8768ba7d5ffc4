"""Furniture as oriented boxes: what stands where, without blocking a way."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from galoc.errors import GalocError

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan
    from galoc_env.furniture_room import FreeRoom

Array = NDArray[np.float64]

AGENT_RADIUS = 0.3
"""An agent of this radius can still reach every place after furnishing that it could reach before, m."""
DOOR_CLEARANCE = 0.9
"""No furniture this close to a door's centreline, m."""
AREA_PER_ITEM = 2.5
"""Floor area for each piece at density 1, m2."""
MAX_ITEMS = 150
"""Most pieces at density 1: huge plans stay fast to build and to draw."""
WALL_GAP = 0.03
"""Gap between a piece's back and the wall, m."""
MIN_GAP = 0.05
"""Least gap between two pieces, m."""


@dataclass(frozen=True, slots=True)
class Furniture:
    """An upright box that stands on the floor; its front faces ``heading``."""

    kind: str
    """One of :data:`KINDS`."""
    x: float
    """Centre, m."""
    y: float
    """Centre, m."""
    heading: float
    """Plan bearing of the front, rad."""
    length: float
    """Extent along the heading, m."""
    width: float
    """Extent across the heading, m."""
    height: float
    """Extent upwards, m."""

    def corners(self, margin: float = 0.0) -> Array:
        """(4, 2) m: corners of the footprint grown by ``margin``, counter-clockwise."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        a, b = self.length / 2 + margin, self.width / 2 + margin
        local = np.array([[a, b], [-a, b], [-a, -b], [a, -b]])
        return local @ np.array([[c, s], [-s, c]]) + (self.x, self.y)

    def edges(self) -> Array:
        """(4, 4) m: the footprint's edges as segments x1, y1, x2, y2."""
        corners = self.corners()
        return np.hstack([corners, np.roll(corners, -1, axis=0)])

    def distance(self, points: Array) -> Array:
        """(...) m: distance from points (..., 2) to the footprint, 0 inside."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        dx, dy = points[..., 0] - self.x, points[..., 1] - self.y
        ahead = np.abs(c * dx + s * dy) - self.length / 2
        beside = np.abs(c * dy - s * dx) - self.width / 2
        return np.hypot(np.maximum(ahead, 0.0), np.maximum(beside, 0.0))


@dataclass(frozen=True, slots=True)
class _Kind:
    """Sizes and habits of one kind of furniture."""

    length: tuple[float, float]
    width: tuple[float, float]
    height: tuple[float, float]
    weight: float
    """How often it is tried."""
    free: bool = False
    """Stands away from walls."""
    front: float = 0.5
    """Clear distance wanted before it, m."""


_KINDS = {
    "armchair": _Kind((0.80, 0.90), (0.80, 0.95), (0.80, 0.95), 1.0),
    "bed": _Kind((2.05, 2.15), (1.00, 1.80), (0.90, 1.10), 0.9),
    "cabinet": _Kind((0.40, 0.50), (0.80, 1.70), (0.70, 0.95), 1.4),
    "chair": _Kind((0.45, 0.50), (0.42, 0.48), (0.85, 0.95), 0.8),
    "desk": _Kind((0.65, 0.80), (1.20, 1.60), (0.72, 0.76), 1.2),
    "lamp": _Kind((0.38, 0.38), (0.38, 0.38), (1.45, 1.70), 0.8, front=0.1),
    "plant": _Kind((0.45, 0.60), (0.45, 0.60), (0.90, 1.50), 1.0, front=0.1),
    "shelf": _Kind((0.28, 0.36), (0.80, 1.40), (1.70, 2.10), 1.6),
    "sofa": _Kind((0.85, 0.95), (1.50, 2.20), (0.78, 0.88), 1.3),
    "table": _Kind((0.80, 0.95), (1.20, 1.80), (0.72, 0.76), 1.0, free=True),
    "wardrobe": _Kind((0.55, 0.62), (1.00, 2.00), (1.90, 2.15), 1.1),
}

KINDS = tuple(_KINDS)
"""All kinds of furniture."""


def furnish(plan: Floorplan, density: float, rng: np.random.Generator) -> tuple[Furniture, ...]:
    """Put furniture into a plan, mostly against its walls.

    No piece overlaps a wall or another piece, stands within 0.9 m of a door, or cuts off a place that an agent of
    radius 0.3 m could reach before.

    Args:
        plan: any floorplan.
        density: 0 (none) to 1 (crowded).
        rng: source of all choices.

    Raises:
        GalocError: density out of range.
    """
    if isinstance(density, str | bool) or not 0.0 <= density <= 1.0:
        raise GalocError(f"furniture = {density!r}", "a density from 0 (empty) to 1 (crowded)", "Pass 0.5, say.")
    if density == 0.0:
        return ()
    from galoc_env.furniture_room import FreeRoom

    room = FreeRoom(plan)
    target = round(density * min(room.area / AREA_PER_ITEM, MAX_ITEMS))
    weights = np.array([kind.weight for kind in _KINDS.values()])
    for _ in range(12 * target):
        if len(room.items) >= target:
            break
        name = str(rng.choice(KINDS, p=weights / weights.sum()))
        item = _propose(name, room, rng)
        if item is not None and room.place(item, front=_KINDS[name].front) and name in ("table", "desk"):
            for chair in _chairs(item, rng):
                room.place(chair, front=0.0, gap=0.0)
    return tuple(room.items)


def _propose(name: str, room: FreeRoom, rng: np.random.Generator) -> Furniture | None:
    """A piece of random size: with its back to a random wall, or freely in the open."""
    kind = _KINDS[name]
    length, width, height = (float(rng.uniform(*span)) for span in (kind.length, kind.width, kind.height))
    height = min(height, room.plan.ceiling_height - 0.1)
    if kind.free:
        spot = room.open_spot(rng)
        if spot is None:
            return None
        return Furniture(name, spot[0], spot[1], room.wall_bearing(rng), length, width, height)
    foot, normal = room.wall_spot(width, rng)
    x, y = foot + normal * (length / 2 + WALL_GAP)
    return Furniture(name, float(x), float(y), math.atan2(normal[1], normal[0]), length, width, height)


def _chairs(table: Furniture, rng: np.random.Generator) -> list[Furniture]:
    """Chairs that face a table from both its sides, or a desk from its front."""
    chairs = []
    along = np.array([math.cos(table.heading), math.sin(table.heading)])
    across = np.array([-along[1], along[0]])
    seats = 1 if table.kind == "desk" else int(table.width // 0.6)
    for side in (1.0,) if table.kind == "desk" else (1.0, -1.0):
        for seat in range(seats):
            beside = (seat - (seats - 1) / 2) * table.width / seats
            away = table.length / 2 + 0.24 + rng.uniform(0.02, 0.15)
            x, y = (table.x, table.y) + side * away * along + beside * across
            heading = table.heading + (math.pi if side > 0 else 0.0) + rng.normal(0.0, 0.08)
            chairs.append(Furniture("chair", float(x), float(y), heading, 0.46, 0.44, 0.90))
    return chairs
