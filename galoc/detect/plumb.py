"""Plumb lines in a tilted image: where the vertical through a pixel leaves the picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.camera import Camera, levelling
from galoc.errors import GalocError


def plumb_exit(pixel: ArrayLike, camera: Camera, gravity: ArrayLike, *, upwards: bool) -> NDArray[np.float64]:
    """Where the vertical line through a pixel leaves the image.

    Args:
        pixel: (2,) px, inside the image (pixel edges included; what lies outside is moved in).
        camera: intrinsics.
        gravity: (roll, pitch), rad.
        upwards: which way to go.

    Returns:
        (2,) px on the image border.

    Raises:
        GalocError: the plumb line is seen end on.
    """
    high = np.array([camera.width - 0.5, camera.height - 0.5])
    start = np.clip(np.asarray(pixel, np.float64), -0.5, high)
    vertical = levelling(gravity)[1] * (-1.0 if upwards else 1.0)  # camera-frame direction
    ray = camera.rays_camera(start)
    # Velocity of the pixel as the point moves along the vertical, up to a positive factor.
    speed = np.array(
        [camera.fx * (vertical[0] - ray[0] * vertical[2]), camera.fy * (vertical[1] - ray[1] * vertical[2])]
    )
    if np.abs(speed).max() < 1e-9:
        raise GalocError("a plumb line seen end on", "a camera that does not look straight up or down", "Fix gravity.")
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(speed > 0, (high - start) / speed, (-0.5 - start) / speed)
    reach = np.where(speed == 0, np.inf, reach)
    end = np.asarray(start + max(0.0, float(reach.min())) * speed)
    # The vanishing point of the vertical ends the line where it is inside the image.
    if vertical[2] > 1e-9:
        vanishing = np.array([camera.fx, camera.fy]) * vertical[:2] / vertical[2] + np.array([camera.cx, camera.cy])
        if np.dot(vanishing - start, speed) < np.dot(end - start, speed):
            return np.asarray(vanishing)
    return end
