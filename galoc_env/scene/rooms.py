"""Rooms of a plan: closed polygons between walls, their style, floors and ceilings."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc_env.scene.light import CEILING_EDGE, CEILING_LIGHT, EDGE, FLOOR_EDGE, FLOOR_LIGHT
from galoc_env.scene.mesh import CEILING, FLOOR, MeshBuilder
from galoc_env.scene.styles import Style, Trim, draw_style, draw_trim, guess_uses, tinge

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan, Opening

Array = NDArray[np.float64]

MARGIN = 0.5
"""How far floor and ceiling reach beyond the walls, m."""
MIN_RADIUS = 0.3
"""Polygons without a disc of this radius (m) are wall cores, door steps or drawing noise, not rooms ..."""
MIN_WIDTH = 0.35
"""... and so are those narrower than this on average (m): a wall core may hold a disc where a chimney stands."""
REST, CORE = -1, -2
"""Room numbers of what no wall encloses, and of wall cores and door steps."""


@dataclass(frozen=True, eq=False)
class Rooms:
    """Room polygons with their styles."""

    polygons: tuple[Any, ...]
    """Shapely polygons, m."""
    styles: tuple[Style, ...]
    """Style of each polygon, and last that of the rest."""
    cores: tuple[Any, ...] = ()
    """Shapely polygons too thin to be rooms: wall cores and door steps."""
    trim: Trim = field(default_factory=Trim)
    """Joinery of the home."""

    @cached_property
    def _tree(self) -> Any:
        from shapely import STRtree

        return STRtree([*self.polygons, *self.cores])

    def at(self, points: ArrayLike) -> NDArray[np.int64]:
        """(N,) room that holds each of the points (N, 2); ``REST`` or ``CORE`` otherwise."""
        import shapely

        found = np.full(len(np.asarray(points)), REST, np.int64)
        if len(found) and (self.polygons or self.cores):
            which, cell = self._tree.query(shapely.points(points), predicate="intersects")
            found[which] = np.where(cell < len(self.polygons), cell, CORE)
        return found

    def style(self, room: int) -> Style:
        """Style of a number from :meth:`at`."""
        return self.styles[max(room, REST)]

    def use(self, room: int) -> str:
        """What a room is used for: one of ``galoc_env.scene.styles.USES``."""
        return self.style(room).use


def closing_lines(opening: Opening, overlap: float = 0.02) -> Array:
    """(2 or 1, 4) m: lines that close a door: along both wall faces, or along the one line of a thin wall.

    They reach ``overlap`` (m) beyond both ends of the gap.
    """
    start, end = np.array([opening.x1, opening.y1]), np.array([opening.x2, opening.y2])
    along = (end - start) / max(opening.width, 1e-9)
    shift = opening.thickness / 2 * np.array([-along[1], along[0]])
    start, end = start - overlap * along, end + overlap * along
    sides = (1.0, -1.0) if opening.thickness > 0.01 else (0.0,)
    return np.array([[*(start + s * shift), *(end + s * shift)] for s in sides])


def find_rooms(plan: Floorplan, rng: np.random.Generator) -> Rooms:
    """Polygons that walls and closed doors enclose, largest first."""
    import shapely

    # A hair longer than the gap, so that rounding leaves no leak at the ends.
    doors = [closing_lines(o) for o in plan.openings if o.kind == "door" and o.width > 0]
    lines = np.concatenate([plan.segments, *doors])
    # Snapping to a millimetre makes ends that nearly meet meet, and noding robust.
    noded = shapely.union_all(shapely.linestrings(lines.reshape(-1, 2, 2)), grid_size=1e-3)
    cells = shapely.get_parts(shapely.polygonize(list(shapely.get_parts(noded))))
    width = 2 * shapely.area(cells) / np.maximum(shapely.length(cells), 1e-9)
    wide = (width > MIN_WIDTH) & ~shapely.is_empty(shapely.buffer(cells, -MIN_RADIUS))
    rooms = sorted(cells[wide], key=lambda cell: (-round(cell.area, 6), cell.bounds))
    centrelines = [shapely.LineString([(o.x1, o.y1), (o.x2, o.y2)]) for o in plan.openings if o.kind == "door"]
    trim = draw_trim(rng)
    uses = guess_uses(rooms, centrelines, rng)
    styles = [draw_style(use, trim, rng) for use in uses]
    styles = [
        replace(style, accent_bearing=style.accent_bearing + _direction(room))
        for style, room in zip(styles, rooms, strict=True)
    ]
    # Brick, deep colours and tiles all through a big building are too much.
    rest = replace(draw_style("other", trim, rng), wall="plaster", wall_tint=tinge(rng, 0.12), dado=None, accent=None)
    return Rooms(tuple(rooms), (*styles, replace(rest, light=0.97)), tuple(cells[~wide]), trim)


def add_floors(builder: MeshBuilder, plan: Floorplan, rooms: Rooms) -> None:
    """Floor and ceiling of every room, and of the rest of the bounding box."""
    import shapely

    floor, ceiling = builder.new_instance(FLOOR), builder.new_instance(CEILING)
    x0, y0, x1, y1 = plan.bounds
    rest = shapely.box(x0 - MARGIN, y0 - MARGIN, x1 + MARGIN, y1 + MARGIN)
    if rooms.polygons:
        rest = rest.difference(shapely.union_all(list(rooms.polygons)))
    for number, polygon in [(REST, rest), *enumerate(rooms.polygons)]:
        style = rooms.style(number)
        angle = _direction(polygon) if number >= 0 else 0.0
        for patch, distance in _patches(polygon, rings=number >= 0):
            points, faces = _triangles(patch)
            if not len(faces):
                continue
            near = _edge_weight(points, polygon, distance)
            uv = points @ np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
            light = style.light * FLOOR_LIGHT * (1 - (1 - FLOOR_EDGE) * near)
            builder.add(style.floor, _lift(points, 0.0), uv, light, faces, floor, tint=style.floor_tint)
            light = style.light * CEILING_LIGHT * (1 - (1 - CEILING_EDGE) * near)
            above = _lift(points, plan.ceiling_height)
            builder.add("ceiling", above, uv * (-1, 1), light, faces[:, ::-1], ceiling, tint=style.ceiling_tint)


def _patches(polygon: Any, rings: bool) -> list[tuple[Any, float]]:
    """The polygon cut into the band along its edge and the middle, so that vertex light can form a gradient."""
    import shapely

    inner = shapely.buffer(polygon, -EDGE, quad_segs=2) if rings else shapely.Polygon()
    if inner.is_empty:
        return [(polygon, 0.0)]
    return [(polygon.difference(inner), EDGE), (inner, EDGE)]


def _edge_weight(points: Array, polygon: Any, distance: float) -> Array:
    """(V,) 1 for vertices on the polygon's edge, 0 for those ``distance`` inside; a constant where there is no band."""
    import shapely

    if distance == 0.0:
        return np.full(len(points), 0.25)
    to_edge = shapely.distance(shapely.points(points), polygon.boundary)
    return np.clip(1.0 - to_edge / distance, 0.0, 1.0)


def _triangles(polygon: Any) -> tuple[Array, NDArray[np.int64]]:
    """Triangulate a polygon (with holes): points (V, 2) and counter-clockwise faces (F, 3)."""
    import shapely

    corners = [t.exterior.coords[:3] for t in shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))]
    if not corners:
        return np.zeros((0, 2)), np.zeros((0, 3), np.int64)
    triangles = np.array(corners)[:, :, :2]
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    area2 = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    triangles[area2 < 0] = triangles[area2 < 0][:, ::-1]
    points, index = np.unique(triangles.reshape(-1, 2), axis=0, return_inverse=True)
    return points, index.reshape(-1, 3)[np.abs(area2) > 1e-9]


def _direction(polygon: Any) -> float:
    """Bearing of the polygon's longest edge, rad: the way its boards run."""
    corners = np.array(polygon.exterior.coords)
    edge = np.diff(corners, axis=0)
    longest = edge[np.argmax((edge**2).sum(axis=1))]
    return math.atan2(longest[1], longest[0])


def _lift(points: Array, z: float) -> Array:
    return np.column_stack([points, np.full(len(points), z)])
