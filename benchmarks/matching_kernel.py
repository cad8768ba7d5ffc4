"""Numba kernel of the dense reference: the masked cosine of every pose, as one writes it first."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

BINS = 360


@njit(cache=True, parallel=True, fastmath=True)
def dense_cosines(profiles, seen, known, best, heading):  # type: ignore[no-untyped-def]
    """Best cosine of each position over whole degrees of heading, and that heading.

    Profiles are written out over a turn and the view, so that each dot product runs over neighbours in memory.

    Args:
        profiles: (P, 360) float32, m.
        seen: (n,) float32 observation of unit norm, 0 where unknown.
        known: (n,) float32 0 or 1.
        best: (P,) float32 output.
        heading: (P,) int64 output, degrees.
    """
    n = seen.shape[0]
    middle = (n - 1) // 2
    for p in prange(profiles.shape[0]):
        wall = np.empty(BINS + n, np.float32)
        square = np.empty(BINS + n, np.float32)
        for j in range(BINS + n):
            r = profiles[p, (j - middle + BINS) % BINS]
            wall[j], square[j] = r, r * r
        top, at = np.float32(-1.0), 0
        for v in range(BINS):
            here, squares = wall[v : v + n], square[v : v + n]
            dot, energy = np.float32(0.0), np.float32(0.0)
            for i in range(n):
                dot += seen[i] * here[i]
                energy += known[i] * squares[i]
            score = dot / (math.sqrt(energy) + np.float32(1e-6))
            if score > top:
                top, at = score, v
        best[p], heading[p] = top, at
