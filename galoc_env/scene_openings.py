"""Doors and windows: lintel, lining and casing; reveal, frame, sill and the bright outdoors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from galoc_env.scene_light import Lighting, height_gradient
from galoc_env.scene_mesh import DOOR, FLOOR, OUTSIDE, WINDOW, MeshBuilder
from galoc_env.scene_rooms import Rooms, Style
from galoc_env.scene_solids import SolidPainter
from galoc_env.scene_walls import OVERLAP

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan, Opening

Array = NDArray[np.float64]

MIN_DEPTH = 0.02
"""Least thickness that a lintel is drawn with, m."""
LINING, CASING_DEPTH, CASING_WIDTH = 0.02, 0.012, 0.06
"""Thickness of the boards in the door opening; how far casing stands off the wall, and how wide it is, m."""
FRAME, FRAME_DEPTH, SILL = 0.05, 0.05, 0.025
"""Width and depth of a window's frame; how far its sill stands out, m."""


def add_openings(builder: MeshBuilder, plan: Floorplan, rooms: Rooms, lighting: Lighting) -> None:
    """All openings of the plan: one instance per door; one per window, and one for what is seen through it."""
    for opening in plan.openings:
        if opening.width > 0.1:
            (_add_door if opening.kind == "door" else _add_window)(builder, plan, rooms, lighting, opening)


def _styles(opening: Opening, rooms: Rooms, depth: float) -> tuple[Style, Style]:
    """Styles of the rooms on the left and on the right of the centreline."""
    middle, normal = _middle(opening)
    found = rooms.at([middle + (depth / 2 + 0.05) * normal, middle - (depth / 2 + 0.05) * normal])
    return rooms.style(int(found[0])), rooms.style(int(found[1]))


def _middle(opening: Opening) -> tuple[Array, Array]:
    heading = math.atan2(opening.y2 - opening.y1, opening.x2 - opening.x1)
    middle = np.array([opening.x1 + opening.x2, opening.y1 + opening.y2]) / 2
    return middle, np.array([-math.sin(heading), math.cos(heading)])


def _painter(builder: MeshBuilder, lighting: Lighting, opening: Opening, light: float, semantic: int) -> SolidPainter:
    """Frame with its origin in the middle of the opening and x along the centreline."""
    middle, _ = _middle(opening)
    heading = math.atan2(opening.y2 - opening.y1, opening.x2 - opening.x1)
    x, y = float(middle[0]), float(middle[1])
    return SolidPainter(builder, lighting, x, y, heading, light, builder.new_instance(semantic))


def _add_door(builder: MeshBuilder, plan: Floorplan, rooms: Rooms, lighting: Lighting, door: Opening) -> None:
    depth = max(door.thickness, MIN_DEPTH)
    styles = _styles(door, rooms, depth)
    paint = _painter(builder, lighting, door, (styles[0].light + styles[1].light) / 2, DOOR)
    half, top = door.width / 2, min(door.top, plan.ceiling_height)
    if top < plan.ceiling_height - 1e-6:
        _add_lintel(builder, plan, lighting, door, styles, depth, paint.instance)
    reach = depth / 2 + CASING_DEPTH
    for sign in (-1.0, 1.0):
        low, high = sorted((sign * half, sign * (half - LINING)))
        paint.box("lacquer", (low, -reach, 0.0), (high, reach, top))
    paint.box("lacquer", (-half + LINING, -reach, top - LINING), (half - LINING, reach, top))
    _add_casing(plan, door, paint, depth, top)
    step = builder.new_instance(FLOOR)
    corner = np.array([*_middle(door)[0], 0.004])
    along = np.array([door.x2 - door.x1, door.y2 - door.y1, 0.0])
    across = np.array([*(_middle(door)[1] * depth), 0.0])
    builder.add_quad("wood", corner - along / 2 - across / 2, along, across, 0.7, step)


def _add_lintel(
    builder: MeshBuilder,
    plan: Floorplan,
    lighting: Lighting,
    door: Opening,
    styles: tuple[Style, Style],
    depth: float,
    instance: int,
) -> None:
    """The wall above a door, in the walls' materials."""
    middle, normal = _middle(door)
    along = np.array([door.x2 - door.x1, door.y2 - door.y1, 0.0])
    rows = (door.top, (door.top + plan.ceiling_height) / 2, plan.ceiling_height + OVERLAP)
    for style, sign in zip(styles, (1.0, -1.0), strict=True):
        right = -sign * along
        foot = np.array([*(middle + sign * depth / 2 * normal), 0.0]) - right / 2
        for low, high in zip(rows[:-1], rows[1:], strict=True):
            light = (
                style.light
                * lighting.wall(sign * normal)
                * height_gradient([low, low, high, high], plan.ceiling_height)
            )
            up = np.array([0.0, 0.0, high - low])
            builder.add_quad(
                style.wall, foot + [0, 0, low], right, up, light, instance, (0.0, low), tint=style.wall_tint
            )


def _add_casing(plan: Floorplan, door: Opening, paint: SolidPainter, depth: float, top: float) -> None:
    """Boards on the wall around the door, where there is wall beside it to carry them."""
    import shapely

    middle, normal = _middle(door)
    along = np.array([normal[1], -normal[0]])
    walls = shapely.multilinestrings(shapely.linestrings(plan.segments.reshape(-1, 2, 2)))
    for side in (1.0, -1.0):
        near, far = sorted((side * depth / 2, side * (depth / 2 + CASING_DEPTH)))
        ends = []
        for sign in (-1.0, 1.0):
            beside = middle + side * door.thickness / 2 * normal + sign * (door.width / 2 + CASING_WIDTH / 2) * along
            carried = shapely.distance(walls, shapely.points(beside)) < 0.015
            ends.append(door.width / 2 + (CASING_WIDTH if carried else 0.0))
            if carried:
                low, high = sorted((sign * door.width / 2, sign * ends[-1]))
                paint.box("lacquer", (low, near, 0.0), (high, far, top))
        if top + CASING_WIDTH < plan.ceiling_height:
            paint.box("lacquer", (-ends[0], near, top), (ends[1], far, top + CASING_WIDTH))


def _add_window(builder: MeshBuilder, plan: Floorplan, rooms: Rooms, lighting: Lighting, window: Opening) -> None:
    depth, half = window.thickness, window.width / 2
    low, high = max(window.bottom, 0.0), min(window.top, plan.ceiling_height)
    if high - low < 0.1:
        return
    styles = _styles(window, rooms, depth)
    paint = _painter(builder, lighting, window, max(styles[0].light, styles[1].light), WINDOW)
    d = min(FRAME_DEPTH, max(depth, MIN_DEPTH)) / 2
    for a, b in (((-half, low), (-half + FRAME, high)), ((half - FRAME, low), (half, high))):
        paint.box("lacquer", (a[0], -d, a[1]), (b[0], d, b[1]))
    inner = half - FRAME
    for a, b in (((-inner, low), (inner, low + FRAME)), ((-inner, high - FRAME), (inner, high))):
        paint.box("lacquer", (a[0], -d, a[1]), (b[0], d, b[1]))
    if window.width > 1.2:
        paint.box("lacquer", (-FRAME / 2, -d, low + FRAME), (FRAME / 2, d, high - FRAME))
    if depth > 2 * d:
        _add_reveal(builder, lighting, window, low, high, paint.instance)
    if depth > 0.02 and low > 0.1:
        reach = depth / 2 + SILL
        paint.box("lacquer", (-half - 0.03, depth / 2, low - 0.03), (half + 0.03, reach, low))
        paint.box("lacquer", (-half - 0.03, -reach, low - 0.03), (half + 0.03, -depth / 2, low))
    _add_pane(builder, window, low, high)


def _add_reveal(
    builder: MeshBuilder, lighting: Lighting, window: Opening, low: float, high: float, instance: int
) -> None:
    """The four inner faces of the hole, over the thickness of the wall."""
    middle, normal = _middle(window)
    along = np.array([normal[1], -normal[0], 0.0])
    across, up = np.array([*normal, 0.0]) * window.thickness, np.array([0.0, 0.0, high - low])
    wide = along * window.width
    corner = np.array([*middle, low]) - wide / 2 - across / 2
    # Each parallelogram faces into the hole: right x up points there.
    for origin, right, rise, normal3 in (
        (corner, across, up, along),
        (corner + wide + across, -across, up, -along),
        (corner, wide, across, np.array([0.0, 0.0, 1.0])),
        (corner + up + across, wide, -across, np.array([0.0, 0.0, -1.0])),
    ):
        light = 0.5 + 0.5 * lighting.facing(normal3)
        builder.add_quad("lacquer", origin, right, rise, light, instance)


def _add_pane(builder: MeshBuilder, window: Opening, low: float, high: float) -> None:
    """The outdoors, at full light, seen from both sides."""
    instance = builder.new_instance(OUTSIDE)
    along, up = np.array([window.x2 - window.x1, window.y2 - window.y1, 0.0]), np.array([0.0, 0.0, high - low])
    start = np.array([window.x1, window.y1, low])
    builder.add_quad("outdoors", start, along, up, 1.0, instance, (0.0, low), glow=1.0)
    builder.add_quad("outdoors", start + along, -along, up, 1.0, instance, (0.0, low), glow=1.0)
