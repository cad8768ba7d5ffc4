"""Book-keeping while a plan is furnished: what is still free, and whether a piece would be in the way."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from galoc_env.furniture import AGENT_RADIUS, DOOR_CLEARANCE, MIN_GAP, Furniture

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan

Array = NDArray[np.float64]

_OPEN_CLEARANCE = 0.9
"""Free-standing pieces are centred at least this far from walls, m."""
_DETOUR = 2.0
"""A piece may force a detour within this distance of it; a longer one counts as cut off, m."""
_LONGEST = 8.0
"""Longer walls are not likelier to get furniture than walls of this length, m."""


class FreeRoom:
    """A plan, the pieces placed so far, and the ground that an agent can still roam."""

    def __init__(self, plan: Floorplan) -> None:
        import shapely

        self.plan = plan
        self.items: list[Furniture] = []
        self.rugs: list[Furniture] = []
        self._groups = 0
        self._space = plan.free_space()
        # Twice: as cell centres say it, and with half a cell's diagonal more, so that the way holds for every point of
        # its cells. Checking only the second would leave slivers of the first cut off.
        self._radii = (AGENT_RADIUS, AGENT_RADIUS + 0.71 * self._space.resolution)
        free = self._space.inside & (self._space.clearance >= AGENT_RADIUS)
        self._free = [free, free.copy()]
        self._open = self._space.positions(_OPEN_CLEARANCE)
        lines = shapely.linestrings(plan.segments.reshape(-1, 2, 2))
        self._walls = shapely.STRtree(lines)
        doors = [o for o in plan.openings if o.kind == "door"]
        windows = [o for o in plan.openings if o.kind == "window"]
        self._doors = shapely.STRtree([shapely.LineString([(o.x1, o.y1), (o.x2, o.y2)]) for o in doors])
        self._windows = shapely.STRtree([shapely.LineString([(o.x1, o.y1), (o.x2, o.y2)]) for o in windows])
        self._sills = np.array([o.bottom for o in windows])
        self._start, delta = plan.segments[:, :2], plan.segments[:, 2:] - plan.segments[:, :2]
        self._length = np.linalg.norm(delta, axis=1)
        self._along = delta / np.maximum(self._length, 1e-9)[:, None]
        weight = np.where(self._length > 0.4, np.minimum(self._length, _LONGEST), 0.0)
        total = weight.sum()
        self._chance = np.cumsum(weight) / total if total > 0 else np.linspace(0.0, 1.0, len(weight) + 1)[1:]

    @property
    def area(self) -> float:
        """Inside area of the plan, m2."""
        return float(self._space.area)

    @property
    def open_spots(self) -> Array:
        """(P, 2) m: places in the open."""
        return self._open

    def new_group(self) -> int:
        """A number for pieces that belong together, from 1."""
        self._groups += 1
        return self._groups

    def swap(self, old: Furniture, new: Furniture) -> None:
        """Put a piece with the same footprint in another's place."""
        self.items[self.items.index(old)] = new

    def wall_spot(self, width: float, rng: np.random.Generator) -> tuple[Array, Array]:
        """A random point on a wall where ``width`` (m) fits beside it, and the unit normal of a random side."""
        i = min(int(np.searchsorted(self._chance, rng.uniform())), len(self._chance) - 1)
        slack = max(self._length[i] - width, 0.0)
        s = (self._length[i] - slack) / 2 + slack * rng.uniform()
        normal = np.array([-self._along[i, 1], self._along[i, 0]]) * (1.0 if rng.uniform() < 0.5 else -1.0)
        return self._start[i] + s * self._along[i], normal

    def wall_bearing(self, rng: np.random.Generator) -> float:
        """Bearing of a random wall, rad: free-standing pieces are lined up with some wall."""
        along = self._along[min(int(np.searchsorted(self._chance, rng.uniform())), len(self._chance) - 1)]
        return math.atan2(along[1], along[0])

    def open_spot(self, rng: np.random.Generator) -> tuple[float, float] | None:
        """A random place in the open, m; None where the plan has none."""
        if not len(self._open):
            return None
        x, y = self._open[rng.integers(len(self._open))]
        return float(x), float(y)

    def place(self, item: Furniture, *, front: float, gap: float = MIN_GAP) -> bool:
        """Put a piece down if nothing speaks against it.

        Args:
            item: the piece.
            front: clear distance wanted before it, m.
            gap: least distance to other pieces, m.
        """
        if not self.fits(item, front) or not (item.flat or self._apart(item, gap)):
            return False
        if item.flat:
            self.rugs.append(item)
            return True
        window, distance = item.around(self._space, AGENT_RADIUS + _DETOUR)
        views = [free[window] for free in self._free]
        blocked = [view & (distance < radius) for view, radius in zip(views, self._radii, strict=True)]
        if not all(_passable(view, taken) for view, taken in zip(views, blocked, strict=True)):
            return False
        for view, taken in zip(views, blocked, strict=True):
            view &= ~taken
        self.items.append(item)
        return True

    def fits(self, item: Furniture, front: float) -> bool:
        """Inside, through no wall, away from doors, with its front clear, and before no window that it would cover."""
        import shapely

        heading = np.array([math.cos(item.heading), math.sin(item.heading)])
        before = np.array([item.x, item.y]) + (item.length / 2 + front) * heading
        points = np.vstack([item.corners(-0.02), [[item.x, item.y]], before[None]])
        clearance = self._space.clearance_at(points)
        if not np.all(clearance[:5] > 0.0) or clearance[5] <= min(front, 0.15):
            return False
        outline = shapely.Polygon(item.corners(0.01))
        if len(self._walls.query(outline, predicate="intersects")):
            return False
        if len(self._doors.query(outline, predicate="dwithin", distance=DOOR_CLEARANCE)):
            return False
        covered = self._windows.query(outline, predicate="dwithin", distance=0.45)
        return not np.any(self._sills[covered] < item.height) if len(covered) else True

    def _apart(self, item: Furniture, gap: float) -> bool:
        """At least ``gap`` from every other piece."""
        import shapely

        outline = None
        radius = math.hypot(item.length, item.width) / 2
        for other in self.items:
            reach = radius + math.hypot(other.length, other.width) / 2 + gap
            if abs(other.x - item.x) < reach and abs(other.y - item.y) < reach:
                outline = outline or shapely.Polygon(item.corners())
                distance = outline.distance(shapely.Polygon(other.corners()))
                if distance <= gap:
                    return False
        return True


def _passable(free: NDArray[np.bool_], blocked: NDArray[np.bool_]) -> bool:
    """Whether all that bordered the blocked cells is still connected, without leaving the window."""
    import cv2

    if not blocked.any():
        return True
    left = free & ~blocked
    _, label = cv2.connectedComponents(left.astype(np.uint8), connectivity=4)
    rim = cv2.dilate(blocked.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool) & left
    return len(np.unique(label[rim])) == 1
