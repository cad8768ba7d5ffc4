"""What the body feels: true camera tilt, the IMU's reading of it, and odometry. Every knob has an exact zero."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc_env import _motion_kernel as kernel

Array = NDArray[np.float64]

_PERIODS = ((12.0, 24.0), (4.0, 9.0))
"""Ranges that the periods of the slow and the fast sway are drawn from, steps."""
DRIFT_RAD_PER_M = kernel.DRIFT_RAD_PER_M
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
        body = np.zeros(kernel.COLUMNS)
        body[16:20], body[20:24], body[25] = self.frequency.ravel(), self.phase.ravel(), step
        kernel.sway(body, float(self.amplitude_rad))
        return float(body[6]), float(body[7])


class NoiseBlocks:
    """The standard normals behind the readings of many bodies, drawn for many steps at once.

    A stream gives the same numbers in whatever portions they are drawn, so a reading does not depend on the size of
    a block, nor on how many bodies there are.
    """

    def __init__(self, bodies: int) -> None:
        self.values = np.zeros((bodies, kernel.BLOCK, 5))
        """(L, BLOCK, 5): two for gravity, three for odometry, by step modulo BLOCK."""
        self._streams: list[tuple[np.random.Generator, np.random.Generator] | None] = [None] * bodies

    def start(self, body: int, imu_rng: np.random.Generator, odometry_rng: np.random.Generator) -> None:
        """Draw the first block of an episode; the noise draws from the streams from now on."""
        self._streams[body] = imu_rng, odometry_rng
        self.refill(body)

    def refill(self, body: int) -> None:
        """Draw the next block."""
        streams = self._streams[body]
        assert streams is not None
        self.values[body, :, :2] = streams[0].standard_normal((kernel.BLOCK, 2))
        self.values[body, :, 2:] = streams[1].standard_normal((kernel.BLOCK, 3))


def measure_gravity(gravity: tuple[float, float], sd_rad: float, rng: np.random.Generator) -> Array:
    """(2,) the IMU's roll and pitch, rad: the true tilt plus white noise, independent from reading to reading.

    Args:
        gravity: true (roll, pitch), rad.
        sd_rad: standard deviation per reading, rad; 0 returns the truth to the bit.
        rng: drawn from the same number of times whatever the noise.
    """
    body, noise = np.zeros(kernel.COLUMNS), np.zeros(5)
    body[6:8], noise[:2] = gravity, rng.standard_normal(2)
    kernel.measure(body, float(sd_rad), 0.0, noise)
    return body[8:10].copy()


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
    body, noise = np.zeros(kernel.COLUMNS), np.zeros(5)
    body[3:6], noise[2:] = odometry, rng.standard_normal(3)
    kernel.measure(body, 0.0, float(fraction), noise)
    return body[10:13].copy()
