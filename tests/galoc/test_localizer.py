"""The whole method: noise-free accuracy, abstention, sequences, refusals."""

import math

import numpy as np
import pytest

from galoc import Camera, Floorplan, GalocError, Localizer, Wireframe
from galoc.detect.oracle import OracleDetector, perturb
from galoc.metrics import pose_error
from galoc_env.truth import visible_wireframe

PLAN = Floorplan.load("apartment")
CAMERA = Camera.from_hfov(640, 480, 108)


@pytest.fixture(scope="module")
def localizer() -> Localizer:
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
    assert estimate.entropy < math.log(localizer.belief.log_p.size) - 3.0


def test_image_route_equals_wireframe_route() -> None:
    pose = walk(0)[0][0]
    truth = visible_wireframe(PLAN, CAMERA, pose, 1.4)
    detector = OracleDetector(lambda: truth, 0.0, np.random.default_rng(0))
    with_detector = Localizer(PLAN, CAMERA, detector=detector)
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
    before = localizer.belief.log_p.copy()
    localizer.locate(visible_wireframe(PLAN, CAMERA, walk(0)[0][0], 1.4), (0.0, 0.0))
    np.testing.assert_array_equal(localizer.belief.log_p, before)


def test_candidates_are_sorted(localizer: Localizer) -> None:
    estimate = localizer.locate(visible_wireframe(PLAN, CAMERA, walk(0)[0][0], 1.4), (0.0, 0.0))
    assert np.all(np.diff(estimate.candidates[:, 3]) <= 0)
    np.testing.assert_array_equal(estimate.pose, estimate.candidates[0, :3])


def test_refusals(localizer: Localizer) -> None:
    with pytest.raises(GalocError, match="geometry"):
        Localizer(PLAN, CAMERA, geometry="magic")
    with pytest.raises(GalocError, match="scoring"):
        Localizer(PLAN, CAMERA, scoring="magic")
    with pytest.raises(GalocError, match="detector"):
        localizer.locate(np.zeros((480, 640, 3), np.uint8), (0.0, 0.0))
    with pytest.raises(GalocError, match="gravity"):
        localizer.locate(visible_wireframe(PLAN, CAMERA, walk(0)[0][0], 1.4), (math.nan, 0.0))
    detector = OracleDetector(Wireframe.empty, 0.0, np.random.default_rng(0))
    for image in (np.zeros((48, 64, 3), np.uint8), np.zeros((480, 640, 3), np.float32)):
        with pytest.raises(GalocError, match="image"):
            Localizer(PLAN, CAMERA, detector=detector).locate(image, (0.0, 0.0))
