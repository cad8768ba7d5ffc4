"""The oracle detector: true junctions plus calibrated pixel noise (the paper's Gibson protocol)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from galoc.camera import Camera
from galoc.errors import GalocError
from galoc.types import BORDER, Wireframe


def perturb(wireframe: Wireframe, camera: Camera, sigma_px: float, rng: np.random.Generator) -> Wireframe:
    """Add independent Gaussian noise to every ceiling and floor junction (paper, Sec. IV, Gibson).

    Junctions move in both image directions. What lies on the image border (cuts, border pairs) is where a wall line
    leaves the image, so it moves along that border only; a border pair and its cut are one measurement and stay one.

    Args:
        wireframe: the true wireframe.
        camera: intrinsics, for the border.
        sigma_px: standard deviation per coordinate, px; 0 gives the true pixels back unchanged.
        rng: source of the noise.

    Raises:
        GalocError: negative or not finite sigma.
    """
    if not math.isfinite(sigma_px) or sigma_px < 0:
        raise GalocError(f"noise of {sigma_px!r} px", "a finite standard deviation of 0 px or more", "Pass 0 for none.")
    sigma = np.full((len(wireframe), 2), float(sigma_px))
    if sigma_px == 0 or len(wireframe) == 0:
        return replace(wireframe, sigma_px=sigma)
    noisy = {}
    for name, flag in (("ceiling", wireframe.ceiling_true), ("floor", wireframe.floor_true)):
        pixels = getattr(wireframe, name)
        noise = rng.normal(0.0, sigma_px, pixels.shape)
        noise[wireframe.kind == BORDER, 0] = 0.0  # a border pair stays on the left or right image edge
        noise[~flag, 1] = 0.0  # an unseen end stays where its vertical leaves the image
        noisy[name] = pixels + noise
        cut = getattr(wireframe, f"{name}_cut")
        if cut is None:
            continue
        along_u = (cut[..., 1] <= -0.5 + 1e-6) | (cut[..., 1] >= camera.height - 0.5 - 1e-6)
        axis = np.stack([along_u, ~along_u], axis=-1)
        moved = cut + axis * rng.normal(0.0, sigma_px, cut.shape)
        same = (wireframe.kind == BORDER)[wireframe.walls] & flag[wireframe.walls]
        noisy[f"{name}_cut"] = np.where(same[..., None], noisy[name][wireframe.walls], moved)
    return replace(wireframe, sigma_px=sigma, **noisy)


class OracleDetector:
    """A :class:`galoc.detect.Detector` fed from outside with true wireframes.

    Args:
        truth: called once per image; returns the true wireframe of the view the image shows.
        noise_px: standard deviation added to each junction coordinate, px.
        rng: source of the noise.
    """

    def __init__(self, truth: Callable[[], Wireframe], noise_px: float, rng: np.random.Generator) -> None:
        self._truth, self._noise_px, self._rng = truth, noise_px, rng

    def detect(self, image: NDArray[np.uint8], camera: Camera, gravity: tuple[float, float]) -> Wireframe:
        """The true wireframe plus noise; the image itself is not looked at."""
        return perturb(self._truth(), camera, self._noise_px, self._rng)
