"""What a perfect layout network would say of a view, and the same with the errors that real ones make."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.camera import Camera, level_angles, level_directions, levelling
from galoc.checked import number
from galoc.detect.columns import Columns
from galoc.detect.strip import COLUMN_GROUP, STEP_RAD, azimuth_of, column_azimuths, columns_for
from galoc.errors import GalocError
from galoc.floorplan import Floorplan
from galoc.wall_pixels import JOIN_RANGE
from galoc_env.truth import Panel, visible_panels

Array = NDArray[np.float64]

EXACT_RAD = math.radians(0.1)
"""Standard deviation that exact columns state, rad."""
SURE, UNSURE = 0.98, 0.5
"""Probability stated for columns that are right, and for those that are wrong."""
WALL_RAD = math.radians(8.0)
"""Along a wall, one independent error comes per so much azimuth, rad."""
WRONG_RAD = math.radians(8.0)
"""A wrong line is this far off (one standard deviation), rad."""
WRONG_COLUMNS = 6
"""Columns that are wrong together."""
GUESS = 3.0
"""A line that is hidden or outside the image is guessed with so many times the error of a visible one."""
EDGE_SD = 0.8
"""Width of the bump that a wall edge is in the edge columns, columns."""
EDGE_TOP, EDGE_FOOT = 0.9, 0.005
"""Probability at an edge and far from all, as networks state them."""


def true_columns(
    plan: Floorplan,
    camera: Camera,
    pose: ArrayLike,
    camera_height: float,
    gravity: tuple[float, float],
    *,
    measured: tuple[float, float] | None = None,
    noise_rad: float = 0.0,
    hidden: float = 0.0,
    wrong: float = 0.0,
    missed: float = 0.0,
    rng: np.random.Generator | None = None,
) -> Columns:
    """Columns of a view of empty rooms.

    Args:
        plan: walls and ceiling height.
        camera: intrinsics.
        pose: (x, y, heading), m and rad.
        camera_height: above the floor, m.
        gravity: true (roll, pitch), rad.
        measured: what the IMU reads: the columns are level by that, rad; None: the truth.
        noise_rad: standard deviation of the elevations, half of its variance shared along ``WALL_RAD`` of a wall.
        hidden: share of the walls whose floor line furniture hides.
        wrong: share of the columns whose ceiling or floor line is another one.
        missed: share of the wall edges that the edge columns do not show.
        rng: source of the errors; needed for any.

    Raises:
        GalocError: camera not between floor and ceiling, bad noise, noise without rng, or no wall in view.
    """
    errors = {"noise_rad": noise_rad, "hidden": hidden, "wrong": wrong, "missed": missed}
    _check(plan, camera_height, errors, rng)
    columns = columns_for(camera)
    reach = columns * STEP_RAD / 2.0 + math.radians(3.0)
    panels = visible_panels(plan, pose, -reach, reach)
    if not panels:
        raise GalocError(f"no wall in view of {pose!r}", "a pose that sees walls", "Choose another pose.")
    chain = WallChain(panels)
    heights = np.array([plan.ceiling_height - camera_height, -camera_height])
    turn = levelling(gravity if measured is None else measured) @ levelling(gravity).T
    shown = np.ones(len(panels), bool) if rng is None else rng.random(len(panels)) >= missed
    exact = _exact(chain, camera, heights, gravity, turn, columns, shown)
    if rng is None:
        return exact
    wall = chain.index(exact.azimuths)
    return _wrong(_noisy(exact, wall, noise_rad, hidden, rng), wrong, rng)


def _check(plan: Floorplan, camera_height: float, errors: dict[str, float], rng: np.random.Generator | None) -> None:
    for name, value in errors.items():
        number(name, value, 0.0, 1.0, cure="Pass 0 for none.")
    if not 0.0 < camera_height < plan.ceiling_height:
        got = f"camera_height = {camera_height!r} m"
        raise GalocError(got, f"above the floor and below the ceiling ({plan.ceiling_height:g} m)", "Lower it.")
    if rng is None and any(errors.values()):
        raise GalocError("noise without rng", "a numpy Generator as its source", "Pass rng=np.random.default_rng(0).")


class WallChain:
    """Wall panels around a pose, to be asked for the range at any azimuth."""

    def __init__(self, panels: list[Panel]) -> None:
        self.panels = panels
        self._left = np.array([p.azimuth[0] for p in panels])
        self._right = np.array([p.azimuth[1] for p in panels])
        ends = np.array([p.points() for p in panels])
        self._normal = np.stack([ends[:, 1, 1] - ends[:, 0, 1], ends[:, 0, 0] - ends[:, 1, 0]], axis=1)
        self._offset = np.sum(self._normal * ends[:, 0], axis=1)

    def index(self, azimuth: Array) -> NDArray[np.int64]:
        """Panel at azimuths, rad; the nearest one in gaps."""
        k = np.clip(np.searchsorted(self._left, azimuth, "right") - 1, 0, len(self._left) - 1)
        after = np.minimum(k + 1, len(self._left) - 1)
        gap = azimuth - self._right[k]
        return np.where((gap > 0) & (self._left[after] - azimuth < gap), after, k)

    def covers(self, azimuth: Array) -> NDArray[np.bool_]:
        """Whether there is a wall at azimuths, rad, or within two columns of them."""
        k = self.index(azimuth)
        return np.asarray((azimuth > self._left[k] - 2 * STEP_RAD) & (azimuth < self._right[k] + 2 * STEP_RAD))

    def range(self, azimuth: Array) -> Array:
        """Range of the wall at azimuths, m; that of the nearest panel's plane in gaps."""
        k = self.index(azimuth)
        inside = np.clip(azimuth, self._left[k], self._right[k])
        along = self._normal[k, 0] * np.sin(inside) + self._normal[k, 1] * np.cos(inside)
        return np.asarray(self._offset[k] / along)


def wall_lines(chain: WallChain, heights: Array, azimuths: Array, turn: Array) -> tuple[Array, Array, Array]:
    """Ceiling and floor line of the wall in each column of a level frame that is a little off.

    Args:
        chain: the walls in view.
        heights: (2,) m, ceiling above the camera and floor, negative, below it.
        azimuths: (C,) of the columns, rad.
        turn: (3, 3) from the true level frame to the columns'.

    Returns:
        (2, C) true azimuth and true elevation of the line, and its elevation in the columns' frame, rad.
    """
    true_azimuth = np.broadcast_to(azimuths, (2, len(azimuths))).copy()
    true_elevation, elevation = np.zeros_like(true_azimuth), np.zeros_like(true_azimuth)
    for _ in range(4):  # the IMU's error is small: the line of a column is found in a few rounds
        true_elevation = np.arctan2(heights[:, None], chain.range(true_azimuth))
        seen, elevation = level_angles(level_directions(true_azimuth, true_elevation) @ turn.T)
        true_azimuth += azimuths - seen
    return true_azimuth, true_elevation, elevation


def _exact(
    chain: WallChain,
    camera: Camera,
    heights: Array,
    gravity: tuple[float, float],
    turn: Array,
    columns: int,
    shown: NDArray[np.bool_],
) -> Columns:
    azimuths = column_azimuths(columns)
    true_azimuth, true_elevation, elevation = wall_lines(chain, heights, azimuths, turn)
    pixels = camera.project_level(level_directions(true_azimuth, true_elevation), gravity)
    inside = camera.contains(pixels).astype(np.float64)
    return Columns(
        azimuths,
        elevation,
        np.full_like(elevation, EXACT_RAD),
        np.full_like(elevation, SURE),
        inside,
        inside.copy(),
        azimuth_of(np.arange(columns), columns),
        _edges(chain, heights, turn, columns, shown),
    )


def _edges(chain: WallChain, heights: Array, turn: Array, columns: int, shown: NDArray[np.bool_]) -> Array:
    """(2, E) bumps at the corners and occlusions between neighbouring panels, where they are shown."""
    at = np.arange(columns, dtype=np.float64)
    out = np.full((2, columns), EDGE_FOOT)
    for before, after, show in zip(chain.panels[:-1], chain.panels[1:], shown[1:], strict=True):
        azimuth = float(after.azimuth[0])
        if not show or azimuth - before.azimuth[1] > STEP_RAD:
            continue
        near, far = sorted((float(before.range[1]), float(after.range[0])))
        middle = float(np.mean(np.arctan2(heights, near)))
        seen, _ = level_angles(level_directions(azimuth, middle) @ turn.T)
        column = float(seen) / STEP_RAD + columns / 2.0 - 0.5
        kind = 0 if far - near < 5.0 * JOIN_RANGE * near else 1
        bump = EDGE_TOP * np.exp(-0.5 * ((at - column) / EDGE_SD) ** 2)
        out[kind] = np.maximum(out[kind], bump)
    return out


def _noisy(
    exact: Columns, wall: NDArray[np.int64], noise_rad: float, hidden: float, rng: np.random.Generator
) -> Columns:
    """Errors correlated along each wall, larger where the line is not seen."""
    count = len(exact)
    covered = rng.random(int(wall.max()) + 1) < hidden
    visible = exact.visible.copy()
    visible[1, covered[wall]] = 0.0
    keep = math.exp(-2.0 * STEP_RAD * COLUMN_GROUP / WALL_RAD)
    white, fresh = rng.standard_normal((2, 2, count))
    slow = np.empty((2, count))
    for c in range(count):
        stays = c > 0 and wall[c] == wall[c - 1]
        slow[:, c] = keep * slow[:, c - 1] + math.sqrt(1.0 - keep**2) * fresh[:, c] if stays else fresh[:, c]
    sigma = noise_rad * np.where(visible > 0.5, 1.0, GUESS)
    error = sigma * (slow + white) * math.sqrt(0.5)
    return replace(exact, elevation=exact.elevation + error, sigma=np.maximum(sigma, EXACT_RAD), visible=visible)


def _wrong(columns: Columns, share: float, rng: np.random.Generator) -> Columns:
    """Runs of columns whose ceiling or floor line is another one."""
    elevation, sure = columns.elevation.copy(), columns.sure.copy()
    for row in (0, 1):
        for _ in range(round(share * len(columns) / WRONG_COLUMNS)):
            start = int(rng.integers(len(columns) - WRONG_COLUMNS + 1))
            run = slice(start, start + WRONG_COLUMNS)
            elevation[row, run] += WRONG_RAD * rng.standard_normal()
            sure[row, run] = UNSURE
    return replace(columns, elevation=elevation, sure=sure)
