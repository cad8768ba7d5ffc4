"""The tracker between cells: its motion model, the heights it learns, and what it refuses to learn from."""

import math
from functools import cache

import numpy as np
import pytest

from galoc import Camera, Floorplan, Localizer, Wireframe
from galoc.detect.oracle import perturb
from galoc.heights import Heights
from galoc.layout import solve_layout
from galoc.likelihood import Likelihood
from galoc.localizer import LocalizerConfig
from galoc.observation import Observation, observation
from galoc.profiles import profile_field
from galoc.rays import cast_rays
from galoc.tracker import START_SD, STILL_SD, Tracker
from galoc.types import Layout
from galoc_env.truth import visible_wireframe

CAMERA = Camera.from_hfov(640, 480, 108)
PLAN = Floorplan.load("apartment")
TRUE = (PLAN.ceiling_height - 1.4, 1.4)


@cache
def likelihood() -> Likelihood:
    return Likelihood(profile_field(PLAN, 0.1))


def tracker(heights: Heights | None = None) -> Tracker:
    return Tracker(likelihood(), heights or Heights(), 0.02, math.radians(0.5))


def spots(count: int, seed: int = 0) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    free = PLAN.free_space(0.1).positions(0.6)
    return [np.array([*free[rng.integers(len(free))], rng.uniform(-np.pi, np.pi)]) for _ in range(count)]


def look(pose: np.ndarray, heights: Heights, sigma: float, seed: int) -> tuple[Observation, Layout]:
    rng = np.random.default_rng(seed)
    wireframe = perturb(visible_wireframe(PLAN, CAMERA, pose, 1.4), CAMERA, sigma, rng)
    layout = solve_layout(wireframe, CAMERA, (0.0, 0.0), heights=heights, imu_sigma_rad=math.radians(0.3))
    return observation(layout, cast_rays(layout, CAMERA)), layout


@pytest.mark.parametrize("odometry", [(0.3, 0.0, 0.0), (0.2, -0.1, 0.4), (0.0, 0.0, -0.7), (0.0, 0.0, 0.0)])
def test_odometry_moves_mean_and_covariance(odometry: tuple[float, float, float]) -> None:
    """Covariance by finite differences of the motion, plus the odometry's own noise."""
    move = np.array(odometry)

    def moved(pose: np.ndarray) -> np.ndarray:
        t = tracker()
        t.start(pose)
        t.predict(move)
        assert t.mean is not None
        return t.mean

    pose = np.array([1.0, 2.0, 0.8])
    c, s = math.cos(0.8), math.sin(0.8)
    want = pose + [c * move[0] - s * move[1], s * move[0] + c * move[1], move[2]]
    np.testing.assert_allclose(moved(pose), want, atol=1e-12)
    step = 1e-6
    jacobian = np.stack([(moved(pose + step * e) - moved(pose - step * e)) / (2.0 * step) for e in np.eye(3)], axis=1)
    t = tracker()
    t.start(pose)
    np.testing.assert_allclose(t.covariance, np.diag(START_SD**2))
    t.predict(move)
    far, turned = 0.02 * math.hypot(move[0], move[1]), math.radians(0.5) * bool(np.any(move != 0.0))
    own = np.diag(np.square([far, far, turned]) + STILL_SD**2)
    np.testing.assert_allclose(t.covariance, jacobian @ np.diag(START_SD**2) @ jacobian.T + own, atol=1e-9)


def test_heading_stays_wrapped() -> None:
    t = tracker()
    t.predict(np.array([1.0, 0.0, 0.0]))  # nothing to follow yet: no error
    assert t.mean is None
    t.start(np.array([0.0, 0.0, 3.0]))
    t.predict(np.array([0.0, 0.0, 1.0]))
    assert t.mean is not None and -math.pi <= t.mean[2] <= math.pi


def test_a_frame_pulls_the_pose_to_the_truth() -> None:
    """From 8 cm and 2 degrees off to under 3 cm, the covariance shrinking, at 3 px of noise."""
    errors = []
    for i, pose in enumerate(spots(20)):
        known = Heights.known(1.4, PLAN.ceiling_height, sd=0.01)
        seen, _ = look(pose, known, 3.0, i)
        t = tracker(known)
        t.start(pose + [0.06, -0.05, math.radians(2.0)])
        before = np.trace(t.covariance)
        if t.update(seen) is None:
            continue
        assert t.mean is not None and np.trace(t.covariance) < before
        assert np.linalg.eigvalsh(t.covariance).min() > 0.0
        errors.append(np.hypot(*(t.mean[:2] - pose[:2])))
    assert len(errors) >= 14 and np.median(errors) < 0.03


def test_heights_converge_to_the_truth() -> None:
    """Unknown at first (30 %), then learned from 40 fixes near the truth: within 2 %, and no surer than that."""
    t = tracker()
    start = t.heights
    for i, pose in enumerate(spots(40, 1)):
        seen, layout = look(pose, t.heights, 3.0, i)
        t.start(pose)
        scale = t.update(seen)
        if scale is not None:
            t.learn(layout, scale)
    got = np.exp([t.heights.log_ceiling, t.heights.log_floor])
    np.testing.assert_allclose(got, TRUE, rtol=0.02)
    assert t.heights.var_ceiling < 0.02 * start.var_ceiling
    off = np.log(got) - np.log(TRUE)
    assert np.all(np.abs(off) < 3.0 * np.sqrt([t.heights.var_ceiling, t.heights.var_floor]))
    t.forget_heights()
    assert t.heights is start
    t.reset()
    assert t.mean is None and t.heights is start


def test_a_wrong_pose_is_mostly_not_registered() -> None:
    """Followed in another room, most frames fit nothing there: update says so and keeps the pose."""
    refused, tried = 0, 0
    known = Heights.known(1.4, PLAN.ceiling_height, sd=0.01)
    places = spots(20, 2)
    for i, (pose, wrong) in enumerate(zip(places, places[1:], strict=False)):
        if np.hypot(*(pose[:2] - wrong[:2])) < 1.5:
            continue
        seen, _ = look(pose, known, 2.0, i)
        t = tracker(known)
        t.start(wrong)
        t.covariance = np.diag(np.square([0.03, 0.03, math.radians(1.0)]))
        tried += 1
        if t.update(seen) is None:
            refused += 1
            assert t.mean is not None
            np.testing.assert_array_equal(t.mean, wrong)
    assert tried >= 10 and refused >= 0.6 * tried


def test_nothing_is_learned_from_a_fix_that_is_not_sure() -> None:
    """At the first view of an ambiguous place the confidence is low: heights stay as given."""
    localizer = Localizer(PLAN, CAMERA, config=LocalizerConfig(imu_sigma_deg=0.3))
    for i, pose in enumerate(spots(5, 3)):
        localizer.reset()
        wireframe = perturb(visible_wireframe(PLAN, CAMERA, pose, 1.4), CAMERA, 5.0, np.random.default_rng(i))
        estimate = localizer.step(wireframe, (0.0, 0.0))
        if estimate.confidence <= 0.9:
            assert localizer.heights == Heights()
    localizer.step(Wireframe.empty(), (0.0, 0.0))


def test_nothing_to_register() -> None:
    seen, layout = look(spots(1)[0], Heights(), 1.0, 0)
    t = tracker()
    assert t.update(seen) is None  # no pose yet
    t.start(spots(1)[0])
    blank = solve_layout(Wireframe.empty(), CAMERA, (0.0, 0.0))
    assert t.update(observation(blank, cast_rays(blank, CAMERA))) is None
    before = t.heights
    told = Layout(layout.points, layout.walls, layout.arcs, layout.heights, "ml", log_ratio=(before.k, before.k_sd))
    t.learn(told, (0.0, 0.01))  # a ratio no better known than before teaches nothing
    assert t.heights is before
