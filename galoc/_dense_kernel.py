"""Numba kernels of the dense masked cosine: every heading of a position at once."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from galoc._correlation import GROUPS, SPAN, correlate
from galoc._vector import load, spread, store

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
def every_kth_heading(profiles, step, first, bins, seen):  # type: ignore[no-untyped-def]
    """(P, 360 / step) float32: cosine of each position at headings first, first + step, ... over the circle.

    Bins by their rest modulo ``step``: what a ray meets at all headings lies side by side, 16 headings in a vector.

    Args:
        profiles: (P, 360) float32, m.
        step: divisor of 360.
        first: degrees, 0..359.
        bins: (K,) bearing of each known ray relative to the heading, 0..359.
        seen: (K,) float32 their ranges, of unit norm.
    """
    count, turns, rays = profiles.shape[0], BINS // step, bins.shape[0]
    length = 2 * turns + 48
    at = np.empty(rays, np.int64)
    for i in range(rays):
        b = (bins[i] + first) % BINS
        at[i] = b % step * length + b // step
    out = np.empty((count, turns), np.float32)
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        phases = np.zeros(step * length, np.float32)
        dot, energy = np.empty(48, np.float32), np.empty(48, np.float32)
        zero = spread(np.float32(0.0))
        for p in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK)):
            profile = profiles[p]
            for r in range(step):
                once = phases[r * length : r * length + turns]
                for k in range(turns):
                    once[k] = profile[k * step + r]
                phases[r * length + turns : r * length + 2 * turns] = once
            for v in range(0, turns, 48):  # three vectors at a time, whose sums do not wait for each other
                dot0, dot1, dot2 = zero, zero, zero
                energy0, energy1, energy2 = zero, zero, zero
                for i in range(rays):
                    weight = spread(seen[i])
                    wall0, wall1 = load(phases, at[i] + v), load(phases, at[i] + v + 16)
                    wall2 = load(phases, at[i] + v + 32)
                    dot0, dot1, dot2 = dot0 + wall0 * weight, dot1 + wall1 * weight, dot2 + wall2 * weight
                    energy0, energy1 = energy0 + wall0 * wall0, energy1 + wall1 * wall1
                    energy2 = energy2 + wall2 * wall2
                store(dot0, dot, 0)
                store(dot1, dot, 16)
                store(dot2, dot, 32)
                store(energy0, energy, 0)
                store(energy1, energy, 16)
                store(energy2, energy, 32)
                for k in range(min(48, turns - v)):
                    out[p, v + k] = dot[k] / (math.sqrt(energy[k]) + np.float32(1e-6))
    return out


@njit(cache=True, parallel=True, fastmath=True, error_model="numpy")
def some_headings(profiles, seen, known, start, headings):  # type: ignore[no-untyped-def]
    """(P, V) float32: cosine of each position at any headings.

    Args:
        profiles: (P, 360) float32, m.
        seen: (n,) float32 observation of unit norm, 0 where unknown.
        known: (n,) float32 0 or 1.
        start: bearing of its first ray relative to the heading, degrees.
        headings: (V,) 0..359.
    """
    count, n = profiles.shape[0], seen.shape[0]
    out = np.empty((count, headings.shape[0]), np.float32)
    for p in prange(count):
        unrolled = np.zeros(UNROLLED, np.float32)
        unrolled[:BINS] = profiles[p]
        unrolled[BINS : 2 * BINS] = profiles[p]
        for h in range(headings.shape[0]):
            at = (headings[h] + start) % BINS
            wall = unrolled[at : at + n]
            dot, energy = np.float32(0.0), np.float32(0.0)
            for i in range(n):
                dot += seen[i] * wall[i]
                energy += known[i] * wall[i] * wall[i]
            out[p, h] = dot / (math.sqrt(energy) + np.float32(1e-6))
    return out
