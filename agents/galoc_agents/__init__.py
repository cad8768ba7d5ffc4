"""Policies that choose the next viewpoint to localize faster."""

from galoc_agents.policy import Policy, RandomPolicy, SpinPolicy
from galoc_agents.run import Episode, run_episode

__all__ = ["Episode", "Policy", "RandomPolicy", "SpinPolicy", "run_episode"]
