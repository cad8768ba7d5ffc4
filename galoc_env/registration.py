"""Registers the environments with Gymnasium (1.x has no plugin entry points, so this runs at import)."""

from __future__ import annotations

import gymnasium

ENV_ID = "GALoc-Floorplan-v0"
"""Name for ``gymnasium.make``; ``"galoc_env:GALoc-Floorplan-v0"`` needs no import."""
MAX_EPISODE_STEPS = 100
"""Default length of an episode, steps."""


def register() -> None:
    """Register every environment that is not registered yet."""
    if ENV_ID not in gymnasium.registry:
        gymnasium.register(
            id=ENV_ID,
            entry_point="galoc_env.env:FloorplanEnv",
            vector_entry_point="galoc_env.vector:FloorplanVectorEnv",
            max_episode_steps=MAX_EPISODE_STEPS,
        )
