"""Knows where it is, and goes where its localizer will find that out soonest: what a perfect guess would achieve."""

from __future__ import annotations

from typing import Any

import numpy as np

from galoc_agents.infogain import TEMPER, InfoGain
from galoc_env.policy import BeliefView

TRUTH_WEIGHT = 1e-3
"""Weight of the true pose beside the belief's hypotheses: it must come out of the views, not of this."""


class Oracle(InfoGain):
    """:class:`galoc_agents.infogain.InfoGain` with the expectation over the truth alone, from which it also plans.

    It sees the truth, hence is a bound and no competitor; not a strict one, since it is as greedy and as short-sighted
    as infogain, and knows nothing of furniture.
    """

    sees_truth = True

    def _best(self, belief: BeliefView, info: dict[str, Any], onward: int) -> int:
        """The move under a belief and at the true pose."""
        truth = np.array(info["pose"], dtype=np.float64)
        hypotheses = self._weighed(belief).tempered(TEMPER).thinned(self._most).with_pose(truth, TRUTH_WEIGHT)
        outer = np.zeros(len(hypotheses.weights))
        outer[0] = 1.0
        return self._begin(hypotheses, outer, onward)
