import numpy as np
import pytest
from small_world import small_plan

from galoc_env import motion
from galoc_env.env import FloorplanEnv
from galoc_env.patrol import Patrol

FAST = {"localizer": "none", "renderer": "none", "width": 32, "height": 24}


@pytest.fixture(scope="module")
def env(tmp_path_factory):
    plan = small_plan().save(tmp_path_factory.mktemp("plans") / "small.json")
    env = FloorplanEnv(plan=str(plan), furniture=0.3, **FAST)
    yield env
    env.close()


def walk(env, seed, steps):
    _, info = env.reset(seed=seed)
    walker = Patrol(env.world, np.random.default_rng(seed))
    poses, actions, bumps = [info["pose"]], [], 0
    for _ in range(steps):
        actions.append(walker.action(info["pose"]))
        *_, info = env.step(actions[-1])
        poses.append(info["pose"])
        bumps += info["collided"]
    return np.array(poses), actions, bumps


@pytest.mark.parametrize("seed", range(4))
def test_walks_without_bumping(env, seed):
    poses, actions, bumps = walk(env, seed, 120)
    assert bumps == 0
    assert np.ptp(poses[:, :2], axis=0).max() > 1.5  # gets somewhere in a home of 6 m
    assert actions.count(motion.FORWARD) > 30  # and does not only turn


def test_same_seed_same_walk(env):
    assert walk(env, 5, 60)[1] == walk(env, 5, 60)[1]
    assert walk(env, 5, 60)[1] != walk(env, 6, 60)[1]


def test_sees_both_rooms(env):
    x = np.concatenate([walk(env, seed, 120)[0][:, 0] for seed in range(4)])
    assert (x < 2.5).any() and (x > 3.8).any()  # the wall between them is at 3.5


@pytest.mark.parametrize("plan", ["apartment", None])
def test_walks_in_furnished_homes(plan):
    env = FloorplanEnv(plan=plan, furniture=0.7, **FAST)
    poses, actions, bumps = walk(env, 3, 150)
    assert bumps == 0
    assert np.ptp(poses[:, :2], axis=0).max() > 2.5
    env.close()
