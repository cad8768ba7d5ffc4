"""Detectors: from an image to a :class:`galoc.Wireframe`."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from galoc.camera import Camera
from galoc.types import Wireframe


class Detector(Protocol):
    """Anything that finds the wall wireframe of an image."""

    def detect(self, image: NDArray[np.uint8], camera: Camera, gravity: tuple[float, float]) -> Wireframe:
        """Wireframe of one image.

        Args:
            image: (H, W, 3) uint8 RGB.
            camera: intrinsics of the image.
            gravity: measured (roll, pitch), rad.

        Returns:
            The wireframe in pixels of the image; empty when no structure is seen.
        """
        ...
