"""Numba kernels of the dense masked cosine: every heading of a position at once."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from galoc._correlation import GROUPS, SPAN, correlate
from galoc._vector import load, spread, total

BINS = 360
UNROLLED = 2 * BINS + 16
"""Two turns of a profile, and what 360 rays filled up to whole vectors reach beyond (with weight 0)."""
CHUNK = 64
"""Positions of one parallel task."""


@njit(cache=True, inline="never", fastmath=True, error_model="numpy")
def cosines(profile, seen, start, runs, unrolled, squares, dot, energy):  # type: ignore[no-untyped-def]
    """Cosine of one position at every whole degree of heading.

    Args:
        profile: (360,) float32, m.
        seen: (n,) float32 observation of unit norm, 0 where unknown; n a multiple of LANES.
        start: bearing of its first ray relative to the heading, degrees.
        runs: (R, 2) start and stop of each run of known rays.
        unrolled: (UNROLLED,) float32 work space.
        squares: (2, UNROLLED) float32 work space.
        dot: (GROUPS * SPAN,) float32 work space.
        energy: (360,) float32 output.
    """
    n = seen.shape[0]
    unrolled[: BINS - start] = profile[start:]
    unrolled[BINS - start : 2 * BINS - start] = profile
    unrolled[2 * BINS - start : 2 * BINS] = profile[:start]
    unrolled[2 * BINS :] = np.float32(0.0)
    for j in range(BINS + n):
        squares[0, j] = unrolled[j] * unrolled[j]
    dot[:] = np.float32(0.0)
    for g in range(GROUPS):
        correlate(dot, g * SPAN, unrolled, g * SPAN, seen)
    # Sums of squares over each run by doubling: windows of 1, 2, 4, ... squares. Differences of running sums would
    # cancel where a far wall stands beside a near one.
    energy[:] = np.float32(0.0)
    longest = 0
    for r in range(runs.shape[0]):
        longest = max(longest, runs[r, 1] - runs[r, 0])
    width, length, now = 1, BINS + n, 0
    while True:
        for r in range(runs.shape[0]):
            size = runs[r, 1] - runs[r, 0]
            if size & width:
                skip = runs[r, 0] + (size & (width - 1))
                window = squares[now, skip : skip + BINS]
                for v in range(BINS):
                    energy[v] += window[v]
        if 2 * width > longest:
            break
        length -= width
        low, high, twice = squares[now, :length], squares[now, width : width + length], squares[1 - now, :length]
        for j in range(length):
            twice[j] = low[j] + high[j]
        now = 1 - now
        width *= 2
    for v in range(BINS):
        energy[v] = dot[v] / (math.sqrt(energy[v]) + np.float32(1e-6))


@njit(cache=True, parallel=True)
def best_headings(profiles, rows, seen, start, runs):  # type: ignore[no-untyped-def]
    """Best cosine of each position and the heading it is at: ((P,) float32, (P,) int16 degrees).

    Args:
        profiles: (R, 360) float32, m.
        rows: (P,) which of them.
        seen: see :func:`cosines`, as the rest.
        start: bearing of the first ray relative to the heading, degrees.
        runs: (K, 2).
    """
    count = rows.shape[0]
    best = np.empty(count, np.float32)
    heading = np.empty(count, np.int16)
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        unrolled = np.empty(UNROLLED, np.float32)
        squares = np.empty((2, UNROLLED), np.float32)
        dot = np.empty(GROUPS * SPAN, np.float32)
        cosine = np.empty(BINS, np.float32)
        for p in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK)):
            cosines(profiles[rows[p]], seen, start, runs, unrolled, squares, dot, cosine)
            v = np.argmax(cosine)
            best[p] = cosine[v]
            heading[p] = v
    return best, heading


@njit(cache=True, parallel=True)
def all_headings(profiles, rows, seen, start, runs):  # type: ignore[no-untyped-def]
    """(P, 360) float32: cosine of each position at every whole degree; arguments as :func:`best_headings`."""
    count = rows.shape[0]
    out = np.empty((count, BINS), np.float32)
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        unrolled = np.empty(UNROLLED, np.float32)
        squares = np.empty((2, UNROLLED), np.float32)
        dot = np.empty(GROUPS * SPAN, np.float32)
        for p in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK)):
            cosines(profiles[rows[p]], seen, start, runs, unrolled, squares, dot, out[p])
    return out


@njit(cache=True, parallel=True, fastmath=True, error_model="numpy")
def some_headings(profiles, seen, known, start, headings):  # type: ignore[no-untyped-def]
    """(P, V) float32: cosine of each position at any headings, each of them for itself.

    Args:
        profiles: (P, 360) float32, m.
        seen: (n,) float32 observation of unit norm, 0 where unknown; n a multiple of 16.
        known: (n,) float32 0 or 1.
        start: bearing of its first ray relative to the heading, degrees.
        headings: (V,) 0..359.
    """
    count, n = profiles.shape[0], seen.shape[0]
    out = np.empty((count, headings.shape[0]), np.float32)
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        unrolled = np.zeros(UNROLLED, np.float32)
        zero = spread(np.float32(0.0))
        for p in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK)):
            unrolled[:BINS] = profiles[p]
            unrolled[BINS : 2 * BINS] = profiles[p]
            for h in range(headings.shape[0]):
                at = (headings[h] + start) % BINS
                dots, energies = zero, zero
                for i in range(0, n, 16):
                    wall = load(unrolled, at + i)
                    dots, energies = dots + load(seen, i) * wall, energies + load(known, i) * wall * wall
                out[p, h] = total(dots) / (math.sqrt(total(energies)) + np.float32(1e-6))
    return out


@njit(cache=True, parallel=True, fastmath=True)
def sharpen(cosine):  # type: ignore[no-untyped-def]
    """max(0, cosine)^10 in place, (P, V) float32."""
    for p in prange(cosine.shape[0]):
        row = cosine[p]
        for v in range(row.shape[0]):
            c = max(row[v], np.float32(0.0))
            square = c * c
            fourth = square * square
            row[v] = fourth * fourth * square
