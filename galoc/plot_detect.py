"""What a detector found, drawn over its picture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from galoc.camera import Camera
from galoc.overlay import CEILING_RGB, FLOOR_RGB, VERTICAL_RGB, dashes, draw_line, draw_wireframe
from galoc.types import BORDER, OCCLUSION, Wireframe
from galoc.wireframe import layout_mask

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]
Point = NDArray[np.float64]

WALL_RGBS = ((96, 165, 250), (250, 204, 21), (74, 222, 128), (244, 114, 182), (167, 139, 250), (45, 212, 191))
"""Tints of neighbouring walls, by turns."""
TINT = 0.28
"""Share of the tint in a wall's colour."""
LONG_SIDE = (900, 1600)
"""Smaller pictures are enlarged to the first, larger ones shrunk to the second, px."""


def draw_detection(image: Image, wireframe: Wireframe, caption: str = "") -> Image:
    """Draw walls (tinted), their ceiling and floor lines, junctions (circles, hollow where not seen) and verticals.

    Occlusions have dashed verticals. Where the wireframe states standard deviations, a bar through each seen junction
    spans one on both sides.

    Args:
        image: (H, W, 3) uint8 RGB.
        wireframe: in its pixels.
        caption: one line below the picture; "": none.

    Returns:
        (H', W', 3) uint8 RGB, scaled to a size at which lines can be told apart.

    Raises:
        GalocError: not an RGB image.
    """
    draw_wireframe(image, Wireframe.empty())  # refuses what is no picture
    scale = _scale(image.shape)
    canvas, scaled = _resized(image, scale), wireframe.resized(scale, scale)
    canvas = _tinted(canvas, scaled)
    width = max(2, round(min(canvas.shape[:2]) / 300))
    for row, colour in ((0, CEILING_RGB), (1, FLOOR_RGB)):
        for _, a, b in scaled.shown_lines(row):
            draw_line(canvas, a, b, colour, width)
    for pair in np.flatnonzero(scaled.kind != BORDER):
        ends = scaled.ceiling[pair], scaled.floor[pair]
        for a, b in dashes(*ends, 5.0 * width) if scaled.kind[pair] == OCCLUSION else [ends]:
            draw_line(canvas, a, b, VERTICAL_RGB, width)
    for bar in _bars(scaled):
        _draw_bar(canvas, scaled, *bar, width)
    canvas = draw_wireframe(canvas, replace(scaled, walls=np.zeros((0, 2), int), ceiling_cut=None, floor_cut=None))
    return _captioned(canvas, caption) if caption else canvas


def _scale(shape: tuple[int, ...]) -> float:
    low, high = LONG_SIDE
    longest = max(shape[:2])
    return min(high / longest, max(1.0, low / longest))


def _resized(image: Image, scale: float) -> Image:
    height, width = (max(1, round(side * scale)) for side in image.shape[:2])
    how = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC
    return np.array(cv2.resize(image, (width, height), interpolation=how), np.uint8)


def _tinted(canvas: Image, w: Wireframe) -> Image:
    camera = Camera.from_hfov(canvas.shape[1], canvas.shape[0], 90.0)  # only its size counts here
    walls = np.zeros(canvas.shape[:2], np.int16)
    for m in range(len(w.walls)):
        inside = layout_mask(w, camera, (m,)) > 0
        walls[inside] = 1 + m % len(WALL_RGBS)
    tints = np.array([(0, 0, 0), *WALL_RGBS], np.float32)
    mixed = canvas + TINT * (tints[walls] - canvas)
    return np.where(walls[..., None] > 0, np.rint(mixed), canvas).astype(np.uint8)


def _bars(w: Wireframe) -> Iterator[tuple[int, int, float]]:
    """Pair, row and standard deviation (px) of each seen junction that states one."""
    if w.sigma_px is None:
        return
    for row, seen in enumerate((w.ceiling_true, w.floor_true)):
        for pair in np.flatnonzero(seen & np.isfinite(w.sigma_px[:, row]) & (w.sigma_px[:, row] > 0.0)):
            yield int(pair), row, float(w.sigma_px[pair, row])


def _draw_bar(canvas: Image, w: Wireframe, pair: int, row: int, sigma: float, width: int) -> None:
    """A bar with caps along the pair's vertical, white on dark, so that it shows on any wall."""
    middle = (w.ceiling, w.floor)[row][pair]
    along = w.floor[pair] - w.ceiling[pair]
    length = float(np.hypot(*along))
    along = along / length if length > 1e-6 else np.array([0.0, 1.0])
    cap = 2.5 * width * np.array([-along[1], along[0]])
    tips = middle - sigma * along, middle + sigma * along
    strokes = [tips, *((tip - cap, tip + cap) for tip in tips)]
    for colour, thick in (((20, 20, 20), width + 2), ((255, 255, 255), max(1, width - 1))):
        for a, b in strokes:
            draw_line(canvas, a, b, colour, thick)


def _captioned(canvas: Image, caption: str) -> Image:
    """The picture with a dark strip below, and the caption on it as large as fits."""
    height, width = canvas.shape[:2]
    size, thick = 0.62, 1
    (wide, tall), below = cv2.getTextSize(caption, cv2.FONT_HERSHEY_SIMPLEX, size, thick)
    size *= min(1.0, (width - 24) / max(wide, 1))
    strip = np.full((tall + below + 18, width, 3), 24, np.uint8)
    cv2.putText(strip, caption, (12, tall + 9), cv2.FONT_HERSHEY_SIMPLEX, size, (235, 235, 235), thick, cv2.LINE_AA)
    return np.concatenate([canvas, strip])
