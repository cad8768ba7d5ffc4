"""Walls: every plan segment as an upright sheet, seen from both sides, with holes where the windows are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from galoc_env.scene.light import CORNER, EDGE, Lighting, height_gradient
from galoc_env.scene.mesh import WALL, MeshBuilder
from galoc_env.scene.rooms import CORE, Rooms

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan

Array = NDArray[np.float64]

PARALLEL = math.radians(2.0)
"""A window cuts the wall faces that are parallel to it within this angle (rad) ..."""
REACH = 0.03
"""... and closer to its centreline than half its thickness plus this, m."""
OVERLAP = 0.02
"""Walls reach this far through floor and ceiling, so that no crack shows the void, m."""
_PROBE = 0.12
"""This far off a wall's end another wall is looked for, m."""


@dataclass(frozen=True, slots=True)
class Cut:
    """A rectangular hole in a wall segment."""

    start: float
    """Along the segment, m."""
    end: float
    """Along the segment, m."""
    bottom: float
    """Height, m."""
    top: float
    """Height, m."""


def window_cuts(plan: Floorplan) -> list[list[Cut]]:
    """Holes of each segment. A window cuts every wall face that runs along it within the wall's thickness."""
    cuts: list[list[Cut]] = [[] for _ in plan.segments]
    start, end = plan.segments[:, :2], plan.segments[:, 2:]
    length = np.linalg.norm(end - start, axis=1)
    along = (end - start) / np.maximum(length, 1e-9)[:, None]
    for window in (o for o in plan.openings if o.kind == "window" and o.width > 0):
        a, b = np.array([window.x1, window.y1]), np.array([window.x2, window.y2])
        direction = (b - a) / window.width
        skew = np.abs(along[:, 0] * direction[1] - along[:, 1] * direction[0])
        s = np.sort(np.stack([((p - start) * along).sum(axis=1) for p in (a, b)]), axis=0)
        low, high = np.clip(s[0], 0.0, length), np.clip(s[1], 0.0, length)
        middle = start + along * ((low + high) / 2)[:, None]
        off = np.abs((middle - a) @ np.array([-direction[1], direction[0]]))
        hit = (skew <= math.sin(PARALLEL)) & (off <= window.thickness / 2 + REACH) & (high - low > 1e-3)
        for i in np.flatnonzero(hit):
            cuts[i].append(Cut(float(low[i]), float(high[i]), window.bottom, min(window.top, plan.ceiling_height)))
    return cuts


def breakpoints(plan: Floorplan) -> list[Array]:
    """Where other walls meet or cross each segment: sorted distances along it, its own ends included, m."""
    import shapely

    segments = plan.segments
    lines = shapely.linestrings(segments.reshape(-1, 2, 2))
    tree = shapely.STRtree(lines)
    ends = segments.reshape(-1, 2)
    end_index, touched = tree.query(shapely.points(ends), predicate="dwithin", distance=0.02)
    first, second = tree.query(lines, predicate="crosses")
    crossing = shapely.get_coordinates(shapely.intersection(lines[first], lines[second]), return_index=True)
    where = np.concatenate([touched, first[crossing[1]]])
    points = np.concatenate([ends[end_index], crossing[0]])
    start, delta = segments[:, :2], segments[:, 2:] - segments[:, :2]
    length = np.linalg.norm(delta, axis=1)
    s = ((points - start[where]) * delta[where]).sum(axis=1) / np.maximum(length[where], 1e-9)
    order = np.argsort(where, kind="stable")
    groups = np.split(s[order], np.searchsorted(where[order], np.arange(1, len(segments))))
    return [_clean(group, total) for group, total in zip(groups, length, strict=True)]


def _clean(values: Array, length: float) -> Array:
    """Sorted, inside (0, length) with both ends, no two closer than 2 cm."""
    kept = [0.0]
    for value in np.sort(values):
        if kept[-1] + 0.02 < value < length - 0.02:
            kept.append(float(value))
    return np.array([*kept, length])


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """One side of the stretch of a segment between two breakpoints."""

    segment: int
    """Index in the plan."""
    start: float
    """Along the segment, m."""
    end: float
    """Along the segment, m."""
    along: Array
    """(2,) unit vector."""
    normal: Array
    """(2,) unit vector towards the viewer."""
    room: int
    """What it faces: see :meth:`Rooms.at`."""
    dark_start: bool
    """It starts in a room corner."""
    dark_end: bool
    """It ends in a room corner."""


def wall_sides(plan: Floorplan, rooms: Rooms) -> list[Side]:
    """All stretches, seen from both sides, with the room they face and whether they end in a room corner."""
    import shapely

    raw = []
    for i, (segment, breaks) in enumerate(zip(plan.segments, breakpoints(plan), strict=True)):
        along = (segment[2:] - segment[:2]) / max(float(breaks[-1]), 1e-9)
        for low, high in zip(breaks[:-1], breaks[1:], strict=True):
            for sign in (1.0, -1.0):
                raw.append((i, float(low), float(high), along, sign * np.array([-along[1], along[0]])))
    if not raw:
        return []
    origin = np.array([plan.segments[r[0], :2] for r in raw])
    along, normal = np.array([r[3] for r in raw]), np.array([r[4] for r in raw])
    low, high = np.array([r[1] for r in raw]), np.array([r[2] for r in raw])
    room = rooms.at(origin + along * ((low + high) / 2)[:, None] + 0.03 * normal)
    lines = shapely.linestrings(plan.segments.reshape(-1, 2, 2))
    tree = shapely.STRtree(lines)
    dark = []
    for s in (low, high):
        # Just off the end, on this side: a wall there means a concave corner; a wall that goes straight on, or turns
        # away, is out of reach.
        probe = shapely.points(origin + along * s[:, None] + _PROBE * normal)
        which, _ = tree.query(probe, predicate="dwithin", distance=0.8 * _PROBE)
        dark.append(np.isin(np.arange(len(raw)), which))
    return [Side(*r, int(room[k]), bool(dark[0][k]), bool(dark[1][k])) for k, r in enumerate(raw)]


def add_walls(
    builder: MeshBuilder, plan: Floorplan, rooms: Rooms, sides: list[Side], cuts: list[list[Cut]], lighting: Lighting
) -> None:
    """One instance per plan segment."""
    instances = [builder.new_instance(WALL) for _ in plan.segments]
    for side in sides:
        here = [c for c in cuts[side.segment] if c.end > side.start and c.start < side.end]
        _add_side(builder, plan, rooms, lighting, side, here, instances[side.segment])


def _add_side(
    builder: MeshBuilder, plan: Floorplan, rooms: Rooms, lighting: Lighting, side: Side, cuts: list[Cut], instance: int
) -> None:
    style, height = rooms.style(side.room), plan.ceiling_height
    columns = _ticks(side.start, side.end, [c.start for c in cuts] + [c.end for c in cuts], _corner_ticks(side))
    bands = style.bands(side.normal, height)
    exact = [z for c in cuts for z in (c.bottom, c.top)]
    if side.room == CORE:
        bands, soft = bands[-1:], []  # inside a wall nobody sees boards or gradients
    else:
        exact, soft = exact + [top for top, _ in bands], [EDGE, height - EDGE]
    rows = _ticks(-OVERLAP, height + OVERLAP, exact, soft)
    s, z = np.meshgrid(columns, rows)
    xy = plan.segments[side.segment, :2] + s[..., None] * side.along
    points = np.dstack([xy, z]).reshape(-1, 3)
    light = style.light * lighting.wall(side.normal) * height_gradient(z, height) * _corner_gradient(side, s)
    # The right-hand direction for a viewer in front of the wall is along x normal up, which flips u on one side.
    rightwards = side.normal @ np.array([side.along[1], -side.along[0]]) > 0
    uv = np.stack([s if rightwards else -s, z], axis=-1).reshape(-1, 2)
    faces, middle = _grid_faces(columns, rows, cuts, flip=not rightwards)
    band = np.searchsorted([top for top, _ in bands], middle)
    for k, (_, coat) in enumerate(bands):
        if (band == k).any():
            used, index = np.unique(faces[band == k].ravel(), return_inverse=True)
            shade = light.ravel()[used]
            builder.add(coat.name, points[used], uv[used], shade, index.reshape(-1, 3), instance, tint=coat.tint)


def _corner_ticks(side: Side) -> list[float]:
    edge = min(EDGE, (side.end - side.start) / 2)
    if side.room == CORE:
        return []
    return [side.start + edge] * side.dark_start + [side.end - edge] * side.dark_end


def _corner_gradient(side: Side, s: Array) -> Array:
    edge = min(EDGE, (side.end - side.start) / 2)
    factor = np.ones_like(s)
    if side.dark_start:
        factor *= CORNER + (1 - CORNER) * np.clip((s - side.start) / edge, 0, 1)
    if side.dark_end:
        factor *= CORNER + (1 - CORNER) * np.clip((side.end - s) / edge, 0, 1)
    return factor


def _ticks(low: float, high: float, exact: list[float], soft: list[float]) -> Array:
    """Grid lines: the ends and the exact ones, plus soft ones that keep 2 cm from all others."""
    ticks = sorted({low, high, *(v for v in exact if low < v < high)})
    for value in soft:
        if low < value < high and min(abs(value - t) for t in ticks) > 0.02:
            ticks.append(value)
    return np.array(sorted(ticks))


def _grid_faces(columns: Array, rows: Array, cuts: list[Cut], flip: bool) -> tuple[NDArray[np.int64], Array]:
    """Triangles of the grid's cells outside the holes, and the height of the middle of their cells, m."""
    n = len(columns)
    j, i = np.meshgrid(np.arange(n - 1), np.arange(len(rows) - 1))
    mid_s, mid_z = (columns[j] + columns[j + 1]) / 2, (rows[i] + rows[i + 1]) / 2
    solid = np.ones(j.shape, bool)
    for cut in cuts:
        solid &= ~((mid_s > cut.start) & (mid_s < cut.end) & (mid_z > cut.bottom) & (mid_z < cut.top))
    corner = (i * n + j)[solid]
    a, b, c, d = corner, corner + 1, corner + n + 1, corner + n
    faces = np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)
    return (faces[:, ::-1] if flip else faces), np.repeat(mid_z[solid], 2)
