"""The histogram filter: exact shifts, conserved mass, calibrated bookkeeping."""

import math
from typing import Any

import numpy as np
import pytest

from galoc import Floorplan, GalocError
from galoc.belief import Belief, gaussian_taps
from galoc.cells import cosine_cells, likely_cells
from galoc.likelihood import Likelihood
from galoc.mass import LEAST
from galoc.metrics import pose_error
from galoc.observation import observation
from galoc.profiles import ProfileField, profile_field
from galoc.types import Layout, Rays


def room(*corners: tuple[float, float]) -> Floorplan:
    ends = np.array(corners, dtype=float)
    return Floorplan.from_segments(np.hstack([ends, np.roll(ends, -1, axis=0)]))


ROOM = room((0, 0), (8, 0), (8, 6), (0, 6))
ELL = room((0, 0), (5, 0), (5, 2), (2, 2), (2, 4), (0, 4))
PAIR = Floorplan.from_segments(
    np.array(
        [
            [0, 0, 4, 0], [4, 0, 4, 3], [4, 3, 0, 3], [0, 3, 0, 0],
            [6, 0, 12, 0], [12, 0, 12, 5], [12, 5, 8, 5], [8, 5, 8, 2.5], [8, 2.5, 6, 2.5], [6, 2.5, 6, 0],
        ],
        float,
    )
)  # fmt: skip
"""Two rooms without a way from one to the other."""


@pytest.fixture(scope="module")
def field() -> ProfileField:
    return profile_field(ROOM, 0.1)


@pytest.fixture(scope="module")
def ell() -> ProfileField:
    return profile_field(ELL, 0.1)


def certain(field: ProfileField, xy: tuple[float, float], heading_deg: float, **options: Any) -> Belief:
    """A belief that holds one cell for sure."""
    belief = Belief(field, **options)
    p = np.zeros(belief.p.shape)
    p[field.nearest(xy), int(heading_deg % 360 / belief.group)] = 1.0
    belief.set(p)
    return belief


def cell_of(field: ProfileField, xy: tuple[float, float], belief: Belief, heading_deg: float) -> np.ndarray:
    """Pose of a cell's centre."""
    centre = belief.headings_rad[int(heading_deg % 360 / belief.group)]
    return np.array([*field.positions[field.nearest(xy)], centre])


class Scatter:
    """The prediction in words: every cell sends its mass along its own motion; what does not fit the grid is kept."""

    def __init__(self, field: ProfileField, p: np.ndarray) -> None:
        self.field, self.p = field, p.astype(np.float64)
        self.headings = p.shape[1]
        self.rest = np.zeros((self.headings, 2))
        self.rest_deg = 0.0

    def predict(self, move: tuple[float, float, float]) -> None:
        group = 360 // self.headings
        out, rest = np.zeros_like(self.p), np.zeros_like(self.rest)
        turn = math.degrees(move[2]) + self.rest_deg
        bins = round(turn / group)
        for v in range(self.headings):
            heading = math.radians(v * group + (group - 1) / 2 + self.rest_deg)
            dx = move[0] * math.cos(heading) - move[1] * math.sin(heading) + self.rest[v, 0]
            dy = move[0] * math.sin(heading) + move[1] * math.cos(heading) + self.rest[v, 1]
            right, up = round(dx / self.field.resolution), round(dy / self.field.resolution)
            to = (v + bins) % self.headings
            rest[to] = dx - right * self.field.resolution, dy - up * self.field.resolution
            row, column = self.field.cell[:, 0] + up, self.field.cell[:, 1] + right
            height, width = self.field.index.shape
            inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
            goal = self.field.index[np.where(inside, row, 0), np.where(inside, column, 0)]
            goes = inside & (goal >= 0)
            out[goal[goes], to] += self.p[goes, v]
        self.p, self.rest, self.rest_deg = out / out.sum(), rest, turn - bins * group


def test_starts_uniform(field: ProfileField) -> None:
    belief = Belief(field)
    assert belief.entropy() == pytest.approx(math.log(belief.size), abs=1e-6)
    assert belief.position_marginal().sum() == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(belief.p, 1.0 / belief.size, rtol=1e-6)


@pytest.mark.parametrize("headings", [36, 72, 360])
def test_prediction_is_every_cell_scattered_by_its_own_motion(ell: ProfileField, headings: int) -> None:
    """Metre steps and quarter turns in an L-shaped room: corners are cut, mass is lost, remainders are carried."""
    p = np.random.default_rng(headings).gamma(0.3, size=(len(ell.positions), headings))
    belief, words = Belief(ell, headings=headings), Scatter(ell, p)
    belief.set(p)
    words.p /= words.p.sum()
    for move in ((1.0, 0.0, 0.0), (0.0, 0.0, math.pi / 2), (0.33, -0.14, 0.41), (-0.27, 0.0, -1.3)):
        belief.predict(move)
        words.predict(move)
        assert belief.p.sum(dtype=np.float64) == pytest.approx(1.0, abs=1e-6)  # float32 cells
        # Cells at the floor of a belief count for exp(LEAST) of the best instead of 0.
        np.testing.assert_allclose(belief.p, words.p, rtol=2e-5, atol=1e-20)


@pytest.mark.parametrize("headings", [36, 72, 360])
@pytest.mark.parametrize(
    ("move", "expected"),
    [
        ((1.0, 0.0, 0.0), (1.0, 0.0, 0)),  # a kernel of seven taps would make 0.3 m of it
        ((0.0, 0.0, math.pi / 2), (0.0, 0.0, 90)),  # and NaN of this
        ((1.0, 0.0, math.pi / 2), (1.0, 0.0, 90)),  # motion is in the body frame before the turn
        ((0.0, 0.7, 0.0), (0.0, 0.7, 0)),
        ((-0.5, -0.5, -math.pi), (-0.5, -0.5, 180)),
    ],
)
def test_one_large_motion(field: ProfileField, headings: int, move: tuple, expected: tuple) -> None:
    belief = certain(field, (3.05, 3.05), 0, headings=headings)
    x, y, heading = cell_of(field, (3.05, 3.05), belief, 0)
    belief.predict(move)
    c, s = math.cos(heading), math.sin(heading)
    there = (x + c * expected[0] - s * expected[1], y + s * expected[0] + c * expected[1])
    error_m, error_rad = pose_error(belief.peak(), (*there, heading + math.radians(expected[2])))
    assert error_m < 1e-6 and error_rad < 1e-6
    assert np.isfinite(belief.p).all()


@pytest.mark.parametrize("headings", [36, 72, 360])
@pytest.mark.parametrize("heading_deg", [0, 37, 90, 211])
def test_many_small_steps_equal_one_long_one(field: ProfileField, headings: int, heading_deg: int) -> None:
    """40 steps of 3 cm and 1.3 degrees: what rounding leaves over is carried, exactly."""
    belief = certain(field, (4.05, 3.05), heading_deg, headings=headings)
    pose = cell_of(field, (4.05, 3.05), belief, heading_deg)
    for _ in range(40):
        pose[:2] += 0.03 * np.array([math.cos(pose[2]), math.sin(pose[2])])
        pose[2] += math.radians(1.3)
        belief.predict((0.03, 0.0, math.radians(1.3)))
    error_m, error_rad = pose_error(belief.peak(), pose)
    assert error_m < 1e-6 and error_rad < 1e-6


def test_heading_cells_turn_along_by_whole_degrees(field: ProfileField) -> None:
    """A turn of 3 degrees moves no bin of 10: the cells then hold the degrees that are 3 further, and are scored so."""
    belief = certain(field, (4.05, 3.05), 40, headings=36)
    belief.predict((0.0, 0.0, math.radians(3.0)))
    assert belief.turned_deg == 3
    assert belief.headings_rad[4] == pytest.approx(math.radians(47.5))
    belief.predict((0.0, 0.0, math.radians(3.0)))  # 6 in all: one bin on, 4 back
    assert belief.turned_deg == -4
    assert belief.peak()[2] == pytest.approx(math.radians(50.5), abs=1e-6)


def test_paper_motion_loses_slow_steps(field: ProfileField) -> None:
    """A plain integer shift never moves at 3 cm a step on a 10 cm grid: the reason why the remainder is carried."""
    belief = certain(field, (3.05, 3.05), 0, motion="paper", headings=72)
    start = belief.peak()
    for _ in range(40):
        belief.predict((0.03, 0.0, math.radians(2.0)))
    assert pose_error(belief.peak(), start) == pytest.approx((0.0, 0.0), abs=1e-6)
    belief.predict((1.0, 0.0, math.radians(90.0)))
    assert pose_error(belief.peak(), start)[0] == pytest.approx(1.0, abs=0.051)  # half a cell


@pytest.mark.parametrize("headings", [72, 360])
def test_full_circle_returns_every_cell(field: ProfileField, headings: int) -> None:
    belief = Belief(field, headings=headings)
    belief.set(np.exp(np.random.default_rng(0).normal(0.0, 3.0, belief.p.shape)))
    before = belief.p.copy()
    for _ in range(4):
        belief.predict((0.0, 0.0, math.pi / 2))
    np.testing.assert_allclose(belief.p, before, rtol=1e-5)


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


def test_diffusion_has_the_variance_that_is_due(field: ProfileField) -> None:
    """0.3 m per metre over a step of 1 m, far from walls: 0.3 m along each axis; 5 degrees of heading."""
    belief = certain(field, (3.55, 3.05), 0, diffusion_m=0.3, diffusion_rad=math.radians(5.0))
    belief.predict((1.0, 0.0, 0.0))
    spread = np.sqrt(belief.position_marginal() @ (field.positions - (4.55, 3.05)) ** 2)
    np.testing.assert_allclose(spread, 0.3, rtol=0.03)  # taps end at three standard deviations: 1.3 % less
    degrees = (np.arange(360) + 180) % 360 - 180
    assert math.sqrt(belief.p.sum(axis=0, dtype=np.float64) @ degrees**2) == pytest.approx(5.0, rel=0.03)


def test_diffusion_at_walls_loses_no_mass(ell: ProfileField) -> None:
    """Spreading is symmetric and what a wall stops stays: uniform stays uniform, and no cell of the sum goes."""
    belief = Belief(ell, headings=36, diffusion_m=1.0, diffusion_rad=0.2)
    p = np.random.default_rng(1).gamma(0.2, size=belief.p.shape)
    belief.set(p)
    uniform = Belief(ell, headings=36, diffusion_m=1.0, diffusion_rad=0.2)
    uniform.set(np.ones(p.shape))
    for b in (belief, uniform):
        b._diffuse(0.3, moved=True)
        assert b._mass.total == pytest.approx(1.0, abs=1e-5)  # before anything is renormalised; float32 sums
    np.testing.assert_allclose(uniform.p, 1.0 / uniform.size, rtol=1e-5)
    assert belief.p.max() < p.max() / p.sum()


def test_update_is_bayes_with_weight(field: ProfileField) -> None:
    rng = np.random.default_rng(2)
    belief = Belief(field, headings=72)
    prior, scores = rng.gamma(1.0, size=belief.p.shape), rng.uniform(0.0, 1.0, belief.p.shape)
    scores[7, 30], scores[8, 31] = 1.0, 0.0
    belief.set(prior)
    belief.update(scores, 0.25)
    expected = prior * (0.01 + scores) ** 0.25
    np.testing.assert_allclose(belief.p, expected / expected.sum(), rtol=1e-5)


def test_add_is_bayes_down_to_the_floor(field: ProfileField) -> None:
    rng = np.random.default_rng(3)
    belief = Belief(field, headings=72)
    prior, log_likelihood = rng.gamma(1.0, size=belief.p.shape), rng.normal(0.0, 6.0, belief.p.shape)
    belief.set(prior)
    belief.add(log_likelihood, -8.0, temper=0.9, frame_floor=-12.0)
    expected = prior * np.exp(0.9 * np.maximum(log_likelihood - log_likelihood.max(), -12.0))
    expected = np.maximum(expected, math.exp(-8.0) * expected.max())
    np.testing.assert_allclose(belief.p, expected / expected.sum(), rtol=2e-5)
    assert belief.p.min() == pytest.approx(math.exp(-8.0) * belief.p.max(), rel=1e-5)


def test_positions_that_were_not_scored_are_at_the_floor_of_the_frame(field: ProfileField) -> None:
    """A list of positions says the same as all positions with the others hopeless, whatever was believed before."""
    rng = np.random.default_rng(4)
    shape = Belief(field, headings=36).p.shape
    some = np.sort(rng.permutation(shape[0])[: shape[0] // 3])
    prior, log_likelihood = rng.gamma(0.1, size=shape), rng.normal(0.0, 6.0, (len(some), shape[1]))
    everything = np.full(shape, -1e6)
    everything[some] = log_likelihood
    both = []
    for rows, scores in ((some, log_likelihood), (None, everything)):
        belief = Belief(field, headings=36)
        belief.set(prior)
        for _ in range(4):
            belief.add(scores, -25.0, rows=rows, temper=0.9, frame_floor=-12.0)
        both.append(belief)
    np.testing.assert_allclose(both[0].p, both[1].p, rtol=1e-4)
    assert both[0].entropy() == pytest.approx(both[1].entropy(), abs=1e-5)


def test_contradictory_frames_leave_numbers(field: ProfileField) -> None:
    """Each frame rules out what the last one said: nothing underflows, and the floor is kept."""
    belief = Belief(field, headings=72)
    frame = np.full(belief.p.shape, -500.0)
    frame[: len(frame) // 2] = 0.0
    for k in range(6):
        belief.add(frame[::-1] if k % 2 else frame)
        assert np.isfinite(belief.p).all()
        assert belief.p.sum(dtype=np.float64) == pytest.approx(1.0, abs=1e-5)
        assert belief.p.min() >= 0.99 * math.exp(LEAST) * belief.p.max() > 0.0


def test_sums_and_entropy_are_those_of_the_cells(ell: ProfileField) -> None:
    """What falls off the passes equals what the whole array says, after every operation, when most rows are idle."""
    belief = certain(ell, (1.05, 1.05), 50, headings=72, diffusion_m=0.3, diffusion_rad=0.1, kidnapped=1e-6)
    rng = np.random.default_rng(5)
    for k in range(6):
        belief.predict((0.1, 0.02, 0.3))
        if k % 2:
            belief.add(rng.normal(0.0, 2.0, belief.p.shape), -30.0, frame_floor=-5.0)
        elif k:
            belief.update(rng.uniform(0.0, 1.0, belief.p.shape), 0.3)
        marginal, entropy, peak = belief.position_marginal(), belief.entropy(), belief.peak()
        p = belief.p.astype(np.float64)
        p /= p.sum()
        np.testing.assert_allclose(marginal, p.sum(axis=1), rtol=1e-5)
        assert entropy == pytest.approx(-np.sum(p * np.log(p)), abs=1e-4)
        i, v = np.unravel_index(int(np.argmax(p)), p.shape)
        assert np.hypot(*(peak[:2] - ell.positions[i])) < 0.35  # placed within 3 cells of the best
        best = p.max(axis=1)
        np.testing.assert_array_equal(belief.best_rows(-10.0), np.flatnonzero(best > math.exp(-10.0) * best.max()))


def test_blind_frame_says_nothing(field: ProfileField) -> None:
    belief = Belief(field)
    belief.update(np.zeros(belief.p.shape), 0.01)
    assert belief.entropy() == pytest.approx(math.log(belief.size), abs=1e-4)


@pytest.mark.parametrize("move", [(3.0, 0.0, 0.0), (1e9, 0.0, 0.0), (1e250, -1e250, 1e250)])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_belief_that_leaves_the_room_is_uniform_again(field: ProfileField, move: tuple, noise: float) -> None:
    belief = certain(field, (7.55, 3.05), 0, diffusion_m=noise, diffusion_rad=noise)
    belief.predict(move)  # through the wall
    assert np.isfinite(belief.p).all()
    assert belief.entropy() == pytest.approx(math.log(belief.size), abs=1e-6)


def test_mass_near(field: ProfileField) -> None:
    belief = certain(field, (4.05, 3.05), 90)
    assert belief.mass_near((4.05, 3.05, math.pi / 2), 0.5) == pytest.approx(1.0)
    assert belief.mass_near((4.05, 3.05, -math.pi / 2), 0.5, 0.3) == pytest.approx(0.0, abs=1e-12)
    assert belief.mass_near((1.0, 1.0, 0.0), 0.5) == pytest.approx(0.0, abs=1e-12)
    assert belief.mass_near((-50.0, 1.0, 0.0), 0.5) == 0.0
    p = np.random.default_rng(6).uniform(size=belief.p.shape)
    belief.set(p)
    near = np.hypot(*(field.positions - (2.0, 0.3)).T) < 0.7
    facing = np.abs(np.radians((np.arange(360) + 180) % 360 - 180)) <= 0.5
    for angle, columns in ((math.pi, slice(None)), (0.5, facing)):
        expected = p[near][:, columns].sum() / p.sum()
        assert belief.mass_near((2.0, 0.3, 0.0), 0.7, angle) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("headings", [72, 360])
def test_peak_is_between_cells_where_every_heading_has_been_carried(field: ProfileField, headings: int) -> None:
    """A fan of headings moved by parts of a cell: the peak is the mean of where each has come to, weighed by p^2."""
    belief = certain(field, (4.05, 3.05), 90.0, headings=headings)
    weight = np.array([0.8, 1.0, 0.7])
    here = np.zeros_like(belief.p)
    row, column = np.unravel_index(int(np.argmax(belief.p)), belief.p.shape)
    here[row, column - 1 : column + 2] = weight
    belief.set(here)
    start, heading = field.positions[row], belief.headings_rad[column - 1 : column + 2]
    move = np.array([0.0, 0.0])
    for step in ((0.13, 0.04), (0.02, 0.0), (0.09, -0.06), (0.11, 0.01)):
        belief.predict((*step, 0.0))
        move += step
        c, s = np.cos(heading), np.sin(heading)
        ends = start + np.stack([c * move[0] - s * move[1], s * move[0] + c * move[1]], axis=1)
        # Single precision of the weights times the fan's width of a few centimetres.
        np.testing.assert_allclose(belief.peak()[:2], weight**2 @ ends / np.sum(weight**2), atol=1e-6)


@pytest.mark.parametrize("kidnapped", [0.0, 0.01])
def test_a_camera_that_is_carried_off_is_found_again_if_that_is_allowed(kidnapped: float) -> None:
    """Twelve turning views in one room, eight in another that no motion leads to."""
    field = profile_field(PAIR, 0.2)
    belief = Belief(field, headings=72, diffusion_m=0.05, diffusion_rad=0.02, kidnapped=kidnapped)
    found = []
    for xy, views in (((1.5, 1.1), 12), ((10.3, 2.9), 8)):
        profile = field.caster(xy)[0]
        for k in range(views):
            degree = 47 + 30 * k
            ranges = profile[(degree + np.arange(109) - 54) % 360].astype(float)
            rays = Rays(ranges, np.ones(109, bool), np.full(109, 1e-3))
            belief.predict((0.0, 0.0, math.radians(30.0) if k else 0.0))
            # The cosine is a blunt likelihood: sharpened, so that some views settle.
            belief.update(cosine_cells(field, rays, belief), 6.0)
        found.append(pose_error(belief.peak(), (*xy, math.radians(degree)))[0])
    assert found[0] < 0.3
    assert (found[1] < 0.3) == (kidnapped > 0.0)


@pytest.mark.parametrize("scoring", ["cosine", "likelihood"])
def test_frames_are_scored_at_the_degrees_that_the_cells_hold(field: ProfileField, scoring: str) -> None:
    """After a turn by half a cell the same frame scores as one taken half a cell on."""
    likelihood = Likelihood(field)
    profile = field.caster((2.3, 2.0))[0]

    def scores(belief: Belief, degree: int) -> np.ndarray:
        ranges = profile[(degree + np.arange(109) - 54) % 360].astype(float)
        rays = Rays(ranges, np.ones(109, bool), np.full(109, 1e-3))
        if scoring == "cosine":
            return cosine_cells(field, rays, belief)
        return likely_cells(likelihood, observation(Layout.unknown("ml"), rays), belief, everywhere=True)[0]

    belief, turned = Belief(field, headings=36), Belief(field, headings=36)
    turned.predict((0.0, 0.0, math.radians(4.0)))
    here = field.nearest((2.3, 2.0))
    # Uniform beliefs: only the cells' degrees differ. The camera faces the middle of cell 7, then of the turned cell 7.
    first, second = scores(belief, 74)[here], scores(turned, 78)[here]
    assert np.argmax(first) == np.argmax(second) == 7
    np.testing.assert_allclose(second[7], first[7], atol=0.02 if scoring == "cosine" else 1.0)
    beside = scores(belief, 78)[here]
    assert beside[7] < second[7]


def test_taps_are_a_distribution() -> None:
    for sd in (0.4, 1.3, 5.0):
        taps = gaussian_taps(sd)
        assert taps.sum() == pytest.approx(1.0, abs=1e-6)
        np.testing.assert_array_equal(taps, taps[::-1])


@pytest.mark.parametrize("odometry", [(0.0, 0.0), (math.nan, 0.0, 0.0), (math.inf, 0.0, 0.0), "abc"])
def test_bad_odometry(field: ProfileField, odometry: object) -> None:
    with pytest.raises(GalocError, match="odometry"):
        Belief(field).predict(odometry)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("motion", "fast"), ("headings", 7), ("headings", 0), ("headings", True), ("headings", 36.0),
        ("kidnapped", 1.0), ("kidnapped", -0.1), ("kidnapped", math.nan), ("kidnapped", "x"),
    ],
)  # fmt: skip
def test_bad_settings(field: ProfileField, name: str, value: Any) -> None:
    with pytest.raises(GalocError, match=name):
        Belief(field, **{name: value})


def test_bad_observations(field: ProfileField) -> None:
    belief = Belief(field, headings=36)
    with pytest.raises(GalocError, match="shape"):
        belief.update(np.zeros((3, 36)), 1.0)
    with pytest.raises(GalocError, match="shape"):
        belief.add(np.zeros((3, 36)), rows=np.arange(4))
    with pytest.raises(GalocError, match="finite"):
        belief.add(np.full(belief.p.shape, -np.inf))
    for weights in (np.zeros(belief.p.shape), np.full(belief.p.shape, -1.0), np.full(belief.p.shape, np.nan)):
        with pytest.raises(GalocError, match="weights"):
            belief.set(weights)


@pytest.mark.parametrize("name", ["diffusion_m", "diffusion_rad"])
@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf, "x", None, True])
def test_bad_diffusion(field: ProfileField, name: str, value: Any) -> None:
    with pytest.raises(GalocError, match=name):
        Belief(field, **{name: value})


def test_refused_observations_leave_the_belief_as_it_was(field: ProfileField) -> None:
    belief = Belief(field, headings=36)
    scores = np.random.default_rng(4).random(belief.p.shape)
    belief.update(scores, 1.0)
    before, entropy = belief.p.copy(), belief.entropy()
    one_bad = {
        bad: np.where(np.arange(scores.size).reshape(scores.shape) == 5, bad, scores) for bad in (math.nan, -1.0)
    }
    few = scores[:3]
    refused: list[tuple[str, Any]] = [
        ("scores", lambda: belief.update(one_bad[math.nan], 1.0)),
        ("scores", lambda: belief.update(one_bad[-1.0], 1.0)),
        ("scores", lambda: belief.update(scores * math.inf, 1.0)),
        ("dtype", lambda: belief.update("x", 1.0)),
        ("confidence", lambda: belief.update(scores, math.nan)),
        ("confidence", lambda: belief.update(scores, 1e9)),
        ("finite", lambda: belief.add(one_bad[math.nan])),
        ("temper", lambda: belief.add(scores, temper=-1.0)),
        ("frame_floor", lambda: belief.add(scores, frame_floor=math.nan)),
        ("least", lambda: belief.add(scores, 1.0)),
        ("positions from 0", lambda: belief.add(few, rows=np.array([0, 1, len(scores)]))),
        ("positions from 0", lambda: belief.add(few, rows=np.array([0, 1, -1]))),
        ("twice", lambda: belief.add(few, rows=np.array([0, 1, 1]))),
        ("whole numbers", lambda: belief.add(few, rows=np.array([0.0, 1.0, 2.0]))),  # type: ignore[arg-type]
    ]
    for words, ask in refused:
        with pytest.raises(GalocError, match=words):
            ask()
        np.testing.assert_array_equal(belief.p, before)
        assert belief.entropy() == entropy


@pytest.mark.parametrize("distance", [3.3e19, 1.7e250])
def test_an_astronomic_motion_leaves_nothing_to_carry(field: ProfileField, distance: float) -> None:
    """Rounding leaves more than the plan of it, which must not be added to what is found later."""
    belief = Belief(field)
    belief.predict((distance, 0.3 * distance, 0.7))  # out of the plan: uniform again
    seen = np.full(belief.p.shape, -60.0)
    seen[field.nearest((4.05, 3.05)), 90] = 0.0
    belief.add(seen)
    assert np.hypot(*(belief.peak()[:2] - (4.05, 3.05))) < 2.0 * field.resolution  # a cell of carried rest each way


@pytest.mark.parametrize("pose", [(1.0, 1.0), "x", (math.nan, 1.0, 0.0)])
def test_bad_poses(field: ProfileField, pose: Any) -> None:
    belief = Belief(field, headings=36)
    with pytest.raises(GalocError, match="pose"):
        belief.mass_near(pose, 0.5)
    with pytest.raises(GalocError, match="radius_m"):
        belief.mass_near((1.0, 1.0, 0.0), math.nan)
    assert belief.mass_near((1e30, 0.0, 0.0), 0.5) == 0.0


def test_rays_that_cannot_be_scored_are_refused(field: ProfileField) -> None:
    for count in (361, 721):
        rays = Rays(np.ones(count), np.ones(count, bool), np.full(count, np.nan))
        with pytest.raises(GalocError, match="at most 360"):
            cosine_cells(field, rays, Belief(field))
