"""Observation rays at 1 degree from a wall chain (paper, Sec. III-E), with variances where the layout has them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from galoc._rays_kernel import chain_log_ranges
from galoc.camera import Camera, levelling
from galoc.chain import to_level
from galoc.types import OCCLUSION, Layout, Rays

Array = NDArray[np.float64]

KNOWN_SD = 0.15
"""A ray is known when its log range at fixed scale is, to this standard deviation."""
STEP_SD = 0.15
"""Added to the log-range deviation of rays within one standard deviation of an occluded wall's end, where the range
jumps."""
FARTHEST = 1e3
"""No wall is farther than so many times the height of the room ("paper")."""
LIMIT_MARGIN_PX = 1.0
"""A line counts as beyond the image only when it is this far beyond, px."""


def ray_count(hfov_deg: float) -> int:
    """N_r = floor(FOV) + 1, lowered to the next odd number so that the middle ray is the optical axis."""
    n = int(math.floor(hfov_deg + 1e-9)) + 1
    return n if n % 2 else n - 1


def cast_rays(layout: Layout, camera: Camera) -> Rays:
    """Cast N_r rays from the camera onto the known walls of a layout.

    Layouts with a covariance ("ml"): a ray is known when the standard deviation of its log range is below
    ``KNOWN_SD``; rays onto walls that are seen to be near but not how near carry ``Rays.limit``. Otherwise ("paper") a
    ray is known when its azimuth lies in the arc that a known wall spans in the image; its range is the nearest hit on
    the known walls. Where the chain, moved by the inscribed-angle step, leaves a gap at that azimuth, the line of the
    arc's own wall is used.

    Returns:
        Ranges in the scale of the layout, ordered right to left (counter-clockwise).
    """
    n = ray_count(camera.hfov_deg)
    azimuths = -np.radians(np.arange(n) - (n - 1) / 2.0)
    if layout.covariance is not None:
        return _with_variance(layout, camera, azimuths)
    a, b = layout.points[layout.walls[:, 0]], layout.points[layout.walls[:, 1]]
    direction = np.stack([np.sin(azimuths), np.cos(azimuths)], axis=1)[:, None]
    d = b - a
    with np.errstate(divide="ignore", invalid="ignore"):
        den = direction[..., 0] * d[:, 1] - direction[..., 1] * d[:, 0]
        t = (a[:, 0] * d[:, 1] - a[:, 1] * d[:, 0]) / den
        u = (a[:, 0] * direction[..., 1] - a[:, 1] * direction[..., 0]) / den
    ahead = np.isfinite(t) & (t > 1e-9)
    low, high = np.minimum(*layout.arcs.T), np.maximum(*layout.arcs.T)
    inside = (azimuths[:, None] >= low - 1e-9) & (azimuths[:, None] <= high + 1e-9)
    hit = np.where(ahead & (u >= -1e-9) & (u <= 1.0 + 1e-9), t, np.inf).min(axis=1, initial=np.inf)
    own = np.where(ahead & inside, t, np.inf).min(axis=1, initial=np.inf)
    distance = np.where(np.isfinite(hit), hit, own)
    # A ray along a wall's own line meets it nowhere in the building.
    known = inside.any(axis=1) & (distance < FARTHEST * layout.heights.sum())
    return Rays(np.where(known, distance, np.nan), known, np.full(n, np.nan))


def chain_rays(
    points: Array, walls: NDArray[np.int64], azimuths: Array, covariance: Array | None = None
) -> tuple[Array, Array]:
    """Log range of the nearest wall of a chain at each azimuth, and its variance.

    Args:
        points: (N, 2) as (x right, z forward), z > 0; a wall with a NaN end is skipped.
        walls: (M, 2) left and right end of each wall.
        azimuths: (R,) rad, right positive.
        covariance: (2N, 2N) of (x_0, z_0, x_1, ...); None: no variances.

    Returns:
        (R,) log range (NaN where there is no wall) and (R,) its variance (NaN where not estimated).
    """
    if covariance is None:
        m, s, spread = points[:, 0] / points[:, 1], 1.0 / points[:, 1], np.zeros((0, 0))
    else:
        m, s, spread = to_level(points, covariance)
    log_range, variance, _ = chain_log_ranges(m, s, spread, _writable(walls), azimuths)
    return log_range, variance


def _writable(walls: NDArray[np.int64]) -> NDArray[np.int64]:
    """A copy: to numba a read-only array is another type, for which the kernel would be compiled once more."""
    return np.array(walls, dtype=np.int64)


def _with_variance(layout: Layout, camera: Camera, azimuths: Array) -> Rays:
    """Rays of a layout with covariance."""
    assert layout.covariance is not None
    m, s, spread = to_level(layout.points, layout.covariance)
    log_range, variance, wall = chain_log_ranges(m, s, spread, _writable(layout.walls), azimuths)
    if layout.kind is not None and len(layout.walls):
        node_az, node_sd = np.arctan(m), np.sqrt(np.diag(spread)[::2]) / (1.0 + m**2)
        for side in (0, 1):
            node = layout.walls[wall, side]
            near = np.abs(azimuths - node_az[node]) < node_sd[node]
            variance = variance + np.where((wall >= 0) & near & (layout.kind[node] == OCCLUSION), STEP_SD**2, 0.0)
    known = (wall >= 0) & (variance < KNOWN_SD**2)
    distance = np.where(known, np.exp(log_range), np.nan)
    limit = np.where(known, np.nan, _limits(layout, camera, azimuths))
    return Rays(distance, known, np.where(known, variance, np.nan), limit)


def _limits(layout: Layout, camera: Camera, azimuths: Array) -> Array:
    """(n,) range that a wall with a hidden ceiling or floor line cannot exceed; NaN where no line is hidden."""
    limit = np.full(len(azimuths), np.inf)
    if layout.hidden is None or layout.gravity is None:
        return np.full(len(azimuths), np.nan)
    rotation = levelling(layout.gravity)
    t = np.tan(azimuths)
    for row, v in ((0, -0.5 - LIMIT_MARGIN_PX), (1, camera.height - 0.5 + LIMIT_MARGIN_PX)):
        # The pixel of that image border at each azimuth, and the slope of its levelled ray.
        q1 = (v - camera.cy) / camera.fy
        with np.errstate(divide="ignore", invalid="ignore"):
            q0 = -((rotation[0, 1] - t * rotation[2, 1]) * q1 + rotation[0, 2] - t * rotation[2, 2]) / (
                rotation[0, 0] - t * rotation[2, 0]
            )
            ray = np.stack([q0, np.full_like(q0, q1), np.ones_like(q0)], axis=1) @ rotation.T
            slope = np.abs(ray[:, 1] / ray[:, 2])
        usable = (ray[:, 2] > 0.0) & (slope > 0.05) & (np.sign(ray[:, 1]) == (-1.0, 1.0)[row])
        depth = np.where(usable, layout.heights[row] / np.maximum(slope, 0.05), np.inf)
        for left, right, which in layout.hidden:
            inside = (which == row) & (azimuths >= left) & (azimuths <= right)
            limit = np.where(inside, np.minimum(limit, depth / np.cos(azimuths)), limit)
    return np.where(np.isfinite(limit), limit, np.nan)
