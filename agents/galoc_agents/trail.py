"""Where a robot has been and what it ran into, in dead reckoning, put where it now believes to be."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from galoc_agents.frames import compose, relative
from galoc_env.motion import wrap

Array = NDArray[np.float64]

KEPT = 200
"""Poses remembered: dead reckoning is good for no longer."""


class Trail:
    """Poses, views taken for granted and obstacles of an episode, in the frame of its first pose."""

    def __init__(self) -> None:
        self._poses = np.zeros((1, 3))
        self._granted = np.zeros((0, 3))
        self._obstacles = np.zeros((0, 3))

    def move(self, odometry: NDArray[np.floating]) -> None:
        """Take the measured motion (3,): forward m, left m, turn rad."""
        here = compose(self._poses[-1], np.asarray(odometry, dtype=np.float64))
        self._poses = np.concatenate([self._poses, here])[-KEPT:]

    def bump(self, ahead: float) -> None:
        """Remember an obstacle this far ahead, m."""
        met = compose(self._poses[-1], np.array([ahead, 0.0, 0.0]))
        self._obstacles = np.concatenate([self._obstacles, met])[-KEPT:]

    def grant(self, here: Array, view: Array) -> None:
        """Count a view (3,) as taken, in the frame in which the present pose is ``here`` (3,)."""
        granted = compose(self._poses[-1], relative(here, view[None]))
        self._granted = np.concatenate([self._granted, granted])[-KEPT:]

    def poses(self, here: Array) -> Array:
        """(P, 3) all poses so far, if the present one is this (3,)."""
        return compose(here, relative(self._poses[-1], self._poses))

    def views(self, here: Array) -> Array:
        """(V, 3) all poses so far and the views that were granted, if the present pose is this (3,)."""
        return compose(here, relative(self._poses[-1], np.concatenate([self._poses, self._granted])))

    def walked(self, here: Array) -> Array:
        """(W, 2) m: points along the way so far, if the present pose is this (3,)."""
        xy = self.poses(here)[:, :2]
        shares = np.linspace(0.0, 1.0, 4)[:, None, None]
        return np.concatenate([((1.0 - shares) * xy[:-1] + shares * xy[1:]).reshape(-1, 2), xy[-1:]])

    def obstacles(self, here: Array) -> Array:
        """(K, 2) m: all obstacles, if the present pose is this (3,)."""
        return compose(here, relative(self._poses[-1], self._obstacles))[:, :2]

    def way_back(self, distance: float) -> float | None:
        """Bearing in the body frame, rad, of where the robot last was at least this far (m) from here; None: never."""
        back = relative(self._poses[-1], self._poses)
        far = np.flatnonzero(np.hypot(back[:, 0], back[:, 1]) >= distance)
        return None if len(far) == 0 else float(np.arctan2(back[far[-1], 1], back[far[-1], 0]))


def moved(pose: Array, odometry: NDArray[np.floating]) -> Array:
    """(3,) where a measured motion (3,) leads to."""
    return np.asarray(compose(pose, np.asarray(odometry, dtype=np.float64))[0])


def apart(a: Array, b: Array) -> tuple[float, float]:
    """How far two poses (3,) are apart: m, and rad within 0 to pi."""
    turn = abs(wrap(a[2] - b[2]))
    return float(np.hypot(*(a[:2] - b[:2]))), float(turn)
