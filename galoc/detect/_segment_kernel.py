"""Numba kernels that cut columns of inverse depth into plane walls: exact dynamic programming and robust merging.

A plane wall is ``s = a + b m`` over the abscissa m = tan(azimuth). Every column gives s twice (row 0 from its ceiling
line, row 1 from its floor line), each with a standard deviation and with the odds that it is something else: the
robust cost of a residual of z standard deviations is ``log((1 + odds) / (exp(-z^2 / 2) + odds))``. A line beyond the
image gives a bound instead: a wall at least so near costs nothing.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

SHORTEST = 2
"""Columns of the narrowest wall."""
RIDGE = 1e-6
"""Keeps fits of one column finite, in units of the data's own weight."""
GUESS = 0.1
"""Weight of what is said of a line beyond the image."""
LEAST_BELONGS = 1e-3
"""No column weighs less than this share of itself in the exact cut."""
ROUNDS = 3
"""Rounds of reweighting of a robust fit."""


@njit(cache=True, error_model="numpy")
def cut_walls(m, s, sd, bound, bound_sd, odds, breaks, temper):  # type: ignore[no-untyped-def]
    """Cut columns into walls.

    Args:
        m: (C,) abscissas, ascending.
        s: (2, C) inverse depths.
        sd: (2, C) their standard deviations.
        bound: (2, C) what s is at least where it is only bounded, else NaN; ``s`` is then a guess.
        bound_sd: (2, C) standard deviations with which bounds hold.
        odds: (2, C) odds that they are something else, times the ratio of the two densities at z = 0.
        breaks: (C,) cost of a break before each column, nats.
        temper: columns that share one independent error; costs are divided by it.

    Returns:
        (S + 1,) first column of each wall, and C; (2, C) probability that each datum belongs to its wall's plane.
    """
    count = m.shape[0]
    weight = np.empty((2, count))
    for r in range(2):
        for c in range(count):
            weight[r, c] = 1.0 / (sd[r, c] * sd[r, c] * (1.0 + odds[r, c]))
            if not math.isnan(bound[r, c]):
                weight[r, c] *= GUESS
    belongs = np.empty((2, count))
    bounds = np.zeros(2, np.int64)
    for _ in range(2):
        bounds = best_cut(m, s, weight, breaks, temper)
        bounds = merged(m, s, sd, bound, bound_sd, odds, weight, breaks, bounds, temper)
        for w in range(bounds.shape[0] - 1):
            lo, hi = bounds[w], bounds[w + 1]
            a, b = plane_of(m, s, bound, weight, lo, hi, lo, lo)
            robust_plane(m, s, sd, bound, bound_sd, odds, lo, hi, a, b, belongs)
            measured = 0
            for c in range(lo, hi):
                measured += math.isnan(bound[0, c]) + math.isnan(bound[1, c])
            for r in range(2):
                for c in range(lo, hi):
                    weight[r, c] = max(belongs[r, c], LEAST_BELONGS) / (sd[r, c] * sd[r, c])
                    if not math.isnan(bound[r, c]):
                        weight[r, c] = GUESS / (sd[r, c] * sd[r, c])
                        belongs[r, c] = 0.0 if measured > 0 else GUESS
    return bounds, belongs


@njit(cache=True, error_model="numpy")
def best_cut(m, s, weight, breaks, temper):  # type: ignore[no-untyped-def]
    """(S + 1,) first columns of the walls of least weighted squares plus break costs: exact, O(C^2)."""
    count = m.shape[0]
    sums = np.zeros((count + 1, 6))
    for c in range(count):
        for p in range(6):
            sums[c + 1, p] = sums[c, p]
        for r in range(2):
            w, x, y = weight[r, c], m[c], s[r, c]
            sums[c + 1, 0] += w
            sums[c + 1, 1] += w * x
            sums[c + 1, 2] += w * x * x
            sums[c + 1, 3] += w * y
            sums[c + 1, 4] += w * x * y
            sums[c + 1, 5] += w * y * y
    best = np.full(count + 1, np.inf)
    best[0] = 0.0
    before = np.zeros(count + 1, np.int64)
    for hi in range(1, count + 1):
        for lo in range(0, max(hi - SHORTEST, 0) + 1):
            if not best[lo] < np.inf or hi - lo < SHORTEST <= count:
                continue
            w = sums[hi, 0] - sums[lo, 0]
            x = (sums[hi, 1] - sums[lo, 1]) / w
            y = (sums[hi, 3] - sums[lo, 3]) / w
            xx = sums[hi, 2] - sums[lo, 2] - w * x * x
            xy = sums[hi, 4] - sums[lo, 4] - w * x * y
            yy = sums[hi, 5] - sums[lo, 5] - w * y * y
            value = best[lo] + max(yy - xy * xy / (xx + RIDGE * w), 0.0) / (2.0 * temper)
            if lo > 0:
                value += breaks[lo]
            if value < best[hi]:
                best[hi] = value
                before[hi] = lo
    walls, c = 0, count
    while c > 0:
        c = before[c]
        walls += 1
    bounds = np.empty(walls + 1, np.int64)
    c = count
    for w in range(walls, -1, -1):
        bounds[w] = c
        c = before[c]
    return bounds


@njit(cache=True, error_model="numpy")
def plane_of(m, s, bound, weight, lo, hi, skip_lo, skip_hi):  # type: ignore[no-untyped-def]
    """(a, b) of the weighted plane of columns lo to hi without those from skip_lo to skip_hi.

    Guesses behind bounds count only where next to nothing is measured.
    """
    measured = 0
    for c in range(lo, hi):
        if not skip_lo <= c < skip_hi:
            measured += math.isnan(bound[0, c]) + math.isnan(bound[1, c])
    w = x = y = xx = xy = 0.0
    for c in range(lo, hi):
        if skip_lo <= c < skip_hi:
            continue
        for r in range(2):
            if measured >= 2 * SHORTEST and not math.isnan(bound[r, c]):
                continue
            v, d = weight[r, c], m[c] - m[lo]
            w += v
            x += v * d
            y += v * s[r, c]
            xx += v * d * d
            xy += v * d * s[r, c]
    x, y = x / w, y / w
    b = (xy - w * x * y) / (xx - w * x * x + RIDGE * w)
    return y - b * (x + m[lo]), b


@njit(cache=True, error_model="numpy")
def robust_plane(m, s, sd, bound, bound_sd, odds, lo, hi, a, b, belongs):  # type: ignore[no-untyped-def]
    """Robust cost of the best plane near (a, b) for columns lo to hi, untempered; fills their ``belongs``.

    Bounds pull a plane only a little: a wall that bounds alone know of is any wall near enough.
    """
    measured = 0
    for c in range(lo, hi):
        for r in range(2):
            measured += math.isnan(bound[r, c])
    if measured == 0:
        for c in range(lo, hi):
            belongs[0, c] = belongs[1, c] = 1.0
        return 0.0
    best = np.inf
    for step in range(ROUNDS + 1):
        w = x = y = xx = xy = cost = 0.0
        for c in range(lo, hi):
            for r in range(2):
                at, spread, pull = s[r, c], sd[r, c], 1.0
                if not math.isnan(bound[r, c]):
                    at, spread, pull = max(bound[r, c], a + b * m[c]), bound_sd[r, c], GUESS
                z = (at - a - b * m[c]) / spread
                near = math.exp(-0.5 * z * z)
                cost += math.log((1.0 + odds[r, c]) / (near + odds[r, c]))
                belongs[r, c] = near / (near + odds[r, c])
                v = pull * belongs[r, c] / (spread * spread)
                w += v
                x += v * m[c]
                y += v * at
                xx += v * m[c] * m[c]
                xy += v * m[c] * at
        best = min(best, cost)
        if step == ROUNDS or not w > 0.0:
            break
        x, y = x / w, y / w
        b = (xy - w * x * y) / (xx - w * x * x + RIDGE * w)
        a = y - b * x
    return best


@njit(cache=True, error_model="numpy")
def merged(m, s, sd, bound, bound_sd, odds, weight, breaks, bounds, temper):  # type: ignore[no-untyped-def]
    """Join two neighbours, or three, while one plane explains them at less robust cost: heals wrong columns."""
    scratch = np.empty((2, m.shape[0]))
    while True:
        walls = bounds.shape[0] - 1
        own = np.empty(walls)
        for w in range(walls):
            a, b = plane_of(m, s, bound, weight, bounds[w], bounds[w + 1], 0, 0)
            lo, hi = bounds[w], bounds[w + 1]
            own[w] = robust_plane(m, s, sd, bound, bound_sd, odds, lo, hi, a, b, scratch) / temper
        gain, first, last = 0.0, -1, -1
        for w in range(walls):
            for v in range(w + 1, min(w + 3, walls)):
                lo, hi = bounds[w], bounds[v + 1]
                apart = own[w]
                for u in range(w + 1, v + 1):
                    apart += own[u] + breaks[bounds[u]]
                joint = np.inf
                for start in range(3):
                    if start == 0:
                        a, b = plane_of(m, s, bound, weight, lo, hi, bounds[w + 1], bounds[v])
                    elif start == 1:
                        a, b = plane_of(m, s, bound, weight, lo, bounds[w + 1], 0, 0)
                    else:
                        a, b = plane_of(m, s, bound, weight, bounds[v], hi, 0, 0)
                    joint = min(joint, robust_plane(m, s, sd, bound, bound_sd, odds, lo, hi, a, b, scratch) / temper)
                if apart - joint > gain:
                    gain, first, last = apart - joint, w, v
        if first < 0:
            return bounds
        kept = np.empty(walls - (last - first) + 1, np.int64)
        at = 0
        for w in range(walls + 1):
            if w <= first or w > last:
                kept[at] = bounds[w]
                at += 1
        bounds = kept
