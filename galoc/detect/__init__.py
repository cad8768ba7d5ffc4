"""Detectors: from an image to a :class:`galoc.Wireframe`."""

from __future__ import annotations

from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

from galoc.camera import Camera
from galoc.errors import GalocError
from galoc.heights import Heights
from galoc.types import Wireframe

DETECTORS = ("onnx", "lines")
"""Names that :func:`make_detector` knows: the learned one that ships with galoc, and line segments without weights."""


class Detector(Protocol):
    """Anything that finds the wall wireframe of an image.

    A detector that has a true attribute ``uses_heights`` is a :class:`HeightsDetector` and is asked as one.
    """

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


class HeightsDetector(Protocol):
    """A detector that draws the one boundary of a wall from the other where the ratio of the heights is known."""

    uses_heights: bool
    """True."""

    def detect(
        self,
        image: NDArray[np.uint8],
        camera: Camera,
        gravity: tuple[float, float],
        *,
        log_ratio: tuple[float, float] | None = None,
    ) -> Wireframe:
        """Wireframe of one image.

        Args:
            image: (H, W, 3) uint8 RGB.
            camera: intrinsics of the image.
            gravity: measured (roll, pitch), rad.
            log_ratio: what is known of log(camera above the floor / ceiling above the camera): mean and standard
                deviation; None: nothing.

        Returns:
            The wireframe in pixels of the image; empty when no structure is seen.
        """
        ...


def checked_detector(detector: str | Detector) -> str | Detector:
    """What was given, if :func:`make_detector` can do something with it; nothing is loaded.

    Raises:
        GalocError: neither a name of :data:`DETECTORS` nor an object that detects.
    """
    if isinstance(detector, str) and detector in DETECTORS:
        return detector
    if not isinstance(detector, str | type) and callable(getattr(detector, "detect", None)):
        return detector
    got = f"the class {detector.__name__}" if isinstance(detector, type) else repr(detector)
    names = " or ".join(f'"{name}"' for name in DETECTORS)
    cure = 'Leave it out for "onnx"; for a model file pass galoc.detect.onnx.OnnxDetector(PATH).'
    raise GalocError(f"detector = {got}", f"{names}, or an object with a method `detect`", cure)


_made: dict[str, Detector] = {}


def make_detector(detector: str | Detector) -> Detector:
    """The detector of a name, or the given object itself.

    The same name gives the same object in the whole process: it costs memory once, may be used from several threads,
    and a process forked later opens the model for itself.

    Args:
        detector: "onnx" (learned, ships with galoc), "lines" (line segments, no weights), or an object that detects.

    Raises:
        GalocError: nothing of these, or the model is missing or damaged.
    """
    detector = checked_detector(detector)
    if not isinstance(detector, str):
        return detector
    if detector not in _made:
        _made.setdefault(detector, _build(detector))  # of two threads that come first, one wins
    return _made[detector]


def _build(name: str) -> Detector:
    if name == "onnx":
        from galoc.detect.onnx import OnnxDetector

        return OnnxDetector()
    from galoc.detect.lines import LinesDetector

    return LinesDetector()


def detect(
    detector: Detector,
    image: NDArray[np.uint8],
    camera: Camera,
    gravity: tuple[float, float],
    heights: Heights | None = None,
) -> Wireframe:
    """Ask a detector for the wireframe of an image; those that use heights are told what is known of them.

    Args:
        detector: whom to ask.
        image: (H, W, 3) uint8 RGB.
        camera: intrinsics of the image.
        gravity: measured (roll, pitch), rad.
        heights: what is known of the heights; None: nothing.

    Raises:
        GalocError: as the detector does, or what it returns is no wireframe.
    """
    if getattr(detector, "uses_heights", False):
        log_ratio = None if heights is None else (heights.k, heights.k_sd)
        found = cast(HeightsDetector, detector).detect(image, camera, gravity, log_ratio=log_ratio)
    else:
        found = detector.detect(image, camera, gravity)
    if not isinstance(found, Wireframe):
        got = f"{type(found).__name__} from the detector {type(detector).__name__}"
        raise GalocError(got, "a galoc.Wireframe", "Return Wireframe(...), or Wireframe.empty() where nothing is seen.")
    return found
