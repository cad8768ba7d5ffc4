"""Columns on the level plane: heights of wall lines over depth, what they are worth, and the ratio they all share."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.camera import Camera
from galoc.detect.columns import Columns
from galoc.detect.ends import LEAST_Y
from galoc.detect.frame import frame_borders

Array = NDArray[np.float64]

LEAST_SIGMA = math.radians(0.1)
"""No column is better than this, rad."""
HIDDEN_SIGMA = math.radians(1.5)
"""Added to the deviation of a line that is not seen: what is said of it was inferred from the other one, rad."""
OUTSIDE_SIGMA = math.radians(6.0)
"""Added to the deviation of a line beyond the image, a guess pulled towards what can be seen (times the square of the
probability that it is), rad."""
BOUND_SIGMA = math.radians(1.0)
"""How sharply a line said to be beyond the image must be beyond it, rad."""
MOST_SURE = 0.98
"""No column is believed more than this, nor less than one minus this."""
WIDE = math.sqrt(2.0 * math.pi)
"""Density of a wrong line is 1 per rad: with this, the odds at z = 0 are odds times WIDE times sigma."""
ERROR_RAD = math.radians(8.0)
"""Along a wall, one independent error comes per so much azimuth: neighbouring columns err together, rad."""
TILT_SD = math.radians(1.0)
"""How far off the measured gravity may be, rad."""
RATIO_ROUNDS = 4
"""Rounds of reweighting of the common ratio."""


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """C columns on the level plane (depth 1); rows of pairs: ceiling, floor."""

    m: Array
    """(C,) abscissa: tangent of the azimuth."""
    y: Array
    """(2, C) height of the line above (below) the horizon, over depth."""
    sd: Array
    """(2, C) its standard deviation."""
    odds: Array
    """(2, C) odds that the line is elsewhere, times the ratio of the densities at no residual."""
    bound: Array
    """(2, C) y that the line is at least at, being beyond the image; NaN where it is measured."""
    bound_sd: Array
    """(2, C) standard deviation with which the bound holds."""
    border: Array
    """(2, C) y at which a column's vertical leaves the image; inf where the column is beside it."""
    bend: Array
    """(C,) what an error of the measured gravity adds to y of the ceiling and takes from y of the floor."""
    heights: Array
    """(2,) ceiling above and floor below the camera; their geometric mean is 1."""

    @property
    def keep(self) -> float:
        """Correlation of the errors of neighbouring columns."""
        step = float(np.arctan(self.m[-1]) - np.arctan(self.m[0])) / max(len(self.m) - 1, 1)
        return math.exp(-2.0 * step / ERROR_RAD)

    def depths(self) -> tuple[Array, Array, Array, Array]:
        """Inverse depth of both rows, freed of the gravity's error, its deviation, its bound and the deviation of that.

        All (2, C).
        """
        bend = np.stack([-self.bend, self.bend])
        parts = (self.y + bend, self.sd, self.bound + bend, self.bound_sd)
        depth, sd, bound, bound_sd = (part / self.heights[:, None] for part in parts)
        return depth, sd, bound, bound_sd


def evidence_of(columns: Columns, camera: Camera, gravity: ArrayLike, log_ratio: tuple[float, float]) -> Evidence:
    """Bring columns to the level plane.

    Args:
        columns: what the network says.
        camera: intrinsics of the image.
        gravity: (roll, pitch) that levelled the columns, rad.
        log_ratio: mean and standard deviation of log(floor / ceiling height) known beforehand.
    """
    m = np.tan(columns.azimuths)
    root = np.sqrt(1.0 + m * m)
    slope = np.tan(columns.elevation) * np.array([[1.0], [-1.0]])
    border = frame_borders(m, camera, gravity)
    least = np.where(np.isfinite(border), border, LEAST_Y)  # beside the image: a bound that says nothing
    beyond = columns.in_frame < 0.5
    y = np.maximum(slope * root, np.where(beyond, least, LEAST_Y))
    sigma = np.hypot(np.maximum(columns.sigma, LEAST_SIGMA), HIDDEN_SIGMA * (1.0 - columns.visible))
    sigma = np.hypot(sigma, OUTSIDE_SIGMA * (1.0 - columns.in_frame) ** 2)
    sure = np.clip(np.where(beyond, 1.0 - columns.in_frame, columns.sure), 1.0 - MOST_SURE, MOST_SURE)
    per_rad = root * (1.0 + (y / root) ** 2)
    odds = (1.0 - sure) / sure * WIDE * np.where(beyond, BOUND_SIGMA, sigma)
    ratio, bend = _common(m, y, sigma * per_rad, np.where(beyond, 1e3, odds), log_ratio)
    half = math.exp(0.5 * ratio)
    bound, bound_sd = np.where(beyond, least, np.nan), BOUND_SIGMA * per_rad
    return Evidence(m, y, sigma * per_rad, odds, bound, bound_sd, border, bend, np.array([1.0 / half, half]))


def _common(m: Array, y: Array, sd: Array, odds: Array, log_ratio: tuple[float, float]) -> tuple[float, Array]:
    """Robust log height ratio and (C,) bend, from the columns that give both lines.

    The two lines of a column at inverse depth s are y = h_c s + t and h_f s - t, where t = p + r m is what errors of
    pitch and roll add. With q = h_f / h_c this is ``y_f - q y_c + (1 + q) t = 0``: linear in q and (1 + q)(p, r).
    """
    q0 = math.exp(log_ratio[0])
    prior = np.array([q0, 0.0, 0.0])
    spread = np.array([q0 * log_ratio[1], (1.0 + q0) * TILT_SD, (1.0 + q0) * TILT_SD])
    step = float(np.arctan(m[-1]) - np.arctan(m[0])) / max(len(m) - 1, 1)
    temper = max(ERROR_RAD / max(step, 1e-6), 1.0)
    both = 1.0 / (1.0 + odds[0]) / (1.0 + odds[1])
    rows = np.stack([y[0], -np.ones_like(m), -m])
    # The first guess is a median: neither rows of wrong columns nor tilt move it far.
    weight = both / ((sd / y) ** 2).sum(axis=0)
    order = np.argsort(y[1] / y[0])
    run = np.cumsum(weight[order])
    middle = float((y[1] / y[0])[order[np.searchsorted(run, 0.5 * run[-1])]])
    trust = 1.0 / (1.0 + temper / max(float(weight.sum()), 1e-12) / log_ratio[1] ** 2)
    found = np.array([math.exp(trust * math.log(middle) + (1.0 - trust) * log_ratio[0]), 0.0, 0.0])
    wide = 3.0
    for _ in range(RATIO_ROUNDS):
        variance = sd[1] ** 2 + found[0] ** 2 * sd[0] ** 2
        residual = y[1] - found @ rows
        slack = variance * wide**2 + ((1.0 + found[0]) * TILT_SD) ** 2 * (wide > 1.0)
        weight = both / (1.0 + residual**2 / slack) ** 2 / (variance * temper)
        normal = (rows * weight) @ rows.T + np.diag(spread**-2.0)
        right = (rows * weight) @ y[1] + prior / spread**2
        found = np.linalg.solve(normal, right)
        found[0] = min(max(found[0], 0.05), 20.0)
        wide = max(1.5, wide / 1.5)
    return math.log(found[0]), (found[1] + found[2] * m) / (1.0 + found[0])
