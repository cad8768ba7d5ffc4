"""From wall faces around the camera to the wireframe of an image: projected, clipped to its border, flagged."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.camera import Camera, azimuth, levelling
from galoc.types import BORDER, Wireframe

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

JOIN_RANGE = 2e-3
"""Two wall ends at one azimuth are one when their ranges differ by less than this share."""
NEAR = 1e-3
"""What is nearer to the camera plane than this does not project, in the unit of the faces."""
MAX_AZIMUTH = math.radians(89.0)
"""Beyond this a wall leaves no finite image in the levelled view, rad."""
MARGIN_RAD = math.radians(1.0)
"""A view is looked at so far beyond the image border, so that ends just outside are still seen, rad."""


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """One visible stretch of a straight wall."""

    corners: Array
    """(2, 2, 3) level-frame points (x right, y down, z forward): ceiling, floor by left, right end. Any unit, even one
    for each point: only directions count."""
    kind: tuple[int, int]
    """Left and right end: CORNER, OCCLUSION or BORDER, as in :class:`galoc.Wireframe`."""


def wireframe_of(faces: Sequence[Face], camera: Camera, gravity: ArrayLike) -> tuple[Wireframe, IntArray]:
    """Project faces and clip them to the image.

    Args:
        faces: left to right; one that ends where the next begins shares its junction pair.
        camera: intrinsics.
        gravity: (roll, pitch) of the level frame, rad.

    Returns:
        The wireframe, and for each of its N pairs (N, 2) the face and the side (0 left, 1 right) that it is the end of.
    """
    pairs = _Pairs()
    to_camera = levelling(gravity)
    shared: tuple[Array, int] | None = None  # the last right-hand end and its index
    for index, face in enumerate(faces):
        quad = face.corners @ to_camera
        ends = [_end(face.kind[side], side, quad, camera) for side in (0, 1)]
        if ends[0] is None or ends[1] is None:
            continue
        met = shared is not None and _one_end(shared[0], face.corners[:, 0])
        left = shared[1] if met and shared is not None else pairs.add(ends[0], (index, 0))
        right = pairs.add(ends[1], (index, 1))
        shared = (face.corners[:, 1], right)
        pairs.walls.append((left, right))
        pairs.cuts.append(np.stack([_cuts(quad[row], camera) for row in (0, 1)]))
    return pairs.wireframe(), np.array(pairs.ends, np.int64).reshape(-1, 2)


def azimuth_limits(camera: Camera, gravity: ArrayLike) -> tuple[float, float]:
    """Azimuths that the image border reaches, ``MARGIN_RAD`` widened, rad.

    Args:
        camera: intrinsics.
        gravity: (roll, pitch), rad.
    """
    w, h = camera.width - 0.5, camera.height - 0.5
    t = np.linspace(0.0, 1.0, 33)[:, None]
    corners = np.array([[-0.5, -0.5], [w, -0.5], [w, h], [-0.5, h], [-0.5, -0.5]])
    border = np.concatenate([a * (1 - t) + b * t for a, b in zip(corners[:-1], corners[1:], strict=True)])
    rays = camera.rays_level(border, gravity)
    seen = azimuth(rays[rays[:, 2] > 1e-6])
    if len(seen) == 0:
        return -MAX_AZIMUTH, MAX_AZIMUTH
    return max(-MAX_AZIMUTH, float(seen.min()) - MARGIN_RAD), min(MAX_AZIMUTH, float(seen.max()) + MARGIN_RAD)


def _one_end(a: Array, b: Array) -> bool:
    """Whether two wall ends (ceiling/floor, xyz) are one vertical edge: same azimuth, same elevations."""
    (xa, ya, za), (xb, yb, zb) = a.T.tolist(), b.T.tolist()
    if abs(math.atan2(xa[0], za[0]) - math.atan2(xb[0], zb[0])) >= 1e-9:
        return False
    slopes = [(ya[r] / math.hypot(xa[r], za[r]), yb[r] / math.hypot(xb[r], zb[r])) for r in (0, 1)]
    return all(abs(s - t) < JOIN_RANGE * abs(s) for s, t in slopes)


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
        self.ends: list[tuple[int, int]] = []
        self.walls: list[tuple[int, int]] = []
        self.cuts: list[Array] = []

    def add(self, row: _Row, end: tuple[int, int]) -> int:
        self.rows.append(row)
        self.ends.append(end)
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


def _cuts(line: Array, camera: Camera) -> Array:
    """(2, 2) px: where a wall line (left end, right end) is cut by the image border; NaN where it is not."""
    seen = _on_image(line, camera)
    if seen is None:
        return np.full((2, 2), np.nan)
    return np.where(np.array(seen.cut)[:, None], seen.pixels, np.nan)


def _end(kind: int, side: int, quad: Array, camera: Camera) -> _Row | None:
    """One end of a face (camera frame) as a junction pair; None when no part of the face is on the image."""
    vertical = _on_image(quad[:, side], camera) if kind != BORDER else None
    if vertical is not None:
        top, bottom = vertical.pixels
        return top, bottom, not vertical.cut[0], not vertical.cut[1], kind
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
