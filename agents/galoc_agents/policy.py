"""What a policy is, and two that need no training."""

from __future__ import annotations

from typing import Any, Protocol

import gymnasium
import numpy as np
from numpy.typing import NDArray

FORWARD, LEFT = 0, 2
"""Discrete actions of ``GALoc-Floorplan-v0``."""
TURNS_AROUND = 12
"""Turns of 30 degrees in a full circle."""


class Policy(Protocol):
    """Chooses actions from what the agent observes."""

    def reset(self, seed: int | None) -> None:
        """Start a new episode."""

    def act(self, observation: dict[str, NDArray], info: dict[str, Any]) -> Any:
        """The next action. ``info`` holds the truth: a policy that reads it is a yardstick, not an agent."""


class RandomPolicy:
    """Draws every action from the action space.

    Args:
        action_space: of the environment; a copy of it is seeded, the environment's own stays untouched.
    """

    def __init__(self, action_space: gymnasium.Space[Any]) -> None:
        from copy import deepcopy

        self._space = deepcopy(action_space)

    def reset(self, seed: int | None) -> None:
        """Seed the draws."""
        self._space.seed(seed)

    def act(self, observation: dict[str, NDArray], info: dict[str, Any]) -> Any:
        """A random action."""
        return self._space.sample()


class SpinPolicy:
    """Turns once around, walks on, turns again: sees every wall of a room before it leaves it. Discrete actions.

    It walks straight on while odometry says that it moves; when a step is cut short, it turns a random way.

    Args:
        walk_steps: forward steps between two full turns.
    """

    def __init__(self, walk_steps: int = 8) -> None:
        self._walk_steps = walk_steps
        self.reset(None)

    def reset(self, seed: int | None) -> None:
        """Begin with a full turn."""
        self._rng = np.random.default_rng(seed)
        self._plan = [LEFT] * TURNS_AROUND
        self._last: int | None = None

    def act(self, observation: dict[str, NDArray], info: dict[str, Any]) -> int:
        """The next discrete action, from the odometry in the observation."""
        stuck = self._last == FORWARD and float(observation["odometry"][0]) < 0.15
        if stuck:
            self._plan = [LEFT] * int(self._rng.integers(2, TURNS_AROUND - 1)) + [FORWARD] * self._walk_steps
        if not self._plan:
            self._plan = [LEFT] * TURNS_AROUND + [FORWARD] * self._walk_steps
        self._last = self._plan.pop(0)
        return self._last
