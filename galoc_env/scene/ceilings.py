"""What is fixed to ceilings beside lamps: mouldings along their edge, beams, smoke detectors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from galoc_env.scene.light import Lighting
from galoc_env.scene.mesh import FITTING, MeshBuilder
from galoc_env.scene.rooms import Rooms
from galoc_env.scene.solids import MakePainter, SolidPainter
from galoc_env.scene.styles import tinge

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan

Array = NDArray[np.float64]

MOULDING_SHARE, BEAM_SHARE, DETECTOR_SHARE = 0.6, 0.1, 0.3
"""Chance at density 0.5 and more: of a moulding in a room whose walls end in ceiling paint, of beams, of a detector."""
MAX_ROOMS = 100
"""Rooms of a plan whose ceilings are fitted: huge plans stay fast to build and to draw."""
_PROFILE = np.array([[0.0, 1.0], [0.18, 0.92], [0.45, 0.4], [1.0, 0.0]])
"""Of a moulding: distance from the wall and from the ceiling, in its size."""


def add_ceilings(
    builder: MeshBuilder, plan: Floorplan, rooms: Rooms, lighting: Lighting, density: float, rng: np.random.Generator
) -> None:
    """One instance for each room's moulding, beams and detector; their number grows with the density (0..1)."""
    import shapely

    share, height = min(1.0, 2.0 * density), plan.ceiling_height
    gaps = max((o.top for o in plan.openings), default=0.0) > height - 0.2  # a moulding there would hang in the air
    for number, room in enumerate(rooms.polygons[:MAX_ROOMS]):
        own = np.random.default_rng(rng.integers(1 << 31))
        style, chance = rooms.style(number), own.uniform(size=3) / max(share, 1e-9)

        def painter(light: float = style.light) -> SolidPainter:
            return SolidPainter(builder, lighting, 0.0, 0.0, 0.0, light, builder.new_instance(FITTING))

        if style.cornice and chance[0] < MOULDING_SHARE and not gaps:
            _moulding(painter, room, height, style.cornice, style.ceiling_tint)
        elif chance[1] < BEAM_SHARE and height > 2.45 and room.area < 60.0:
            _beams(painter, room, height, own)
        if chance[2] < DETECTOR_SHARE:
            x, y = room.representative_point().coords[0]
            a, b = own.uniform(0.5, 0.9, 2)
            if shapely.contains_xy(room.buffer(-0.2), x + a, y + b):
                paint = painter()
                paint.prism("lacquer", (x + a, y + b, height - 0.035, height), (0.045, 0.055), 0.97, sides=10)
                paint.flush()


def _moulding(painter: MakePainter, room: Any, height: float, size: float, tint: Array) -> None:
    """A strip along every edge of a room, mitred in its corners."""
    import shapely

    quads = []
    for number, ring in enumerate((room.exterior, *room.interiors)):
        closed = np.asarray(shapely.simplify(ring, 2e-3).coords)[:-1]
        if len(closed) < 3:
            return
        ccw = shapely.LinearRing(closed).is_ccw
        corners = closed if ccw == (number == 0) else closed[::-1]  # the room is to the left
        edge = np.roll(corners, -1, axis=0) - corners
        along = edge / np.linalg.norm(edge, axis=1)[:, None]
        inwards = np.column_stack([-along[:, 1], along[:, 0]])
        before = np.roll(inwards, 1, axis=0)
        mitre = (inwards + before) / np.maximum(1.0 + (inwards * before).sum(axis=1), 0.1)[:, None]
        left = edge + size * (np.roll(mitre, -1, axis=0) - mitre)
        if ((left * along).sum(axis=1) <= 0.0).any() or np.abs(mitre).max() > 3.0:
            return  # corners too close to each other
        rings = [np.column_stack([corners + a * size * mitre, np.full(len(corners), height - b * size)])
                 for a, b in _PROFILE]  # fmt: skip
        for low, high in zip(rings[:-1], rings[1:], strict=True):
            # Seen from the room, the ring runs to the left.
            quads.append(np.stack([np.roll(low, -1, axis=0), low, high, np.roll(high, -1, axis=0)], axis=1))
    paint = painter()
    paint.polygons("ceiling", np.concatenate(quads), tint)
    paint.flush()


def _beams(painter: MakePainter, room: Any, height: float, rng: np.random.Generator) -> None:
    """Beams from wall to wall across the room's shorter way."""
    import shapely

    box = np.array(shapely.minimum_rotated_rectangle(room).exterior.coords)[:4]
    a, b = box[1] - box[0], box[3] - box[0]
    if np.hypot(*a) < np.hypot(*b):
        a, b = b, a
    pitch, width, drop = rng.uniform(0.8, 1.4), rng.uniform(0.08, 0.16), rng.uniform(0.08, min(0.2, height - 2.25))
    count = int(np.hypot(*a) / pitch)
    along = b / np.hypot(*b)
    name = str(rng.choice(("walnut", "oak", "lacquer", "pine")))
    tint, paint = tinge(rng, 0.1, (0.7, 1.0)), None
    for k in range(count):
        start = box[0] + (k + 0.5) / count * a
        line = shapely.intersection(shapely.LineString([start - 0.1 * along, start + b + 0.1 * along]), room)
        for piece in getattr(line, "geoms", [line]):
            if piece.length < 0.6:
                continue
            paint = paint or painter()
            ends = np.array(piece.coords)
            bar = paint.at((*ends[0], 0.0), turn=math.atan2(along[1], along[0]))
            low, high = (0.0, -width / 2, height - drop), (piece.length, width / 2, height)
            bar.box(name, low, high, tint, hide="xXZ")
    if paint is not None:
        paint.flush()
