"""The environment under Gymnasium's own tools and those of stable-baselines3; both are used as a reader would."""

import hashlib
import os
import subprocess
import sys
import warnings

import cv2
import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import RecordEpisodeStatistics, RescaleAction
from small_world import small_plan

ENV_ID = "galoc_env:GALoc-Floorplan-v0"
SIZE = {"width": 48, "height": 40}
STEPS = 4

TWIN = """
import hashlib, sys
import gymnasium
env = gymnasium.make("galoc_env:GALoc-Floorplan-v0", plan=sys.argv[1], width=48, height=40, tilt_deg=5.0)
digest = hashlib.sha256()
def add(observation, *rest):
    for key in sorted(observation):
        digest.update(observation[key].tobytes())
    digest.update(repr(rest).encode())
add(*env.reset(seed=9))
env.action_space.seed(9)
for _ in range(6):
    add(*env.step(env.action_space.sample()))
env.close()
print(digest.hexdigest())
"""


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory):
    return str(small_plan().save(tmp_path_factory.mktemp("plans") / "small.json"))


@pytest.fixture
def make(plan_file):
    made = []

    def build(**arguments):
        made.append(gymnasium.make(ENV_ID, plan=plan_file, **{**SIZE, **arguments}))
        return made[-1]

    yield build
    for env in made:
        env.close()


def test_frames_are_what_video_writers_take(make):
    env = make(render_mode="rgb_array")
    env.reset(seed=0)
    frames = [env.render()]
    for _ in range(STEPS):
        env.step(2)
        frames.append(env.render())
    for frame in frames:
        assert isinstance(frame, np.ndarray) and frame.dtype == np.uint8 and frame.flags.c_contiguous
        assert frame.ndim == 3 and frame.shape[2] == 3
        assert frame.shape[0] % 2 == 0 and frame.shape[1] % 2 == 0  # H.264 with 4:2:0 colour has no odd sides
    # Recorders keep frames until the episode ends: a buffer that is painted over would give a still film.
    assert len({hashlib.sha256(frame.tobytes()).hexdigest() for frame in frames}) == len(frames)
    rate = env.metadata["render_fps"]
    assert isinstance(rate, int) and rate > 0


def test_record_video_writes_the_episode(make, tmp_path):
    pytest.importorskip("moviepy", reason="gymnasium's RecordVideo needs moviepy, which is not installed")
    from gymnasium.wrappers import RecordVideo

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", module="moviepy")  # its own syntax and resource warnings
        env = RecordVideo(make(render_mode="rgb_array"), str(tmp_path / "films"))
        env.reset(seed=0)
        for _ in range(STEPS):
            env.step(2)
        env.close()
    (file,) = (tmp_path / "films").glob("*.mp4")
    film = cv2.VideoCapture(str(file))
    assert film.get(cv2.CAP_PROP_FPS) == pytest.approx(env.metadata["render_fps"])
    frames = 0
    while film.read()[0]:
        frames += 1
    assert frames == STEPS + 1


def test_usual_wrappers(make):
    env = RecordEpisodeStatistics(
        RescaleAction(make(actions="continuous", max_episode_steps=STEPS), *np.float32([0.0, 1.0]))
    )
    env.reset(seed=0)
    total = 0.0
    for _ in range(STEPS):
        *_, info = step = env.step(np.full(3, 0.5, np.float32))  # the middle of the new range: stand still
        total += step[1]
    assert info["pose"] == pytest.approx(env.unwrapped.episode.trail[0])
    assert info["episode"]["l"] == STEPS
    assert info["episode"]["r"] == pytest.approx(total)
    env.close()


def test_twins_in_two_processes_see_the_same_bytes(plan_file):
    def twin(hash_seed):
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", TWIN, plan_file],
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONHASHSEED": hash_seed},
        )
        assert done.returncode == 0, done.stderr[-2000:]
        return done.stdout

    # The order of sets of strings differs between the two; nothing may depend on it.
    assert twin("1") == twin("2")


@pytest.mark.parametrize(
    "arguments",
    [{}, {"actions": "continuous", "reward": "infogain"}, {"localizer": "none"}, {"width": 160, "height": 120}],
)
def test_stable_baselines3_checker_has_nothing_to_say(make, arguments):
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="stable-baselines3 is not installed")
    with warnings.catch_warnings():  # all others are errors
        # Its guess is that any three-dimensional box is a picture. It feeds `belief` to a policy as a flat vector.
        warnings.filterwarnings("ignore", message="It seems that your observation (space )?belief is an image")
        checker.check_env(make(**arguments).unwrapped, warn=True)
