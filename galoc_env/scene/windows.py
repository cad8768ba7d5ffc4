"""Windows: reveal, frame, casements with glazing bars, sill, and the bright outdoors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from galoc_env.scene.light import Lighting
from galoc_env.scene.mesh import OUTSIDE, WINDOW, MeshBuilder
from galoc_env.scene.openings import Hole
from galoc_env.scene.solids import SolidPainter
from galoc_env.scene.styles import Trim

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan

Array = NDArray[np.float64]
Look = tuple[str, Array]
"""Material and tint."""

FRAME, FRAME_DEPTH, SASH, BEAD, SILL = 0.05, 0.05, 0.05, 0.02, 0.03
"""Width and depth of a window's frame; width of a casement's and of the slope at its glass; how far a sill stands out:
m."""
_CASEMENT = 0.85
"""Casements are at most this wide, m."""
GLOW = (1.1, 1.7)
"""Brightness of the outdoors as a lamp, by the day."""
_EXPOSED, _BURNT = (0.95, 1.4), (1.6, 2.6)
"""Brightness of the outdoors as it is seen: most cameras show it somewhat too bright, some nearly white."""
TOP = 2.95
"""What the picture of the outdoors shows reaches this high, m."""


def add_windows(
    builder: MeshBuilder, plan: Floorplan, holes: list[Hole], trim: Trim, lighting: Lighting, rng: np.random.Generator
) -> None:
    """Two instances each: the window, and what is seen through it."""
    glow, sill = float(rng.uniform(*GLOW)), float(rng.uniform(SILL, 0.14))
    exposure = float(rng.uniform(*_EXPOSED if rng.uniform() < 0.7 else _BURNT))
    for hole in holes:
        low, high = span(plan, hole)
        if hole.opening.kind == "window" and high - low >= 0.1:
            _add_window(builder, hole, low, high, trim, lighting, sill)
            # What is seen through windows of one front of the house matches.
            front = "outdoors" if abs(hole.along[0]) > abs(hole.along[1]) else "outdoors.1"
            _add_pane(builder, hole, low, high, front, glow, exposure / glow)


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
    instance = builder.new_instance(WINDOW)
    d = min(FRAME_DEPTH, hole.depth) / 2
    for side, room in zip((1.0, -1.0), hole.rooms, strict=True):
        # Nobody sees a window from outside a house.
        if room >= 0 or inner_side(hole) == 0.0:
            paint = hole.painter(builder, lighting, instance, side)
            _add_frame(paint, trim, (-half, low), (half, high), d)
            paint.flush()
    if depth > 2 * d:
        _add_reveal(builder, lighting, hole, low, high, instance)
    if depth > 0.02 and low > 0.1:
        paint = hole.painter(builder, lighting, instance, inner_side(hole) or 1.0)
        name, tint = trim.window.name, trim.window.tint
        board = "marble" if sill > 0.11 and name == "lacquer" else name
        paint.box(board, (-half - 0.04, depth / 2, low - 0.03), (half + 0.04, depth / 2 + sill, low), tint, hide="y")
        paint.box(name, (-half - 0.03, -depth / 2 - SILL, low - 0.03), (half + 0.03, -depth / 2, low), tint, hide="Y")
        paint.flush()


def _add_frame(
    paint: SolidPainter, trim: Trim, low: tuple[float, float], high: tuple[float, float], depth: float
) -> None:
    """What one side shows of frame and casements: corners (x, z), the frame's face ``depth`` before the pane, m."""
    name, tint = trim.window.name, trim.window.tint
    (x0, z0), (x1, z1) = low, high
    count = max(1, round((x1 - x0 - 0.2) / _CASEMENT + 0.3))
    wide = (x1 - x0 - 2 * FRAME) / count
    opens = wide > 0.3 and z1 - z0 > 0.4
    # A casement stands proud of the frame, which goes on behind its edge.
    _rim(paint, (name, tint), low, high, FRAME + (0.012 if opens else 0.0), depth)
    if not opens:
        _bead(paint, (name, tint), (x0 + FRAME, z0 + FRAME), (x1 - FRAME, z1 - FRAME), depth)
        return
    for k in range(count):
        left = x0 + FRAME + k * wide
        handle = count == 1 or k < count - 1
        _casement(paint, trim, (left, z0 + FRAME), (left + wide, z1 - FRAME), depth + 0.008, handle=handle)


def _rim(
    paint: SolidPainter, look: Look, low: tuple[float, float], high: tuple[float, float], width: float, depth: float
) -> None:
    """The face of four boards around a rectangle (x, z).

    A board has no sides: those that touch the pane would be black where they go on behind it, and flicker.
    """
    (x0, z0), (x1, z1) = low, high
    boards = (
        (x0, z0, x0 + width, z1),
        (x1 - width, z0, x1, z1),
        (x0 + width, z0, x1 - width, z0 + width),
        (x0 + width, z1 - width, x1 - width, z1),
    )
    paint.polygons(look[0], [_face(board, depth) for board in boards], look[1])


def _face(board: tuple[float, float, float, float], depth: float) -> list[tuple[float, float, float]]:
    """A rectangle x0, z0, x1, z1 that looks along +y; a viewer there has x running to the left."""
    x0, z0, x1, z1 = board
    return [(x1, depth, z0), (x0, depth, z0), (x0, depth, z1), (x1, depth, z1)]


def _bead(paint: SolidPainter, look: Look, low: tuple[float, float], high: tuple[float, float], depth: float) -> None:
    """The slope from a rim's inner edge (x, z) down to the glass: it faces the room as much as its own glass."""
    (x0, z0), (x1, z1) = low, high
    w = BEAD * min(1.0, depth / 0.033)
    outer = np.array([(x0, depth, z0), (x1, depth, z0), (x1, depth, z1), (x0, depth, z1)])
    inner = np.array(
        [(x0 + w, 0.003, z0 + w), (x1 - w, 0.003, z0 + w), (x1 - w, 0.003, z1 - w), (x0 + w, 0.003, z1 - w)]
    )
    after, beyond = np.roll(outer, -1, axis=0), np.roll(inner, -1, axis=0)
    paint.polygons(look[0], np.stack([after, outer, inner, beyond], axis=1), look[1])


def _casement(
    paint: SolidPainter, trim: Trim, low: tuple[float, float], high: tuple[float, float], depth: float, *, handle: bool
) -> None:
    """A casement with glazing bars and a handle; bars are strips, for the reason that boards have no sides."""
    look = trim.window.name, 0.97 * trim.window.tint
    width = SASH - BEAD / 2
    x0, x1, z0, z1 = low[0] + width, high[0] - width, low[1] + width, high[1] - width
    _rim(paint, look, low, high, width, depth)
    _bead(paint, look, (x0, z0), (x1, z1), depth)
    upright, level = trim.bars
    x = x0 + (x1 - x0) * (np.arange(upright) + 1) / (upright + 1)
    # One bar alone stands high: a fanlight.
    z = z0 + (z1 - z0) * ((np.arange(level) + 1) / (level + 1) if level > 1 or upright else np.full(level, 0.72))
    boards = [(v - 0.013, z0 + BEAD / 2, v + 0.013, z1 - BEAD / 2) for v in x]
    boards += [(x0 + BEAD / 2, v - 0.013, x1 - BEAD / 2, v + 0.013) for v in z]
    for k, board in enumerate(boards):
        # Where bars cross, those that run level lie behind.
        paint.polygons(look[0], [_face(board, 0.012 if k < upright else 0.010)], look[1])
    if handle:
        x_, z_ = high[0] - width / 2, (z0 + z1) / 2 - 0.1
        paint.box("metal", (x_ - 0.01, depth, z_), (x_ + 0.01, depth + 0.035, z_ + 0.11), 0.9, hide="y")


def _add_reveal(builder: MeshBuilder, lighting: Lighting, hole: Hole, low: float, high: float, instance: int) -> None:
    """The four inner faces of the hole, from the pane to each face of the wall."""
    for side, room in zip((1.0, -1.0), hole.rooms, strict=True):
        # A tint of its own keeps the half outside a face of its own, so that its darkness does not reach the room.
        tint = 1.0 if room >= 0 else 0.9
        along, up = side * np.array([*hole.along, 0.0]), np.array([0.0, 0.0, high - low])
        across = side * np.array([*hole.normal, 0.0]) * hole.opening.thickness / 2
        wide = along * hole.opening.width
        corner = np.array([*hole.middle, low]) - wide / 2
        # Each parallelogram faces into the hole: right x up points there.
        for origin, right, rise, normal3 in (
            (corner, across, up, along),
            (corner + wide + across, -across, up, -along),
            (corner, wide, across, np.array([0.0, 0.0, 1.0])),
            (corner + up + across, wide, -across, np.array([0.0, 0.0, -1.0])),
        ):
            light = 0.5 + 0.5 * lighting.facing(normal3)
            builder.add_quad("lacquer", origin, right, rise, light, instance, tint=tint)


def _add_pane(builder: MeshBuilder, hole: Hole, low: float, high: float, name: str, glow: float, tint: float) -> None:
    """The outdoors, seen from both sides: ``glow`` is what it sheds, and ``tint`` tells how it is exposed."""
    window = hole.opening
    instance = builder.new_instance(OUTSIDE)
    along, up = np.array([window.x2 - window.x1, window.y2 - window.y1, 0.0]), np.array([0.0, 0.0, high - low])
    start = np.array([window.x1, window.y1, low])
    # The picture ends above: a high window shows its upper end.
    shift = float(window.x1 + window.y1) % 5.0, low - max(0.0, high - TOP)
    builder.add_quad(name, start, along, up, 1.0, instance, shift, tint=tint, glow=glow)
    builder.add_quad(name, start + along, -along, up, 1.0, instance, shift, tint=tint, glow=glow)
