"""The ``galoc locate`` command."""

from __future__ import annotations

import json as json_text
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import tyro
from numpy.typing import NDArray

from galoc.cli_detect import (
    SHIPPED,
    camera_and_gravity,
    chosen_detector,
    coverage_words,
    describe,
    drawing_target,
    found_rows,
    picture_words,
    read_picture,
)
from galoc.errors import GalocError
from galoc.heights import Heights
from galoc.places import Place, places
from galoc.types import Estimate

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan

HEIGHTS_SD = 0.03
"""Relative standard deviation of heights that are given."""


def locate(
    image: tyro.conf.Positional[Path],
    /,
    *,
    plan: str,
    hfov: float,
    roll: float = 0.0,
    pitch: float = 0.0,
    scale: float | None = None,
    camera_height: float | None = None,
    ceiling_height: float | None = None,
    model: str = SHIPPED,
    detector: Literal["onnx", "lines"] = "onnx",
    labels: Path | None = None,
    out: Path | None = None,
    json: Path | None = None,
) -> int:
    """Find where in a floorplan a photo was taken, print the pose and draw it on the plan.

    Args:
        image: a picture in any format that OpenCV reads. It is turned as its EXIF entry says; the angles below are
            those of the turned picture.
        plan: plan file (.json, ROS map .yaml, or an image with --scale), or the name of a shipped plan.
        hfov: horizontal field of view, degrees (a phone's main camera: about 65 lying, 50 upright).
        roll: of the camera, degrees; above 0: its right side is lower.
        pitch: of the camera, degrees; above 0: it looks up.
        scale: metres per pixel of the plan; needed for images.
        camera_height: of the camera above the floor, m. Heights that are known make the pose much surer.
        ceiling_height: of the ceiling above the floor, m; what the plan says of it is not used.
        model: ONNX file; "shipped": the one that ships with galoc.
        detector: onnx (learned) or lines (line segments, no model).
        labels: take the walls of this picture from a labels file (galoc detect --json writes one to correct by hand).
        out: where to write the drawing, .png or .jpg; default: <name>.map.png in the current folder.
        json: also write pose, covariance and other places to this file.
    """
    from galoc.floorplan import Floorplan

    target = drawing_target(out, Path(f"{image.stem}.map.png"), json)
    known = given_heights(camera_height, ceiling_height)
    picture, turned = read_picture(image)
    loaded = Floorplan.load(plan, scale=scale)
    if labels is not None and (detector != "onnx" or model != SHIPPED):
        raise GalocError("--labels with --detector or --model", "one of the two", "Leave one of them out.")
    found_by = _labelled(labels, image.name) if labels is not None else chosen_detector(detector, model)
    heights = _height_words(camera_height, ceiling_height)
    words = {
        "picture": picture_words(image, picture, turned),
        "camera": f"hfov {hfov:g} deg, roll {roll:g} deg, pitch {pitch:g} deg, {heights}",
        "detector": f"labels in {labels.name}" if labels is not None else describe(found_by),
        "plan": f"{loaded.name or plan}, {len(loaded.segments)} wall segments",
    }
    print(_located(loaded, picture, (hfov, roll, pitch), found_by, known, words, target, json))
    return 0


def given_heights(camera_m: float | None, ceiling_m: float | None) -> Heights:
    """What is known of the heights when either, both or none are given.

    Args:
        camera_m: of the camera above the floor, m.
        ceiling_m: of the ceiling above the floor, m.

    Raises:
        GalocError: no height, or a camera that is not below the ceiling.
    """
    if camera_m is not None and ceiling_m is not None:
        return Heights.known(camera_m, ceiling_m, HEIGHTS_SD)
    if ceiling_m is not None:
        return Heights.under(ceiling_m, HEIGHTS_SD)
    if camera_m is None:
        return Heights()
    if not (math.isfinite(camera_m) and 0.0 < camera_m <= 100.0):
        raise GalocError(f"--camera-height {camera_m:g}", "metres above the floor, up to 100", "Fix it.")
    return Heights(log_floor=math.log(camera_m), var_floor=HEIGHTS_SD**2)


def _located(
    plan: Floorplan,
    picture: NDArray[np.uint8],
    angles_deg: tuple[float, float, float],
    found_by: Any,
    heights: Heights,
    words: dict[str, str],
    target: Path,
    json: Path | None,
) -> str:
    """Locate, write the files, and return the table."""
    from galoc.detect import detect
    from galoc.localizer import Localizer
    from galoc.plot_locate import observed_walls, save_location_figure

    camera, gravity = camera_and_gravity(picture, angles_deg)
    localizer = Localizer(plan, camera, detector=found_by)
    wireframe = detect(found_by, picture, camera, gravity, heights)
    estimate = localizer.locate(wireframe, gravity, heights)
    seen_from = places(estimate)
    rows = {**words, **found_rows(wireframe, camera, gravity), **pose_rows(estimate, seen_from)}
    walls = None
    if seen_from and estimate.rays is not None:
        rows["coverage"] = coverage_words(estimate.rays.coverage)  # of the rays that were matched
        field = localizer.field
        walls = observed_walls(estimate.rays, seen_from[0].pose, field.positions, field.ranges)
    title = rows["pose"] + ("" if "confidence" not in rows else f"   confidence {estimate.confidence:.2f}")
    save_location_figure(plan, picture, wireframe, seen_from, target, walls=walls, title=title)
    rows["drawing"] = str(target)
    if json is not None:
        from galoc.formats.atomic import write_atomic

        text = json_text.dumps(as_json(estimate, seen_from), indent=1, allow_nan=False) + "\n"
        rows["json"] = str(write_atomic(json, text.encode()))
    return "\n".join(f"{key:<14}{value}" for key, value in rows.items())


def pose_rows(estimate: Estimate, found: tuple[Place, ...]) -> dict[str, str]:
    """Pose, its standard deviation, confidence and other places, in words, by name."""
    if estimate.abstained or not found:
        return {"pose": "abstained: the picture does not say where it was taken"}
    rows = {"pose": pose_text(estimate.pose)}
    if estimate.covariance is not None:
        sd = np.sqrt(np.maximum(np.diagonal(estimate.covariance), 0.0))
        rows["pose sd"] = f"{sd[0]:.2f} m, {sd[1]:.2f} m, {math.degrees(sd[2]):.1f} deg, if it is this place"
    rows["confidence"] = f"{estimate.confidence:.2f} (probability that the position is right within 0.5 m)"
    for number, place in enumerate(found[1:], 2):
        if place.share >= 0.01:
            rows[f"or place {number}"] = f"{pose_text(place.pose)} ({100 * place.share:.0f} %)"
    return rows


def pose_text(pose: NDArray[np.float64]) -> str:
    """A pose in metres and degrees."""
    return f"x {pose[0]:.2f} m, y {pose[1]:.2f} m, heading {math.degrees(pose[2]):.0f} deg"


def as_json(estimate: Estimate, found: tuple[Place, ...]) -> dict[str, Any]:
    """An estimate as plain values: metres, radians, null where there is nothing."""
    there = bool(np.all(np.isfinite(estimate.pose)))
    covariance = None if estimate.covariance is None else np.asarray(estimate.covariance).tolist()
    return {
        "galoc": "location/1",
        "abstained": bool(estimate.abstained),
        "pose": estimate.pose.tolist() if there else None,
        "confidence": float(estimate.confidence),
        "covariance": covariance,
        "coverage": 0.0 if estimate.rays is None else estimate.rays.coverage,
        "places": [{"pose": place.pose.tolist(), "share": place.share} for place in found],
    }


def _height_words(camera_m: float | None, ceiling_m: float | None) -> str:
    given = (("at", camera_m), ("under a ceiling of", ceiling_m))
    return ", ".join(f"{word} {value:g} m" for word, value in given if value is not None) or "heights not given"


def _labelled(labels: Path, name: str) -> Any:
    from galoc.detect.labels import LabelsDetector

    detector = LabelsDetector(labels)
    detector.select(name)
    return detector
