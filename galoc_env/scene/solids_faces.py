"""Normals, texture coordinates and simple light of many flat faces at once."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from galoc_env.scene.light import Lighting

Array = NDArray[np.float64]

_BEARINGS = 256
"""Directions that the light of upright faces is tabulated for."""


@lru_cache(maxsize=32)
def circle(sides: int) -> Array:
    """(sides, 2) corners on the unit circle, counter-clockwise, with flat sides along the axes."""
    angle = 2 * math.pi * (np.arange(sides) + 0.5) / sides
    return np.column_stack([np.cos(angle), np.sin(angle)])


def normals(corners: Array) -> Array:
    """(F, 3) unit normals of polygons (F, K, 3), by Newell's sum: right also where corners coincide."""
    a, b = corners, np.roll(corners, -1, axis=1)
    x = ((a[..., 1] - b[..., 1]) * (a[..., 2] + b[..., 2])).sum(axis=1)
    y = ((a[..., 2] - b[..., 2]) * (a[..., 0] + b[..., 0])).sum(axis=1)
    z = ((a[..., 0] - b[..., 0]) * (a[..., 1] + b[..., 1])).sum(axis=1)
    normal = np.stack([x, y, z], axis=1)
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-15)[:, None])


def texture(corners: Array) -> Array:
    """(F, K, 2) m: texture coordinates of polygons in their plane, upright unless they lie flat (then along y)."""
    n = normals(corners)
    flat = np.abs(n[:, 2]) > 0.9
    up = np.where(flat[:, None], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])
    up = up - n * (n * up).sum(axis=1)[:, None]
    up /= np.linalg.norm(up, axis=1)[:, None]
    right = np.stack(
        [
            up[:, 1] * n[:, 2] - up[:, 2] * n[:, 1],
            up[:, 2] * n[:, 0] - up[:, 0] * n[:, 2],
            up[:, 0] * n[:, 1] - up[:, 1] * n[:, 0],
        ],
        axis=1,
    )
    return np.stack([np.einsum("fki,fi->fk", corners, right), np.einsum("fki,fi->fk", corners, up)], axis=2)


@lru_cache(maxsize=8)
def _table(lighting: Lighting) -> tuple[Array, float, float]:
    """Brightness of upright faces by bearing, of what faces up, and of what faces down."""
    angle = 2 * math.pi * np.arange(_BEARINGS) / _BEARINGS
    sides = np.array([lighting.facing((math.cos(a), math.sin(a), 0.0)) for a in angle])
    return sides, lighting.facing((0.0, 0.0, 1.0)), lighting.facing((0.0, 0.0, -1.0))


def facing(lighting: Lighting, normal: Array) -> Array:
    """(F,) brightness by unit normals, blended between upright and level."""
    sides, up, down = _table(lighting)
    bearing = np.arctan2(normal[:, 1], normal[:, 0]) / (2 * math.pi) * _BEARINGS
    side = sides[np.rint(bearing).astype(np.int64) % _BEARINGS]
    level = normal[:, 2] ** 2
    return np.asarray(side * (1 - level) + np.where(normal[:, 2] > 0, up, down) * level)
