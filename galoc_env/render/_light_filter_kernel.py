"""Numba kernel that fills gaps in rasters of light."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def fill(values, bad, size, first, rounds):  # type: ignore[no-untyped-def]
    """Replace bad texels (T, 3) by the mean of their good neighbours, in place; ``bad`` (T,) is updated."""
    for f in range(size.shape[0]):
        wide, high, base = size[f, 0], size[f, 1], first[f]
        for _ in range(rounds):
            before = bad[base : first[f + 1]].copy()
            if not before.any():
                break
            for r in range(high):
                for c in range(wide):
                    if not before[r * wide + c]:
                        continue
                    count, total = 0, np.zeros(3)
                    for rr in range(max(0, r - 1), min(high, r + 2)):
                        for cc in range(max(0, c - 1), min(wide, c + 2)):
                            if not before[rr * wide + cc]:
                                count += 1
                                for k in range(3):
                                    total[k] += values[base + rr * wide + cc, k]
                    if count:
                        bad[base + r * wide + c] = False
                        for k in range(3):
                            values[base + r * wide + c, k] = total[k] / count
