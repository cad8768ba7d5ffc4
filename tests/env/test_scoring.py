import math

import numpy as np
import pytest
from small_world import small_plan

from galoc import Estimate
from galoc_env import scoring
from galoc_env.env import FloorplanEnv
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


BLIND = {"renderer": "none", "detector": "oracle", "hfov_deg": 60.0}
STILL, LEFT, AHEAD = np.float32([0, 0, 0]), np.float32([0, 0, 1]), np.float32([1, 0, 0])


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory):
    return str(small_plan().save(tmp_path_factory.mktemp("plans") / "small.json"))


def play(plan_file, reward, actions, **arguments):
    """Rewards of these actions, and the scores of all observations."""
    env = FloorplanEnv(plan=plan_file, actions="continuous", reward=reward, **BLIND, **arguments)
    env.reset(seed=3)
    rewards = [env.step(action)[1] for action in actions]
    scores, cells = list(env.episode.scores), getattr(env.world.observer.belief, "size", None)
    env.close()
    return rewards, scores, cells


@pytest.mark.parametrize(
    "actions", [[LEFT] * 12, [STILL] * 12, [AHEAD, -AHEAD] * 6], ids=["turn", "stay", "to and fro"]
)
def test_returns_of_potentials_depend_on_both_ends_only(plan_file, actions):
    rewards, scores, _ = play(plan_file, "log_belief", actions)
    assert sum(rewards) == pytest.approx(scores[-1].log_mass - scores[0].log_mass)
    assert np.abs(rewards).max() <= math.log(1e6) and abs(sum(rewards)) <= math.log(1e6)
    rewards, scores, cells = play(plan_file, "infogain", actions)
    assert sum(rewards) == pytest.approx(scores[0].entropy - scores[-1].entropy)
    assert all(-1e-6 <= score.entropy <= math.log(cells) + 1e-6 for score in scores)


@pytest.mark.parametrize("name", ["log_belief", "infogain"])
def test_a_belief_that_does_not_change_earns_nothing(name):
    now = Score(3.0, 0.5, 6.0, -4.0)
    assert scoring.reward(name, now, now, False) == 0.0


def test_standing_still_pays_for_its_error_at_every_step(plan_file):
    rewards, scores, _ = play(plan_file, "error", [STILL] * 5, localizer="small_world:DeadReckoner")
    assert rewards == pytest.approx([-score.error_m for score in scores[1:]])
    assert len(set(np.round(rewards, 6))) == 1 and -10.0 <= rewards[0] < 0.0
    rewards, *_ = play(plan_file, "error", [STILL] * 5, localizer="small_world:Silent")
    assert rewards == [-10.0] * 5


def test_success_returns_one_or_nothing(plan_file):
    rewards, scores, _ = play(plan_file, "success", [LEFT] * 30)
    held = any(scoring.has_held([s.error_m for s in scores[: i + 1]]) for i in range(len(scores)))
    assert held and sum(rewards) == 1.0 and rewards.count(0.0) == len(rewards) - 1
    rewards, *_ = play(plan_file, "success", [LEFT] * 30, localizer="small_world:Silent")
    assert rewards == [0.0] * 30
