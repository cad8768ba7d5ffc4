"""Monte Carlo localization: the comparator of the histogram filter, with the same likelihood.

Textbook bootstrap filter: uniform start over the free space, odometry noise sampled per particle, weights from the
frame at the nearest grid position and whole degree, systematic resampling. Temper and jitter are tuned for it (24 walks
in ``apartment``), so that the comparison is fair. No particles are injected and their number does not adapt: a cloud
that has settled in a wrong room stays there.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.belief import checked_odometry
from galoc.checked import number, whole
from galoc.errors import GalocError
from galoc.likelihood import Likelihood
from galoc.metrics import wrap_angle
from galoc.observation import Observation

Array = NDArray[np.float64]

TEMPER, FRAME_FLOOR = 0.2, -12.0
"""Weight of a frame's log-likelihood, and how much it can rule a pose out before that, nats. The histogram filter takes
0.9: particles are too far apart for so sharp a likelihood, and half of the walks then settle in the wrong place."""
CLUSTER_M, CLUSTER_RAD = 0.5, 0.35
"""Particles within this of each other are one cluster."""
STILL_M, STILL_RAD = 0.04, math.radians(2.0)
"""Spread that each step adds to the odometry's noise: keeps copies of one particle apart (tuned with TEMPER)."""
OUTSIDE = 1e-12
"""Weight of a particle that has left the free space, against one that has not."""


class ParticleFilter:
    """Weighted poses.

    Args:
        likelihood: scores frames for :meth:`update`.
        count: particles.
        rng: of all draws.
        odometry_noise: standard deviation of a motion as a share of its length.
        odometry_turn_rad: standard deviation of the heading change of a step that moves, rad.

    Raises:
        GalocError: less than one particle, noise below 0.
    """

    def __init__(
        self,
        likelihood: Likelihood,
        count: int = 5000,
        *,
        rng: np.random.Generator,
        odometry_noise: float = 0.02,
        odometry_turn_rad: float = math.radians(0.5),
    ) -> None:
        if not isinstance(rng, np.random.Generator):
            raise GalocError(f"rng = {rng!r}", "a numpy Generator", "Use numpy.random.default_rng(seed).")
        self.likelihood, self.field = likelihood, likelihood.field
        self.count, self._rng = whole("count", count, 1, "Use 5000."), rng
        self._noise = number("odometry_noise", odometry_noise, 0.0, 1e6)
        self._turn = number("odometry_turn_rad", odometry_turn_rad, 0.0, 1e6, "rad")
        self.reset()

    def reset(self) -> None:
        """Draw the particles anew, uniformly over the free space."""
        rng, field = self._rng, self.field
        cells = field.positions[rng.integers(len(field.positions), size=self.count)]
        xy = cells + field.resolution * rng.uniform(-0.5, 0.5, cells.shape)
        self.poses = np.column_stack([xy, rng.uniform(-math.pi, math.pi, self.count)])
        """(C, 3) x, y (m), heading (rad)."""
        self.weights = np.full(self.count, 1.0 / self.count)
        """(C,) summing to 1."""

    def predict(self, odometry: ArrayLike) -> None:
        """Move every particle by odometry (dx forward, dy left, dheading), m and rad, and its own draw of the noise.

        Raises:
            GalocError: not three finite numbers.
        """
        step = checked_odometry(odometry)
        along = self._noise * math.hypot(step[0], step[1]) + STILL_M
        turn = STILL_RAD + (self._turn if np.any(step != 0.0) else 0.0)
        dx, dy, turned = step[:, None] + self._rng.standard_normal((3, self.count)) * [[along], [along], [turn]]
        c, s = np.cos(self.poses[:, 2]), np.sin(self.poses[:, 2])
        self.poses[:, 0] += c * dx - s * dy
        self.poses[:, 1] += s * dx + c * dy
        self.poses[:, 2] = wrap_angle(self.poses[:, 2] + turned)
        self._weigh(np.where(self.rows() < 0, math.log(OUTSIDE), 0.0))

    def rows(self) -> NDArray[np.int64]:
        """(C,) grid position of the cell that each particle is in, -1 outside the free space."""
        field = self.field
        cells = np.floor((self.poses[:, :2] - field.origin) / field.resolution)
        column, row = np.clip(cells, -1.0, 1e9).astype(np.int64).T
        height, width = field.index.shape
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        return np.where(inside, field.index[np.where(inside, row, 0), np.where(inside, column, 0)], -1).astype(np.int64)

    def update(self, seen: Observation) -> None:
        """Weigh by a frame's likelihood, then resample if the effective number of particles is below half."""
        rows = self.rows()
        inside = rows >= 0
        if not seen.blind and inside.any():
            # Scored at all headings of the positions that hold particles, which soon are few.
            used, at = np.unique(rows[inside], return_inverse=True)
            volume = self.likelihood.volume(seen, rows=used)
            degree = np.round(np.degrees(self.poses[inside, 2])).astype(np.int64) % 360
            score = np.full(self.count, FRAME_FLOOR)
            own = volume[at, degree].astype(np.float64)
            score[inside] = np.maximum(own - own.max(), FRAME_FLOOR)
            self._weigh(TEMPER * score)
        if self.effective < 0.5 * self.count:
            self.resample()

    def _weigh(self, log_factor: Array) -> None:
        log_weight = np.log(np.maximum(self.weights, 1e-300)) + log_factor
        weight = np.exp(log_weight - log_weight.max())
        self.weights = weight / weight.sum()

    @property
    def effective(self) -> float:
        """Effective number of particles, 1 / sum of squared weights."""
        return float(1.0 / np.sum(self.weights**2))

    def resample(self) -> None:
        """Systematic resampling: a particle of weight w survives floor or ceil of C w times, C w in the mean."""
        self.poses = self.poses[systematic(self.weights, self._rng)]
        self.weights = np.full(self.count, 1.0 / self.count)

    def estimate(self) -> tuple[Array, float]:
        """Mean pose (3,) of the heaviest cluster, and the weight in it.

        Starts from the heaviest cell of ``CLUSTER_M`` and ``CLUSTER_RAD``, then twice takes the mean within that reach.
        """
        cell = np.floor(self.poses / (CLUSTER_M, CLUSTER_M, CLUSTER_RAD)).astype(np.int64)
        cell -= cell.min(axis=0)
        _, cluster = np.unique(cell @ (1 << np.array([40, 20, 0])), return_inverse=True)
        near = cluster == int(np.argmax(np.bincount(cluster, self.weights)))
        for _ in range(2):
            near = self._near(self._mean(near))
        return self._mean(near), float(self.weights[near].sum())

    def _near(self, pose: Array) -> NDArray[np.bool_]:
        close = np.hypot(*(self.poses[:, :2] - pose[:2]).T) < CLUSTER_M
        near: NDArray[np.bool_] = close & (np.abs(wrap_angle(self.poses[:, 2] - pose[2])) < CLUSTER_RAD)
        return near

    def _mean(self, which: NDArray[np.bool_]) -> Array:
        weight = self.weights[which] / self.weights[which].sum()
        x, y = weight @ self.poses[which, :2]
        c, s = weight @ np.cos(self.poses[which, 2]), weight @ np.sin(self.poses[which, 2])
        return np.array([x, y, math.atan2(s, c)])


def systematic(weights: Array, rng: np.random.Generator) -> NDArray[np.intp]:
    """(C,) indices drawn in proportion to the weights (C,), evenly spaced with one random offset."""
    count = len(weights)
    ticks = (np.arange(count) + rng.uniform()) / count
    edges = np.cumsum(weights)
    edges[-1] = 1.0
    return np.searchsorted(edges, ticks, side="right").clip(max=count - 1)
