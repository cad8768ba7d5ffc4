"""Observation rays straight from a network's columns: each column is a ray with a variance.

A column at elevation e of the floor line says ``log range = log h_floor - log tan(-e)``, the ceiling line likewise; an
error of e counts ``2 / sin(2 e)`` times. No wall has to be drawn for that, so a column that the decoder cannot fit
still tells what it knows.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.camera import Camera, level_angles, level_directions, levelling
from galoc.detect.columns import Columns
from galoc.rays import KNOWN_SD, cast_rays
from galoc.types import Layout, Rays

Array = NDArray[np.float64]

LEAST_ELEVATION = math.radians(1.0)
"""Lines nearer to the horizon tell no range, rad."""
FREE_CHI2 = 3.0
"""Ceiling and floor may disagree by so many variances before the column is trusted less."""


def column_rays(columns: Columns, layout: Layout, camera: Camera, gravity: ArrayLike) -> Rays:
    """Rays at 1 degree, as :func:`galoc.rays.cast_rays` gives them.

    Args:
        columns: what the network said.
        layout: solved from the walls that were drawn from them ("ml"): gives heights, their ratio's uncertainty, the
            refined gravity, and how near walls must be whose lines are out of sight.
        camera: intrinsics.
        gravity: (roll, pitch) that the columns were levelled by, rad.
    """
    cast = cast_rays(layout, camera)
    if layout.gravity is None:
        return cast
    k_sd = layout.log_ratio[1]
    turn = levelling(layout.gravity) @ levelling(gravity).T
    log_h = np.log(layout.heights)[:, None]
    azimuth, elevation = level_angles(level_directions(columns.azimuths, columns.elevation) @ turn.T)
    steep = np.maximum(np.array([[1.0], [-1.0]]) * elevation, LEAST_ELEVATION)
    log_range = log_h - np.log(np.tan(np.minimum(steep, math.radians(89.0))))
    variance = np.square(2.0 / np.sin(2.0 * np.clip(steep, 0.0, math.radians(85.0))) * columns.sigma)
    usable = (np.array([[1.0], [-1.0]]) * elevation > LEAST_ELEVATION) & (columns.sure > 0.05)
    precision = np.where(usable, np.square(columns.sure) / variance, 0.0)
    total = precision.sum(axis=0)
    share = precision / np.maximum(total, 1e-12)
    fused = (share * log_range).sum(axis=0)
    apart = np.square(log_range[0] - log_range[1]) / (variance.sum(axis=0) + k_sd**2)
    doubt = np.where(usable.all(axis=0), np.maximum(1.0, apart / FREE_CHI2), 1.0)
    spread = doubt / np.maximum(total, 1e-12) + np.square(0.5 * (share[1] - share[0]) * k_sd)
    at = (share * azimuth).sum(axis=0)
    return _at_rays(at, fused, np.where(total > 0.0, spread, np.inf), cast)


def _at_rays(azimuth: Array, log_range: Array, variance: Array, cast: Rays) -> Rays:
    """Columns to rays: the mean of the columns on both sides; where these disagree, a step is near."""
    wanted = -cast.bearings_rad
    right = np.clip(np.searchsorted(azimuth, wanted), 1, len(azimuth) - 1)
    left = right - 1
    t = np.clip((wanted - azimuth[left]) / np.maximum(azimuth[right] - azimuth[left], 1e-9), 0.0, 1.0)
    with np.errstate(invalid="ignore"):
        mean = (1.0 - t) * log_range[left] + t * log_range[right]
        between = t * (1.0 - t) * np.square(log_range[right] - log_range[left])
        spread = (1.0 - t) * variance[left] + t * variance[right] + between
    spread = np.where(np.isfinite(spread), spread, np.inf)
    known = spread < KNOWN_SD**2
    limit = None if cast.limit is None else np.where(known, np.nan, cast.limit)
    return Rays(np.where(known, np.exp(mean), np.nan), known, np.where(known, spread, np.nan), limit)
