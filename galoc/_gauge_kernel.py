"""Numba kernels of the gauge scan: sigma_min(A(theta)) from the tridiagonal A^T A by Sturm bisection."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

POLE = 1e-6
"""A floor ray whose |z| is below this share of its horizontal norm is at a pole of lambda (90 deg - azimuth)."""
TINY = 1e-300
"""Stands in for a pivot that is exactly zero."""


@njit(cache=True)
def tridiagonal(p, q, theta, diagonal, off):  # type: ignore[no-untyped-def]
    """Fill the diagonal and the entries beside it of A(theta)^T A(theta); False at a pole.

    A^T A is tridiagonal because every row of A touches one depth or two neighbouring ones.

    Args:
        p: (N, 3) levelled ceiling rays.
        q: (N, 3) levelled floor rays.
        theta: rad.
        diagonal: (N,) output.
        off: (N,) output; entry i couples depths i - 1 and i, entry 0 is 0.
    """
    n = p.shape[0]
    c, s = math.cos(theta), math.sin(theta)
    previous = 0.0
    for i in range(n):
        px, pz = c * p[i, 0] + s * p[i, 2], -s * p[i, 0] + c * p[i, 2]
        qx, qz = c * q[i, 0] + s * q[i, 2], -s * q[i, 0] + c * q[i, 2]
        if qz * qz <= POLE * POLE * (qx * qx + qz * qz):
            return False
        lam = pz / qz
        verticality = px - lam * qx
        height = lam * q[i, 1]
        shared = 2.0
        if i == 0 or i == n - 1:
            shared = 1.0
        if n == 1:
            shared = 0.0
        diagonal[i] = verticality * verticality + shared * (p[i, 1] * p[i, 1] + height * height)
        off[i] = 0.0 if i == 0 else -(p[i - 1, 1] * p[i, 1] + previous * height)
        previous = height
    return True


@njit(cache=True)
def any_below(diagonal, off, value):  # type: ignore[no-untyped-def]
    """Whether the tridiagonal matrix has an eigenvalue below ``value``: a negative term of the Sturm sequence."""
    t = 1.0
    for i in range(diagonal.shape[0]):
        t = diagonal[i] - value - (off[i] * off[i] / t if i > 0 else 0.0)
        if t == 0.0:
            t = TINY
        if t < 0.0:
            return True
    return False


@njit(cache=True)
def smallest_eigenvalue(diagonal, off):  # type: ignore[no-untyped-def]
    """Smallest eigenvalue of a positive semidefinite tridiagonal matrix, by bisection on the Sturm sequence."""
    high = diagonal[0]
    for value in diagonal:
        high = min(high, value)
    high = high * (1.0 + 1e-12) + TINY
    low = 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if any_below(diagonal, off, middle):
            high = middle
        else:
            low = middle
        if high - low < 1e-13 * high:
            break
    return 0.5 * (low + high)


@njit(cache=True)
def sigma_min(p, q, theta, diagonal, off):  # type: ignore[no-untyped-def]
    """Smallest singular value of A(theta), inf at a pole; ``diagonal`` and ``off`` (N,) are work space."""
    if not tridiagonal(p, q, theta, diagonal, off):
        return np.inf
    return math.sqrt(smallest_eigenvalue(diagonal, off))


@njit(cache=True)
def sigma_min_scan(p, q, thetas):  # type: ignore[no-untyped-def]
    """Smallest singular value of A(theta) at each theta; inf at a pole. Absolute accuracy about 1e-8 sigma_max.

    Args:
        p: (N, 3) levelled ceiling rays.
        q: (N, 3) levelled floor rays.
        thetas: (T,) rad.
    """
    out = np.empty(thetas.shape[0])
    diagonal = np.empty(p.shape[0])
    off = np.empty(p.shape[0])
    for k in range(thetas.shape[0]):
        out[k] = sigma_min(p, q, thetas[k], diagonal, off)
    return out


@njit(cache=True)
def refine(p, q, low, high, tolerance):  # type: ignore[no-untyped-def]
    """Minimum of sigma_min(A(theta)) between two angles by Brent's method: parabolas, golden section where they fail.

    Args:
        p: (N, 3) levelled ceiling rays.
        q: (N, 3) levelled floor rays.
        low: rad.
        high: rad.
        tolerance: absolute, rad.
    """
    golden = 0.5 * (3.0 - math.sqrt(5.0))
    diagonal, off = np.empty(p.shape[0]), np.empty(p.shape[0])
    best = low + golden * (high - low)
    second = third = best
    f_best = sigma_min(p, q, best, diagonal, off)
    f_second = f_third = f_best
    step = previous = 0.0
    for _ in range(100):
        middle = 0.5 * (low + high)
        least = 1.5e-8 * abs(best) + tolerance / 3.0
        if abs(best - middle) <= 2.0 * least - 0.5 * (high - low):
            break
        parabola = False
        if abs(previous) > least:
            r = (best - second) * (f_best - f_third)
            b = (best - third) * (f_best - f_second)
            a = (best - third) * b - (best - second) * r
            b = 2.0 * (b - r)
            if b > 0.0:
                a = -a
            b = abs(b)
            before, previous = previous, step
            # NaN (a pole in the bracket) fails all three and falls back to the golden section.
            if abs(a) < abs(0.5 * b * before) and a > b * (low - best) and a < b * (high - best):
                parabola = True
                step = a / b
                if best + step - low < 2.0 * least or high - best - step < 2.0 * least:
                    step = least if middle >= best else -least
        if not parabola:
            previous = low - best if best >= middle else high - best
            step = golden * previous
        x = best + (max(abs(step), least) if step >= 0.0 else -max(abs(step), least))
        f = sigma_min(p, q, x, diagonal, off)
        if f <= f_best:
            if x >= best:
                low = best
            else:
                high = best
            third, f_third, second, f_second, best, f_best = second, f_second, best, f_best, x, f
            continue
        if x < best:
            low = x
        else:
            high = x
        if f <= f_second or second == best:
            third, f_third, second, f_second = second, f_second, x, f
        elif f <= f_third or third in (best, second):
            third, f_third = x, f
    return best
