"""The batch against its specification: lane by lane the single environment, byte for byte."""

import copy
import gc
import math
import pickle
import tracemalloc

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from small_world import small_plan

from galoc import GalocError
from galoc_env.vector import FloorplanVectorEnv
from galoc_env.world import World

ENV_ID = "galoc_env:GALoc-Floorplan-v0"
SIZE = {"width": 32, "height": 24}
BLIND = {**SIZE, "renderer": "none", "detector": "oracle"}
BARE = {**BLIND, "localizer": "none"}
RECKONED = {**BLIND, "localizer": "small_world:DeadReckoner"}
LANES = 3


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory):
    return str(small_plan().save(tmp_path_factory.mktemp("plans") / "small.json"))


@pytest.fixture
def make():
    made = []

    def build(lanes=LANES, **arguments):
        made.append(FloorplanVectorEnv(lanes, **arguments))
        return made[-1]

    yield build
    for envs in made:
        envs.close()


@pytest.fixture
def twins(make):
    """The batch, and gymnasium's loop over single environments, from the same arguments."""
    loops = []

    def build(lanes=LANES, limit=5, mode=AutoresetMode.NEXT_STEP, **arguments):
        def single():
            return gymnasium.make(ENV_ID, max_episode_steps=limit, disable_env_checker=True, **arguments)

        loops.append(SyncVectorEnv([single] * lanes, autoreset_mode=mode))
        return make(lanes, max_episode_steps=limit, autoreset_mode=mode, **arguments), loops[-1]

    yield build
    for loop in loops:
        loop.close()


def assert_same(a, b, where=""):
    """Equal in structure, type and bytes."""
    assert type(a) is type(b), where
    if isinstance(a, dict):
        assert sorted(a) == sorted(b), where
        for key in a:
            assert_same(a[key], b[key], f"{where}/{key}")
    elif isinstance(a, tuple):
        assert len(a) == len(b), where
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            assert_same(x, y, f"{where}/{i}")
    elif isinstance(a, np.ndarray) and a.dtype == object:
        assert a.shape == b.shape, where
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            assert_same(x, y, f"{where}/{i}")
    elif isinstance(a, np.ndarray):
        assert (a.dtype, a.shape) == (b.dtype, b.shape) and a.tobytes() == b.tobytes(), f"{where}: {a} != {b}"
    else:
        assert a == b, where


def play(envs, actions, seed=3, options=None):
    """Everything that a batch says."""
    said = [envs.reset(seed=seed, options=copy.deepcopy(options))]
    for action in actions:
        said.append(envs.step(action))
        if envs.metadata["autoreset_mode"] == AutoresetMode.DISABLED:
            ended = said[-1][2] | said[-1][3]
            if ended.any():
                said.append(envs.reset(options={"reset_mask": ended}))
    return said


def assert_twins(pair, actions, **reset):
    for step, (a, b) in enumerate(zip(*(play(envs, actions, **reset) for envs in pair), strict=True)):
        assert_same(a, b, f"step {step}: ")


def walks(steps, lanes=LANES, kind="discrete"):
    rng = np.random.default_rng(1)
    if kind == "discrete":
        return rng.integers(0, 4, (steps, lanes))
    return rng.uniform(-1, 1, (steps, lanes, 3)).astype(np.float32)


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize(("kind", "tilt_deg"), [("discrete", 0.0), ("continuous", 8.0)])
def test_without_localizer_in_different_homes(twins, mode, kind, tilt_deg):
    pair = twins(mode=mode, actions=kind, tilt_deg=tilt_deg, **BARE)
    assert_twins(pair, walks(13, kind=kind), seed=[3, 3, 8])


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_with_galoc(twins, plan_file, mode):
    assert_twins(twins(plan=plan_file, mode=mode, limit=3, tilt_deg=3.0, **BLIND), walks(8))


def test_with_galoc_infogain_in_different_homes(twins):
    assert_twins(twins(lanes=2, limit=3, reward="infogain", actions="continuous", **BLIND), walks(5, 2, "continuous"))


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_success_ends_lanes_at_different_times(twins, plan_file, mode):
    pair = twins(plan=plan_file, mode=mode, reward="success", limit=14, odometry_noise=0.0, **RECKONED)
    # Only the first lane starts where the dead reckoner thinks it does; it stands and turns until it has succeeded.
    poses = {"pose": [(1.1, 1.0, 0.0), None, (4.5, 1.0, 2.0)]}
    said = [pair[0].reset(seed=3, options=poses)]
    said += [pair[0].step(np.array([2, 0, 3])) for _ in range(9)]
    assert said[-1][2].tolist() == [True, False, False] and said[-1][1].tolist() == [1.0, 0.0, 0.0]
    assert_twins(pair, walks(40), seed=5, options={"pose": (1.1, 1.0, 0.0)})


def test_silent_localizer_and_error_reward(twins, plan_file):
    arguments = {**BLIND, "localizer": "small_world:Silent", "reward": "error"}
    assert_twins(twins(plan=plan_file, **arguments), walks(7))


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_pictures(twins, plan_file, mode):
    pair = twins(plan=plan_file, mode=mode, limit=3, localizer="none", renderer="raster", tilt_deg=6.0, **SIZE)
    assert_twins(pair, walks(7))
    assert pair[0].reset(seed=1)[0]["image"].std(axis=(1, 2, 3)).min() > 1.0  # something is drawn in every lane


def test_pictures_of_a_poor_camera(twins, plan_file):
    assert_twins(twins(plan=plan_file, limit=3, localizer="none", renderer="raster", imaging="poor", **SIZE), walks(5))


def test_pictures_of_different_homes(twins):
    pair = twins(limit=3, localizer="none", renderer="raster", quality="fast", **SIZE)
    assert_twins(pair, walks(3), seed=[3, 8, 3])
    assert_twins(pair, walks(2), seed=[11, 12, 13])
    assert_twins(pair, walks(2), seed=[8, 14, 15])  # a seventh home: one more than are kept


def test_noise_goes_on_beyond_its_block(twins, plan_file):
    from galoc_env._motion_kernel import BLOCK

    assert_twins(twins(plan=plan_file, limit=2 * BLOCK + 3, **BARE), walks(2 * BLOCK + 9))


def test_a_mask_resets_only_some_lanes(make, plan_file):
    envs = make(plan=plan_file, autoreset_mode="Disabled", **BARE)
    envs.reset(seed=0)
    before, _, _, _, said = envs.step(np.array([0, 0, 0]))
    after, infos = envs.reset(options={"reset_mask": np.array([False, True, False])})
    assert infos["_pose"].tolist() == [False, True, False]
    for lane in (0, 2):
        assert all(before[key][lane].tobytes() == after[key][lane].tobytes() for key in before)
    assert not after["odometry"][1].any()
    assert said["pose"][1].tobytes() != infos["pose"][1].tobytes()


def test_options_lane_by_lane(make):
    envs = make(**BARE)
    envs.reset(seed=0, options={"plan_seed": [4, 5, None]})
    assert [episode.world.number for episode in envs._lanes] == [4, 5, 2]
    envs.reset(options={"plan_seed": np.array([5, 5, 6])})
    assert [episode.world.number for episode in envs._lanes] == [5, 5, 6]
    assert envs._lanes[0].world is envs._lanes[1].world  # shared
    start = envs._lanes[2].world.random_pose(np.random.default_rng(0))
    _, infos = envs.reset(options={"pose": [None, None, start]})
    assert infos["pose"][2] == pytest.approx(start)


def test_shared_homes_have_their_own_beliefs(make, plan_file):
    envs = make(plan=plan_file, **BLIND)
    envs.reset(seed=0)
    first, second = (envs._lanes[lane] for lane in (0, 1))
    assert first.world is second.world and first.observer is not second.observer
    assert first.observer.belief is not second.observer.belief
    assert first.observer.localizer.field is second.observer.localizer.field  # the large part is one


def test_worlds_are_bounded_and_found_again(make):
    envs = make(lanes=2, **BARE)
    envs.reset(seed=[0, 1])
    first = envs._lanes[0].world
    envs.reset(seed=[2, 3])
    assert first in envs._worlds
    envs.reset(seed=[0, 0])
    assert envs._lanes[0].world is first
    for seed in range(4, 12, 2):
        envs.reset(seed=seed)
        assert len(envs._worlds) <= 4  # two per lane
        assert all(episode.world in envs._worlds for episode in envs._lanes)
    assert first not in envs._worlds


def test_copies_are_the_callers(make, plan_file):
    ours, theirs = make(plan=plan_file, **BARE), make(plan=plan_file, copy=False, **BARE)
    (a, _), (b, _) = ours.reset(seed=0), theirs.reset(seed=0)
    c, d = ours.step(np.array([0, 1, 2]))[0], theirs.step(np.array([0, 1, 2]))[0]
    assert all(b[key] is d[key] for key in b)
    assert not any(np.shares_memory(a[key], c[key]) for key in a)
    assert_same(c, {key: value.copy() for key, value in d.items()})


def test_seeds_are_those_of_gymnasium(twins, plan_file):
    ours, theirs = twins(plan=plan_file, **BARE)
    for seed in (7, [1, None, 2], None):
        ours.reset(seed=seed), theirs.reset(seed=seed)
        known = [0, 2] if seed is not None else []
        assert [ours.np_random_seed[i] for i in known] == [theirs.np_random_seed[i] for i in known]
    assert len({rng.bit_generator.state["state"]["state"] for rng in ours.np_random}) == LANES


def test_make_vec_makes_it_and_it_wraps(plan_file):
    envs = gymnasium.make_vec(ENV_ID, num_envs=LANES, plan=plan_file, max_episode_steps=4, **RECKONED, reward="error")
    assert isinstance(envs.unwrapped, FloorplanVectorEnv)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    spec = pickle.loads(pickle.dumps(envs.spec))
    assert spec.kwargs["num_envs"] == LANES
    again = gymnasium.make_vec(spec)
    again.close()
    wrapped = RecordEpisodeStatistics(envs)
    observation, _ = wrapped.reset(seed=0)
    assert wrapped.observation_space.contains(observation)
    wrapped.action_space.seed(0)
    total = np.zeros(LANES)
    for _ in range(4):
        _, rewards, _, truncations, infos = wrapped.step(wrapped.action_space.sample())
        total += rewards
    assert truncations.all()
    # The wrapper adds up in float32: seven digits of a sum of four.
    assert infos["episode"]["r"] == pytest.approx(total, rel=1e-6)
    assert infos["episode"]["l"].tolist() == [4] * LANES
    wrapped.close()


def test_make_vec_hands_on_how_to_reset(plan_file):
    envs = gymnasium.make_vec(ENV_ID, num_envs=2, autoreset_mode="SameStep", copy=False, plan=plan_file, **BARE)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    envs.close()


@pytest.mark.parametrize(("localizer", "renderer"), [("none", "raster"), ("galoc", "none")])
def test_a_pickled_batch_goes_on_alike(make, plan_file, localizer, renderer):
    envs = make(plan=plan_file, tilt_deg=5.0, **SIZE, localizer=localizer, renderer=renderer, detector="oracle")
    fresh = pickle.loads(pickle.dumps(envs))
    assert_same(envs.reset(seed=2), fresh.reset(seed=2))
    envs.step(np.array([0, 2, 3]))
    twin = pickle.loads(pickle.dumps(envs))
    for action in walks(3):
        assert_same(envs.step(action), twin.step(action))
    fresh.close(), twin.close()


def test_close_twice_and_open_again(make, plan_file):
    envs = make(plan=plan_file, **BARE)
    first = envs.reset(seed=4)
    envs.close()
    envs.close()
    with pytest.raises(gymnasium.error.ResetNeeded):
        envs.step(np.zeros(LANES, int))
    assert_same(first, envs.reset(seed=4))


def test_memory_stays_flat_over_resets(make, plan_file):
    envs = make(lanes=2, plan=plan_file, max_episode_steps=2, **BARE)

    def kept_kib():
        for seed in range(100):
            envs.reset(seed=seed)
            for _ in range(3):
                envs.step(np.array([0, 2]))
        gc.collect()
        return tracemalloc.get_traced_memory()[0] / 1024

    tracemalloc.start()
    before, after = kept_kib(), kept_kib()
    tracemalloc.stop()
    # One observation of both lanes is 5 KiB, so that one kept per reset would be 500 KiB.
    assert after - before < 100, f"{before:.0f} -> {after:.0f} KiB"


def test_dropped_worlds_are_gone(make):
    def alive():
        gc.collect()
        return sum(type(thing) is World for thing in gc.get_objects())  # isinstance asks lazy objects for their class

    others = alive()
    envs = make(lanes=1, **BARE)
    for seed in range(5):
        envs.reset(seed=seed)
    assert alive() - others == 2  # twice as many as lanes
    envs.close()
    assert alive() == others


def test_render_and_snapshot_are_the_single_ones(twins, plan_file):
    ours, theirs = twins(lanes=2, plan=plan_file, render_mode="rgb_array", limit=3, **BLIND)
    ours.reset(seed=0), theirs.reset(seed=0)
    for action in walks(3, 2):
        ours.step(action), theirs.step(action)
        assert_same(ours.render(), theirs.render())
    single = theirs.envs[0].unwrapped.snapshot()
    assert ours.snapshot(0).wireframe.floor.tobytes() == single.wireframe.floor.tobytes()
    assert ours.snapshot(0).trail.tobytes() == single.trail.tobytes()


def test_nothing_is_painted_without_a_render_mode(make, plan_file):
    envs = make(plan=plan_file, **BARE)
    envs.reset(seed=0)
    assert envs.render() == (None,) * LANES


def test_who_looks_changes_nothing(make, plan_file):
    looked, blind = make(plan=plan_file, **BARE), make(plan=plan_file, **BARE)
    looked.reset(seed=0), blind.reset(seed=0)
    for action in walks(3):
        assert_same(looked.step(action), blind.step(action))
        looked.snapshot(0)
    assert looked.snapshot(1).wireframe.floor.tobytes() == blind.snapshot(1).wireframe.floor.tobytes()


@pytest.mark.parametrize(
    "arguments",
    [
        {"lanes": 0},
        {"lanes": 2.5},
        {"max_episode_steps": 0},
        {"max_episode_steps": True},
        {"autoreset_mode": "same_step"},
        {"reward": "money"},
        {"renderer": "crayon"},
        {"plan": "no_such_plan"},
    ],
)
def test_bad_arguments(make, arguments):
    with pytest.raises(GalocError) as caught:
        make(**{**BARE, **arguments})
    assert caught.value.cure


@pytest.mark.parametrize(
    "reset",
    [
        {"seed": [1, 2]},
        {"seed": 1.5},
        {"seed": [1, 2.5, 3]},
        {"seed": "abc"},
        {"options": {"pose": [(1, 1, 0), (1, 1, 0)]}},
        {"options": {"pose": (3.5, 0.7, 0)}},
        {"options": {"start": 1}},
        {"options": [1]},
        {"options": {"plan_seed": 3}},
        {"options": {"reset_mask": [True, False, False]}},
        {"options": {"reset_mask": np.zeros(LANES, bool)}},
        {"options": {"reset_mask": np.ones(LANES + 1, bool)}},
    ],
)
def test_bad_resets(make, plan_file, reset):
    envs = make(plan=plan_file, **BARE)
    envs.reset(seed=0)
    with pytest.raises(GalocError) as caught:
        envs.reset(**reset)
    assert caught.value.cure


@pytest.mark.parametrize(
    "actions", [[0, 1], [0, 1, 4], [0, -1, 0], [0.0, 1.0, 2.0], "abc", [[0, 1, 2]], [[0, 1], [1]], None]
)
def test_bad_actions(make, plan_file, actions):
    envs = make(plan=plan_file, **BARE)
    envs.reset(seed=0)
    with pytest.raises(GalocError, match="action"):
        envs.step(actions)


def test_bad_continuous_actions(make, plan_file):
    envs = make(plan=plan_file, actions="continuous", **BARE)
    envs.reset(seed=0)
    bad = np.zeros((LANES, 3))
    bad[1, 2] = math.nan
    with pytest.raises(GalocError, match="action"):
        envs.step(bad)
    with pytest.raises(GalocError, match="action"):
        envs.step(np.full((LANES, 3), -128, np.int8))  # its own absolute value


def test_numpys_whole_numbers_will_do(make, plan_file):
    envs = make(np.int64(2), plan=plan_file, max_episode_steps=np.int32(1), **BARE)
    assert type(envs.num_envs) is int
    envs.reset(seed=np.int64(3))
    assert envs.step(np.zeros(2, np.uint8))[3].all()


def test_a_reset_that_fails_leaves_no_body_in_the_wrong_home(make):
    envs = make(lanes=2, **BARE)
    envs.reset(options={"plan_seed": [0, 1]}, seed=0)
    with pytest.raises(GalocError, match="start pose"):
        envs.reset(options={"plan_seed": [2, 1], "pose": [None, (1e4, 0.0, 0.0)]})
    with pytest.raises(gymnasium.error.ResetNeeded):
        envs.step(np.zeros(2, int))
    again, fresh = (e.reset(options={"plan_seed": [2, 1]}, seed=5) for e in (envs, make(lanes=2, **BARE)))
    assert_same(again, fresh)


def test_step_needs_a_reset(make, plan_file):
    envs = make(plan=plan_file, autoreset_mode="Disabled", max_episode_steps=1, **BARE)
    with pytest.raises(gymnasium.error.ResetNeeded):
        envs.step(np.zeros(LANES, int))
    with pytest.raises(gymnasium.error.ResetNeeded):
        envs.reset(options={"reset_mask": np.array([True, False, False])})
    envs.reset(seed=0)
    envs.step(np.zeros(LANES, int))
    with pytest.raises(gymnasium.error.ResetNeeded):  # all have ended
        envs.step(np.zeros(LANES, int))
