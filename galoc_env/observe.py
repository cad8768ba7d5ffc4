"""A localizer as observation processor: its belief on a fixed canvas, its estimate as four numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc import Camera, Estimate, Floorplan, GalocError, Wireframe
from galoc.heights import Heights
from galoc_env import plugin
from galoc_env.motion import STEP_M, TURN_RAD
from galoc_env.sensors import DRIFT_RAD_PER_M

if TYPE_CHECKING:
    from galoc_env.settings import Settings

Array = NDArray[np.float64]

LEAST_IMU_DEG = 0.1
"""No gravity reading is trusted further than this, degrees."""
CANVAS_CELLS = 64
"""Cells on a side of the belief canvas."""


class SequenceLocalizer(Protocol):
    """What the environment needs of a localizer; a ``belief`` attribute is optional."""

    def reset(self) -> None:
        """Forget everything."""

    def step(self, observation: Wireframe, *, gravity: ArrayLike, odometry: ArrayLike) -> Estimate:
        """Take one observation with measured (roll, pitch) and measured motion since the last one."""


def make_localizer(settings: Settings, plan: Floorplan, camera: Camera) -> SequenceLocalizer | None:
    """Build the localizer named by the environment's ``localizer`` argument.

    galoc's own is told how good the sensors are, as their data sheets would; a "module:Class" is called as
    ``Class(plan, camera)``.

    Args:
        settings: of the environment: localizer, geometry, scoring and the sensors' noise.
        plan: the map.
        camera: intrinsics.

    Raises:
        GalocError: no such module or class, or the class lacks ``reset`` or ``step``.
    """
    name = settings.localizer
    if name == "none":
        return None
    if name == "galoc":
        from galoc.localizer import Localizer, LocalizerConfig

        turn_sd = settings.odometry_noise * math.hypot(TURN_RAD, DRIFT_RAD_PER_M * STEP_M)
        config = LocalizerConfig(
            imu_sigma_deg=max(settings.imu_noise_deg, LEAST_IMU_DEG),
            odometry_noise=settings.odometry_noise,
            odometry_turn_deg=math.degrees(turn_sd),
        )
        return Localizer(plan, camera, geometry=settings.geometry, scoring=settings.scoring, config=config)
    expected = '"galoc", "none" or "module:Class"'
    try:
        found, _ = plugin.load(name)
    except plugin.LOADING as error:
        cure = "Use one of the names, or point to a class you can import."
        raise GalocError(f"localizer = {name!r} ({error})", expected, cure) from error
    localizer = found(plan, camera)
    missing = [method for method in ("reset", "step") if not callable(getattr(localizer, method, None))]
    if missing:
        raise GalocError(f"localizer {name!r} without {missing}", "methods reset and step", "Add them to the class.")
    return localizer


@dataclass(frozen=True, slots=True, eq=False)
class Canvas:
    """A fixed square raster over a plan: equal scale in x and y, plan centred, row 0 at the top (largest y)."""

    origin: Array
    """(2,) m: lower left corner of the canvas."""
    cell_m: float
    """Cell size, m."""
    free: NDArray[np.float32]
    """(64, 64) share of each cell that is inside the building, 0..1."""

    @classmethod
    def of(cls, plan: Floorplan) -> Canvas:
        """The canvas that covers the plan's bounding box."""
        x0, y0, x1, y1 = plan.bounds
        cell_m = max(x1 - x0, y1 - y0) / CANVAS_CELLS
        origin = np.array([x0 + x1, y0 + y1]) / 2.0 - cell_m * CANVAS_CELLS / 2.0
        grid = plan.free_space()
        rows = _overlap(origin[1], cell_m, float(grid.origin[1]), grid.resolution, grid.inside.shape[0])
        cols = _overlap(origin[0], cell_m, float(grid.origin[0]), grid.resolution, grid.inside.shape[1])
        share = rows @ grid.inside.astype(np.float32) @ cols.T
        return cls(origin, cell_m, np.ascontiguousarray(np.clip(share[::-1], 0.0, 1.0)))

    def centres(self) -> Array:
        """(4096, 2) m: cell centres, row by row from the top."""
        along = (np.arange(CANVAS_CELLS) + 0.5) * self.cell_m
        x, y = np.meshgrid(self.origin[0] + along, self.origin[1] + along[::-1])
        return np.stack([x.ravel(), y.ravel()], axis=1)


def _overlap(start: float, size: float, grid_start: float, grid_size: float, count: int) -> NDArray[np.float32]:
    """(64, count) share of each canvas interval that each grid interval covers: exact area averaging, per axis."""
    low = start + size * np.arange(CANVAS_CELLS)[:, None]
    grid_low = grid_start + grid_size * np.arange(count)[None, :]
    common = np.minimum(low + size, grid_low + grid_size) - np.maximum(low, grid_low)
    return (np.maximum(common, 0.0) / size).astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Turns values at a belief's positions into a canvas: mean per cell, nearest position where a cell holds none."""

    cell: NDArray[np.int64]
    """(P,) flat canvas cell of each position."""
    count: NDArray[np.int64]
    """(4096,) positions per cell."""
    gaps: NDArray[np.int64]
    """(G,) cells without a position but next to one."""
    nearest: NDArray[np.int64]
    """(G,) the position that fills each gap."""

    @classmethod
    def of(cls, canvas: Canvas, positions: Array, resolution: float) -> Spread:
        """Prepare for positions (P, 2) m on a grid of that resolution (m)."""
        from scipy.spatial import cKDTree

        col, up = np.clip(np.floor((positions - canvas.origin) / canvas.cell_m), 0, CANVAS_CELLS - 1).astype(np.int64).T
        cell = (CANVAS_CELLS - 1 - up) * CANVAS_CELLS + col
        count = np.bincount(cell, minlength=CANVAS_CELLS**2)
        distance, nearest = cKDTree(positions).query(canvas.centres())
        gaps = np.flatnonzero((count == 0) & (distance <= 0.75 * resolution))
        return cls(cell, count, gaps, np.asarray(nearest)[gaps])

    def paint(self, values: Array) -> NDArray[np.float32]:
        """(64, 64) canvas of values (P,), scaled so that the largest cell is 1 (all zero stays zero)."""
        total = np.bincount(self.cell, weights=values, minlength=CANVAS_CELLS**2)
        mean = total / np.maximum(self.count, 1)
        mean[self.gaps] = values[self.nearest]
        top = mean.max()
        scaled = mean / top if top > 0.0 else mean
        return scaled.reshape(CANVAS_CELLS, CANVAS_CELLS).astype(np.float32)


class Observer:
    """A localizer together with the canvas its belief is painted on."""

    def __init__(self, localizer: SequenceLocalizer, plan: Floorplan) -> None:
        self.localizer = localizer
        self.canvas = Canvas.of(plan)
        self._spread: Spread | None = None
        self._positions: Array | None = None

    @property
    def belief(self) -> Any:
        """The localizer's belief, None where it has none."""
        return getattr(self.localizer, "belief", None)

    @property
    def heights(self) -> Heights | None:
        """What the localizer knows of the heights by now, None where it does not say."""
        known = getattr(self.localizer, "heights", None)
        return known if isinstance(known, Heights) else None

    def reset(self) -> None:
        """Clear the belief."""
        self.localizer.reset()

    def step(self, wireframe: Wireframe, gravity: Array, odometry: Array) -> Estimate:
        """Run the localizer on one observation."""
        return self.localizer.step(wireframe, gravity=gravity, odometry=odometry)

    def belief_observation(self) -> NDArray[np.float32]:
        """(2, 64, 64) float32: position marginal scaled to maximum 1 (zero without a belief), and free space."""
        belief = self.belief
        if belief is None:
            return np.stack([np.zeros_like(self.canvas.free), self.canvas.free])
        if self._spread is None or self._positions is not belief.positions:
            self._positions = belief.positions
            self._spread = Spread.of(self.canvas, np.asarray(belief.positions), float(belief.resolution))
        return np.stack([self._spread.paint(np.asarray(belief.position_marginal())), self.canvas.free])


def estimate_observation(estimate: Estimate, bounds: tuple[NDArray, NDArray]) -> NDArray[np.float32]:
    """(4,) float32: x m, y m, heading rad, confidence, within the bounds; all zero when there is nothing to report."""
    if not np.all(np.isfinite(estimate.pose)):
        return np.zeros(4, np.float32)
    return np.clip(np.array([*estimate.pose, estimate.confidence], dtype=np.float32), *bounds)
