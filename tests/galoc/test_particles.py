"""The particle filter: weights, resampling, and that it finds a camera."""

import math
from typing import Any

import numpy as np
import pytest

from galoc import Camera, Floorplan, GalocError, Localizer
from galoc.detect.oracle import perturb
from galoc.metrics import pose_error
from galoc.observation import Observation, observation
from galoc.particles import ParticleFilter, systematic
from galoc_env.truth import visible_wireframe

PLAN = Floorplan.load("apartment")
CAMERA = Camera.from_hfov(640, 480, 108)


@pytest.fixture(scope="module")
def localizer() -> Localizer:
    return Localizer(PLAN, CAMERA)


def views(localizer: Localizer, steps: int, seed: int) -> list[tuple[np.ndarray, np.ndarray, Observation]]:
    """Pose, motion to it and view along a wandering walk: 2 px of noise."""
    rng = np.random.default_rng(seed)
    free = PLAN.free_space(0.05)
    places = free.positions(0.6)
    pose, out = np.array([*places[rng.integers(len(places))], rng.uniform(-np.pi, np.pi)]), []
    move = np.zeros(3)
    for _ in range(steps):
        seen = perturb(visible_wireframe(PLAN, CAMERA, pose, 1.4), CAMERA, 2.0, rng)
        out.append((pose.copy(), move, observation(*localizer.observe(seen, (0.0, 0.0)))))
        ahead = pose[:2] + 0.25 * np.array([math.cos(pose[2]), math.sin(pose[2])])
        clear = free.clearance_at(ahead[None])[0] > 0.5
        move = np.array([0.25, 0.0, rng.uniform(-0.2, 0.2)]) if clear else np.array([0.0, 0.0, 0.5])
        pose = np.array([*(ahead if clear else pose[:2]), pose[2] + move[2]])
    return out


def filter_of(localizer: Localizer, count: int = 5000, **options: Any) -> ParticleFilter:
    assert localizer.likelihood is not None
    return ParticleFilter(localizer.likelihood, count, rng=np.random.default_rng(0), **options)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_finds_the_camera_on_a_walk(localizer: Localizer, seed: int) -> None:
    particles = filter_of(localizer)
    walk = views(localizer, 30, seed)
    for _, move, seen in walk:
        particles.predict(move)
        particles.update(seen)
        assert particles.weights.sum() == pytest.approx(1.0, abs=1e-12)
        assert particles.weights.min() >= 0.0
    found, mass = particles.estimate()
    error_m, error_rad = pose_error(found, walk[-1][0])
    assert error_m < 0.3 and error_rad < math.radians(5.0)  # scattered by 0.04 m and 2 degrees each step
    assert 0.5 < mass <= 1.0 + 1e-12


def test_starts_all_over_the_free_space(localizer: Localizer) -> None:
    particles = filter_of(localizer, 20000)
    rows = particles.rows()
    assert rows.min() >= 0
    counts = np.bincount(rows, minlength=len(localizer.field.positions))
    middle = np.median(localizer.field.positions[:, 0])
    left = counts[localizer.field.positions[:, 0] < middle].sum() / 20000
    expected = np.mean(localizer.field.positions[:, 0] < middle)
    assert left == pytest.approx(expected, abs=0.015)  # four standard deviations of 20 000 draws
    assert np.bincount(((particles.poses[:, 2] + np.pi) // (np.pi / 2)).astype(int)).min() > 4700


def test_resampling_is_unbiased_and_systematic() -> None:
    """A particle of weight w comes back floor or ceil of C w times, and C w times in the mean."""
    rng = np.random.default_rng(1)
    weights = rng.gamma(0.5, size=40)
    weights /= weights.sum()
    counts = np.array([np.bincount(systematic(weights, rng), minlength=40) for _ in range(4000)])
    assert (counts >= np.floor(40 * weights)).all() and (counts <= np.ceil(40 * weights)).all()
    # A count varies by at most half: five standard deviations of the mean of 4000.
    np.testing.assert_allclose(counts.mean(axis=0), 40 * weights, atol=5 * 0.5 / math.sqrt(4000))


def test_resampling_keeps_what_is_believed(localizer: Localizer) -> None:
    particles = filter_of(localizer, 4000)
    particles.weights = np.random.default_rng(2).gamma(0.3, size=4000)
    particles.weights /= particles.weights.sum()
    before, effective = particles.weights @ particles.poses[:, :2], particles.effective
    assert effective < 2000
    particles.resample()
    assert particles.effective == pytest.approx(4000)
    np.testing.assert_allclose(particles.weights @ particles.poses[:, :2], before, atol=0.05)  # m; plan of 11 m


def test_motion_has_the_noise_it_is_told(localizer: Localizer) -> None:
    particles = filter_of(localizer, 20000, odometry_noise=0.1, odometry_turn_rad=0.05)
    particles.poses[:] = (3.0, 3.0, 0.0)
    particles.predict((1.0, 0.0, math.pi / 2))
    np.testing.assert_allclose(particles.poses.mean(axis=0), (4.0, 3.0, math.pi / 2), atol=0.005)
    np.testing.assert_allclose(
        particles.poses.std(axis=0), (0.14, 0.14, 0.0849), rtol=0.03
    )  # 0.04 m and 2 degrees more than told
    particles.predict((0.0, 0.0, 0.0))
    assert np.isfinite(particles.weights).all()


def test_particles_outside_do_not_count_as_long_as_some_are_inside(localizer: Localizer) -> None:
    particles = filter_of(localizer, 100)
    inside = particles.poses[0].copy()
    particles.poses[:] = (-30.0, 0.0, 0.0)
    particles.predict((0.0, 0.0, 0.0))
    assert particles.weights.sum() == pytest.approx(1.0)  # all outside: nothing is known, nothing breaks
    particles.poses[0] = inside
    particles.predict((0.0, 0.0, 0.0))
    assert particles.weights[0] > 0.99
    np.testing.assert_allclose(particles.estimate()[0][:2], inside[:2], atol=0.2)  # five standard deviations of a step


def test_a_heading_across_the_wrap_is_averaged_on_the_circle(localizer: Localizer) -> None:
    particles = filter_of(localizer, 2)
    particles.poses[:] = [(3.0, 3.0, math.pi - 0.05), (3.0, 3.0, -math.pi + 0.05)]
    assert abs(abs(particles.estimate()[0][2]) - math.pi) < 1e-9


@pytest.mark.parametrize("count", [0, -1, 2.5, True])
def test_bad_count(localizer: Localizer, count: Any) -> None:
    with pytest.raises(GalocError, match="count"):
        filter_of(localizer, count)


@pytest.mark.parametrize(
    ("name", "value"),
    [("odometry_noise", math.nan), ("odometry_noise", -1.0), ("odometry_turn_rad", -1.0), ("rng", None)],
)
def test_bad_settings(localizer: Localizer, name: str, value: Any) -> None:
    assert localizer.likelihood is not None
    with pytest.raises(GalocError, match=name):
        ParticleFilter(localizer.likelihood, 10, **({"rng": np.random.default_rng(0)} | {name: value}))


def test_particles_may_be_carried_off_any_distance(localizer: Localizer) -> None:
    particles = filter_of(localizer, 10)
    particles.predict((1e290, 0.0, 0.0))
    assert np.all(particles.rows() == -1)
    assert particles.weights.sum() == pytest.approx(1.0)
