"""Where a camera can be."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from galoc import Floorplan, GalocError, freespace


def rectangle(x1: float, y1: float, x2: float, y2: float) -> list[list[float]]:
    return [[x1, y1, x2, y1], [x2, y1, x2, y2], [x2, y2, x1, y2], [x1, y2, x1, y1]]


def distance(segments: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance from each point to the nearest segment, the plain way."""
    a, b = segments[None, :, :2], segments[None, :, 2:]
    t = np.clip(np.sum((points[:, None] - a) * (b - a), -1) / np.sum((b - a) ** 2, -1), 0, 1)
    return np.min(np.linalg.norm(points[:, None] - a - t[..., None] * (b - a), axis=-1), axis=1)


@given(st.integers(0, 2**32 - 1))
def test_clearance_is_the_distance_to_the_walls(seed: int) -> None:
    rng = np.random.default_rng(seed)
    inner = rng.uniform(0.5, 7.5, (6, 4))
    plan = Floorplan.from_segments(np.vstack([rectangle(0, 0, 8, 8), inner]))
    free = plan.free_space(0.05)
    points = free.positions(0.0)
    exact = distance(plan.segments, points)
    got = free.clearance_at(points)
    assert np.all(got >= exact - 1e-5)  # measured to some wall, in float32
    assert np.quantile(got - exact, 0.99) < 1e-5  # and nearly always to the nearest one
    assert np.max(got - exact) < 0.05 * np.sqrt(2)  # else within the diagonal of a cell


@pytest.mark.parametrize("resolution", [0.02, 0.05, 0.1])
@pytest.mark.parametrize("shift", [0.0, 0.013, -3.337])
def test_area_of_a_rectangle(resolution: float, shift: float) -> None:
    plan = Floorplan.from_segments(rectangle(shift, shift, shift + 6, shift + 4))
    # the cells that walls run through, at most one along 20 m of wall, are not inside
    assert 24 - 20 * resolution <= plan.free_space(resolution).area <= 24


@given(st.floats(0, 2 * np.pi), st.floats(-50, 50))
def test_area_does_not_depend_on_the_frame(angle: float, shift: float) -> None:
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    walls = np.array(rectangle(0, 0, 6, 4)).reshape(-1, 2) @ turn.T + shift
    area = Floorplan.from_segments(walls.reshape(-1, 4)).free_space(0.05).area
    assert 24 - 20 * 0.05 * np.sqrt(2) <= area <= 24  # oblique walls run through up to sqrt(2) cells a cell


def test_wall_cores_pillars_and_outside_are_not_inside() -> None:
    walls = rectangle(0, 0, 8, 6) + rectangle(-0.3, -0.3, 8.3, 6.3) + rectangle(3, 3, 3.5, 3.5)
    free = Floorplan.from_segments(walls).free_space(0.05)
    assert free.clearance_at([4.0, 1.0]) == pytest.approx(
        1.0, abs=0.04
    )  # the point is up to half a cell from its centre
    for point in ([-0.15, 3.0], [3.25, 3.25], [-1.0, 3.0], [100.0, 0.0], [np.nan, 0.0], [np.inf, 1.0], [1e300, 0.0]):
        assert free.clearance_at(point) == 0.0


def test_a_wide_shaft_in_a_thin_wall_does_not_let_anyone_into_the_wall() -> None:
    outline = [[0, 0], [8, 0], [8, 6], [0, 6]]
    room = [(0.2, 0.2), (7.8, 0.2), (7.8, 4.9), (6.9, 4.9), (6.9, 5.8), (0.2, 5.8)]
    faces = [[*a, *b] for a, b in zip(room, room[1:] + room[:1], strict=True)]
    plan = Floorplan(np.array(rectangle(0, 0, 8, 6) + faces), outline=np.array(outline))
    free = plan.free_space(0.05)
    assert free.clearance_at([7.45, 5.45]) == 0.0
    assert free.area < 7.6 * 5.6 - 0.9 * 0.9 + 1e-9


@pytest.mark.parametrize("gap", [0.0, 0.8, 1.4, 2.2])
def test_an_open_entrance_does_not_let_the_outside_in(gap: float) -> None:
    walls = [[0, 0, 5, 0], [5 + gap, 0, 12, 0], *rectangle(0, 0, 12, 8)[1:]] if gap else rectangle(0, 0, 12, 8)
    free = Floorplan.from_segments(walls).free_space(0.05)
    # the disc that closes the gap reaches at most half the gap into it
    assert 96 - 40 * 0.05 - gap**2 / 2 <= free.area <= 96 + gap**2 / 2


def test_an_outline_decides_where_walls_leave_gaps() -> None:
    walls = rectangle(0, 0, 12, 8)[:2] + [[0, 8, 0, 0]]  # one side missing
    closed = Floorplan(np.array(walls, float), outline=np.array([[0, 0], [12, 0], [12, 8], [0, 8]]))
    assert closed.free_space(0.05).area == pytest.approx(96, abs=40 * 0.05)


def test_one_oblique_wall_encloses_nothing() -> None:
    free = Floorplan.from_segments([[0, 0, 4, 3]]).free_space(0.05)
    assert free.area == 0.0
    assert free.positions(0.0).shape == (0, 2)


def test_an_outline_far_beyond_the_walls_is_cut_at_the_grid() -> None:
    plan = Floorplan(np.array(rectangle(0, 0, 2, 2), float), outline=np.array([[-9e4, -9e4], [9e4, -9e4], [0, 9e4]]))
    assert plan.free_space(0.005).clearance_at([1.0, 1.0]) == pytest.approx(1.0, abs=0.005)


def test_positions_are_cell_centres_with_that_clearance() -> None:
    free = Floorplan.load("apartment").free_space(0.05)
    points = free.positions(0.4)
    assert np.all(free.clearance_at(points) >= 0.4)
    rows, cols = free.index(points).T
    np.testing.assert_allclose(free.origin + (np.stack([cols, rows], 1) + 0.5) * 0.05, points, atol=1e-9)
    assert np.all(np.diff(rows) >= 0)
    assert len(free.positions(1e3)) == 0
    assert free.area == pytest.approx(len(free.positions(0.0)) * 0.05**2)


def test_index_is_the_floor_and_may_lie_outside() -> None:
    free = Floorplan.from_segments(rectangle(0, 0, 6, 4)).free_space(0.05)
    height, width = free.clearance.shape
    low, high = free.origin, free.origin + np.array([width, height]) * 0.05
    assert free.index(low + 0.01).tolist() == [0, 0]
    assert free.index(high - 0.01).tolist() == [height - 1, width - 1]
    assert free.index(low - 0.01).tolist() == [-1, -1]
    assert free.index(np.zeros((2, 3, 2))).shape == (2, 3, 2)


def test_largest_room_shrinks_to_what_a_body_can_reach() -> None:
    walls = [*rectangle(0, 0, 9, 4), [6, 0, 6, 1.6], [6, 2.4, 6, 4]]  # a door 0.8 m wide at x = 6
    free = Floorplan.from_segments(walls).free_space(0.05)
    both, left = free.largest_room(0.3), free.largest_room(0.5)
    columns = np.flatnonzero(both.any(axis=0)) * 0.05 + free.origin[0]
    assert columns.max() > 8.5
    columns = np.flatnonzero(left.any(axis=0)) * 0.05 + free.origin[0]
    assert 5.4 < columns.max() < 5.7  # up to where the disc rests against both jambs
    assert np.all(free.clearance[left] >= 0.5)
    assert not free.largest_room(50.0).any()


@pytest.mark.parametrize("side", [20.0, 2000.0, 1.5e5])
def test_the_grid_never_explodes(side: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(freespace, "MAX_CELLS", 250_000)
    plan = Floorplan.from_segments(np.array(rectangle(0, 0, 1, 1)) * side - side / 2)
    free = freespace.build_free_space(plan, 0.05)
    assert free.clearance.size <= 250_000
    assert (free.resolution == 0.05) == (side == 20.0)
    assert free.area == pytest.approx(side**2, rel=4 * free.resolution / side)


@pytest.mark.slow
def test_the_largest_grid_is_built() -> None:
    plan = Floorplan.from_segments(np.array(rectangle(-1e5, -1e5, 1e5, 1e5)))
    free = freespace.build_free_space(plan, 0.01)
    assert 0.9 * freespace.MAX_CELLS < free.clearance.size <= freespace.MAX_CELLS


@pytest.mark.parametrize("resolution", [0.0, -1.0, np.nan, np.inf, "0.05"])
def test_bad_resolutions_are_refused(resolution: object) -> None:
    with pytest.raises(GalocError, match="resolution"):
        Floorplan.load("apartment").free_space(resolution)  # type: ignore[arg-type]


def test_arrays_are_read_only_and_the_grid_is_cached() -> None:
    plan = Floorplan.load("apartment")
    free = plan.free_space(0.05)
    assert plan.free_space(0.05) is free
    with pytest.raises(ValueError, match="read-only"):
        free.clearance[0, 0] = 1.0


@pytest.mark.parametrize(
    ("name", "inside", "outside"),
    [
        ("amrl_maps/NSH1", (0.30, 0.25), (0.99, 0.02)),
        ("amrl_maps/NYU19", (0.30, 0.60), (0.02, 0.02)),
        ("utexas_gdc/gdc_1", None, (0.5, 0.6)),
        ("ifc_duplex/Duplex_Architecture_1_Level-1", (0.5, 0.75), None),
        ("wrld_westport/westport-house-floor-3", None, (0.2, 0.8)),
    ],
)
def test_published_buildings(shared_plans, name, inside, outside) -> None:  # type: ignore[no-untyped-def]
    plan = Floorplan.load(shared_plans / f"{name}.json")
    free = plan.free_space(0.1)
    x_min, y_min, x_max, y_max = plan.bounds
    size = np.array([x_max - x_min, y_max - y_min])
    assert 0.15 * size.prod() < free.area < 0.9 * size.prod()
    assert inside is None or free.clearance_at(np.array([x_min, y_min]) + inside * size) > 0
    assert outside is None or free.clearance_at(np.array([x_min, y_min]) + outside * size) == 0
