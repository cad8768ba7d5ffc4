"""Estimate against truth: errors, rewards and episode metrics.

Rewards, one per value of the environment's ``reward`` argument; "now" is after the step's observation:

| name | reward of a step | unit |
|---|---|---|
| `log_belief` | change of log(belief mass within 0.5 m and 15 degrees of the truth), the mass floored at 1e-6 | nats |
| `infogain` | entropy of the belief before minus now | nats |
| `error` | -min(position error now, 10); -10 where there is no estimate | m |
| `success` | 1 at the first step that ends 10 consecutive ones with position error below 0.5 m, else 0 | - |

The sums telescope: an episode's `log_belief` return is the last log mass minus the first, its `infogain` return the
entropy lost since the first observation. With `success` that step also terminates the episode. Where there is no
estimate the errors are infinity and pi: above every threshold.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from galoc import Estimate

Array = NDArray[np.float64]

REWARDS = ("log_belief", "infogain", "error", "success")
"""Values of the environment's ``reward``."""
BELIEF_REWARDS = ("log_belief", "infogain")
"""The rewards that need a localizer with a belief."""
NEAR_M, NEAR_RAD = 0.5, math.radians(15.0)
"""The neighbourhood of the truth whose belief mass is rewarded."""
MASS_FLOOR = 1e-6
"""Least belief mass told apart, so that the logarithm stays finite."""
ERROR_CAP_M = 10.0
"""Position errors beyond this cost no more, m."""
HOLD_STEPS, HOLD_M = 10, 0.5
"""The paper's success: this many consecutive steps with a position error below this."""


class HasBelief(Protocol):
    """The parts of a belief that scoring reads."""

    def entropy(self) -> float:
        """Entropy, nats."""

    def mass_near(self, pose: Array, radius_m: float, angle_rad: float) -> float:
        """Belief mass around a pose, 0..1."""


@dataclass(frozen=True, slots=True)
class Score:
    """How good the estimate is at one step."""

    error_m: float
    """Position error, m; infinity where there is no estimate."""
    error_rad: float
    """Absolute heading error, rad; pi where there is no estimate."""
    entropy: float
    """Entropy of the belief, nats; NaN without a belief."""
    log_mass: float
    """log of the belief mass within 0.5 m and 15 degrees of the truth, floored; NaN without a belief."""


def score(estimate: Estimate, belief: HasBelief | None, truth: Array) -> Score:
    """Compare an estimate and a belief with the true pose (3,)."""
    from galoc.metrics import pose_error

    error_m, error_rad = pose_error(estimate.pose, truth)
    if belief is None:
        return Score(error_m, error_rad, math.nan, math.nan)
    mass = float(belief.mass_near(truth, NEAR_M, NEAR_RAD))
    entropy = estimate.entropy if math.isfinite(estimate.entropy) else float(belief.entropy())
    return Score(error_m, error_rad, entropy, math.log(max(mass, MASS_FLOOR)))


def reward(name: str, before: Score, now: Score, held: bool) -> float:
    """Reward of one step (see the module's table); ``held``: the success criterion is met now for the first time."""
    if name == "log_belief":
        return now.log_mass - before.log_mass
    if name == "infogain":
        return before.entropy - now.entropy
    if name == "error":
        return -min(now.error_m, ERROR_CAP_M)
    return 1.0 if held else 0.0


def has_held(errors_m: Sequence[float], threshold_m: float = HOLD_M, hold: int = HOLD_STEPS) -> bool:
    """Whether the last ``hold`` errors exist and all lie below the threshold."""
    last = errors_m[-hold:]
    return len(last) == hold and all(e < threshold_m for e in last)


def episode_metrics(errors_m: Sequence[float], errors_rad: Sequence[float]) -> dict[str, float]:
    """Metrics of an episode so far, over all its observations (the one of the reset included).

    Keys: ``recall_<threshold>`` (share of steps, thresholds as in :func:`galoc.metrics.recall`),
    ``steps_to_converge`` (:func:`galoc.metrics.steps_to_converge`, -1 for not yet), ``final_error_m``,
    ``median_error_m`` and ``success`` (0 or 1, the paper's criterion at 0.5 m).
    """
    from galoc.metrics import recall, steps_to_converge, success

    errors = np.asarray(errors_m, dtype=np.float64)
    converged = steps_to_converge(errors, threshold_m=HOLD_M, hold=HOLD_STEPS)
    return {
        **{f"recall_{key}": float(value) for key, value in recall(errors, errors_rad).items()},
        "steps_to_converge": float(-1 if converged is None else converged),
        "final_error_m": float(errors[-1]),
        # Not np.median: the mean of two infinite middle values would warn.
        "median_error_m": float(np.sort(errors)[len(errors) // 2]),
        "success": float(success(errors, HOLD_M, "paper")),
    }
