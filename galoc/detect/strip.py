"""The upright strip: an image resampled to azimuth and elevation, where every vertical wall edge is a column.

Columns are a fixed angle apart, so a wall looks the same wherever in the view it is, and the field of view is the
number of columns. Rows are finer near the horizon, where a degree of elevation is worth most range.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.camera import Camera, level_directions, levelling

Array = NDArray[np.float64]

ROWS = 128
"""Rows of a strip."""
TOP_RAD = math.radians(64.0)
"""Elevation of the upper border of the first row; the lower border of the last is as far below the horizon."""
BEND = 1.5
"""How much coarser rows become away from the horizon: elevation = TOP_RAD sinh(BEND t) / sinh(BEND), |t| <= 1."""
STEP_RAD = math.radians(0.5)
"""Angle between columns."""
BLOCK = 16
"""The number of columns is a multiple of this."""
MOST_COLUMNS = 240
"""Columns of the widest strip: 120 degrees."""
COLUMN_GROUP = 2
"""Columns of the strip per column of boundary angles: those are 1 degree apart, as rays are."""
SHARPNESS = 1.1
"""Images finer than the strip's middle by more than this factor are shrunk to it first, against aliasing."""


def row_of(elevation_rad: ArrayLike) -> Array:
    """Row coordinate (centre of row i is i) of elevations above the horizon, rad; any shape; not clipped."""
    t = np.arcsinh(np.asarray(elevation_rad, np.float64) / TOP_RAD * math.sinh(BEND)) / BEND
    return np.asarray((1.0 - t) * (ROWS / 2.0) - 0.5)


def elevation_of(row: ArrayLike) -> Array:
    """Elevation above the horizon, rad, of row coordinates; any shape."""
    t = 1.0 - (np.asarray(row, np.float64) + 0.5) / (ROWS / 2.0)
    return np.asarray(TOP_RAD * np.sinh(BEND * t) / math.sinh(BEND))


def columns_for(camera: Camera) -> int:
    """Columns of the strip of a camera: its field of view and 2 degrees on both sides, in whole blocks."""
    wanted = (camera.hfov_rad + math.radians(4.0)) / STEP_RAD
    return min(MOST_COLUMNS, BLOCK * math.ceil(wanted / BLOCK))


def azimuth_of(column: ArrayLike, columns: int) -> Array:
    """Azimuth, rad, right positive, of column coordinates (centre of column i is i) of a strip so wide."""
    return np.asarray((np.asarray(column, np.float64) + 0.5 - columns / 2.0) * STEP_RAD)


def column_azimuths(columns: int) -> Array:
    """(W // COLUMN_GROUP,) azimuth of the columns of boundary angles of a strip of W columns, rad, right positive."""
    return azimuth_of(np.arange(columns // COLUMN_GROUP) * COLUMN_GROUP + (COLUMN_GROUP - 1) / 2.0, columns)


@dataclass(frozen=True, slots=True, eq=False)
class Strip:
    """An image as the network sees it."""

    rgb: NDArray[np.uint8]
    """(ROWS, W, 3) RGB; 0 where the image does not reach."""
    mask: NDArray[np.bool_]
    """(ROWS, W) where it does."""

    @property
    def columns(self) -> int:
        """W."""
        return self.rgb.shape[1]

    @property
    def azimuths(self) -> Array:
        """(W // COLUMN_GROUP,) azimuth of the columns of boundary angles, rad, right positive."""
        return column_azimuths(self.columns)


def upright_strip(image: NDArray[np.uint8], camera: Camera, gravity: ArrayLike, columns: int | None = None) -> Strip:
    """Resample an image.

    Args:
        image: (H, W, 3) uint8 RGB.
        camera: its intrinsics.
        gravity: measured (roll, pitch), rad.
        columns: of the strip, a multiple of ``BLOCK``; None: as many as the camera needs.

    Raises:
        GalocError: gravity that is none.
    """
    columns = columns_for(camera) if columns is None else columns
    x, y = strip_pixels(camera, gravity, columns)
    mask = (x >= -0.5) & (x <= camera.width - 0.5) & (y >= -0.5) & (y <= camera.height - 0.5)
    scale = SHARPNESS / STEP_RAD / max(camera.fx, camera.fy)
    if scale < 1.0:
        size = max(1, round(camera.width * scale)), max(1, round(camera.height * scale))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
        x = (x + 0.5) * np.float32(size[0] / camera.width) - np.float32(0.5)
        y = (y + 0.5) * np.float32(size[1] / camera.height) - np.float32(0.5)
    seen = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    rgb = np.asarray(seen, np.uint8)
    rgb[~mask] = 0
    return Strip(rgb, mask)


def strip_pixels(camera: Camera, gravity: ArrayLike, columns: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(ROWS, W) image column and row, px, that each place of a strip shows; far outside where it is behind."""
    to_pixels = (levelling(gravity) @ camera.matrix.T).astype(np.float32)
    seen = _directions(columns) @ to_pixels
    ahead = seen[:, 2] > 0.02
    depth = np.where(ahead, seen[:, 2], np.float32(1.0))
    x, y = (np.where(ahead, seen[:, i] / depth, np.float32(-1e4)).reshape(ROWS, columns) for i in (0, 1))
    return x, y


@lru_cache(maxsize=16)
def _directions(columns: int) -> NDArray[np.float32]:
    """(ROWS * W, 3) levelled direction of each place of a strip."""
    elevation = elevation_of(np.arange(ROWS))[:, None]
    azimuth = azimuth_of(np.arange(columns), columns)[None, :]
    return level_directions(azimuth, elevation).reshape(-1, 3).astype(np.float32)
