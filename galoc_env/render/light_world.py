"""Facets as the light kernels take them: in tables, with a grid of cells that says what is where."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc_env.render._light_ray_kernel import fill_grid
from galoc_env.render.facet_build import dot
from galoc_env.render.facet_layout import extent, padded
from galoc_env.render.facets import Facets
from galoc_env.scene.mesh import OUTSIDE

Array = NDArray[np.float64]

CELL = 0.15
"""Edge of the grid's cells, m."""
MOST_CELLS, CELLS_EACH = 400_000, 5
"""Where a plan is so large that it would have more, and more than so many for each facet, cells are larger."""


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """A scene for the kernels."""

    rays: tuple[Any, ...]
    """What :func:`galoc_env.render._light_ray_kernel.trace` takes."""
    step: Array
    """(N, 2) m between texels."""
    size: NDArray[np.int32]
    """(N, 2) columns and rows of texels."""
    first: NDArray[np.int64]
    """(N + 1,) first texel of each facet."""


def make_world(facets: Facets) -> World:
    """Tables and grid of some facets."""
    light = facets.light.astype(np.float64)
    step = 1.0 / np.sqrt(dot(light[:, :, :3], light[:, :, :3]))
    sheets = np.zeros((len(light), 17))
    sheets[:, :4] = facets.plane
    for k in range(2):
        sheets[:, 4 + 4 * k : 7 + 4 * k] = light[:, k, :3] * step[:, k, None]
        sheets[:, 7 + 4 * k] = -light[:, k, 3] * step[:, k]
    sheets[:, 12:14] = (facets.light_size - 1) * step
    shape = padded(facets.vertices.astype(np.float64), facets.first.astype(np.int64))
    edges, rectangle = _edges(facets, sheets)
    sheets[:, 14] = rectangle
    # Lamps shine through their own shades; windows are as tight as walls.
    sheets[:, 15] = (facets.glow == 0) | (facets.semantic == OUTSIDE)
    boxes = np.stack(extent(shape, 1), axis=1)
    low, high = boxes[:, 0].min(axis=0) - 0.1, boxes[:, 1].max(axis=0) + 0.1
    span = high - low
    most = max(MOST_CELLS, CELLS_EACH * len(sheets))
    cell = max(CELL, float(np.cbrt(span[0] * span[1] * span[2] / most)))
    cells = np.ceil(span / cell).astype(np.int64)
    first, items = fill_grid(sheets, boxes, low, cell, cells)
    rays = (sheets, facets.first, edges, low, cell, cells, first, items)
    return World(rays, step, facets.light_size, facets.light_first)


def _edges(facets: Facets, sheets: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Outlines in the plane of each facet, and which facets (N,) fill their rectangle.

    (V, 5): half plane a u + b v + c >= 0 of the edge that leaves each corner, and the corner's own u and v.
    """
    facet = np.repeat(np.arange(len(sheets)), np.diff(facets.first))
    p = facets.vertices.astype(np.float64)
    u = dot(sheets[facet, 4:7], p) - sheets[facet, 7]
    v = dot(sheets[facet, 8:11], p) - sheets[facet, 11]
    following = np.arange(1, len(p) + 1)
    following[facets.first[1:] - 1] = facets.first[:-1]
    du, dv = u[following] - u, v[following] - v
    length = np.maximum(np.sqrt(du * du + dv * dv), 1e-12)
    a, b = -dv / length, du / length
    edges = np.column_stack([a, b, -(a * u + b * v), u, v])
    twice = np.bincount(facet, u * v[following] - v * u[following], len(sheets))
    box = sheets[:, 12] * sheets[:, 13]
    return edges, np.abs(twice / 2 - box) < 1e-4 * box
