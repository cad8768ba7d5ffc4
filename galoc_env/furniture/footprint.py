"""Upright boxes on the floor: their footprints, and the cells of a plan around them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from galoc.freespace import FreeSpace

Array = NDArray[np.float64]


class Footprint:
    """What all boxes on the floor can say of themselves; their fields are those of :class:`Box`."""

    __slots__ = ()
    x: float
    y: float
    heading: float
    length: float
    width: float

    @property
    def flat(self) -> bool:
        """Whether it lies on the floor, so that bodies pass over it."""
        return False

    def corners(self, margin: float = 0.0) -> Array:
        """(4, 2) m: corners of the footprint grown by ``margin``, counter-clockwise."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        a, b = self.length / 2 + margin, self.width / 2 + margin
        local = np.array([[a, b], [-a, b], [-a, -b], [a, -b]])
        return np.asarray(local @ np.array([[c, s], [-s, c]]) + (self.x, self.y))

    def edges(self) -> Array:
        """(4, 4) m: what stops bodies: the footprint's edges as segments x1, y1, x2, y2; (0, 4) for a flat piece."""
        if self.flat:
            return np.zeros((0, 4))
        corners = self.corners()
        return np.hstack([corners, np.roll(corners, -1, axis=0)])

    def distance(self, points: Array) -> Array:
        """(...) m: distance from points (..., 2) to the footprint, 0 inside."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        dx, dy = points[..., 0] - self.x, points[..., 1] - self.y
        ahead = np.abs(c * dx + s * dy) - self.length / 2
        beside = np.abs(c * dy - s * dx) - self.width / 2
        return np.asarray(np.hypot(np.maximum(ahead, 0.0), np.maximum(beside, 0.0)))

    def around(self, space: FreeSpace, reach: float) -> tuple[tuple[slice, slice], Array]:
        """Cells of a grid within ``reach`` (m) of the box and some more: their window, and how far off they are, m."""
        step = space.resolution
        n = math.ceil((math.hypot(self.length, self.width) / 2 + reach) / step)
        rows, cols = space.inside.shape
        row, col = (int(i) for i in space.index([self.x, self.y]))
        # A box outside the grid has an empty window.
        top, left = min(max(row - n, 0), rows), min(max(col - n, 0), cols)
        window = (slice(top, max(min(row + n + 1, rows), top)), slice(left, max(min(col + n + 1, cols), left)))
        x = space.origin[0] + (np.arange(window[1].start, window[1].stop) + 0.5) * step
        y = space.origin[1] + (np.arange(window[0].start, window[0].stop) + 0.5) * step
        return window, self.distance(np.stack(np.meshgrid(x, y), axis=-1))


@dataclass(frozen=True, slots=True)
class Box(Footprint):
    """An upright box that stands on the floor."""

    x: float
    """Centre, m."""
    y: float
    """Centre, m."""
    heading: float
    """Plan bearing of its length, rad."""
    length: float
    """Extent along the heading, m."""
    width: float
    """Extent across the heading, m."""
    height: float
    """Extent upwards, m."""
