"""Numba kernels that fit lines to the columns of a wall, with the covariance that correlated errors leave."""

from __future__ import annotations

import numpy as np
from numba import njit

DEPTH_SD, DEPTH_SLOPE_SD = 3.0, 8.0
"""Spread of inverse depths, in units of the mean height, and of their slope over the abscissa: near walls that are
seen edge-on have steep ones."""


@njit(cache=True, error_model="numpy")
def spread_of(m, y, sd, belongs, lo, hi, keep, centre, value, slope):  # type: ignore[no-untyped-def]
    """Covariance (three numbers) of a line's right-hand side for errors of correlation keep^|i - j| along each row.

    Errors that turn out larger than stated count as large as they are.
    """
    temper = (1.0 + keep) / (1.0 - keep)
    misfit, total = 0.0, 1e-9
    s00 = s01 = s11 = 0.0
    for r in range(y.shape[0]):
        t0 = t1 = 0.0
        for c in range(lo, hi):
            d = m[c] - centre
            z = (y[r, c] - value - slope * d) / sd[r, c]
            misfit += belongs[r, c] * z * z
            total += belongs[r, c]
            f0 = belongs[r, c] / (sd[r, c] * temper)
            f1 = f0 * d
            t0, t1 = keep * t0, keep * t1
            s00 += f0 * f0 + 2.0 * f0 * t0
            s01 += f0 * f1 + f0 * t1 + f1 * t0
            s11 += f1 * f1 + 2.0 * f1 * t1
            t0 += f0
            t1 += f1
    worse = max(1.0, misfit / total)
    return worse * s00, worse * s01, worse * s11


@njit(cache=True, error_model="numpy")
def fit_line(m, y, sd, belongs, lo, hi, keep, prior, prior_sd, out):  # type: ignore[no-untyped-def]
    """Line through columns lo to hi, with the covariance that errors correlated along the wall leave.

    Args:
        m: (C,) abscissas.
        y: (R, C) values; one line for all R rows.
        sd: (R, C) their standard deviations.
        belongs: (R, C) weight of each, 0 to 1.
        lo: first column.
        hi: behind the last one.
        keep: correlation of the errors of neighbouring columns.
        prior: (2,) value in the middle of the columns and slope expected beforehand.
        prior_sd: (2,) their standard deviations.
        out: (6,) gets the centre abscissa, value and slope there, and their variances v00, v01, v11.
    """
    temper = (1.0 + keep) / (1.0 - keep)
    w = x = 0.0
    for c in range(lo, hi):
        for r in range(y.shape[0]):
            v = belongs[r, c] / (sd[r, c] * sd[r, c])
            w += v
            x += v * m[c]
    middle = 0.5 * (m[lo] + m[hi - 1])
    centre = x / w if w > 0.0 else middle
    p0, p1 = 1.0 / (prior_sd[0] * prior_sd[0]), 1.0 / (prior_sd[1] * prior_sd[1])
    expected = prior[0] + prior[1] * (centre - middle)
    h00, h01, h11 = p0, 0.0, p1
    g0, g1 = p0 * expected, p1 * prior[1]
    for c in range(lo, hi):
        d = m[c] - centre
        for r in range(y.shape[0]):
            v = belongs[r, c] / (sd[r, c] * sd[r, c] * temper)
            h00 += v
            h01 += v * d
            h11 += v * d * d
            g0 += v * y[r, c]
            g1 += v * d * y[r, c]
    det = h00 * h11 - h01 * h01
    value, slope = (h11 * g0 - h01 * g1) / det, (h00 * g1 - h01 * g0) / det
    s00, s01, s11 = spread_of(m, y, sd, belongs, lo, hi, keep, centre, value, slope)
    e00, e01, e11 = p0 + s00, s01, p1 + s11  # covariance of (g0, g1)
    i00, i01, i11 = h11 / det, -h01 / det, h00 / det
    out[0], out[1], out[2] = centre, value, slope
    out[3] = i00 * (i00 * e00 + i01 * e01) + i01 * (i00 * e01 + i01 * e11)
    out[4] = i00 * (i01 * e00 + i11 * e01) + i01 * (i01 * e01 + i11 * e11)
    out[5] = i01 * (i01 * e00 + i11 * e01) + i11 * (i01 * e01 + i11 * e11)


@njit(cache=True, error_model="numpy")
def fit_walls(m, y, sd, belongs, bounds, heights, keep, cross_sd, slope_sd, planes, lines):  # type: ignore[no-untyped-def]
    """Fit every wall: its plane from both rows, then each row's own line, which falls back to the plane's.

    Args:
        m: (C,) abscissas.
        y: (2, C) heights of the lines on the level plane, positive.
        sd: (2, C) their standard deviations.
        belongs: (2, C) weight of each.
        bounds: (S + 1,) first columns.
        heights: (2,) ceiling above and floor below the camera.
        keep: correlation of the errors of neighbouring columns.
        cross_sd: relative standard deviation of a line foretold from the other one.
        slope_sd: standard deviation of its slope.
        planes: (S, 6) out, see :func:`fit_line`, of s.
        lines: (S, 2, 6) out, of y.
    """
    count = m.shape[0]
    s, s_sd = np.empty((2, count)), np.empty((2, count))
    for r in range(2):
        for c in range(count):
            s[r, c], s_sd[r, c] = y[r, c] / heights[r], sd[r, c] / heights[r]
    prior, spread = np.zeros(2), np.empty(2)
    for w in range(bounds.shape[0] - 1):
        lo, hi = bounds[w], bounds[w + 1]
        prior[0], prior[1] = 0.5, 0.0
        spread[0], spread[1] = DEPTH_SD, DEPTH_SLOPE_SD
        fit_line(m, s, s_sd, belongs, lo, hi, keep, prior, spread, planes[w])
        middle = 0.5 * (m[lo] + m[hi - 1])
        for r in range(2):
            level = max(planes[w, 1] + planes[w, 2] * (middle - planes[w, 0]), 0.05) * heights[r]
            prior[0], prior[1] = level, planes[w, 2] * heights[r]
            spread[0], spread[1] = cross_sd * level, slope_sd * max(1.0, abs(planes[w, 2]))
            row = slice(r, r + 1)
            fit_line(m, y[row], sd[row], belongs[row], lo, hi, keep, prior, spread, lines[w, r])
