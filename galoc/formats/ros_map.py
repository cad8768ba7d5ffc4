"""ROS map_server maps (``map.yaml`` with an occupancy image): the boundary of free space becomes wall."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc.errors import GalocError
from galoc.floorplan import Floorplan

MAX_BYTES = 1 << 20
"""A larger yaml is no map description."""
EXAMPLE = "image, resolution (m per px), origin [x, y, yaw], negate, occupied_thresh, free_thresh"


def read_ros_map(path: Path) -> Floorplan:
    """Plan from a map_server yaml and the image it names.

    Unknown (grey) cells are not free; the walls are where free space ends. Where the named image is missing, one of
    the same stem, or of the yaml's stem, with suffix .png or .pgm is taken instead.

    Raises:
        GalocError: not such a yaml, no image, bad values.
    """
    from galoc.formats.image import grey_image
    from galoc.formats.vectorize import walls_from_free

    info = _parsed(path)
    resolution = _number(info, "resolution", path)
    negate = bool(_number(info, "negate", path, 0.0))
    free_below = _number(info, "free_thresh", path, 0.196)
    if resolution <= 0 or not 0 < free_below < 1:
        got = f"resolution {resolution:g} and free_thresh {free_below:g} in {path.name!r}"
        raise GalocError(got, "a resolution above 0 m and a threshold between 0 and 1", "Fix the yaml.")
    grey = grey_image(_image_path(info, path)).astype(np.float64)
    occupancy = grey / 255.0 if negate else (255.0 - grey) / 255.0
    # pad so that boundaries which run off the map close; what they close with, along its edge, is no wall
    free = np.pad((occupancy < free_below)[::-1], 1, constant_values=False)
    segments = walls_from_free(free, resolution, path.name) - resolution
    segments = segments[~_on_border(segments, free.shape[1] - 2, free.shape[0] - 2, resolution)]
    try:
        return Floorplan(
            _placed(segments, _origin(info, path)), name=path.stem, notes=f"ROS map, {resolution:g} m per cell."
        )
    except GalocError as error:
        raise GalocError(f"{path.name!r}: {error.got}", error.expected, error.cure) from error


def _on_border(segments: NDArray[np.float64], width: int, height: int, cell: float) -> NDArray[np.bool_]:
    """(S,) which segments run along the edge of the map."""
    x, y = segments[:, [0, 2]] / cell, segments[:, [1, 3]] / cell
    near = [np.abs(values - edge).max(axis=1) < 0.25 for values, edge in ((x, 0), (x, width), (y, 0), (y, height))]
    return np.asarray(np.logical_or.reduce(near))


def _placed(segments: NDArray[np.float64], origin: tuple[float, float, float]) -> NDArray[np.float64]:
    """Segments in map coordinates: turned by the origin's yaw, then moved to its x, y."""
    x, y, yaw = origin
    if yaw == 0.0:  # keep axis-aligned walls exactly so
        return segments + np.array([x, y, x, y])
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    return np.asarray((segments.reshape(-1, 2) @ turn.T + np.array([x, y])).reshape(-1, 4))


def _parsed(path: Path) -> dict[str, Any]:
    import yaml

    try:
        if path.stat().st_size > MAX_BYTES:
            raise GalocError(f"{path.name!r} of {path.stat().st_size} bytes", "a ROS map yaml", "Check the file.")
        info = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise GalocError(f"{str(path)!r} ({error.strerror})", "a readable yaml", "Check the path.") from error
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise GalocError(f"{path.name!r} that is not YAML ({error})", f"a ROS map with {EXAMPLE}", "Fix it.") from error
    if not isinstance(info, dict) or "image" not in info or "resolution" not in info:
        raise GalocError(f"{path.name!r} without image and resolution", f"a ROS map with {EXAMPLE}", "Fix the yaml.")
    return info


def _number(info: dict[str, Any], key: str, path: Path, default: float | None = None) -> float:
    value = info.get(key, default)
    if not isinstance(value, int | float) or not math.isfinite(value):
        raise GalocError(f"{key} = {value!r} in {path.name!r}", "a finite number", "Fix the yaml.")
    return float(value)


def _origin(info: dict[str, Any], path: Path) -> tuple[float, float, float]:
    value = info.get("origin", [0.0, 0.0, 0.0])
    good = isinstance(value, list) and len(value) in (2, 3)
    if not good or not all(isinstance(v, int | float) and math.isfinite(v) for v in value):
        raise GalocError(f"origin = {value!r} in {path.name!r}", "[x, y, yaw] in m and rad", "Fix the yaml.")
    x, y, yaw = [*map(float, value), 0.0][:3]
    return x, y, yaw


def _image_path(info: dict[str, Any], path: Path) -> Path:
    """The image the yaml names, or its stand-in beside the yaml."""
    named = path.parent / str(info["image"])
    stems = [named.with_suffix(""), path.parent / named.stem, path.with_suffix("")]
    candidates = [named, *(stem.parent / (stem.name + suffix) for stem in stems for suffix in (".png", ".pgm"))]
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    raise GalocError(
        f"{path.name!r} that names the missing image {info['image']!r}",
        f"that image, or {path.stem}.png or {path.stem}.pgm, beside the yaml",
        "Put the image there or fix its name.",
    )
