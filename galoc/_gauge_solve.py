"""Numba kernels that run the paper's whole gauge solve for a batch of images: search, null vector, symmetry choice."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from galoc._gauge_kernel import TINY, any_below, refine, smallest_eigenvalue, tridiagonal

DEGREE = math.pi / 180.0
FLAT_SCREEN = 1e-6
"""A landscape whose median is above this share of |A| is not flat; below it, sigma_min is computed without squaring."""
FLAT = 1e-9
"""Below this share of |A| everywhere, sigma_min carries no information and theta is 0."""
TOLERANCE = 1e-7
"""Of the refined theta, rad."""


@njit(cache=True)
def null_vector(p, q, theta, z):  # type: ignore[no-untyped-def]
    """Fill z (N,) with the last right singular vector of A(theta), largest entry 1; returns |A z| / |z|, inf at a pole.

    Inverse iteration on the tridiagonal A^T A, shifted to just below its smallest eigenvalue.
    """
    n = p.shape[0]
    diagonal, off, pivot = np.empty(n), np.empty(n), np.empty(n)
    if not tridiagonal(p, q, theta, diagonal, off):
        z[:] = np.nan
        return np.inf
    shift = smallest_eigenvalue(diagonal, off) * (1.0 - 1e-12)
    trace = 0.0
    for i in range(n):
        trace += diagonal[i]
    for i in range(n):
        pivot[i] = diagonal[i] - shift - (off[i] * off[i] / pivot[i - 1] if i > 0 else 0.0)
        if abs(pivot[i]) < 1e-16 * trace:
            pivot[i] = 1e-16 * trace + TINY
    z[:] = 1.0
    for _ in range(4):
        for i in range(1, n):
            z[i] -= off[i] / pivot[i - 1] * z[i - 1]
        z[n - 1] /= pivot[n - 1]
        for i in range(n - 2, -1, -1):
            z[i] = z[i] / pivot[i] - off[i + 1] / pivot[i] * z[i + 1]
        largest = z[0]
        for i in range(n):
            if abs(z[i]) > abs(largest):
                largest = z[i]
        for i in range(n):
            z[i] /= largest
    return _residual(p, q, theta, z)


@njit(cache=True)
def _residual(p, q, theta, z):  # type: ignore[no-untyped-def]
    """|A(theta) z| / |z| row by row, which keeps the digits that A^T A loses."""
    c, s = math.cos(theta), math.sin(theta)
    total = norm = 0.0
    above = below = 0.0
    for i in range(p.shape[0]):
        px, pz = c * p[i, 0] + s * p[i, 2], -s * p[i, 0] + c * p[i, 2]
        qx, qz = c * q[i, 0] + s * q[i, 2], -s * q[i, 0] + c * q[i, 2]
        lam = pz / qz
        total += ((px - lam * qx) * z[i]) ** 2
        ceiling, floor = p[i, 1] * z[i], lam * q[i, 1] * z[i]
        if i > 0:
            total += (ceiling - above) ** 2 + (floor - below) ** 2
        above, below = ceiling, floor
        norm += z[i] * z[i]
    return math.sqrt(total / norm)


@njit(cache=True)
def search(p, q):  # type: ignore[no-untyped-def]
    """Scan one period at 1 degree; (scan angle of the least sigma_min, whether the landscape is flat).

    One Sturm count per angle tells whether it beats the best so far; only then is its sigma_min computed.
    """
    n = p.shape[0]
    diagonal, off = np.empty(n), np.empty(n)
    best, least = 0.0, np.inf
    scale = 1.0
    for k in range(180):
        theta = (k - 90.0) * DEGREE
        if not tridiagonal(p, q, theta, diagonal, off):
            continue
        if least == np.inf or any_below(diagonal, off, least):
            least = smallest_eigenvalue(diagonal, off)
            best = theta
            scale = diagonal.sum()  # |A|^2
    low = finite = 0
    for k in range(180):
        if tridiagonal(p, q, (k - 90.0) * DEGREE, diagonal, off):
            finite += 1
            if any_below(diagonal, off, FLAT_SCREEN * FLAT_SCREEN * scale):
                low += 1
        if 2 * (k + 1 - low) > 180:
            return best, False
    if 2 * low <= finite:
        return best, False
    z = np.empty(n)
    for k in range(0, 180, 15):
        theta = (k - 90.0) * DEGREE
        if tridiagonal(p, q, theta, diagonal, off) and null_vector(p, q, theta, z) > FLAT * math.sqrt(diagonal.sum()):
            return best, False
    return best, True


@njit(cache=True)
def _assemble(p, theta, z, turned):  # type: ignore[no-untyped-def]
    """Fill turned (N, 2) with x, z in the gauge frame; returns (corners behind the camera, left-right disorder)."""
    n = p.shape[0]
    c, s = math.cos(theta), math.sin(theta)
    behind = disorder = 0
    for i in range(n):
        turned[i, 0] = z[i] * (c * p[i, 0] + s * p[i, 2])
        turned[i, 1] = z[i] * (-s * p[i, 0] + c * p[i, 2])
        if turned[i, 1] < 0.0:
            behind += 1
        for j in range(i):
            if turned[i, 0] < turned[j, 0]:
                disorder += 1
    return behind, disorder


@njit(cache=True)
def solve_one(p, q, fixed, theta, points, heights):  # type: ignore[no-untyped-def]
    """One image: fill points (N, 2), unrotated, and heights (2,), both with Z_1 = 1; returns theta_hat.

    Args:
        p: (N, 3) levelled ceiling rays.
        q: (N, 3) levelled floor rays.
        fixed: take ``theta`` instead of searching.
        theta: rad.
        points: (N, 2) output, x right and z forward in the level camera frame.
        heights: (2,) output, ceiling above and floor below the camera.
    """
    n = p.shape[0]
    count = 1
    candidates = np.zeros(4)
    if fixed:
        candidates[0] = theta
    else:
        start, flat = search(p, q)
        if not flat:
            first = refine(p, q, start - DEGREE, start + DEGREE, TOLERANCE)
            middle = first + math.pi / 2.0
            second = refine(p, q, middle - DEGREE, middle + DEGREE, TOLERANCE)
            candidates[0], candidates[1] = first, second
            candidates[2], candidates[3] = first + math.pi, second + math.pi  # A(theta + pi) = D A(theta)
            count = 4
    z, turned = np.empty(n), np.empty((n, 2))
    chosen, behind, disorder = candidates[0], n + 1, 0
    for k in range(count):
        null_vector(p, q, candidates[k], z)
        first_depth = z[0] if abs(z[0]) > 1e-12 else math.copysign(1.0, z[0])
        for i in range(n):
            z[i] /= first_depth
        b, d = _assemble(p, candidates[k], z, turned)
        if b < behind or (b == behind and d < disorder):
            chosen, behind, disorder = candidates[k], b, d
            c, s = math.cos(chosen), math.sin(chosen)
            for i in range(n):
                points[i, 0] = c * turned[i, 0] - s * turned[i, 1]
                points[i, 1] = s * turned[i, 0] + c * turned[i, 1]
            lam = (-s * p[0, 0] + c * p[0, 2]) / (-s * q[0, 0] + c * q[0, 2])
            heights[0], heights[1] = -z[0] * p[0, 1], z[0] * lam * q[0, 1]
    return chosen


@njit(cache=True)
def solve_batch(p, q, fixed, theta):  # type: ignore[no-untyped-def]
    """Gauge solves of B images; pairs with a NaN ray are left out and come back as NaN.

    Args:
        p: (B, N, 3) levelled ceiling rays.
        q: (B, N, 3) levelled floor rays.
        fixed: take ``theta`` instead of searching.
        theta: (B,) rad, only read when ``fixed``.

    Returns:
        points (B, N, 2) and heights (B, 2) with sqrt(h_ceiling h_floor) = 1, theta (B,).
    """
    batch, n = p.shape[0], p.shape[1]
    points, heights, angle = np.full((batch, n, 2), np.nan), np.full((batch, 2), np.nan), np.full(batch, np.nan)
    index = np.empty(n, np.int64)
    for k in range(batch):
        count = 0
        for i in range(n):
            total = 0.0
            for axis in range(3):
                total += p[k, i, axis] + q[k, i, axis]
            if math.isfinite(total):
                index[count] = i
                count += 1
        if count < 2:
            continue
        own, height = np.empty((count, 2)), np.empty(2)
        angle[k] = solve_one(p[k][index[:count]], q[k][index[:count]], fixed, theta[k], own, height)
        unit = math.sqrt(abs(height[0] * height[1]))
        if not unit > 0.0:
            continue
        for j in range(count):
            points[k, index[j], 0], points[k, index[j], 1] = own[j, 0] / unit, own[j, 1] / unit
        heights[k, 0], heights[k, 1] = height[0] / unit, height[1] / unit
    return points, heights, angle
