"""The rules a floorplan must keep, each with an error that says how to mend it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from galoc.errors import GalocError

if TYPE_CHECKING:
    from galoc.floorplan import Opening

Array = NDArray[np.float64]

MAX_COORDINATE = 1e5
"""Coordinates beyond this are a wrong unit or a geographic projection, m."""
MIN_EXTENT = 0.5
"""Smallest bounding box side of a plan, m: less is one wall, or a unit that is not the metre."""
MIN_LENGTH = 1e-9
"""Segments up to this length count as zero-length, m."""
CEILING_RANGE = (1.5, 20.0)
"""Lowest and highest ceiling accepted, m."""


def _numbers(name: str, value: Any, columns: int) -> Array:
    """Fresh float64 (n, columns) array of finite numbers within the coordinate limit."""
    shape_words = f"an (n, {columns}) array of numbers in metres"
    try:
        raw = np.asarray(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise GalocError(
            f"{name} that is no array ({error})", shape_words, "Give every row equally many numbers."
        ) from error
    if raw.dtype.kind not in "iuf" and raw.size:
        raise GalocError(f"{name} of dtype {raw.dtype}", shape_words, "Convert the values to float metres first.")
    if raw.size == 0:
        return np.zeros((0, columns))
    if raw.ndim != 2 or raw.shape[1] != columns:
        raise GalocError(f"{name} with shape {raw.shape}", shape_words, f"Pass {columns} numbers a row.")
    array = np.array(raw, dtype=np.float64, order="C") + 0.0  # + 0.0 turns -0.0 into 0.0: equal plans, equal bytes
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if len(bad):
        got = f"{len(bad)} rows of {name} with NaN or infinite values (first at index {bad[0]})"
        raise GalocError(got, "finite coordinates", "Drop or mend those rows.")
    largest = float(np.abs(array).max())
    if largest > MAX_COORDINATE:
        raise GalocError(
            f"{name} with a coordinate of {largest:.6g} m",
            f"coordinates within +-{MAX_COORDINATE:g} m",
            "Convert to metres and move the plan near the origin.",
        )
    return array


def _frozen(array: Array) -> Array:
    array.setflags(write=False)
    return array


def checked_segments(value: Any) -> Array:
    """Wall segments as a read-only (S, 4) float64 array, m.

    Raises:
        GalocError: wrong type or shape, no wall at all, NaN, far-off coordinates, zero-length segments, or a bounding
            box below 0.5 m.
    """
    array = _numbers("segments", value, 4)
    if len(array) == 0:
        raise GalocError("a plan without walls", "at least one wall segment", "Check that the source holds walls.")
    lengths = np.hypot(array[:, 2] - array[:, 0], array[:, 3] - array[:, 1])
    zero = np.flatnonzero(lengths <= MIN_LENGTH)
    if len(zero):
        raise GalocError(
            f"{len(zero)} zero-length segments (first at index {zero[0]})",
            "segments with two different ends",
            "Drop the rows whose ends coincide.",
        )
    width, height = np.ptp(array[:, [0, 2]]), np.ptp(array[:, [1, 3]])
    if min(width, height) < MIN_EXTENT:
        raise GalocError(
            f"a plan of {width:.4g} m x {height:.4g} m",
            f"a bounding box of at least {MIN_EXTENT} m in both directions",
            "Check the unit (metres) and the scale.",
        )
    return _frozen(array)


def checked_outline(value: Any) -> Array | None:
    """Storey boundary as a read-only (V, 2) float64 array without a repeated last vertex, or None.

    Raises:
        GalocError: fewer than 3 vertices, zero area, or a polygon that crosses or touches itself.
    """
    if value is None:
        return None
    array = _numbers("outline", value, 2)
    if len(array) > 1 and np.array_equal(array[0], array[-1]):
        array = array[:-1].copy()
    if len(array) < 3:
        raise GalocError(f"an outline of {len(array)} vertices", "at least 3 vertices", "Leave the outline out.")
    from shapely.geometry import Polygon
    from shapely.validation import explain_validity

    polygon = Polygon(array)
    if not polygon.is_valid or polygon.area < 1e-6:
        reason = explain_validity(polygon) if not polygon.is_valid else "zero area"
        raise GalocError(
            f"an outline that is not simple ({reason})",
            "a polygon that encloses area and does not cross itself",
            "Order the vertices around the building, or leave the outline out.",
        )
    return _frozen(array)


def _finite(name: str, value: Any) -> float:
    """A real, finite number as a Python float; strings and booleans are refused."""
    ok = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    try:
        number = float(value) if ok else math.nan
    except OverflowError:
        number = math.nan
    if not math.isfinite(number):
        raise GalocError(f"{name} = {value!r}", "a finite number", "Give a plain number in metres.")
    return number + 0.0


def checked_height(value: Any) -> float:
    """Ceiling height as a float between 1.5 and 20 m.

    Raises:
        GalocError: not a number, or out of range.
    """
    number = _finite("ceiling_height", value)
    low, high = CEILING_RANGE
    if not low <= number <= high:
        raise GalocError(
            f"ceiling_height = {number:g}",
            f"metres from {low:g} to {high:g}",
            "Give the floor-to-ceiling height in metres.",
        )
    return number


def checked_openings(value: Any, ceiling_height: float) -> tuple[Opening, ...]:
    """Doors and windows as a tuple of openings whose numbers are plain floats.

    Raises:
        GalocError: unknown kind, NaN, no width, negative thickness, or heights outside 0 <= bottom < top <= ceiling.
    """
    from galoc.floorplan import Opening

    if not isinstance(value, Iterable):
        raise GalocError(f"openings = {value!r}", "a sequence of Opening", "Pass a tuple, or leave it out.")
    out = []
    for index, item in enumerate(value):
        if not isinstance(item, Opening):
            raise GalocError(
                f"openings[{index}] of type {type(item).__name__}", "an Opening", "Build galoc.Opening(...)."
            )
        out.append(_checked_opening(f"openings[{index}]", item, ceiling_height))
    return tuple(out)


def _checked_opening(name: str, item: Opening, ceiling_height: float) -> Opening:
    from galoc.floorplan import Opening

    if item.kind not in ("door", "window"):
        raise GalocError(f"{name}.kind = {item.kind!r}", "'door' or 'window'", "Fix the kind.")
    fields = ("x1", "y1", "x2", "y2", "thickness", "bottom", "top")
    numbers = [_finite(f"{name}.{field}", getattr(item, field)) for field in fields]
    opening = Opening(item.kind, *numbers)
    if max(abs(n) for n in numbers) > MAX_COORDINATE or opening.width <= MIN_LENGTH or opening.thickness < 0:
        raise GalocError(
            f"{name} of width {opening.width:g} m and thickness {opening.thickness:g} m",
            f"a width above 0, a thickness of at least 0 and coordinates within +-{MAX_COORDINATE:g} m",
            "Give the centreline of the opening in metres.",
        )
    if not 0 <= opening.bottom < opening.top <= ceiling_height + 1e-9:
        raise GalocError(
            f"{name} from {opening.bottom:g} m to {opening.top:g} m under a ceiling of {ceiling_height:g} m",
            "0 <= bottom < top <= ceiling height",
            "Fix the sill and head heights, or the ceiling height.",
        )
    return opening
