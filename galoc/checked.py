"""Checks of numbers, poses and places that callers give, each with an error that names the argument."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.errors import GalocError
from galoc.floorplan import Floorplan


def number(name: str, value: object, least: float, most: float, unit: str = "", cure: str = "Fix it.") -> float:
    """A real number as float.

    Args:
        name: of the argument.
        value: what was given.
        least: smallest value that is accepted.
        most: largest; infinity only where this is infinite.
        unit: for the message.
        cure: for the message.

    Raises:
        GalocError: no real number (strings, booleans and NaN are none), or out of range.
    """
    real = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not real or not least <= value <= most:  # type: ignore[operator]  # NaN compares false
        raise GalocError(f"{name} = {value!r}", f"a number{_span(least, most)}{unit and f' ({unit})'}", cure)
    return float(value)  # type: ignore[arg-type]


def whole(name: str, value: object, least: int, cure: str = "Fix it.") -> int:
    """A whole number from ``least`` up as int.

    Raises:
        GalocError: no whole number (booleans and 2.0 are none), or too small.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise GalocError(f"{name} = {value!r}", f"a whole number, {least} or more", cure)
    return int(value)


def three(name: str, value: ArrayLike, parts: str) -> NDArray[np.float64]:
    """(3,) finite numbers: a pose or a motion, m and rad.

    Raises:
        GalocError: anything else.
    """
    found = _array(value)
    if found.shape != (3,) or not np.all(np.abs(found) < 1e300):  # products of these stay finite; NaN compares false
        raise GalocError(f"{name} {value!r}", f"{parts}, three finite numbers in m and rad", "Fix it.")
    return found


def place_inside(plan: Floorplan, xy: ArrayLike) -> NDArray[np.float64]:
    """(2,) m: a position inside the building.

    Raises:
        GalocError: anything else.
    """
    found = _array(xy)
    if found.shape != (2,) or not plan.free_space(0.05).clearance_at(found) > 0.0:
        raise GalocError(f"position {xy!r}", "(x, y) in m, inside the building and not in a wall", "Fix it.")
    return found


def _array(value: ArrayLike) -> NDArray[np.float64]:
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        return np.empty(0)  # refused by its shape


def _span(least: float, most: float) -> str:
    if math.isinf(most):
        return "" if math.isinf(least) else f", {least:g} or more"
    return f", {most:g} or less" if math.isinf(least) else f" from {least:g} to {most:g}"
