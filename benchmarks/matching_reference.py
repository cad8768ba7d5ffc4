"""The dense reference of the matching benchmark: every pose of the lattice, tile by tile."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from matching_frames import Frame
from matching_kernel import dense_cosines
from numpy.typing import NDArray

from galoc.likelihood_bound import LikelihoodBound
from galoc.profiles import Caster
from galoc.pyramid import Pyramid

Int = NDArray[np.int64]

TILE = 40_000
"""Positions of a tile: 58 MB of profiles."""


@dataclass(slots=True, eq=False)
class Best:
    """Best pose that the reference has met."""

    score: float = -math.inf
    leaf: int = -1
    heading: int = 0
    seconds: float = 0.0

    def offer(self, scores: NDArray[np.float32], leaves: Int, headings: Int) -> None:
        """Take the best of these if it is better."""
        k = int(np.argmax(scores))
        if scores[k] > self.score:
            self.score, self.leaf, self.heading = float(scores[k]), int(leaves[k]), int(headings[k])


class Reference:
    """Scores every pose of tiles of positions.

    Args:
        pyramid: whose clear leaves are scored.
        caster: of the plan.
        tiles: to score at most.
    """

    def __init__(self, pyramid: Pyramid, caster: Caster, tiles: int) -> None:
        self._pyramid, self._caster = pyramid, caster
        self._leaves = pyramid.leaves()
        count = -(-len(self._leaves) // TILE)
        self._chosen = np.unique(np.linspace(0, count - 1, min(count, tiles)).astype(int))
        self.scored = sum(len(self._leaves[t * TILE : (t + 1) * TILE]) for t in self._chosen)
        """Positions in the tiles scored."""
        self.whole = self.scored == len(self._leaves)
        """Whether that is all of them."""

    def tiles(self) -> Iterator[tuple[Int, NDArray[np.float32]]]:
        """Leaves and profiles of the tiles."""
        for t in self._chosen:
            leaves = self._leaves[t * TILE : (t + 1) * TILE]
            yield leaves, self._caster(self._pyramid.grid.positions(leaves))

    def middle(self) -> int:
        """Number of tiles after which half are scored."""
        return (len(self._chosen) + 1) // 2


def score_tile(scoring: str, frame: Frame, step: float, profiles: NDArray[np.float32], leaves: Int, best: Best) -> None:
    """Every pose of a tile under one frame: the best one is kept, and the CPU time taken is added."""
    if scoring == "cosine":
        rays = frame.rays
        seen = np.where(rays.known, rays.range, 0.0)
        seen = (seen / np.linalg.norm(seen)).astype(np.float32)
        known = rays.known.astype(np.float32)
        scores, headings = np.empty(len(leaves), np.float32), np.empty(len(leaves), np.int64)
        start = time.process_time()
        dense_cosines(profiles, seen, known, scores, headings)
    else:
        bound, rows = LikelihoodBound(frame.seen, step), np.arange(len(leaves))
        start = time.process_time()
        volume = bound.volume(profiles, rows)
        headings = np.argmax(volume, axis=1)
        scores = volume[rows, headings]
    best.seconds += time.process_time() - start
    best.offer(scores, leaves, headings)
