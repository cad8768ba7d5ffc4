"""Numba kernel that takes the nodes of one level to their children."""

from __future__ import annotations

import numpy as np
from numba import njit

from galoc._pyramid_kernel import LEAVES


@njit(cache=True)
def children(cells, headings, first, width, width_below):  # type: ignore[no-untyped-def]
    """Children of nodes: cells, headings and the node each comes from.

    Args:
        cells: (N,) int32.
        headings: (N,) int16, degrees.
        first: (C + 1,) first child of each cell.
        width: degrees of a node.
        width_below: degrees of a child.

    Returns:
        (K,) int32 cells, (K,) int16 headings, (K,) int32 parents.
    """
    turns = width // width_below
    total = 0
    for q in range(cells.shape[0]):
        total += (first[cells[q] + 1] - first[cells[q]]) * turns
    out_cells = np.empty(total, np.int32)
    out_headings = np.empty(total, np.int16)
    parents = np.empty(total, np.int32)
    z = 0
    for q in range(cells.shape[0]):
        for c in range(first[cells[q]], first[cells[q] + 1]):
            for t in range(turns):
                out_cells[z] = c
                out_headings[z] = (headings[q] + t * width_below) % 360
                parents[z] = q
                z += 1
    return out_cells, out_headings, parents


@njit(cache=True)
def clear_poses(leaves, headings, parents, mask):  # type: ignore[no-untyped-def]
    """The leaf poses whose leaf keeps the clearance: (K,) int64 leaves, (K,) int16 headings, (K,) int32 parents."""
    out = np.empty(leaves.shape[0], np.int64)
    out_headings = np.empty(leaves.shape[0], np.int16)
    out_parents = np.empty(leaves.shape[0], np.int32)
    z = 0
    for q in range(leaves.shape[0]):
        leaf = np.int64(leaves[q])
        if (mask[leaf // LEAVES] >> np.uint64(leaf % LEAVES)) & np.uint64(1):
            out[z], out_headings[z], out_parents[z] = leaf, headings[q], parents[q]
            z += 1
    return out[:z], out_headings[:z], out_parents[:z]
