"""The posterior of one image: mass near a position against sampling, and what happens without nodes."""

import math

import numpy as np
import pytest

from galoc import Floorplan
from galoc.likelihood import Likelihood
from galoc.observation import Observation
from galoc.posterior import locate_modes, probability_near
from galoc.profiles import profile_field
from galoc.register import LOCAL_SD, Modes


def modes_of(poses: list[list[float]], spreads: list[np.ndarray], mass: list[float]) -> Modes:
    covariance = np.zeros((len(poses), 4, 4))
    covariance[:, 2, 2] = covariance[:, 3, 3] = 0.01
    covariance[:, :2, :2] = spreads
    return Modes(np.array(poses, float), covariance, np.array(mass, float), np.zeros((len(poses), 2), np.int64))


@pytest.mark.parametrize("seed", range(6))
def test_mass_near_a_position_equals_sampling(seed: int) -> None:
    """128 points per mode stand for a Gaussian: within 0.03 of 200 000 samples of the mixture."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 5))
    poses = [[*rng.uniform(-0.5, 0.5, 2), 0.0, 0.0] for _ in range(count)]
    roots = [rng.uniform(-0.4, 0.4, (2, 2)) for _ in range(count)]
    mass = list(rng.uniform(-2.0, 0.0, count) - 500.0)  # only differences count
    modes = modes_of(poses, [r @ r.T + 1e-6 * np.eye(2) for r in roots], mass)
    weight = np.exp(np.array(mass) + 500.0)
    which = rng.choice(count, 200_000, p=weight / weight.sum())
    sample = np.array(poses)[which, :2] + np.einsum(
        "nij,nj->ni", np.array(roots)[which], rng.standard_normal((200_000, 2))
    )
    for radius in (0.2, 0.5):
        share = np.mean(np.hypot(*sample.T) < radius)
        assert probability_near(modes, np.zeros(2), radius) == pytest.approx(share, abs=0.03)


def test_sharp_modes_count_by_their_mass() -> None:
    tiny = 1e-8 * np.eye(2)
    modes = modes_of([[0, 0, 0, 0], [0.3, 0, 1, 0], [9, 9, 0, 0]], [tiny] * 3, [0.0, math.log(0.5), math.log(0.5)])
    assert probability_near(modes, np.zeros(2)) == pytest.approx(0.75)
    assert probability_near(modes, np.array([9.0, 9.0])) == pytest.approx(0.25)
    assert probability_near(modes, np.array([-50.0, 0.0])) == 0.0


def test_an_image_of_walls_alone_keeps_the_cells() -> None:
    """A laser's rays without a chain: the modes are the best cells, as wide as the cells they stand for."""
    field = profile_field(Floorplan.load("apartment"), 0.2)
    likelihood = Likelihood(field)
    row = len(field.positions) // 2
    bearing = np.arange(-54, 55)
    ranges = field.ranges[row, (40 + bearing) % 360].astype(float)
    none = np.zeros(0, bool)
    seen = Observation(
        np.log(ranges), np.full(109, 1e-3), np.zeros(109, bool), -np.radians(bearing), np.zeros((0, 2)),
        np.zeros((0, 0)), none, none.astype(np.int64), 0.1,
    )  # fmt: skip
    modes = locate_modes(likelihood, seen, 8)
    assert len(modes) == 8 and np.all(np.diff(modes.log_mass) <= 0.0)
    assert np.hypot(*(modes.poses[0, :2] - field.positions[row])) < 0.3
    np.testing.assert_allclose(np.diag(modes.covariances[0]), [*np.square(LOCAL_SD), 0.01])
    assert 0.0 < probability_near(modes, modes.poses[0, :2]) <= 1.0
