"""Field-of-view consistent bird's-eye view: the inscribed-angle camera position (paper, Sec. III-D)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def inscribed_position(points: Array, angle: float) -> Array:
    """Camera position X* from which the chain's outermost points subtend ``angle``, nearest the origin.

    d = chord, R = d / (2 sin Theta), C on the chord's perpendicular bisector on the side from which the camera faces
    the chain, X* = C - R C / |C|. Only the translation changes; scale-free because R is proportional to d.

    Args:
        points: (N, 2) chain (x right, z forward), left to right, camera at the origin.
        angle: Theta, the angle the known arc subtends in the image, rad.

    Returns:
        (2,) position in the frame of ``points``; the origin where the construction is degenerate.
    """
    still = np.zeros(2)
    if len(points) < 2 or not 1e-3 < angle < math.pi - 1e-3:
        return still
    left, right = points[0], points[-1]
    chord = right - left
    d = float(np.hypot(*chord))
    if d < 1e-12:
        return still
    middle = 0.5 * (left + right)
    normal = np.array([-chord[1], chord[0]]) / d
    if normal @ -middle < 0.0:  # towards the camera
        normal = -normal
    radius = d / (2.0 * math.sin(angle))
    centre = middle + radius * math.cos(angle) * normal
    distance = float(np.hypot(*centre))
    return np.asarray(centre * (1.0 - radius / distance)) if distance > 1e-12 else still
