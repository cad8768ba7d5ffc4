"""Holes in walls: frames of reference for them, and the lintel, lining and casing of doors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from galoc_env.scene.light import Lighting, height_gradient
from galoc_env.scene.mesh import DOOR, FLOOR, MeshBuilder
from galoc_env.scene.rooms import Rooms
from galoc_env.scene.solids import SolidPainter
from galoc_env.scene.styles import Style, Trim
from galoc_env.scene.walls import OVERLAP

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan, Opening

Array = NDArray[np.float64]

MIN_DEPTH = 0.02
"""Least thickness that a lintel is drawn with, m."""
LINING, CASING_DEPTH = 0.02, 0.012
"""Thickness of the boards in the door opening; how far casing stands off the wall, m."""


@dataclass(frozen=True, slots=True, eq=False)
class Hole:
    """An opening with the directions and rooms around it."""

    opening: Opening
    """What the plan says."""
    middle: Array
    """(2,) m."""
    along: Array
    """(2,) unit vector along the centreline."""
    normal: Array
    """(2,) unit vector to its left."""
    depth: float
    """Thickness of the wall, drawn at least ``MIN_DEPTH``, m."""
    rooms: tuple[int, int]
    """Rooms on the left and on the right."""
    styles: tuple[Style, Style]
    """Their styles."""

    def painter(self, builder: MeshBuilder, lighting: Lighting, instance: int, side: float = 1.0) -> SolidPainter:
        """Frame with its origin in the middle, x along the centreline and y to its left; turned by half for -1."""
        heading = math.atan2(side * self.along[1], side * self.along[0])
        light = (self.styles[0].light + self.styles[1].light) / 2
        x, y = float(self.middle[0]), float(self.middle[1])
        return SolidPainter(builder, lighting, x, y, heading, light, instance)


def find_holes(plan: Floorplan, rooms: Rooms) -> list[Hole]:
    """All openings wide enough to be drawn."""
    openings = [o for o in plan.openings if o.width > 0.1]
    ends = np.array([(o.x1, o.y1, o.x2, o.y2) for o in openings]).reshape(-1, 2, 2)
    middle, delta = ends.mean(axis=1), ends[:, 1] - ends[:, 0]
    along = delta / np.maximum(np.linalg.norm(delta, axis=1), 1e-9)[:, None]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    depth = np.array([max(o.thickness, MIN_DEPTH) for o in openings])
    off = (depth / 2 + 0.05)[:, None] * normal
    found = np.stack([rooms.at(middle + off), rooms.at(middle - off)], axis=1)
    return [
        Hole(o, middle[k], along[k], normal[k], float(depth[k]), (int(found[k, 0]), int(found[k, 1])),
             (rooms.style(int(found[k, 0])), rooms.style(int(found[k, 1]))))
        for k, o in enumerate(openings)
    ]  # fmt: skip


def add_doorways(builder: MeshBuilder, plan: Floorplan, holes: list[Hole], trim: Trim, lighting: Lighting) -> None:
    """Lintel, lining, casing and step of all doors: one instance each, and one of class FLOOR for the step."""
    import shapely

    walls = shapely.multilinestrings(shapely.linestrings(plan.segments.reshape(-1, 2, 2)))
    shapely.prepare(walls)
    for hole in holes:
        if hole.opening.kind == "door":
            _add_doorway(builder, plan, hole, trim, lighting, walls)


def _add_doorway(
    builder: MeshBuilder, plan: Floorplan, hole: Hole, trim: Trim, lighting: Lighting, walls: object
) -> None:
    door = hole.opening
    paint = hole.painter(builder, lighting, builder.new_instance(DOOR))
    half, top = door.width / 2, min(door.top, plan.ceiling_height)
    if top < plan.ceiling_height - 1e-6:
        _add_lintel(builder, plan, lighting, hole, paint.instance)
    reach = hole.depth / 2 + CASING_DEPTH
    name, tint = trim.casing.name, trim.casing.tint
    for low, high in ((-half, -half + LINING), (half - LINING, half)):
        paint.box(name, (low, -reach, 0.0), (high, reach, top), tint)
    paint.box(name, (-half + LINING, -reach, top - LINING), (half - LINING, reach, top), tint)
    _add_casing(plan, hole, trim, paint, top, walls)
    paint.flush()
    step = builder.new_instance(FLOOR)
    along, across = (np.array([*v, 0.0]) for v in (door.width * hole.along, hole.depth * hole.normal))
    corner = np.array([*hole.middle, 0.004]) - along / 2 - across / 2
    wood = trim.casing.name if trim.casing.name != "lacquer" else "wood"
    builder.add_quad(wood, corner, along, across, 0.7, step)


def _add_lintel(builder: MeshBuilder, plan: Floorplan, lighting: Lighting, hole: Hole, instance: int) -> None:
    """The wall above a door, in the walls' materials."""
    along, height = np.array([*(hole.opening.width * hole.along), 0.0]), plan.ceiling_height
    for style, sign in zip(hole.styles, (1.0, -1.0), strict=True):
        right = -sign * along
        foot = np.array([*(hole.middle + sign * hole.depth / 2 * hole.normal), 0.0]) - right / 2
        low = hole.opening.top
        for top, coat in style.bands(sign * hole.normal, height):
            high = min(top, height + OVERLAP)
            if high <= low:
                continue
            light = style.light * lighting.wall(sign * hole.normal) * height_gradient([low, low, high, high], height)
            up = np.array([0.0, 0.0, high - low])
            builder.add_quad(coat.name, foot + [0, 0, low], right, up, light, instance, (0.0, low), tint=coat.tint)
            low = high


def _add_casing(plan: Floorplan, hole: Hole, trim: Trim, paint: SolidPainter, top: float, walls: object) -> None:
    """Boards on the wall around the door, where there is wall beside it to carry them."""
    import shapely

    half, width, thickness = hole.opening.width / 2, trim.casing_width, hole.opening.thickness
    name, tint = trim.casing.name, trim.casing.tint
    places = [(side, end) for side in (1.0, -1.0) for end in (-1.0, 1.0)]
    beside = [
        hole.middle + side * thickness / 2 * hole.normal + end * (half + width / 2) * hole.along for side, end in places
    ]
    carried = shapely.distance(walls, shapely.points(beside)) < 0.015
    for side in (1.0, -1.0):
        near, far = sorted((side * hole.depth / 2, side * (hole.depth / 2 + CASING_DEPTH)))
        wall, ends = "y" if side > 0 else "Y", []
        for (here, end), on_wall in zip(places, carried, strict=True):
            if here != side:
                continue
            ends.append(half + (width if on_wall else 0.0))
            if on_wall:
                low, high = sorted((end * half, end * ends[-1]))
                paint.box(name, (low, near, 0.0), (high, far, top), tint, hide=wall)
        if top + width < plan.ceiling_height:
            paint.box(name, (-ends[0], near, top), (ends[1], far, top + width), tint, hide=wall)
