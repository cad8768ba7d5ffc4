"""A wireframe drawn over its image."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.errors import GalocError
from galoc.types import BORDER, OCCLUSION, Wireframe

CEILING_RGB = (255, 176, 32)
"""Ceiling lines and junctions: amber."""
FLOOR_RGB = (40, 196, 255)
"""Floor lines and junctions: cyan."""
VERTICAL_RGB = (255, 72, 160)
"""Vertical edges: pink."""
_UNKNOWN_SHARE = 0.35
"""How far a wall that the layout left unknown fades into the image (0 gone, 1 full colour)."""

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]


def draw_wireframe(image: Image, wireframe: Wireframe, known_walls: ArrayLike | None = None) -> Image:
    """Draw ceiling lines, floor lines and verticals with their junctions on a copy of an RGB image.

    Occlusion ends (the wall goes on behind a nearer edge) have dashed verticals; junctions out of the image are
    hollow; pairs cut by the image border have no vertical, for no edge is seen there.

    Args:
        image: (H, W, 3) uint8 RGB.
        wireframe: in the pixels of that image.
        known_walls: (M,) bool, the walls whose place was recovered; the others are drawn faded. None: all.

    Raises:
        GalocError: not an RGB image, or a mask of another length.
    """
    canvas = np.asarray(image)
    if canvas.ndim != 3 or canvas.shape[2] != 3 or canvas.dtype != np.uint8:
        raise GalocError(f"image {canvas.dtype} {canvas.shape}", "uint8 (H, W, 3), RGB", "Convert the image to RGB.")
    known = np.ones(len(wireframe.walls), bool) if known_walls is None else np.asarray(known_walls, dtype=bool)
    if known.shape != (len(wireframe.walls),):
        raise GalocError(f"known_walls {known.shape}", f"({len(wireframe.walls)},) bool", "Pass one flag per wall.")
    canvas = canvas.copy()
    width = max(1, round(min(canvas.shape[:2]) / 240))
    faded = canvas.copy()
    _draw_walls(faded, wireframe, ~known, width)
    canvas = np.rint(canvas + _UNKNOWN_SHARE * (faded.astype(np.float32) - canvas)).astype(np.uint8)
    _draw_walls(canvas, wireframe, known, width)
    _draw_junctions(canvas, wireframe, width)
    return canvas


def _draw_walls(canvas: Image, wireframe: Wireframe, chosen: NDArray[np.bool_], width: int) -> None:
    kind = np.zeros(len(wireframe), np.int8) if wireframe.kind is None else wireframe.kind
    for row, colour in ((0, CEILING_RGB), (1, FLOOR_RGB)):
        for wall, a, b in wireframe.shown_lines(row):
            if chosen[wall]:
                draw_line(canvas, a, b, colour, width)
    for pair in np.unique(wireframe.walls[chosen]):
        if kind[pair] == BORDER:
            continue
        ends = wireframe.ceiling[pair], wireframe.floor[pair]
        for a, b in dashes(*ends, 4.0 * width) if kind[pair] == OCCLUSION else [ends]:
            draw_line(canvas, a, b, VERTICAL_RGB, width)


def _draw_junctions(canvas: Image, wireframe: Wireframe, width: int) -> None:
    import cv2

    kind = np.zeros(len(wireframe), np.int8) if wireframe.kind is None else wireframe.kind
    rows = (
        (wireframe.ceiling, wireframe.ceiling_true, CEILING_RGB),
        (wireframe.floor, wireframe.floor_true, FLOOR_RGB),
    )
    for points, seen, colour in rows:
        for pair in np.flatnonzero(kind != BORDER):
            if not np.all(np.abs(points[pair]) < 4.0 * max(canvas.shape)):
                continue
            centre = (round(float(points[pair, 0])), round(float(points[pair, 1])))
            cv2.circle(canvas, centre, width + 2, (255, 255, 255), -1, cv2.LINE_AA)
            filled = -1 if seen[pair] else max(1, width - 1)
            cv2.circle(canvas, centre, width + 1, colour, filled, cv2.LINE_AA)


def draw_line(canvas: Image, a: NDArray, b: NDArray, colour: Colour, width: int) -> None:
    """Anti-aliased line between float pixels; ends far outside are clipped first, for cv2 takes 32-bit numbers."""
    import cv2

    ends = _clipped(np.asarray(a, float), np.asarray(b, float), canvas.shape[1], canvas.shape[0])
    if ends is not None:
        p, q = (tuple(int(round(x * 16.0)) for x in end) for end in ends)
        cv2.line(canvas, p, q, colour, width, cv2.LINE_AA, 4)


def _clipped(a: NDArray, b: NDArray, width: int, height: int) -> tuple[NDArray, NDArray] | None:
    """The part of a-b within an image (and a margin of its own size), None for none of it (Liang-Barsky)."""
    low, high = np.array([-width, -height], float), np.array([2.0 * width, 2.0 * height])
    d = b - a
    start, stop = 0.0, 1.0
    for axis in range(2):
        if abs(d[axis]) < 1e-12:
            if not low[axis] <= a[axis] <= high[axis]:
                return None
            continue
        t0, t1 = sorted(((low[axis] - a[axis]) / d[axis], (high[axis] - a[axis]) / d[axis]))
        start, stop = max(start, t0), min(stop, t1)
    return (a + start * d, a + stop * d) if start <= stop else None


def dashes(a: NDArray, b: NDArray, dash_px: float) -> Iterator[tuple[NDArray, NDArray]]:
    """The line a-b as dashes of that length, and gaps as long."""
    length = float(np.hypot(*(b - a)))
    count = min(max(1, round(length / (2.0 * dash_px))), 500)
    for i in range(count):
        yield a + (b - a) * (i / count), a + (b - a) * ((i + 0.5) / count)
