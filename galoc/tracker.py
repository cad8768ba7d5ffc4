"""A Gaussian on the belief's leading pose: carries it between cells, and learns the heights it is seen from.

The histogram says which room; registration of each frame from the predicted pose says where in it, to the centimetre.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from galoc.heights import Heights
from galoc.likelihood import Likelihood, Observation
from galoc.metrics import wrap_angle
from galoc.types import Layout

Array = NDArray[np.float64]

START_SD = np.array([0.15, 0.15, math.radians(4.0)])
"""Spread of a pose taken from the belief's peak (m, m, rad)."""
FRAME_WEIGHT = 0.7
"""Share of a frame's information that is taken: errors of neighbouring frames are not independent."""
STILL_SD = np.array([0.003, 0.003, math.radians(0.1)])
"""Least uncertainty that a step adds (m, m, rad)."""
HEIGHTS_WEIGHT = 0.5
"""The same share for the heights, which every frame of a run shares."""
HEIGHTS_FLOOR = 0.01
"""Heights learned on the way are never trusted further than this."""


class Tracker:
    """Mean and covariance of (x, y, heading) along a run, and the heights learned.

    Args:
        likelihood: of the plan.
        heights: what is known of the heights at the start.
        odometry_noise: standard deviation of a motion as a share of its length.
        odometry_turn_rad: standard deviation of the heading change of a step that moves, rad.
    """

    def __init__(
        self, likelihood: Likelihood, heights: Heights, odometry_noise: float, odometry_turn_rad: float
    ) -> None:
        self._likelihood = likelihood
        self._given = heights
        self._noise, self._turn = odometry_noise, odometry_turn_rad
        self.reset()

    def reset(self) -> None:
        """Forget the run."""
        self.mean: Array | None = None
        """(3,) pose, or None while there is none to follow."""
        self.covariance = np.diag(START_SD**2)
        """(3, 3) of the pose."""
        self.heights = self._given
        """What is known of the heights by now."""
        self._likelihood.forget_corners()
        self._explained = (0, 0)  # of the last frame: corners explained by the map, corners seen

    def predict(self, odometry: Array) -> None:
        """Move by odometry (dx, dy, dheading), with its noise."""
        if self.mean is None:
            return
        x, y, heading = self.mean
        c, s = math.cos(heading), math.sin(heading)
        dx, dy = c * odometry[0] - s * odometry[1], s * odometry[0] + c * odometry[1]
        self.mean = np.array([x + dx, y + dy, float(wrap_angle(heading + odometry[2]))])
        jacobian = np.eye(3)
        jacobian[0, 2], jacobian[1, 2] = -dy, dx
        moved = self._noise * math.hypot(dx, dy)
        turned = self._turn if np.any(odometry != 0.0) else 0.0
        own = np.square(np.array([moved, moved, turned])) + np.square(STILL_SD)
        self.covariance = jacobian @ self.covariance @ jacobian.T + np.diag(own)

    def start(self, pose: Array) -> None:
        """Follow another pose, known to about a cell."""
        self.mean, self.covariance = np.array(pose, dtype=np.float64), np.diag(START_SD**2)

    def update(self, seen: Observation) -> tuple[float, float] | None:
        """Register a frame from the predicted pose.

        Returns:
            The log scale (relative to the observation's) that this frame alone measures, and its variance; None where
            it could not be registered.
        """
        if self.mean is None or len(seen.nodes) == 0:
            return None
        information = np.linalg.inv(self.covariance)
        slack = max(0.3, min(2.0, math.sqrt(float(self.covariance[0, 0] + self.covariance[1, 1])) / 0.1))
        modes = self._likelihood.register(self.mean[None], seen, prior_precision=information, slack=slack)
        if len(modes) == 0 or modes.matched[0, 1] > max(1, len(seen.nodes) // 3):
            return None
        self._explained = (int(modes.matched[0, 0]), int(seen.is_corner.sum()))
        moved = modes.poses[0, :3] - self.mean
        moved[2] = float(wrap_angle(moved[2]))
        if moved @ information @ moved > 25.0:  # five standard deviations: it slipped to another corner
            return None
        fitted = np.linalg.inv(modes.covariances[0, :3, :3])
        kept = information + FRAME_WEIGHT * (fitted - information)
        kept = 0.5 * (kept + kept.T)
        value, vector = np.linalg.eigh(kept)
        self.covariance = (vector / np.maximum(value, 1e-6)) @ vector.T
        self.mean = modes.poses[0, :3].copy()
        prior = seen.scale_precision
        own = 1.0 / float(modes.covariances[0, 3, 3]) - prior
        if own <= 0.0:
            return None
        return float(modes.poses[0, 3]) * (own + prior) / own, 1.0 / own

    def learn(self, layout: Layout, scale: tuple[float, float]) -> None:
        """Take a sure frame's height ratio and metric scale into what is known of the heights, and count its corners.

        Args:
            layout: of the frame, solved with the present :attr:`heights`.
            scale: from :meth:`update`.
        """
        self._likelihood.learn_corners(*self._explained)
        k, k_sd = layout.log_ratio
        own = 1.0 / k_sd**2 - 1.0 / self.heights.k_sd**2
        if own <= 0.0:
            return
        k_own = (k / k_sd**2 - self.heights.k / self.heights.k_sd**2) / own
        log_scale = 0.5 * math.log(float(layout.heights.prod())) + scale[0]
        self.heights = self.heights.updated(
            k_own, 1.0 / (own * HEIGHTS_WEIGHT), log_scale, scale[1] / HEIGHTS_WEIGHT, HEIGHTS_FLOOR
        )

    def forget_heights(self) -> None:
        """Back to what was given: the fix that taught them was wrong."""
        self.heights = self._given
