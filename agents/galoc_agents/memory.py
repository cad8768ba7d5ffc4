"""What a robot remembers of an episode in dead reckoning: how much it saw from where, and what it ran into."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc import Floorplan
from galoc_agents.frames import compose, relative
from galoc_agents.moves import BACKWARD, FORWARD, STEP_M
from galoc_env.motion import BODY_RADIUS

Array = NDArray[np.float64]

SHORT_M = 0.03
"""A step that falls short by more than this ended at something; odometry's noise is below it."""
WALL_M = 0.15
"""A bump this close to a wall of the map is that wall."""
BLIND_SHARE = 0.05
"""A view that tells less than this share of its rays is blind."""
REACH_M = 0.15
"""A step that ends at something shows that so far ahead of where it ended the body's centre cannot be, m."""
TOUCH_M = BODY_RADIUS + 0.02
"""From the body's centre to what it touches, m."""


class Memory:
    """Views and bumps in the frame of the episode's first pose.

    Args:
        plan: the map; bumps at its walls are not remembered.
    """

    def __init__(self, plan: Floorplan) -> None:
        self._free = plan.free_space(0.05)
        self._here = np.zeros(3)
        self._views: list[tuple[Array, float]] = []
        self._taken: list[Array] = []
        self._intended: tuple[int, Array] | None = None

    def intend(self, move: int, pose: ArrayLike) -> None:
        """Say what the body is about to do.

        Args:
            move: discrete action.
            pose: (3,) where the body believes to be.
        """
        self._intended = move, np.array(pose, dtype=np.float64)

    def take(self, odometry: NDArray[Any], coverage: float) -> None:
        """Take the measured motion (3,) since the last call and the share of rays that the view told."""
        dx, dy, turn = (float(v) for v in odometry)
        self._here = compose(self._here, np.array([dx, dy, turn]))[0]
        self._views.append((self._here, coverage))
        if self._intended is None or self._intended[0] not in (FORWARD, BACKWARD):
            return
        ahead = 1.0 if self._intended[0] == FORWARD else -1.0
        if ahead * dx > STEP_M - SHORT_M:
            return
        touched = compose(self._intended[1], np.array([dx + ahead * TOUCH_M, 0.0, 0.0]))[0, :2]
        if float(self._free.clearance_at(touched)) > WALL_M:
            self._taken.append(compose(self._here, np.array([ahead * REACH_M, 0.0, 0.0]))[0, :2])

    def taken(self, pose: Array) -> Array:
        """(B, 2) m in the plan: where the body's centre cannot be, if it is at this pose (3,)."""
        points = np.zeros((len(self._taken), 3))
        points[:, :2] = np.array(self._taken).reshape(-1, 2)
        return compose(pose, relative(self._here, points))[:, :2]

    def __len__(self) -> int:
        """Views so far."""
        return len(self._views)

    @property
    def blind(self) -> bool:
        """Whether no view has told a ray to speak of."""
        return all(share < BLIND_SHARE for _, share in self._views)

    def views(self, last: int) -> tuple[Array, Array]:
        """(W, 3) poses of the last views in the present body frame, and (W,) the share of rays that each told."""
        views = self._views[-last:]
        poses = np.array([pose for pose, _ in views]).reshape(-1, 3)
        return relative(self._here, poses), np.array([share for _, share in views])
