"""Door leaves: how far each stands open, and what it looks like."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from galoc.errors import GalocError
from galoc_env.furniture.footprint import Box
from galoc_env.scene.ground import Ground
from galoc_env.scene.light import Lighting
from galoc_env.scene.mesh import DOOR, MeshBuilder
from galoc_env.scene.rooms import Rooms, closing_lines
from galoc_env.scene.solids import SolidPainter
from galoc_env.scene.styles import Coat, Trim

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan, Opening
    from galoc_env.furniture import Furniture

Array = NDArray[np.float64]

WIDTHS = (0.55, 1.3)
"""Openings narrower or wider than this have no leaf, m."""
BARE_SHARE = 0.1
"""Share of doors whose leaf has been taken off."""
THICKNESS = 0.04
"""Of a leaf, m."""
_INSET = 0.022
"""From the end of the opening to the hinge: lining and gap, m."""
_PROUD = 0.016
"""A hinge stands this far off the wall: casing and gap, m."""
_SWINGS = ((152.0, 172.0), (82.0, 104.0), (58.0, 76.0), (108.0, 142.0))
"""Degrees from shut: against the wall, square, ajar, wide."""
_HABITS = (0.35, 0.30, 0.20, 0.15)
"""How often a door stands in each of these ways."""
_TURNS = ((-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0))
"""End of the opening that has the hinge, and face of the wall towards which the door swings."""
_GLASS = np.array([0.86, 0.93, 0.95])
"""Tint of glazed panels."""


@dataclass(frozen=True, slots=True)
class Leaf:
    """A door leaf: a board that stands on the floor from its hinge to its free edge."""

    door: int
    """Index of its opening in the plan."""
    x: float
    """Hinge, m."""
    y: float
    """Hinge, m."""
    heading: float
    """Plan bearing from the hinge to the free edge, rad."""
    length: float
    """From the hinge to the free edge, m."""
    height: float
    """m."""
    side: float
    """The board lies to the left (1) or the right (-1) of the line from the hinge, looking along it."""
    shut: bool
    """It fills its opening."""

    def box(self) -> Box:
        """Its footprint as an upright box."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        a, b = self.length / 2, self.side * THICKNESS / 2
        x, y = self.x + a * c - b * s, self.y + a * s + b * c
        return Box(x, y, self.heading, self.length, THICKNESS, self.height)


def hang_leaves(
    plan: Floorplan, items: Sequence[Furniture], shut_share: float, rng: np.random.Generator
) -> tuple[Leaf, ...]:
    """Leaves for the doors of a plan; those that find no place to stand open are left out.

    An open leaf crosses no wall, no furniture and no other leaf, and takes no place from an agent of radius 0.3 m.

    Args:
        plan: any floorplan.
        items: its furniture.
        shut_share: share of doors that are shut, 0 to 1.
        rng: source of all choices.

    Raises:
        GalocError: share out of range.
    """
    import shapely

    if isinstance(shut_share, str | bool) or not 0.0 <= shut_share <= 1.0:
        raise GalocError(f"shut_doors = {shut_share!r}", "a share from 0 (none) to 1 (all)", "Pass 0.3, say.")
    doors = [
        k for k, o in enumerate(plan.openings) if o.kind == "door" and WIDTHS[0] <= o.width <= WIDTHS[1] and o.top > 1.5
    ]
    draws = rng.uniform(size=(len(doors), 2))
    shut = set(np.argsort(draws[:, 0], kind="stable")[: round(shut_share * len(doors))].tolist())
    items = [item for item in items if not item.flat]  # a leaf sweeps over rugs
    ground = Ground(plan, items)
    walls = shapely.STRtree(shapely.linestrings(plan.segments.reshape(-1, 2, 2)))
    taken = [shapely.Polygon(item.corners()) for item in items]
    leaves = []
    for k, number in enumerate(doors):
        # All are opened first, so that the share of shut ones does not change how the others stand.
        leaf = None
        if draws[k, 1] >= BARE_SHARE:
            leaf = _open_leaf(plan.openings[number], number, rng, (walls, taken, ground))
        if leaf is not None:
            taken.append(shapely.Polygon(leaf.box().corners()))
        if k in shut:
            leaf = _leaf(plan.openings[number], number, _TURNS[int(4 * draws[k, 1])], 0.0)
        if leaf is not None:
            leaves.append(leaf)
    return tuple(leaves)


def _leaf(door: Opening, number: int, turn: tuple[float, float], angle: float) -> Leaf:
    """Leaf with its hinge at one end (-1, 1) of the opening and on one face of the wall, swung out by an angle, rad."""
    end, face = turn
    bearing = math.atan2(door.y2 - door.y1, door.x2 - door.x1)
    along, out = np.array([math.cos(bearing), math.sin(bearing)]), np.array([-math.sin(bearing), math.cos(bearing)])
    middle = np.array([door.x1 + door.x2, door.y1 + door.y2]) / 2
    off = max(door.thickness, THICKNESS) / 2 + (_PROUD if angle else 0.0)
    hinge = middle + end * (door.width / 2 - _INSET) * along + face * off * out
    ahead = -end * math.cos(angle) * along + face * math.sin(angle) * out
    # Shut, the board lies inside the wall's face; turning about the hinge keeps it on the same side of its line.
    heading = math.atan2(ahead[1], ahead[0])
    return Leaf(
        number,
        float(hinge[0]),
        float(hinge[1]),
        heading,
        door.width - 2 * _INSET,
        door.top - 0.023,
        end * face,
        angle == 0.0,
    )


def _open_leaf(
    door: Opening, number: int, rng: np.random.Generator, around: tuple[Any, list[Any], Ground]
) -> Leaf | None:
    """The first of some random ways to stand open for which there is room."""
    import shapely

    walls, taken, ground = around
    order = rng.permutation(4)
    for swing in rng.choice(len(_SWINGS), len(_SWINGS), replace=False, p=_HABITS):
        for k in order:
            angle = math.radians(float(rng.uniform(*_SWINGS[swing])))
            leaf = _leaf(door, number, _TURNS[k], angle)
            box = leaf.box()
            outline = shapely.Polygon(box.corners())
            if len(walls.query(outline, predicate="dwithin", distance=0.005)):
                continue
            if any(outline.distance(other) < 0.05 for other in taken):
                continue
            if ground.place(box):
                return leaf
    return None


def leaf_edges(leaves: Sequence[Leaf]) -> Array:
    """(K, 4) m: footprint edges of the open leaves."""
    edges = [leaf.box().edges() for leaf in leaves if not leaf.shut]
    return np.concatenate(edges) if edges else np.zeros((0, 4))


def shut_lines(plan: Floorplan, leaves: Sequence[Leaf]) -> Array:
    """(K, 4) m: what closes the openings of shut doors, as walls."""
    lines = [closing_lines(plan.openings[leaf.door], overlap=0.0) for leaf in leaves if leaf.shut]
    return np.concatenate(lines) if lines else np.zeros((0, 4))


def add_leaves(
    builder: MeshBuilder, leaves: Sequence[Leaf], rooms: Rooms, lighting: Lighting, rng: np.random.Generator
) -> None:
    """One instance per leaf."""
    metal = rng.uniform(0.35, 1.0) * np.array([1.0, rng.uniform(0.85, 1.0), rng.uniform(0.6, 1.0)])
    found = rooms.at(np.array([(leaf.x, leaf.y) for leaf in leaves]).reshape(-1, 2))
    for leaf, room in zip(leaves, found, strict=True):
        light = rooms.style(int(room)).light
        instance = builder.new_instance(DOOR)
        paint = SolidPainter(builder, lighting, leaf.x, leaf.y, leaf.heading, light, instance)
        _paint_leaf(paint, leaf, rooms.trim, metal)
        paint.flush()


def _paint_leaf(paint: SolidPainter, leaf: Leaf, trim: Trim, metal: Array) -> None:
    """The board, the panels on both its sides, and a handle on each."""
    low, high = sorted((0.0, leaf.side * THICKNESS))
    coat = trim.leaf
    paint.box(coat.name, (0.0, low, 0.01), (leaf.length, high, leaf.height), coat.tint)
    panels, glazed = _panels(trim.panels, leaf.length, leaf.height)
    board, glass = Coat(coat.name, 0.95 * coat.tint), Coat("lacquer", _GLASS)
    for y, out in ((low, -1.0), (high, 1.0)):
        near, far = sorted((y, y + 0.006 * out))
        for k, (x0, z0, x1, z1) in enumerate(panels):
            panel = glass if k < glazed else board
            paint.box(panel.name, (x0, near, z0), (x1, far, z1), panel.tint, hide="Y" if out < 0 else "y")
        knob = leaf.length - 0.06
        near, far = sorted((y, y + 0.008 * out))
        paint.box("metal", (knob - 0.02, near, 0.96), (knob + 0.02, far, 1.14), metal, hide="Y" if out < 0 else "y")
        near, far = sorted((y + 0.03 * out, y + 0.05 * out))
        paint.box("metal", (knob - 0.11, near, 1.04), (knob + 0.012, far, 1.06), metal)


def _panels(layout: int, length: float, height: float) -> tuple[list[tuple[float, float, float, float]], int]:
    """Rectangles (x0, z0, x1, z1) of a leaf's panels, m, and how many of them, the first ones, are glass."""
    rim, middle = 0.11, length / 2
    left, right, top = rim, length - rim, height - 0.12
    two = [(left, 1.25, right, top), (left, 0.16, right, 0.88)]
    if layout == 1:
        return two, 0
    if layout == 2:
        split = [(a, b) for _, a, _, b in two]
        return [(x0, a, x1, b) for a, b in split for x0, x1 in ((left, middle - 0.05), (middle + 0.05, right))], 0
    if layout == 3:
        tall = (height - 0.28 - 0.3) / 4
        return [(left, 0.16 + k * (tall + 0.1), right, 0.16 + k * (tall + 0.1) + tall) for k in range(4)], 0
    if layout == 4:
        return two, 1
    if layout == 5:
        return [(left, 0.9, right, top)], 1
    return [], 0
