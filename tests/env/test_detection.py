"""Detectors in the environment: what they look at, who shares them, and what is refused."""

import multiprocessing
import pickle
from concurrent.futures import ThreadPoolExecutor

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from small_world import small_plan

from galoc import GalocError, assets
from galoc.detect import detect, make_detector
from galoc.detect.model import SHIPPED
from galoc.heights import Heights
from galoc_env import detection
from galoc_env.env import FloorplanEnv
from galoc_env.settings import Settings
from galoc_env.vector import FloorplanVectorEnv
from galoc_env.world import World

pytestmark = pytest.mark.skipif(
    not (assets.root() / SHIPPED).is_file(), reason=f"this checkout has no {SHIPPED}: the learned detector needs it"
)
SIZE = {"width": 96, "height": 72}
IDLE = {"localizer": "none", "detector": "onnx"}
SEES = {"localizer": "small_world:DeadReckoner", "reward": "error"}


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory):
    return str(small_plan().save(tmp_path_factory.mktemp("plans") / "small.json"))


@pytest.fixture
def make(plan_file):
    made = []

    def build(**arguments):
        made.append(FloorplanEnv(**{"plan": plan_file, **SIZE, **arguments}))
        return made[-1]

    yield build
    for env in made:
        env.close()


def digest(wireframe):
    return b"".join(getattr(wireframe, name).tobytes() for name in ("ceiling", "floor", "walls", "kind"))


def flat(observation):
    return b"".join(observation[key].tobytes() for key in sorted(observation))


def play(env, actions, seed=7):
    observation, info = env.reset(seed=seed)
    trace = [flat(observation), digest(env.snapshot().wireframe)]
    for action in actions:
        observation, reward, *_ = env.step(action)
        trace += [flat(observation), reward, digest(env.snapshot().wireframe)]
    return trace


def test_the_learned_detector_is_the_default(make):
    env = make()
    assert env.settings.detector == "onnx" and detection.model("onnx")
    env.reset(seed=0)
    assert "onnx" in env.snapshot().wireframe_source
    assert detection.model("oracle") is None
    assert "oracle" in detection.source(Settings(detector="oracle"))


def test_it_sees_the_picture_of_the_agent_and_the_measured_gravity(make):
    env = make(localizer="none", imaging="poor", tilt_deg=10.0, imu_noise_deg=3.0)
    found = 0
    observation, _ = env.reset(seed=5)
    for action in (2, 2, 0, 2):
        roll, pitch = (float(v) for v in env._bodies.gravity[0])
        assert observation["gravity"] == pytest.approx([roll, pitch], abs=1e-6)  # rounded to float32
        seen = detect(make_detector("onnx"), observation["image"], env.camera, (roll, pitch))
        assert digest(env.snapshot().wireframe) == digest(seen)
        found += len(seen)
        observation, *_ = env.step(action)
    assert found > 0


def test_it_is_told_what_the_localizer_knows_of_the_heights(make, monkeypatch):
    told = []

    class Listener:
        uses_heights = True

        def detect(self, image, camera, gravity, *, log_ratio=None):
            told.append(log_ratio)
            return make_detector("onnx").detect(image, camera, gravity, log_ratio=log_ratio)

    monkeypatch.setattr(detection, "make_detector", lambda name: Listener())
    env = make()
    env.reset(seed=5)
    localizer = env.world.observer.localizer
    learned = Heights.known(1.4, 2.6)
    localizer._tracker.heights = learned
    env.step(2)
    assert told == [(Heights().k, Heights().k_sd), (learned.k, learned.k_sd)]
    env = make(localizer="none")
    env.reset(seed=5)
    env.snapshot()
    assert told[2:] == [None]


@pytest.mark.parametrize("localizer", ["galoc", "none"])
def test_same_seed_same_bytes(make, localizer):
    arguments = {"localizer": localizer, "imaging": "poor", "tilt_deg": 5.0}
    actions = [2, 0, 3]
    first = play(make(**arguments), actions)
    assert first == play(make(**arguments), actions)
    assert first != play(make(**arguments), actions, seed=8)


def test_the_detector_draws_from_no_stream(make):
    """Whatever finds the walls, motion, pictures and readings are the same."""
    kinds = [make(localizer="none", detector=name) for name in ("onnx", "oracle")]
    starts = [flat(env.reset(seed=3)[0]) for env in kinds]
    steps = [flat(env.step(0)[0]) for env in kinds]
    assert starts[0] == starts[1] and steps[0] == steps[1]


def test_nobody_looks_nothing_is_detected_and_two_looks_see_the_same(make, monkeypatch):
    asked, look = [], detection.look
    monkeypatch.setattr(detection, "look", lambda *given: asked.append(1) or look(*given))
    env = make(**IDLE)
    env.reset(seed=0)
    env.step(2)
    assert not asked
    assert env.snapshot().wireframe is env.snapshot().wireframe
    assert len(asked) == 1


def test_a_picture_is_drawn_once_per_step(make, monkeypatch):
    drawn, image = [], World.image
    monkeypatch.setattr(World, "image", lambda *given: drawn.append(1) or image(*given))
    env = make(**SEES, render_mode="rgb_array")
    env.reset(seed=0)
    env.render()
    env.step(2)
    env.render(), env.snapshot()
    assert len(drawn) == 2


@pytest.mark.parametrize("value", [0, 255])
def test_a_blank_picture_abstains(make, monkeypatch, value):
    blank = np.full((SIZE["height"], SIZE["width"], 3), value, np.uint8)
    monkeypatch.setattr(World, "image", lambda *_: blank.copy())
    env = make()
    observation, info = env.reset(seed=0)
    assert len(env.snapshot().wireframe) == 0
    assert info["abstained"] and info["coverage"] == 0.0 and not observation["estimate"].any()
    observation, _, _, _, info = env.step(0)
    assert info["abstained"] and not observation["estimate"].any()


@pytest.mark.parametrize("mode", list(AutoresetMode)[:2])
@pytest.mark.parametrize("localizer", ["galoc", "none"])
def test_the_batch_sees_what_single_ones_see(plan_file, mode, localizer):
    arguments = {**SIZE, "plan": plan_file, "localizer": localizer, "imaging": "poor", "tilt_deg": 5.0}

    def single():
        return gymnasium.make("galoc_env:GALoc-Floorplan-v0", max_episode_steps=3, **arguments)

    loop = SyncVectorEnv([single] * 2, autoreset_mode=mode)
    batch = FloorplanVectorEnv(2, max_episode_steps=3, autoreset_mode=mode, **arguments)
    (ours, _), (theirs, _) = batch.reset(seed=3), loop.reset(seed=3)
    for action in ([2, 0], [0, 2], [3, 3], [2, 2]):
        assert flat(ours) == flat(theirs)
        for lane in range(2):
            a, b = batch.snapshot(lane), loop.envs[lane].unwrapped.snapshot()
            assert digest(a.wireframe) == digest(b.wireframe) and a.image.tobytes() == b.image.tobytes()
        (ours, *said), (theirs, *heard) = batch.step(np.array(action)), loop.step(np.array(action))
        assert all(np.array_equal(a, b) for a, b in zip(said[:3], heard[:3], strict=True))
    batch.close(), loop.close()


def test_the_batch_detects_when_somebody_looks(plan_file, monkeypatch):
    asked, look = [], detection.look
    monkeypatch.setattr(detection, "look", lambda *given: asked.append(1) or look(*given))
    batch = FloorplanVectorEnv(2, plan=plan_file, **SIZE, **IDLE)
    batch.reset(seed=0)
    batch.step(np.array([2, 2]))
    assert not asked
    kept = batch.snapshot(1).image.copy()
    batch.step(np.array([2, 2]))
    assert len(asked) == 1 and not np.array_equal(batch.snapshot(1).image, kept)
    batch.close()


def test_all_worlds_of_a_process_share_one_detector(make):
    assert make_detector("onnx") is make_detector("onnx")
    env = make(**SEES)
    env.reset(seed=0)
    small = make(**SEES, detector="oracle")
    small.reset(seed=0)
    # A copy takes no model along: both are a few hundred KB, a model is megabytes.
    assert len(pickle.dumps(env)) < len(pickle.dumps(small)) + 100_000


def test_a_copied_environment_goes_on_alike(make):
    env = make(localizer="none", tilt_deg=4.0)
    env.reset(seed=3)
    twin = pickle.loads(pickle.dumps(env))
    for action in (2, 0):
        assert digest(env.snapshot().wireframe) == digest(twin.snapshot().wireframe)
        assert flat(env.step(action)[0]) == flat(twin.step(action)[0])


def test_threads_share_it(make):
    env = make(**IDLE)
    images = [env.reset(seed=3)[0]["image"]] + [env.step(2)[0]["image"] for _ in range(7)]

    def seen(image):
        return digest(detect(make_detector("onnx"), image, env.camera, (0.0, 0.0)))

    alone = [seen(image) for image in images]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(seen, images)) == alone
    assert len(set(alone)) > 1


def _walk_in_a_child(answers, plan_file):
    env = FloorplanEnv(plan=plan_file, **SIZE, **IDLE)
    try:
        answers.put(play(env, [2, 0]))
    except GalocError as error:
        answers.put(error)


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="this system cannot fork")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")  # threads of the test's own libraries
def test_a_forked_process_sees_the_same(make, plan_file):
    here = play(make(**IDLE), [2, 0])  # the parent's session is open when the child is born
    context = multiprocessing.get_context("fork")
    answers = context.Queue()
    child = context.Process(target=_walk_in_a_child, args=(answers, plan_file))
    child.start()
    assert answers.get(timeout=100) == here
    child.join()


@pytest.mark.parametrize("detector", ["onnx", "lines"])
@pytest.mark.parametrize(
    "arguments",
    [
        {"renderer": "none"},
        {"renderer": "none", **SEES},
        {"renderer": "none", "localizer": "none", "render_mode": "rgb_array"},
        {"detector_noise_px": 0.0},
        {"detector_noise_px": 3},
    ],
)
def test_what_does_not_go_together_names_the_cure(make, plan_file, detector, arguments):
    for build in (make, lambda **given: FloorplanVectorEnv(2, plan=plan_file, **given)):
        with pytest.raises(GalocError, match=detector) as caught:
            build(detector=detector, **arguments)
        assert 'detector="oracle"' in caught.value.cure


def test_without_pictures_looking_is_refused_and_walking_is_not(make):
    env = make(**IDLE, renderer="none")
    env.reset(seed=0)
    env.step(0)
    with pytest.raises(GalocError, match="none") as caught:
        env.snapshot()
    assert 'detector="oracle"' in caught.value.cure


def test_a_missing_model_is_refused_before_anybody_walks(make, monkeypatch):
    def missing(name):
        raise GalocError("no model", "a model", "Pass one.")

    monkeypatch.setattr("galoc_env.world.make_detector", missing)
    with pytest.raises(GalocError, match="no model"):
        make(**SEES).reset(seed=0)
    make(localizer="none").reset(seed=0)


@pytest.mark.parametrize("localizer", ["galoc", "none"])
def test_line_segments_can_be_asked_too(make, localizer):
    env = make(detector="lines", localizer=localizer, width=160, height=120)
    assert play(env, [2]) == play(env, [2])
    assert "lines" in env.snapshot().wireframe_source and detection.model("lines") is None
