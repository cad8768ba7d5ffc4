"""Numba kernels of the histogram filter: motion, diffusion and fusion over rows (one position, V headings).

A row whose cells are all at the floor is not live: its value is known without its content, which is then neither read
nor written. A converged belief is cheap for that on large plans. Every kernel takes unnormalised rows with a factor
that normalises them, and leaves the greatest cell and the sum of every row behind.
"""

from __future__ import annotations

import numpy as np
from numba import njit

FLAGS = {"reassoc", "contract", "arcp", "nsz", "nnan"}
"""Sums and maxima may be reordered, which lets them be vectorised; infinities stay."""
SAME = np.float32(1.0 + 1e-5)
"""Rows that exceed the floor by less than this factor are at the floor."""


@njit(cache=True, inline="always", error_model="numpy")
def exp32(x):  # type: ignore[no-untyped-def]
    """Exponential of a float32 in [-87, 0.3] to 3e-7: vectorised, which the library's is not."""
    y = x * np.float32(1.44269504)
    n = np.int32(y - np.float32(0.5))
    # The quotient is off by up to 87 ulp: take n ln 2 away in two parts.
    f = (x - np.float32(n) * np.float32(0.693359375)) + np.float32(n) * np.float32(2.12194440e-4)
    r = np.float32(1.0 / 720.0)
    r = r * f + np.float32(1.0 / 120.0)
    r = r * f + np.float32(1.0 / 24.0)
    r = r * f + np.float32(1.0 / 6.0)
    r = r * f + np.float32(0.5)
    r = r * f + np.float32(1.0)
    r = r * f + np.float32(1.0)
    return np.int32((n + np.int32(127)) << np.int32(23)).view(np.float32) * r


@njit(cache=True, inline="always", error_model="numpy")
def log32(x):  # type: ignore[no-untyped-def]
    """Logarithm of a normal positive float32 to 3e-7."""
    bits = np.float32(x).view(np.int32)
    # Counted from sqrt(1/2), so that the mantissa m lies around 1.
    over = np.int32(bits - np.int32(0x3F3504F3))
    e = np.int32(over >> np.int32(23))
    m = np.int32(bits - np.int32(e << np.int32(23))).view(np.float32)
    z = (m - np.float32(1.0)) / (m + np.float32(1.0))
    q = z * z
    s = np.float32(1.0 / 9.0)
    s = s * q + np.float32(1.0 / 7.0)
    s = s * q + np.float32(0.2)
    s = s * q + np.float32(1.0 / 3.0)
    s = s * q + np.float32(1.0)
    return np.float32(np.int32(e)) * np.float32(0.69314718) + np.float32(2.0) * z * s


# Short functions of one row each: with a branch or a second result in the loop, it is not vectorised.
@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def _greatest(row):  # type: ignore[no-untyped-def]
    best = np.float32(-np.inf)
    for v in range(row.shape[0]):
        best = max(best, row[v])
    return best


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def _sum(row):  # type: ignore[no-untyped-def]
    total = np.float32(0.0)
    for v in range(row.shape[0]):
        total += row[v]
    return total


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def _raise(row, more, floor):  # type: ignore[no-untyped-def]
    for v in range(row.shape[0]):
        row[v] = max(floor, row[v] + more)


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def _times(row, factor):  # type: ignore[no-untyped-def]
    for v in range(row.shape[0]):
        row[v] = row[v] * factor


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def _times_exp(row, scale, scores, best, temper, least):  # type: ignore[no-untyped-def]
    for v in range(row.shape[0]):
        row[v] = row[v] * scale * exp32(max(scores[v] - best, least) * temper)


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def _times_power(row, scale, scores, epsilon, power):  # type: ignore[no-untyped-def]
    for v in range(row.shape[0]):
        row[v] = row[v] * scale * exp32(power * log32(epsilon + scores[v]))


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def _scale_raise(row, scale, floor):  # type: ignore[no-untyped-def]
    for v in range(row.shape[0]):
        row[v] = max(floor, row[v] * scale)


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def move(p, live, floor, scale, at, index, offsets, which, start, out, out_live, row_best, row_sum):  # type: ignore[no-untyped-def]
    """Shift every heading by its own whole cells, and roll the headings.

    Args:
        p: (P, V) float32 belief.
        live: (P,) bool.
        floor: float32 value of the cells of rows that are not live, already scaled.
        scale: float32 factor on what is read.
        at: (P,) int64 place of each position in the index map.
        index: flat padded map of positions, -1 where there is none.
        offsets: (D,) int64 distinct motions, as steps in the index map.
        which: (V,) int64 motion that leads to each heading.
        start: (V,) int64 heading that each heading comes from.
        out: (P, V) float32.
        out_live: (P,) bool.
        row_best: (P,) float32.
        row_sum: (P,) float64.
    """
    count, headings = p.shape
    sources = np.empty(offsets.shape[0], np.int64)
    flat = p.reshape(-1)
    out_live[:] = False
    for j in range(count):
        if live[j]:
            for d in range(offsets.shape[0]):
                to = index[at[j] + offsets[d]]
                if to >= 0:
                    out_live[to] = True
    for i in range(count):
        row_best[i], row_sum[i] = floor, np.float64(floor) * headings
        if not out_live[i]:
            continue
        for d in range(offsets.shape[0]):
            near = np.int64(index[at[i] - offsets[d]])
            sources[d] = near * headings if near >= 0 and live[near] else -headings
        row = out[i]
        for v in range(headings):
            cell = sources[which[v]] + start[v]
            # Unsigned: no test for negative indices in the innermost loop.
            row[v] = flat[np.uint64(cell)] if cell >= 0 else np.float32(0.0)
        _scale_raise(row, scale, floor)
        row_best[i], row_sum[i] = _greatest(row), _sum(row)


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def blur(p, live, floor, scale, at, index, step, taps, out, out_live, row_best, row_sum):  # type: ignore[no-untyped-def]
    """Spread positions along one axis; what a wall stops stays where it is, so that no mass is lost.

    ``step`` leads from one cell to the next along the axis in the index map; ``taps`` (2 r + 1,) float32 are symmetric
    and sum to 1; the other arguments are those of :func:`move`.
    """
    count, headings = p.shape
    radius = taps.shape[0] // 2
    sources = np.empty(taps.shape[0], np.int64)
    flat, flat_out = p.reshape(-1), out.reshape(-1)
    for i in range(count):
        some = False
        for k in range(taps.shape[0]):
            j = np.int64(index[at[i] + (k - radius) * step])
            sources[k] = i if j < 0 else j
            some = some or live[sources[k]]
        out_live[i] = some
        row_best[i], row_sum[i] = floor, np.float64(floor) * headings
        if not some:
            continue
        row = out[i]
        to = np.uint64(i * headings)
        row[:] = np.float32(0.0)
        lost = np.float32(0.0)
        for k in range(taps.shape[0]):
            if live[sources[k]]:
                w, start = taps[k] * scale, np.uint64(sources[k] * headings)
                for v in range(np.uint64(headings)):
                    flat_out[to + v] += w * flat[start + v]
            else:
                lost += taps[k] * floor
        _raise(row, lost, floor)
        row_best[i], row_sum[i] = _greatest(row), _sum(row)


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def blur_headings(p, live, floor, scale, taps, row_best, row_sum):  # type: ignore[no-untyped-def]
    """Spread the headings of live rows in place, around the circle; arguments as for :func:`blur`."""
    count, headings = p.shape
    radius = taps.shape[0] // 2
    wide, flat = np.empty(headings + 2 * radius, np.float32), p.reshape(-1)
    for i in range(count):
        row_best[i], row_sum[i] = floor, np.float64(floor) * headings
        if not live[i]:
            continue
        row = p[i]
        wide[radius : radius + headings] = row
        for k in range(radius):
            wide[k] = row[(k - radius) % headings]
            wide[radius + headings + k] = row[k % headings]
        to = np.uint64(i * headings)
        row[:] = np.float32(0.0)
        for k in range(np.uint64(taps.shape[0])):
            w = taps[k] * scale
            for v in range(np.uint64(headings)):
                flat[to + v] += w * wide[k + v]
        _raise(row, np.float32(0.0), floor)
        row_best[i], row_sum[i] = _greatest(row), _sum(row)


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def mix(p, live, keep, add, row_best, row_sum):  # type: ignore[no-untyped-def]
    """Make p keep p + add in live rows; the sums of all rows with it."""
    count, headings = p.shape
    for i in range(count):
        row_best[i] = keep * row_best[i] + add
        row_sum[i] = np.float64(keep) * row_sum[i] + np.float64(add) * headings
        if live[i]:
            row = p[i]
            for v in range(headings):
                row[v] = keep * row[v] + add


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def weigh(p, live, floor, scale, scores, slot, best, temper, least, rest, row_best):  # type: ignore[no-untyped-def]
    """Multiply rows by the likelihood of a frame; rows at the floor only learn what their best cell would become.

    Args:
        p: (P, V) float32, in place.
        live: (P,) bool.
        floor: float32, scaled.
        scale: float32 factor on live rows.
        scores: (R, V) float32 log-likelihood.
        slot: (P,) int64 row of ``scores``, -1 for positions that were not scored.
        best: float32 greatest score.
        temper: float32 weight.
        least: float32 floor of the scores below the best; tempered at least -87, below which exp is no normal float32.
        rest: float32 factor of positions that were not scored.
        row_best: (P,) float32, set.
    """
    for i in range(p.shape[0]):
        j = slot[i]
        if not live[i]:
            top = rest if j < 0 else exp32(max(_greatest(scores[j]) - best, least) * temper)
            row_best[i] = floor * top
            continue
        if j < 0:
            _times(p[i], scale * rest)
        else:
            _times_exp(p[i], scale, scores[j], best, temper, least)
        row_best[i] = _greatest(p[i])


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def weigh_power(p, live, floor, scale, scores, epsilon, power, row_best):  # type: ignore[no-untyped-def]
    """The same with (epsilon + score)^power for scores (P, V) in [0, 1]."""
    for i in range(p.shape[0]):
        if live[i]:
            _times_power(p[i], scale, scores[i], epsilon, power)
            row_best[i] = _greatest(p[i])
        else:
            row_best[i] = floor * exp32(power * log32(epsilon + _greatest(scores[i])))


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def revive(p, live, floor, lowest, scores, slot, best, temper, least, row_best):  # type: ignore[no-untyped-def]
    """Write out the rows that a frame lifts above the new floor ``lowest``; arguments as for :func:`weigh`."""
    for i in range(p.shape[0]):
        if not live[i] and row_best[i] > lowest * SAME:
            live[i] = True
            p[i] = floor
            _times_exp(p[i], np.float32(1.0), scores[slot[i]], best, temper, least)


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def revive_power(p, live, floor, lowest, scores, epsilon, power, row_best):  # type: ignore[no-untyped-def]
    """The same after :func:`weigh_power`."""
    for i in range(p.shape[0]):
        if not live[i] and row_best[i] > lowest * SAME:
            live[i] = True
            p[i] = floor
            _times_power(p[i], np.float32(1.0), scores[i], epsilon, power)


@njit(cache=True, fastmath=FLAGS, error_model="numpy")
def settle(p, live, lowest, best, row_best, row_sum):  # type: ignore[no-untyped-def]
    """Lift every cell to the floor, let go of rows that are at it, and sum up.

    Returns:
        Sum of p log(p / best) over all cells, float64.
    """
    count, headings = p.shape
    one = np.float32(1.0) / best
    total = 0.0
    flat = np.float64(lowest) * headings
    flat_log = flat * np.float64(log32(lowest * one))
    for i in range(count):
        if not live[i] or row_best[i] <= lowest * SAME:
            live[i] = False
            row_best[i], row_sum[i] = lowest, flat
            total += flat_log
            continue
        row = p[i]
        mass, spread = np.float32(0.0), np.float32(0.0)
        for v in range(headings):
            x = max(row[v], lowest)
            row[v] = x
            mass += x
            spread += x * log32(x * one)
        row_sum[i] = mass
        total += np.float64(spread)
    return total
