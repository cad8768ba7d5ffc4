"""What stands on the floor: whether a way stays passable beside it, and whether there is room on the wall behind it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc_env.furniture import AGENT_RADIUS

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan
    from galoc_env.furniture import Furniture

Array = NDArray[np.float64]

SPARE = 0.08
"""A way must stay passable also for an agent this much larger: grids round, m."""
_REACH = 1.0
"""A detour within this distance is none, m."""


@dataclass(frozen=True, slots=True)
class Box:
    """An upright box that stands on the floor."""

    x: float
    """Centre, m."""
    y: float
    """Centre, m."""
    heading: float
    """Plan bearing of its length, rad."""
    length: float
    """m."""
    width: float
    """m."""
    height: float
    """m."""
    flat: ClassVar[bool] = False
    """Rugs alone are: they stop nobody, and nothing."""

    def corners(self) -> Array:
        """(4, 2) m, counter-clockwise."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        half = np.array([self.length, self.width]) / 2
        local = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half
        return np.asarray(local @ np.array([[c, s], [-s, c]]) + (self.x, self.y))

    def edges(self) -> Array:
        """(4, 4) m: the footprint's edges as segments x1, y1, x2, y2."""
        corners = self.corners()
        return np.hstack([corners, np.roll(corners, -1, axis=0)])

    def distance(self, points: Array) -> Array:
        """(...) m: distance from points (..., 2) to the footprint, 0 inside."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        dx, dy = points[..., 0] - self.x, points[..., 1] - self.y
        ahead, beside = np.abs(c * dx + s * dy) - self.length / 2, np.abs(c * dy - s * dx) - self.width / 2
        return np.asarray(np.hypot(np.maximum(ahead, 0.0), np.maximum(beside, 0.0)))


class Ground:
    """Cells of a plan that an agent of radius 0.3 m can roam among boxes."""

    def __init__(self, plan: Floorplan, boxes: Sequence[Box | Furniture]) -> None:
        self._space = plan.free_space()
        self._radii = (AGENT_RADIUS, AGENT_RADIUS + SPARE)
        free = self._space.inside & (self._space.clearance >= AGENT_RADIUS)
        self._free = (free, free.copy())
        for box in boxes:
            if box.flat:
                continue
            window, distance = self._around(box)
            for cells, radius in zip(self._free, self._radii, strict=True):
                cells[window] &= distance >= radius

    def place(self, box: Box) -> bool:
        """Put a box down if all that is connected without it stays so."""
        window, distance = self._around(box)
        views = [cells[window] for cells in self._free]
        blocked = [view & (distance < radius) for view, radius in zip(views, self._radii, strict=True)]
        if not all(_still_connected(view, taken) for view, taken in zip(views, blocked, strict=True)):
            return False
        for view, taken in zip(views, blocked, strict=True):
            view &= ~taken
        return True

    def _around(self, box: Box | Furniture) -> tuple[tuple[slice, slice], Array]:
        """A window of the grid around a box, and the distance of its cell centres to the box, m."""
        step = self._space.resolution
        n = math.ceil((math.hypot(box.length, box.width) / 2 + AGENT_RADIUS + _REACH) / step)
        rows, cols = self._free[0].shape
        row, col = (int(i) for i in self._space.index([box.x, box.y]))
        # A box outside the grid has an empty window.
        top, left = min(max(row - n, 0), rows), min(max(col - n, 0), cols)
        window = (slice(top, max(min(row + n + 1, rows), top)), slice(left, max(min(col + n + 1, cols), left)))
        x = self._space.origin[0] + (np.arange(window[1].start, window[1].stop) + 0.5) * step
        y = self._space.origin[1] + (np.arange(window[0].start, window[0].stop) + 0.5) * step
        return window, box.distance(np.stack(np.meshgrid(x, y), axis=-1))


def _still_connected(free: NDArray[np.bool_], blocked: NDArray[np.bool_]) -> bool:
    """Whether no two free cells beside the blocked ones lose their connection within the window."""
    import cv2

    if not blocked.any():
        return True
    left = free & ~blocked
    rim = cv2.dilate(blocked.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool) & left
    before = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)[1]
    after = cv2.connectedComponents(left.astype(np.uint8), connectivity=4)[1]
    if set(np.unique(before[blocked])) - set(np.unique(before[rim])):
        return False  # a place has vanished altogether
    return len(np.unique(after[rim])) == len(np.unique(before[rim]))


class Clutter:
    """Boxes on the floor, for asking whether something would hang inside one of them."""

    def __init__(self, boxes: Sequence[Box | Furniture]) -> None:
        rows = [
            (b.x, b.y, math.cos(b.heading), math.sin(b.heading), b.length, b.width, b.height)
            for b in boxes
            if not b.flat
        ]
        self._table = np.array(rows, np.float64).reshape(-1, 7)
        self.boxes = tuple(boxes)
        """All of them, rugs too."""

    def hits(self, points: ArrayLike, low: float, gap: float = 0.03) -> bool:
        """Whether a box reaches higher than ``low`` (m) within ``gap`` (m) of one of the points (N, 2)."""
        p = np.asarray(points, np.float64)[:, None]
        x, y, c, s, length, width, height = self._table.T
        dx, dy = p[..., 0] - x, p[..., 1] - y
        ahead, beside = np.abs(c * dx + s * dy) - length / 2, np.abs(c * dy - s * dx) - width / 2
        near = np.hypot(np.maximum(ahead, 0.0), np.maximum(beside, 0.0)) < gap
        return bool((near & (height > low)).any())
