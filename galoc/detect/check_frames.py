"""Frames with known truth that ship with galoc, and how well a detector does on them."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from galoc import assets
from galoc.camera import Camera
from galoc.detect.columns import Columns
from galoc.errors import GalocError
from galoc.types import Wireframe
from galoc.wireframe import layout_mask, mask_iou

if TYPE_CHECKING:
    from galoc.detect import Detector

Array = NDArray[np.float64]

FORMAT = "galoc.check/1"
"""Of ``truth.json`` beside the frames."""
ROUNDS = 3
"""Times that each frame is timed."""
CUTS = ("ceiling_cut", "floor_cut")
MIRRORED = 0.7
"""Columns that are so many times nearer to the truth after a swap of left and right were swapped."""


@dataclass(frozen=True, slots=True, eq=False)
class CheckFrame:
    """One frame and what is true of it."""

    name: str
    """File name of the picture."""
    picture: NDArray[np.uint8]
    """(H, W, 3) RGB."""
    camera: Camera
    """Intrinsics."""
    gravity: tuple[float, float]
    """True (roll, pitch), rad."""
    wireframe: Wireframe
    """What a perfect detector would return."""
    elevation: Array
    """(2, C) rad: true elevation of ceiling and floor line per column; NaN where there is no wall."""
    visible: NDArray[np.bool_]
    """(2, C): the line is inside the picture and nothing hides it."""
    in_frame: NDArray[np.bool_]
    """(2, C): it is inside the picture."""


@dataclass(frozen=True, slots=True, eq=False)
class Check:
    """How a detector did on F frames."""

    iou: Array
    """(F,) overlap of the true and the found wall area, 0 to 1; NaN where nothing was found."""
    milliseconds: Array
    """(F,) processor time of one frame, ms: the median of some rounds."""
    error_deg: Array | None
    """(K,) of all columns whose line is visible, how far it was found from the truth, degrees. None: no columns."""
    guess_deg: float
    """Median of the same for the best guess that does not look at the picture."""
    problems: tuple[str, ...]
    """What breaks the contract, in words."""


def check_frames() -> list[CheckFrame]:
    """The shipped frames.

    Raises:
        GalocError: they are not there, or damaged.
    """
    path = assets.path("check/truth.json")
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        if data["format"] != FORMAT:
            raise ValueError(data["format"])
        return [_frame(entry) for entry in data["frames"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        if isinstance(error, GalocError):
            raise
        raise GalocError(
            "check/truth.json that is damaged", f"frames of format {FORMAT}", "Reinstall galoc."
        ) from error


def check(detector: Detector, frames: Sequence[CheckFrame]) -> Check:
    """Run a detector over frames.

    Args:
        detector: any; what it says per column is compared where it has a method ``columns``.
        frames: with their truth.

    Raises:
        GalocError: what the detector raises.
    """
    iou, spent, columns = [], [], []
    for frame in frames:
        found, milliseconds = _timed(detector, frame)
        spent.append(milliseconds)
        iou.append(_overlap(found, frame))
        if hasattr(detector, "columns") and getattr(detector, "has_columns", True):
            columns.append(detector.columns(frame.picture, frame.camera, frame.gravity))
    truth = np.concatenate([frame.elevation for frame in frames], axis=1)
    seen = np.concatenate([frame.visible for frame in frames], axis=1) & np.isfinite(truth)
    middle = [np.median(row[there]) for row, there in zip(truth, seen, strict=True)]
    guess = float(np.degrees(np.median(np.abs(truth - np.array(middle)[:, None])[seen])))
    if not columns:
        return Check(np.array(iou), np.array(spent), None, guess, ())
    said = np.concatenate([c.elevation for c in columns], axis=1)
    error = np.degrees(np.abs(said - truth))[seen]
    return Check(np.array(iou), np.array(spent), error, guess, _problems(columns, truth, seen))


def _problems(columns: Sequence[Columns], truth: Array, seen: NDArray[np.bool_]) -> tuple[str, ...]:
    """What no single output gives away: numbers in range that mean something else."""
    said = np.concatenate([c.elevation for c in columns], axis=1)
    mirrored = np.concatenate([c.elevation[:, ::-1] for c in columns], axis=1)
    problems = []
    if np.median(said[0]) <= 0.0 or np.median(said[1]) >= 0.0:
        problems.append("elevation: row 0, the ceiling, has to be above the horizon (> 0), row 1, the floor, below")
    error, swapped = (float(np.median(np.abs(s - truth)[seen])) for s in (said, mirrored))
    if swapped < MIRRORED * error:
        problems.append("columns: left and right are swapped (azimuth grows to the right)")
    return tuple(problems)


def _timed(detector: Detector, frame: CheckFrame) -> tuple[Wireframe, float]:
    """Wireframe of a frame and the processor time that it took, ms."""
    found = detector.detect(frame.picture, frame.camera, frame.gravity)  # the first run may compile
    spent = []
    for _ in range(ROUNDS):
        start = time.process_time()
        found = detector.detect(frame.picture, frame.camera, frame.gravity)
        spent.append(1e3 * (time.process_time() - start))
    return found, float(np.median(spent))


def _overlap(found: Wireframe, frame: CheckFrame) -> float:
    if len(found.walls) == 0:
        return math.nan
    return mask_iou(layout_mask(found, frame.camera), layout_mask(frame.wireframe, frame.camera))


def _frame(entry: dict[str, Any]) -> CheckFrame:
    import cv2

    data = np.fromfile(assets.path(f"check/{entry['image']}"), np.uint8)
    camera = Camera.from_hfov(entry["width"], entry["height"], entry["hfov_deg"])
    bgr = cv2.imdecode(data, cv2.IMREAD_COLOR)
    if bgr is None or bgr.shape[:2] != (camera.height, camera.width):
        raise ValueError(entry["image"])
    return CheckFrame(
        entry["image"],
        np.ascontiguousarray(bgr[..., ::-1], np.uint8),
        camera,
        (math.radians(entry["roll_deg"]), math.radians(entry["pitch_deg"])),
        _wireframe(entry["wireframe"]),
        np.radians(np.array(entry["elevation_deg"], np.float64)),  # null becomes NaN
        *(np.array([[c == "1" for c in row] for row in entry[name]]) for name in ("visible", "in_frame")),
    )


def _wireframe(entry: dict[str, Any]) -> Wireframe:
    ceiling_cut, floor_cut = (np.array(entry[name], np.float64).reshape(-1, 2, 2) for name in CUTS)
    return Wireframe(
        np.array(entry["ceiling"], np.float64),
        np.array(entry["floor"], np.float64),
        np.array(entry["ceiling_true"]),
        np.array(entry["floor_true"]),
        np.array(entry["walls"]),
        np.array(entry["kind"], np.int8),
        ceiling_cut=ceiling_cut,
        floor_cut=floor_cut,
    )
