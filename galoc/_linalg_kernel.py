"""Numba kernels of dense linear algebra on small positive definite matrices."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def cholesky(a, n):  # type: ignore[no-untyped-def]
    """In-place lower Cholesky factor of the leading n x n block; False where it is not positive definite."""
    for j in range(n):
        d = a[j, j]
        for k in range(j):
            d -= a[j, k] * a[j, k]
        if not d > 0.0:
            return False
        d = math.sqrt(d)
        a[j, j] = d
        for i in range(j + 1, n):
            v = a[i, j]
            for k in range(j):
                v -= a[i, k] * a[j, k]
            a[i, j] = v / d
    return True


@njit(cache=True)
def cholesky_solve(chol, rhs, n):  # type: ignore[no-untyped-def]
    """Solve in place with a factor from :func:`cholesky`."""
    for i in range(n):
        v = rhs[i]
        for k in range(i):
            v -= chol[i, k] * rhs[k]
        rhs[i] = v / chol[i, i]
    for i in range(n - 1, -1, -1):
        v = rhs[i]
        for k in range(i + 1, n):
            v -= chol[k, i] * rhs[k]
        rhs[i] = v / chol[i, i]


@njit(cache=True)
def cholesky_inverse(chol, n):  # type: ignore[no-untyped-def]
    """(n, n) inverse of the matrix behind a factor from :func:`cholesky`."""
    low = np.zeros((n, n))
    for j in range(n):  # inverse of the factor, column by column
        low[j, j] = 1.0 / chol[j, j]
        for i in range(j + 1, n):
            v = 0.0
            for k in range(j, i):
                v -= chol[i, k] * low[k, j]
            low[i, j] = v / chol[i, i]
    out = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            v = 0.0
            for k in range(i, n):
                v += low[k, i] * low[k, j]
            out[i, j] = v
            out[j, i] = v
    return out
