"""Numba kernels of the branch and bound over the masked cosine: which boxes of profiles can hold a better pose.

For unit observations l, 1 - cos^2 = min_t |l - t w|^2. Over a box L <= w <= U that is at least

    min_t sum_i k_i (max(0, t L_i - l_i)^2 + max(0, l_i - t U_i)^2),

convex in the one scale t: two tangents certify that it stays above a threshold. A part of the rays bounds it too, and
most boxes fail for every eighth ray already: 16 rays, one vector.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from galoc._box_code import FLOAT_BASE, FLOAT_SHIFT
from galoc._pyramid_kernel import BINS, codes_at
from galoc._vector import at_least_0, float_decoded, load, spread, total

TANGENTS = 5
"""Tangents tried before a box is kept; on average one or two decide."""
CHUNK = 256
"""Nodes of one parallel task."""


@njit(inline="always")
def _ranges(boxes, cell, bound, bin):  # type: ignore[no-untyped-def]
    """Ranges of 16 bins, 8 apart, from ``bin`` (0..719) on."""
    return float_decoded(codes_at(boxes, cell, bound, bin), FLOAT_SHIFT, FLOAT_BASE)


@njit(cache=True, fastmath=True, error_model="numpy")
def may_hold(boxes, cell, start, first, count, seen, known, residual, energy, scale):  # type: ignore[no-untyped-def]
    """False: certainly no profile in the box has a squared residual of at most ``residual`` over these rays.

    Args:
        boxes: (C, 2, 8, 64) uint16.
        cell: which box.
        start: bin of ray 0, 0..359.
        first: first vector of rays to count; vector r holds rays r % 8 + 128 (r // 8), 8 apart.
        count: number of vectors.
        seen: (16 V,) float32 observation of unit norm by vectors, 0 where unknown.
        known: (16 V,) float32 0 or 1.
        residual: float32, 1 - cos^2.
        energy: float32 sum of the squares of these rays of ``seen``.
        scale: (2,) float32 least and greatest scale t.
    """
    zero, two = np.float32(0.0), np.float32(2.0)
    tops, bottoms, lows, highs = spread(zero), spread(zero), spread(zero), spread(zero)
    for r in range(first, first + count):
        bin = start + (r & 7) + ((r >> 3) << 7)
        low, high = _ranges(boxes, cell, 0, bin), _ranges(boxes, cell, 1, bin)
        ray, on = load(seen, 16 * r), load(known, 16 * r)
        tops, bottoms = tops + ray * high, bottoms + ray * low
        lows, highs = lows + on * low * low, highs + on * high * high
    top, energy_low = total(tops), total(lows)
    if top * top < (energy - residual) * energy_low:
        return False
    t = (top + total(bottoms)) / (energy_low + total(highs))
    left_t, left_g, left_d = np.float32(-1.0), zero, zero
    right_t, right_g, right_d = np.float32(-1.0), zero, zero
    for _ in range(TANGENTS):
        t = min(max(t, scale[0]), scale[1])
        scales = spread(t)
        rests, slopes = spread(zero), spread(zero)
        for r in range(first, first + count):
            bin = start + (r & 7) + ((r >> 3) << 7)
            low, high = _ranges(boxes, cell, 0, bin), _ranges(boxes, cell, 1, bin)
            ray, on = load(seen, 16 * r), load(known, 16 * r)
            over, under = at_least_0(scales * low - ray) * on, at_least_0(ray - scales * high)
            rests = rests + over * over + under * under
            slopes = slopes + over * low - under * high
        g, d = total(rests), two * total(slopes)
        if g <= residual:
            return True
        if (t <= scale[0] and d >= zero) or (t >= scale[1] and d <= zero) or d == zero:
            return False
        if d < zero:
            left_t, left_g, left_d = t, g, d
        else:
            right_t, right_g, right_d = t, g, d
        if left_t > zero and right_t > zero:
            t = (right_g - left_g + left_d * left_t - right_d * right_t) / (left_d - right_d)
            if left_g + left_d * (t - left_t) > residual:
                return False
        else:
            t -= (g - residual) / d  # up to here the tangent is above the threshold
            if t <= zero:
                return False
    return True


@njit(cache=True, parallel=True)
def keep_nodes(boxes, cells, headings, start, probe, probe_energy, seen, known, residual, scale):  # type: ignore[no-untyped-def]
    """(N,) bool: which of these nodes may hold a pose within ``residual``.

    Args:
        boxes: (C, 2, 8, 64) uint16.
        cells: (N,) boxes of the nodes.
        headings: (N,) degrees.
        start: bearing of ray 0 relative to the heading, degrees.
        probe: the vector of rays that is tried alone first.
        probe_energy: float32 sum of its squares.
        seen: (16 V,) float32, see :func:`may_hold`.
        known: (16 V,) float32.
        residual: float32.
        scale: (2,) float32.
    """
    count, vectors, one = cells.shape[0], seen.shape[0] // 16, np.float32(1.0)
    out = np.empty(count, np.bool_)
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        for q in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK)):
            at, c = (start + headings[q]) % BINS, cells[q]
            out[q] = may_hold(boxes, c, at, probe, 1, seen, known, residual, probe_energy, scale) and may_hold(
                boxes, c, at, 0, vectors, seen, known, residual, one, scale
            )
    return out


@njit(cache=True, parallel=True, fastmath=True, error_model="numpy")
def cosine_limits(boxes, cells, headings, start, seen, known, slack):  # type: ignore[no-untyped-def]
    """(N,) float32: a cosine that no pose of each node exceeds, l.U / |L|; arguments as :func:`keep_nodes`."""
    count, vectors = cells.shape[0], seen.shape[0] // 16
    out = np.empty(count, np.float32)
    for q in prange(count):
        at = (start + headings[q]) % BINS
        tops, lows = spread(np.float32(0.0)), spread(np.float32(0.0))
        for r in range(vectors):
            bin = at + (r & 7) + ((r >> 3) << 7)
            low, high = _ranges(boxes, cells[q], 0, bin), _ranges(boxes, cells[q], 1, bin)
            tops, lows = tops + load(seen, 16 * r) * high, lows + load(known, 16 * r) * low * low
        top = total(tops)
        out[q] = min(np.float32(1.0), math.sqrt(top * top / total(lows) + slack))
    return out


@njit(cache=True, parallel=True, fastmath=True, error_model="numpy")
def leaf_cosines(profiles, rows, headings, start, seen, known, scale):  # type: ignore[no-untyped-def]
    """(N,) float32 cosine of single poses; with bounds on the scale, the cosine of the best scale within them.

    Args:
        profiles: (R, 360) float32, m.
        rows: (N,) profile of each pose.
        headings: (N,) whole degrees.
        start: bearing of the first ray relative to the heading, degrees.
        seen: (n,) float32 observation of unit norm in the order of the rays, 0 where unknown.
        known: (n,) float32 0 or 1.
        scale: (2,) float32 least and greatest scale t of the observation over the map.
    """
    count, n = rows.shape[0], seen.shape[0]
    out = np.empty(count, np.float32)
    one = np.float32(1.0)
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        for q in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK)):
            at = (start + headings[q]) % BINS
            ahead = min(n, BINS - at)
            dot, energy = np.float32(0.0), np.float32(0.0)
            wall = profiles[rows[q], at : at + ahead]
            for i in range(ahead):
                dot += seen[i] * wall[i]
                energy += known[i] * wall[i] * wall[i]
            more = min(n - ahead, BINS)  # what 360 rays are filled up with beyond has weight 0
            wall = profiles[rows[q], :more]
            seen_rest, known_rest = seen[ahead:], known[ahead:]
            for i in range(more):
                dot += seen_rest[i] * wall[i]
                energy += known_rest[i] * wall[i] * wall[i]
            t = dot / energy
            if t < scale[0] or t > scale[1]:
                t = min(max(t, scale[0]), scale[1])
                rest = one - np.float32(2.0) * t * dot + t * t * energy
                out[q] = math.sqrt(max(np.float32(0.0), one - rest))
            else:
                out[q] = dot / (math.sqrt(energy) + np.float32(1e-6))
    return out
