"""From a wireframe to the wall chain seen from above."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.bev import inscribed_position
from galoc.camera import Camera, azimuth, levelling
from galoc.chain import SIGMA_PX, fit_chain, to_points
from galoc.errors import GalocError
from galoc.gauge import solve_gauge
from galoc.heights import Heights
from galoc.rays import KNOWN_SD, chain_rays
from galoc.types import BORDER, Layout, Wireframe
from galoc.wireframe import complete

Array = NDArray[np.float64]

METHODS = ("ml", "paper")
"""Layout methods."""
IMU_SIGMA_RAD = math.radians(1.0)
"""Noise of a measured roll or pitch where the caller gives none, rad."""
METRIC_SD = 0.1
"""A layout is metric when its log scale is known this well."""


def solve_layout(
    wireframe: Wireframe,
    camera: Camera,
    gravity: ArrayLike,
    method: str = "ml",
    *,
    imu_sigma_rad: float = IMU_SIGMA_RAD,
    heights: Heights | None = None,
    on_grid: bool = False,
    inscribed: bool = True,
    theta: float | None = None,
) -> Layout:
    """Recover the gravity-aligned wall chain of one image.

    Args:
        wireframe: junction pairs, left to right.
        camera: intrinsics.
        gravity: measured (roll, pitch), rad.
        method: "ml": maximum likelihood in pixels with tilt refinement and covariance (docs/geometry.md). "paper":
            completion (Sec. III-B), null-space gauge search (III-C), inscribed-angle bird's-eye view (III-D); the
            intermediates are in ``Layout.gauge``.
        imu_sigma_rad: standard deviation of each gravity angle ("ml"), rad.
        heights: what is known of the camera's and the ceiling's height ("ml"); None: nothing.
        on_grid: the walls of the place lie on one right-angled grid ("ml"; switches a wall-direction prior on).
        inscribed: False skips the inscribed-angle translation ("paper", for ablations).
        theta: fixes the gauge angle instead of searching it ("paper", for ablations), rad.

    Returns:
        The chain with the camera at the origin; without a known wall (abstained) when the image fixes none.

    Raises:
        GalocError: unknown method, NaN gravity, negative IMU noise.
    """
    if method not in METHODS:
        raise GalocError(f"layout method {method!r}", f"one of {METHODS}", "Use method='ml'.")
    if method == "paper":
        return _paper(wireframe, camera, gravity, inscribed=inscribed, theta=theta)
    if not (math.isfinite(imu_sigma_rad) and imu_sigma_rad >= 0.0):
        raise GalocError(f"imu_sigma_rad = {imu_sigma_rad!r}", "a standard deviation in rad, 0 or more", "Fix it.")
    levelling(gravity)  # refuses what is no gravity before anything is computed
    return _maximum_likelihood(wireframe, camera, gravity, imu_sigma_rad, heights or Heights(), on_grid)


def _paper(wireframe: Wireframe, camera: Camera, gravity: ArrayLike, *, inscribed: bool, theta: float | None) -> Layout:
    full = complete(wireframe, camera, gravity)
    if len(full.walls) == 0:
        return Layout.unknown("paper")
    p, q = camera.rays_level(full.ceiling, gravity), camera.rays_level(full.floor, gravity)
    gauge = solve_gauge(p, q, theta=theta)
    column = 0.5 * (azimuth(p) + azimuth(q))
    points = gauge.points
    if inscribed:
        points = points - inscribed_position(points, float(column[-1] - column[0]))
    heights = np.array([-gauge.ceiling[0, 1], gauge.floor[0, 1]])
    arcs: Array = column[full.walls]
    return Layout(points, full.walls, arcs, heights, "paper", gauge=gauge)


def _maximum_likelihood(
    wireframe: Wireframe, camera: Camera, gravity: ArrayLike, imu_sd: float, heights: Heights, on_grid: bool
) -> Layout:
    g = np.asarray(gravity, dtype=np.float64)
    chain = fit_chain(wireframe, camera, g, imu_sd=imu_sd, heights=heights, on_grid=on_grid)
    if chain is None:
        return Layout.unknown("ml")
    log_scale, scale_sd = heights.log_scale(chain.k, chain.k_sd)
    scale = math.exp(log_scale)
    points, covariance = to_points(chain.m, chain.s / scale, _scaled(chain.covariance, scale))
    azimuths = np.arctan(chain.m)
    ends: Array = azimuths[wireframe.walls].reshape(-1, 2)
    known = _determined(points, covariance, wireframe.walls, ends)
    given = wireframe.sigma_px
    sigma = chain.sigma_factor * (SIGMA_PX * camera.width if given is None else float(np.mean(given)))
    return Layout(
        points,
        wireframe.walls[known],
        ends[known],
        scale * np.exp([-0.5 * chain.k, 0.5 * chain.k]),
        "ml",
        covariance,
        scale_sd <= METRIC_SD,
        kind=wireframe.kind,
        gravity=chain.gravity,
        gravity_sd=chain.gravity_sd,
        flagged=chain.flagged,
        hidden=_hidden(wireframe, camera, chain.gravity, azimuths),
        scale_sd=scale_sd,
        log_ratio=(chain.k, chain.k_sd),
        sigma_px=sigma,
    )


def _scaled(covariance: Array, scale: float) -> Array:
    """Covariance of (m, s) after s is divided by the scale."""
    factor = np.ones(len(covariance))
    factor[1::2] = 1.0 / scale
    return covariance * factor[:, None] * factor[None, :]


def _determined(points: Array, covariance: Array, walls: NDArray[np.int64], ends: Array) -> NDArray[np.bool_]:
    """(M,) whether the range of a wall is known somewhere along it."""
    known = np.zeros(len(walls), dtype=bool)
    for w, (left, right) in enumerate(ends):
        if right > left:
            at = left + (right - left) * np.array([0.05, 0.275, 0.5, 0.725, 0.95])
            variance = chain_rays(points, walls[w : w + 1], at, covariance)[1]
            known[w] = bool(np.nanmin(variance, initial=np.inf) < KNOWN_SD**2)
    return known


def _hidden(wireframe: Wireframe, camera: Camera, gravity: Array, azimuths: Array) -> Array:
    """(H, 3) stretches (left azimuth, right azimuth, row) of walls whose ceiling or floor line is not in the image."""
    rows: list[tuple[float, float, int]] = []
    flags, cuts = (wireframe.ceiling_true, wireframe.floor_true), (wireframe.ceiling_cut, wireframe.floor_cut)
    pixels = (wireframe.ceiling, wireframe.floor)
    for w, (i, j) in enumerate(wireframe.walls):
        left, right = float(azimuths[i]), float(azimuths[j])
        for row in (0, 1):
            cut = cuts[row]
            shown = [
                azimuths[node]
                if flags[row][node]
                else float(azimuth(camera.rays_level(cut[w, side], gravity)))
                if cut is not None and np.isfinite(cut[w, side]).all()
                else math.nan
                for side, node in enumerate((i, j))
            ]
            # A line that leaves through the opposite border (a ceiling below the image) says something else.
            middle = 0.5 * (camera.height - 1)
            beyond = [
                wireframe.kind[node] == BORDER or (pixels[row][node][1] < middle) == (row == 0) for node in (i, j)
            ]
            if math.isnan(shown[0]) and math.isnan(shown[1]):
                if all(beyond):
                    rows.append((left, right, row))
                continue
            if not math.isnan(shown[0]) and not flags[row][i] and beyond[0]:
                rows.append((left, shown[0], row))
            if not math.isnan(shown[1]) and not flags[row][j] and beyond[1]:
                rows.append((shown[1], right, row))
    return np.array(rows, dtype=np.float64).reshape(-1, 3)
