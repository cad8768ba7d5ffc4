"""The environment's detector: the oracle knows the walls of the view, the others look at the picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from galoc import Camera, Floorplan, Wireframe
from galoc.detect import detect, make_detector
from galoc.heights import Heights
from galoc_env.settings import NOISE_WIDTH_PX, Settings

Array = NDArray[np.float64]

DIGITS = 12
"""Of a model's sha256, to tell models apart in reports."""
_WORDS = {"onnx": "walls seen by the network (onnx)", "lines": "walls from line segments (lines)"}


def oracle(plan: Floorplan, pose: Array, tilt: Array, settings: Settings, camera: Camera, key: tuple) -> Wireframe:
    """The true wireframe of a view, plus noise.

    Args:
        plan: as the camera sees it.
        pose: (3,) true pose.
        tilt: (2,) true roll and pitch, rad.
        settings: camera height and noise.
        camera: intrinsics.
        key: seed of the noise.
    """
    from galoc.detect.oracle import perturb
    from galoc_env.truth import visible_wireframe

    roll, pitch = tilt.tolist()
    truth = visible_wireframe(plan, camera, pose, settings.camera_height, (roll, pitch))
    noise_px = settings.detector_noise_px * camera.width / NOISE_WIDTH_PX
    return perturb(truth, camera, noise_px, np.random.default_rng(key))


def look(
    image: NDArray[np.uint8], gravity: Array, settings: Settings, camera: Camera, heights: Heights | None
) -> Wireframe:
    """What a detector that looks at pictures finds in one.

    Args:
        image: (H, W, 3) RGB, as the policy gets it.
        gravity: (2,) measured roll and pitch, rad.
        settings: which detector.
        camera: intrinsics.
        heights: what the localizer knows of the heights by now; None: nothing, or there is none.

    Raises:
        GalocError: nothing is drawn.
    """
    if not settings.draws:
        raise settings.refusal()
    roll, pitch = gravity.tolist()
    return detect(make_detector(settings.detector), image, camera, (roll, pitch), heights)


def source(settings: Settings) -> str:
    """Where wireframes come from, in words for a caption."""
    if settings.looks:
        return _WORDS[settings.detector]
    return f"true wall lines + {settings.detector_noise_px:g} px noise (oracle)"


def model(name: str) -> str | None:
    """First digits of the sha256 of a detector's model; None for a detector without one.

    Args:
        name: of the detector, as in the settings.

    Raises:
        GalocError: the model is missing or damaged.
    """
    if name == "oracle":
        return None
    file = getattr(make_detector(name), "model", None)
    return None if file is None else str(file.sha256)[:DIGITS]


def described(name: str) -> str:
    """A detector and its model, for people: ``onnx, model 0123456789ab``."""
    digits = model(name)
    return name if digits is None else f"{name}, model {digits}"
