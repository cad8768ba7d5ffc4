"""Where polygons lie: rectangles of light texels in their planes, and clusters of neighbours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from galoc_env.render.facet_build import PAD, cross, dot, unit

Array = NDArray[np.float64]

SMALL, BIG = 0.3, 1.5
"""Facets up to SMALL across have the fewest texels; those from BIG on are kept in clusters of their own, m."""
STRIP = 1.75
"""Along facets narrower than SMALL the texels lie farther apart by this factor."""
MOST_TEXELS = 64
"""Along a side of a facet."""
CLUSTER = 24
"""Facets of a cluster at most."""


def extent(values: Array, axis: int) -> tuple[Array, Array]:
    """Smallest and largest values along a short axis; numpy's own reduction takes ten times as long there."""
    low = high = np.asarray(values.take(0, axis))
    for k in range(1, values.shape[axis]):
        here = values.take(k, axis)
        low, high = np.minimum(low, here), np.maximum(high, here)
    return np.asarray(low + 0.0), np.asarray(high + 0.0)  # no -0.0: which zero is less differs by processor


def padded(corners: Array, first: NDArray[np.int64]) -> Array:
    """(N, PAD, 3): corners of every polygon; its last one fills the rest."""
    count = np.diff(first)
    return corners[first[:-1, None] + np.minimum(np.arange(PAD), count[:, None] - 1)]


def light_rectangles(shape: Array, normal: Array, texel_m: float) -> tuple[Array, NDArray[np.int32]]:
    """Rectangle of texels of each polygon, along its longest edge.

    Args:
        shape: (N, PAD, 3) m, see :func:`padded`.
        normal: (N, 3).
        texel_m: spacing aimed at, m.

    Returns:
        (N, 2, 4) affine maps to column and row, and (N, 2) columns and rows.
    """
    edge = np.roll(shape, -1, axis=1) - shape
    longest = np.argmax(dot(edge, edge), axis=1)
    right = unit(edge[np.arange(len(edge)), longest])
    axes = np.stack([right, cross(normal, right)], axis=1)
    place = np.stack([dot(shape, axes[:, None, k]) for k in (0, 1)], axis=1)
    low, high = extent(place, 2)
    size = np.maximum(high - low, 1e-5)
    narrow, wide = extent(size, 1)
    spacing = np.where(narrow < SMALL, STRIP * texel_m, texel_m)[:, None]
    count = np.clip(np.rint(size / spacing) + 1, 2, MOST_TEXELS)
    count[wide < SMALL] = 2
    scale = (count - 1) / size
    return np.concatenate([axes * scale[..., None], -(low * scale)[..., None]], axis=2), count.astype(np.int32)


def clusters(shape: Array) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Order of polygons (N,) in which neighbours follow each other, and where each cluster begins (C + 1,).

    Big and small polygons are kept apart, so that the boxes of the small ones stay tight.
    """
    low, high = extent(shape, 1)
    middle, big = np.ascontiguousarray((low + high).T / 2), extent(high - low, 1)[1] > BIG
    leaves = []
    stack = [np.flatnonzero(~big), np.flatnonzero(big)]
    while stack:
        some = stack.pop()
        if len(some) > CLUSTER:
            here = middle[:, some]
            axis = int(np.argmax(here.max(axis=1) - here.min(axis=1)))
            some = some[np.argsort(here[axis], kind="stable")]
            stack += [some[len(some) // 2 :], some[: len(some) // 2]]
        elif len(some):
            leaves.append(some)
    order = np.concatenate(leaves) if leaves else np.zeros(0, np.int64)
    return order, np.cumsum([0] + [len(leaf) for leaf in leaves]).astype(np.int32)


def boxes(shape: Array, cluster_first: NDArray[np.int32]) -> Array:
    """(C, 2, 3) m: box of each cluster of the ordered polygons."""
    if len(cluster_first) < 2:
        return np.zeros((0, 2, 3))
    low, high = extent(shape, 1)
    low = np.minimum.reduceat(low, cluster_first[:-1], axis=0)
    high = np.maximum.reduceat(high, cluster_first[:-1], axis=0)
    return np.stack([low, high], axis=1)
