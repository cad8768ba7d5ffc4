"""Numba kernel of the gauge scan: sigma_min(A(theta)) from the tridiagonal A^T A by Sturm bisection."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

POLE = 1e-6
"""A floor ray whose |z| is below this share of its horizontal norm is at a pole of lambda (90 deg - azimuth)."""


@njit(cache=True)
def sigma_min_scan(p, q, thetas):  # type: ignore[no-untyped-def]
    """Smallest singular value of A(theta) at each theta; inf at a pole.

    A^T A is tridiagonal because every row of A touches one depth or two neighbouring ones. Its smallest eigenvalue is
    bracketed by counting sign changes of the Sturm sequence; absolute accuracy about 1e-8 sigma_max.

    Args:
        p: (N, 3) levelled ceiling rays.
        q: (N, 3) levelled floor rays.
        thetas: (T,) rad.
    """
    n = p.shape[0]
    out = np.empty(thetas.shape[0])
    diagonal = np.empty(n)
    off = np.empty(n)
    for k in range(thetas.shape[0]):
        c, s = math.cos(thetas[k]), math.sin(thetas[k])
        pole = False
        previous = 0.0
        for i in range(n):
            px, pz = c * p[i, 0] + s * p[i, 2], -s * p[i, 0] + c * p[i, 2]
            qx, qz = c * q[i, 0] + s * q[i, 2], -s * q[i, 0] + c * q[i, 2]
            if abs(qz) <= POLE * math.hypot(qx, qz):
                pole = True
                break
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
        out[k] = np.inf if pole else math.sqrt(_smallest_eigenvalue(diagonal, off))
    return out


@njit(cache=True)
def _smallest_eigenvalue(diagonal, off):  # type: ignore[no-untyped-def]
    high = diagonal[0]
    for value in diagonal:
        high = min(high, value)
    high = high * (1.0 + 1e-12) + 1e-300
    low = 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        t = 1.0
        negative = False
        for i in range(diagonal.shape[0]):
            t = diagonal[i] - middle - (off[i] * off[i] / t if i > 0 else 0.0)
            if t == 0.0:
                t = 1e-300
            if t < 0.0:
                negative = True
                break
        if negative:
            high = middle
        else:
            low = middle
        if high - low < 1e-13 * high:
            break
    return 0.5 * (low + high)
