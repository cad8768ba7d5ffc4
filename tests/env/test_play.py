"""One episode: what a policy is told, what it can do wrong, and what the walk's numbers are."""

import math
import signal

import numpy as np
import pytest
from small_world import small_plan

from galoc import GalocError
from galoc_env.env import FloorplanEnv
from galoc_env.patrol import Patroller
from galoc_env.play import Rollout, Step, play, rollout
from galoc_env.policy import TOLD

STEPS = 14


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory):
    return str(small_plan().save(tmp_path_factory.mktemp("plans") / "small.json"))


def make_env(plan, **more):
    quiet = {"renderer": "none", "detector": "oracle", "width": 32, "height": 24, "reward": "error"}
    return FloorplanEnv(plan=plan, **{"localizer": "small_world:DeadReckoner", **quiet, **more})


class Turner:
    """Turns left, and keeps what it was told."""

    def reset(self, robot):
        self.robot, self.told = robot, []

    def act(self, observation, info):
        self.told.append((observation, info))
        return 2


class Bad(Turner):
    """Does ``deed`` at observation 3."""

    def __init__(self, deed):
        self.deed = deed

    def act(self, observation, info):
        super().act(observation, info)
        return self.deed() if len(self.told) == 4 else 2


def test_a_policy_is_told_what_a_robot_has_and_no_more(plan_file):
    env, policy = make_env(plan_file), Turner()
    walk, cpu_ms = play(env, policy, 5, STEPS)
    assert len(walk.steps) == STEPS + 1 == len(cpu_ms) + 1 and walk.failure is None and walk.missing == 0
    assert policy.robot.seed == 5 and policy.robot.steps == STEPS
    for observation, info in policy.told:
        assert set(observation) == {"image", "gravity", "odometry", "belief", "estimate"}
        assert info and set(info) <= set(TOLD)
    knowing = Turner()
    knowing.sees_truth = True
    play(env, knowing, 5, STEPS)
    assert {"pose", "error_m", "metrics"} <= set(knowing.told[0][1])


def test_numbers_of_a_walk_that_turns_on_the_spot(plan_file):
    walk, _ = play(make_env(plan_file), Turner(), 1, STEPS)
    assert walk.path_m() == 0.0 and walk.turns_rad() == pytest.approx(STEPS * math.radians(30.0))
    again, _ = play(make_env(plan_file), Turner(), 1, STEPS)
    assert again == walk


@pytest.mark.parametrize(
    ("deed", "said"),
    [
        (lambda: 1 / 0, "act raised ZeroDivisionError: division by zero"),
        (lambda: exit(3), "act raised SystemExit: 3"),
        (lambda: 4, "act returned 4, expected 0 (forward)"),
        (lambda: None, "act returned None, expected 0 (forward)"),
        (lambda: "left", "act returned 'left', expected"),
        (lambda: 1.0, "act returned 1.0, expected"),
        (lambda: np.array([np.nan, 0, 0]), "act returned array([nan, 0., 0.]), expected"),
        (object, "act returned <object object>, expected"),
    ],
)
def test_what_a_policy_does_wrong_is_told_and_ends_the_walk(deed, said, plan_file):
    walk, _ = play(make_env(plan_file), Bad(deed), 0, STEPS, name="my.py:Mine")
    assert walk.failure.startswith(f"policy my.py:Mine, step 3: {said}") and "\n" not in walk.failure
    assert len(walk.steps) == 4 and walk.missing == STEPS + 1 - 4
    found = walk.metrics()
    assert found["steps_to_converge"] is None and not any(v for p in found["success"].values() for v in p.values())
    assert found["recall"]["1m"] <= 4 / (STEPS + 1)


class Speechless(BaseException):
    """Cannot say what it is."""

    def __str__(self):
        raise TypeError("no words")


@pytest.mark.parametrize("error", [KeyboardInterrupt, GeneratorExit, MemoryError, Speechless])
def test_exceptions_of_any_kind_are_the_policys_and_say_where(error, plan_file, monkeypatch):
    def deed():
        raise error

    # As in a worker process, which ignores Ctrl-C.
    monkeypatch.setattr("galoc_env.play.signal.getsignal", lambda number: signal.SIG_IGN)
    walk, _ = play(make_env(plan_file), Bad(deed), 0, STEPS)
    line = deed.__code__.co_firstlineno + 1
    assert walk.failure == f"policy policy, step 3: act raised {error.__name__} (test_play.py, line {line})"


def test_ctrl_c_is_not_the_policys(plan_file):
    def deed():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        play(make_env(plan_file), Bad(deed), 0, STEPS)


def test_a_call_that_fails_before_the_policys_code_names_no_line(plan_file):
    class Few(Turner):
        def act(self):
            return 2

    walk, _ = play(make_env(plan_file), Few(), 0, STEPS)
    assert "step 0: act raised TypeError:" in walk.failure and ", line " not in walk.failure


def test_a_watched_walk_names_the_policy_that_failed(plan_file):
    with pytest.raises(GalocError, match="policy my.py:Mine, step 3: act returned 4"):
        rollout(make_env(plan_file), 0, STEPS, policy=Bad(lambda: 4), name="my.py:Mine")


def test_a_policy_cannot_change_the_belief(plan_file):
    env, policy = make_env(plan_file, localizer="galoc"), Turner()
    play(env, policy, 0, 1)
    belief = policy.robot.belief
    for array in (belief.positions, belief.headings_rad, belief.p):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


@pytest.mark.parametrize("bad", [np.zeros(2), np.full(3, np.inf), np.array([0.0, 0.0, 1.5]), 1, "left", [[0, 0, 0]]])
def test_continuous_actions_are_checked(bad, plan_file):
    env = make_env(plan_file, actions="continuous")
    walk, _ = play(env, Bad(lambda: bad), 0, STEPS)
    assert "step 0: act returned 2, expected three finite numbers" in walk.failure

    class Late(Bad):
        def act(self, observation, info):
            action = super().act(observation, info)
            return np.zeros(3, np.float32) if isinstance(action, int) and action == 2 else action

    walk, _ = play(env, Late(lambda: bad), 0, STEPS)
    assert "step 3: act returned" in walk.failure and "three finite numbers" in walk.failure


def test_a_reset_that_raises_leaves_the_first_observation(plan_file):
    class Unready(Turner):
        def reset(self, robot):
            raise RuntimeError("no\nmodel " + 1000 * "x")

    walk, cpu_ms = play(make_env(plan_file), Unready(), 0, STEPS, name="unready")
    assert (
        walk.failure.startswith("policy unready: reset raised RuntimeError: no model xxx") and len(walk.failure) < 300
    )
    assert len(walk.steps) == 1 and cpu_ms == []


def test_nobody_is_scored_without_a_localizer(plan_file):
    with pytest.raises(GalocError, match="localizer"):
        play(make_env(plan_file, localizer="none"), Turner(), 0, STEPS)


@pytest.mark.parametrize("actions", ["discrete", "continuous"])
def test_the_scripted_walker_is_a_policy(actions, plan_file):
    env = make_env(plan_file, actions=actions)
    walk, _ = play(env, Patroller(), 3, 40)
    assert walk.failure is None and not any(s.collided for s in walk.steps) and walk.path_m() > 1.0
    seen = []
    same = rollout(env, 3, 40, on_step=lambda e: seen.append(e.episode.steps))
    assert same == walk and seen == list(range(41))
    # The same walk in both action spaces, but for the single precision of the continuous one.
    other = rollout(make_env(plan_file, actions="discrete"), 3, 40)
    np.testing.assert_allclose([s.pose for s in walk.steps], [s.pose for s in other.steps], atol=1e-5)


def test_convergence_needs_ten_last_observations_and_no_failure():
    def step(error):
        return Step((0, 0, 0), (0, 0, 0), error, 0.0, 1.0, 1.0, False, False)

    steps = tuple(step(e) for e in [5.0, 0.05, 0.4] + [0.2] * 10)
    whole = Rollout(0, "plan", steps)
    assert [whole.steps_to(x) for x in (0.5, 0.3, 0.1)] == [1, 3, None]
    assert Rollout(0, "plan", steps[:-1]).steps_to(0.3) is None
    failed = Rollout(0, "plan", steps, "policy: reset raised", 2)
    assert failed.steps_to(0.5) is None and failed.metrics()["final_error_m"] == 0.2
    assert failed.metrics()["recall"]["1m"] == pytest.approx(12 / 15)
