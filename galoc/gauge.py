"""The paper's null-space gravity alignment (Sec. III-C): A(theta), gauge search, EYM structure, symmetry choice.

What is true of it (docs/geometry.md): with exact gravity and noise-free pixels A(theta) is the same rank N-1 matrix at
every theta, so theta_hat is a numerical weighting parameter of this solver. It is not a yaw and is never used as a
heading; the structure is turned back by R_y(-theta_hat) before anything else sees it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc._gauge_kernel import refine, sigma_min_scan
from galoc._gauge_solve import FLAT, FLAT_SCREEN, TOLERANCE, solve_batch
from galoc.errors import GalocError

Array = NDArray[np.float64]

SCAN_DEG = 1.0
"""Step of the global scan, degrees (paper: 1 degree, refined by Brent within +-1 degree)."""


@dataclass(frozen=True, slots=True, eq=False)
class Gauge:
    """Every intermediate of one gauge solve. Depths and coordinates are up to one common scale."""

    theta: float
    """theta_hat, rad (paper Eq. theta_star): the chosen candidate."""
    flat: bool
    """True when sigma_min vanishes at every theta (noise-free input) and theta was set to 0."""
    scan_theta: Array
    """(T,) rad: scan angles over [-pi/2, pi/2), one period."""
    scan_sigma_min: Array
    """(T,): sigma_min(A(theta)) at the scan angles; inf at a pole."""
    candidates: Array
    """(C,) rad: Theta_4, the four symmetric minima, each refined."""
    negative_depths: NDArray[np.int64]
    """(C,): corners behind the camera for each candidate (first symmetry check)."""
    order_errors: NDArray[np.int64]
    """(C,): left-right order inconsistencies for each candidate (second symmetry check)."""
    matrix: Array
    """(3N-2, N): A(theta_hat)."""
    singular_values: Array
    """(N,): of A(theta_hat), descending."""
    Z: Array
    """(N,): ceiling depths, last right singular vector, scaled to Z_1 = 1 (paper Eq. Z_recovery)."""
    lam: Array
    """(N,): lambda_i, floor depth over ceiling depth at theta_hat (paper Eq. vert_z)."""
    ceiling: Array
    """(N, 3): assembled ceiling corners in the gauge frame (x, y down, z) (paper Eq. xz_assembly, y_assembly)."""
    floor: Array
    """(N, 3): assembled floor corners in the gauge frame."""
    points: Array
    """(N, 2): (x, z) of the corners turned back by R_y(-theta_hat) into the level camera frame."""


def rotated(rays: Array, theta: float) -> Array:
    """``R_y(theta)`` applied to levelled rays (N, 3) (paper Eq. rays)."""
    c, s = math.cos(theta), math.sin(theta)
    return np.stack([c * rays[:, 0] + s * rays[:, 2], rays[:, 1], -s * rays[:, 0] + c * rays[:, 2]], axis=1)


def constraint_matrix(p: Array, q: Array, theta: float) -> tuple[Array, Array]:
    """A(theta) and lambda (paper Table II): N verticality, N-1 ceiling and N-1 floor coplanarity rows.

    Args:
        p: (N, 3) levelled ceiling rays, N >= 1.
        q: (N, 3) levelled floor rays.
        theta: rad.

    Returns:
        (3N-2, N) matrix and (N,) lambda.
    """
    n = len(p)
    rp, rq = rotated(p, theta), rotated(q, theta)
    with np.errstate(divide="ignore", invalid="ignore"):
        lam = rp[:, 2] / rq[:, 2]
    a = np.zeros((3 * n - 2, n))
    i, k = np.arange(n), np.arange(n - 1)
    a[i, i] = rp[:, 0] - lam * rq[:, 0]
    a[n + k, k], a[n + k, k + 1] = rp[:-1, 1], -rp[1:, 1]
    height = lam * rq[:, 1]
    a[2 * n - 1 + k, k], a[2 * n - 1 + k, k + 1] = height[:-1], -height[1:]
    return a, lam


def solve_gauge(p: Array, q: Array, *, theta: float | None = None) -> Gauge:
    """Find theta_hat = argmin sigma_min(A(theta)) and the structure at it.

    Args:
        p: (N, 3) levelled ceiling rays ``R_rp K^-1 [u, v, 1]``, left to right, N >= 2.
        q: (N, 3) levelled floor rays.
        theta: fix the gauge angle instead of searching (for ablations), rad.

    Raises:
        GalocError: fewer than two pairs, wrong shapes or NaN.
    """
    p, q = np.asarray(p, dtype=np.float64), np.asarray(q, dtype=np.float64)
    if p.shape != q.shape or p.ndim != 2 or p.shape[1] != 3 or len(p) < 2 or not np.isfinite([p, q]).all():
        raise GalocError(
            f"ceiling rays {p.shape} and floor rays {q.shape}",
            "two finite arrays of the same shape (N, 3) with N >= 2",
            "A single pair has no wall between corners: abstain instead.",
        )
    scan = np.radians(np.arange(-90.0, 90.0, SCAN_DEG))
    curve = sigma_min_scan(p, q, scan)
    flat = _is_flat(p, q, scan, curve)
    if theta is not None:
        candidates = np.array([float(theta)])
    elif flat:
        candidates = np.array([0.0])
    else:
        candidates = _theta_4(p, q, float(scan[int(np.argmin(curve))]))
    structures = [_structure(p, q, t) for t in candidates]
    negative = np.array([int(np.count_nonzero(s.ceiling[:, 2] < 0)) for s in structures])
    order = np.array([_order_errors(s.ceiling[:, 0]) for s in structures])
    best = int(np.lexsort((order, negative))[0])  # fewest corners behind the camera, then best left-right order
    chosen = structures[best]
    return Gauge(
        float(candidates[best]), flat, scan, curve, candidates, negative, order, chosen.matrix, chosen.singular_values,
        chosen.z, chosen.lam, chosen.ceiling, chosen.floor, chosen.points,
    )  # fmt: skip


def solve_points(p: Array, q: Array, *, theta: float | None = None) -> tuple[Array, Array, Array]:
    """The structures of a batch of images as :func:`solve_gauge` finds them, without its intermediates and faster.

    Args:
        p: (B, N, 3) levelled ceiling rays, left to right. A pair with a NaN ray is left out.
        q: (B, N, 3) levelled floor rays.
        theta: fix the gauge angle instead of searching, rad.

    Returns:
        points (B, N, 2), (x right, z forward) in the level camera frame, and heights (B, 2) of the ceiling above and
        the floor below the camera, in the unit where ``sqrt(h_ceiling h_floor) = 1``; theta_hat (B,), rad. NaN for
        pairs left out, and for images with fewer than two pairs.

    Raises:
        GalocError: wrong or different shapes.
    """
    p, q = np.asarray(p, dtype=np.float64), np.asarray(q, dtype=np.float64)
    if p.shape != q.shape or p.ndim != 3 or p.shape[2] != 3:
        raise GalocError(
            f"ceiling rays {p.shape} and floor rays {q.shape}",
            "two arrays of the same shape (B, N, 3)",
            "Add a leading axis for a single image.",
        )
    angle = np.full(len(p), 0.0 if theta is None else float(theta))
    points, heights, found = solve_batch(np.ascontiguousarray(p), np.ascontiguousarray(q), theta is not None, angle)
    return points, heights, found


def _is_flat(p: Array, q: Array, scan: Array, curve: Array) -> bool:
    """Whether sigma_min is zero to working precision at every angle.

    The Sturm curve resolves 1e-8 sigma_max only, so a curve below 1e-6 is checked by SVD.
    """
    scale = float(np.linalg.norm(constraint_matrix(p, q, float(scan[int(np.argmin(curve))]))[0]))
    finite = np.isfinite(curve)
    if float(np.median(curve[finite])) > FLAT_SCREEN * scale:
        return False
    for theta in scan[finite][::15]:
        a = constraint_matrix(p, q, float(theta))[0]
        singular = np.linalg.svd(a, compute_uv=False)
        if singular[-1] > FLAT * singular[0]:
            return False
    return True


def _theta_4(p: Array, q: Array, theta: float) -> Array:
    """The minimum near ``theta`` and its three partners at steps of pi/2, each refined by Brent within +-1 degree."""

    def refined(start: float) -> float:
        step = math.radians(SCAN_DEG)
        return float(refine(p, q, start - step, start + step, TOLERANCE))

    first = refined(theta)
    second = refined(first + math.pi / 2)
    return np.array([first, second, first + math.pi, second + math.pi])  # A(theta + pi) = D A(theta): exactly periodic


@dataclass(frozen=True, slots=True, eq=False)
class _Structure:
    matrix: Array
    singular_values: Array
    z: Array
    lam: Array
    ceiling: Array
    floor: Array
    points: Array


def _structure(p: Array, q: Array, theta: float) -> _Structure:
    """EYM depths and assembled corners at one theta (paper Eqs. eym to y_assembly)."""
    a, lam = constraint_matrix(p, q, theta)
    singular_values, vt = np.linalg.svd(a)[1:]
    v = vt[-1]
    z = v / v[0] if abs(v[0]) > 1e-12 else v / np.copysign(max(np.abs(v).max(), 1e-300), v[0])
    rp, rq = rotated(p, theta), rotated(q, theta)
    ceiling = np.stack([z * rp[:, 0], np.full(len(z), z[0] * rp[0, 1]), z * rp[:, 2]], axis=1)
    floor = ceiling.copy()
    floor[:, 1] = z[0] * lam[0] * rq[0, 1]
    points = rotated(ceiling, -theta)[:, [0, 2]]
    return _Structure(a, singular_values, z, lam, ceiling, floor, points)


def _order_errors(x: Array) -> int:
    """Pairs of corners whose left-right order differs from the image's (chirality check)."""
    return int(np.count_nonzero(np.triu(x[None, :] < x[:, None], k=1)))
