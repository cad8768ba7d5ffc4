"""ProfileField: what the walls look like from every position of a grid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.cache import DiskCache, content_key
from galoc.errors import GalocError
from galoc.floorplan import Floorplan
from galoc.raycast import cast_profiles, tile_lists

Array = NDArray[np.float64]

CLEARANCE = 0.15
"""A camera is never closer to a wall than this, m."""
MAX_POSITIONS = 60_000
"""The grid of a large plan is coarsened until it holds no more positions than this (22 M poses at 1 degree)."""
TILE = 1.0
"""Side of the tiles that share one front-to-back list, m."""
MAX_LIST = 40_000_000
"""Tiles grow on large plans until their lists hold no more entries than this."""
CASTER_VERSION = 1
"""Counted up whenever the caster gives other ranges, so that none of before are read from the cache."""
KEPT_WORK = 1_000_000
"""Profiles are kept on disk where positions times segments exceed this, about 0.1 s of casting."""


class Caster:
    """Casts profiles at arbitrary positions of one plan; front-to-back lists are built per tile on first use."""

    def __init__(self, plan: Floorplan) -> None:
        self.plan = plan
        """The plan whose walls are cast."""
        self._segments = plan.segments
        x0, y0, x1, y1 = plan.bounds
        tiles = math.ceil((x1 - x0) / TILE + 2) * math.ceil((y1 - y0) / TILE + 2)
        self._side = TILE * max(1.0, math.sqrt(tiles * len(self._segments) / MAX_LIST))
        self._origin = np.array([x0 - self._side, y0 - self._side])

    def __call__(self, positions: ArrayLike) -> NDArray[np.float32]:
        """(P, 360) float32 ranges in metres from positions (P, 2)."""
        xy = np.ascontiguousarray(positions, dtype=np.float64).reshape(-1, 2)
        cell = np.floor((xy - self._origin) / self._side).astype(np.int64)
        used, tile = np.unique(cell, axis=0, return_inverse=True)
        centres = self._origin + (used + 0.5) * self._side
        half = self._side / math.sqrt(2.0)
        out = np.empty((len(xy), 360), np.float32)
        tile = tile.reshape(-1)
        # Lists of all tiles at once would not fit for a campus, so work through them in blocks.
        block = max(1, MAX_LIST // (4 * len(self._segments)))
        for start in range(0, len(used), block):
            mine = np.flatnonzero((tile >= start) & (tile < start + block))
            order, distance = tile_lists(centres[start : start + block], half, self._segments)
            out[mine] = cast_profiles(xy[mine], tile[mine] - start, order, distance, self._segments)
        return out


@dataclass(frozen=True, slots=True, eq=False)
class ProfileField:
    """Range profiles on a position grid of one plan."""

    positions: Array
    """(P, 2) m: cell centres."""
    ranges: NDArray[np.float32]
    """(P, 360) m: distance to the first wall along each whole degree of plan bearing."""
    resolution: float
    """Grid step, m."""
    origin: Array
    """(2,) m: lower left corner of cell (0, 0)."""
    cell: NDArray[np.int64]
    """(P, 2): row and column of each position."""
    index: NDArray[np.int32]
    """(H, W): position of each cell, -1 where there is none."""
    caster: Caster
    """Casts profiles between the grid positions."""

    def nearest(self, xy: ArrayLike) -> int:
        """Index of the grid position closest to (x, y)."""
        return int(np.argmin(np.sum((self.positions - np.asarray(xy, dtype=np.float64)) ** 2, axis=1)))


@lru_cache(maxsize=4)
def profile_field(plan: Floorplan, resolution: float = 0.1) -> ProfileField:
    """Profiles of every free position; cached per plan object.

    Args:
        plan: the map.
        resolution: grid step, m; coarsened in steps of 25 % where the plan would hold more than ``MAX_POSITIONS``.

    Raises:
        GalocError: bad resolution, or a plan in which no position has the clearance of a camera.
    """
    if not math.isfinite(resolution) or not 0.01 <= resolution <= 2.0:
        raise GalocError(f"grid resolution {resolution!r} m", "a step between 0.01 and 2 m", "Use 0.1.")
    while True:
        free = plan.free_space(resolution)
        positions = free.positions(CLEARANCE)
        if len(positions) <= MAX_POSITIONS:
            break
        resolution = round(max(resolution * 1.25, free.resolution), 4)
    if len(positions) == 0:
        raise GalocError(
            f"plan {plan.name!r} without free space",
            f"walls that enclose room for a camera ({CLEARANCE} m of clearance)",
            "Check the scale and that the walls close; draw the plan with `galoc plan FILE`.",
        )
    cell = free.index(positions)
    index = np.full(free.clearance.shape, -1, np.int32)
    index[cell[:, 0], cell[:, 1]] = np.arange(len(positions), dtype=np.int32)
    caster = Caster(plan)
    ranges = _ranges(caster, positions, free.resolution, free.origin)
    return ProfileField(positions, ranges, free.resolution, free.origin, cell, index, caster)


def _ranges(caster: Caster, positions: Array, resolution: float, origin: Array) -> NDArray[np.float32]:
    """Profiles of the grid, cast or read from the cache on disk."""
    segments = caster.plan.segments
    if len(positions) * len(segments) <= KEPT_WORK:
        return caster(positions)
    key = content_key("ranges", CASTER_VERSION, segments, resolution, origin, CLEARANCE, positions)
    name = caster.plan.name or "a plan without name"
    note = f"profiles of {name}, {resolution:g} m"
    # Writable in memory only: numba would compile every kernel again for read-only arrays.
    return DiskCache().fetch(key, lambda: {"ranges": caster(positions)}, note, writable=True)["ranges"]
