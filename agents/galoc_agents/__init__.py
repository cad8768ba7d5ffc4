"""Policies that choose the next viewpoint to localize faster; each is a module of its own, named in the README."""

from galoc_env.policy import BeliefView, Policy, Robot, make_policy, named

__all__ = ["BeliefView", "Policy", "Robot", "make_policy", "named"]
