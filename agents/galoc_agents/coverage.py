"""Which part of a plan was seen from where, and how much a further view would add."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from galoc import Camera, Floorplan
from galoc.metrics import wrap_angle
from galoc.profiles import Caster

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

REACH_M = 6.0
"""Floor farther away than this does not count as seen, m."""
MAX_CELLS = 3000
"""Cells of floor that are kept account of at most: larger plans get coarser cells."""
MAX_STANDS = 600
"""Places to look from that are considered at most."""
CELL_M, STAND_M = 0.25, 0.5
"""Cells of floor and places to look from are this far apart where there are few enough, m."""
SECTORS = 72
"""Bearings are counted in this many sectors."""


class Coverage:
    """The floor of a plan in cells, and what is visible from where.

    Args:
        plan: the map.
        camera: the field of view.
        stands: (N, 2) m, places where a body can be; some of them, evenly spread, are considered for views.
    """

    def __init__(self, plan: Floorplan, camera: Camera, stands: Array) -> None:
        self.cells = _thinned(plan.free_space(0.1).positions(0.1), CELL_M, MAX_CELLS)
        """(C, 2) m: middles of the cells of floor."""
        self.stands = _thinned(stands, STAND_M, MAX_STANDS)
        """(K, 2) m: places to look from."""
        self._caster = Caster(plan)
        self._half = math.atan(camera.width / 2.0 / camera.fx)
        self._sector = self._sectors()

    def seen(self, poses: Array) -> Mask:
        """(C,) which cells are seen from any of these poses (P, 3)."""
        poses = np.asarray(poses, dtype=np.float64).reshape(-1, 3)
        visible, bearing = self._visible(poses[:, :2])
        off = np.abs(wrap_angle(bearing - poses[:, 2:]))
        return np.asarray(np.any(visible & (off <= self._half), axis=0))

    def gains(self, unseen: Mask, headings: Array) -> Array:
        """(K, H) share of all cells that are unseen and would be seen from each stand with each heading (H,)."""
        sector = self._sector[:, unseen]
        count = len(self.stands)
        flat = (sector + (SECTORS + 1) * np.arange(count)[:, None]).ravel()
        found = np.bincount(flat, minlength=count * (SECTORS + 1)).reshape(count, SECTORS + 1)[:, :SECTORS]
        width = 2.0 * math.pi / SECTORS
        middles = (np.arange(SECTORS) + 0.5) * width
        off = np.abs(wrap_angle(middles[:, None] - headings[None]))
        return np.asarray(found @ (off <= self._half)) / len(self.cells)

    def _sectors(self) -> NDArray[np.int64]:
        """(K, C) sector in which each stand sees each cell; ``SECTORS`` where it does not."""
        visible, bearing = self._visible(self.stands)
        sector = np.floor(bearing % (2.0 * math.pi) / (2.0 * math.pi) * SECTORS).astype(np.int64) % SECTORS
        return np.where(visible, sector, SECTORS)

    def _visible(self, places: Array) -> tuple[Mask, Array]:
        """(P, C) whether each place has each cell in line of sight and within reach, and its plan bearing, rad."""
        offset = self.cells[None] - places[:, None]
        gap, bearing = np.hypot(offset[..., 0], offset[..., 1]), np.arctan2(offset[..., 1], offset[..., 0])
        ranges = self._caster(places)
        degree = np.round(np.degrees(bearing)).astype(np.int64) % 360
        return (gap <= REACH_M) & (gap <= np.take_along_axis(ranges, degree, axis=1)), bearing


def _thinned(positions: Array, spacing: float, most: int) -> Array:
    """One position per square of this size (m), or of a larger one where that leaves more than ``most``."""
    while True:
        square = np.floor(positions / spacing).astype(np.int64)
        middle = np.linalg.norm(positions / spacing - square - 0.5, axis=1)
        order = np.lexsort((middle, square[:, 1], square[:, 0]))
        first = np.ones(len(order), bool)
        first[1:] = np.any(np.diff(square[order], axis=0) != 0, axis=1)
        kept = order[first]
        if len(kept) <= most:
            return positions[np.sort(kept)]
        spacing *= 1.2
