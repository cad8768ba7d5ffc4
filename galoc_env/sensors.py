"""What the body feels: true camera tilt, the IMU's reading of it, and odometry. Every knob has an exact zero."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_WEIGHTS = np.array([0.6, 0.4])
"""Shares of the slow and the fast sway; they sum to 1, so the tilt never exceeds its amplitude."""
_PERIODS = ((12.0, 24.0), (4.0, 9.0))
"""Ranges that the periods of the slow and the fast sway are drawn from, steps."""
DRIFT_RAD_PER_M = 0.1
"""Cross term of the odometry noise: heading noise per metre travelled, times the noise fraction (rad/m)."""


@dataclass(frozen=True, slots=True, eq=False)
class Tilt:
    """True roll and pitch of the camera over an episode: two sines each, smooth and bounded by the amplitude."""

    amplitude_rad: float
    """Largest |roll| and |pitch|, rad; 0 gives exactly (0, 0)."""
    frequency: Array
    """(2, 2) rad per step of roll and pitch, slow and fast."""
    phase: Array
    """(2, 2) rad."""

    @classmethod
    def random(cls, amplitude_rad: float, rng: np.random.Generator) -> Tilt:
        """Draw the sway of one episode."""
        periods = np.stack([rng.uniform(low, high, size=2) for low, high in _PERIODS], axis=1)
        return cls(amplitude_rad, 2.0 * math.pi / periods, rng.uniform(0.0, 2.0 * math.pi, size=(2, 2)))

    def at(self, step: int) -> tuple[float, float]:
        """True (roll, pitch) at a step, rad."""
        if self.amplitude_rad == 0.0:
            return 0.0, 0.0
        sway = np.sin(self.frequency * step + self.phase) @ _WEIGHTS * self.amplitude_rad
        return float(sway[0]), float(sway[1])


def measure_gravity(gravity: tuple[float, float], sd_rad: float, rng: np.random.Generator) -> Array:
    """(2,) the IMU's roll and pitch, rad: the true tilt plus white noise, independent from reading to reading.

    Args:
        gravity: true (roll, pitch), rad.
        sd_rad: standard deviation per reading, rad; 0 returns the truth to the bit.
        rng: drawn from the same number of times whatever the noise.
    """
    noise = rng.standard_normal(2)
    truth = np.array(gravity, dtype=np.float64)
    return truth if sd_rad == 0.0 else truth + sd_rad * noise


def measure_odometry(odometry: Array, fraction: float, rng: np.random.Generator) -> Array:
    """(3,) measured body-frame motion: the truth plus noise in proportion to the motion.

    Standard deviations: ``fraction * distance`` on dx and on dy; on dheading ``fraction * |dheading|`` and
    ``fraction * 0.1 rad/m * distance`` (a straight step drifts a little), added in quadrature. Standing still is
    measured exactly.

    Args:
        odometry: true (dx m, dy m, dheading rad).
        fraction: noise as a share of the motion; 0 returns the truth to the bit.
        rng: drawn from the same number of times whatever the noise.
    """
    noise = rng.standard_normal(3)
    truth = np.array(odometry, dtype=np.float64)
    if fraction == 0.0:
        return truth
    distance = math.hypot(truth[0], truth[1])
    turn_sd = math.hypot(truth[2], DRIFT_RAD_PER_M * distance)
    return truth + fraction * noise * np.array([distance, distance, turn_sd])
