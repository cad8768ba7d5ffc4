"""Numba kernels of the dense log-range likelihood and of the corner-distance profiles it uses."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

BINS = 360
FAR_DEG = 12.0
"""A bearing without a visible map corner within this has none."""


@njit(cache=True, parallel=True)
def corner_distances(positions, ranges, corners):  # type: ignore[no-untyped-def]
    """Angle from each whole degree of bearing to the nearest visible map corner, degrees, cut at ``FAR_DEG``.

    Args:
        positions: (P, 2) m.
        ranges: (P, 360) profiles, m.
        corners: (C, 2) m.

    Returns:
        (P, 360) float32.
    """
    count = positions.shape[0]
    out = np.empty((count, BINS), np.float32)
    reach = int(FAR_DEG)
    for p in prange(count):
        near = np.full(BINS, np.float32(FAR_DEG))
        for c in range(corners.shape[0]):
            dx, dy = corners[c, 0] - positions[p, 0], corners[c, 1] - positions[p, 1]
            distance = math.hypot(dx, dy)
            if distance < 0.05:
                continue
            bearing = math.degrees(math.atan2(dy, dx)) % 360.0
            low = int(bearing)
            seen = max(ranges[p, low % BINS], ranges[p, (low + 1) % BINS])
            if distance > 1.02 * seen + 0.05:
                continue  # hidden: both neighbouring rays end before it
            for k in range(low - reach, low + reach + 2):
                b = k % BINS
                near[b] = min(near[b], np.float32(abs(k - bearing)))
        out[p] = near
    return out


@njit(cache=True, parallel=True, fastmath=True)
def likelihood_volume(  # type: ignore[no-untyped-def]
    log_ranges, corner_deg, headings, offset, stride, seen, precision, least, scale_weight, saturation, corner_bin,
    corner_part, corner_precision, corner_saturation, scale_precision,
):  # fmt: skip
    """Robust log-range log-likelihood of every position and heading, the scale profiled out.

    A ray's residual is ``e = log map range - observed log range - scale``; its squared whitened residual enters as
    ``q c / (q + c)``, which is q near 0 and saturates at c (an occluder that the map does not have costs no more). The
    scale is the prior-weighted mean of the residuals, reweighted once against outliers.

    Args:
        log_ranges: (P, 360) float32.
        corner_deg: (P, 360) float32 from :func:`corner_distances`, or (0, 360) for no corner evidence.
        headings: (V,) whole degrees.
        offset: bearing of the first ray relative to the heading, degrees.
        stride: degrees between rays, a divisor of 360.
        seen: (n,) float32 observed log range (or limit), 0 where there is none.
        precision: (n,) float32 tempered 1/variance, 0 where there is none.
        least: (n,) float32: residuals below this count as this (0 for limits, very negative otherwise).
        scale_weight: (n,) float32: precision of the rays that speak of the scale.
        saturation: float32 c, per ray and tempered alike.
        corner_bin: (J,) bin offset of each observed corner.
        corner_part: (J,) float32 fraction towards the next bin.
        corner_precision: (J,) float32, 1/deg^2.
        corner_saturation: (J,) float32 c of corners.
        scale_precision: float32, 1/variance of the log scale (tempered).

    Returns:
        (P, V) float32 log-likelihood up to a constant.
    """
    count, n = log_ranges.shape[0], seen.shape[0]
    turn = BINS // stride
    out = np.empty((count, headings.shape[0]), np.float32)
    one = np.float32(1.0)
    for p in prange(count):
        # Every stride-th bin side by side, and unrolled, so that the rays of one heading are contiguous.
        wall = np.empty((stride, turn + n), np.float32)
        for r in range(stride):
            for j in range(turn + n):
                wall[r, j] = log_ranges[p, (r + stride * j) % BINS]
        for h in range(headings.shape[0]):
            v = headings[h]
            start = (v + offset) % BINS
            at = wall[start % stride, start // stride : start // stride + n]
            total = scale_precision
            pull = np.float32(0.0)
            for i in range(n):
                d = min(one, max(-one, at[i] - seen[i]))
                total += scale_weight[i]
                pull += scale_weight[i] * d
            scale = pull / total
            total = scale_precision
            pull = np.float32(0.0)
            for i in range(n):
                d = at[i] - seen[i]
                e = d - scale
                r = saturation / (saturation + scale_weight[i] * e * e)
                w = scale_weight[i] * r * r
                total += w
                pull += w * d
            scale = pull / total
            cost = np.float32(0.0)
            for i in range(n):
                e = max(at[i] - seen[i] - scale, least[i])
                q = precision[i] * e * e
                cost += q / (one + q)
            cost *= saturation
            q = scale_precision * scale * scale
            cost += q
            if corner_deg.shape[0] > 0:
                for j in range(corner_bin.shape[0]):
                    b = (v + corner_bin[j]) % BINS
                    c = b + 1 if b + 1 < BINS else 0
                    angle = (one - corner_part[j]) * corner_deg[p, b] + corner_part[j] * corner_deg[p, c]
                    q = corner_precision[j] * angle * angle
                    cost += q * corner_saturation[j] / (q + corner_saturation[j])
            out[p, h] = np.float32(-0.5) * cost
    return out
