"""Observation rays at 1 degree from a wall chain (paper, Sec. III-E)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from galoc.camera import Camera
from galoc.types import Layout, Rays

Array = NDArray[np.float64]


def ray_count(hfov_deg: float) -> int:
    """N_r = floor(FOV) + 1, lowered to the next odd number so that the middle ray is the optical axis."""
    n = int(math.floor(hfov_deg + 1e-9)) + 1
    return n if n % 2 else n - 1


def cast_rays(layout: Layout, camera: Camera) -> Rays:
    """Cast N_r rays from the camera onto the known walls of a layout.

    A ray is known when its azimuth lies in the arc that a known wall spans in the image; its range is the nearest hit
    on the known walls. Where the chain, moved by the inscribed-angle step, leaves a gap at that azimuth, the line of
    the arc's own wall is used.

    Returns:
        Ranges in the scale of the layout, ordered right to left (counter-clockwise).
    """
    n = ray_count(camera.hfov_deg)
    azimuths = -np.radians(np.arange(n) - (n - 1) / 2.0)
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
    known = inside.any(axis=1) & np.isfinite(distance)
    return Rays(np.where(known, distance, np.nan), known, np.full(n, np.nan))
