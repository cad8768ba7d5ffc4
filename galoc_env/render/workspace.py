"""Workspace: the buffers that one worker draws with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from galoc_env.render._shading_kernel import COEFFICIENTS
from galoc_env.render._visibility_kernel import LANES, MOST, TILE_ROWS

Sizes = tuple[int, int, int]
"""Facets and clusters of a home, and corners of the facets of a cluster."""


class Work(NamedTuple):
    """Buffers as the kernels take them. A slot is a facet that is drawn in the picture at hand."""

    inverse: NDArray[np.float32]
    """(H * stride + 16,) 1 / m: inverse depth of each pixel."""
    slots: NDArray[np.int32]
    """Likewise: the slot that each pixel sees, -1 for none."""
    tiles: NDArray[np.float32]
    """Least inverse depth of each 16 x 8 pixels."""
    order: NDArray[np.int32]
    """(C,) clusters in sight, nearest first."""
    distance: NDArray[np.float64]
    """(C,) m^2: their squared distance."""
    corners: NDArray[np.float32]
    """(5, V + 16) of a cluster: x, y times the focal lengths and z, m; column and row, px."""
    outline: NDArray[np.float64]
    """(40, 6) px: of a facet its corners, and of each edge the lower end, the upper end's row, and its slope."""
    left: NDArray[np.int32]
    """(H + 16,) first pixel of a facet's span in each of its rows."""
    right: NDArray[np.int32]
    """(H + 16,) last pixel."""
    facet_of: NDArray[np.int32]
    """(N,) of each slot."""
    planes: NDArray[np.float64]
    """(N, 3) of each slot: inverse depth at column 0 and row 0, and its change along both."""
    outlines: NDArray[np.float32]
    """(N, 20, 4) of each slot: first the number of edges, then those as in ``outline``."""
    coefficients: NDArray[np.float64]
    """(N, 20) of each slot: texture and light over the image."""
    ready: NDArray[np.bool_]
    """(N,) whether they are filled in."""
    last_rgb: NDArray[np.uint8]
    """(48,) the last 16 pixels of a picture, before those of them that belong to it are copied."""
    last_depth: NDArray[np.float32]
    """(16,) their depth, m."""
    fine: NDArray[np.uint8]
    """(12 * H * W,) the picture twice as fine; empty where it is not drawn."""
    reflection: NDArray[np.uint8]
    """Likewise: what the floor reflects."""


@dataclass(frozen=True, slots=True, eq=False)
class Workspace:
    """Buffers for pictures of one size; never shared between threads."""

    buffers: Work
    """What the kernels take."""
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
        finer = 3 * w * h if fineness > 1 else 0
        work = Work(
            inverse=np.zeros(h * stride + LANES, np.float32),
            slots=np.zeros(h * stride + LANES, np.int32),
            tiles=np.zeros((stride // LANES) * -(-h // TILE_ROWS), np.float32),
            order=np.zeros(clusters, np.int32),
            distance=np.zeros(clusters),
            corners=np.zeros((5, corners + LANES), np.float32),
            outline=np.zeros((MOST, 6)),
            left=np.zeros(h + LANES, np.int32),
            right=np.zeros(h + LANES, np.int32),
            facet_of=np.zeros(facets, np.int32),
            planes=np.zeros((facets, 3)),
            outlines=np.zeros((facets, MOST // 2, 4), np.float32),
            coefficients=np.zeros((facets, COEFFICIENTS)),
            ready=np.zeros(facets, np.bool_),
            last_rgb=np.zeros(3 * LANES, np.uint8),
            last_depth=np.zeros(LANES, np.float32),
            fine=np.zeros(finer, np.uint8),
            reflection=np.zeros(finer, np.uint8),
        )
        return cls(work, sizes)
