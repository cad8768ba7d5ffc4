"""From truncated wall cycles to full corners, and the layout mask (paper, Sec. III-A and III-B).

All constructions are done on the level plane (x/z, y/z): the image of a virtual upright camera, where verticals are
the lines x = const and the vertical vanishing point lies at infinity.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.camera import Camera
from galoc.types import BORDER, Wireframe

Array = NDArray[np.float64]

MIN_FRAGMENT = 1.0 / 32.0
"""A line fragment shorter than this share of the image width fixes no direction (20 of 640 px: at 5 px noise it is off
by 20 degrees)."""


@dataclass(frozen=True, slots=True, eq=False)
class Completed:
    """Wall panels after corner completion. Only pairs that belong to a known panel are kept."""

    ceiling: Array
    """(N, 2) px: ceiling corner P of each pair; may lie outside the image."""
    floor: Array
    """(N, 2) px: floor corner Q of each pair."""
    walls: NDArray[np.int64]
    """(M, 2): known panels as indices into the pairs."""
    pair: NDArray[np.int64]
    """(N,): index of each pair in the wireframe."""
    known: NDArray[np.bool_]
    """(M_all,): for every wall of the wireframe, K (four corners recovered) or U."""
    j_true: NDArray[np.int64]
    """(M_all,): number of actual corners seen, 0..4."""


def true_corners(wireframe: Wireframe) -> NDArray[np.int64]:
    """(M,) the paper's j_true: junctions of each panel that are seen and not made by the left or right image edge."""
    actual = wireframe.kind != BORDER
    seen = (wireframe.ceiling_true & actual).astype(np.int64) + (wireframe.floor_true & actual)
    return np.asarray(seen[wireframe.walls].sum(axis=1), dtype=np.int64)


def complete(wireframe: Wireframe, camera: Camera, gravity: ArrayLike) -> Completed:
    """Complete truncated panels where that is well posed (paper, Sec. III-B).

    j_true = 4: nothing to do. j_true = 3: the missing corner is where the vertical through its partner meets the line
    from its neighbour to the wall's vanishing point. j_true = 2: the missing corners are where the wall's visible
    ceiling or floor line meets a vertical: that of the partner corner, or that of the field of view's edge for a wall
    which the left or right image edge cuts; where only one of the two lines is visible, it gives the vanishing point
    for the other. j_true <= 1: left alone (U).

    Args:
        wireframe: N pairs, M panels.
        camera: intrinsics.
        gravity: (roll, pitch), rad.
    """
    level = _LevelView(wireframe, camera, gravity)
    j_true = true_corners(wireframe)
    recovered: dict[int, tuple[int, Array]] = {}  # pair -> (j_true of the panel it came from, (2, 2) level corners)
    known = np.zeros(len(wireframe.walls), dtype=bool)
    for m, j in enumerate(j_true):
        corners = level.panel(m) if j >= 2 else None
        if corners is None:
            continue
        known[m] = True
        for side, pair in enumerate(wireframe.walls[m]):
            if int(pair) not in recovered or recovered[int(pair)][0] < j:
                recovered[int(pair)] = (int(j), corners[:, side])
    pair = np.array(sorted(recovered), dtype=np.int64)
    pixels = np.array([_to_pixels(recovered[int(p)][1], camera, gravity) for p in pair]).reshape(-1, 2, 2)
    usable = np.all(np.isfinite(pixels), axis=(1, 2))
    known &= ~np.isin(wireframe.walls, pair[~usable]).any(axis=1)
    keep = usable & np.isin(pair, wireframe.walls[known])
    new_index = {int(p): i for i, p in enumerate(pair[keep])}
    walls = np.array([[new_index[int(p)] for p in w] for w in wireframe.walls[known]], dtype=np.int64).reshape(-1, 2)
    return Completed(pixels[keep, 0], pixels[keep, 1], walls, pair[keep], known, j_true)


def _to_pixels(corners: Array, camera: Camera, gravity: ArrayLike) -> Array:
    """Level-plane points (2, 2) to pixels (2, 2)."""
    return camera.project_level(np.concatenate([corners, np.ones((2, 1))], axis=1), gravity)


class _LevelView:
    """The wireframe on the level plane, with the constructions of one panel."""

    def __init__(self, wireframe: Wireframe, camera: Camera, gravity: ArrayLike) -> None:
        self._w = wireframe
        self._camera = camera
        self._gravity = gravity
        self._points = np.stack([self._to_level(wireframe.ceiling), self._to_level(wireframe.floor)])
        cuts = [wireframe.ceiling_cut, wireframe.floor_cut]
        none = np.full((len(wireframe.walls), 2, 2), np.nan)
        self._cuts_px = np.stack([none if c is None else c for c in cuts])
        self._cuts = self._to_level(self._cuts_px)
        self._edge = math.tan(min(camera.hfov_rad, math.radians(178.0)) / 2.0)

    def _to_level(self, pixels: Array) -> Array:
        rays = self._camera.rays_level(pixels, self._gravity)
        z = np.where(rays[..., 2] > 1e-6, rays[..., 2], np.nan)
        return rays[..., :2] / z[..., None]

    def panel(self, m: int) -> Array | None:
        """(ceiling/floor, left/right, xy) corners of panel m on the level plane, or None if not well posed."""
        w, ends = self._w, self._w.walls[m]
        border = w.kind[ends] == BORDER
        seen = np.stack([w.ceiling_true[ends], w.floor_true[ends]]) & ~border
        corners = np.where(seen[..., None], self._points[:, ends], np.nan)
        lines = [self._line(m, row, seen[row], border) for row in (0, 1)]
        for side in (0, 1):
            if seen[:, side].all():
                continue
            x = (-1.0, 1.0)[side] * self._edge if border[side] else corners[0 if seen[0, side] else 1, side, 0]
            for row in (0, 1):
                if not seen[row, side]:
                    anchor = corners[row, 1 - side] if seen[row, 1 - side] else None
                    by_direction = lines[row] is None or bool(seen[1 - row].all())
                    corners[row, side] = (
                        x,
                        (
                            _through_vanishing_point(x, anchor, lines[1 - row])
                            if by_direction
                            else _on_line(x, lines[row])
                        ),
                    )
        above, below = corners[0, :, 1], corners[1, :, 1]
        ordered = corners[:, 0, 0] < corners[:, 1, 0]
        if not (np.all(np.isfinite(corners)) and np.all(above < -1e-3) and np.all(below > 1e-3) and ordered.any()):
            return None
        return corners

    def _line(self, m: int, row: int, seen: NDArray[np.bool_], border: NDArray[np.bool_]) -> tuple[Array, Array] | None:
        """The two measured end points (level plane) of a panel's ceiling or floor line; None if too short."""
        ends = self._w.walls[m]
        flags = (self._w.ceiling_true, self._w.floor_true)[row][ends]
        pixels = (self._w.ceiling, self._w.floor)[row][ends]
        found_px, found = [], []
        for side in (0, 1):
            if seen[side] or (border[side] and flags[side]):
                found_px.append(pixels[side])
                found.append(self._points[row, ends[side]])
            elif np.isfinite(self._cuts[row, m, side]).all():
                found_px.append(self._cuts_px[row, m, side])
                found.append(self._cuts[row, m, side])
        shortest = MIN_FRAGMENT * self._camera.width
        if len(found) < 2 or np.hypot(*(found_px[1] - found_px[0])) < shortest or found[1][0] <= found[0][0]:
            return None
        return found[0], found[1]


def _on_line(x: float, line: tuple[Array, Array] | None) -> float:
    """Level-plane y at abscissa x of the line through two points; NaN without a line."""
    if line is None:
        return math.nan
    (x0, y0), (x1, y1) = line
    return float(y0 + (y1 - y0) * (x - x0) / (x1 - x0))


def _through_vanishing_point(x: float, anchor: Array | None, other: tuple[Array, Array] | None) -> float:
    """Level-plane y at abscissa x of the line from ``anchor`` to the vanishing point of the wall's ``other`` line.

    Lines that meet on the horizon y = 0 have proportional heights at every abscissa.
    """
    if anchor is None or other is None:
        return math.nan
    at_anchor = _on_line(float(anchor[0]), other)
    return float(anchor[1]) * _on_line(x, other) / at_anchor if at_anchor != 0.0 else math.nan


def layout_mask(wireframe: Wireframe, camera: Camera, walls: Iterable[int] | None = None) -> NDArray[np.uint8]:
    """(H, W) uint8 mask of the visible wall panels (1 = wall), the region M of the paper's IoU (Sec. III-A).

    Args:
        wireframe: in pixels of the image.
        camera: for the size of the image.
        walls: which panels; None: all.
    """
    mask = np.zeros((camera.height, camera.width), np.uint8)
    limit = 4.0 * max(camera.width, camera.height)
    for wall in range(len(wireframe.walls)) if walls is None else walls:
        fixed = np.round(np.clip(wall_outline(wireframe, wall, camera), -limit, limit) * 16).astype(np.int32)
        cv2.fillPoly(mask, [fixed.reshape(-1, 1, 2)], 1, shift=4)
    return mask


def wall_outline(wireframe: Wireframe, wall: int, camera: Camera) -> Array:
    """(V, 2) px: outline of what the image shows of a panel, along its ceiling line and back along its floor line."""
    sides = []
    for row, (pixels, flags, cuts) in enumerate(
        (
            (wireframe.ceiling, wireframe.ceiling_true, wireframe.ceiling_cut),
            (wireframe.floor, wireframe.floor_true, wireframe.floor_cut),
        )
    ):
        ends = wireframe.walls[wall]
        middle = [] if cuts is None else [p for p in cuts[wall] if np.isfinite(p).all()]
        line = [pixels[ends[0]], *middle, pixels[ends[1]]]
        edge = (-0.5, camera.height - 0.5)[row]
        outline = [line[0], *line[1:-1], line[-1]]
        # Where the line is beyond the image, the panel reaches into the image's own corner.
        if not flags[ends[1]] and _from_side_to(edge, line[-1], line[-2], camera.width - 0.5):
            outline.insert(-1, np.array([camera.width - 0.5, edge]))
        if not flags[ends[0]] and _from_side_to(edge, line[0], line[1], -0.5):
            outline.insert(1, np.array([-0.5, edge]))
        sides.append(outline)
    return np.array(sides[0] + sides[1][::-1])


def _from_side_to(edge: float, end: Array, following: Array, side: float) -> bool:
    """Whether a point is on a side border (u = ``side``), short of its corner, and the next one is not on it."""
    near = 1e-6
    return abs(end[0] - side) < near and abs(end[1] - edge) > near and abs(following[0] - side) > near


def mask_iou(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    """Intersection over union of two layout masks; 1 when both are empty."""
    union = np.count_nonzero(a | b)
    return float(np.count_nonzero(a & b) / union) if union else 1.0
