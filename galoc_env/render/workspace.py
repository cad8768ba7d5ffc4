"""Workspace: the buffers that one worker draws with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Sizes = tuple[int, int, int]
"""Facets and clusters of a home, and corners of the facets of a cluster."""

LANES = 16
TILE_ROWS = 8
MOST = 40
"""Corners of a facet after clipping, at most."""


@dataclass(frozen=True, slots=True, eq=False)
class Workspace:
    """Buffers for pictures of one size; never shared between threads."""

    buffers: tuple[NDArray, ...]
    """In the order in which the kernels take them."""
    sizes: Sizes
    """Of the largest home that fits."""

    @classmethod
    def of(cls, width: int, height: int, fineness: int, sizes: Sizes) -> Workspace:
        """Buffers for pictures of ``width`` x ``height`` px, drawn ``fineness`` (1 or 2) times as fine.

        Args:
            width: px.
            height: px.
            fineness: 1 or 2.
            sizes: of the largest home.
        """
        facets, clusters, corners = sizes
        w, h = fineness * width, fineness * height
        stride = -(-w // LANES) * LANES
        f4, i4 = np.float32, np.int32
        return cls(
            (
                np.zeros(h * stride + LANES, f4),  # inverse depth
                np.zeros(h * stride + LANES, i4),  # slot
                np.zeros((stride // LANES) * -(-h // TILE_ROWS), f4),  # coarse inverse depth
                np.zeros((facets, 3)),  # per slot: inverse depth over the image
                np.zeros(facets, i4),  # per slot: its facet
                np.zeros(clusters, i4),  # clusters, nearest first
                np.zeros(clusters),  # their squared distance
                np.zeros(h + LANES, i4),  # first pixel of spans
                np.zeros(h + LANES, i4),  # last pixel
                np.zeros((5, corners + LANES), f4),  # of a cluster: x, y, z times focal lengths, and in pixels
                np.zeros((facets, 20)),  # per slot: texture and light over the image
                np.zeros(facets, np.bool_),  # per slot: whether those are filled in
                np.zeros(3 * LANES, np.uint8),  # the last pixels of a picture
                np.zeros(LANES, f4),
                np.zeros((facets, MOST // 2, 4), f4),  # per slot: number of edges, then they as in the outline below
                np.zeros(3 * w * h if fineness > 1 else 0, np.uint8),  # the finer picture
                np.zeros((MOST, 6)),  # outline of a facet: corner; of each edge lower end, row of the upper, slope; px
                np.zeros(1),  # height above the floor, m
                np.zeros(3 * w * h if fineness > 1 else 0, np.uint8),  # what the floor reflects
            ),
            sizes,
        )
