"""The plain policies: deterministic, blind to the truth, and doing what they say."""

import numpy as np
import pytest
from galoc_agents import make_policy, named
from galoc_agents.random_walk import RandomWalk
from galoc_agents.spin import Spin
from galoc_agents.stay import Stay
from small_world import small_plan

from galoc import GalocError
from galoc_env.env import FloorplanEnv
from galoc_env.motion import FORWARD, LEFT, RIGHT, STEP_M
from galoc_env.play import play
from galoc_env.policy import TOLD, Robot, sees_truth, told

STEPS = 40
POLICIES = [Stay, RandomWalk, Spin]
MOVING, STUCK = ({"odometry": np.array([forward, 0.0, 0.0])} for forward in (STEP_M, 0.01))


@pytest.fixture(params=["discrete", "continuous"])
def env(request, tmp_path):
    made = FloorplanEnv(
        plan=str(small_plan().save(tmp_path / "small.json")),
        localizer="small_world:DeadReckoner",
        reward="error",
        renderer="none",
        detector="oracle",
        width=32,
        height=24,
        actions=request.param,
    )
    yield made
    made.close()


class OnlyTold(dict):
    """Raises on everything that a robot does not have."""

    def _check(self, key):
        assert key in TOLD, f"a policy read {key}, which only the environment knows"

    def __getitem__(self, key):
        self._check(key)
        return super().__getitem__(key)

    def get(self, key, default=None):
        self._check(key)
        return super().get(key, default)

    def __contains__(self, key):
        self._check(key)
        return super().__contains__(key)

    def _all(self):
        raise AssertionError("a policy went through all that there is")

    __iter__ = keys = values = items = _all


def robot(env, seed=0):
    env.reset(seed=0)
    return Robot.of(env, seed, STEPS)


@pytest.mark.parametrize("made", POLICIES)
def test_same_seed_same_actions_and_all_of_them_in_the_space(made, env):
    def actions(seed):
        policy = made()
        policy.reset(robot(env, seed))
        observation, info = env.reset(seed=0)
        taken = []
        for _ in range(STEPS):
            taken.append(policy.act(observation, told(policy, info)))
            assert env.action_space.contains(taken[-1])
            observation, _, _, _, info = env.step(taken[-1])
        return np.array(taken)

    np.testing.assert_array_equal(actions(1), actions(1))
    if made is RandomWalk:
        assert not np.array_equal(actions(1), actions(2))


@pytest.mark.parametrize("made", POLICIES)
def test_a_second_episode_begins_afresh(made, env):
    policy = made()
    first, _ = play(env, policy, 3, STEPS)
    play(env, policy, 4, STEPS // 2)
    again, _ = play(env, policy, 3, STEPS)
    assert first == again and first.failure is None


@pytest.mark.parametrize("made", POLICIES)
def test_policies_never_look_at_the_truth(made, env):
    policy = made()
    assert not sees_truth(policy)
    policy.reset(robot(env))
    observation, info = env.reset(seed=0)
    for _ in range(STEPS):
        observation, _, _, _, info = env.step(policy.act(observation, OnlyTold(info)))


def test_what_is_told_has_no_truth_in_it(env):
    _, info = env.reset(seed=0)
    assert {"pose", "error_m", "error_rad", "metrics"} <= set(info)
    assert not {"pose", "error_m", "error_rad", "metrics"} & set(told(Stay(), info))
    with pytest.raises(AssertionError, match="pose"):
        OnlyTold(info)["pose"]


def test_random_walk_leaves_the_environments_own_space_alone(env):
    env.action_space.seed(0)
    expected = np.array([env.action_space.sample() for _ in range(5)])
    env.action_space.seed(0)
    policy = RandomWalk()
    policy.reset(robot(env, 7))
    for _ in range(5):
        policy.act({}, {})
    np.testing.assert_array_equal(expected, [env.action_space.sample() for _ in range(5)])


def moves(env, policy, observations):
    """What a policy does, as moves whatever the action space."""
    found = [policy.act(o, {}) for o in observations]
    if env.settings.actions == "discrete":
        return found
    names = {(1, 0, 0): FORWARD, (0, 0, 1): LEFT, (0, 0, -1): RIGHT, (0, 0, 0): None}
    return [names[tuple(int(v) for v in action)] for action in found]


def test_stay_goes_nowhere(env):
    walk, _ = play(env, Stay(), 0, STEPS)
    assert walk.path_m() == 0.0 and len({round(s.pose[2], 6) for s in walk.steps}) <= 2


def test_spin_turns_once_around_then_walks(env):
    policy = Spin(walk_steps=3)
    policy.reset(robot(env))
    assert moves(env, policy, [MOVING] * 27) == [LEFT] * 24 + [FORWARD] * 3


def test_spin_turns_away_where_it_is_stopped(env):
    policy = Spin(walk_steps=3)
    policy.reset(robot(env))
    assert moves(env, policy, [MOVING] * 25)[-1] == FORWARD
    away = moves(env, policy, [STUCK] * 15)
    turns = away.index(FORWARD)
    assert 2 <= turns <= 11 and away[:turns] == [LEFT] * turns


def test_policies_are_found_by_name():
    assert {"random", "spin", "stay", "patrol"} <= set(named())
    assert isinstance(make_policy("spin"), Spin) and isinstance(make_policy("galoc_agents.stay:Stay"), Stay)
    with pytest.raises(GalocError, match="spin, stay"):
        make_policy("spinn")
    with pytest.raises(GalocError, match="reset and act"):
        make_policy("builtins:dict")
