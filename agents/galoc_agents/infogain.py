"""Goes where the views are expected to tell the remaining hypotheses apart soonest."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc.profiles import ProfileField, profile_field
from galoc_agents._gain_kernel import expected_entropy, freshness, shares_seen
from galoc_agents.hypotheses import Hypotheses
from galoc_agents.memory import Memory
from galoc_agents.moves import LEFT, as_action
from galoc_agents.sight import Sight
from galoc_agents.tree import Tree
from galoc_env.policy import BeliefView, Robot

Array = NDArray[np.float64]

HYPOTHESES = 32
"""Hypotheses that are told apart."""
NODES = 600
"""Budget: views predicted per decision. Fewer look less far ahead; any number gives an action."""
HORIZON = 30
"""Actions over which the expected entropy is summed."""
SCALE_SD = 0.15
"""Spread of the log of the heights, which views are compared up to."""
TEMPER = 0.5
"""Exponent of the belief's odds: its frames are not as independent as it counts them."""
FRESH_M, FRESH_RAD = 0.6, math.radians(25.0)
"""Views this far apart share exp(-1) of what they tell, m and rad."""
VIEWS = 12
"""Last views whose share of rays is held against the hypotheses: dead reckoning is good for so long."""
SHARE_SD = 0.3
"""Spread of the share of rays that a view tells about what is predicted of it."""
SHARE_MOST = 9.0
"""Squared whitened misfit of that share beyond which it counts no more."""
FLOOR = -10.0
"""No view makes a hypothesis less likely than this, nats: maps and detectors are wrong now and then."""
BUMP_NATS = 3.0
"""What it tells that one hypothesis runs into a wall and the other does not."""


class InfoGain:
    """Greedy expected entropy reduction, with the time it takes in the account.

    The belief's leading hypotheses are moved along every short way of the likeliest one (a breadth-first tree over the
    actions); the profile field says what each would see there, and the likelihood how far these views tell them apart.
    The way with the least sum of expected entropy over the next ``HORIZON`` actions is begun, and the next observation
    decides anew.

    Args:
        nodes: budget, views predicted per decision.
        hypotheses: hypotheses that are told apart; the work grows with their square.
    """

    def __init__(self, nodes: int = NODES, hypotheses: int = HYPOTHESES) -> None:
        self._nodes, self._most = nodes, hypotheses
        self._field: ProfileField | None = None

    def reset(self, robot: Robot) -> None:
        """Begin."""
        self._robot = robot
        if self._field is None or self._field.caster.plan is not robot.plan:
            self._field = profile_field(robot.plan)
            self._log_ranges = np.log(np.maximum(self._field.ranges, 1e-3))
        self._sight = Sight.of(robot.camera)
        self._memory = Memory(robot.plan)
        self._left = robot.steps

    def act(self, observation: dict[str, NDArray[Any]], info: dict[str, Any]) -> Any:
        """The first move of the best way."""
        self._memory.take(observation["odometry"], float(info["coverage"]))
        belief = self._robot.belief
        if belief is None:
            return as_action(self._robot, LEFT)
        hypotheses = self._considered(belief)
        move = self._choose(hypotheses, hypotheses.weights)
        self._left -= 1
        self._memory.intend(move, hypotheses.poses[0])
        return as_action(self._robot, move)

    def _considered(self, belief: BeliefView) -> Hypotheses:
        """The belief's hypotheses, weighed by how much of each view they would have had in the image."""
        assert self._field is not None
        field, sight = self._field, self._sight
        every = Hypotheses.of(belief)
        views, told = self._memory.views(VIEWS)
        would = shares_seen(
            every.poses, views, self._log_ranges, field.index, field.origin, field.resolution, sight.rays, sight.measured
        )
        misfit = np.minimum(np.square((would - told) / SHARE_SD), SHARE_MOST)
        return every.weighed(-0.5 * np.where(np.isnan(misfit), SHARE_MOST, misfit).sum(axis=1)).tempered(TEMPER).thinned(self._most)

    def _choose(self, hypotheses: Hypotheses, outer: Array) -> int:
        pose = hypotheses.poses[0]
        tree = Tree.grow(self._robot.plan, pose, self._memory.contacts(pose), HORIZON, self._nodes)
        if len(tree.parent) < 2:
            return LEFT
        cost = tree.cost(self._expected(tree, hypotheses, outer), min(HORIZON, max(self._left, 1)))
        return tree.first_move(1 + int(np.argmin(cost[1:])))

    def _expected(self, tree: Tree, hypotheses: Hypotheses, outer: Array) -> Array:
        """(M,) expected entropy after the way to each node of a tree, nats."""
        field, sight = self._field, self._sight
        assert field is not None
        limit = sight.measured
        views, _ = self._memory.views(len(self._memory))
        fresh = freshness(tree.motion, tree.parent, views, FRESH_M, FRESH_RAD)
        return np.asarray(
            expected_entropy(
                tree.motion, tree.parent, fresh, hypotheses.poses, outer, hypotheses.weights, hypotheses.near(),
                self._log_ranges, field.index, field.origin, field.resolution, sight.rays, sight.measured,
                sight.precision, limit, sight.limit_precision, sight.weight,
                np.float32(1.0 / (SCALE_SD**2 * 9.0)), np.float32(FLOOR), np.float32(BUMP_NATS),
            )
        )  # fmt: skip
