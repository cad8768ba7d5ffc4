"""Stays where it is."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc_agents.moves import LEFT, RIGHT, as_action
from galoc_env.policy import Robot


class Stay:
    """Does as little as the action space allows: nothing ("continuous"), or one turn left, one right ("discrete")."""

    def reset(self, robot: Robot) -> None:
        """Begin."""
        self._robot = robot
        self._turned = False

    def act(self, observation: dict[str, NDArray[Any]], info: dict[str, Any]) -> Any:
        """No motion, or the turn that undoes the last one."""
        if self._robot.actions == "continuous":
            return np.zeros(3, np.float32)
        self._turned = not self._turned
        return as_action(self._robot, LEFT if self._turned else RIGHT)
