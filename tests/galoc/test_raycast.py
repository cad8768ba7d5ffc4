"""Range profiles against brute-force ray and segment intersection, and the grid that holds them."""

import math

import numpy as np
import pytest

from galoc import Floorplan, GalocError
from galoc.profiles import CLEARANCE, MAX_POSITIONS, Caster, profile_field
from galoc.raycast import MOST, NEAR_BIN, bearing_deg, cast_profiles, tile_lists

ANGLE = np.radians(np.arange(360))
DIRECTION = np.stack([np.cos(ANGLE), np.sin(ANGLE)], axis=1)
KILOMETRE = 1000.0


def brute_force(segments: np.ndarray, xy: np.ndarray, slack: float) -> np.ndarray:
    """(360,) m: nearest hit of each whole-degree ray on segments lengthened by a share ``slack`` at both ends."""
    a, d = segments[:, :2] - xy, segments[:, 2:] - segments[:, :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        den = DIRECTION[:, :1] * d[:, 1] - DIRECTION[:, 1:] * d[:, 0]
        t = (a[:, 0] * d[:, 1] - a[:, 1] * d[:, 0]) / den
        u = (a[:, 0] * DIRECTION[:, 1:] - a[:, 1] * DIRECTION[:, :1]) / den
        hit = (np.abs(den) > 1e-12) & (t > 0.0) & (u >= -slack) & (u <= 1.0 + slack)
    return np.where(hit, t, np.inf).min(axis=1).clip(max=KILOMETRE)


def sample(plan: Floorplan, count: int, seed: int) -> np.ndarray:
    """(count, 2) m: free positions off any grid."""
    rng = np.random.default_rng(seed)
    free = plan.free_space(0.1).positions(0.25)
    return free[rng.integers(len(free), size=count)] + rng.uniform(-0.05, 0.05, (count, 2))


@pytest.mark.parametrize("name", ["apartment", "gallery", "house", "corridor"])
def test_profiles_equal_brute_force(name: str) -> None:
    plan = Floorplan.load(name)
    positions = sample(plan, 60, 1)
    compared = 0
    for xy, got in zip(positions, Caster(plan)(positions), strict=True):
        # A ray through a wall's very end may go either way; where walls longer or shorter by 1e-7 agree, it may not.
        shorter, longer = brute_force(plan.segments, xy, -1e-7), brute_force(plan.segments, xy, 1e-7)
        clear = shorter == longer
        compared += np.count_nonzero(clear)
        np.testing.assert_allclose(got[clear], longer[clear], rtol=2e-7)  # float32
    assert compared > 0.99 * 360 * len(positions)


@pytest.mark.parametrize("centre", [(0.0, 0.0), (-3.7, 0.3), (211.3, 98.1)])
def test_walls_that_meet_on_a_ray_are_watertight(centre: tuple[float, float]) -> None:
    """A ring with a corner on every whole degree: each ray ends at its corner, none slips through."""
    radius = np.random.default_rng(3).uniform(1.0, 9.0, 360)
    ring = np.array(centre) + radius[:, None] * DIRECTION
    got = Caster(Floorplan.from_segments(np.hstack([ring, np.roll(ring, -1, axis=0)])))([centre])[0]
    # An end point may lie 1e-11 rad beside its ray, where the wall's range changes by 1e3 m a radian at most.
    np.testing.assert_allclose(got, radius, rtol=2e-7)  # float32


@pytest.mark.parametrize("gap", [0.0, 0.3])
def test_walls_of_many_short_pieces_equal_brute_force(gap: float) -> None:
    """Rings of pieces that mostly lie between two rays; with gaps, rays pass nearer rings and reach farther ones."""
    rng, pieces = np.random.default_rng(4), []
    for radius in (2.0, 4.0, 7.0, 11.0):
        count = 4 * MOST
        edge = np.sort(rng.uniform(0.0, 2.0 * math.pi, count))
        keep = rng.random(count) >= gap
        a = radius * np.stack([np.cos(edge), np.sin(edge)], axis=1)
        pieces.append(np.hstack([a, np.roll(a, -1, axis=0)])[keep])
    plan = Floorplan.from_segments(np.concatenate(pieces))
    positions = rng.uniform(-1.2, 1.2, (40, 2))
    for xy, got in zip(positions, Caster(plan)(positions), strict=True):
        shorter, longer = brute_force(plan.segments, xy, -1e-7), brute_force(plan.segments, xy, 1e-7)
        clear = shorter == longer
        assert clear.mean() > 0.99
        np.testing.assert_allclose(got[clear], longer[clear], rtol=2e-7)  # float32


def test_bearing_error_is_below_what_the_caster_allows_for() -> None:
    angle = np.random.default_rng(5).uniform(0.0, 360.0, 20_000)
    angle = np.concatenate([angle, np.arange(0.0, 360.0, 15.0), 45.0 + np.array([-1e-9, 1e-9])])
    got = np.array([bearing_deg(3.0 * math.cos(a), 3.0 * math.sin(a)) for a in np.radians(angle)])
    assert np.abs((got - angle + 180.0) % 360.0 - 180.0).max() < 0.2 * NEAR_BIN
    exact = [(1.0, 0.0, 0.0), (0.0, 2.0, 90.0), (-1.0, 0.0, 180.0), (0.0, -0.5, 270.0)]
    assert [bearing_deg(x, y) for x, y, _ in exact] == [want for *_, want in exact]


@pytest.mark.parametrize("side", [0.5, 3.0, 40.0])
def test_tiles_do_not_change_the_result(side: float) -> None:
    """The front-to-back lists only save time: any tiling gives the same ranges, bit for bit."""
    plan = Floorplan.load("gallery")
    positions = sample(plan, 80, 2)
    used, tile = np.unique(np.floor(positions / side).astype(np.int64), axis=0, return_inverse=True)
    order, distance = tile_lists((used + 0.5) * side, side / math.sqrt(2.0), plan.segments)
    got = cast_profiles(positions, tile.reshape(-1), order, distance, plan.segments)
    np.testing.assert_array_equal(got, Caster(plan)(positions))


def test_tile_lists_are_sorted_lower_bounds() -> None:
    plan = Floorplan.load("apartment")
    centre, half = np.array([[3.0, 3.0]]), 0.5 / math.sqrt(2.0) * 2.0
    order, distance = tile_lists(centre, half, plan.segments)
    assert sorted(order[0].tolist()) == list(range(len(plan.segments)))
    assert np.all(np.diff(distance[0]) >= 0.0)
    points = np.linspace(plan.segments[order[0], :2], plan.segments[order[0], 2:], 50)
    corner = centre[0] + 0.5 * np.array([1.0, 1.0])
    assert np.all(np.hypot(*(points - corner).T).T.min(axis=0) >= distance[0] - 1e-6)


def test_no_wall_is_one_kilometre() -> None:
    caster = Caster(Floorplan.from_segments(np.array([[0.0, 0.0, 8.0, 0.0], [8.0, 0.0, 8.0, 2.0]])))
    profile = caster([[4.0, 1.0]])[0]
    assert np.all(profile[20:160] == KILOMETRE)
    assert profile[0] == pytest.approx(4.0) and profile[270] == pytest.approx(1.0)
    assert np.all(profile > 0.0) and np.isfinite(profile).all()


def test_field_casts_from_its_own_cells() -> None:
    plan = Floorplan.load("apartment")
    field = profile_field(plan, 0.25)
    assert field.resolution == 0.25 and profile_field(plan, 0.25) is field
    np.testing.assert_allclose(field.positions, field.origin + (field.cell[:, ::-1] + 0.5) * 0.25)
    np.testing.assert_array_equal(field.index[field.cell[:, 0], field.cell[:, 1]], np.arange(len(field.positions)))
    assert np.count_nonzero(field.index >= 0) == len(field.positions)
    np.testing.assert_array_equal(field.ranges[::50], field.caster(field.positions[::50]))
    assert field.nearest(field.positions[17] + 0.05) == 17


def test_positions_keep_clear_of_walls() -> None:
    assert profile_field(Floorplan.load("apartment"), 0.1).ranges.min() >= CLEARANCE - 1e-6


def test_large_plan_is_coarsened() -> None:
    side = 60.0
    walls = np.array([[0, 0, side, 0], [side, 0, side, side], [side, side, 0, side], [0, side, 0, 0]], float)
    field = profile_field(Floorplan.from_segments(walls), 0.1)
    assert MAX_POSITIONS / 2 < len(field.positions) <= MAX_POSITIONS
    # 60 m x 60 m over 60000 positions is a step of 0.245 m at least; one step of 25 % more at most.
    assert 0.24 < field.resolution < 0.245 * 1.27
    steps = np.diff(np.unique(np.round(field.positions[:, 0], 6)))
    np.testing.assert_allclose(steps, field.resolution, atol=1e-5)


@pytest.mark.parametrize("resolution", [0.0, -0.1, 0.001, 5.0, math.nan, math.inf])
def test_bad_resolution_is_refused(resolution: float) -> None:
    with pytest.raises(GalocError, match="resolution"):
        profile_field(Floorplan.load("apartment"), resolution)


def test_plan_without_room_for_a_camera_is_refused() -> None:
    walls = np.array([[0.0, 0.0, 8.0, 0.0], [0.0, 0.2, 8.0, 0.2], [0.0, 0.0, 0.0, 0.6]])  # a slot 0.2 m wide
    with pytest.raises(GalocError, match="free space"):
        profile_field(Floorplan.from_segments(walls), 0.05)
