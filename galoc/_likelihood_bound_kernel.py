"""Numba kernels of the branch and bound over the log-range likelihood.

The likelihood of a pose is taken at one scale g, found by reweighting. Whatever scale that is, the cost is at least

    min_g sum_i rho(p_i e_i^2) + g^2 / var(g),    e_i = distance of o_i + g from the box [L_i, U_i] of log ranges,

with the robust rho increasing. The cost is not convex in g, so g is searched like the pose: each node carries the
interval of scales that its parents left over, cuts it into pieces, and keeps the hull of those that may still do.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from galoc._box_code import LOG_LEAST, LOG_STEP
from galoc._pyramid_kernel import BINS, codes_at
from galoc._vector import at_least_0, load, spread, total, whole_decoded

CHUNK = 256
"""Nodes of one parallel task."""
PIECES = 4
"""Pieces that an interval of scales is cut into."""
NARROW = 0.01
"""Intervals of log scale below this are not cut."""


@njit(inline="always")
def _log_ranges(boxes, cell, bound, bin):  # type: ignore[no-untyped-def]
    """Log ranges of 16 bins, 8 apart, from ``bin`` (0..719) on."""
    codes = whole_decoded(codes_at(boxes, cell, bound, bin))
    return codes * spread(np.float32(LOG_STEP)) + spread(np.float32(LOG_LEAST))


@njit(cache=True, fastmath=True, error_model="numpy")
def least_cost(boxes, cell, start, which, first, last, seen, precision, both, saturation, prior, low, high):  # type: ignore[no-untyped-def]
    """Cost that no pose of a box and no log scale within [low, high] falls below; see :func:`keep_nodes`."""
    zero, one = np.float32(0.0), spread(np.float32(1.0))
    costs = spread(zero)
    above, below = spread(high), spread(low)
    for j in range(first, last):
        r = which[j]
        bin = start + (r & 7) + ((r >> 3) << 7)
        o = load(seen, 16 * j)
        far = at_least_0(_log_ranges(boxes, cell, 0, bin) - o - above)
        near = at_least_0(o + below - _log_ranges(boxes, cell, 1, bin)) * load(both, 16 * j)
        e = far + near
        q = load(precision, 16 * j) * e * e
        costs = costs + q / (one + q)
    g = max(low, -high, zero)
    return saturation * total(costs) + prior * g * g


@njit(cache=True, fastmath=True, error_model="numpy")
def scales_left(boxes, cell, start, which, seen, precision, both, saturation, prior, limit, low, high):  # type: ignore[no-untyped-def]
    """The part of [low, high] at which a pose of the box may cost at most ``limit``: its hull; (1, -1) for none."""
    n = which.shape[0]
    none = (np.float32(1.0), np.float32(-1.0))
    # A part of the rays is a bound as well, and often enough.
    if least_cost(boxes, cell, start, which, 0, 1, seen, precision, both, saturation, prior, low, high) > limit:
        return none
    if n > 1:
        if least_cost(boxes, cell, start, which, 0, n, seen, precision, both, saturation, prior, low, high) > limit:
            return none
    if high - low <= np.float32(NARROW):
        return low, high
    left, right = none
    step = (high - low) / np.float32(PIECES)
    for k in range(PIECES):
        a = low + np.float32(k) * step
        if least_cost(boxes, cell, start, which, 0, n, seen, precision, both, saturation, prior, a, a + step) <= limit:
            left = a
            break
    if left > right and left == np.float32(1.0):
        return none
    for k in range(PIECES):
        b = high - np.float32(k) * step
        if b - step <= left or (
            least_cost(boxes, cell, start, which, 0, n, seen, precision, both, saturation, prior, b - step, b) <= limit
        ):
            right = b
            break
    return left, right


@njit(cache=True, parallel=True)
def keep_nodes(boxes, cells, headings, start, scales, which, seen, precision, both, saturation, prior, limit):  # type: ignore[no-untyped-def]
    """Which of these nodes may hold a pose that costs at most ``limit``, and at which scales.

    Args:
        boxes: (C, 2, 8, 64) uint16, code LOG.
        cells: (N,) boxes of the nodes.
        headings: (N,) degrees.
        start: bearing of ray 0 relative to the heading, degrees.
        scales: (N, 2) float32 log scales left by the parents.
        which: (V,) vectors of rays: vector r holds rays r % 8 + 128 (r // 8), 8 apart.
        seen: (16 V,) float32 observed log ranges by vectors.
        precision: (16 V,) float32 tempered 1 / variance over the saturation; 0 where there is no ray.
        both: (16 V,) float32: 0 for limits, which only farther walls contradict, 1 for ranges.
        saturation: float32.
        prior: float32 precision of the log scale.
        limit: float32.

    Returns:
        (N,) bool, (N, 2) float32 scales.
    """
    count = cells.shape[0]
    keep = np.empty(count, np.bool_)
    left = np.empty((count, 2), np.float32)
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        for q in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK)):
            low, high = scales_left(
                boxes, cells[q], (start + headings[q]) % BINS, which, seen, precision, both, saturation, prior,
                limit, scales[q, 0], scales[q, 1],
            )  # fmt: skip
            keep[q] = low <= high
            left[q, 0], left[q, 1] = low, high
    return keep, left


@njit(cache=True, parallel=True)
def scale_costs(boxes, cells, headings, start, scales, which, seen, precision, both, saturation, prior):  # type: ignore[no-untyped-def]
    """(N,) float32: a cost that no pose of each node falls below at any scale it has left; see :func:`keep_nodes`."""
    count = cells.shape[0]
    out = np.empty(count, np.float32)
    for q in prange(count):
        out[q] = least_cost(
            boxes, cells[q], (start + headings[q]) % BINS, which, 0, which.shape[0], seen, precision, both, saturation,
            prior, scales[q, 0], scales[q, 1],
        )  # fmt: skip
    return out


@njit(cache=True, parallel=True, fastmath=True, error_model="numpy")
def leaf_likelihoods(logs, rows, headings, ray_bin, rays, limit_bin, limits, saturation, scale_precision):  # type: ignore[no-untyped-def]
    """(N,) float32 score of single poses: the formula of :func:`galoc._likelihood_kernel.likelihood_volume`.

    Args:
        logs: (R, 360) float32 log ranges.
        rows: (N,) profile of each pose.
        headings: (N,) whole degrees.
        ray_bin: as there, and the rest.
        rays: (2, n) float32.
        limit_bin: (m,).
        limits: (2, m) float32.
        saturation: float32.
        scale_precision: float32.
    """
    count, n, m = rows.shape[0], ray_bin.shape[0], limit_bin.shape[0]
    out = np.empty(count, np.float32)
    one = np.float32(1.0)
    seen, p = rays[0], rays[1]
    weight = scale_precision
    for i in range(n):
        weight += p[i]
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        d = np.empty(n, np.float32)
        for k in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK)):
            row, v = logs[rows[k]], np.int64(headings[k])
            for i in range(n):
                b = ray_bin[i] + v
                d[i] = row[b if b < BINS else b - BINS] - seen[i]
            pull = np.float32(0.0)
            for i in range(n):
                pull += p[i] * min(one, max(-one, d[i]))
            scale = pull / weight
            total, pull = scale_precision, np.float32(0.0)
            for i in range(n):
                e = d[i] - scale
                ease = one / (one + p[i] * e * e)
                ease *= ease * p[i]
                total += ease
                pull += ease * d[i]
            scale = pull / total
            cost = scale_precision * scale * scale
            for i in range(n):
                e = d[i] - scale
                q = p[i] * e * e
                cost += q / (one + q)
            for i in range(m):
                b = limit_bin[i] + v
                e = max(row[b if b < BINS else b - BINS] - limits[0, i] - scale, np.float32(0.0))
                q = limits[1, i] * e * e
                cost += q / (one + q)
            out[k] = np.float32(-0.5) * saturation * cost
    return out
