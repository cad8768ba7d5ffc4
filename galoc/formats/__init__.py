"""Reading and writing floorplans: one lazily imported module per file format."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from galoc import assets
from galoc.errors import GalocError

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan

IMAGE_SUFFIXES = (".png", ".pgm", ".jpg", ".jpeg", ".bmp")
SUFFIX_WORDS = ".json, .yaml, .yml or an image (" + ", ".join(IMAGE_SUFFIXES) + ")"


def load_plan(path: str | Path, *, scale: float | None = None, ceiling_height: float | None = None) -> Floorplan:
    """Read a plan; the format follows from the suffix (see :meth:`galoc.Floorplan.load`).

    Args:
        path: ``.json``, ``.yaml``/``.yml`` (ROS map_server), an image, or the bare name of a shipped plan.
        scale: metres per pixel; needed for images, refused elsewhere.
        ceiling_height: replaces the file's value, m.

    Raises:
        GalocError: missing file, unknown suffix, not a plan, bad values, image without scale or too large.
    """
    file = _resolved(path)
    suffix = file.suffix.lower()
    image = suffix in IMAGE_SUFFIXES
    if scale is not None and not image:
        raise GalocError(f"scale = {scale!r} for {file.name!r}", "a scale for images only", "Leave the scale out.")
    plan: Floorplan
    if suffix == ".json":
        from galoc.formats.plan_json import read_json

        return read_json(file, ceiling_height)
    if suffix in (".yaml", ".yml"):
        from galoc.formats.ros_map import read_ros_map

        plan = read_ros_map(file)
    elif image:
        from galoc.formats.image import read_image

        plan = read_image(file, checked_scale(scale, file.name))
    else:
        raise GalocError(f"{file.name!r} with suffix {suffix!r}", SUFFIX_WORDS, "Convert the plan to one of these.")
    return plan if ceiling_height is None else replace(plan, ceiling_height=ceiling_height)


def save_plan(plan: Floorplan, path: str | Path) -> Path:
    """Write the plan as JSON that :func:`load_plan` reads back bit-equal; whole or not at all.

    Raises:
        GalocError: suffix other than ``.json``, or a place that cannot be written.
    """
    target = Path(path)
    if target.suffix.lower() != ".json":
        raise GalocError(f"{target.name!r} to save a plan to", "a file name that ends in .json", "Add the suffix.")
    from galoc.formats.atomic import write_atomic
    from galoc.formats.plan_json import to_json

    return write_atomic(target, to_json(plan).encode())


def checked_scale(scale: object, name: str) -> float:
    """Metres per pixel as a positive float, or a GalocError that names the image."""
    number = isinstance(scale, int | float) and not isinstance(scale, bool)
    if not number or not math.isfinite(scale) or scale <= 0:  # type: ignore[arg-type,operator]
        raise GalocError(
            f"scale = {scale!r} for the image {name!r}",
            "metres per pixel above 0",
            "Measure a known length in pixels and pass scale = metres / pixels.",
        )
    return float(scale)  # type: ignore[arg-type]


def _resolved(path: str | Path) -> Path:
    """The file behind a path or behind the bare name of a shipped plan."""
    file = Path(path)
    if file.is_file():
        return file
    shipped = assets.plan_names()
    if str(path) in shipped and not file.suffix:
        return assets.path(f"plans/{path}.json")
    what = "a folder" if file.is_dir() else "which does not exist"
    raise GalocError(f"{str(path)!r}, {what}", f"a plan file, or one of the shipped plans {shipped}", "Check the path.")
