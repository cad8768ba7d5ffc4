"""The ``galoc detect`` command."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import tyro
from numpy.typing import NDArray

from galoc.errors import GalocError
from galoc.types import BORDER, OCCLUSION, Wireframe

if TYPE_CHECKING:
    from galoc.camera import Camera
    from galoc.detect.check_frames import Check

PICTURES = (".png", ".jpg", ".jpeg")
"""Kinds of file that the overlay is written as."""
SHIPPED = "shipped"
"""What ``--check`` and ``--model`` call the model that ships with galoc."""


def detect(
    image: tyro.conf.Positional[Path | None] = None,
    /,
    *,
    hfov: float | None = None,
    roll: float = 0.0,
    pitch: float = 0.0,
    model: str = SHIPPED,
    detector: Literal["onnx", "lines"] = "onnx",
    out: Path | None = None,
    json: Path | None = None,
    check: str | None = None,
) -> int:
    """Find the walls in a picture and draw them over it; or try a model on frames with known truth.

    Args:
        image: a picture in any format that OpenCV reads. It is turned as its EXIF entry says; the angles below are
            those of the turned picture.
        hfov: horizontal field of view, degrees (a phone's main camera: about 65 lying, 50 upright).
        roll: of the camera, degrees; above 0: its right side is lower.
        pitch: of the camera, degrees; above 0: it looks up.
        model: ONNX file; "shipped": the one that ships with galoc.
        detector: onnx (learned) or lines (line segments, no model).
        out: where to write the picture, .png or .jpg; default: <name>.walls.png in the current folder.
        json: also write the wireframe as labels to this file.
        check: try this ONNX file ("shipped": galoc's own) on frames with known truth, and look at no picture.
    """
    if check is not None:
        if image is not None:
            raise GalocError(f"--check with a picture, {str(image)!r}", "one of the two", "Leave one of them out.")
        return run_check(check)
    if image is None or hfov is None:
        missing = "a picture" if image is None else "--hfov"
        raise GalocError(
            f"no {missing}", "galoc detect IMAGE --hfov DEGREES, or galoc detect --check MODEL", f"Give {missing}."
        )
    target = drawing_target(out, Path(f"{image.stem}.walls.png"), json)
    picture, turned = read_picture(image)
    print(_detected(image, picture, turned, (hfov, roll, pitch), chosen_detector(detector, model), target, json))
    return 0


def _detected(
    image: Path,
    picture: NDArray[np.uint8],
    turned: bool,
    angles_deg: tuple[float, float, float],
    found_by: Any,
    target: Path,
    labels: Path | None,
) -> str:
    """Detect, write the files, and return the table."""
    height, width = picture.shape[:2]
    hfov, roll, pitch = angles_deg
    camera, gravity = camera_and_gravity(picture, angles_deg)
    wireframe = found_by.detect(picture, camera, gravity)
    rows = {
        "picture": picture_words(image, picture, turned),
        "camera": f"hfov {hfov:g} deg, roll {roll:g} deg, pitch {pitch:g} deg",
        "detector": describe(found_by),
        **found_rows(wireframe, camera, gravity),
    }
    _write_picture(target, picture, wireframe, rows)
    rows["drawing"] = str(target)
    if labels is not None:
        from galoc.detect.labels import save_labels

        rows["labels"] = str(save_labels({image.name: wireframe}, labels, (width, height)))
    return "\n".join(f"{key:<14}{value}" for key, value in rows.items())


def camera_and_gravity(
    picture: NDArray[np.uint8], angles_deg: tuple[float, float, float]
) -> tuple[Camera, tuple[float, float]]:
    """Camera of a picture and gravity (rad) from hfov, roll and pitch in degrees.

    Raises:
        GalocError: a field of view or a tilt that no camera has.
    """
    from galoc.camera import MAX_TILT, Camera

    hfov, *tilt = angles_deg
    if not all(abs(angle) <= math.degrees(MAX_TILT) for angle in tilt):  # false for NaN too
        got = f"--roll {tilt[0]:g} --pitch {tilt[1]:g}"
        raise GalocError(got, "gravity within 85 degrees of level", "Give degrees; leave them out for a level camera.")
    return Camera.from_hfov(picture.shape[1], picture.shape[0], hfov), (math.radians(tilt[0]), math.radians(tilt[1]))


def found_rows(wireframe: Wireframe, camera: Camera, gravity: tuple[float, float]) -> dict[str, str]:
    """What was found, in words, by name."""
    if len(wireframe.walls) == 0:
        return {"walls": "abstained: no wall is seen"}
    from galoc.layout import solve_layout
    from galoc.rays import cast_rays

    ends = wireframe.kind != BORDER
    seen = np.stack([wireframe.ceiling_true, wireframe.floor_true], axis=1)
    counts = (seen & ends[:, None]).sum(axis=0)
    rows = {
        "walls": f"{len(wireframe.walls)}",
        "corners seen": f"{counts[0]} at the ceiling, {counts[1]} at the floor",
        "occlusions": f"{np.count_nonzero(wireframe.kind == OCCLUSION)}",
        "boundary sd": "not stated",
    }
    if wireframe.sigma_px is not None and seen.any():
        sigma = float(np.median(wireframe.sigma_px[seen]))
        rows["boundary sd"] = f"{sigma:.1f} px ({math.degrees(math.atan(sigma / camera.fx)):.2f} deg at the centre)"
    coverage = cast_rays(solve_layout(wireframe, camera, gravity), camera).coverage
    rows["coverage"] = coverage_words(coverage) if coverage > 0.0 else "abstained: no wall's distance is known"
    return rows


def coverage_words(coverage: float) -> str:
    """How much is seen, as a share of the field of view."""
    return f"{100 * coverage:.0f} % of the field of view has a known distance"


def picture_words(image: Path, picture: NDArray[np.uint8], turned: bool) -> str:
    """Name and size of a picture."""
    size = f"{picture.shape[1]} x {picture.shape[0]} px"
    return f"{image.name}, {size}" + (" after turning it by its EXIF entry" if turned else "")


def describe(detector: Any) -> str:
    """One line about a detector."""
    model = getattr(detector, "model", None)
    if model is None:
        return "lines"
    return f"{model.path.name} ({model.contract}, sha256 {model.sha256[:12]}...)"


def chosen_detector(name: str, model: str) -> Any:
    """The detector that ``--detector`` and ``--model`` ask for.

    Raises:
        GalocError: lines with a model, or a model that cannot be used.
    """
    if name == "lines":
        if model != SHIPPED:
            raise GalocError(f"--detector lines with --model {model!r}", "one of the two", "Leave one of them out.")
        from galoc.detect import make_detector

        return make_detector(name)
    from galoc.detect.onnx import OnnxDetector

    return OnnxDetector(None if model == SHIPPED else model)


def read_picture(path: Path) -> tuple[NDArray[np.uint8], bool]:
    """(H, W, 3) RGB of a picture file, turned as its EXIF entry says, and whether that entry exchanged its sides.

    Raises:
        GalocError: no such file, or no picture that OpenCV reads.
    """
    import cv2

    try:
        data = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError as error:
        got = f"{str(path)!r} which cannot be read ({error.strerror})"
        raise GalocError(got, "a picture file", "Fix the path.") from error
    try:
        bgr = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
        raw = None if bgr is None else cv2.imdecode(data, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error:  # too many pixels
        bgr = raw = None
    if bgr is None or raw is None:
        got = f"{str(path)!r} which is no picture that OpenCV reads, or damaged"
        raise GalocError(got, "a PNG, JPEG, WebP, TIFF or other picture", "Convert it to PNG or JPEG.")
    return np.ascontiguousarray(bgr[..., ::-1], np.uint8), bgr.shape[:2] != raw.shape[:2]


def drawing_target(out: Path | None, default: Path, json: Path | None) -> Path:
    """Where to draw; it and the file for the numbers are refused before any work is done for them.

    Raises:
        GalocError: a name that is no picture's, or a file that cannot be written.
    """
    target = default if out is None else out
    if target.suffix.lower() not in PICTURES:
        raise GalocError(f"{str(target)!r} to draw to", "a file name that ends in .png or .jpg", "Fix the suffix.")
    for file in (target, json):
        if file is not None:
            refuse_unwritable(file)
    return target


def refuse_unwritable(path: Path) -> None:
    """Refuse a file that cannot be written before any work is done for it.

    Raises:
        GalocError: its folder is missing or not writable, or it is a folder itself.
    """
    try:
        if path.is_dir():
            raise IsADirectoryError(21, "it is a folder")
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        got = f"{str(path)!r} which cannot be written ({error.strerror})"
        raise GalocError(got, "a file in an existing, writable folder", "Make the folder or choose another.") from error


def _write_picture(target: Path, picture: NDArray[np.uint8], wireframe: Wireframe, rows: dict[str, str]) -> None:
    import cv2

    from galoc.formats.atomic import write_atomic
    from galoc.plot_detect import draw_detection

    names = [name for name in ("walls", "corners seen", "boundary sd", "coverage") if name in rows]
    caption = rows["walls"] if len(names) == 1 else "   ".join(f"{name}: {rows[name]}" for name in names)
    drawn = draw_detection(picture, wireframe, caption)
    _, data = cv2.imencode(target.suffix.lower(), drawn[..., ::-1])
    write_atomic(target, data.tobytes())


def run_check(model: str) -> int:
    """Try a model on the shipped frames and print how it does.

    Args:
        model: ONNX file, or "shipped".

    Returns:
        0 when it keeps its contract, 2 when not.
    """
    from galoc.detect.check_frames import check, check_frames
    from galoc.detect.onnx import OnnxDetector

    detector = OnnxDetector(None if model == SHIPPED else model)
    print(f"{'model':<14}{describe(detector)}")
    found = check(detector, check_frames())
    print(check_text(found, detector.model.contract))
    return 2 if found.problems else 0


def check_text(found: Check, contract: str) -> str:
    """A line for each frame, then what they come to and the verdict."""
    lines = ["", "frame  mask IoU     ms"]
    for number, (iou, spent) in enumerate(zip(found.iou, found.milliseconds, strict=True)):
        lines.append(f"{number:>5}  {'abstained' if math.isnan(iou) else f'{iou:.3f}':>8}  {spent:>5.1f}")
    blind = int(np.isnan(found.iou).sum())
    mean = "none" if blind == len(found.iou) else f"{np.nanmean(found.iou):.3f}"
    lines += ["", f"{'mask IoU':<14}{mean} (mean), abstained on {blind} of {len(found.iou)}"]
    if found.error_deg is not None:
        middle, tail = np.percentile(found.error_deg, [50, 90])
        lines.append(f"{'boundary':<14}off by {middle:.2f} deg (median), {tail:.2f} deg (90 %), where it is visible")
        if middle >= found.guess_deg:
            lines.append(f"{'warning':<14}a guess without looking is off by {found.guess_deg:.2f} deg: no better")
    lines.append(f"{'time':<14}{np.median(found.milliseconds):.1f} ms of processor time a frame (median)")
    lines += [f"{'broken':<14}{problem}" for problem in found.problems]
    lines.append(f"{'contract':<14}{contract}: {'FAILED' if found.problems else 'passed'}")
    return "\n".join(lines)
