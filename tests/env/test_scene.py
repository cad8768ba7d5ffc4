"""The scene: right surfaces in the right places, each with its class, instance and texture."""

import math
from pathlib import Path

import numpy as np
import pytest
from test_furniture import turned_plan

from galoc import Floorplan, GalocError
from galoc.floorplan import Opening
from galoc_env.materials import NAMES, material
from galoc_env.scene import Scene, build_scene
from galoc_env.scene.mesh import CEILING, DOOR, FLOOR, FURNITURE, OUTSIDE, WALL, WINDOW
from galoc_env.scene.rooms import MARGIN, find_rooms
from galoc_env.scene.walls import OVERLAP

PLANS = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "plans"
THICK = 0.3
MOST_MESHES = len(NAMES) + 4
"""One for each material at most; of pictures and outdoors there may be some more."""


def house() -> Floorplan:
    """The two rooms with outer walls 30 cm thick, a door between them and two windows."""
    inner = turned_plan()
    outer = [[-0.3, -0.3, 9.3, -0.3], [9.3, -0.3, 9.3, 4.3], [9.3, 4.3, -0.3, 4.3], [-0.3, 4.3, -0.3, -0.3]]
    windows = (
        Opening("window", 1.5, 4.15, 3.2, 4.15, THICK, 0.9, 2.2),
        Opening("window", 9.15, 1.0, 9.15, 2.0, THICK, 0.9, 2.2),
    )
    return Floorplan(np.vstack([inner.segments, outer]), 2.6, inner.openings + windows, name="house")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return build_scene(house(), furniture=0.6, seed=3)


def faces(scene, semantic):
    """Triangles (F, 3, 3) of one class, with their instances."""
    found = [(m.mesh.triangles[m.semantic == semantic], m.instance[m.semantic == semantic]) for m in scene.meshes]
    return np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])


def area_normals(triangles):
    return 0.5 * np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def total_area(triangles):
    return np.linalg.norm(area_normals(triangles), axis=1).sum()


def test_tables_agree(scene):
    assert 1 <= len(scene.meshes) <= MOST_MESHES
    assert [m.name for m in scene.meshes] == sorted({m.name for m in scene.meshes})
    for m in scene.meshes:
        assert len(m.semantic) == len(m.instance) == len(m.mesh.faces)
        assert len(m.shade) == len(m.mesh.vertices) == len(m.mesh.visual.uv)
        assert m.instance.min() >= 1
        np.testing.assert_array_equal(scene.instance_semantic[m.instance], m.semantic)
    used = np.unique(np.concatenate([m.instance for m in scene.meshes]))
    np.testing.assert_array_equal(used, np.arange(1, len(scene.instance_semantic)))  # no number is wasted
    assert np.count_nonzero(scene.instance_semantic == FURNITURE) == len(scene.furniture) > 0
    assert np.count_nonzero(scene.instance_semantic == WALL) == len(scene.plan.segments)


def test_walls_fill_their_segments_on_both_sides(scene):
    """Area of each segment's faces = 2 sides x length x height, less the windows in it."""
    triangles, instance = faces(scene, WALL)
    areas = np.linalg.norm(area_normals(triangles), axis=1)
    height = scene.plan.ceiling_height + 2 * OVERLAP
    holes = {10: (1.7, 1.3), 5: (1.0, 1.3), 14: (1.7, 1.3), 13: (1.0, 1.3)}  # segment: width, height of its window
    for i, (x1, y1, x2, y2) in enumerate(scene.plan.segments):
        mine = triangles[instance == i + 1]
        wide, high = holes.get(i, (0.0, 0.0))
        expected = 2 * (math.hypot(x2 - x1, y2 - y1) * height - wide * high)
        assert areas[instance == i + 1].sum() == pytest.approx(expected, rel=1e-9)
        normal = np.array([y1 - y2, x2 - x1]) / math.hypot(x2 - x1, y2 - y1)
        assert np.abs((mine[..., :2] - (x1, y1)) @ normal).max() < 1e-9  # in the segment's plane
        assert np.abs(area_normals(mine).sum(axis=0)).max() < 1e-9  # as much seen from one side as from the other
        assert mine[..., 2].min() == pytest.approx(-OVERLAP) and mine[..., 2].max() == pytest.approx(2.6 + OVERLAP)


def test_a_window_only_cuts_the_walls_it_lies_in():
    plan = house()
    skew = math.radians(4)
    near_but_turned = [1.5, 4.05, 1.5 + math.cos(skew), 4.05 + math.sin(skew)]
    parallel_but_off = [1.5, 3.7, 3.2, 3.7]
    more = Floorplan(np.vstack([plan.segments, [near_but_turned, parallel_but_off]]), 2.6, plan.openings)
    triangles, instance = faces(build_scene(more, furniture=0.0), WALL)
    for k, length in ((len(plan.segments), 1.0), (len(plan.segments) + 1, 1.7)):
        assert total_area(triangles[instance == k + 1]) == pytest.approx(2 * length * (2.6 + 2 * OVERLAP), rel=1e-6)


def test_floor_and_ceiling_cover_the_plan_once(scene):
    box = (9.6 + 2 * MARGIN) * (4.6 + 2 * MARGIN)
    for semantic, z, sign in ((FLOOR, 0.0, 1.0), (CEILING, 2.6, -1.0)):
        triangles, _ = faces(scene, semantic)
        level = triangles[np.abs(triangles[..., 2] - z).max(axis=1) < 1e-9]  # without door steps
        normals = area_normals(level)
        assert np.all(sign * normals[:, 2] > 0)
        assert np.abs(normals[:, 2]).sum() == pytest.approx(box, rel=1e-3)  # rooms are snapped to a millimetre


def test_door_is_open_below_its_lintel(scene):
    triangles, instance = faces(scene, DOOR)
    triangles = triangles[instance == np.flatnonzero(scene.instance_semantic == DOOR)[0]]  # without the leaf
    assert triangles[..., 2].max() == pytest.approx(2.6 + OVERLAP)
    low = triangles.reshape(-1, 3)
    low = low[low[:, 2] < 2.0]
    along = low[:, 1] - 1.95  # the door runs along y from 1.5 to 2.4, so this is the distance from its middle
    assert np.all(np.abs(along) > 0.45 - 0.03)  # frames stand out into the opening by less than 3 cm
    assert np.all(np.abs(low[:, 0] - 5.075) < 0.075 + 0.03)  # and off the wall by less than 3 cm
    lintel = triangles[(triangles[..., 2].min(axis=1) > 2.04) & (np.abs(area_normals(triangles)[:, 0]) > 1e-3)]
    across = lintel[np.abs(lintel[..., 1] - 1.95).max(axis=1) < 0.451]
    sides = across[np.abs(np.abs(across[..., 0] - 5.075) - 0.075).max(axis=1) < 1e-9]
    assert total_area(sides) >= 2 * 0.9 * 0.55  # both sides of the lintel, 0.9 m wide and 0.55 m high


def test_a_thin_wall_gets_a_lintel_too():
    walls = [[0, 0, 6, 0], [6, 0, 6, 4], [6, 4, 0, 4], [0, 4, 0, 0], [3, 0, 3, 1.5], [3, 2.5, 3, 4]]
    plan = Floorplan(np.array(walls, float), 2.6, (Opening("door", 3, 1.5, 3, 2.5, 0.0, 0.0, 2.1),))
    triangles, _ = faces(build_scene(plan, furniture=0.0), DOOR)
    assert np.ptp(triangles[..., 0]) >= 0.02 and triangles[..., 2].max() > 2.6
    assert len(find_rooms(plan, np.random.default_rng(0)).polygons) == 2


def test_window_reveals_face_the_hole(scene):
    """Every reveal face turns towards the middle of its window; the pane fills the hole, seen from both sides."""
    window = scene.plan.openings[1]
    middle = np.array([(window.x1 + window.x2) / 2, window.y1, (window.bottom + window.top) / 2])
    triangles, instance = faces(scene, WINDOW)
    first = triangles[instance == np.flatnonzero(scene.instance_semantic == WINDOW)[0]]
    normals = area_normals(first)
    # Faces from the pane to a face of the wall: the reveal, in two halves.
    off = np.sort(np.abs(first[..., 1] - window.y1), axis=1)
    span = (off[:, 0] < 1e-9) & (np.abs(off[:, 2] - THICK / 2) < 1e-9)
    assert total_area(first[span]) == pytest.approx(2 * THICK * (window.width + 1.3), rel=1e-6)
    assert np.all(((middle - first.mean(axis=1)) * normals)[span].sum(axis=1) > 0)
    panes, instance = faces(scene, OUTSIDE)
    assert total_area(panes[instance == instance.min()]) == pytest.approx(2 * window.width * 1.3, rel=1e-6)


def test_textures_are_neither_stretched_nor_mirrored(scene):
    for m in scene.meshes:
        size = material(m.name, 3).size_m
        uv = np.asarray(m.mesh.visual.uv)[m.mesh.faces] * size
        a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
        signed = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        true = m.mesh.area_faces
        flat = ~np.isin(m.semantic, [FURNITURE]) & (true > 1e-6)
        np.testing.assert_allclose(signed[flat], true[flat], rtol=2e-4)
        assert np.all(signed[true > 1e-6] > 0)


def test_light_tells_surfaces_apart():
    room = build_scene(Floorplan.from_segments([[0, 0, 4, 0], [4, 0, 4, 3], [4, 3, 0, 3], [0, 3, 0, 0]]), furniture=0.0)
    mean = []
    for number in np.flatnonzero(room.instance_semantic == WALL):
        z, light = [], []
        for m in room.meshes:
            inwards = ((2.0, 1.5, 1.3) - m.mesh.triangles_center) * m.mesh.face_normals
            mine = np.flatnonzero((m.instance == number) & (inwards.sum(axis=1) > 0))
            corner = m.mesh.faces[mine].ravel()
            z.append(m.mesh.vertices[corner, 2])
            light.append((m.shade[corner] / np.repeat(m.tint[mine], 3, axis=0)).max(axis=1))  # whatever paint it wears
        height, bright = np.concatenate(z), np.concatenate(light)
        middle = bright[(height > 0.4) & (height < 2.2)].mean()
        mean.append(middle)
        assert bright[height > 2.55].mean() < 0.95 * middle  # darker towards the ceiling
    assert len(mean) == 4
    assert np.diff(np.sort(mean)).min() > 1.5  # of 255: no two of the four walls are equally bright
    assert np.ptp(mean) > 20


def test_rooms_are_found_with_doors_closed():
    rooms = find_rooms(house(), np.random.default_rng(0))
    assert [round(p.area, 1) for p in rooms.polygons] == [20.0, 15.4]
    np.testing.assert_array_equal(rooms.at([[1, 1], [6, 1], [5.075, 0.5], [5.075, 2.0], [20, 20]]), [0, 1, -2, -2, -1])


def test_same_seed_same_scene():
    first, again, other = (build_scene(house(), furniture=0.6, seed=s) for s in (5, 5, 6))
    assert first.furniture == again.furniture != other.furniture
    for a, b in zip(first.meshes, again.meshes, strict=True):
        assert a.name == b.name and a.mesh.vertices.tobytes() == b.mesh.vertices.tobytes()
        assert a.shade.tobytes() == b.shade.tobytes() and a.instance.tobytes() == b.instance.tobytes()
    assert [m.shade.tobytes() for m in first.meshes] != [m.shade.tobytes() for m in other.meshes]


def test_obstacles_are_the_footprints(scene):
    standing = [item.edges() for item in scene.furniture]
    np.testing.assert_array_equal(scene.obstacles, np.concatenate([*standing, scene.leaves]))
    assert len(scene.leaves) % 4 == 0
    for k, number in enumerate(np.flatnonzero(scene.instance_semantic == FURNITURE)):
        triangles, instance = faces(scene, FURNITURE)
        points = triangles[instance == number].reshape(-1, 3)
        item = scene.furniture[k]
        assert item.distance(points[:, :2]).max() < 0.03  # what is drawn stays inside what is collided with
        assert points[:, 2].max() <= item.height + 0.51 and points[:, 2].min() >= 0.0  # a desk carries a screen


def test_export_and_reload(scene, tmp_path):
    import trimesh

    path = scene.export(tmp_path / "home.glb")
    assert [p.name for p in tmp_path.iterdir()] == ["home.glb"]
    loaded = trimesh.load_scene(path)
    assert set(loaded.geometry) == {m.name for m in scene.meshes}
    assert sum(len(g.faces) for g in loaded.geometry.values()) == sum(len(m.mesh.faces) for m in scene.meshes)
    # glTF has y up: plan (x, y, z) is stored as (x, z, -y).
    low, high = loaded.bounds
    np.testing.assert_allclose([low[0], -high[2], low[1]], scene.as_trimesh().bounds[0], atol=1e-5)
    np.testing.assert_allclose([high[0], -low[2], high[1]], scene.as_trimesh().bounds[1], atol=1e-5)
    assert scene.meshes[0].mesh.bounds[0][2] >= -OVERLAP - 1e-9  # exporting turned a copy


def test_bad_arguments(scene, tmp_path):
    with pytest.raises(GalocError, match="seed"):
        build_scene(house(), seed=-1)
    with pytest.raises(GalocError, match="density"):
        build_scene(house(), furniture=2.0)
    with pytest.raises(GalocError, match=r"\.glb"):
        scene.export(tmp_path / "home.obj")
    with pytest.raises(GalocError, match="folder"):
        scene.export(tmp_path / "missing" / "home.glb")
    assert list(tmp_path.iterdir()) == []


def test_a_huge_plan_builds():
    path = PLANS / "amrl_maps" / "GHC4.json"
    if not path.exists():
        pytest.skip("the shared real plans are not beside this checkout")
    plan = Floorplan.load(path)
    big = build_scene(plan, furniture=0.0, seed=0)
    assert len(big.meshes) <= MOST_MESHES
    assert np.count_nonzero(big.instance_semantic == WALL) == len(plan.segments)
    assert sum(len(m.mesh.faces) for m in big.meshes) < 200_000
