"""The whole method: noise-free accuracy, abstention, sequences, refusals."""

import math
from typing import Any

import numpy as np
import pytest

from galoc import Camera, Floorplan, GalocError, Localizer, Wireframe, assets, detect
from galoc.detect.model import SHIPPED
from galoc.detect.oracle import OracleDetector, perturb
from galoc.heights import Heights
from galoc.localizer import LocalizerConfig
from galoc.metrics import pose_error
from galoc_env.truth import visible_wireframe

PLAN = Floorplan.load("apartment")
CAMERA = Camera.from_hfov(640, 480, 108)


@pytest.fixture(scope="module")
def localizer() -> Localizer:
    """The paper's method."""
    return Localizer(PLAN, CAMERA, geometry="paper", scoring="cosine")


@pytest.fixture(scope="module")
def likely() -> Localizer:
    """The default: maximum-likelihood layout, likelihood scoring."""
    return Localizer(PLAN, CAMERA)


def walk(steps: int) -> list[tuple[np.ndarray, tuple[float, float, float]]]:
    """Poses along a straight stretch with turns in place, and the exact odometry to each."""
    positions = PLAN.free_space(0.1).positions(0.6)
    pose = np.array([*positions[len(positions) // 3], 0.4])
    out = [(pose.copy(), (0.0, 0.0, 0.0))]
    for _ in range(steps):
        pose[2] += math.radians(30.0)
        out.append((pose.copy(), (0.0, 0.0, math.radians(30.0))))
    return out


def journey(steps: int, seed: int) -> list[tuple[np.ndarray, tuple[float, float, float]]]:
    """Poses of a wandering walk through free space, and the exact odometry to each."""
    rng = np.random.default_rng(seed)
    free = PLAN.free_space(0.05)
    positions = free.positions(0.6)
    pose = np.array([*positions[rng.integers(len(positions))], rng.uniform(-np.pi, np.pi)])
    out = [(pose.copy(), (0.0, 0.0, 0.0))]
    while len(out) <= steps:
        ahead = pose[:2] + 0.2 * np.array([math.cos(pose[2]), math.sin(pose[2])])
        clear = free.clearance_at(ahead[None])[0] > 0.5
        move = (0.2, 0.0, float(rng.uniform(-0.2, 0.2))) if clear else (0.0, 0.0, 0.5)
        pose = np.array([*(ahead if clear else pose[:2]), pose[2] + move[2]])
        out.append((pose.copy(), move))
    return out


def test_the_default_is_ml_and_likelihood(likely: Localizer) -> None:
    assert likely.geometry == "ml" and likely.scoring == "likelihood" and likely.likelihood is not None
    estimate = likely.locate(visible_wireframe(PLAN, CAMERA, walk(0)[0][0], 1.4), (0.0, 0.0))
    assert estimate.layout is not None and estimate.layout.method == "ml"


def test_sequence_converges_and_knows_it(localizer: Localizer) -> None:
    """Turning once around on the spot with 5 px noise settles where the camera is."""
    localizer.reset()
    rng = np.random.default_rng(1)
    confidence = []
    for pose, odometry in walk(11):
        wireframe = perturb(visible_wireframe(PLAN, CAMERA, pose, 1.4), CAMERA, 5.0, rng)
        estimate = localizer.step(wireframe, (0.0, 0.0), odometry)
        confidence.append(estimate.confidence)
    error_m, error_rad = pose_error(estimate.pose, pose)
    assert error_m < 0.3 and error_rad < math.radians(3.0)
    assert confidence[-1] > 3.0 * confidence[0]  # the cosine is a blunt likelihood: it grows, slowly
    assert estimate.entropy < math.log(localizer.belief.size) - 3.0


def test_image_route_equals_wireframe_route() -> None:
    pose = walk(0)[0][0]
    truth = visible_wireframe(PLAN, CAMERA, pose, 1.4)
    detector = OracleDetector(lambda: truth, 0.0, np.random.default_rng(0))
    with_detector = Localizer(PLAN, CAMERA, detector=detector, geometry="paper", scoring="cosine")
    image = np.zeros((480, 640, 3), np.uint8)
    a = with_detector.locate(image, (0.0, 0.0))
    b = with_detector.locate(truth, (0.0, 0.0))
    np.testing.assert_array_equal(a.pose, b.pose)
    assert a.rays is not None and a.layout is not None and a.layout.gauge is not None


def test_blind_image_abstains(localizer: Localizer) -> None:
    estimate = localizer.locate(Wireframe.empty(), (0.0, 0.0))
    assert estimate.abstained and estimate.confidence == 0.0 and np.isnan(estimate.pose).all()
    localizer.reset()
    estimate = localizer.step(Wireframe.empty(), (0.0, 0.0))
    assert estimate.abstained and estimate.confidence == 0.0 and np.isnan(estimate.pose).all()


def test_blind_frames_fall_back_to_odometry(localizer: Localizer) -> None:
    localizer.reset()
    rng = np.random.default_rng(2)
    for pose, odometry in walk(11):
        wireframe = perturb(visible_wireframe(PLAN, CAMERA, pose, 1.4), CAMERA, 3.0, rng)
        before = localizer.step(wireframe, (0.0, 0.0), odometry)
    after = localizer.step(Wireframe.empty(), (0.0, 0.0), (0.2, 0.0, 0.0))
    assert after.abstained and after.confidence > 0.0
    ahead = before.pose[:2] + 0.2 * np.array([math.cos(before.pose[2]), math.sin(before.pose[2])])
    assert np.hypot(*(after.pose[:2] - ahead)) < 0.05  # m: half a cell


def test_locate_leaves_the_belief_alone(localizer: Localizer) -> None:
    localizer.reset()
    before = localizer.belief.p.copy()
    localizer.locate(visible_wireframe(PLAN, CAMERA, walk(0)[0][0], 1.4), (0.0, 0.0))
    np.testing.assert_array_equal(localizer.belief.p, before)


def test_candidates_are_sorted(localizer: Localizer) -> None:
    estimate = localizer.locate(visible_wireframe(PLAN, CAMERA, walk(0)[0][0], 1.4), (0.0, 0.0))
    assert np.all(np.diff(estimate.candidates[:, 3]) <= 0)
    np.testing.assert_array_equal(estimate.pose, estimate.candidates[0, :3])


def test_refusals(localizer: Localizer) -> None:
    with pytest.raises(GalocError, match="geometry"):
        Localizer(PLAN, CAMERA, geometry="magic")
    with pytest.raises(GalocError, match="scoring"):
        Localizer(PLAN, CAMERA, scoring="magic")
    with pytest.raises(GalocError, match="gravity"):
        localizer.locate(visible_wireframe(PLAN, CAMERA, walk(0)[0][0], 1.4), (math.nan, 0.0))
    detector = OracleDetector(Wireframe.empty, 0.0, np.random.default_rng(0))
    for image in (np.zeros((48, 64, 3), np.uint8), np.zeros((480, 640, 3), np.float32)):
        with pytest.raises(GalocError, match="image"):
            Localizer(PLAN, CAMERA, detector=detector).locate(image, (0.0, 0.0))


@pytest.mark.parametrize("detector", ["magic", "oracle", "", None, 3, OracleDetector, Wireframe.empty()])
def test_what_is_no_detector_is_refused_at_once(detector: Any) -> None:
    with pytest.raises(GalocError, match="detector") as caught:
        Localizer(ROOMS, CAMERA, detector=detector)
    assert '"onnx"' in caught.value.expected


def test_a_detector_that_uses_heights_is_told_what_is_known() -> None:
    """First what was given, then what the sequence has learned; :meth:`locate` may be told otherwise."""
    told: list[Any] = []

    class Listener:
        uses_heights = True

        def detect(self, image: Any, camera: Any, gravity: Any, *, log_ratio: Any = None) -> Wireframe:
            told.append(log_ratio)
            return visible_wireframe(PLAN, CAMERA, poses[(len(told) - 1) % len(poses)][0], 1.4)

    poses = journey(10, 1)
    listening = Localizer(PLAN, CAMERA, detector=Listener())
    image = np.zeros((480, 640, 3), np.uint8)
    known: list[Any] = []
    for _, odometry in poses:
        known.append((listening.heights.k, listening.heights.k_sd))
        listening.step(image, (0.0, 0.0), odometry)
    assert told == known and told[0] == (0.0, pytest.approx(0.3 * math.sqrt(2.0)))
    assert told[-1][1] < 0.1  # learned: k is known to 10 %
    other = Heights.known(1.2, 2.4)
    listening.locate(image, (0.0, 0.0), other)
    listening.locate(image, (0.0, 0.0))
    assert told[-2:] == [(other.k, other.k_sd), told[0]]


@pytest.mark.parametrize("found", [None, {}, (Wireframe.empty(),), np.zeros((0, 2))])
@pytest.mark.parametrize("uses_heights", [False, True])
def test_a_detector_that_returns_no_wireframe_is_named(found: Any, uses_heights: bool) -> None:
    class Odd:
        def detect(self, *_: Any, **__: Any) -> Any:
            return found

    Odd.uses_heights = uses_heights  # type: ignore[attr-defined]
    with pytest.raises(GalocError, match=f"{type(found).__name__} from the detector Odd.*Wireframe"):
        Localizer(PLAN, CAMERA, detector=Odd()).locate(np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8), (0, 0))


def test_no_detector_is_made_before_an_image_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []

    def build(name: str) -> OracleDetector:
        made.append(name)
        return OracleDetector(Wireframe.empty, 0.0, np.random.default_rng(0))

    monkeypatch.setattr(detect, "_made", {})
    monkeypatch.setattr(detect, "_build", build)
    first, second = Localizer(ROOMS, CAMERA), Localizer(ROOMS, CAMERA, detector="lines")
    first.step(Wireframe.empty(), (0.0, 0.0))
    assert made == []
    for localizer in (first, second, first):
        localizer.step(np.zeros((480, 640, 3), np.uint8), (0.0, 0.0))
    assert made == ["onnx", "lines"]


Film = tuple[Camera, list[tuple[Any, Any, Any, Any]]]
FILMED_FROM = (1.65, 5.55, -2.9)
"""In the kitchen of the apartment."""
needs_model = pytest.mark.skipif(
    not (assets.root() / SHIPPED).is_file(), reason=f"this checkout has no {SHIPPED}: the learned detector needs it"
)


@pytest.fixture(scope="module")
def filmed() -> Film:
    """Once around in the furnished apartment, as a robot records it: image, gravity, odometry; and the true pose."""
    from galoc_env.env import FloorplanEnv

    env = FloorplanEnv(plan="apartment", localizer="none", tilt_deg=2.0)
    seen, info = env.reset(seed=4, options={"pose": FILMED_FROM})
    frames = [(seen["image"], seen["gravity"], seen["odometry"], info["pose"])]
    for _ in range(12):
        seen, *_, info = env.step(2)
        frames.append((seen["image"], seen["gravity"], seen["odometry"], info["pose"]))
    env.close()
    return env.camera, frames


@needs_model
def test_from_pixels_alone_it_finds_itself(filmed: Film) -> None:
    """The shipped network, heights unknown, 0.5 degrees of gravity noise: a look around the room is enough."""
    camera, frames = filmed
    localizer = Localizer(PLAN, camera, config=LocalizerConfig(imu_sigma_deg=0.5))
    coverage, errors = [], []
    for image, gravity, odometry, pose in frames:
        estimate = localizer.step(image, gravity, odometry)
        assert estimate.rays is not None and 0.0 <= estimate.confidence <= 1.0
        coverage.append(estimate.rays.coverage)
        errors.append(pose_error(estimate.pose, pose)[0])
    assert np.mean(coverage) > 0.3  # of the view; 0.7 with exact structure
    assert errors[-1] < 0.5  # m, what counts as found


@needs_model
def test_images_and_their_wireframes_are_one_route(filmed: Film) -> None:
    """An image given is the wireframe given that the detector makes of it, with what is known of the heights."""
    camera, frames = filmed
    by_image, by_wireframe = Localizer(PLAN, camera), Localizer(PLAN, camera)
    for image, gravity, odometry, _ in frames[:4]:
        measured = (float(gravity[0]), float(gravity[1]))
        seen = detect.detect(detect.make_detector("onnx"), image, camera, measured, by_wireframe.heights)
        a, b = by_image.step(image, gravity, odometry), by_wireframe.step(seen, gravity, odometry)
        assert a.pose.tobytes() == b.pose.tobytes() and a.confidence == b.confidence


@needs_model
@pytest.mark.parametrize("value", [0, 128, 255])
def test_a_blank_picture_abstains(likely: Localizer, value: int) -> None:
    likely.reset()
    image = np.full((480, 640, 3), value, np.uint8)
    for estimate in (likely.locate(image, (0.0, 0.0)), likely.step(image, (0.0, 0.0))):
        assert estimate.abstained and estimate.confidence == 0.0 and np.isnan(estimate.pose).all()


def test_likelihood_finds_noise_free_views(likely: Localizer) -> None:
    """Unknown heights, exact junctions: sure estimates are right to 2 cm and 0.3 degrees; most views are sure."""
    rng, sure = np.random.default_rng(3), []
    free = PLAN.free_space(0.1).positions(0.5)
    for _ in range(14):
        pose = np.array([*free[rng.integers(len(free))], rng.uniform(-np.pi, np.pi)])
        exact = perturb(visible_wireframe(PLAN, CAMERA, pose, 1.4), CAMERA, 0.0, rng)
        if not (exact.ceiling_true | exact.floor_true).any():
            continue  # nose to the wall
        estimate = likely.locate(exact, (0.0, 0.0))
        assert 0.0 <= estimate.confidence <= 1.0 and not estimate.abstained
        assert np.all(np.diff(estimate.candidates[:, 3]) <= 0.0)
        np.testing.assert_array_equal(estimate.pose, estimate.candidates[0, :3])
        assert estimate.covariance is not None and np.linalg.eigvalsh(estimate.covariance).min() > 0.0
        if estimate.confidence > 0.9:
            sure.append(pose_error(estimate.pose, pose))
    assert len(sure) >= 6
    right = [e < 0.02 and a < math.radians(0.3) for e, a in sure]
    assert np.mean(right) >= 0.9


def test_likelihood_abstains_on_blind_frames() -> None:
    likely = Localizer(PLAN, CAMERA)
    for estimate in (likely.locate(Wireframe.empty(), (0.0, 0.0)), likely.step(Wireframe.empty(), (0.0, 0.0))):
        assert estimate.abstained and estimate.confidence == 0.0 and np.isnan(estimate.pose).all()
    # Lost before the first view is not lost for good.
    for pose, odometry in walk(5):
        estimate = likely.step(visible_wireframe(PLAN, CAMERA, pose, 1.4), (0.0, 0.0), odometry)
    assert not estimate.abstained and estimate.confidence > 0.0
    before = estimate.pose
    blind = likely.step(Wireframe.empty(), (0.0, 0.0), (0.1, 0.0, 0.0))
    ahead = before[:2] + 0.1 * np.array([math.cos(before[2]), math.sin(before[2])])
    assert blind.abstained and np.hypot(*(blind.pose[:2] - ahead)) < 1e-6


@pytest.mark.parametrize("seed", [0, 1])
def test_likelihood_tracks_to_centimetres(likely: Localizer, seed: int) -> None:
    """A walk of 40 frames at 2 px and 0.3 degrees, heights unknown: last ten frames within 3 cm in the median."""
    likely.reset()
    rng, errors = np.random.default_rng(seed), []
    for pose, odometry in journey(40, seed):
        wireframe = perturb(visible_wireframe(PLAN, CAMERA, pose, 1.4), CAMERA, 2.0, rng)
        gravity = np.radians(0.3) * rng.standard_normal(2)
        estimate = likely.step(wireframe, gravity, odometry)
        errors.append(pose_error(estimate.pose, pose)[0])
    assert np.median(errors[-10:]) < 0.03
    assert estimate.confidence > 0.9 and estimate.covariance is not None
    learned = np.exp([likely.heights.log_ceiling, likely.heights.log_floor])
    np.testing.assert_allclose(learned, [PLAN.ceiling_height - 1.4, 1.4], rtol=0.05)
    likely.reset()
    assert likely.heights.ceiling is None and likely.heights.var_floor == pytest.approx(0.09)


@pytest.mark.parametrize("seed", [3, 6, 7])
def test_a_camera_put_elsewhere_is_found_again(likely: Localizer, seed: int) -> None:
    """Carried off unnoticed: what is seen fits no believed place, so all places are looked at again.

    These walks are right within 5 steps of it. Without that look, two of the three are not within 10.
    """
    likely.reset()
    rng, errors = np.random.default_rng(seed), []
    for part in (seed, seed + 10):
        for pose, odometry in journey(9, part):
            wireframe = perturb(visible_wireframe(PLAN, CAMERA, pose, 1.4), CAMERA, 3.0, rng)
            errors.append(pose_error(likely.step(wireframe, (0.0, 0.0), odometry).pose, pose)[0])
    assert errors[9] < 0.2 < errors[10] and errors[-1] < 0.2  # m; 0.04 where the right place is tracked


def test_same_input_same_bytes(likely: Localizer) -> None:
    def run() -> list[bytes]:
        likely.reset()
        rng, out = np.random.default_rng(4), []
        for pose, odometry in journey(4, 2):
            wireframe = perturb(visible_wireframe(PLAN, CAMERA, pose, 1.4), CAMERA, 5.0, rng)
            estimate = likely.step(wireframe, (0.0, 0.01), odometry)
            alone = likely.locate(wireframe, (0.0, 0.01))
            out += [estimate.pose.tobytes(), alone.pose.tobytes(), alone.candidates.tobytes()]
            out.append(np.float64([estimate.confidence, alone.confidence, estimate.entropy]).tobytes())
        return [*out, likely.belief.p.tobytes()]

    assert run() == run()


def test_known_heights_help() -> None:
    """With the heights given, ranges are metric: scores of the true place rise against the rest."""
    rng, sure = np.random.default_rng(5), {True: list[float](), False: list[float]()}
    config = LocalizerConfig(heights=(1.4, PLAN.ceiling_height), heights_sd=0.01)
    both = {True: Localizer(PLAN, CAMERA, config=config), False: Localizer(PLAN, CAMERA)}
    free = PLAN.free_space(0.1).positions(0.5)
    for _ in range(8):
        pose = np.array([*free[rng.integers(len(free))], rng.uniform(-np.pi, np.pi)])
        wireframe = perturb(visible_wireframe(PLAN, CAMERA, pose, 1.4), CAMERA, 3.0, rng)
        for known, localizer in both.items():
            estimate = localizer.locate(wireframe, (0.0, 0.0))
            right = pose_error(estimate.pose, pose)[0] < 0.5
            sure[known].append(estimate.confidence if right else 0.0)
            assert estimate.layout is not None and estimate.layout.metric == known
    assert np.mean(sure[True]) > np.mean(sure[False])
    assert both[True].heights.log_floor == pytest.approx(math.log(1.4))
    from_plan = Localizer(PLAN, CAMERA, config=LocalizerConfig(ceiling_from_plan=True))
    assert from_plan.heights.ceiling == pytest.approx((math.log(PLAN.ceiling_height), 0.03))


@pytest.mark.parametrize("heights", [(1.4, 1.2), (0.0, 2.6), (math.nan, 2.6), ("1.4", 2.6)])
def test_bad_heights_are_refused(heights: Any) -> None:
    with pytest.raises(GalocError):
        Localizer(PLAN, CAMERA, config=LocalizerConfig(heights=heights))


@pytest.mark.parametrize(("geometry", "scoring"), [("paper", "likelihood"), ("ml", "cosine")])
def test_mixed_methods_run(geometry: str, scoring: str) -> None:
    mixed = Localizer(PLAN, CAMERA, geometry=geometry, scoring=scoring)
    rng = np.random.default_rng(6)
    for pose, odometry in walk(11):
        wireframe = perturb(visible_wireframe(PLAN, CAMERA, pose, 1.4), CAMERA, 2.0, rng)
        estimate = mixed.step(wireframe, (0.0, 0.0), odometry)
    assert pose_error(estimate.pose, pose)[0] < 0.5
    assert estimate.layout is not None and estimate.layout.method == geometry
    alone = mixed.locate(wireframe, (0.0, 0.0))
    assert np.isfinite(alone.pose).all() and 0.0 < alone.confidence <= 1.0
    assert mixed.scores(wireframe, (0.0, 0.0)).shape == (len(mixed.field.positions), 360)
    assert mixed.locate(Wireframe.empty(), (0.0, 0.0)).abstained


def test_rays_alone_can_be_fused(likely: Localizer) -> None:
    """A laser's ranges, without a layout: the belief alone finds the place while turning on the spot."""
    from galoc.types import Rays

    likely.reset()
    for pose, odometry in walk(11):
        degree = round(math.degrees(pose[2]))
        ranges = likely.field.caster(pose[:2])[0][(degree + np.arange(109) - 54) % 360].astype(float)
        estimate = likely.fuse(Rays(ranges, np.ones(109, bool), np.full(109, 1e-3)), odometry)
    assert pose_error(estimate.pose, pose)[0] < 0.3 and not estimate.abstained


@pytest.mark.parametrize("name", ["resolution", "heights_sd", "imu_sigma_deg", "odometry_noise", "odometry_turn_deg"])
@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf"), "x", None])
def test_config_refuses_what_is_no_number(name: str, value: object) -> None:
    with pytest.raises(GalocError, match=name):
        LocalizerConfig(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize(("name", "value"), [("headings", 50), ("headings", 72.0), ("kidnapped", 1.0)])
def test_config_refuses_headings_that_do_not_divide_the_circle(name: str, value: Any) -> None:
    with pytest.raises(GalocError, match=name):
        LocalizerConfig(**{name: value})


def test_headings_fit_the_scoring(localizer: Localizer, likely: Localizer) -> None:
    assert localizer.belief.headings == 360 and likely.belief.headings == 72
    both = [Localizer(PLAN, CAMERA, scoring=s, config=LocalizerConfig(headings=36)) for s in ("cosine", "likelihood")]
    rng = np.random.default_rng(8)
    for pose, odometry in walk(11):
        wireframe = perturb(visible_wireframe(PLAN, CAMERA, pose, 1.4), CAMERA, 2.0, rng)
        for coarse in both:
            coarse.step(wireframe, (0.0, 0.0), odometry)
    for coarse in both:
        assert coarse.belief.p.shape[1] == 36
        error_m, error_rad = pose_error(coarse.belief.peak(), pose)
        assert error_m < 0.5 and error_rad < math.radians(10.0)  # a cell


def test_estimates_below_the_wanted_confidence_count_as_abstained() -> None:
    strict = Localizer(PLAN, CAMERA, config=LocalizerConfig(abstain_below=1.1))
    estimate = strict.locate(visible_wireframe(PLAN, CAMERA, walk(0)[0][0], 1.4), (0.0, 0.0))
    assert estimate.abstained
    assert np.isfinite(estimate.pose).all() and estimate.confidence <= 1.0


ROOMS = Floorplan.from_segments(
    np.array(
        [[0, 0, 5, 0], [5, 0, 5, 2], [5, 2, 3, 2], [3, 2, 3, 4], [3, 4, 0, 4], [0, 4, 0, 0], [1.5, 4, 1.5, 2.6]], float
    )
)
"""An L with a stub of wall, 16 m2."""


def test_exact_search_is_certified_and_never_worse() -> None:
    plain = Localizer(ROOMS, CAMERA, geometry="paper", scoring="cosine")
    exact = Localizer(ROOMS, CAMERA, geometry="paper", scoring="cosine", config=LocalizerConfig(exact=True))
    rng = np.random.default_rng(5)
    for x, y, heading in ((1.0, 1.0, 0.3), (4.0, 1.2, 2.5), (2.3, 3.1, -1.9), (0.8, 3.2, -0.6)):
        seen = perturb(visible_wireframe(ROOMS, CAMERA, np.array([x, y, heading]), 1.4), CAMERA, 4.0, rng)
        best, proven = plain.locate(seen, (0.0, 0.0)), exact.locate(seen, (0.0, 0.0))
        assert proven.certified and not best.certified
        # The grid search ends on another lattice (multiples of 1 cm, ours lies between): 2e-3 for half a step.
        assert proven.candidates[0, 3] >= best.candidates[0, 3] - 2e-3
        np.testing.assert_array_equal(proven.pose, proven.candidates[0, :3])
        apart = np.hypot(*(proven.candidates[1:, :2] - proven.pose[:2]).T) >= 0.45
        turned = np.abs(proven.candidates[1:, 2] - proven.pose[2]) >= math.radians(12.0)
        assert np.all(apart | turned)
    assert exact.locate(Wireframe.empty(), (0.0, 0.0)).abstained


def test_exact_search_is_for_the_cosine() -> None:
    with pytest.raises(GalocError, match="exact"):
        Localizer(ROOMS, CAMERA, config=LocalizerConfig(exact=True))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("exact", "yes"), ("exact", 1), ("ceiling_from_plan", "yes"), ("candidates", 0), ("candidates", "x"),
        ("motion", "rounded"), ("diffusion_m", -1.0), ("diffusion_m", "x"), ("diffusion_rad", math.nan),
        ("heights", 1.4), ("heights", (1.4,)), ("heights", "ab"),
    ],
)  # fmt: skip
def test_config_refuses_what_is_of_the_wrong_kind(name: str, value: Any) -> None:
    with pytest.raises(GalocError, match=name):
        LocalizerConfig(**{name: value})
