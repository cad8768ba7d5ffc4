"""Furniture stands against walls, overlaps nothing and blocks no way."""

import math
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import shapely
from scipy.ndimage import label

from galoc import Floorplan, GalocError
from galoc.floorplan import Opening
from galoc_env.furniture import AGENT_RADIUS, DOOR_CLEARANCE, KINDS, MAX_ITEMS, Furniture, furnish
from galoc_env.furniture.kinds import KINDS_BY_NAME
from galoc_env.furniture.space import random_size
from galoc_env.homes import generate
from galoc_env.scene import build_scene
from galoc_env.scene.furniture import DRAW
from galoc_env.scene.furniture_palette import Look, draw_stock
from galoc_env.scene.light import Lighting
from galoc_env.scene.mesh import FURNITURE, MeshBuilder, SceneMesh
from galoc_env.scene.solids import SolidPainter


@dataclass(frozen=True)
class Drawn:
    """As much of a scene as has faces."""

    meshes: tuple[SceneMesh, ...]


PLANS = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "plans"


def turned_plan(angle=0.0):
    """Two rooms, 5 x 4 m and 4 x 4 m, behind a wall of 15 cm with a door, turned by an angle."""
    walls = np.array([
        [0, 0, 5, 0], [5, 0, 5, 1.5], [5, 1.5, 5.15, 1.5], [5.15, 1.5, 5.15, 0], [5.15, 0, 9, 0], [9, 0, 9, 4],
        [9, 4, 5.15, 4], [5.15, 4, 5.15, 2.4], [5.15, 2.4, 5, 2.4], [5, 2.4, 5, 4], [5, 4, 0, 4], [0, 4, 0, 0],
    ], float)  # fmt: skip
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, s], [-s, c]])
    door = np.array([[5.075, 1.5], [5.075, 2.4]]) @ turn
    return Floorplan(
        (walls.reshape(-1, 2) @ turn).reshape(-1, 4), 2.6, (Opening("door", *door.ravel(), 0.15, 0.0, 2.05),)
    )


def reachable_parts(plan, items):
    """Components of the cells where the agent's disc touches neither wall nor furniture, found afresh."""
    space = plan.free_space()
    rows, cols = space.clearance.shape
    x, y = (np.arange(n) + 0.5 for n in (cols, rows))
    cells = space.origin + space.resolution * np.stack(np.meshgrid(x, y), axis=-1)
    free = space.inside & (space.clearance >= AGENT_RADIUS)
    for item in items:
        if item.flat:
            continue
        free &= item.distance(cells) >= AGENT_RADIUS
    return label(free), label(space.inside & (space.clearance >= AGENT_RADIUS))


def test_box_geometry():
    item = Furniture("sofa", 1.0, 2.0, math.radians(90), 0.9, 2.0, 0.8)
    corners = item.corners()
    # Facing +y, the 2 m across lie along x.
    np.testing.assert_allclose(corners.min(axis=0), [0.0, 1.55], atol=1e-12)
    np.testing.assert_allclose(corners.max(axis=0), [2.0, 2.45], atol=1e-12)
    assert shapely.Polygon(corners).exterior.is_ccw
    edges = item.edges()
    np.testing.assert_array_equal(edges[:, 2:], np.roll(edges[:, :2], -1, axis=0))
    np.testing.assert_allclose(item.distance(np.array([[1.0, 2.0], [2.5, 2.0], [3.0, 3.45]])), [0, 0.5, math.sqrt(2)])


@pytest.mark.parametrize("angle_deg", [0, 30, 77])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_nothing_overlaps_and_doors_stay_clear(angle_deg, seed):
    plan = turned_plan(math.radians(angle_deg))
    items = furnish(plan, 1.0, np.random.default_rng(seed))
    assert len(items) >= 5  # 36 m2 at density 1 aims at 14
    walls = shapely.MultiLineString(list(plan.segments.reshape(-1, 2, 2)))
    door = shapely.LineString([(plan.openings[0].x1, plan.openings[0].y1), (plan.openings[0].x2, plan.openings[0].y2)])
    shapes = [shapely.Polygon(item.corners()) for item in items]
    for k, shape in enumerate(shapes):
        assert items[k].kind in KINDS and items[k].height < plan.ceiling_height
        assert not shape.intersects(walls)
        assert shape.distance(door) >= DOOR_CLEARANCE
        assert items[k].flat or all(shape.distance(other) > 0.0 for other in shapes[:k])  # rugs come last


@pytest.mark.parametrize("seed", range(4))
def test_no_place_is_cut_off(seed):
    plan = turned_plan(math.radians(12))
    items = furnish(plan, 1.0, np.random.default_rng(seed))
    (_, after), (_, before) = reachable_parts(plan, items)
    assert after == before == 1


def test_most_pieces_have_a_wall_behind_them():
    plan = turned_plan()
    seen = [i for s in range(4) for i in furnish(plan, 0.7, np.random.default_rng(s))]
    # Seats stand before the table that they belong to.
    items = [i for i in seen if not KINDS_BY_NAME[i.kind].free and i.kind != "armchair"]
    assert len(items) > 0.4 * len(seen)
    walls = shapely.MultiLineString(list(plan.segments.reshape(-1, 2, 2)))
    for item in items:
        back = np.array([item.x, item.y]) - item.length / 2 * np.array([math.cos(item.heading), math.sin(item.heading)])
        assert walls.distance(shapely.Point(back)) < 0.031  # the gap is 3 cm


def test_density():
    plan = turned_plan()
    assert furnish(plan, 0.0, np.random.default_rng(0)) == ()
    few, many = (furnish(plan, d, np.random.default_rng(0)) for d in (0.2, 0.9))
    assert 0 < len(few) < len(many)
    again = furnish(plan, 0.9, np.random.default_rng(0))
    assert many == again


@pytest.mark.parametrize("density", [-0.1, 1.5, float("nan"), "lots"])
def test_bad_density(density):
    with pytest.raises(GalocError, match="density"):
        furnish(turned_plan(), density, np.random.default_rng(0))


def test_a_closet_stays_empty():
    closet = Floorplan.from_segments([[0, 0, 0.8, 0], [0.8, 0, 0.8, 0.8], [0.8, 0.8, 0, 0.8], [0, 0.8, 0, 0]])
    assert furnish(closet, 1.0, np.random.default_rng(0)) == ()


def test_windows_are_not_covered():
    room = [[0, 0, 4, 0], [4, 0, 4, 4], [4, 4, 0, 4], [0, 4, 0, 0]]
    glass = tuple(Opening("window", *line, 0.2, 0.5, 2.2) for line in ([0.3, -0.1, 3.7, -0.1], [0.3, 4.1, 3.7, 4.1]))
    plan = Floorplan(np.array(room, float), 2.6, glass)
    for seed in range(5):
        for item in furnish(plan, 1.0, np.random.default_rng(seed)):
            edge = shapely.Polygon(item.corners())
            near = min(edge.distance(shapely.LineString([(w.x1, w.y1), (w.x2, w.y2)])) for w in glass)
            assert near > 0.45 or item.height <= 0.5


def test_a_huge_plan_is_quick_and_capped():
    path = PLANS / "amrl_maps" / "GHC4.json"
    if not path.exists():
        pytest.skip("the shared real plans are not beside this checkout")
    plan = Floorplan.load(path)
    start = time.process_time()
    plan.free_space()
    free_space = time.process_time() - start
    start = time.process_time()
    items = furnish(plan, 1.0, np.random.default_rng(0))
    cost = time.process_time() - start
    assert cost < 4.0 * free_space  # a third of it in measurements
    assert 0.5 * MAX_ITEMS < len(items) <= MAX_ITEMS + 6  # a table's chairs may come on top


@pytest.fixture(scope="module")
def homes():
    """Eight furnished homes: plan, pieces."""
    return [(plan, furnish(plan, 0.7, np.random.default_rng(n))) for n, plan in enumerate(map(generate, range(8)))]


def test_homes_stay_passable(homes):
    for plan, items in homes:
        (after, parts), (before, _) = reachable_parts(plan, items)
        assert parts == 1 or np.sort(np.bincount(after[after > 0]))[:-1].sum() < 0.02 * (before > 0).sum()


def test_rugs_stop_nobody(homes):
    seen = 0
    for _, items in homes:
        flat = [item.flat for item in items]
        assert flat == sorted(flat)  # they come last
        for rug in items[len(items) - sum(flat) :]:
            assert rug.kind == "rug" and rug.edges().shape == (0, 4) and rug.height < 0.02
            seen += 1
    assert seen > 0


def test_a_home_has_one_kitchen_of_joined_units(homes):
    found = 0
    for plan, items in homes:
        units = [item for item in items if item.kind in ("kitchen", "counter", "fridge")]
        assert len({item.group for item in units}) <= 1
        found += bool(units)
        letters = "".join(item.detail for item in units)
        assert letters.count("H") <= 1 and letters.count("S") <= 1  # one hob, one sink
        for item in units:
            assert item.kind != "counter" or item.height == pytest.approx(0.9)
            assert item.kind == "fridge" or len(item.detail) == pytest.approx(item.width / 0.62, abs=0.6)
            assert item.height < plan.ceiling_height
        if len(units) > 1:  # each stands close to another: 2 mm, or 4 cm at the inner corner
            boxes = [shapely.Polygon(item.corners()) for item in units]
            for box in boxes:
                gaps = [box.distance(other) for other in boxes if other is not box]
                assert 0.0 < min(gaps) < 0.65
    assert found >= 6


def test_pieces_that_belong_together_stand_together(homes):
    tables, pairs = 0, 0
    for _, items in homes:
        for item in items:
            others = [other for other in items if other is not item and other.group == item.group > 0]
            if item.kind == "nightstand":
                near = [o for o in others if o.kind in ("bed", "sofa")]
                assert near and abs(near[0].heading - item.heading) < 1e-9
                assert shapely.Polygon(near[0].corners()).distance(shapely.Polygon(item.corners())) < 0.1
                pairs += 1
            if item.kind == "chair" and item.group:
                seats = [t for t in items if t.kind in ("table", "round_table")]
                assert min(t.distance(np.array([item.x, item.y])) for t in seats) < 0.5
                tables += 1
    assert tables > 10 and pairs > 4


def overlaps(scene):
    """(instance, area m2) of faces of one instance that lie in one plane, look different and cover each other."""
    meshes = scene.meshes
    count = [len(m.mesh.faces) for m in meshes]
    look = np.column_stack([
        np.repeat(np.arange(len(meshes)), count), np.concatenate([np.column_stack([m.tint, m.glow]) for m in meshes])
    ])  # fmt: skip
    corners, instance = np.concatenate([m.mesh.triangles for m in meshes]), np.concatenate([m.instance for m in meshes])
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1)
    large = size > 2e-4  # a smaller one covers no 1 cm2
    look, corners, instance, normal = look[large], corners[large], instance[large], normal[large] / size[large, None]
    offset = (normal * corners[:, 0]).sum(axis=1)
    low, high = corners.min(axis=1) - 1e-4, corners.max(axis=1) + 1e-4
    found = []
    for number in np.unique(instance):
        mine = np.flatnonzero(instance == number)
        i, j = np.nonzero(np.abs(offset[mine, None] - offset[mine]) < 3e-4)
        i, j = mine[i[i < j]], mine[j[i < j]]
        for axis in range(3):
            near = (low[i, axis] < high[j, axis]) & (low[j, axis] < high[i, axis])
            i, j = i[near], j[near]
        near = ((normal[i] * normal[j]).sum(axis=1) > 0.99999) & (
            np.abs(look[i] - look[j]).max(axis=1, initial=0) > 1e-5
        )
        for a, b in zip(i[near], j[near], strict=True):
            u = corners[a, 1] - corners[a, 0]
            frame = np.stack([u / np.linalg.norm(u), np.cross(normal[a], u / np.linalg.norm(u))], axis=1)
            first, second = (shapely.Polygon((corners[k] - corners[a, 0]) @ frame) for k in (a, b))
            area = first.intersection(second).area
            if area > 1e-4:
                found.append((int(number), area))
    return found


def test_no_two_faces_of_a_piece_fight_for_a_place():
    """Every kind in many looks, and whole homes: where two faces lie in one plane, at most 1 cm2 shows either."""
    builder = MeshBuilder()
    rng, drawn = np.random.default_rng(0), [""]
    stock = draw_stock(rng)
    details = {"kitchen": ("NDHD", "RDSN"), "counter": ("DSWR", "HN"), "sofa": ("left", "right"),
               "chaise": ("left", "right")}  # fmt: skip
    for kind in KINDS:
        for k in range(24):
            size = random_size(kind, rng, 2.6)
            detail = details.get(kind, ("",))[k % 2 if kind in details else 0]
            width = 0.6 * len(detail) if kind in ("kitchen", "counter") else size[1]
            item = Furniture(kind, 0.0, 0.0, 0.0, size[0], width, size[2], detail=detail)
            paint = SolidPainter(builder, Lighting(0.0), 0.0, 0.0, 0.0, 1.0, builder.new_instance(FURNITURE))
            DRAW[kind](paint, item, Look(np.random.default_rng([k, 5]), stock=stock))
            paint.flush()
            drawn.append(f"{kind} {k}")
    assert [(drawn[number], area) for number, area in overlaps(Drawn(builder.finish(0)))] == []
    for seed in range(3):
        scene = build_scene(generate(seed), furniture=0.8, seed=seed, shut_doors=0.3)
        assert [(int(scene.instance_semantic[number]), area) for number, area in overlaps(scene)] == []


def test_faces_that_fight_are_found():
    builder = MeshBuilder()
    number = builder.new_instance(FURNITURE)
    for tint, shift in ((1.0, 0.0), (0.5, 0.98), (0.5, 3.0)):
        builder.add_quad("plaster", (shift, 0, 0), (1, 0, 0), (0, 0, 1), 1.0, number, tint=tint)
    # 2 cm x 1 m, in the triangles of both; the third quad lies apart.
    assert sum(area for _, area in overlaps(Drawn(builder.finish(0)))) == pytest.approx(0.02, abs=1e-6)
