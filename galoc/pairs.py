"""The bare gauge problem in batches: ceiling/floor pixel pairs in, wall chain out, by any of the solvers.

This is what a geometry researcher stresses: no wireframe, no completion, B frames of N pairs at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc._pairs_kernel import solve_batch, tls_batch
from galoc.camera import MAX_TILT, Camera, levelling
from galoc.chain import MAX_DROPS, S_PRIOR, SIGMA_FLOOR_PX, SIGMA_PX, intrinsics, to_points
from galoc.errors import GalocError
from galoc.heights import Heights

Array = NDArray[np.float64]

PAIR_METHODS = ("ml", "tls", "paper", "paper-fixed")
"""Solvers of :func:`solve_pairs`."""


@dataclass(frozen=True, slots=True, eq=False)
class PairSolution:
    """B solved frames of N pairs; unit: geometric mean of ceiling height above and floor depth below the camera."""

    points: Array
    """(B, N, 2): (x right, z forward) in the level camera frame; NaN where a pair was not recovered."""
    heights: Array
    """(B, 2): ceiling above and floor below the camera (their product is 1)."""
    gravity: Array
    """(B, 2) rad: refined roll and pitch ("ml"), else the measured ones."""
    covariance: Array | None
    """(B, 2N, 2N) of (x_0, z_0, x_1, ...) in this unit; None where the method gives none."""
    flagged: NDArray[np.bool_]
    """(B, N): pairs that the chi-square gate refused ("ml")."""
    sigma_px: Array
    """(B,) px: junction noise used or estimated."""


def solve_pairs(
    ceiling: ArrayLike,
    floor: ArrayLike,
    camera: Camera,
    gravity: ArrayLike,
    *,
    method: str = "ml",
    sigma_px: float | None = None,
    imu_sigma_rad: float = math.radians(1.0),
    ceiling_seen: ArrayLike | None = None,
    floor_seen: ArrayLike | None = None,
    heights: Heights | None = None,
) -> PairSolution:
    """Recover B wall chains from their pixel pairs.

    Args:
        ceiling: (B, N, 2) px, left to right.
        floor: (B, N, 2) px.
        camera: intrinsics.
        gravity: (B, 2) measured roll and pitch, rad.
        method: "ml" (Gauss-Newton in pixels with tilt refinement, covariance and gate), "tls" (its closed-form start),
            "paper" (null-space gauge search, Sec. III-C) or "paper-fixed" (the same at theta = 0).
        sigma_px: junction noise, px; None: estimated from the residuals.
        imu_sigma_rad: noise of each gravity angle, rad; 0 holds the tilt fixed.
        ceiling_seen: (B, N) bool: the ceiling end is measured; None: all are. The paper's solver skips frames in which
            one is not.
        floor_seen: (B, N) bool, likewise.
        heights: prior of the two heights ("ml"); None: unknown.

    Raises:
        GalocError: wrong shapes, unknown method, NaN pixels or gravity, negative noise.
    """
    p, q = _pixels("ceiling", ceiling), _pixels("floor", floor)
    if p.shape != q.shape:
        raise GalocError(f"ceiling {p.shape} and floor {q.shape}", "two arrays of one shape (B, N, 2)", "Pair them up.")
    g = np.asarray(gravity, dtype=np.float64).reshape(-1, 2) if np.size(gravity) == 2 * len(p) else None
    if g is None:
        raise GalocError(f"gravity of shape {np.shape(gravity)}", f"({len(p)}, 2)", "Give roll and pitch per frame.")
    for row in g[~(np.abs(g) <= MAX_TILT).all(axis=1)][:1]:
        levelling(row)  # refuses NaN and more than 85 degrees
    seen = [_mask(name, m, p.shape[:2]) for name, m in (("ceiling_seen", ceiling_seen), ("floor_seen", floor_seen))]
    if method not in PAIR_METHODS:
        raise GalocError(f"method {method!r}", f"one of {PAIR_METHODS}", "Use method='ml'.")
    if sigma_px is not None and not (math.isfinite(sigma_px) and sigma_px >= 0):
        raise GalocError(f"sigma_px = {sigma_px!r}", "a standard deviation in px, 0 or more, or None", "Fix it.")
    if not (math.isfinite(imu_sigma_rad) and imu_sigma_rad >= 0):
        raise GalocError(f"imu_sigma_rad = {imu_sigma_rad!r}", "an angle in rad, 0 or more", "Fix it.")
    if method in ("paper", "paper-fixed"):
        return _paper(p, q, seen[0] & seen[1], camera, g, fixed=method == "paper-fixed")
    heights = heights or Heights()
    n = p.shape[1]
    sd = SIGMA_PX * camera.width if sigma_px is None else max(float(sigma_px), SIGMA_FLOOR_PX * camera.width)
    if method == "tls":
        return _closed_form(p, q, seen, g, sd, camera, heights)
    theta, cov, flagged, factor = solve_batch(
        p, q, seen[0], seen[1], g, sd, intrinsics(camera), max(imu_sigma_rad, 1e-4), heights.k, heights.k_sd, *S_PRIOR,
        min(MAX_DROPS, n // 3), sigma_px is None,
    )  # fmt: skip
    m, s, k = theta[:, : 2 * n : 2], theta[:, 1 : 2 * n : 2], theta[:, 2 * n]
    points, spread = to_points(m, s, cov)
    lost = ~(seen[0] | seen[1]) | flagged | (factor < 0)[:, None]
    points[lost] = np.nan
    return PairSolution(
        points,
        np.exp(np.stack([-0.5 * k, 0.5 * k], axis=1)),
        theta[:, 2 * n + 1 : 2 * n + 3],
        spread,
        flagged,
        sd * np.abs(factor),
    )


def _closed_form(
    p: Array, q: Array, seen: list[NDArray[np.bool_]], gravity: Array, sd: float, camera: Camera, heights: Heights
) -> PairSolution:
    """Total least squares at the measured gravity: no iteration, no covariance, no gate."""
    m, s, k = tls_batch(p, q, seen[0], seen[1], gravity, sd, intrinsics(camera), heights.k, heights.k_sd, S_PRIOR[0])
    z = 1.0 / s
    points = np.stack([m * z, z], axis=-1)
    points[~(seen[0] | seen[1])] = np.nan
    ratio = np.exp(0.5 * k)
    none = np.zeros(s.shape, dtype=bool)
    return PairSolution(points, np.stack([1.0 / ratio, ratio], axis=1), gravity, None, none, np.full(len(p), sd))


def _pixels(name: str, value: ArrayLike) -> Array:
    try:
        array = np.ascontiguousarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.ndim != 3 or array.shape[2] != 2 or array.shape[1] < 1 or not np.isfinite(array).all():
        raise GalocError(
            f"{name} of shape {np.shape(value)}", "finite pixels (B, N, 2) with N >= 1", "Give equal N per frame."
        )
    return array


def _mask(name: str, value: ArrayLike | None, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    mask = np.ones(shape, dtype=bool) if value is None else np.ascontiguousarray(value, dtype=bool)
    if mask.shape != shape:
        raise GalocError(f"{name} of shape {mask.shape}", f"{shape}", "One flag per junction.")
    return mask


def _paper(
    p: Array, q: Array, whole: NDArray[np.bool_], camera: Camera, gravity: Array, *, fixed: bool
) -> PairSolution:
    """The paper's solver on the pairs of each frame that are whole; the others are NaN."""
    from galoc.gauge import solve_points

    levels = np.array([levelling(g) for g in gravity]).reshape(-1, 3, 3)
    rays = [np.einsum("bij,bnj->bni", levels, camera.rays_camera(x)) for x in (p, q)]
    rays[0][~whole] = np.nan  # pairs that the solver is to leave out
    points, heights, _ = solve_points(*rays, theta=0.0 if fixed else None)
    return PairSolution(points, heights, gravity, None, np.zeros_like(whole), np.full(len(p), np.nan))
