"""Goes where the views are expected to tell the remaining hypotheses apart soonest."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc.likelihood import SATURATION
from galoc.profiles import ProfileField, profile_field
from galoc_agents._gain_kernel import expected_entropy, freshness, shares_seen
from galoc_agents.explore import Explore
from galoc_agents.hypotheses import Hypotheses
from galoc_agents.memory import Memory
from galoc_agents.moves import LEFT, RIGHT, TURN_RAD, TURNS_AROUND, as_action
from galoc_agents.sight import Sight
from galoc_agents.tree import Tree
from galoc_env.policy import BeliefView, Robot

Array = NDArray[np.float64]

HYPOTHESES = 32
"""Hypotheses that are told apart."""
NODES = 1000
"""Budget: views predicted per decision. Fewer look less far ahead; any number gives an action."""
HORIZON = 45
"""Actions looked ahead, over which the expected entropy is summed."""
SCALE_SD = 0.15
"""Spread of the log of the heights, up to which views are compared."""
TEMPER = 0.5
"""Exponent of the belief's odds: its frames are not as independent as it counts them."""
FRESH_M, FRESH_RAD = 0.6, math.radians(25.0)
"""Views this far apart share exp(-1) of what they tell, m and rad."""
VIEWS = 12
"""Last views whose share of rays is held against the hypotheses: dead reckoning is good for so long."""
SEEN_SHARE = 0.3
"""Share of rays with which a view shows a wall."""
CHANGE_TURNS = 3.0
"""A turn once begun goes on unless the other way round is expected to take so many turns less."""
SHARE_SD = 0.3
"""Spread of the share of rays that a view tells about what is predicted of it."""
SHARE_MOST = 9.0
"""Squared whitened misfit of that share beyond which it counts no more."""
EDGE_DEG = 2
"""An edge may pass a ray on either side within this, degrees: a cell of the grid is no exact pose."""
DEAD = 1.0
"""Views of two hypotheses that differ by less than this, nats, are the same, for the same reason."""
FLOOR = -10.0
"""No view makes a hypothesis less likely than this, nats: maps and detectors are wrong now and then."""
BUMP_NATS = 3.0
"""What it tells that one hypothesis runs into a wall and the other does not."""
LEAST_NATS, LEAST_SHARE = 0.1, 0.1
"""A way is worth going if it is expected to tell this much, nats, and this share of what is open."""


_LEFTWARD = np.arange(TURNS_AROUND)
_RIGHTWARD = np.append(np.arange(TURNS_AROUND - 1)[::-1], TURNS_AROUND - 1)
"""Order in which the views of a full turn come, turning either way; the last one is where it began."""


class InfoGain:
    """Greedy expected entropy reduction, with the time it takes in the account.

    The belief's leading hypotheses are moved along every short way of the likeliest one (a breadth-first tree over the
    actions); the profile field says what each would see there, and the likelihood how far these views tell them apart.
    The way with the least sum of expected entropy over the next ``HORIZON`` actions is begun, and the next observation
    decides anew. As long as nothing was seen at all it turns to where a wall is likely to be in the image soonest;
    where no way promises to tell anything, it explores: a belief that is sure may still be wrong, and new walls
    are what shows it.

    Args:
        nodes: budget, views predicted per decision.
        hypotheses: hypotheses that are told apart; the work grows with their square.
    """

    def __init__(self, nodes: int = NODES, hypotheses: int = HYPOTHESES) -> None:
        self._nodes, self._most = nodes, hypotheses
        self._explore = Explore()
        self._field: ProfileField | None = None

    def reset(self, robot: Robot) -> None:
        """Begin."""
        self._robot = robot
        if self._field is None or self._field.caster.plan is not robot.plan:
            self._field = profile_field(robot.plan)
            self._log_ranges = np.log(np.maximum(self._field.ranges, 1e-3))
            around = [np.roll(self._log_ranges, shift, axis=1) for shift in range(-EDGE_DEG, EDGE_DEG + 1)]
            self._lowest, self._highest = np.minimum.reduce(around), np.maximum.reduce(around)
        self._sight = Sight.of(robot.camera)
        self._memory = Memory(robot.plan)
        self._explore.reset(robot)
        self._way: int | None = None
        self._left = robot.steps

    def act(self, observation: dict[str, NDArray[Any]], info: dict[str, Any]) -> Any:
        """The first move of the best way."""
        self._memory.take(observation["odometry"], float(info.get("coverage", 1.0)))
        onward = self._explore.move(observation)
        belief = self._robot.belief
        move = onward if belief is None else self._best(belief, info, onward)
        self._explore.did(move)
        self._left -= 1
        return as_action(self._robot, move)

    def _best(self, belief: BeliefView, info: dict[str, Any], onward: int) -> int:
        """The move under a belief; ``onward`` where none promises to tell anything."""
        every = self._weighed(belief)
        if self._memory.blind and len(self._memory) <= TURNS_AROUND:
            return self._turn(every)
        hypotheses = every.tempered(TEMPER).thinned(self._most)
        return self._begin(hypotheses, hypotheses.weights, onward)

    def _weighed(self, belief: BeliefView) -> Hypotheses:
        """The belief's hypotheses, weighed by how much of each view they would have had in the image."""
        every = Hypotheses.of(belief)
        views, told = self._memory.views(VIEWS)
        misfit = np.minimum(np.square((self._shares(every, views) - told) / SHARE_SD), SHARE_MOST)
        misfit[np.isnan(misfit)] = SHARE_MOST
        return every.weighed(-0.5 * misfit.sum(axis=1))

    def _shares(self, hypotheses: Hypotheses, views: Array) -> Array:
        """(K, W) share of the rays that each hypothesis would have in the image at views (W, 3) in the body frame."""
        assert self._field is not None
        field, sight = self._field, self._sight
        shares = shares_seen(
            hypotheses.poses, views, self._log_ranges, field.index, field.origin, field.resolution, sight.rays,
            sight.measured,
        )  # fmt: skip
        return np.asarray(shares)

    def _turn(self, hypotheses: Hypotheses) -> int:
        """The turn after which a wall is in the image soonest, by all hypotheses."""
        around = np.zeros((TURNS_AROUND, 3))
        around[:, 2] = TURN_RAD * np.arange(1, TURNS_AROUND + 1)
        seen = self._shares(hypotheses, around) >= SEEN_SHARE
        seen[:, -1] = True  # once around, and no wall yet
        turns = [hypotheses.weights @ seen[:, order].argmax(axis=1) for order in (_LEFTWARD, _RIGHTWARD)]
        if self._way is None or abs(turns[0] - turns[1]) > CHANGE_TURNS:
            self._way = LEFT if turns[0] <= turns[1] else RIGHT
        return self._way

    def _begin(self, hypotheses: Hypotheses, outer: Array, onward: int) -> int:
        """The first move of the way with the least expected cost, from the first of the hypotheses.

        Args:
            hypotheses: what is to be told apart.
            outer: (K,) probability of each for the expectation.
            onward: the move where no way promises to tell anything.
        """
        pose = hypotheses.poses[0]
        tree = Tree.grow(self._robot.plan, pose, self._memory.taken(pose), HORIZON, self._nodes)
        move = onward
        if len(tree.parent) > 1:
            entropy = self._expected(tree, hypotheses, outer)
            best = 1 + int(np.argmin(tree.cost(entropy, min(HORIZON, max(self._left, 1)))[1:]))
            if entropy[0] - entropy[best] >= max(LEAST_NATS, LEAST_SHARE * entropy[0]):
                move = tree.first_move(best)
        self._memory.intend(move, pose)
        return move

    def _expected(self, tree: Tree, hypotheses: Hypotheses, outer: Array) -> Array:
        """(M,) expected entropy after the way to each node of a tree, nats."""
        field, sight = self._field, self._sight
        assert field is not None
        views, _ = self._memory.views(len(self._memory))
        fresh = freshness(tree.motion, tree.parent, views, FRESH_M, FRESH_RAD)
        return np.asarray(
            expected_entropy(
                tree.motion, tree.parent, fresh, hypotheses.poses, outer, hypotheses.weights, hypotheses.near(),
                self._log_ranges, self._lowest, self._highest, field.index, field.origin, field.resolution, sight.rays,
                sight.measured, sight.precision, sight.limit_precision, sight.weight,
                np.float32(1.0 / (SATURATION * SCALE_SD**2)), np.float32(FLOOR), np.float32(BUMP_NATS),
                np.float32(DEAD),
            )
        )  # fmt: skip
