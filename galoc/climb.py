"""Local searches on the lattice: a good score to beat, from the best of some evenly spread seeds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from galoc.bound import Bound
from galoc.fine import LeafProfiles
from galoc.pyramid import Pyramid

Int = NDArray[np.int64]
Headings = NDArray[np.int16]
Float32 = NDArray[np.float32]
Scored = tuple[Int, Headings, Float32]
"""Leaves, headings (degrees) and scores of poses."""

STEPS = (8, 4, 4, 2, 2, 1, 1, 1)
"""Steps of a search, leaves; of headings a quarter of that, at least 1 degree, up to two of them."""
_AROUND = np.array([(dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)])


def climb(bound: Bound, pyramid: Pyramid, profiles: LeafProfiles, seeds: int) -> Scored:
    """Where local searches from the best seeds end.

    Args:
        bound: the observation.
        pyramid: of the plan, with its seeds.
        profiles: of the leaves.
        seeds: how many to start from.
    """
    usable = np.flatnonzero(pyramid.seeds >= 0)
    score, heading = bound.dense(pyramid.seed_profiles, usable)
    top = np.argsort(-score, kind="stable")[:seeds]
    leaf, heading, score = pyramid.seeds[usable[top]], heading[top], score[top]
    each = np.arange(len(leaf))
    for step in STEPS:
        around = pyramid.grid.find((pyramid.grid.cells(leaf)[:, None] + step * _AROUND).reshape(-1, 2))
        around = np.where((around >= 0) & pyramid.is_clear(around), around, np.repeat(leaf, len(_AROUND)))
        turns = max(1, step // 4) * np.arange(-2, 3)
        headings = ((np.repeat(heading, len(_AROUND))[:, None] + turns) % 360).astype(np.int16)
        tried = np.empty(headings.shape, np.float32)
        for which, rows in profiles.batches(around):
            part = bound.leaves(profiles.rows, np.repeat(rows, len(turns)), headings[which].ravel())
            tried[which] = part.reshape(-1, len(turns))
        found = tried.reshape(len(leaf), -1)
        best = np.argmax(found, axis=1)
        leaf = around.reshape(len(leaf), -1)[each, best // len(turns)]
        heading = headings.reshape(len(leaf), -1)[each, best]
        score = found[each, best]
    return leaf, heading, score
