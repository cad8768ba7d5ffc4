"""The corners of a map: where a wall ends or turns, the only points of it that a vertical edge in an image can be."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from galoc.floorplan import Floorplan

Array = NDArray[np.float64]

STRAIGHT = math.radians(3.0)
"""Two segments that meet and turn by less than this are one straight wall, rad."""
SAME_M = 2e-3
"""End points closer than this are one, m."""
CLEAN_M = 0.2
"""A corner between segments of at least this length is one that an architect drew; shorter ones are often the steps of
a raster or of a scan, m."""
SHARE_CLEAN, SHARE_ROUGH = 0.9, 0.4
"""How often a corner that is seen is a corner of the map, on a map of clean corners and on one without any."""


def map_corners(plan: Floorplan) -> tuple[Array, float]:
    """End points of wall segments that are no straight continuations.

    Returns:
        (C, 2) m, and the prior share of seen corners that are corners of this map: high on drawings with clean corners,
        low on rasters and scans, whose corners are mostly steps.
    """
    ends = plan.segments.reshape(-1, 2)
    rounded = np.round(ends / SAME_M).astype(np.int64)
    _, first, member = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    member = member.reshape(-1)
    steps = plan.segments[:, 2:] - plan.segments[:, :2]
    length = np.repeat(np.hypot(*steps.T), 2)
    outward = np.repeat(steps, 2, axis=0) * np.tile([[1.0], [-1.0]], (len(steps), 1))
    outward /= np.maximum(length, 1e-9)[:, None]
    count = np.bincount(member)
    total = np.stack([np.bincount(member, outward[:, k]) for k in (0, 1)], axis=1)
    # Two unit vectors that point apart by nearly pi add up to 2 sin(turn / 2).
    straight = (count == 2) & (np.hypot(*total.T) < 2.0 * math.sin(STRAIGHT / 2.0))
    shortest = np.full(len(count), np.inf)
    np.minimum.at(shortest, member, length)
    clean = float(np.mean(shortest[~straight] >= CLEAN_M)) if (~straight).any() else 0.0
    return ends[first[~straight]].copy(), SHARE_ROUGH + (SHARE_CLEAN - SHARE_ROUGH) * clean
