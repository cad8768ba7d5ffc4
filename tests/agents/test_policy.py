import gymnasium
import numpy as np
import pytest
from galoc_agents import RandomPolicy, SpinPolicy, run_episode
from small_world import small_plan

STEPS = 40


@pytest.fixture
def env(tmp_path):
    plan = str(small_plan().save(tmp_path / "small.json"))
    env = gymnasium.make(
        "galoc_env:GALoc-Floorplan-v0",
        max_episode_steps=STEPS,
        plan=plan,
        localizer="small_world:DeadReckoner",
        reward="error",
        renderer="none",
        detector="oracle",
        width=32,
        height=24,
    )
    yield env
    env.close()


def policies(env):
    return [RandomPolicy(env.action_space), SpinPolicy(walk_steps=5)]


def test_an_episode_runs_to_the_time_limit_and_adds_up(env):
    for policy in policies(env):
        episode = run_episode(env, policy, seed=1)
        assert episode.steps == STEPS and not episode.terminated
        assert -10.0 * STEPS <= episode.total_reward < 0.0
        assert 0.0 <= episode.metrics["recall_1m"] <= 1.0


def test_same_seed_same_episode(env):
    for policy in policies(env):
        assert run_episode(env, policy, seed=2) == run_episode(env, policy, seed=2)
        assert run_episode(env, policy, seed=2) != run_episode(env, policy, seed=3)


def test_random_policy_leaves_the_environments_own_space_alone(env):
    env.action_space.seed(0)
    policy = RandomPolicy(env.action_space)
    policy.reset(5)
    first = [policy.act({}, {}) for _ in range(5)]
    env_draws = [env.action_space.sample() for _ in range(5)]
    env.action_space.seed(0)
    assert env_draws == [env.action_space.sample() for _ in range(5)]
    policy.reset(5)
    assert first == [policy.act({}, {}) for _ in range(5)]


def test_spin_turns_once_around_then_walks_and_turns_away_when_stuck(env):
    policy = SpinPolicy(walk_steps=3)
    policy.reset(0)
    moving, stuck = {"odometry": np.array([0.3, 0, 0])}, {"odometry": np.array([0.01, 0, 0])}
    assert [policy.act(moving, {}) for _ in range(12)] == [2] * 12
    walked = [policy.act(moving, {}) for _ in range(12 + 3)]
    assert walked == [2] * 12 + [0] * 3
    policy.reset(0)
    for _ in range(24):
        policy.act(moving, {})
    assert policy.act(moving, {}) == 0
    assert policy.act(stuck, {}) == 2


def test_policies_use_observations_only(env):
    class Blind(dict):
        def __getitem__(self, key):
            raise AssertionError("a policy read the truth")

        get = __getitem__

    for policy in policies(env):
        policy.reset(0)
        observation, _ = env.reset(seed=0)
        for _ in range(20):
            policy.act(observation, Blind())
