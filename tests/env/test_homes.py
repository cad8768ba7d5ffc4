"""Generated homes: sound, varied, reproducible, and never the same in training and test."""

import numpy as np
import pytest
from shapely import Polygon

from galoc import Floorplan, GalocError
from galoc.plan_facts import manhattan
from galoc_env.homes import KINDS, generate
from galoc_env.wall_builder import Shell, boundary_segments, door, rectangle, window

SEEDS = range(12)


@pytest.fixture(scope="module", params=KINDS)
def homes(request: pytest.FixtureRequest) -> list[Floorplan]:
    return [generate(seed, kind=request.param) for seed in SEEDS]


def test_same_seed_same_bytes() -> None:
    for seed in (0, 7, 999_999):
        assert generate(seed).content_hash == generate(seed).content_hash


def test_seeds_and_splits_give_different_homes() -> None:
    hashes = [generate(seed, split=split).content_hash for split in ("train", "test") for seed in SEEDS]
    assert len(set(hashes)) == len(hashes)


def test_kinds_are_all_drawn() -> None:
    notes = {generate(seed).notes for seed in range(15)}
    assert notes == {f"Generated home, {kind}." for kind in KINDS}


def test_every_room_can_be_reached(homes: list[Floorplan]) -> None:
    for plan in homes:
        free = plan.free_space(0.05)
        everywhere = free.inside & (free.clearance >= 0.3)
        reached = np.count_nonzero(free.largest_room(0.3)) / np.count_nonzero(everywhere)
        assert reached > 0.97, plan.name  # a niche beside a closet may be too narrow


def test_sizes_are_those_of_homes(homes: list[Floorplan]) -> None:
    for plan in homes:
        assert 2.4 <= plan.ceiling_height <= 3.2
        assert 30.0 < plan.free_space(0.05).area < 250.0
        doors = [o for o in plan.openings if o.kind == "door"]
        windows = [o for o in plan.openings if o.kind == "window"]
        assert len(doors) >= 2
        assert windows
        tolerance = 2e-4  # ends are rounded to 0.1 mm
        for opening in doors:
            assert any(low - tolerance <= opening.width <= high + tolerance for low, high in ((0.75, 1.0), (1.4, 2.4)))
            assert opening.bottom == 0.0
            assert 1.99 <= opening.top <= plan.ceiling_height - 0.04
        for opening in windows:
            assert 0.59 <= opening.width <= 2.4 + tolerance
            assert 0.4 <= opening.bottom <= 1.1
            assert 2.0 <= opening.top <= 2.3
        assert all(0.08 <= o.thickness <= 0.30 for o in plan.openings)


def test_doors_are_gaps_and_windows_are_wall(homes: list[Floorplan]) -> None:
    for plan in homes:
        free = plan.free_space(0.02)
        for opening in plan.openings:
            middle = [(opening.x1 + opening.x2) / 2, (opening.y1 + opening.y2) / 2]
            clearance = float(free.clearance_at(middle))
            wanted = opening.width / 2 if opening.kind == "door" else 0.0
            # half a cell's diagonal; a closet beside the door may be nearer than the jamb of a wide opening
            assert clearance <= wanted + 0.02
            assert (clearance > 0.3) == (opening.kind == "door")


def test_openings_do_not_overlap(homes: list[Floorplan]) -> None:
    for plan in homes:
        middles = np.array([[(o.x1 + o.x2) / 2, (o.y1 + o.y2) / 2] for o in plan.openings])
        halves = np.array([o.width / 2 for o in plan.openings])
        apart = np.linalg.norm(middles[:, None] - middles[None], axis=-1)
        np.fill_diagonal(apart, np.inf)
        assert np.all(apart > np.maximum(halves[:, None], halves[None]))


def test_walls_lie_within_the_outline(homes: list[Floorplan]) -> None:
    for plan in homes:
        polygon = Polygon(plan.outline)
        assert polygon.bounds == pytest.approx(plan.bounds, abs=2e-4)
        from shapely import contains_xy

        assert np.all(contains_xy(polygon.buffer(1e-3), plan.segments[:, [0, 2]], plan.segments[:, [1, 3]]))


def test_wall_directions_are_those_of_the_kind() -> None:
    shares = {kind: [manhattan(generate(seed, kind=kind).segments)[0] for seed in SEEDS] for kind in KINDS}
    assert min(shares["rectilinear"]) > 1 - 1e-9
    assert max(shares["atlanta"]) < 1.0 and min(shares["atlanta"]) > 0.5
    assert max(shares["free"]) < 0.95 and np.mean(shares["free"]) < 0.75


def test_homes_differ_in_size_and_height() -> None:
    plans = [generate(seed) for seed in range(15)]
    assert np.std([plan.ceiling_height for plan in plans]) > 0.1
    assert np.std([plan.free_space(0.05).area for plan in plans]) > 10.0


@pytest.mark.parametrize("seed", [-1, 1_000_000, 1.0, "1", None, True])
def test_bad_seeds_are_refused(seed: object) -> None:
    with pytest.raises(GalocError, match="seed"):
        generate(seed)  # type: ignore[arg-type]


def test_unknown_kinds_and_splits_are_refused() -> None:
    with pytest.raises(GalocError, match="kind"):
        generate(0, kind="round")
    with pytest.raises(GalocError, match="split"):
        generate(0, split="validation")


def test_numpy_integers_are_seeds() -> None:
    assert generate(np.int64(3)).content_hash == generate(3).content_hash


@pytest.mark.slow
def test_many_homes_are_sound() -> None:
    for seed in range(1500):
        generate(seed, split="test" if seed % 2 else "train")  # raises when no sound home is found


# ---- the builder


TWO = [rectangle(0, 0, 4, 3), rectangle(4, 0, 7, 3)]


def test_builder_keeps_true_thickness() -> None:
    plan = Shell.from_rooms(TWO, 0.1, 0.3).build([door(4.0, 1.5, 0.9), window(2.0, 0.0, 1.2)], 2.5, "two")
    assert plan.bounds == pytest.approx((-0.25, -0.25, 7.25, 3.25))
    # outer face 4, two rooms with a door between them: one ring of 12 with four jamb corners
    assert len(plan.segments) == 16
    area = 3.9 * 2.9 + 2.9 * 2.9 + 0.1 * 0.9
    perimeter = 2 * (3.9 + 2.9) + 2 * (2.9 + 2.9)
    assert plan.free_space(0.01).area == pytest.approx(area, abs=0.01 * perimeter)
    (gap, pane) = plan.openings
    assert (gap.thickness, pane.thickness) == (0.1, 0.3)
    assert (gap.x1, gap.x2) == pytest.approx((4.0, 4.0))
    assert pane.y1 == pytest.approx(-0.1)  # the middle of a wall from -0.25 to 0.05
    assert gap.width == pytest.approx(0.9)


@pytest.mark.parametrize("hole", [door(4.0, 0.3, 0.9), door(2.0, 1.5, 0.9), door(4.0, 1.5, 3.2), window(9.0, 1.0, 1.0)])
def test_builder_refuses_holes_that_do_not_fit(hole) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(GalocError, match="clear of corners"):
        Shell.from_rooms(TWO, 0.1, 0.3).build([hole], 2.5, "two")


def test_builder_refuses_rooms_that_lie_apart_or_cross_themselves() -> None:
    with pytest.raises(GalocError, match="apart"):
        Shell.from_rooms([rectangle(0, 0, 4, 3), rectangle(6, 0, 9, 3)], 0.1, 0.3).build([], 2.5, "apart")
    with pytest.raises(GalocError, match="room 0"):
        Shell.from_rooms([[(0, 0), (3, 3), (3, 0), (0, 3)]], 0.1, 0.3)


def test_boundary_keeps_the_solid_on_one_side_and_its_area() -> None:
    solid = Polygon(rectangle(0, 0, 5, 4)).difference(Polygon([(1, 1), (4, 1), (3, 3)]))
    segments = boundary_segments(solid)
    x1, y1, x2, y2 = segments.T
    assert abs(0.5 * np.sum(x1 * y2 - x2 * y1)) == pytest.approx(solid.area, abs=1e-3)  # rounded to 0.1 mm
    assert len(segments) == 7
