"""Draws every action."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from galoc_env.policy import Robot


class RandomWalk:
    """Draws every action from the action space."""

    def reset(self, robot: Robot) -> None:
        """Begin with the robot's own seeded space."""
        self._space = robot.action_space

    def act(self, observation: dict[str, NDArray[Any]], info: dict[str, Any]) -> Any:
        """A random action."""
        return self._space.sample()
