"""Numba kernels that pick distinct peaks out of a score volume."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

PER_POSITION = 6
"""Most peaks over heading kept at one position."""


@njit(cache=True, parallel=True)
def heading_peaks(volume):  # type: ignore[no-untyped-def]
    """The best local maxima over heading of each position.

    Args:
        volume: (P, V) float32; headings go round.

    Returns:
        (P, 6) float32 scores, best first, -inf where there are fewer; (P, 6) int32 heading indices.
    """
    count, turns = volume.shape
    score = np.full((count, PER_POSITION), -np.inf, np.float32)
    heading = np.zeros((count, PER_POSITION), np.int32)
    for p in prange(count):
        before = volume[p, turns - 1]
        for v in range(turns):
            here = volume[p, v]
            after = volume[p, v + 1 if v + 1 < turns else 0]
            # The first of equal neighbours counts, so that a plateau gives one peak; all equal give one as well.
            if here > score[p, PER_POSITION - 1] and here >= after and (here > before or v == 0):
                k = PER_POSITION - 1
                while k > 0 and here > score[p, k - 1]:
                    score[p, k], heading[p, k] = score[p, k - 1], heading[p, k - 1]
                    k -= 1
                score[p, k], heading[p, k] = here, v
            before = here
    return score, heading


@njit(cache=True)
def first_apart(x, y, heading, count, apart_m, apart_rad):  # type: ignore[no-untyped-def]
    """Indices of poses, best first, that are apart from every better one chosen, at most ``count``.

    Args:
        x: (N,) m.
        y: (N,) m.
        heading: (N,) rad.
        count: most to choose.
        apart_m: poses nearer than this ...
        apart_rad: ... and turned by less than this are one.
    """
    chosen = np.empty(min(count, x.shape[0]), np.int64)
    found = 0
    for i in range(x.shape[0]):
        alone = True
        for k in range(found):
            j = chosen[k]
            dx, dy = x[i] - x[j], y[i] - y[j]
            if dx * dx + dy * dy < apart_m * apart_m:
                turn = abs(heading[i] - heading[j]) % math.tau
                if min(turn, math.tau - turn) < apart_rad:
                    alone = False
                    break
        if alone:
            chosen[found] = i
            found += 1
            if found == chosen.shape[0]:
                break
    return chosen[:found]
