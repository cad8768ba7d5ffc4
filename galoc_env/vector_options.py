"""Seeds and options of a batched reset, lane by lane."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from galoc import GalocError
from galoc_env.settings import Settings, checked_options

_RANK = {"pose": 1, "plan_seed": 0}
"""Dimensions of each option's value for a single lane."""


def checked_mode(mode: AutoresetMode | str) -> AutoresetMode:
    """The autoreset mode of that name.

    Raises:
        GalocError: no such mode.
    """
    try:
        return AutoresetMode(mode)
    except ValueError:
        names = " or ".join(f'"{known.value}"' for known in AutoresetMode)
        raise GalocError(f"autoreset_mode = {mode!r}", names, "Pass one of these.") from None


def lane_seeds(seed: int | list[int | None] | None, lanes: int) -> list[int | None]:
    """One seed per lane: s gives s, s + 1, ...; a list is taken as it is.

    Raises:
        GalocError: no whole numbers, or a list that does not fit the lanes.
    """
    if seed is None:
        return [None] * lanes
    if isinstance(seed, int | np.integer):
        return [int(seed) + lane for lane in range(lanes)]
    if not hasattr(seed, "__len__") or any(s is not None and not isinstance(s, int | np.integer) for s in seed):
        raise GalocError(f"seed = {seed!r}", "a whole number, or one for each lane", "Pass seed=0, say.")
    if len(seed) != lanes:
        raise GalocError(f"{len(seed)} seeds", f"one for each of {lanes} lanes", "Pass one number for all, or as many.")
    return [None if s is None else int(s) for s in seed]


def reset_mask(options: dict[str, Any] | None, lanes: int) -> NDArray[np.bool_]:
    """(L,) which lanes to reset: all of them, unless the options say otherwise.

    Raises:
        GalocError: not a bool array of one element per lane, or nothing to reset.
    """
    mask = options.get("reset_mask") if isinstance(options, dict) else None
    if mask is None:
        return np.ones(lanes, np.bool_)
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (lanes,) or not mask.any():
        expected = f"a bool array of shape ({lanes},) with at least one True"
        raise GalocError(f"reset_mask = {mask!r}", expected, "Pass np.logical_or(terminations, truncations), say.")
    return mask


def lane_options(options: dict[str, Any] | None, lanes: int, settings: Settings) -> list[dict[str, Any]]:
    """The single environment's options for every lane.

    Raises:
        GalocError: an option that the single environment refuses, or values that do not fit the lanes.
    """
    if not isinstance(options, dict):
        return [checked_options(options, settings)] * lanes
    shared = {key: value for key, value in options.items() if key != "reset_mask"}
    own = {key: shared.pop(key) for key in list(shared) if key in _RANK and _has_lanes(shared[key], _RANK[key])}
    for key, values in own.items():
        if len(values) != lanes:
            raise GalocError(
                f"{len(values)} values of {key!r}", f"one for each of {lanes} lanes", "Pass one or as many."
            )
    rows = ({key: values[lane] for key, values in own.items() if values[lane] is not None} for lane in range(lanes))
    return [checked_options({**shared, **row}, settings) for row in rows]


def _has_lanes(value: Any, rank: int) -> bool:
    """Whether a value is one per lane: a dimension more than a single one has, or a list with gaps."""
    if isinstance(value, np.ndarray):
        return value.ndim == rank + 1
    if not isinstance(value, list | tuple):
        return False
    return rank == 0 or any(v is None or isinstance(v, list | tuple | np.ndarray) for v in value)
