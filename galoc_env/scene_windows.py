"""Windows: reveal, frame, casements with glazing bars, sill, and the bright outdoors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from galoc_env.scene_light import Lighting
from galoc_env.scene_mesh import OUTSIDE, WINDOW, MeshBuilder
from galoc_env.scene_openings import Hole
from galoc_env.scene_solids import SolidPainter
from galoc_env.scene_styles import Trim

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan

Array = NDArray[np.float64]

FRAME, FRAME_DEPTH, SASH, SILL = 0.05, 0.05, 0.045, 0.03
"""Width and depth of a window's frame; width of a casement's; how far a sill stands out, m."""
_CASEMENT = 0.85
"""Casements are at most this wide, m."""


def add_windows(
    builder: MeshBuilder, plan: Floorplan, holes: list[Hole], trim: Trim, lighting: Lighting, rng: np.random.Generator
) -> None:
    """Two instances each: the window, and what is seen through it."""
    glow, sill = float(rng.uniform(1.0, 1.6)), float(rng.uniform(SILL, 0.14))
    for hole in holes:
        low, high = span(plan, hole)
        if hole.opening.kind == "window" and high - low >= 0.1:
            _add_window(builder, hole, low, high, trim, lighting, sill)
            # What is seen through windows of one front of the house matches.
            front = "outdoors" if abs(hole.along[0]) > abs(hole.along[1]) else "outdoors.1"
            _add_pane(builder, hole, low, high, front, glow)


def span(plan: Floorplan, hole: Hole) -> tuple[float, float]:
    """Lower and upper end of a window between floor and ceiling, m."""
    return max(hole.opening.bottom, 0.0), min(hole.opening.top, plan.ceiling_height)


def inner_side(hole: Hole) -> float:
    """The side that has a room: left (1) or right (-1); 0 for none."""
    return 1.0 if hole.rooms[0] >= 0 else -1.0 if hole.rooms[1] >= 0 else 0.0


def _add_window(
    builder: MeshBuilder, hole: Hole, low: float, high: float, trim: Trim, lighting: Lighting, sill: float
) -> None:
    depth, half = hole.opening.thickness, hole.opening.width / 2
    side = inner_side(hole)
    paint = hole.painter(builder, lighting, builder.new_instance(WINDOW), side or 1.0)
    d = min(FRAME_DEPTH, hole.depth) / 2
    name, tint = trim.window.name, trim.window.tint
    _frame(paint, name, tint, (-half, low), (half, high), FRAME, d)
    count = max(1, round((2 * half - 0.2) / _CASEMENT + 0.3))
    wide = (2 * half - 2 * FRAME) / count
    for k in range(count):
        x0, x1 = -half + FRAME + k * wide, -half + FRAME + (k + 1) * wide
        if wide > 0.3 and high - low > 0.4:
            _casement(paint, trim, (x0, low + FRAME), (x1, high - FRAME), d, handle=count == 1 or k < count - 1)
    if depth > 2 * d:
        _add_reveal(builder, lighting, hole, low, high, paint.instance)
    if depth > 0.02 and low > 0.1:
        board = "marble" if sill > 0.11 and trim.window.name == "lacquer" else name
        paint.box(board, (-half - 0.04, depth / 2, low - 0.03), (half + 0.04, depth / 2 + sill, low), tint, hide="y")
        paint.box(name, (-half - 0.03, -depth / 2 - SILL, low - 0.03), (half + 0.03, -depth / 2, low), tint, hide="Y")
    paint.flush()


def _frame(
    paint: SolidPainter,
    name: str,
    tint: Array,
    low: tuple[float, float],
    high: tuple[float, float],
    width: float,
    depth: float,
) -> None:
    """Four boards around a rectangle (x, z), centred on the wall's middle plane."""
    (x0, z0), (x1, z1) = low, high
    a = [(x0, -depth, z0), (x1 - width, -depth, z0)]
    b = [(x0 + width, depth, z1), (x1, depth, z1)]
    paint.box(name, a, b, tint, hide="zZ")
    a = [(x0 + width, -depth, z0), (x0 + width, -depth, z1 - width)]
    b = [(x1 - width, depth, z0 + width), (x1 - width, depth, z1)]
    paint.box(name, a, b, tint, hide="xX")


def _casement(
    paint: SolidPainter, trim: Trim, low: tuple[float, float], high: tuple[float, float], depth: float, *, handle: bool
) -> None:
    """A casement that stands a little out of its frame, with glazing bars and a handle on the inner side."""
    name, tint = trim.window.name, trim.window.tint
    _frame(paint, name, 0.97 * tint, low, high, SASH, depth + 0.008)
    x0, x1, z0, z1 = low[0] + SASH, high[0] - SASH, low[1] + SASH, high[1] - SASH
    upright, level = trim.bars
    for k in range(upright):
        x = x0 + (x1 - x0) * (k + 1) / (upright + 1)
        paint.box(name, (x - 0.012, -0.012, z0), (x + 0.012, 0.012, z1), tint, hide="zZ")
    for k in range(level):
        # One bar alone stands high: a fanlight.
        z = z0 + (z1 - z0) * ((k + 1) / (level + 1) if level > 1 or upright else 0.72)
        paint.box(name, (x0, -0.012, z - 0.012), (x1, 0.012, z + 0.012), tint, hide="xX")
    if handle:
        x, z, y = high[0] - SASH / 2, (z0 + z1) / 2 - 0.1, depth + 0.008
        paint.box("metal", (x - 0.01, y, z), (x + 0.01, y + 0.035, z + 0.11), 0.9, hide="y")


def _add_reveal(builder: MeshBuilder, lighting: Lighting, hole: Hole, low: float, high: float, instance: int) -> None:
    """The four inner faces of the hole, over the thickness of the wall."""
    along, up = np.array([*hole.along, 0.0]), np.array([0.0, 0.0, high - low])
    across, wide = np.array([*hole.normal, 0.0]) * hole.opening.thickness, along * hole.opening.width
    corner = np.array([*hole.middle, low]) - wide / 2 - across / 2
    # Each parallelogram faces into the hole: right x up points there.
    for origin, right, rise, normal3 in (
        (corner, across, up, along),
        (corner + wide + across, -across, up, -along),
        (corner, wide, across, np.array([0.0, 0.0, 1.0])),
        (corner + up + across, wide, -across, np.array([0.0, 0.0, -1.0])),
    ):
        light = 0.5 + 0.5 * lighting.facing(normal3)
        builder.add_quad("lacquer", origin, right, rise, light, instance)


def _add_pane(builder: MeshBuilder, hole: Hole, low: float, high: float, name: str, glow: float) -> None:
    """The outdoors, seen from both sides."""
    window = hole.opening
    instance = builder.new_instance(OUTSIDE)
    along, up = np.array([window.x2 - window.x1, window.y2 - window.y1, 0.0]), np.array([0.0, 0.0, high - low])
    start = np.array([window.x1, window.y1, low])
    shift = float(window.x1 + window.y1) % 5.0
    builder.add_quad(name, start, along, up, 1.0, instance, (shift, low), glow=glow)
    builder.add_quad(name, start + along, -along, up, 1.0, instance, (shift, low), glow=glow)
