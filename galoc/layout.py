"""From a wireframe to the wall chain seen from above."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.bev import inscribed_position
from galoc.camera import Camera, azimuth
from galoc.errors import GalocError
from galoc.gauge import solve_gauge
from galoc.types import Layout, Wireframe
from galoc.wireframe import complete

METHODS = ("paper",)
"""Layout methods of this version."""


def solve_layout(
    wireframe: Wireframe,
    camera: Camera,
    gravity: ArrayLike,
    method: str = "paper",
    *,
    inscribed: bool = True,
    theta: float | None = None,
) -> Layout:
    """Recover the gravity-aligned wall chain of one image.

    Args:
        wireframe: junction pairs, left to right.
        camera: intrinsics.
        gravity: measured (roll, pitch), rad.
        method: "paper": completion (Sec. III-B), null-space gauge search (III-C), inscribed-angle bird's-eye view
            (III-D). The intermediates are in ``Layout.gauge``.
        inscribed: False skips the inscribed-angle translation (for ablations).
        theta: fixes the gauge angle instead of searching it (for ablations), rad.

    Returns:
        The chain with the camera at the origin; empty (abstained) when no wall has four recovered corners.

    Raises:
        GalocError: unknown method, NaN gravity.
    """
    if method not in METHODS:
        raise GalocError(f"layout method {method!r}", f"one of {METHODS}", "Use method='paper'.")
    full = complete(wireframe, camera, gravity)
    if len(full.walls) == 0:
        return Layout.unknown(method)
    p, q = camera.rays_level(full.ceiling, gravity), camera.rays_level(full.floor, gravity)
    gauge = solve_gauge(p, q, theta=theta)
    column = 0.5 * (azimuth(p) + azimuth(q))
    points = gauge.points
    if inscribed:
        points = points - inscribed_position(points, float(column[-1] - column[0]))
    heights = np.array([-gauge.ceiling[0, 1], gauge.floor[0, 1]])
    arcs: NDArray[np.float64] = column[full.walls]
    return Layout(points, full.walls, arcs, heights, method, gauge=gauge)
