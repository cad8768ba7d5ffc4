"""Poses in the plan frame and in a body's own: from one to the other and back."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def compose(pose: Array, motion: Array) -> Array:
    """(N, 3) where motions (N, 3) in the body frame of a pose (3,) lead to."""
    motion = np.atleast_2d(motion)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = motion[:, 0], motion[:, 1]
    return np.stack([pose[0] + c * x - s * y, pose[1] + s * x + c * y, pose[2] + motion[:, 2]], axis=1)


def relative(pose: Array, others: Array) -> Array:
    """(N, 3) poses (N, 3) in the body frame of a pose (3,)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = others[:, 0] - pose[0], others[:, 1] - pose[1]
    return np.stack([c * x + s * y, c * y - s * x, others[:, 2] - pose[2]], axis=1)
