"""The environment under the tools that people learn with, and the page that shows how."""

import contextlib
import importlib.util
import io
import re
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv
from gymnasium.wrappers import FrameStackObservation, RecordEpisodeStatistics
from gymnasium.wrappers.vector import RecordEpisodeStatistics as RecordVectorStatistics
from small_world import small_plan

from galoc_env.vector import FloorplanVectorEnv

ENV_ID = "galoc_env:GALoc-Floorplan-v0"
PAGE = Path(__file__).resolve().parents[2] / "docs" / "learning.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
SMALL = {"width": 48, "height": 40}
RECKONED = {**SMALL, "renderer": "none", "detector": "oracle", "localizer": "small_world:DeadReckoner"}


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory):
    return str(small_plan().save(tmp_path_factory.mktemp("plans") / "small.json"))


def need(module, extra="rl"):
    if importlib.util.find_spec(module) is None:
        pytest.skip(f"needs the extra `{extra}` ({module})")


def test_the_page_has_its_examples():
    assert len(BLOCKS) == 3
    policy = BLOCKS[0].partition("class ")[2].partition("env = ")[0]
    assert 5 < len([line for line in policy.splitlines() if line.strip()]) <= 20


@pytest.mark.parametrize("number", range(len(BLOCKS)))
def test_the_pages_examples_run(number):
    code = BLOCKS[number]
    if "stable_baselines3" in code:
        need("stable_baselines3")
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(compile(code, f"docs/learning.md, example {number}", "exec"), {"__name__": "example"})
    assert re.search(r"localized: \[\d+, \d+, \d+\]|\(3, 48, 64, 3\) steps: 5|trained for 32 steps", out.getvalue())


def test_the_pages_policy_works_in_both_action_spaces(plan_file):
    from galoc_agents.trial import steps_to_localize

    space = {"__name__": "example"}
    exec(BLOCKS[0].partition("\nenv = ")[0], space)
    found = []
    for actions in ("discrete", "continuous"):
        env = gymnasium.make(ENV_ID, plan=plan_file, actions=actions, renderer="none", detector="oracle", **SMALL)
        found.append(steps_to_localize(env.unwrapped, space["LookTwice"](), seed=1, steps=12))
        env.close()
    assert found[0] == found[1] <= 12


def test_frames_are_stacked_key_by_key(plan_file):
    env = FrameStackObservation(gymnasium.make(ENV_ID, plan=plan_file, **RECKONED, reward="error"), 3)
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    first = observation["odometry"].copy()
    observation, *_ = env.step(2)
    assert env.observation_space.contains(observation)
    assert observation["odometry"].shape == (3, 3) and observation["belief"].shape == (3, 2, 64, 64)
    assert np.array_equal(observation["odometry"][:2], first[1:]) and observation["odometry"][2, 2] > 0.4
    env.close()


def test_episode_statistics_add_up(plan_file):
    env = gymnasium.make(ENV_ID, plan=plan_file, max_episode_steps=5, **RECKONED, reward="error")
    env = RecordEpisodeStatistics(env)
    env.reset(seed=0)
    total = 0.0
    for _ in range(5):
        *_, reward, terminated, truncated, info = step = env.step(3)
        total += step[1]
    assert truncated and not terminated
    assert info["episode"]["r"] == pytest.approx(total, abs=1e-6) and info["episode"]["l"] == 5
    env.close()


def test_both_ways_of_many_at_once_tell_the_same(plan_file):
    arguments = {"plan": plan_file, "max_episode_steps": 3, **RECKONED, "reward": "error"}
    batches = [gymnasium.make_vec(ENV_ID, 2, mode, **arguments) for mode in ("vector_entry_point", "sync")]
    assert isinstance(batches[0].unwrapped, FloorplanVectorEnv) and isinstance(batches[1].unwrapped, SyncVectorEnv)
    batches = [RecordVectorStatistics(batch) for batch in batches]
    for batch in batches:
        batch.reset(seed=4)
    for action in (2, 0, 3, 0, 1):
        steps = [batch.step(np.full(2, action)) for batch in batches]
        assert np.allclose(steps[0][1], steps[1][1]) and np.array_equal(steps[0][3], steps[1][3])
        episodes = [step[4].get("episode", {}).get("r") for step in steps]
        assert (episodes[0] is None) == (episodes[1] is None)
        assert episodes[0] is None or episodes[0] == pytest.approx(episodes[1])
    for batch in batches:
        batch.close()


def test_ppo_of_stable_baselines3_trains_on_pictures_and_belief(plan_file, tmp_path):
    need("stable_baselines3")
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

    def make():
        return gymnasium.make(ENV_ID, plan=plan_file, max_episode_steps=10, **SMALL)

    envs = VecMonitor(DummyVecEnv([make, make]))
    model = PPO("MultiInputPolicy", envs, n_steps=20, batch_size=40, n_epochs=2, seed=0, device="cpu")
    before = {k: v.clone() for k, v in model.policy.state_dict().items()}
    model.learn(total_timesteps=120)
    assert model.num_timesteps == 120 and len(model.ep_info_buffer) == 12
    assert any((before[k] != v).any() for k, v in model.policy.state_dict().items())
    model.save(tmp_path / "model.zip")
    observation = envs.reset()
    again = PPO.load(tmp_path / "model.zip", device="cpu")
    actions = [m.predict(observation, deterministic=True)[0] for m in (model, again)]
    assert np.array_equal(*actions)
    envs.close()


def test_checker_of_stable_baselines3_has_nothing_to_say_of_the_lesson(plan_file):
    need("stable_baselines3")
    from galoc_agents.lesson import Lesson
    from stable_baselines3.common.env_checker import check_env

    lesson = Lesson([0], plan=plan_file, **SMALL)
    check_env(lesson, warn=True)
    lesson.close()


def test_a_film_of_a_policy(plan_file, tmp_path):
    need("moviepy")
    from galoc_agents.spin import Spin
    from gymnasium.wrappers import RecordVideo

    from galoc_env.policy import Robot, told

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", module="moviepy")  # its own syntax and resource warnings
        env = gymnasium.make(ENV_ID, plan=plan_file, render_mode="rgb_array", max_episode_steps=3, **SMALL)
        env = RecordVideo(env, str(tmp_path / "films"))
        policy = Spin()
        observation, info = env.reset(seed=0)
        policy.reset(Robot.of(env, 0, 3))
        over = False
        while not over:
            observation, _, terminated, over, info = env.step(policy.act(observation, told(policy, info)))
        env.close()
    (film,) = (tmp_path / "films").glob("*.mp4")
    assert film.stat().st_size > 1000
