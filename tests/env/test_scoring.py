import math

import numpy as np
import pytest

from galoc import Estimate
from galoc_env import scoring
from galoc_env.scoring import Score


class Belief:
    """A belief with settable answers; remembers what it was asked."""

    def __init__(self, mass, entropy):
        self.mass, self.nats = mass, entropy

    def entropy(self):
        return self.nats

    def mass_near(self, pose, radius_m, angle_rad):
        self.asked = radius_m, angle_rad
        return self.mass


def test_score_measures_error_mass_and_entropy():
    belief = Belief(0.25, 3.0)
    estimate = Estimate(np.array([3.0, 4.0, math.pi - 0.1]), 1.0, False)
    now = scoring.score(estimate, belief, np.array([0.0, 0.0, -math.pi + 0.1]))
    assert now.error_m == pytest.approx(5.0)
    assert now.error_rad == pytest.approx(0.2)
    assert now.log_mass == pytest.approx(math.log(0.25))
    assert now.entropy == 3.0
    assert belief.asked == (0.5, math.radians(15))


def test_no_estimate_is_infinitely_wrong_and_mass_has_a_floor():
    now = scoring.score(Estimate(np.full(3, np.nan), 0.0, True), Belief(0.0, 9.0), np.zeros(3))
    assert (now.error_m, now.error_rad) == (math.inf, math.pi)
    assert now.log_mass == pytest.approx(math.log(1e-6))


def test_rewards():
    before, now = Score(4.0, 0.1, 8.0, -5.0), Score(0.3, 0.1, 6.5, -2.0)
    assert scoring.reward("log_belief", before, now, False) == 3.0
    assert scoring.reward("infogain", before, now, False) == 1.5
    assert scoring.reward("error", before, now, False) == -0.3
    assert scoring.reward("error", now, Score(math.inf, math.pi, 6.0, -2.0), False) == -10.0
    assert [scoring.reward("success", before, now, held) for held in (False, True)] == [0.0, 1.0]


def test_log_belief_and_infogain_telescope():
    rng = np.random.default_rng(0)
    scores = [Score(1.0, 0.0, *rng.uniform(-5, 5, 2)) for _ in range(20)]
    pairs = list(zip(scores[:-1], scores[1:], strict=True))
    assert sum(scoring.reward("log_belief", a, b, False) for a, b in pairs) == pytest.approx(
        scores[-1].log_mass - scores[0].log_mass
    )
    assert sum(scoring.reward("infogain", a, b, False) for a, b in pairs) == pytest.approx(
        scores[0].entropy - scores[-1].entropy
    )


def test_success_needs_ten_in_a_row():
    assert not scoring.has_held([0.1] * 9)
    assert scoring.has_held([9.0] + [0.1] * 10)
    assert not scoring.has_held([0.1] * 9 + [0.5])  # strictly within
    assert not scoring.has_held([math.inf] + [0.1] * 9)


def test_episode_metrics():
    errors = [math.inf, 4.0] + [0.2] * 12
    metrics = scoring.episode_metrics(errors, [0.0] * len(errors))
    assert metrics["steps_to_converge"] == 2.0
    assert metrics["recall_0.5m"] == pytest.approx(12 / 14)
    assert metrics["recall_0.1m"] == 0.0
    assert metrics["success"] == 1.0
    assert metrics["final_error_m"] == 0.2
    early = scoring.episode_metrics([math.inf, math.inf], [math.pi] * 2)
    assert (early["steps_to_converge"], early["success"], early["median_error_m"]) == (-1.0, 0.0, math.inf)
