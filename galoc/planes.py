"""The plane test: which poses of a block are left once its walls are taken as the straight lines they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc._plane_kernel import CORNER_X, CORNER_Y, block_planes, listed, plane_poses
from galoc._pyramid_kernel import LEAVES
from galoc.fine import LEAF_X, LEAF_Y, LeafProfiles
from galoc.pyramid import Headings, Int, Level, Nodes, Pyramid

PART = 4096
"""Blocks whose planes are held at once (some 32 MB)."""


@dataclass(frozen=True, slots=True, eq=False)
class PlaneView:
    """An observation under the cosine, as the plane test takes it."""

    seen: NDArray[np.float64]
    """(n,) ranges of unit norm, 0 where unknown."""
    known: NDArray[np.float64]
    """(n,) 0 or 1."""
    start: int
    """Bearing of the first ray relative to the heading, degrees."""
    scale: NDArray[np.float64]
    """(2,) least and greatest scale of the observation over the map."""
    residual: float
    """1 - cos^2 that is to be reached."""


def plane_leaves(
    view: PlaneView, pyramid: Pyramid, profiles: LeafProfiles, level: Level, nodes: Nodes, most: float
) -> tuple[Int, Headings, Int, Int]:
    """Poses below nodes of the block level that may reach the residual.

    Args:
        view: the observation.
        pyramid: with its linear bins.
        profiles: of the leaves.
        level: of the nodes.
        nodes: cells are blocks.
        most: poses of a block beyond which it is to be scored densely instead.

    Returns:
        (K,) leaves, (K,) headings in degrees, (K,) node each comes from, (D,) blocks to be scored densely.
    """
    assert pyramid.linear is not None
    flag = np.zeros(len(pyramid.mask), bool)
    flag[nodes.cells] = True
    blocks = np.flatnonzero(flag)
    bits = np.zeros((len(nodes), level.width), np.uint64)
    for first in range(0, len(blocks), PART):
        part = blocks[first : first + PART]
        here = np.flatnonzero((nodes.cells >= part[0]) & (nodes.cells <= part[-1]))
        corners = profiles.look((part[:, None] * LEAVES + np.array([0, CORNER_X, CORNER_Y])).ravel())
        planes = block_planes(corners.reshape(-1, 3, 360), pyramid.linear[part], 360 + len(view.seen))
        bits[here] = plane_poses(
            planes, np.searchsorted(part, nodes.cells[here]), nodes.headings[here], level.width, view.start, view.seen,
            view.known, view.residual, view.scale, pyramid.mask[part], _X, _Y,
        )  # fmt: skip
    left = np.bincount(nodes.cells, np.bitwise_count(bits).sum(axis=1), len(pyramid.mask))
    crowded = left > most
    keep = np.flatnonzero(~crowded[nodes.cells])
    leaves, headings, parents = listed(bits[keep], nodes.cells[keep], nodes.headings[keep])
    return leaves, headings, keep[parents], np.flatnonzero(crowded)


_X, _Y = LEAF_X.astype(np.float64), LEAF_Y.astype(np.float64)
