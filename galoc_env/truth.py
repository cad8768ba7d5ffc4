"""The true wireframe of a view: exactly visible corners, occlusion ends, truncation at the image border.

Label convention, equal to the plan's: rays pass open doorways (gaps in the plan), a lintel above one is clutter like
furniture and hides nothing; windows belong to their wall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.camera import Camera, azimuth, levelling
from galoc.errors import GalocError
from galoc.floorplan import Floorplan
from galoc.types import BORDER, CORNER, OCCLUSION, Wireframe
from galoc_env.truth_kernel import line_range, visible_pieces

Array = NDArray[np.float64]

MIN_WIDTH = math.radians(0.3)
"""Panels narrower than this are no panels to any detector (about 1 px of 640 at 108 degrees), rad."""
JOIN_ANGLE = math.radians(0.3)
"""Neighbouring pieces that meet and turn by less than this are one straight wall, rad."""
JOIN_RANGE = 2e-3
"""Two pieces meet when their ranges at the shared azimuth differ by less than this share."""
NEAR = 1e-3
"""What is nearer to the camera plane than this does not project, m."""
MAX_AZIMUTH = math.radians(89.0)
"""Beyond this a wall leaves no finite image in the levelled view, rad."""


@dataclass(slots=True)
class Panel:
    """One visible stretch of straight wall, left to right."""

    azimuth: Array
    """(2,) rad: left and right end."""
    range: Array
    """(2,) m: distance from the camera (in plan) at both ends."""
    segment: int
    """Index of the plan segment (of the leftmost one when several are collinear)."""
    kind: list[int]
    """Left and right end: CORNER, OCCLUSION or BORDER."""

    def points(self) -> Array:
        """(2, 2): both ends as (x right, z forward) in the level frame, m."""
        return np.stack([self.range * np.sin(self.azimuth), self.range * np.cos(self.azimuth)], axis=1)


def visible_panels(plan: Floorplan, pose: ArrayLike, azimuth_min: float, azimuth_max: float) -> list[Panel]:
    """Walls seen from a pose between two azimuths, left to right, with occlusions resolved exactly.

    Args:
        plan: the walls.
        pose: (x, y, heading), m and rad.
        azimuth_min: leftmost azimuth, rad (right positive), above -pi.
        azimuth_max: rightmost azimuth, rad, below pi.
    """
    x, y, heading = (float(v) for v in np.asarray(pose, dtype=np.float64))
    segments = plan.segments
    ends = segments.reshape(-1, 2)
    bearing = np.arctan2(ends[:, 1] - y, ends[:, 0] - x)
    events = (heading - bearing + np.pi) % (2 * np.pi) - np.pi
    events = events[(events > azimuth_min) & (events < azimuth_max)]
    events = np.unique(np.concatenate([[azimuth_min], events, [azimuth_max]]))
    pieces = visible_pieces(segments, x, y, heading, events)
    panels: list[Panel] = []
    for a0, a1, k in pieces:
        if k < 0:
            continue
        ranges = [line_range(segments, int(k), x, y, math.cos(heading - a), math.sin(heading - a)) for a in (a0, a1)]
        panel = Panel(np.array([a0, a1]), np.array(ranges), int(k), [BORDER, BORDER])
        if not (panels and _joined(panels[-1], panel)):
            panels.append(panel)
    return _classified(panels, azimuth_min, azimuth_max)


def _joined(left: Panel, right: Panel) -> bool:
    """Extend ``left`` by ``right`` when the two are one straight wall."""
    if right.azimuth[0] - left.azimuth[1] > 1e-9 or abs(right.range[0] - left.range[1]) > JOIN_RANGE * left.range[1]:
        return False
    if left.segment != right.segment:
        d = np.diff(left.points(), axis=0)[0], np.diff(right.points(), axis=0)[0]
        turn = abs(math.atan2(d[0][0] * d[1][1] - d[0][1] * d[1][0], float(d[0] @ d[1])))
        if turn > JOIN_ANGLE:
            return False
    left.azimuth[1], left.range[1] = right.azimuth[1], right.range[1]
    return True


def _classified(panels: list[Panel], azimuth_min: float, azimuth_max: float) -> list[Panel]:
    """Set the kind of every end: the nearer of two unequal neighbours ends there, the farther is occluded."""
    for i, panel in enumerate(panels):
        for side, step in ((0, -1), (1, 1)):
            limit = azimuth_min if side == 0 else azimuth_max
            if abs(panel.azimuth[side] - limit) < 1e-9:
                continue
            j = i + step
            touching = 0 <= j < len(panels) and abs(panels[j].azimuth[1 - side] - panel.azimuth[side]) < 1e-9
            other = panels[j].range[1 - side] if touching else math.inf
            behind = panel.range[side] > other * (1.0 + JOIN_RANGE)
            panel.kind[side] = OCCLUSION if behind else CORNER
    return [p for p in panels if p.azimuth[1] - p.azimuth[0] > MIN_WIDTH]


def visible_wireframe(
    plan: Floorplan,
    camera: Camera,
    pose: ArrayLike,
    camera_height: float,
    gravity: tuple[float, float] = (0.0, 0.0),
) -> Wireframe:
    """The wireframe a perfect detector would return.

    Args:
        plan: walls and ceiling height.
        camera: intrinsics.
        pose: (x, y, heading), m and rad.
        camera_height: above the floor, m, between 0 and the ceiling.
        gravity: TRUE (roll, pitch) of the camera, rad.

    Raises:
        GalocError: camera not between floor and ceiling, or pose not finite.
    """
    if not 0.0 < camera_height < plan.ceiling_height:
        raise GalocError(
            f"camera_height = {camera_height!r} m",
            f"a height above the floor and below the ceiling ({plan.ceiling_height:g} m)",
            "Lower the camera or raise the plan's ceiling.",
        )
    if np.shape(pose) != (3,) or not np.all(np.isfinite(pose)):
        raise GalocError(f"pose {pose!r}", "three finite numbers x, y, heading (m, m, rad)", "Fix the pose.")
    left, right = _azimuth_limits(camera, gravity)
    panels = visible_panels(plan, pose, left, right)
    heights = (-(plan.ceiling_height - camera_height), camera_height)
    return _wireframe_of(panels, camera, heights, gravity)


def _azimuth_limits(camera: Camera, gravity: tuple[float, float]) -> tuple[float, float]:
    """Azimuths that the image border reaches, a little widened so that ends just outside are still seen."""
    w, h = camera.width - 0.5, camera.height - 0.5
    t = np.linspace(0.0, 1.0, 33)[:, None]
    corners = np.array([[-0.5, -0.5], [w, -0.5], [w, h], [-0.5, h], [-0.5, -0.5]])
    border = np.concatenate([a * (1 - t) + b * t for a, b in zip(corners[:-1], corners[1:], strict=True)])
    rays = camera.rays_level(border, gravity)
    seen = azimuth(rays[rays[:, 2] > 1e-6])
    if len(seen) == 0:
        return -MAX_AZIMUTH, MAX_AZIMUTH
    margin = math.radians(1.0)
    return max(-MAX_AZIMUTH, float(seen.min()) - margin), min(MAX_AZIMUTH, float(seen.max()) + margin)


@dataclass(frozen=True, slots=True)
class _Seen:
    """The part of a straight edge that is on the image."""

    pixels: Array  # (2, 2) px: first and last visible point
    cut: tuple[bool, bool]  # whether the border (or the camera plane) cut the edge's start and end


def _on_image(edge: Array, camera: Camera) -> _Seen | None:
    """Clip a camera-frame edge (2, 3) to the space before the camera and to the image (Liang-Barsky)."""
    if edge[:, 2].max() <= NEAR:
        return None
    behind = edge[:, 2] < NEAR
    a, b = edge[0], edge[1]
    if behind.any():
        crossing = a + (NEAR - a[2]) / (b[2] - a[2]) * (b - a)
        a, b = (crossing, b) if behind[0] else (a, crossing)
    start, end = _pixel(a, camera), _pixel(b, camera)
    d = end - start
    t0, t1 = 0.0, 1.0
    for axis, last in ((0, camera.width - 0.5), (1, camera.height - 0.5)):
        for p, q in ((-d[axis], start[axis] + 0.5), (d[axis], last - start[axis])):
            if p == 0.0 and q < 0.0:
                return None
            if p < 0.0:
                t0 = max(t0, q / p)
            elif p > 0.0:
                t1 = min(t1, q / p)
    if t0 >= t1:
        return None
    return _Seen(np.stack([start + t0 * d, start + t1 * d]), (t0 > 0.0 or bool(behind[0]), t1 < 1.0 or bool(behind[1])))


def _pixel(point: Array, camera: Camera) -> Array:
    return np.array([camera.fx * point[0] / point[2] + camera.cx, camera.fy * point[1] / point[2] + camera.cy])


_Row = tuple[Array, Array, bool, bool, int]
"""Ceiling and floor pixel of a pair, whether each is seen, and the pair's kind."""


class _Pairs:
    """Collects junction pairs from left to right."""

    def __init__(self) -> None:
        self.rows: list[_Row] = []
        self.walls: list[tuple[int, int]] = []
        self.cuts: list[Array] = []

    def add(self, row: _Row) -> int:
        self.rows.append(row)
        return len(self.rows) - 1

    def wireframe(self) -> Wireframe:
        if not self.rows:
            return Wireframe.empty()
        ceiling, floor, ceiling_true, floor_true, kind = zip(*self.rows, strict=True)
        cuts = np.array(self.cuts).reshape(-1, 2, 2, 2)
        return Wireframe(
            np.array(ceiling),
            np.array(floor),
            np.array(ceiling_true),
            np.array(floor_true),
            np.array(self.walls, dtype=np.int64).reshape(-1, 2),
            np.array(kind, dtype=np.int8),
            ceiling_cut=cuts[:, 0],
            floor_cut=cuts[:, 1],
        )


def _wireframe_of(
    panels: list[Panel], camera: Camera, heights: tuple[float, float], gravity: tuple[float, float]
) -> Wireframe:
    """Project panels and clip them to the image."""
    pairs = _Pairs()
    shared: tuple[float, float, int] | None = None  # azimuth, range and index of the last right-hand end
    for panel in panels:
        xz = panel.points()
        level = np.stack([np.stack([xz[:, 0], np.full(2, y), xz[:, 1]], axis=1) for y in heights])
        quad = level @ levelling(gravity)  # (ceiling/floor, left/right, camera xyz)
        ends = [_end(panel, side, quad, camera) for side in (0, 1)]
        if ends[0] is None or ends[1] is None:
            continue
        here = (float(panel.azimuth[0]), float(panel.range[0]))
        met = shared is not None and abs(shared[0] - here[0]) < 1e-9 and abs(shared[1] / here[1] - 1.0) < JOIN_RANGE
        left = shared[2] if met and shared is not None else pairs.add(ends[0])
        right = pairs.add(ends[1])
        shared = (float(panel.azimuth[1]), float(panel.range[1]), right)
        pairs.walls.append((left, right))
        pairs.cuts.append(np.stack([_cuts(quad[row], camera) for row in (0, 1)]))
    return pairs.wireframe()


def _cuts(line: Array, camera: Camera) -> Array:
    """(2, 2) px: where a wall line (left end, right end) is cut by the image border; NaN where it is not."""
    seen = _on_image(line, camera)
    if seen is None:
        return np.full((2, 2), np.nan)
    return np.where(np.array(seen.cut)[:, None], seen.pixels, np.nan)


def _end(panel: Panel, side: int, quad: Array, camera: Camera) -> _Row | None:
    """One end of a panel as a junction pair; None when no part of the panel is on the image."""
    vertical = _on_image(quad[:, side], camera) if panel.kind[side] != BORDER else None
    if vertical is not None:
        top, bottom = vertical.pixels
        return top, bottom, not vertical.cut[0], not vertical.cut[1], panel.kind[side]
    # The left or right image edge cuts the wall: find where its ceiling and floor line cross that edge.
    edge = -0.5 if side == 0 else camera.width - 0.5
    normal = np.array([camera.fx, 0.0, camera.cx - edge])  # camera-frame plane of the pixels u = edge
    row = np.array([-0.5, camera.height - 0.5])
    seen, reached = [False, False], False
    for which in (0, 1):
        a, b = quad[which] @ normal
        t = a / (a - b) if a != b else math.nan
        if not -1e-6 <= t <= 1.0 + 1e-6:
            continue
        reached = True
        point = quad[which, 0] + t * (quad[which, 1] - quad[which, 0])
        if point[2] > NEAR:
            v = float(_pixel(point, camera)[1])
            if (which == 0 and v > camera.height - 0.5) or (which == 1 and v < -0.5):
                return None  # the wall crosses this edge wholly above or below the image
            seen[which] = -0.5 <= v <= camera.height - 0.5
            row[which] = min(max(v, -0.5), camera.height - 0.5)
    if not reached:
        return None
    return np.array([edge, row[0]]), np.array([edge, row[1]]), seen[0], seen[1], BORDER
