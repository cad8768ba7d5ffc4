"""What lights a scene: lamps and the sun, and the simple light of renderers that have none of their own."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Lamp:
    """A small bright sphere that lights its surroundings.

    At distance d m its light on a surface that faces it is power / (d^2 + 0.3^2): so near it does not grow without
    end. Upwards it sends less, straight up 80 percent less, as shades do; otherwise ceilings would be burnt white.
    """

    x: float
    """Centre, m."""
    y: float
    """Centre, m."""
    z: float
    """Centre, m."""
    power: tuple[float, float, float]
    """Red, green, blue: 1 lights a surface that faces the lamp from 1 m about to its full brightness."""
    radius: float = 0.15
    """Makes shadows soft, m."""


@dataclass(frozen=True, slots=True)
class Sun:
    """Parallel light that enters where a ray meets a face of class OUTSIDE."""

    bearing: float
    """Plan bearing of the direction to the sun, rad."""
    elevation: float
    """Above the horizon, rad."""
    power: tuple[float, float, float]
    """Red, green, blue of the light on a surface that faces the sun."""


EDGE = 0.5
"""Width of the dark gradient along the edges of a room, m."""
_SUN = math.radians(35.0)


@dataclass(frozen=True, slots=True)
class Lighting:
    """How bright a surface is: by its direction, and darker towards the edges of its room."""

    azimuth: float
    """Plan bearing that the brightest walls face, rad."""
    contrast: float = 0.17
    """Relative difference between the brightest and the darkest wall, halved."""

    def wall(self, normal_xy: ArrayLike) -> float:
        """Brightness of a vertical surface by the direction it faces.

        The second harmonic keeps opposite walls, and those at right angles, all different.
        """
        nx, ny = np.asarray(normal_xy, np.float64)
        angle = math.atan2(ny, nx) - self.azimuth
        return 0.80 + self.contrast * (0.7 * math.cos(angle) + 0.3 * math.cos(2 * angle - _SUN))

    def facing(self, normal: ArrayLike) -> float:
        """Brightness of any flat surface by its unit normal (3,)."""
        n = np.asarray(normal, np.float64)
        if n[2] > 0.7:
            return 0.92
        if n[2] < -0.7:
            return 0.62
        return self.wall(n[:2])


def height_gradient(z: ArrayLike, ceiling_height: float) -> Array:
    """Factor (...) for a point of a wall at height z (m): darker in the corners with floor and ceiling."""
    height = np.clip(np.asarray(z, np.float64), 0.0, ceiling_height)
    low = np.clip(height / EDGE, 0.0, 1.0)
    high = np.clip((ceiling_height - height) / EDGE, 0.0, 1.0)
    return np.asarray((0.80 + 0.20 * low) * (0.84 + 0.16 * high))


FLOOR_EDGE, CEILING_EDGE, CORNER = 0.72, 0.80, 0.80
"""Factor at the wall for floor, ceiling and a vertical room corner (1 at ``EDGE`` from it)."""
FLOOR_LIGHT, CEILING_LIGHT = 0.88, 0.97
"""Brightness of floor and ceiling away from the walls."""
