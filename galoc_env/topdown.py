"""The plan from above with belief, rays, truth and estimate: fast enough for every step (cv2, cached background)."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc import Estimate, Floorplan

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

PAPER: Colour = (236, 238, 241)
"""Outside the building and behind the panels."""
FLOOR: Colour = (255, 255, 255)
WALL: Colour = (44, 50, 60)
WINDOW: Colour = (120, 190, 230)
FURNITURE: Colour = (214, 208, 198)
INK: Colour = (44, 50, 60)
FAINT: Colour = (120, 128, 140)
TRUTH: Colour = (22, 150, 72)
"""True pose and path: green."""
ESTIMATE: Colour = (232, 84, 28)
"""Estimated pose and path: orange."""
FAN: Colour = (255, 190, 130)
"""Veil over what the estimate sees."""
HEAT: tuple[Colour, ...] = (
    (255, 255, 255),
    (214, 226, 247),
    (150, 178, 235),
    (88, 112, 214),
    (58, 44, 170),
    (38, 8, 96),
)
"""Belief from unlikely to certain, evenly darker."""
MARGIN_PX = 22
"""Free strip around the plan, px."""
HEAD_PX, FOOT_PX = 18, 26
"""Further free strips for a title above and for scale bar and legend below, px."""


@lru_cache(maxsize=32)
def _font(size: int, bold: bool) -> Any:
    from matplotlib import get_data_path
    from PIL import ImageFont

    return ImageFont.truetype(f"{get_data_path()}/fonts/ttf/DejaVuSans{'-Bold' if bold else ''}.ttf", size)


def write(
    image: Image,
    xy: tuple[int, int],
    text: str,
    size: int,
    colour: Colour = INK,
    *,
    bold: bool = False,
    anchor: str = "lm",
) -> int:
    """Write text into an RGB image, in place.

    Args:
        image: (H, W, 3).
        xy: anchor point, px.
        text: one line.
        size: px.
        colour: RGB.
        bold: heavier face.
        anchor: two letters, l/m/r and a/m/s/b: which point of the text ``xy`` is (as in Pillow).

    Returns:
        Width of the text, px.
    """
    from PIL import Image as Pillow
    from PIL import ImageDraw

    font = _font(size, bold)
    x0, y0, x1, y1 = (int(math.floor(v)) for v in font.getbbox(text, anchor=anchor))
    left, top = max(0, xy[0] + x0 - 2), max(0, xy[1] + y0 - 2)
    patch = image[top : xy[1] + y1 + 3, left : xy[0] + x1 + 3]
    if patch.size:
        pillow = Pillow.fromarray(np.ascontiguousarray(patch))
        ImageDraw.Draw(pillow).text((xy[0] - left, xy[1] - top), text, fill=colour, font=font, anchor=anchor)
        patch[:] = np.asarray(pillow)
    return x1 - x0


def heat_lut() -> Image:
    """(256, 3) colours of the belief, from 0 to certain."""
    stops = np.linspace(0, 255, len(HEAT))
    return np.stack([np.interp(np.arange(256), stops, [c[i] for c in HEAT]) for i in range(3)], axis=1).astype(np.uint8)


class TopDown:
    """Draws one plan into pictures of one size."""

    def __init__(self, plan: Floorplan, furniture: Array, width: int, height: int) -> None:
        self.plan = plan
        x0, y0, x1, y1 = plan.bounds
        room = np.array([width, height]) - 2.0 * MARGIN_PX - np.array([0.0, HEAD_PX + FOOT_PX])
        self.px_per_m = float(min(room / np.maximum([x1 - x0, y1 - y0], 1e-6)))
        self._centre = np.array([(x0 + x1) / 2.0, (y0 + y1) / 2.0])
        self._middle = np.array([width / 2.0, (HEAD_PX + height - FOOT_PX) / 2.0])
        self._lut = heat_lut()
        self.background = self._draw_background(furniture, width, height)
        self._cells: tuple[Any, ...] | None = None

    def pixels(self, xy: Array) -> Array:
        """(..., 2) px of plan points (..., 2) m."""
        return self._middle + (np.asarray(xy) - self._centre) * [self.px_per_m, -self.px_per_m]

    def draw(
        self,
        *,
        positions: Array | None = None,
        marginal: Array | None = None,
        resolution: float = 0.0,
        trail: Array | None = None,
        estimates: Array | None = None,
        estimate: Estimate | None = None,
    ) -> Image:
        """One picture.

        Args:
            positions: (P, 2) m, cells of the belief.
            marginal: (P,) their probabilities.
            resolution: size of these cells, m.
            trail: (T, 3) true poses, the last one current.
            estimates: (T, 3) estimated poses, NaN where there was none.
            estimate: the current one, for the ray fan.

        Returns:
            (height, width, 3) uint8 RGB.
        """
        image = self.background.copy()
        if positions is not None and marginal is not None and len(positions):
            self._heat(image, positions, marginal, resolution)
        if estimate is not None:
            self._fan(image, estimate)
        if estimates is not None and len(estimates):
            self._dots(image, estimates[:-1], ESTIMATE)
        if trail is not None and len(trail):
            self._path(image, trail, TRUTH)
            self._body(image, trail[-1], TRUTH)
        if estimates is not None and len(estimates) and np.all(np.isfinite(estimates[-1])):
            self._arrow(image, estimates[-1], ESTIMATE)
        return image

    def _draw_background(self, furniture: Array, width: int, height: int) -> Image:
        import cv2

        free = self.plan.free_space()
        image = np.full((height, width, 3), PAPER, np.uint8)
        inside = self._warp(
            free.inside.astype(np.uint8) * 255, free.origin, free.resolution, width, height, cv2.INTER_AREA
        )
        image[inside > 127] = FLOOR
        self._lines(image, furniture, FURNITURE, max(1, round(0.06 * self.px_per_m)))
        thick = 2 if len(self.plan.segments) < 800 else 1
        self._lines(image, self.plan.segments, WALL, thick)
        windows = [[o.x1, o.y1, o.x2, o.y2] for o in self.plan.openings if o.kind == "window"]
        self._lines(image, np.array(windows).reshape(-1, 4), WINDOW, max(2, round(0.08 * self.px_per_m)))
        self._scale_bar(image)
        return image

    def _warp(self, grid: NDArray, origin: Array, size_m: float, width: int, height: int, mode: int) -> NDArray:
        """A grid whose cell (row, col) is centred at origin + (col + 0.5, row + 0.5) * size, in pixels."""
        import cv2

        scale = size_m * self.px_per_m
        corner = self.pixels(np.asarray(origin) + 0.5 * size_m)
        matrix = np.array([[scale, 0.0, corner[0]], [0.0, -scale, corner[1]]])
        if scale < 0.5 and mode == cv2.INTER_AREA:  # many cells a pixel: average first, or thin walls alias
            factor = int(1.0 / scale)
            small = cv2.resize(grid, None, fx=1.0 / factor, fy=1.0 / factor, interpolation=cv2.INTER_AREA)
            ratio = np.array(grid.shape[::-1]) / np.array(small.shape[::-1])
            return self._warp_affine(small, matrix, ratio, width, height)
        return cv2.warpAffine(grid, matrix, (width, height), flags=cv2.INTER_LINEAR)

    @staticmethod
    def _warp_affine(small: NDArray, matrix: Array, ratio: Array, width: int, height: int) -> NDArray:
        import cv2

        # Centre of small cell j lies at full-grid index (j + 0.5) * ratio - 0.5.
        shrunk = matrix.copy()
        shrunk[:, 2] += matrix[:, :2] @ (0.5 * ratio - 0.5)
        shrunk[:, :2] *= ratio
        return cv2.warpAffine(small, shrunk, (width, height), flags=cv2.INTER_LINEAR)

    def _heat(self, image: Image, positions: Array, marginal: Array, resolution: float) -> None:
        """Blend in the belief on a log scale from well below uniform (white) to all mass in one cell (dark)."""
        import cv2

        if self._cells is None or self._cells[0] is not positions:
            origin = positions.min(axis=0) - resolution / 2.0
            col, row = np.round((positions - origin) / resolution - 0.5).astype(int).T
            self._cells = positions, origin, (row, col), (int(row.max()) + 1, int(col.max()) + 1)
        _, origin, cells, shape = self._cells
        floor = math.log(len(positions)) + 2.5
        level = np.clip((np.log(np.maximum(marginal, 1e-30)) + floor) / floor, 0.0, 1.0)
        grid = np.zeros(shape, np.float32)
        grid[cells] = 255.0 * level
        height, width = image.shape[:2]
        heat = self._warp(grid, origin, resolution, width, height, cv2.INTER_LINEAR)
        colours = self._lut[np.clip(heat, 0, 255).astype(np.uint8)].astype(np.uint16)
        image[:] = (image * colours // 255).astype(np.uint8)  # multiply: walls stay dark, white leaves the paper

    def _fan(self, image: Image, estimate: Estimate) -> None:
        """The observed walls as seen from the estimate: they lie on the plan's walls when the estimate is right.

        The rays have no scale of their own (the localizer matches directions and proportions), so they are drawn at
        the scale at which they fit the plan best.
        """
        import cv2

        rays = estimate.rays
        if rays is None or not rays.known.any() or not np.all(np.isfinite(estimate.pose)):
            return
        known = np.flatnonzero(rays.known)
        bearing = estimate.pose[2] + rays.bearings_rad[known]
        observed = np.maximum(rays.range[known], 1e-9)
        reach = observed * np.median(ranges(self.plan.segments, estimate.pose[:2], bearing) / observed)
        reach = np.minimum(reach, max(60.0, 4.0 * float(np.median(reach))))
        ends = self.pixels(estimate.pose[:2] + reach[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=1))
        sectors = np.split(np.arange(len(known)), np.flatnonzero(np.diff(known) > 1) + 1)
        # Where the range jumps, one wall hides another: there is no wall between the two.
        walls = np.split(np.arange(len(known)), np.flatnonzero(_breaks(known, reach)) + 1)
        centre = self.pixels(estimate.pose[:2])
        veil = image.copy()
        for run in sectors:
            cv2.fillPoly(veil, [_fixed(np.concatenate([centre[None], ends[run]]))], FAN, cv2.LINE_AA, 4)
        image[:] = cv2.addWeighted(veil, 0.42, image, 0.58, 0.0)
        for run in walls:
            cv2.polylines(image, [_fixed(ends[run])], False, ESTIMATE, 2, cv2.LINE_AA, 4)

    def _lines(self, image: Image, segments: Array, colour: Colour, width: int) -> None:
        import cv2

        if len(segments):
            lines = list(_fixed(self.pixels(segments.reshape(-1, 2, 2))))
            cv2.polylines(image, lines, False, colour, width, cv2.LINE_AA, 4)

    def _path(self, image: Image, poses: Array, colour: Colour) -> None:
        import cv2

        cv2.polylines(image, [_fixed(self.pixels(poses[:, :2]))], False, colour, 2, cv2.LINE_AA, 4)

    def _dots(self, image: Image, poses: Array, colour: Colour) -> None:
        import cv2

        for x, y in _fixed(self.pixels(poses[np.isfinite(poses[:, 0]), :2])):
            cv2.circle(image, (int(x), int(y)), 3 << 4, colour, -1, cv2.LINE_AA, 4)

    def _body(self, image: Image, pose: Array, colour: Colour) -> None:
        """The true body, to scale but never too small to see, with its heading."""
        import cv2

        centre, radius = self.pixels(pose[:2]), max(7.0, 0.25 * self.px_per_m)
        point = tuple(int(v) for v in _fixed(centre))
        cv2.circle(image, point, int(radius * 16), (255, 255, 255), -1, cv2.LINE_AA, 4)
        cv2.circle(image, point, int(radius * 16), colour, 3, cv2.LINE_AA, 4)
        nose = centre + 1.9 * radius * np.array([math.cos(pose[2]), -math.sin(pose[2])])
        cv2.line(image, point, tuple(int(v) for v in _fixed(nose)), colour, 3, cv2.LINE_AA, 4)

    def _arrow(self, image: Image, pose: Array, colour: Colour) -> None:
        import cv2

        size = max(9.0, 0.3 * self.px_per_m)
        turn = np.array([0.0, 2.5, math.pi, -2.5]) + pose[2]
        reach = size * np.array([1.25, 1.0, 0.35, 1.0])
        tip = self.pixels(pose[:2]) + reach[:, None] * np.stack([np.cos(turn), -np.sin(turn)], axis=1)
        cv2.fillPoly(image, [_fixed(tip)], colour, cv2.LINE_AA, 4)
        cv2.polylines(image, [_fixed(tip)], True, (255, 255, 255), 1, cv2.LINE_AA, 4)

    def _scale_bar(self, image: Image) -> None:
        import cv2

        height = image.shape[0]
        length = next(
            (m for m in (50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.5) if m * self.px_per_m <= image.shape[1] / 4), 0.2
        )
        right = MARGIN_PX + round(length * self.px_per_m)
        y = height - 16
        cv2.line(image, (MARGIN_PX, y), (right, y), INK, 2)
        for x in (MARGIN_PX, right):
            cv2.line(image, (x, y - 4), (x, y + 4), INK, 2)
        write(image, (right + 8, y), f"{length:g} m", 13)


def ranges(segments: Array, xy: Array, bearings_rad: Array) -> Array:
    """(n,) distance (m) from a point (2,) to the nearest of segments (S, 4) along each bearing; 1 km for none."""
    a = segments[:, :2] - xy
    d = segments[:, 2:] - segments[:, :2]
    u = np.stack([np.cos(bearings_rad), np.sin(bearings_rad)], axis=1)
    across = u[:, :1] * d[:, 1] - u[:, 1:] * d[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (a[:, 0] * d[:, 1] - a[:, 1] * d[:, 0]) / across
        along = (a[:, 0] * u[:, 1:] - a[:, 1] * u[:, :1]) / across
        hit = (along >= 0.0) & (along <= 1.0) & (reach > 0.0)
    return np.where(hit, reach, 1000.0).min(axis=1)


def _breaks(known: NDArray[np.intp], reach: Array) -> NDArray[np.bool_]:
    """(n - 1,) between which neighbouring known rays the observed wall is interrupted."""
    slope = np.abs(np.diff(np.log(reach)))
    around = np.zeros_like(slope)
    # A grazing wall is steep too, but evenly so: a jump stands out against its neighbours.
    around[1:] = slope[:-1]
    around[:-1] = np.maximum(around[:-1], slope[1:])
    return (np.diff(known) > 1) | ((slope > 0.1) & (slope > 2.5 * around))


def _fixed(pixels: Array) -> NDArray[np.int32]:
    """Pixels as cv2 wants them with 4 fractional bits."""
    return np.round(np.clip(pixels, -1e5, 1e5) * 16.0).astype(np.int32)
