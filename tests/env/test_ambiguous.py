"""Ambiguous buildings: sound, reproducible, alike where they should be, and unlike somewhere."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from shapely import Polygon, contains_xy, unary_union

from galoc import GalocError
from galoc.profiles import Caster
from galoc_env import homes
from galoc_env.ambiguous import KINDS, Building, draw, generate
from galoc_env.ambiguous_parts import Part, box, half_turn, rotation, shift
from galoc_env.env import FloorplanEnv

SEEDS = range(8)
FAST = {"renderer": "none", "detector": "oracle", "width": 32, "height": 24}


@pytest.fixture(scope="module", params=KINDS)
def buildings(request: pytest.FixtureRequest) -> list[Building]:
    return [draw(seed, kind=request.param) for seed in SEEDS]


def moved(xy: np.ndarray, motion: np.ndarray) -> np.ndarray:
    return xy @ rotation(motion[2]).T + motion[:2]


def differences(building: Building, xy: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """(P, 360) m: how ranges at places differ from those where the motion takes them, bearings turned along."""
    cast = Caster(building.plan)
    turned = np.roll(cast(moved(xy, motion)), -round(np.degrees(motion[2])), axis=1)
    return np.abs(cast(xy) - turned)


def roomy(building: Building, rooms: tuple[Polygon, ...]) -> np.ndarray:
    xy = building.plan.free_space(0.2).positions(0.3)
    return xy[contains_xy(unary_union(rooms), xy[:, 0], xy[:, 1])]


def test_same_seed_same_bytes() -> None:
    for seed in (0, 7, 999_999):
        assert generate(seed).content_hash == generate(seed).content_hash


def test_seeds_splits_and_kinds_differ() -> None:
    plans = [generate(s, split=split, kind=kind) for s in SEEDS for split in ("train", "test") for kind in KINDS]
    assert len({plan.content_hash for plan in plans}) == len(plans)
    assert {generate(seed).notes for seed in range(12)} == {f"Generated ambiguous building, {k}." for k in KINDS}


def test_the_splits_share_no_seed() -> None:
    last = homes.SEEDS_PER_SPLIT - 1
    assert homes.internal_seed(last, "train", None, KINDS) < homes.internal_seed(0, "test", None, KINDS)


def test_sizes(buildings: list[Building]) -> None:
    for building in buildings:
        x1, y1, x2, y2 = building.plan.bounds
        assert 9.5 <= max(x2 - x1, y2 - y1) <= 25.5
        assert 2.4 <= building.plan.ceiling_height <= 3.2
        for room in building.original:
            a, b, c, d = room.bounds
            assert min(c - a, d - b) >= 2.99 and max(c - a, d - b) <= 7.3


def test_every_room_can_be_reached(buildings: list[Building]) -> None:
    for building in buildings:
        assert homes.rooms_connected(building.plan, building.rooms)


def test_views_repeat_in_the_copies(buildings: list[Building]) -> None:
    for building in buildings:
        xy = roomy(building, building.original)
        assert building.motions and len(xy) > 50
        for motion in building.motions:
            # What is seen through a door may differ; the room around one does not.
            alike = np.mean(differences(building, xy, motion) < 0.02, axis=1)
            assert np.mean(alike > 0.9) > 0.7, (building.plan.name, motion)


def test_copies_have_the_same_openings(buildings: list[Building]) -> None:
    for building in buildings:
        middles = np.array([[(o.x1 + o.x2) / 2, (o.y1 + o.y2) / 2] for o in building.plan.openings])
        around = unary_union(building.original).buffer(0.12)  # windows lie in the middle of outside walls
        own = middles[contains_xy(around, middles[:, 0], middles[:, 1])]
        assert len(own) >= 2
        for motion in building.motions:
            gaps = np.linalg.norm(moved(own, motion)[:, None] - middles[None], axis=-1)
            assert gaps.min(axis=1).max() < 0.01


def test_no_copy_is_perfect_as_the_passage_tells_them_apart(buildings: list[Building]) -> None:
    for building in buildings:
        everywhere = roomy(building, building.rooms)
        storey = unary_union(building.rooms).buffer(-0.3)
        for motion in building.motions:
            there = moved(everywhere, motion)
            both = everywhere[contains_xy(storey, there[:, 0], there[:, 1])]
            unlike = np.mean(differences(building, both, motion) > 0.5, axis=1)
            lost = 1.0 - len(both) / len(everywhere)
            assert np.mean(unlike > 0.05) > 0.01 or lost > 0.01, (building.plan.name, motion)


def test_no_rigid_motion_maps_the_walls_onto_themselves(buildings: list[Building]) -> None:
    for building in buildings:
        # A motion onto itself keeps the footprint's centre; walls run along two directions, so it turns by quarters.
        centre = np.array(Polygon(building.plan.outline).centroid.coords[0])
        ends = building.plan.segments.reshape(-1, 2)
        for quarters in (1, 2, 3):
            turned = (ends - centre) @ rotation(quarters * np.pi / 2).T + centre
            gap = np.linalg.norm(turned[:, None] - ends[None], axis=-1).min(axis=1)
            assert gap.max() > 0.4, (building.plan.name, quarters)


def test_parts_move_with_all_that_is_in_them() -> None:
    part = Part((box(0, 0, 2, 1),), (), (box(0, 0, 0.5, 0.5),))
    turned = part.by(half_turn(3.0, 0.5))
    assert Polygon(turned.rooms[0]).equals(Polygon(box(4, 0, 6, 1)))
    assert Polygon(turned.solids[0]).equals(Polygon(box(5.5, 0.5, 6, 1)))
    mirrored = part.moved(np.diag([-1.0, 1.0]), np.zeros(2))
    assert Polygon(mirrored.rooms[0]).exterior.is_ccw
    assert part.by(shift(1.0, 0.0)).rooms[0] == box(1, 0, 3, 1)
    assert len((part + turned).rooms) == 2


@pytest.mark.parametrize("arguments", [{"seed": -1}, {"seed": 0, "split": "all"}, {"seed": 0, "kind": "rectilinear"}])
def test_bad_arguments_are_refused(arguments: dict) -> None:
    with pytest.raises(GalocError):
        generate(**arguments)


def test_the_environment_offers_them() -> None:
    env = gymnasium.make("galoc_env:GALoc-Floorplan-v0", homes="ambiguous", split="test", localizer="none", **FAST)
    check_env(env.unwrapped, skip_render_check=True)
    env.reset(seed=3)
    assert env.unwrapped.world.plan.content_hash == generate(3, split="test").content_hash  # type: ignore[attr-defined]
    env.close()
    with pytest.raises(GalocError, match="homes"):
        FloorplanEnv(homes="castles", **FAST)


def test_a_plan_leaves_no_homes_to_draw() -> None:
    with pytest.raises(GalocError, match='got homes = "ambiguous" with plan = "apartment"; expected one of the two'):
        FloorplanEnv(plan="apartment", homes="ambiguous", **FAST)
    env = FloorplanEnv(plan="apartment", homes="rooms", split="test", localizer="none", **FAST)
    env.reset(seed=0)
    env.close()


def test_the_vector_environment_offers_them() -> None:
    envs = gymnasium.make_vec(
        "galoc_env:GALoc-Floorplan-v0", num_envs=2, homes="ambiguous", localizer="none", vector_kwargs={}, **FAST
    )
    _, info = envs.reset(seed=[1, 2])
    for lane, seed in enumerate((1, 2)):
        x, y = info["pose"][lane][:2]
        assert contains_xy(unary_union(draw(seed).rooms), x, y)
    envs.close()


@pytest.mark.slow
def test_many_buildings_are_sound() -> None:
    for seed in range(200):
        generate(seed, split="test" if seed % 2 else "train")  # raises when no sound one is found
