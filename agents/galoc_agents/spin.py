"""Turns around, walks on, turns around."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc_agents.moves import FORWARD, LEFT, TURNS_AROUND, as_action, cut_short
from galoc_env.policy import Robot

WALK_STEPS = 8
"""Forward steps between two full turns."""


class Spin:
    """Turns once around, walks on, turns again: sees every wall of a room before it leaves it.

    It walks straight on while odometry says that it moves; when a step is cut short, it turns a random way.

    Args:
        walk_steps: forward steps between two full turns.
    """

    def __init__(self, walk_steps: int = WALK_STEPS) -> None:
        self._walk_steps = walk_steps

    def reset(self, robot: Robot) -> None:
        """Begin with a full turn."""
        self._robot = robot
        self._rng = np.random.default_rng(robot.seed)
        self._plan = [LEFT] * TURNS_AROUND
        self._last: int | None = None

    def act(self, observation: dict[str, NDArray[Any]], info: dict[str, Any]) -> Any:
        """The next move, from the odometry in the observation."""
        return as_action(self._robot, self.move(observation))

    def move(self, observation: dict[str, NDArray[Any]]) -> int:
        """The next move, as one of the discrete actions."""
        if self._last == FORWARD and cut_short(observation):
            self._plan = [LEFT] * int(self._rng.integers(2, TURNS_AROUND - 1)) + [FORWARD] * self._walk_steps
        if not self._plan:
            self._plan = [LEFT] * TURNS_AROUND + [FORWARD] * self._walk_steps
        self._last = self._plan.pop(0)
        return self._last
