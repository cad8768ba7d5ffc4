"""What tells one end of a corridor from the other: alcoves, bays and stairwells."""

from __future__ import annotations

import numpy as np

from galoc_env.ambiguous_parts import Part, box
from galoc_env.wall_builder import door

ENDS = ("alcove", "bay", "stairs")
"""Kinds of ends."""


def draw_end(rng: np.random.Generator, x: float, hall: float, kind: str) -> Part:
    """What lies beyond the right-hand end of a corridor from y = -hall to 0.

    Args:
        rng: source of randomness.
        x: where the corridor would end, m.
        hall: its width, m.
        kind: "alcove": the corridor goes on for a bit; "bay": it goes on and widens; "stairs": a room behind a door.

    Returns:
        For "stairs" the room and its door, else rectangles that the corridor grows by.
    """
    if kind == "stairs":
        length, below, above = _cm(rng, 2.4, 3.4), _cm(rng, 0.0, 1.2), _cm(rng, 0.3, 1.6)
        room = box(x, -hall - below, x + length, above)
        return Part((room,), (door(x, -hall / 2.0, min(1.0, round(hall - 0.5, 2))),))
    length, side, up = _cm(rng, 1.2, 2.4), _cm(rng, 0.8, 1.6), rng.random() < 0.5
    grown = Part((box(x, -hall, x + length, 0.0),))
    if kind == "bay":
        grown += Part((box(x, 0.0, x + length, side) if up else box(x, -hall - side, x + length, -hall),))
    return grown


def _cm(rng: np.random.Generator, low: float, high: float) -> float:
    """A length drawn at random, m, whole centimetres."""
    return round(float(rng.uniform(low, high)), 2)
