"""The environment that the learned policy is trained in: features for observations, a price for every lost step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from galoc import Camera, Floorplan, Localizer
from galoc_agents.features import BOUND, MIRRORED_MOVES, SEES, Features, mirrored
from galoc_env.env import FloorplanEnv
from galoc_env.observe import make_localizer
from galoc_env.policy import Robot, without_truth
from galoc_env.scoring import HOLD_M
from galoc_env.settings import Settings

HELD = 5
"""An episode ends well after so many observations in a row within 0.5 m: what follows teaches nothing more."""
STEP_PRICE = 0.1
"""Cost of each observation further off than 0.5 m."""
NAT_VALUE = 0.02
"""Worth of each nat of `log_belief`, which adds up to the same whichever way it is earned."""
COARSE_M = 0.2
"""Grid of the localizer in lessons, m: a quarter of the positions and the work, and robots know as soon as with 0.1."""
ENVIRONMENT: dict[str, Any] = {
    "renderer": "none",
    "detector": "oracle",
    "reward": "log_belief",
    "localizer": "galoc_agents.lesson:CoarseLocalizer",
}
"""Nobody looks at pictures: the oracle's wireframes are as good, and quicker."""


class CoarseLocalizer(Localizer):
    """galoc's localizer as the environment makes it by default, but on a coarse grid."""

    def __init__(self, plan: Floorplan, camera: Camera) -> None:
        sensors = make_localizer(Settings(), plan, camera)
        assert isinstance(sensors, Localizer)
        super().__init__(plan, camera, config=replace(sensors.config, resolution=COARSE_M))


class Lesson(gymnasium.Env[NDArray[np.float32], np.int64]):
    """Episodes that last until the robot knows where it is.

    Observations are the vectors of :mod:`galoc_agents.features`, actions the four moves. The truth sets the reward and
    the end, nothing else. Half of the episodes take place in a mirrored world, where left is right.

    Args:
        numbers: of the homes, "train" split.
        sees: what the vectors are made of, one of ``SEES``.
        steps: actions after which an episode is cut off.
        seed: of homes and starts.
        sorts: of homes, the environment's `homes`; each as often as the others.
        **arguments: of :class:`FloorplanEnv`, besides ``ENVIRONMENT``.
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
        numbers: Sequence[int],
        sees: str = "profile",
        steps: int = 40,
        seed: int | Sequence[int] = 0,
        sorts: Sequence[str] = ("rooms",),
        **arguments: Any,
    ) -> None:
        self._arguments = {**ENVIRONMENT, **arguments}
        self._worlds: dict[tuple[str, int], tuple[FloorplanEnv, Features]] = {}
        self._homes, self._limit = list(product(sorts, numbers)), steps
        self._sees, size = SEES[sees], SEES[sees]().size
        self._mirror = mirrored() if sees == "profile" else None
        self.observation_space = spaces.Box(-BOUND, BOUND, (size,), np.float32)
        self.action_space = spaces.Discrete(4)
        self._rng = np.random.default_rng(seed)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start in one of the homes; with a seed, all that follows is determined."""
        super().reset(seed=seed)
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        home = self._homes[int(self._rng.integers(len(self._homes)))]
        start, self._flipped = int(self._rng.integers(2**31)), self._mirror is not None and self._rng.random() < 0.5
        if home not in self._worlds:  # each home keeps its environment: building one takes as long as fifty steps
            self._worlds[home] = FloorplanEnv(**{"homes": home[0], **self._arguments}), self._sees()
        self._world, self._features = self._worlds[home]
        options = {} if self._arguments.get("plan") else {"plan_seed": home[1]}
        observation, info = self._world.reset(seed=start, options=options)
        self._features.reset(Robot.of(self._world, start, self._limit))
        self._near, self._steps = [bool(info["error_m"] < HOLD_M)], 0
        return self._vector(observation, info, None), {}

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Move; ``info["localized"]`` at the end: from which observation on the robot ``"knows"``, else the limit."""
        move = MIRRORED_MOVES[int(action)] if self._flipped else int(action)
        observation, nats, _, _, info = self._world.step(move)
        self._steps += 1
        self._near.append(bool(info["error_m"] < HOLD_M))
        reward = NAT_VALUE * nats - (0.0 if self._near[-1] else STEP_PRICE)
        knows = len(self._near) >= HELD and all(self._near[-HELD:])
        over = not knows and self._steps >= self._limit
        told = {"localized": len(self._near) - HELD if knows else self._limit, "knows": knows} if knows or over else {}
        return self._vector(observation, info, move), reward, knows, over, told

    def close(self) -> None:
        """Free the homes."""
        for world, _ in self._worlds.values():
            world.close()

    def _vector(self, observation: dict[str, Any], info: dict[str, Any], move: int | None) -> NDArray[np.float32]:
        vector = self._features.see(observation, without_truth(info), move)
        if self._flipped and self._mirror is not None:
            index, sign = self._mirror
            return sign * vector[index]
        return vector
