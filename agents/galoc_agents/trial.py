"""How long a policy takes until the robot knows where it is."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from galoc_env.env import FloorplanEnv
from galoc_env.play import rollout
from galoc_env.policy import Policy
from galoc_env.scoring import HOLD_M

STEPS = 60
"""Actions per episode; also the count where a robot is not localized at its end."""


def steps_to_localize(env: FloorplanEnv, policy: Policy, seed: int, steps: int = STEPS) -> int:
    """First observation from which on the position stays within 0.5 m to the end of the episode; at most ``steps``.

    Args:
        env: with a localizer; ``seed`` names home and start, so that policies can be compared in pairs.
        policy: reset here.
        seed: of the environment and the policy.
        steps: actions of the episode.

    Raises:
        GalocError: the policy failed.
    """
    found = rollout(env, seed, steps, policy=policy).steps_to(HOLD_M)
    return steps if found is None else min(found, steps)


def trials(
    arguments: dict[str, Any], make: Callable[[], Policy], seeds: Sequence[int], steps: int = STEPS
) -> Iterator[int]:
    """:func:`steps_to_localize` for each seed, as they come."""
    env = FloorplanEnv(**arguments)
    policy = make()
    try:
        for seed in seeds:
            yield steps_to_localize(env, policy, seed, steps)
    finally:
        env.close()
