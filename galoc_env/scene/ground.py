"""What stands on the floor: whether a way stays passable beside it, and whether there is room on the wall behind it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc_env.furniture import AGENT_RADIUS
from galoc_env.furniture.footprint import Box

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan
    from galoc_env.furniture import Furniture

SPARE = 0.08
"""A way must stay passable also for an agent this much larger: grids round, m."""
_REACH = 1.0
"""A detour within this distance is none, m."""


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
            window, distance = box.around(self._space, AGENT_RADIUS + _REACH)
            for cells, radius in zip(self._free, self._radii, strict=True):
                cells[window] &= distance >= radius

    def place(self, box: Box) -> bool:
        """Put a box down if all that is connected without it stays so."""
        window, distance = box.around(self._space, AGENT_RADIUS + _REACH)
        views = [cells[window] for cells in self._free]
        blocked = [view & (distance < radius) for view, radius in zip(views, self._radii, strict=True)]
        if not all(_still_connected(view, taken) for view, taken in zip(views, blocked, strict=True)):
            return False
        for view, taken in zip(views, blocked, strict=True):
            view &= ~taken
        return True


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
