"""Doors, windows, fittings and lamps: each in its place, none in the way."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest
import shapely
from test_furniture import turned_plan
from test_scene import faces

from galoc import Floorplan, GalocError
from galoc_env import motion
from galoc_env.furniture import AGENT_RADIUS, Furniture
from galoc_env.homes import generate
from galoc_env.scene import build_scene, fittings
from galoc_env.scene.doors import BARE_SHARE, THICKNESS, hang_leaves
from galoc_env.scene.ground import Clutter, Ground
from galoc_env.scene.lamps import HEAD_ROOM
from galoc_env.scene.mesh import DOOR, FITTING, OUTSIDE, SEMANTIC_NAMES, WALL, WINDOW
from galoc_env.scene.rooms import find_rooms
from galoc_env.scene.styles import USES
from galoc_env.scene.windows import GLOW

SEEDS = range(8)


@pytest.fixture(scope="module")
def homes():
    """Furnished homes, with how many doors could have a leaf."""
    return [(plan, build_scene(plan, furniture=0.6, seed=seed)) for seed in SEEDS for plan in [generate(seed)]]


def doors_of(plan):
    return [o for o in plan.openings if o.kind == "door" and 0.55 <= o.width <= 1.3]


def outlines(edges):
    """Footprints from four edges each."""
    return [shapely.Polygon(group[:, :2]) for group in edges.reshape(-1, 4, 4)]


def test_most_doors_have_a_leaf(homes):
    doors = sum(len(doors_of(plan)) for plan, _ in homes)
    leaves = sum(len(scene.leaves) // 4 for _, scene in homes)
    assert doors > 20
    # A share has been taken off, and some find no place to stand open.
    assert (1 - BARE_SHARE) * 0.75 * doors < leaves < doors


def test_leaves_cross_nothing(homes):
    for plan, scene in homes:
        leaves = outlines(scene.leaves)
        walls = shapely.linestrings(plan.segments.reshape(-1, 2, 2))
        things = [shapely.Polygon(item.corners()) for item in scene.furniture if not item.flat]
        for k, leaf in enumerate(leaves):
            assert min(leaf.exterior.distance(wall) for wall in walls) > 0.0
            assert all(leaf.distance(other) > 0.03 for other in [*things, *leaves[:k]])
            door = min(plan.openings, key=lambda o: leaf.distance(shapely.Point((o.x1 + o.x2) / 2, (o.y1 + o.y2) / 2)))
            assert door.kind == "door"
            assert leaf.area == pytest.approx(THICKNESS * (door.width - 0.044), rel=0.4)


def test_leaves_are_what_is_collided_with(homes):
    _, scene = homes[0]
    triangles, instance = faces(scene, DOOR)
    boards = [n for n in np.unique(instance) if triangles[instance == n][..., 2].max() < 2.15]
    assert len(boards) == len(scene.leaves) // 4 > 0
    leaves = outlines(scene.leaves)
    for number in boards:
        points = triangles[instance == number].reshape(-1, 3)
        nearest = min(leaves, key=lambda leaf: leaf.distance(shapely.Point(points[0, :2])))
        # A handle stands 5 cm off the board.
        assert max(nearest.distance(shapely.Point(p)) for p in points[:, :2]) < 0.055
    np.testing.assert_array_equal(scene.obstacles[-len(scene.leaves) :], scene.leaves)
    assert scene.sight_plan is scene.plan


def test_an_open_leaf_takes_no_place_from_an_agent(homes):
    """Of two places that an agent could walk between without leaves, both off the leaves, it still can."""
    for plan, scene in homes:
        without = scene.obstacles[: -len(scene.leaves)] if len(scene.leaves) else scene.obstacles
        before = motion.walkable(plan, without)
        after = motion.walkable(plan, scene.obstacles)
        lost = before.positions[~np.isin(flat_cells(before), flat_cells(after))]
        if len(lost):
            edges = shapely.multilinestrings(shapely.linestrings(scene.leaves.reshape(-1, 2, 2)))
            away = shapely.distance(edges, shapely.points(lost))
            # Clearance, the grid's own diagonal twice, and a corner between leaf and wall that no disc gets into.
            assert away.max() < AGENT_RADIUS + 0.3
            assert len(lost) < 0.1 * before.mask.sum()


def flat_cells(walkable):
    return np.flatnonzero(walkable.mask.ravel())


def test_a_box_across_the_only_way_is_refused():
    plan = turned_plan()
    leaf = hang_leaves(plan, (), 1.0, np.random.default_rng(0))[0]
    assert not Ground(plan, ()).place(leaf.box())
    swung = hang_leaves(plan, (), 0.0, np.random.default_rng(2))[0]
    assert Ground(plan, ()).place(swung.box())


@pytest.mark.parametrize("angle", [0.0, 0.4])
def test_shut_doors_are_walls(angle):
    plan = turned_plan(angle)
    scene = build_scene(plan, furniture=0.0, seed=1, shut_doors=1.0)
    assert len(scene.leaves) == 0
    door = plan.openings[0]
    lines = scene.sight_plan.segments[len(plan.segments) :]
    np.testing.assert_array_equal(scene.obstacles, lines)
    assert scene.sight_plan.openings == ()
    assert len(lines) == 2
    middle = np.array([door.x1 + door.x2, door.y1 + door.y2]) / 2
    along = np.array([door.x2 - door.x1, door.y2 - door.y1]) / door.width
    for line in lines.reshape(2, 2, 2):
        assert np.linalg.norm(line[1] - line[0]) == pytest.approx(door.width)
        off = line.mean(axis=0) - middle
        assert abs(off @ along) < 1e-9 and np.linalg.norm(off) == pytest.approx(door.thickness / 2)
    # The two rooms are two now, for whoever walks.
    assert motion.walkable(plan, scene.obstacles).mask.sum() < 0.7 * motion.walkable(plan, np.zeros((0, 4))).mask.sum()
    triangles, instance = faces(scene, DOOR)
    leaf = triangles[instance == instance.max()]
    flat = np.abs((leaf[..., :2] - middle) @ along)
    assert flat.max() < door.width / 2  # it fills its hole and no more
    area = 0.5 * np.linalg.norm(np.cross(leaf[:, 1] - leaf[:, 0], leaf[:, 2] - leaf[:, 0]), axis=1).sum()
    assert area > 2 * 0.85 * 2.0


def test_a_share_of_doors_is_shut():
    plan = generate(1)
    doors = len(doors_of(plan))
    for share in (0.0, 0.5, 1.0):
        leaves = hang_leaves(plan, (), share, np.random.default_rng(3))
        assert sum(leaf.shut for leaf in leaves) == round(share * doors)
    for bad in (-0.1, 1.5, True, "all"):
        with pytest.raises(GalocError, match="shut_doors"):
            hang_leaves(plan, (), bad, np.random.default_rng(0))


def test_shutting_doors_moves_nothing_else():
    plan = generate(2)
    first, half, second = (build_scene(plan, furniture=0.6, seed=4, shut_doors=share) for share in (0.0, 0.5, 1.0))
    still = {leaf.tobytes() for leaf in half.leaves.reshape(-1, 4, 4)}
    assert still and still < {leaf.tobytes() for leaf in first.leaves.reshape(-1, 4, 4)}
    assert first.furniture == second.furniture
    assert first.lamps == second.lamps and first.sun == second.sun


def test_fittings_grow_with_the_density():
    plan = generate(3)
    count = [
        np.count_nonzero(build_scene(plan, furniture=density, seed=3).instance_semantic == FITTING)
        for density in (0.0, 0.3, 1.0)
    ]
    rooms = len(find_rooms(plan, np.random.default_rng(0)).polygons)
    assert rooms <= count[0] < count[1] < count[2]
    assert SEMANTIC_NAMES[FITTING] == "fitting"


def test_fittings_stay_in_their_rooms_and_off_furniture(homes):
    """No corner of a fitting is inside a wall or inside a piece of furniture, or hangs into a way."""
    for plan, scene in homes[:4]:
        triangles, instance = faces(scene, FITTING)
        walls = shapely.multilinestrings(shapely.linestrings(plan.segments.reshape(-1, 2, 2)))
        shapely.prepare(walls)
        space = plan.free_space()
        for number in np.unique(instance):
            points = triangles[instance == number].reshape(-1, 3)
            assert points[:, 2].min() >= -1e-9 and points[:, 2].max() <= plan.ceiling_height + 1e-6
            low = points[points[:, 2] < HEAD_ROOM - 0.05]
            if len(low):
                # Bodies keep 25 cm from walls.
                assert shapely.distance(walls, shapely.points(low[:, :2])).max() < 0.25
            middle = points[:, :2].mean(axis=0)
            assert space.inside[tuple(space.index(middle))] or shapely.distance(walls, shapely.Point(middle)) < 0.1
            for item in scene.furniture:
                if item.flat:
                    continue  # what stands at a wall may stand on a rug
                inside = (item.distance(points[:, :2]) == 0.0) & (points[:, 2] < item.height - 0.01)
                assert not inside.any()


def test_fittings_leave_windows_and_doors_free(homes):
    """Seen from the room, nothing that hangs on a wall reaches over the hole of a door, whichever way it stands."""
    for plan, scene in homes[:4]:
        triangles, _ = faces(scene, FITTING)
        points = triangles.reshape(-1, 3)
        for door in (o for o in plan.openings if o.kind == "door"):
            middle = np.array([door.x1 + door.x2, door.y1 + door.y2]) / 2
            along = np.array([door.x2 - door.x1, door.y2 - door.y1]) / door.width
            local = points[:, :2] - middle
            over = np.abs(local @ along) < door.width / 2 - 0.01
            near = np.abs(local @ [-along[1], along[0]]) < door.thickness / 2 + 0.2
            assert not (over & near & (points[:, 2] < door.top)).any()


def test_things_on_the_floor_stop_nobody():
    """They stand where no body's centre gets to, on the floor, and there are more of them in a fuller home."""
    count = []
    for density in (0.3, 1.0):
        standing = 0
        for seed in range(3):
            plan = generate(seed)
            scene = build_scene(plan, furniture=density, seed=seed)
            places = motion.walkable(plan, scene.obstacles).positions
            triangles, instance = faces(scene, FITTING)
            for number in np.unique(instance):
                points = triangles[instance == number].reshape(-1, 3)
                if points[:, 2].min() > 0.005 or points[:, 2].max() > 0.8:
                    continue  # radiators stand on a pipe, and reach lower
                standing += 1
                hull = shapely.MultiPoint(points[:, :2]).convex_hull
                assert shapely.distance(hull, shapely.points(places)).min() > 0.0
        count.append(standing)
    assert 0 < count[0] < 0.5 * count[1]


def test_screens_hang_over_no_seat_and_only_once(monkeypatch):
    """Where screens (sheets of "screen" on a wall) are all that is wanted: no room has two, nor one beside a stand."""
    for wanted in fittings._WANTED:
        monkeypatch.setitem(fittings._WANTED, wanted, {"tv": 1.0})
    for seed in range(5):
        plan = generate(seed)
        scene = build_scene(plan, furniture=1.0, seed=seed)
        rooms = find_rooms(plan, np.random.default_rng(0))
        screens = []
        for m in scene.meshes:
            if m.name == "screen":
                chosen = m.semantic == FITTING
                for number in np.unique(m.instance[chosen]):
                    screens.append(m.mesh.triangles[m.instance == number].reshape(-1, 3))
        middles = np.array([points[:, :2].mean(axis=0) for points in screens]).reshape(-1, 2)
        stands = [(item.x, item.y) for item in scene.furniture if item.kind == "tv_stand"]
        where = rooms.at(middles).tolist() + sorted(set(rooms.at(np.array(stands).reshape(-1, 2)).tolist()))
        inside = [room for room in where if room >= 0]
        assert screens
        assert len(inside) == len(set(inside))
        for points in screens:
            below = [item for item in scene.furniture if not item.flat and item.distance(points[:, :2]).min() < 0.1]
            assert all(item.height <= 0.55 for item in below)


def test_rugs_stop_nothing():
    rug = Furniture("rug", 2.0, 2.0, 0.0, 2.0, 2.0, 0.015)
    sofa = Furniture("sofa", 2.0, 2.0, 0.0, 2.0, 2.0, 0.8)
    assert not Clutter([rug]).hits([(2.0, 2.0)], 0.0) and Clutter([sofa]).hits([(2.0, 2.0)], 0.0)
    plan = turned_plan()
    door = hang_leaves(plan, (), 0.0, np.random.default_rng(2))[0].box()
    across = Furniture("rug", 5.0, 2.0, 0.0, 9.9, 3.9, 0.015)
    assert Ground(plan, (across,)).place(door)


def test_scuffs_lie_on_their_walls():
    """At most 2 mm before the wall that their instance stands for, below a metre: of the wall, and darker than it."""
    plan = generate(1)
    found = 0
    for density in (0.0, 1.0):
        scene = build_scene(plan, furniture=density, seed=1)
        for m in scene.meshes:
            for k in np.flatnonzero(m.semantic == WALL):
                x1, y1, x2, y2 = plan.segments[m.instance[k] - 1]
                normal = np.array([y1 - y2, x2 - x1]) / math.hypot(x2 - x1, y2 - y1)
                off = (m.mesh.triangles[k][:, :2] - (x1, y1)) @ normal
                assert np.abs(off).max() < 0.002
                if np.abs(off).min() > 0.001:
                    found += 1
                    assert density > 0.0 and m.mesh.triangles[k][:, 2].max() < 1.2
                    assert m.tint[k].max() < 0.95
    assert found > 4


def test_mouldings_and_beams_stay_under_the_ceiling_of_their_room():
    seen = {"moulding": 0, "beams": 0}
    for seed in range(12):
        plan = generate(seed)
        scene = build_scene(plan, furniture=1.0, seed=seed)
        rooms = find_rooms(plan, np.random.default_rng(0))
        for m in scene.meshes:
            mine = m.semantic == FITTING
            for number in np.unique(m.instance[mine]):
                triangles = m.mesh.triangles[m.instance == number]
                points = triangles.reshape(-1, 3)
                down = plan.ceiling_height - points[:, 2]
                if m.name == "ceiling":
                    seen["moulding"] += 1
                    assert down.min() > -1e-9 and down.max() < 0.15
                    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
                    assert np.all(normal[:, 2] <= 1e-9)  # seen from below
                elif m.name in ("walnut", "oak", "pine", "lacquer") and np.ptp(points[:, :2], axis=0).max() > 2.0:
                    if down.max() > 0.25 or down.min() > 1e-6:
                        continue
                    seen["beams"] += 1
                else:
                    continue
                middles = shapely.points(triangles.mean(axis=1)[:, :2])
                room = min(rooms.polygons, key=lambda room: shapely.distance(room, middles).sum())
                # Outlines are simplified by 2 mm; beams reach into oblique walls by half their width.
                slack = 0.004 if m.name == "ceiling" else 0.09
                assert shapely.distance(room, shapely.points(points[:, :2])).max() < slack
    assert seen["moulding"] > 3 and seen["beams"] > 1


def test_lamps_hang_in_rooms(homes):
    on = 0
    for plan, scene in homes:
        rooms = find_rooms(plan, np.random.default_rng(0))
        where = [(lamp.x, lamp.y) for lamp in scene.lamps]
        assert np.all(rooms.at(where) >= 0) and np.all(plan.free_space().clearance_at(where) > 0.05)
        for lamp in scene.lamps:
            assert 1.9 < lamp.z < plan.ceiling_height - 0.1
            assert all(0.1 < power < 6.0 for power in lamp.power)
        on += len(scene.lamps)
        glowing = sum(int(((m.glow > 0) & (m.semantic == FITTING)).sum()) for m in scene.meshes)
        assert glowing > 0 or not scene.lamps
    assert on > len(homes)


def test_half_the_days_are_sunny():
    plan = turned_plan()
    suns = [build_scene(plan, furniture=0.0, seed=seed).sun for seed in range(40)]
    shining = [sun for sun in suns if sun is not None]
    assert 8 < len(shining) < 32  # 4 standard deviations around 20
    for sun in shining:
        assert math.radians(15) <= sun.elevation <= math.radians(55)
        assert sun.power[0] > sun.power[1] > sun.power[2] > 1.0


def test_windows_shine(homes):
    exposure = []
    for _, scene in homes:
        glow = np.concatenate([m.glow[m.semantic == OUTSIDE] for m in scene.meshes])
        assert glow.min() >= GLOW[0] - 1e-6 and glow.max() <= GLOW[1] + 1e-6 and np.ptp(glow) == 0.0
        seen = glow * np.concatenate([m.tint[m.semantic == OUTSIDE][:, 0] for m in scene.meshes])
        exposure.append(seen[0])
        assert np.ptp(seen) < 1e-5  # one day outside all windows
    assert 0.9 < min(exposure) and max(exposure) < 2.7


def test_no_part_of_a_window_goes_through_its_pane(homes):
    """Behind it is no light: a face that goes on there would be dark on this side too."""
    for plan, scene in homes[:4]:
        triangles, _ = faces(scene, WINDOW)
        checked = 0
        for pane in (o for o in plan.openings if o.kind == "window"):
            normal = np.array([pane.y1 - pane.y2, pane.x2 - pane.x1]) / pane.width
            middle = np.array([pane.x1 + pane.x2, pane.y1 + pane.y2]) / 2
            mine = triangles[np.linalg.norm(triangles.mean(axis=1)[:, :2] - middle, axis=1) < pane.width / 2]
            off = (mine[..., :2] - middle) @ normal
            inner = mine[(np.abs(off).max(axis=1) < 0.5)]
            off = (inner[..., :2] - middle) @ normal
            assert not ((off.min(axis=1) < -1e-6) & (off.max(axis=1) > 1e-6)).any()
            checked += len(inner)
        assert checked > 100


def test_rooms_have_uses(homes):
    for plan, _ in homes:
        rooms = find_rooms(plan, np.random.default_rng(1))
        uses = [rooms.use(k) for k in range(len(rooms.polygons))]
        assert set(uses) <= set(USES) and uses.count("living") >= 1
        assert len(uses) < 5 or "kitchen" in uses
        assert rooms.use(-1) == rooms.use(-2) == "other"


def test_walls_come_in_many_looks():
    """Over a few homes walls wear most kinds of material, and some walls nearly match their ceilings."""
    worn, contrast = set(), []
    for seed in range(12):
        rooms = find_rooms(generate(seed), np.random.default_rng(seed))
        for style in rooms.styles:
            worn |= {coat.name for _, coat in style.bands((1.0, 0.0), 2.6)}
            if style.wall == "plaster":
                contrast.append(np.abs(style.wall_tint * 0.96 - style.ceiling_tint).max())
    assert len(worn) > 12
    contrast = np.array(contrast)
    assert 0.1 < np.mean(contrast < 0.04) < 0.7 and contrast.max() > 0.2


def test_bands_fill_the_wall():
    for seed in range(6):
        for style in find_rooms(generate(seed), np.random.default_rng(seed)).styles:
            tops = [top for top, _ in style.bands((0.0, 1.0), 2.5)]
            assert tops == sorted(tops) and tops[0] > 0.0 and tops[-1] == math.inf


def test_plans_without_rooms_doors_or_windows_build():
    lonely = Floorplan.from_segments([[0, 0, 4, 0], [4, 0, 4, 3], [1, 3, 0, 3]])
    scene = build_scene(lonely, furniture=0.5, shut_doors=1.0)
    assert len(scene.leaves) == 0
    assert scene.sight_plan is lonely


def test_facets_are_few():
    """A home stays light to draw: most faces are walls, and each fitting is a few facets."""
    scene = build_scene(generate(0), furniture=0.5, seed=0)
    triangles = {name: 0 for name in SEMANTIC_NAMES}
    for m in scene.meshes:
        for number, name in enumerate(SEMANTIC_NAMES):
            triangles[name] += int((m.semantic == number).sum())
    assert sum(triangles.values()) < 12_000
    assert triangles["fitting"] < 90 * np.count_nonzero(scene.instance_semantic == FITTING)
    assert triangles["wall"] < 45 * np.count_nonzero(scene.instance_semantic == WALL)


def test_leaves_are_closed_and_look_outwards(homes):
    """Their faces' area vectors cancel, and the faces turn outwards from their middle."""
    _, scene = homes[1]
    triangles, instance = faces(scene, DOOR)
    checked = 0
    for number in np.unique(instance):
        mine = triangles[instance == number]
        if mine[..., 2].max() > 2.15 or mine[..., 2].min() < 0.005:
            continue  # frames stand on the floor
        area = 0.5 * np.cross(mine[:, 1] - mine[:, 0], mine[:, 2] - mine[:, 0])
        # Panels and plates have no back: what is missing on one side is missing on the other.
        assert np.linalg.norm(area.sum(axis=0)) < 0.05 * np.linalg.norm(area, axis=1).sum()
        volume = ((mine[:, 0] - mine.mean(axis=(0, 1))) * area).sum() / 3
        assert volume > 0.9 * THICKNESS * 0.5 * 1.9  # m3: of the smallest leaf, without what stands on it
        checked += 1
    assert checked == len(scene.leaves) // 4 > 0


def test_another_process_builds_the_same_scene():
    """Hash seeds differ between processes; scenes do not."""
    script = """
import hashlib
from galoc_env.homes import generate
from galoc_env.scene import build_scene
scene = build_scene(generate(5), furniture=0.7, seed=5, shut_doors=0.3)
digest = hashlib.sha256(scene.obstacles.tobytes() + repr((scene.lamps, scene.sun)).encode())
for m in scene.meshes:
    for part in (m.mesh.vertices, m.mesh.visual.uv, m.tint, m.glow, m.shade, m.instance):
        digest.update(part.tobytes())
print(digest.hexdigest())
"""
    runs = [
        subprocess.run(
            [sys.executable, "-c", script],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("1", "2")
    ]
    assert runs[0] == runs[1] and len(runs[0]) == 65
