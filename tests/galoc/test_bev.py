"""The inscribed-angle camera position."""

import numpy as np
import pytest

from galoc.bev import inscribed_position


def chain(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    azimuth = np.sort(rng.uniform(-0.8, 0.8, 6))
    azimuth[0], azimuth[-1] = -0.8 - 0.1 * rng.random(), 0.8 + 0.1 * rng.random()
    r = rng.uniform(2.0, 6.0, 6)
    return np.stack([r * np.sin(azimuth), r * np.cos(azimuth)], axis=1)


def subtended(points: np.ndarray, camera: np.ndarray) -> float:
    a, b = points[0] - camera, points[-1] - camera
    return float(np.arctan2(abs(a[0] * b[1] - a[1] * b[0]), a @ b))


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("angle", [0.9, 1.5, 1.7, 2.2])
def test_the_chain_subtends_the_angle(seed: int, angle: float) -> None:
    points = chain(seed)
    assert subtended(points, inscribed_position(points, angle)) == pytest.approx(angle, abs=1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_identity_when_the_angle_is_already_right(seed: int) -> None:
    """Measured on the chain itself the step moves nothing: it gains nothing of its own."""
    points = chain(seed)
    angle = subtended(points, np.zeros(2))
    np.testing.assert_allclose(inscribed_position(points, angle), 0.0, atol=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_nearest_point_of_the_circle(seed: int) -> None:
    """No other camera position that subtends the angle lies closer to the origin."""
    points = chain(seed)
    angle = subtended(points, np.zeros(2)) + 0.1
    best = inscribed_position(points, angle)
    for direction in np.linspace(0.0, 2 * np.pi, 720, endpoint=False):
        nearer = 0.99 * np.hypot(*best) * np.array([np.cos(direction), np.sin(direction)])
        assert subtended(points, nearer) != pytest.approx(angle, abs=1e-9)


def test_scale_equivariant() -> None:
    points = chain(1)
    np.testing.assert_allclose(inscribed_position(7.0 * points, 1.6), 7.0 * inscribed_position(points, 1.6), rtol=1e-12)


@pytest.mark.parametrize("points", [np.zeros((0, 2)), np.ones((1, 2)), np.ones((2, 2))])
def test_degenerate_chains_stay_put(points: np.ndarray) -> None:
    np.testing.assert_array_equal(inscribed_position(points, 1.0), np.zeros(2))
