"""What is known of the camera's height above the floor and of the ceiling's above the camera."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc.errors import GalocError

UNKNOWN_M = 1.4
"""Median of either height where nothing is known, m."""
UNKNOWN_SD = 0.3
"""Spread of either log height where nothing is known: a factor of 2 is 2.3 standard deviations away."""


@dataclass(frozen=True, slots=True)
class Heights:
    """Log-normal prior of the two heights: ceiling above the camera, camera above the floor.

    The pixels fix the ratio of the two, ``k = log(floor / ceiling)``, and every range in units of their geometric mean;
    the metric scale of that mean comes from this prior alone.
    """

    log_ceiling: float = math.log(UNKNOWN_M)
    """Mean of the log of the ceiling's height above the camera (m)."""
    log_floor: float = math.log(UNKNOWN_M)
    """Mean of the log of the camera's height above the floor (m)."""
    var_ceiling: float = UNKNOWN_SD**2
    """Variance of log_ceiling."""
    var_floor: float = UNKNOWN_SD**2
    """Variance of log_floor."""
    covariance: float = 0.0
    """Covariance of the two."""
    ceiling: tuple[float, float] | None = None
    """Log of the ceiling's height above the floor (m) and its standard deviation, where the map gives it: with the
    fitted ratio it fixes the scale. None: not known, or already in the fields above."""

    @classmethod
    def known(cls, camera_m: float, ceiling_m: float, sd: float = 0.03) -> Heights:
        """Heights that somebody measured.

        Args:
            camera_m: camera above the floor, m.
            ceiling_m: ceiling above the floor, m.
            sd: relative standard deviation of each of these two heights.

        Raises:
            GalocError: camera not between floor and ceiling, or a useless sd.
        """
        values = (camera_m, ceiling_m, sd)
        if not all(isinstance(v, int | float | np.number) and math.isfinite(v) for v in values):
            raise GalocError(f"heights {values!r}", "three finite numbers (m, m, relative sd)", "Fix them.")
        if not 0.0 < camera_m < ceiling_m or not 1e-4 <= sd <= 2.0:
            raise GalocError(
                f"camera at {camera_m} m under a ceiling of {ceiling_m} m, sd {sd}",
                "0 < camera height < ceiling height and a relative sd from 0.0001 to 2",
                "Give both heights above the floor in metres.",
            )
        above = ceiling_m - camera_m
        share = camera_m / above  # errors of both given heights are in the ceiling's height above the camera
        var_above = sd**2 * (share**2 + (ceiling_m / above) ** 2)
        return cls(math.log(above), math.log(camera_m), var_above, sd**2, -(sd**2) * share)

    @classmethod
    def under(cls, ceiling_m: float, sd: float = 0.03) -> Heights:
        """Only the ceiling's height above the floor is known (a map states it); the camera's is not.

        Args:
            ceiling_m: m.
            sd: its relative standard deviation.

        Raises:
            GalocError: not a positive height, or a useless sd.
        """
        if not (math.isfinite(ceiling_m) and ceiling_m > 0.0 and 1e-4 <= sd <= 2.0):
            raise GalocError(f"ceiling of {ceiling_m!r} m, sd {sd!r}", "a height in m and a relative sd", "Fix them.")
        half = math.log(0.5 * ceiling_m)
        return cls(half, half, ceiling=(math.log(ceiling_m), sd))

    @property
    def k(self) -> float:
        """Prior mean of k = log(floor / ceiling)."""
        return self.log_floor - self.log_ceiling

    @property
    def k_sd(self) -> float:
        """Prior standard deviation of k."""
        return math.sqrt(max(self.var_ceiling + self.var_floor - 2.0 * self.covariance, 1e-8))

    def log_scale(self, k: float, k_sd: float) -> tuple[float, float]:
        """Log of the geometric mean height (m) given a fitted k, and its standard deviation.

        Args:
            k: fitted log ratio (with this prior already in it).
            k_sd: its standard deviation after the fit.
        """
        if self.ceiling is not None:  # h_floor = H e^k / (1 + e^k), h_ceiling = H / (1 + e^k)
            share = 1.0 / (1.0 + math.exp(-k))
            mean = self.ceiling[0] + 0.5 * k - math.log1p(math.exp(k))
            return mean, math.hypot(self.ceiling[1], (0.5 - share) * k_sd)
        mean = 0.5 * (self.log_floor + self.log_ceiling)
        variance = 0.25 * (self.var_ceiling + self.var_floor + 2.0 * self.covariance)
        slope = 0.5 * (self.var_floor - self.var_ceiling) / self.k_sd**2
        left = max(variance - slope**2 * self.k_sd**2, 1e-8) + slope**2 * k_sd**2
        return mean + slope * (k - self.k), math.sqrt(left)

    def updated(self, k: float, k_var: float, scale: float, scale_var: float, floor_sd: float) -> Heights:
        """Prior after one more measurement of k and of the log scale (Kalman step).

        Args:
            k: measured log ratio.
            k_var: its variance.
            scale: measured log of the geometric mean height.
            scale_var: its variance.
            floor_sd: neither height is trusted further than this relative sd.
        """
        mean = np.array([self.log_ceiling, self.log_floor])
        cov: NDArray[np.float64] = np.array([[self.var_ceiling, self.covariance], [self.covariance, self.var_floor]])
        to_seen = np.array([[-1.0, 1.0], [0.5, 0.5]])
        gain = cov @ to_seen.T @ np.linalg.inv(to_seen @ cov @ to_seen.T + np.diag([k_var, scale_var]))
        mean = mean + gain @ (np.array([k, scale]) - to_seen @ mean)
        cov = (np.eye(2) - gain @ to_seen) @ cov
        cov += np.diag(np.maximum(floor_sd**2 - np.diag(cov), 0.0))
        return Heights(float(mean[0]), float(mean[1]), float(cov[0, 0]), float(cov[1, 1]), float(cov[0, 1]))
