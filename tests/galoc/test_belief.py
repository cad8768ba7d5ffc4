"""The histogram filter: exact shifts, conserved mass, calibrated bookkeeping."""

import math

import numpy as np
import pytest

from galoc import Floorplan, GalocError
from galoc.belief import Belief
from galoc.metrics import pose_error
from galoc.profiles import ProfileField, profile_field

ROOM = Floorplan.from_segments(np.array([[0, 0, 8, 0], [8, 0, 8, 6], [8, 6, 0, 6], [0, 6, 0, 0]], float))


@pytest.fixture(scope="module")
def field() -> ProfileField:
    return profile_field(ROOM, 0.1)


def certain(field: ProfileField, xy: tuple[float, float], heading_deg: int, **options: object) -> Belief:
    """A belief that holds one cell for sure."""
    belief = Belief(field, **options)  # type: ignore[arg-type]
    belief.log_p[:] = -80.0
    belief.log_p[field.nearest(xy), heading_deg % 360] = 0.0
    return belief


def test_starts_uniform(field: ProfileField) -> None:
    belief = Belief(field)
    assert belief.entropy() == pytest.approx(math.log(belief.log_p.size), abs=1e-6)
    assert belief.position_marginal().sum() == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("move", "expected"),
    [
        ((1.0, 0.0, 0.0), (4.05, 3.05, 0)),  # a 1 m step forward
        ((0.0, 0.0, math.pi / 2), (3.05, 3.05, 90)),  # a quarter turn
        ((1.0, 0.0, math.pi / 2), (4.05, 3.05, 90)),  # motion is in the body frame before the turn
        ((0.0, 0.7, 0.0), (3.05, 3.75, 0)),  # left is +y at heading 0
        ((-0.5, -0.5, -math.pi), (2.55, 2.55, 180)),
    ],
)
def test_one_large_motion(field: ProfileField, move: tuple, expected: tuple) -> None:
    belief = certain(field, (3.05, 3.05), 0)
    belief.predict(move)
    error_m, error_rad = pose_error(belief.peak(), (expected[0], expected[1], math.radians(expected[2])))
    assert error_m < 1e-6 and error_rad < 1e-6


@pytest.mark.parametrize("heading_deg", [0, 37, 90, 211])
def test_many_small_steps_equal_one_long_one(field: ProfileField, heading_deg: int) -> None:
    """40 steps of 3 cm and 1.3 degrees: what rounding leaves over is carried, so half a cell bounds the difference."""
    belief = certain(field, (4.05, 3.05), heading_deg)
    pose = np.array([*belief.positions[field.nearest((4.05, 3.05))], math.radians(heading_deg)])
    for _ in range(40):
        pose[:2] += 0.03 * np.array([math.cos(pose[2]), math.sin(pose[2])])
        pose[2] += math.radians(1.3)
        belief.predict((0.03, 0.0, math.radians(1.3)))
    # The cell's own heading is whole degrees while it moves: 0.5 degree over 1.2 m of path is 1 cm.
    error_m, error_rad = pose_error(belief.peak(), pose)
    assert error_m < 0.012
    assert error_rad < math.radians(0.05)


def test_rounded_motion_loses_slow_steps(field: ProfileField) -> None:
    """A plain integer shift never moves at 3 cm a step on a 10 cm grid: the reason why the remainder is carried."""
    belief = certain(field, (3.05, 3.05), 0, motion="rounded")
    for _ in range(40):
        belief.predict((0.03, 0.0, 0.0))
    assert pose_error(belief.peak(), (3.05, 3.05, 0.0))[0] < 1e-6


def test_full_circle_returns_every_cell(field: ProfileField) -> None:
    rng = np.random.default_rng(0)
    belief = Belief(field)
    belief.log_p[:] = rng.normal(0.0, 3.0, belief.log_p.shape)
    belief.log_p -= belief.log_p.max()
    before = belief.log_p.copy()
    for _ in range(4):
        belief.predict((0.0, 0.0, math.pi / 2))
    np.testing.assert_allclose(belief.log_p, before, atol=1e-4)


@pytest.mark.parametrize(
    "options", [{"diffusion_m": 0.2}, {"diffusion_rad": 0.05}, {"diffusion_m": 0.3, "diffusion_rad": 0.1}]
)
def test_diffusion_spreads(field: ProfileField, options: dict) -> None:
    belief = certain(field, (4.05, 3.05), 0, **options)
    sharp = belief.entropy()
    belief.predict((0.5, 0.0, 0.0))
    assert belief.entropy() > sharp + 0.5
    assert belief.position_marginal().sum() == pytest.approx(1.0, abs=1e-12)
    assert pose_error(belief.peak(), (4.55, 3.05, 0.0))[0] < 0.02


def test_blur_conserves_mass_away_from_walls(field: ProfileField) -> None:
    from galoc.belief import _blur_headings, _blur_positions, _kernel

    p = np.zeros((len(field.positions), 360), np.float32)
    p[field.nearest((4.0, 3.0)), 10] = 1.0
    taps = _kernel(1.3)
    assert taps.sum() == pytest.approx(1.0)
    assert _blur_positions(p, field.cell, field.index, taps).sum() == pytest.approx(1.0, abs=1e-5)
    assert _blur_headings(p, taps).sum() == pytest.approx(1.0, abs=1e-5)


def test_update_is_bayes_with_weight(field: ProfileField) -> None:
    scores = np.zeros((len(field.positions), 360), np.float32)
    scores[7, 30] = 1.0
    belief = Belief(field)
    belief.update(scores, 0.25)
    assert belief.log_p[7, 30] == 0.0
    assert belief.log_p[8, 31] == pytest.approx(0.25 * (math.log(0.01) - math.log(1.01)), abs=1e-5)


def test_blind_frame_says_nothing(field: ProfileField) -> None:
    belief = Belief(field)
    belief.update(np.zeros(belief.log_p.shape, np.float32), 0.01)
    assert belief.entropy() == pytest.approx(math.log(belief.log_p.size), abs=1e-4)


def test_mass_leaving_the_room_does_not_poison_the_belief(field: ProfileField) -> None:
    belief = certain(field, (7.55, 3.05), 0)
    belief.predict((3.0, 0.0, 0.0))  # through the wall
    assert np.all(np.isfinite(belief.log_p)) and belief.log_p.max() == 0.0


def test_mass_near(field: ProfileField) -> None:
    belief = certain(field, (4.05, 3.05), 90)
    assert belief.mass_near((4.05, 3.05, math.pi / 2), 0.5) == pytest.approx(1.0)
    assert belief.mass_near((4.05, 3.05, -math.pi / 2), 0.5, 0.3) == pytest.approx(0.0, abs=1e-12)
    assert belief.mass_near((1.0, 1.0, 0.0), 0.5) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("odometry", [(0.0, 0.0), (math.nan, 0.0, 0.0), (math.inf, 0.0, 0.0), "abc"])
def test_bad_odometry(field: ProfileField, odometry: object) -> None:
    with pytest.raises(GalocError, match="odometry"):
        Belief(field).predict(odometry)  # type: ignore[arg-type]


def test_unknown_motion(field: ProfileField) -> None:
    with pytest.raises(GalocError, match="motion"):
        Belief(field, motion="fast")
