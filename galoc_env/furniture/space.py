"""One room as furniture sees it: what it is used for, and the walls that pieces stand against."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from galoc_env.furniture import DOOR_CLEARANCE, WALL_GAP, Furniture
from galoc_env.furniture.kinds import KINDS_BY_NAME

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan
    from galoc_env.scene.rooms import Rooms

Array = NDArray[np.float64]

USES = ("living", "kitchen", "bed", "bath", "hall", "study", "dining", "office")
"""What a room is used for."""
_HOME_ROOMS, _HOME_AREA = 16, 400.0
"""A plan with more rooms, or more m2, is no home: its rooms are offices."""
_STRAIGHT = 0.03
"""Bends of a wall of less than this are ignored, m."""
_SPOTS = 2000
"""Open places looked at, at least, where there are more."""
_SIDE_GAP = 0.03
"""Gap between a piece in a corner and the wall beside it, m."""


@dataclass(frozen=True, slots=True, eq=False)
class Space:
    """A room's polygon with its edges, counter-clockwise, less what is close to doors: the room lies on their left."""

    polygon: Any
    """Shapely polygon, m."""
    use: str
    """One of :data:`USES`."""
    area: float
    """m2."""
    start: Array
    """(E, 2) m."""
    along: Array
    """(E, 2) unit vectors."""
    length: Array
    """(E,) m."""
    spots: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """(P, 2) m: places in the open."""

    def normal(self, edge: int) -> Array:
        """(2,) unit vector into the room."""
        return np.array([-self.along[edge, 1], self.along[edge, 0]])

    def at_wall(
        self, kind: str, edge: int, s: float, size: tuple[float, float, float], gap: float = WALL_GAP
    ) -> Furniture:
        """A piece with its back to an edge, centred ``s`` m along it; size: length, width, height, m."""
        normal = self.normal(edge)
        x, y = self.start[edge] + s * self.along[edge] + (size[0] / 2 + gap) * normal
        return Furniture(kind, float(x), float(y), math.atan2(normal[1], normal[0]), *size)

    def propose(
        self, kind: str, size: tuple[float, float, float], rng: np.random.Generator, *, corner: float
    ) -> Furniture | None:
        """A piece against a random wall that is long enough, with probability ``corner`` at one of its ends."""
        need = size[1] + 2 * _SIDE_GAP
        slack = self.length - need
        weight = np.where(slack > 0, slack + 0.4, 0.0)
        if not weight.any():
            return None
        edge = int(np.searchsorted(np.cumsum(weight) / weight.sum(), rng.uniform()))
        edge = min(edge, len(weight) - 1)
        s = need / 2 + float(slack[edge]) * (rng.uniform() if rng.uniform() > corner else float(rng.integers(2)))
        return self.at_wall(kind, edge, s, size)

    def facing(self, x: float, y: float, heading: float) -> tuple[int, float, float] | None:
        """The edge that a look from (x, y) along a bearing meets squarely: its number, s along it, distance (m)."""
        ahead = np.array([math.cos(heading), math.sin(heading)])
        from_start = np.array([x, y]) - self.start
        normals = np.stack([-self.along[:, 1], self.along[:, 0]], axis=1)
        height = (from_start * normals).sum(axis=1)
        s = (from_start * self.along).sum(axis=1)
        square = (normals @ ahead < -0.99) & (height > 0.5) & (s > 0.3) & (s < self.length - 0.3)
        if not square.any():
            return None
        edge = int(np.argmin(np.where(square, height, np.inf)))
        return edge, float(s[edge]), float(height[edge])


def random_size(kind: str, rng: np.random.Generator, ceiling: float) -> tuple[float, float, float]:
    """Length, width and height of a piece of a kind, m; below the ceiling."""
    k = KINDS_BY_NAME[kind]
    length, width, height = (float(rng.uniform(*span)) for span in (k.length, k.width, k.height))
    if kind in ("plant", "lamp", "basket", "pouf", "coat_rack", "round_table"):
        width = length
    return length, width, min(height, ceiling - 0.1)


def spaces(rooms: Rooms, plan: Floorplan, spots: Array, rng: np.random.Generator) -> list[Space]:
    """All rooms, largest first, each with its use and those of the open places ``spots`` (P, 2) that lie in it."""
    import shapely

    doors = [shapely.LineString([(o.x1, o.y1), (o.x2, o.y2)]) for o in plan.openings if o.kind == "door"]
    kept_clear = shapely.union_all(shapely.buffer(doors, DOOR_CLEARANCE + 0.02, quad_segs=6))
    shapely.prepare(kept_clear)

    polygons = [shapely.geometry.polygon.orient(p.simplify(_STRAIGHT)) for p in rooms.polygons]
    area = np.array([p.area for p in polygons])
    uses = _refined([rooms.use(k) for k in range(len(polygons))], area, rng)
    spots = spots[:: max(1, len(spots) // _SPOTS)]
    found = rooms.at(spots)
    return [
        _space(p, use, kept_clear, spots[found == k]) for k, (p, use) in enumerate(zip(polygons, uses, strict=True))
    ]


def _space(polygon: Any, use: str, kept_clear: Any, spots: Array) -> Space:
    """The room's edges, less what lies close to a door."""
    import shapely

    corners = np.array(polygon.exterior.coords)
    ends = np.concatenate([corners[:-1], corners[1:]], axis=1)
    lines = shapely.linestrings(ends.reshape(-1, 2, 2))
    near = shapely.intersects(lines, kept_clear)
    pieces = []
    for line, end, cut in zip(lines, ends, near, strict=True):
        if not cut:
            pieces.append(end)
            continue
        left = shapely.get_parts(shapely.difference(line, kept_clear))
        rest = [np.array(part.coords)[[0, -1]].ravel() for part in left if not part.is_empty]
        pieces += sorted(rest, key=lambda piece: line.project(shapely.Point(piece[:2])))
    made = np.array(pieces).reshape(-1, 4)
    delta = made[:, 2:] - made[:, :2]
    length = np.linalg.norm(delta, axis=1)
    kept = length > 0.3
    return Space(
        polygon, use, float(polygon.area), made[kept, :2], delta[kept] / length[kept, None], length[kept], spots
    )


def _refined(uses: list[str], area: Array, rng: np.random.Generator) -> list[str]:
    """The styles' uses, told apart further: one living room, the others for dining or work; no home has offices."""
    home = len(uses) <= _HOME_ROOMS and area.sum() <= _HOME_AREA
    lived, refined = False, list[str]()
    for use in uses:
        if use == "living" and lived:
            use = str(rng.choice(("dining", "study", "living"))) if "bed" in (*uses, *refined) else "bed"
        elif use == "office" and home:
            use = "study"
        elif use not in USES:
            use = "living" if home else "office"
        lived |= use == "living"
        refined.append(use)
    return refined
