"""What a camera can measure of the walls around it, before it has looked."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc import Camera
from galoc.likelihood import SATURATION
from galoc.observation import EFFECTIVE_RAYS, LIMIT_SD
from galoc_agents._gain_kernel import BINS, LOW, PER_UNIT

Float32 = NDArray[np.float32]

LINE_M = 1.2
"""Height of the nearer of ceiling and floor above or below a camera, m."""
EVERY_DEG = 3
"""Distance of the rays that stand for a view, degrees."""
MODEL_SD = 0.06
"""Spread of log range at no noise: grid, map, and the heading's rounding."""
NOISE_SHARE = 5.0 / 640.0
"""Noise of a wall line as a share of the image width (the paper's 5 px of 640)."""


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """Rays of a view and how well each is measured; arguments of :func:`galoc_agents._gain_kernel.expected_entropy`."""

    rays: NDArray[np.int64]
    """(R,) whole degrees beside the heading, counter-clockwise."""
    measured: Float32
    """(R,) least log range at which the floor or ceiling line of the wall is inside the image."""
    precision: Float32
    """(R, BINS) 1 / variance of log range over the saturation, by log range."""
    limit_precision: np.float32
    """The same for what is only known to be near."""
    weight: np.float32
    """Of one ray's cost: the saturation, shared among the rays."""

    @classmethod
    def of(cls, camera: Camera, height_m: float = LINE_M) -> Sight:
        """That of a level camera.

        A line ``height_m`` above or below a camera lies ``f height / z`` pixels from the horizon where the wall is z
        away; an error of one pixel there is ``z / (f height)`` in log z.

        Args:
            camera: intrinsics.
            height_m: of the ceiling above the camera, or of the camera above the floor, m.
        """
        half = math.degrees(math.atan(camera.width / 2.0 / camera.fx))
        edge = int(half) // EVERY_DEG * EVERY_DEG
        rays = np.arange(-edge, edge + 1, EVERY_DEG)
        cosine = np.cos(np.radians(rays))
        nearest = camera.fy * height_m / (camera.height / 2.0) / cosine
        centres = np.exp(LOW + (np.arange(BINS) + 0.5) / PER_UNIT)
        slope = NOISE_SHARE * camera.width / (camera.fy * height_m) * cosine
        variance = MODEL_SD**2 + (slope[:, None] * centres) ** 2
        return cls(
            rays.astype(np.int64),
            np.log(nearest).astype(np.float32),
            (1.0 / (SATURATION * variance)).astype(np.float32),
            np.float32(1.0 / (SATURATION * LIMIT_SD**2)),
            np.float32(SATURATION * min(1.0, EFFECTIVE_RAYS / (2.0 * half)) * EVERY_DEG),
        )
