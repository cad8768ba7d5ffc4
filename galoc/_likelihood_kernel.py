"""Numba kernels of the dense log-range likelihood.

Every inner loop runs over the headings of one position: in a profile written out over two turns the map ranges that a
ray meets at all headings are neighbours, so the loops vectorise and their sums stay in the first-level cache.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

BINS = 360
TOGETHER = 4
"""Rays are scored in fours; ``rays`` is filled up with rays of no precision."""
BLOCK = 32
"""Positions that share one set of buffers."""


@njit(cache=True, parallel=True)
def likelihood_volume(  # type: ignore[no-untyped-def]
    ranges, corner_code, rows, headings, group, ray_bin, rays, limit_bin, limits, corner_bin, corners, saturation,
    scale_precision,
):  # fmt: skip
    """Robust log-range log-likelihood of positions and headings, the scale profiled out.

    The score of one position and heading v, with ``wall[b]`` the log map range of bin b (mod 360) and ``angle[b]`` the
    distance of bin b to the nearest map corner::

        d      = [wall[v + bin] - log_range for rays]
        s      = sum(p * clip(d, -1, 1)) / (sum(p) + scale_precision)
        ease   = 1 / (1 + p * (d - s) ** 2) ** 2
        s      = sum(p * ease * d) / (sum(p * ease) + scale_precision)
        cost   = sum(robust(p * (d - s) ** 2)) + scale_precision * s ** 2
        cost  += sum(robust(p * max(wall[v + bin] - log_limit - s, 0) ** 2)) for limits
        cost  *= saturation
        near   = (1 - part) * angle[v + bin] + part * angle[v + bin + 1] for corners
        cost  += sum(most * robust(p * near ** 2)) for corners
        score  = -cost / 2                      robust(q) = q / (1 + q): q near 0, never more than 1

    so an occluder that the map does not have costs no more than a residual that is moderately large. The scale s is the
    prior-weighted mean of the residuals, reweighted once against outliers. Limits say nothing of the scale.

    Args:
        ranges: (P, 360) float32 profiles, m.
        corner_code: (P, 360) from :func:`galoc._corner_kernel.corner_distances`.
        rows: (R,) positions to score.
        headings: (V,) whole degrees, 0..359.
        group: headings per cell, a divisor of V.
        ray_bin: (n,) 0..359, bin of each ray at heading 0; n a multiple of ``TOGETHER``.
        rays: (2, n) float32 observed log range, and p: 1 / variance over the squared residual that costs half of all.
        limit_bin: (m,) bins of the limits.
        limits: (2, m) float32 log limit, p.
        corner_bin: (J,) bins of the observed corners.
        corners: (3, J) float32 part: fraction towards the next bin, p for angles in steps of ``corner_code``, most.
        saturation: float32, cost of a ray that is far off.
        scale_precision: float32, 1/variance of the log scale over ``saturation``.

    Returns:
        (R, V // group) float32: score up to a constant; with group > 1 the log of the mean likelihood over each cell.
    """
    count = rows.shape[0]
    out = np.empty((count, headings.shape[0] // group), np.float32)
    for block in prange((count + BLOCK - 1) // BLOCK):
        first, last = block * BLOCK, min((block + 1) * BLOCK, count)
        _score_block(
            ranges, corner_code, rows[first:last], headings, group, ray_bin, rays, limit_bin, limits, corner_bin,
            corners, saturation, scale_precision, out[first:last],
        )  # fmt: skip
    return out


@njit(cache=True, fastmath=True, error_model="numpy")
def _score_block(  # type: ignore[no-untyped-def]
    ranges, corner_code, rows, headings, group, ray_bin, rays, limit_bin, limits, corner_bin, corners, saturation,
    scale_precision, out,
):  # fmt: skip
    """:func:`likelihood_volume` of some positions with one set of buffers."""
    width = headings.shape[0]
    n, m, j = ray_bin.shape[0], limit_bin.shape[0], corner_bin.shape[0]
    work = np.empty((4, width), np.float32)
    spare = np.empty((2, max(BINS, width)), np.int32)
    wall, angle = np.empty(2 * BINS, np.float32), np.empty(2 * BINS + 1, np.float32)
    some, near = wall, angle
    at, limit_at, corner_at, next_at = ray_bin, limit_bin, corner_bin, corner_bin + 1
    whole = width == BINS
    for v in range(width):
        whole = whole and headings[v] == v
    if not whole:  # what each ray meets is gathered heading by heading
        some, near = np.empty((n + m) * width, np.float32), np.empty(2 * j * width, np.float32)
        at, limit_at = np.arange(n) * width, np.arange(n, n + m) * width
        corner_at, next_at = np.arange(j) * width, np.arange(j, 2 * j) * width
    for r in range(rows.shape[0]):
        p = rows[r]
        _logs(ranges[p], spare, wall[:BINS])
        for b in range(BINS):
            wall[b + BINS] = wall[b]
        for b in range(2 * BINS + 1 if j > 0 else 0):
            angle[b] = corner_code[p, b % BINS]
        if not whole:
            _gather(wall, ray_bin, headings, some[: n * width])
            _gather(wall, limit_bin, headings, some[n * width :])
            _gather(angle, corner_bin, headings, near[: j * width])
            _gather(angle, corner_bin + 1, headings, near[j * width :])
        scale, cost = work[2], work[3]
        _mean_scale(some, at, rays, scale_precision, scale)
        _reweighted_scale(some, at, rays, scale_precision, work[0], work[1], scale)
        for v in range(width):
            cost[v] = scale_precision * scale[v] * scale[v]
        _add_rays(some, at, rays, scale, cost)
        _add_limits(some, limit_at, limits, scale, cost)
        for v in range(width):
            cost[v] *= saturation
        _add_corners(near, corner_at, next_at, corners, cost)
        if group == 1:
            for v in range(width):
                out[r, v] = np.float32(-0.5) * cost[v]
        else:
            _cell_means(cost, group, work, spare, out[r])


@njit(cache=True)
def _gather(row, bins, headings, out):  # type: ignore[no-untyped-def]
    width = headings.shape[0]
    for i in range(bins.shape[0]):
        for h in range(width):
            out[i * width + h] = row[(headings[h] + bins[i]) % BINS]


@njit(cache=True, fastmath=True, error_model="numpy")
def _logs(row, spare, out):  # type: ignore[no-untyped-def]
    """Natural logarithms of positive numbers to 3e-7, vectorised: x = m 2^e and log m = 2 atanh((m - 1) / (m + 1))."""
    bits = row.view(np.int32)
    size = row.shape[0]
    power, mantissa = spare[0, :size], spare[1, :size]
    for b in range(size):
        e = (bits[b] - np.int32(0x3F3504F3)) >> np.int32(23)  # so that m is within sqrt(1/2)..sqrt(2)
        power[b] = e
        mantissa[b] = bits[b] - (e << np.int32(23))
    m = mantissa.view(np.float32)
    for b in range(size):
        t = (m[b] - np.float32(1.0)) / (m[b] + np.float32(1.0))
        u = t * t
        u *= np.float32(2 / 3) + u * (np.float32(2 / 5) + u * (np.float32(2 / 7) + u * np.float32(2 / 9)))
        out[b] = np.float32(0.6931471805599453) * np.float32(power[b]) + (np.float32(2.0) * t + t * u)


@njit(cache=True, fastmath=True, error_model="numpy")
def _mean_scale(wall, at, rays, scale_precision, scale):  # type: ignore[no-untyped-def]
    """Prior-weighted mean of the residuals, each counted as 1 at most."""
    one, zero = np.float32(1.0), np.float32(0.0)
    seen, p, width = rays[0], rays[1], scale.shape[0]
    total = scale_precision
    for i in range(at.shape[0]):
        total += p[i]
    share = one / total
    scale[:] = zero
    for i in range(0, at.shape[0], 4):
        w0, w1 = wall[at[i] : at[i] + width], wall[at[i + 1] : at[i + 1] + width]
        w2, w3 = wall[at[i + 2] : at[i + 2] + width], wall[at[i + 3] : at[i + 3] + width]
        s0, s1, s2, s3 = seen[i], seen[i + 1], seen[i + 2], seen[i + 3]
        p0, p1, p2, p3 = share * p[i], share * p[i + 1], share * p[i + 2], share * p[i + 3]
        for v in range(width):
            near = p0 * min(one, max(-one, w0[v] - s0)) + p1 * min(one, max(-one, w1[v] - s1))
            scale[v] += near + p2 * min(one, max(-one, w2[v] - s2)) + p3 * min(one, max(-one, w3[v] - s3))


@njit(cache=True, fastmath=True, error_model="numpy")
def _reweighted_scale(wall, at, rays, scale_precision, total, pull, scale):  # type: ignore[no-untyped-def]
    """The mean once more, outliers counted less. Two rays share one division."""
    one = np.float32(1.0)
    seen, p, width = rays[0], rays[1], scale.shape[0]
    pull[:] = np.float32(0.0)
    total[:] = scale_precision
    for i in range(0, at.shape[0], 2):
        w0, w1 = wall[at[i] : at[i] + width], wall[at[i + 1] : at[i + 1] + width]
        s0, s1, p0, p1 = seen[i], seen[i + 1], p[i], p[i + 1]
        for v in range(width):
            d0, d1 = w0[v] - s0, w1[v] - s1
            e0, e1 = d0 - scale[v], d1 - scale[v]
            a, b = one + p0 * e0 * e0, one + p1 * e1 * e1
            t = one / (a * b)
            k0, k1 = p0 * (b * t) * (b * t), p1 * (a * t) * (a * t)
            total[v] += k0 + k1
            pull[v] += k0 * d0 + k1 * d1
    for v in range(width):
        scale[v] = pull[v] / total[v]


@njit(cache=True, fastmath=True, error_model="numpy")
def _add_rays(wall, at, rays, scale, cost):  # type: ignore[no-untyped-def]
    """Robust costs of the rays, over ``saturation``. Four rays share one division."""
    one = np.float32(1.0)
    seen, p, width = rays[0], rays[1], cost.shape[0]
    for i in range(0, at.shape[0], 4):
        w0, w1 = wall[at[i] : at[i] + width], wall[at[i + 1] : at[i + 1] + width]
        w2, w3 = wall[at[i + 2] : at[i + 2] + width], wall[at[i + 3] : at[i + 3] + width]
        s0, s1, s2, s3 = seen[i], seen[i + 1], seen[i + 2], seen[i + 3]
        p0, p1, p2, p3 = p[i], p[i + 1], p[i + 2], p[i + 3]
        for v in range(width):
            s = scale[v]
            e0, e1, e2, e3 = w0[v] - s0 - s, w1[v] - s1 - s, w2[v] - s2 - s, w3[v] - s3 - s
            q0, q1, q2, q3 = p0 * e0 * e0, p1 * e1 * e1, p2 * e2 * e2, p3 * e3 * e3
            # q0/(1+q0) + q1/(1+q1) = (q0 + q1 + 2 q0 q1) / ((1+q0) (1+q1)), and the same once more
            x, y = q0 * q1, q2 * q3
            a, b = one + q0 + q1 + x, one + q2 + q3 + y
            cost[v] += ((q0 + q1 + x + x) * b + (q2 + q3 + y + y) * a) / (a * b)


@njit(cache=True, fastmath=True, error_model="numpy")
def _add_limits(wall, at, limits, scale, cost):  # type: ignore[no-untyped-def]
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(at.shape[0]):
        w, s, p = wall[at[i] : at[i] + cost.shape[0]], limits[0, i], limits[1, i]
        for v in range(cost.shape[0]):
            e = max(w[v] - s - scale[v], zero)
            q = p * e * e
            cost[v] += q / (one + q)


@njit(cache=True, fastmath=True, error_model="numpy")
def _add_corners(angle, at, next_at, corners, cost):  # type: ignore[no-untyped-def]
    one = np.float32(1.0)
    for j in range(at.shape[0]):
        here, there = angle[at[j] : at[j] + cost.shape[0]], angle[next_at[j] : next_at[j] + cost.shape[0]]
        part, p, most = corners[0, j], corners[1, j], corners[2, j]
        for v in range(cost.shape[0]):
            a = here[v] + part * (there[v] - here[v])
            q = p * a * a
            cost[v] += most * q / (one + q)


@njit(cache=True, fastmath=True, error_model="numpy")
def _cell_means(cost, group, work, spare, out):  # type: ignore[no-untyped-def]
    """Log of the mean of exp(-cost / 2) over each ``group`` of headings."""
    cells = out.shape[0]
    least, e, mean = work[0, :cells], work[1], work[2, :cells]
    for c in range(cells):
        low = cost[c * group]
        for k in range(1, group):
            low = min(low, cost[c * group + k])
        least[c] = low
        for k in range(group):
            e[c * group + k] = cost[c * group + k] - low
    for v in range(cost.shape[0]):
        # exp(x) of x = -16..0 as the 16th power of exp(x / 16); what lies lower does not show in a mean of float32.
        x = max(e[v] * np.float32(-0.03125), np.float32(-1.0))
        y = np.float32(0.04117682610319717) + x * (
            np.float32(0.00761402355134061) + x * np.float32(0.0008358456754620769)
        )
        y = np.float32(0.4999690149278028) + x * (np.float32(0.16649028605879335) + x * y)
        y = np.float32(0.9999999759468342) + x * (np.float32(0.9999979030233556) + x * y)
        y *= y
        y *= y
        y *= y
        e[v] = y * y
    share = np.float32(1.0) / np.float32(group)
    for c in range(cells):
        total = np.float32(0.0)
        for k in range(group):
            total += e[c * group + k]
        mean[c] = total * share
    _logs(mean, spare, out)
    for c in range(cells):
        out[c] -= np.float32(0.5) * least[c]
