import pickle
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv
from small_world import small_plan

import galoc_env
from galoc_env.registration import ENV_ID, MAX_EPISODE_STEPS

ARGUMENTS = {
    "localizer": "small_world:DeadReckoner",
    "reward": "error",
    "renderer": "none",
    "detector": "oracle",
    "width": 32,
    "height": 24,
}


@pytest.fixture(scope="module")
def arguments(tmp_path_factory):
    return {**ARGUMENTS, "plan": str(small_plan().save(tmp_path_factory.mktemp("plans") / "small.json"))}


def test_make_without_import_in_a_fresh_process():
    code = "import gymnasium; gymnasium.make('galoc_env:GALoc-Floorplan-v0', localizer='none', renderer='none')"
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)


def test_registering_twice_is_once():
    before = gymnasium.registry[ENV_ID]
    galoc_env.register()
    assert gymnasium.registry[ENV_ID] is before
    assert isinstance(before.entry_point, str)


def test_spec_pickles_prints_and_goes_through_json(arguments):
    env = gymnasium.make(ENV_ID, **arguments)
    spec = pickle.loads(pickle.dumps(env.spec))
    assert spec.kwargs["localizer"] == arguments["localizer"]
    again = gymnasium.envs.registration.EnvSpec.from_json(env.spec.to_json())
    assert again.kwargs == env.spec.kwargs
    assert ENV_ID in spec.pprint(disable_print=True)
    env.close()
    made = gymnasium.make(again)
    made.reset(seed=0)
    made.close()


def test_time_limit(arguments):
    env = gymnasium.make(ENV_ID, **arguments)
    env.reset(seed=0)
    ends = [env.step(2)[2:4] for _ in range(MAX_EPISODE_STEPS)]
    assert ends == [(False, False)] * (MAX_EPISODE_STEPS - 1) + [(False, True)]
    env.close()


def vector(kind, arguments, **kwargs):
    return kind([lambda: gymnasium.make("galoc_env:GALoc-Floorplan-v0", **arguments)] * 2, **kwargs)


def test_async_vector_env_with_spawn_equals_sync(arguments):
    ways = vector(SyncVectorEnv, arguments), vector(AsyncVectorEnv, arguments, context="spawn")
    seen = []
    for envs in ways:
        observation, info = envs.reset(seed=[1, 2])
        steps = [envs.step(np.array([2, 0])) for _ in range(3)]
        seen.append((observation, info["pose"], steps[-1][0], steps[-1][1], steps[-1][4]["error_m"]))
        envs.close()
    for a, b in zip(*seen, strict=True):
        if isinstance(a, dict):
            assert all(np.array_equal(a[key], b[key]) for key in a)
        else:
            assert np.array_equal(a, b)
