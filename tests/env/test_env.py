import copy
import dataclasses
import inspect
import math
import pickle
import re

import gymnasium
import numpy as np
import pytest
from gymnasium.utils import seeding
from gymnasium.utils.env_checker import check_env
from small_world import WALLS, small_plan

from galoc import GalocError
from galoc_env import motion, sensors
from galoc_env._motion_kernel import BLOCK
from galoc_env.env import FloorplanEnv
from galoc_env.settings import Settings

FAST = {"localizer": "small_world:DeadReckoner", "reward": "error", "renderer": "none", "detector": "oracle"}
BARE_NOISY = {"localizer": "none", "renderer": "none", "imu_noise_deg": 10.0, "odometry_noise": 1.0, "tilt_deg": 30.0}
SIZE = {"width": 64, "height": 48}


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory):
    return str(small_plan().save(tmp_path_factory.mktemp("plans with space") / "small.json"))


@pytest.fixture
def make(plan_file):
    """Environments that see the exact structure, unless told otherwise: most tests are not about the detector."""
    made = []

    def build(**arguments):
        made.append(FloorplanEnv(**{"plan": plan_file, "detector": "oracle", **SIZE, **arguments}))
        return made[-1]

    yield build
    for env in made:
        env.close()


def flat(observation):
    return b"".join(observation[key].tobytes() for key in sorted(observation))


def play(env, seed, actions):
    observation, info = env.reset(seed=seed)
    trace = [flat(observation), info["pose"].tobytes()]
    for action in actions:
        observation, reward, *_, info = env.step(action)
        trace += [flat(observation), reward, info["pose"].tobytes()]
    return trace


@pytest.mark.parametrize(
    "arguments",
    [
        {"render_mode": "rgb_array"},
        {"actions": "continuous", "tilt_deg": 10.0, "reward": "infogain"},
        {"localizer": "none"},
        {"localizer": "small_world:Silent", "reward": "success", "renderer": "none", "detector": "oracle"},
    ],
)
def test_gymnasium_checker_has_nothing_to_say(plan_file, arguments):
    env = gymnasium.make("galoc_env:GALoc-Floorplan-v0", plan=plan_file, **SIZE, **arguments)
    check_env(env.unwrapped, skip_render_check=arguments.get("render_mode") is None)
    env.close()


def test_same_seed_same_bytes_other_seed_other_bytes(make):
    arguments = {"tilt_deg": 5.0}
    actions = [2, 0, 0, 3, 1]
    first, second = (play(make(**arguments), 7, actions) for _ in range(2))
    assert first == second
    assert play(make(**arguments), 8, actions) != first


def test_second_episode_repeats_the_first(make):
    env = make()
    assert play(env, 3, [0, 2, 0]) == play(env, 3, [0, 2, 0])


def test_observations_lie_in_their_space_and_say_what_they_should(make):
    env = make(odometry_noise=0.0, imu_noise_deg=0.0, detector_noise_px=0.0)
    observation, info = env.reset(seed=1, options={"pose": (1.0, 1.0, 0.0)})
    assert env.observation_space.contains(observation)
    assert not observation["odometry"].any()
    assert observation["image"].std() > 1.0  # something is drawn
    observation, _, _, _, info = env.step(0)
    assert observation["odometry"] == pytest.approx([0.3, 0.0, 0.0])
    assert info["pose"] == pytest.approx([1.3, 1.0, 0.0])
    assert observation["belief"][0].max() == pytest.approx(1.0)
    assert observation["estimate"][:3] == pytest.approx(info["estimate"], abs=1e-5)
    assert observation["estimate"].dtype == np.float32
    assert set(info["metrics"]) >= {"recall_0.5m", "steps_to_converge", "success"}


def test_belief_canvas_shows_the_belief_where_it_is(make):
    env = make(detector_noise_px=0.0)
    env.reset(seed=2)
    for action in (2, 2, 2, 2, 2, 0, 2, 2):
        observation, *_ = env.step(action)
    belief = env.world.observer.belief
    best = belief.positions[int(np.argmax(belief.position_marginal()))]
    canvas = env.world.observer.canvas
    peak = canvas.centres()[int(np.argmax(observation["belief"][0]))]
    # Cells of 0.1 m are averaged into canvas cells of 6 / 64 m: the peak is off by one of each at most.
    assert peak == pytest.approx(best, abs=0.1 + canvas.cell_m)
    free = observation["belief"][1]
    centres = canvas.centres().reshape(64, 64, 2)
    inside = (centres[..., 0] > 0.2) & (centres[..., 0] < 5.8) & (centres[..., 1] > 0.2) & (centres[..., 1] < 3.0)
    near_wall = np.abs(centres[..., 0] - 3.5) < 0.2
    assert free[inside & ~near_wall].min() > 0.9
    outside = (centres[..., 1] < -0.2) | (centres[..., 1] > 4.2)
    assert free[outside].max() == 0.0
    assert canvas.centres()[0, 1] > canvas.centres()[-1, 1]  # row 0 is the top


def test_without_drawing_everything_but_the_image_is_unchanged(make):
    drawn, blank = make(tilt_deg=4.0), make(tilt_deg=4.0, renderer="none")
    a, _ = drawn.reset(seed=5)
    b, _ = blank.reset(seed=5)
    for action in (0, 2, 0):
        a, ra, *_ = drawn.step(action)
        b, rb, *_ = blank.step(action)
        assert not b["image"].any() and a["image"].any()
        assert ra == rb
        assert all(np.array_equal(a[key], b[key]) for key in a if key != "image")


def test_each_noise_has_its_own_stream(make):
    def readings(**noise):
        env = make(**FAST, **noise)
        env.reset(seed=4)
        rows = [env.step(action)[0] for action in (0, 2, 0)]
        return [np.array([row[key] for row in rows]) for key in ("gravity", "odometry")], env.episode.wireframe.floor

    (gravity, odometry), floor = readings()
    (gravity_0, odometry_0), floor_0 = readings(imu_noise_deg=0.0)
    assert not gravity_0.any() and gravity.any()
    assert np.array_equal(odometry, odometry_0) and np.array_equal(floor, floor_0)
    (gravity_1, odometry_1), floor_1 = readings(odometry_noise=0.0)
    assert np.array_equal(gravity, gravity_1) and np.array_equal(floor, floor_1)
    assert odometry_1[0] == pytest.approx([0.3, 0.0, 0.0]) and not np.array_equal(odometry, odometry_1)


def test_detector_noise_scales_with_the_image(make):
    def spread(width):
        env = make(**FAST, width=width, height=width * 3 // 4, detector_noise_px=5.0)
        exact = make(**FAST, width=width, height=width * 3 // 4, detector_noise_px=0.0)
        offsets = []
        for seed in range(25):
            for e in (env, exact):
                e.reset(seed=seed)
            noisy, true = env.episode.wireframe, exact.episode.wireframe
            offsets.append((noisy.floor - true.floor)[true.floor_true & (true.kind != 2)].ravel())
        return float(np.concatenate(offsets).std())

    # About 100 offsets each: their sd is good to 7 %; 25 % is more than three times that.
    assert spread(640) == pytest.approx(5.0, rel=0.25)
    assert spread(320) == pytest.approx(2.5, rel=0.25)


def test_walls_stop_the_body_and_odometry_tells(make):
    env = make(**FAST, odometry_noise=0.0)
    env.reset(seed=0, options={"pose": (3.0, 0.7, 0.0)})
    observation, _, _, _, info = env.step(0)
    assert info["collided"]
    assert info["pose"][0] == pytest.approx(3.25, abs=1e-5)
    assert observation["odometry"][0] == pytest.approx(0.25, abs=1e-5)


def test_starts_keep_clear_of_walls_and_furniture(make):
    env = make(**FAST, furniture=1.0)
    for seed in range(30):
        _, info = env.reset(seed=seed)
        assert motion.distances(info["pose"][:2], env.world.obstacles).min() >= motion.BODY_RADIUS


def test_log_belief_reward_telescopes(make):
    env = make(renderer="none")
    env.reset(seed=6)
    first = env.episode.scores[0].log_mass
    total = sum(env.step(action)[1] for action in (2, 2, 0, 2))
    assert total == pytest.approx(env.episode.scores[-1].log_mass - first)


def test_success_pays_once_and_terminates(make):
    env = make(**{**FAST, "reward": "success"}, odometry_noise=0.0)
    env.reset(seed=0, options={"pose": (1.1, 1.0, 0.0)})  # the dead reckoner starts 0.1 m beside it
    outcomes = [env.step(2)[1:3] for _ in range(11)]
    # With the observation of the reset the tenth within 0.5 m is that of the ninth step.
    assert outcomes == [(0.0, False)] * 8 + [(1.0, True)] + [(0.0, False)] * 2


def test_nothing_to_report_is_finite_in_the_observation(make):
    env = make(**{**FAST, "localizer": "small_world:Silent"})
    observation, info = env.reset(seed=0)
    assert not observation["estimate"].any() and not observation["belief"][0].any()
    assert not info["estimate"].any() and info["error_m"] == math.inf and info["abstained"]
    assert "entropy" not in info  # there is no belief to have one
    assert env.step(2)[1] == -10.0


def test_without_localizer_nothing_is_scored(make):
    env = make(localizer="none", renderer="none")
    observation, info = env.reset(seed=0)
    assert set(observation) == {"image", "gravity", "odometry"} and set(info) == {"pose", "collided"}
    assert env.step(0)[1] == 0.0


def test_the_world_is_kept_while_the_plan_stays(make):
    env = make(**FAST)
    env.reset(seed=0)
    world = env.world
    env.reset(seed=1)
    env.reset()
    assert env.world is world


@pytest.mark.parametrize(
    "arguments",
    [
        {"detector": "magic"},
        {"detector": None},
        {"geometry": "magic"},
        {"scoring": "magic"},
        {"renderer": "crayon"},
        {"quality": "superb"},
        {"shut_doors": 1.5},
        {"imaging": 3},
        {"imaging": "no_such_camera"},
        {"imaging": "no_such_camera", "renderer": "none"},
        {"actions": "fly"},
        {"reward": "money"},
        {"split": "validation"},
        {"render_mode": "human"},
        {"width": 1, "height": 1},
        {"width": 320.5},
        {"hfov_deg": 180},
        {"hfov_deg": math.nan},
        {"odometry_noise": -0.1},
        {"imu_noise_deg": math.inf},
        {"furniture": 2},
        {"tilt_deg": "5"},
        {"detector_noise_px": None},
        {"localizer": None},
        {"plan": 3},
        {"plan": "no_such_plan"},
    ],
)
def test_bad_arguments_are_refused_at_once(make, arguments):
    with pytest.raises(GalocError) as caught:
        make(**arguments)
    assert caught.value.cure


def test_refusals_list_what_there_is(make):
    with pytest.raises(GalocError, match=r'detector = .magic.*"onnx" or "oracle" or "lines"'):
        make(detector="magic")


@pytest.mark.parametrize(
    "arguments",
    [
        {"localizer": "nonsense"},
        {"localizer": "no_such_module:Thing"},
        {"localizer": "small_world:NoSuchClass"},
        {"localizer": "small_world:NoStep"},
        {"localizer": "small_world:DeadReckoner", "reward": "log_belief"},
        {"camera_height": 2.6},
    ],
)
def test_what_only_the_plan_can_tell_is_refused_at_reset(make, arguments):
    with pytest.raises(GalocError):
        make(renderer="none", **arguments).reset(seed=0)


@pytest.mark.parametrize("options", [{"start": (1, 1, 0)}, {"pose": (3.5, 0.7, 0)}, {"plan_seed": 3}])
def test_bad_reset_options(make, options):
    with pytest.raises(GalocError):
        make(**FAST).reset(seed=0, options=options)


@pytest.mark.parametrize("action", [4, -1, math.nan])
def test_bad_actions(make, action):
    env = make(**FAST)
    env.reset(seed=0)
    with pytest.raises(GalocError):
        env.step(action)


def test_step_before_reset(make):
    with pytest.raises(gymnasium.error.ResetNeeded):
        make(**FAST).step(0)


def test_render_is_a_picture_of_the_step(make):
    env = make(render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    env.step(2)
    second = env.render()
    assert first.shape == (720, 1280, 3) and first.dtype == np.uint8
    assert not np.array_equal(first, second)


def test_homes_follow_the_seed():
    homes = pytest.importorskip("galoc_env.homes")
    env = FloorplanEnv(**FAST, **SIZE)
    env.reset(seed=11)
    assert env.world.plan.content_hash == homes.generate(11).content_hash
    world = env.world
    env.reset()
    assert env.world is world  # no seed: the same home, another start
    env.reset(seed=11, options={"plan_seed": 12})
    assert env.world.plan.content_hash == homes.generate(12).content_hash
    with pytest.raises(GalocError):
        env.reset(options={"plan_seed": -1})
    env.close()


def test_obstacles_are_walls_and_furniture(make):
    env = make(**FAST)
    env.reset(seed=0)
    assert np.array_equal(env.world.obstacles[: len(WALLS)], small_plan().segments)


def test_defaults_are_said_once_and_the_same():
    given = inspect.signature(FloorplanEnv.__init__).parameters
    here = {name: parameter.default for name, parameter in given.items() if name != "self"}
    assert here == {field.name: field.default for field in dataclasses.fields(Settings)}
    table = FloorplanEnv.__doc__.partition("## Arguments")[2].splitlines()  # the specification
    for name, value in here.items():
        row = next(line for line in table if re.match(rf"\s*\|[^|]*`{name}`", line))
        assert str(value) in row


def test_looking_does_not_change_what_follows(make):
    looked, blind = (make(renderer="none", localizer="none", tilt_deg=4.0) for _ in range(2))
    looked.reset(seed=3), blind.reset(seed=3)
    for action in (0, 2, 0, 3):
        looked.snapshot()
        a, b = looked.step(action)[0], blind.step(action)[0]
        assert flat(a) == flat(b)
    last = looked.snapshot().wireframe
    assert last.floor.tobytes() == blind.snapshot().wireframe.floor.tobytes()
    assert last is looked.snapshot().wireframe  # two looks at one step see the same
    blind.step(2)
    assert not np.array_equal(last.floor, blind.snapshot().wireframe.floor)


def test_shut_doors_are_walls_to_camera_and_body_but_not_in_the_map():
    arguments = {
        **SIZE,
        "renderer": "none",
        "detector": "oracle",
        "furniture": 0.0,
        "localizer": "small_world:DeadReckoner",
        "reward": "error",
    }
    doors, shut = FloorplanEnv(**arguments), FloorplanEnv(**arguments, shut_doors=1.0)
    for env in (doors, shut):
        env.reset(seed=2)
    assert np.array_equal(shut.world.plan.segments, doors.world.plan.segments)
    assert len(shut.world.seen_plan.segments) > len(shut.world.plan.segments)
    assert doors.world.seen_plan.segments.tobytes() == doors.world.plan.segments.tobytes()
    for door in shut.world.seen_plan.segments[len(shut.world.plan.segments) :]:
        middle = (door[:2] + door[2:]) / 2.0
        assert motion.distances(middle, shut.world.obstacles).min() < motion.BODY_RADIUS
    assert shut.world.walkable.mask.sum() < 0.8 * doors.world.walkable.mask.sum()  # one room, not the home
    doors.close(), shut.close()


def test_readings_follow_their_streams_beyond_a_block(make):
    env = make(localizer="none", renderer="none")
    rows = [env.reset(seed=3)[0]] + [env.step(2)[0] for _ in range(2 * BLOCK + 5)]
    imu, odometry = seeding.np_random(3)[0].spawn(6)[2:4]
    turn = np.zeros(3)
    for row in rows:
        gravity = sensors.measure_gravity((0.0, 0.0), math.radians(0.5), imu)
        assert row["gravity"].tobytes() == gravity.astype(np.float32).tobytes()
        assert row["odometry"].tobytes() == sensors.measure_odometry(turn, 0.02, odometry).astype(np.float32).tobytes()
        turn = np.array([0.0, 0.0, motion.TURN_RAD])


def test_imaging_changes_the_image_alone(make):
    plain, poor = make(localizer="none"), make(localizer="none", imaging="poor")
    again = make(localizer="none", imaging="poor")
    for env in (plain, poor, again):
        env.reset(seed=3)
    for action in (0, 2):
        a, b, c = (env.step(action)[0] for env in (plain, poor, again))
        assert not np.array_equal(a["image"], b["image"])
        assert flat(b) == flat(c)
        assert flat({**a, "image": b["image"]}) == flat(b)


def test_an_observation_is_the_callers(make):
    env = make(localizer="none")
    kept, info = env.reset(seed=3)
    copies = copy.deepcopy(kept), info["pose"].copy()
    env.step(0)
    assert flat(kept) == flat(copies[0]) and np.array_equal(info["pose"], copies[1])


@pytest.mark.parametrize(("localizer", "renderer"), [("none", "raster"), ("galoc", "none")])
def test_a_copied_environment_goes_on_alike(make, localizer, renderer):
    env = make(renderer=renderer, localizer=localizer, tilt_deg=4.0)
    env.reset(seed=3)
    env.step(0)
    twin = pickle.loads(pickle.dumps(env))
    for action in (2, 0, 1):
        assert flat(env.step(action)[0]) == flat(twin.step(action)[0])
    env.step(0)
    assert twin.snapshot().step == 4 and env.snapshot().step == 5


def test_reading_stays_within_the_space(make):
    env = make(**BARE_NOISY)
    env.reset(seed=0)
    rows = [env.step(action)[0] for action in [0, 1] * 300]
    for key in ("gravity", "odometry"):
        readings = np.array([row[key] for row in rows])
        space = env.observation_space[key]
        assert np.all((readings >= space.low) & (readings <= space.high))
        if key == "odometry":  # noise of 0.3 m on 0.3 m: about one reading in a hundred would lie beyond 1 m
            assert (np.abs(readings) == space.high).any()


def test_errors_cross_process_borders(make):
    with pytest.raises(GalocError) as caught:
        make(reward="money")
    assert pickle.loads(pickle.dumps(caught.value)).cure == caught.value.cure
    again = type(caught.value)(caught.value)  # what AsyncVectorEnv raises in the parent process
    assert (str(again), again.cure) == (str(caught.value), caught.value.cure)


def test_the_localizer_is_told_how_good_the_sensors_are() -> None:
    env = FloorplanEnv(plan="apartment", renderer="none", detector="oracle", imu_noise_deg=2.0, odometry_noise=0.05)
    env.reset(seed=0)
    assert env.world is not None and env.world.observer is not None
    config = env.world.observer.localizer.config  # type: ignore[attr-defined]
    assert config.imu_sigma_deg == 2.0 and config.odometry_noise == 0.05
    assert math.isclose(config.odometry_turn_deg, 0.05 * 30.0, rel_tol=0.01)  # of the turn of 30 degrees
    env.close()
