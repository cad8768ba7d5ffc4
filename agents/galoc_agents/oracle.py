"""Knows where it is, and goes where its localizer will find that out soonest: what a perfect guess would achieve."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc_agents.infogain import InfoGain
from galoc_agents.moves import as_action

TRUTH_WEIGHT = 1e-3
"""Weight of the true pose beside the belief's hypotheses: it must come out of the views, not of this."""


class Oracle(InfoGain):
    """:class:`galoc_agents.infogain.InfoGain` with the expectation over the truth alone, from which it also plans.

    It sees the truth, hence is a bound and no competitor; not a strict one, since it is as greedy and as short-sighted
    as infogain.
    """

    sees_truth = True

    def act(self, observation: dict[str, NDArray[Any]], info: dict[str, Any]) -> Any:
        """The first move of the best way."""
        self._memory.take(observation["odometry"], float(info["coverage"]))
        belief = self._robot.belief
        truth = np.array(info["pose"], dtype=np.float64)
        hypotheses = self._considered(belief).with_pose(truth, TRUTH_WEIGHT)
        outer = np.zeros(len(hypotheses.weights))
        outer[0] = 1.0
        move = self._choose(hypotheses, outer)
        self._left -= 1
        self._memory.intend(move, truth)
        return as_action(self._robot, move)
