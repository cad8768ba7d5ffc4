"""The run loop: one policy, one episode."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium

from galoc_agents.policy import Policy


@dataclass(frozen=True, slots=True)
class Episode:
    """Outcome of one episode."""

    steps: int
    """Actions taken."""
    total_reward: float
    """Sum of the rewards, in the unit of the environment's ``reward``."""
    terminated: bool
    """The task ended the episode (else the time limit did)."""
    metrics: dict[str, float]
    """The environment's metrics of the whole episode; empty without a localizer."""


def run_episode(env: gymnasium.Env[Any, Any], policy: Policy, seed: int | None = None) -> Episode:
    """Play one episode to its end.

    Args:
        env: made by ``gymnasium.make``, so that the time limit ends the episode.
        policy: any :class:`galoc_agents.Policy`.
        seed: of environment and policy.
    """
    observation, info = env.reset(seed=seed)
    policy.reset(seed)
    steps, total, over, terminated = 0, 0.0, False, False
    while not over:
        observation, reward, terminated, truncated, info = env.step(policy.act(observation, info))
        steps += 1
        total += float(reward)
        over = terminated or truncated
    return Episode(steps, total, terminated, dict(info.get("metrics", {})))
