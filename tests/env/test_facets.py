"""Facets against the faces that they are merged from."""

import math

import numpy as np
import pytest
import trimesh

from galoc import Floorplan, GalocError
from galoc_env.homes import generate
from galoc_env.render.facets import MOST_CORNERS, Facets, build_facets
from galoc_env.scene import Scene, build_scene
from galoc_env.scene.mesh import FURNITURE, WALL, MeshBuilder, SceneMesh

ROOM = np.array([[0, 0, 4, 0], [4, 0, 4, 3], [4, 3, 0, 3], [0, 3, 0, 0]], float)


def scene_of(meshes: tuple[SceneMesh, ...], instances: int = 1) -> Scene:
    plan = Floorplan.from_segments(ROOM, ceiling_height=2.5)
    return Scene(plan, meshes, (), np.zeros((0, 4)), np.full(instances + 1, FURNITURE, np.int8))


def soup(points: np.ndarray, faces: np.ndarray, uv: np.ndarray | None = None) -> Scene:
    """A scene of one instance from bare triangles."""
    mesh = trimesh.Trimesh(points, faces, process=False, validate=False)
    mesh.visual = trimesh.visual.TextureVisuals(uv=points[:, :2] if uv is None else uv)
    count = len(faces)
    given = SceneMesh(
        "wood",
        mesh,
        np.full((len(points), 3), 255, np.uint8),
        np.ones((count, 3), np.float32),
        np.zeros(count, np.float32),
        np.full(count, FURNITURE, np.int8),
        np.ones(count, np.int32),
    )
    return scene_of((given,))


def corners(facets: Facets, i: int) -> np.ndarray:
    return facets.vertices[facets.first[i] : facets.first[i + 1]].astype(float)


def areas(facets: Facets) -> np.ndarray:
    """Area of each facet by its corners, m^2; negative if they run clockwise."""
    out = np.zeros(len(facets.plane))
    for i in range(len(out)):
        p = corners(facets, i)
        out[i] = np.cross(p[1:-1] - p[0], p[2:] - p[0]).sum(axis=0) @ facets.plane[i, :3] / 2
    return out


def check_shapes(facets: Facets) -> None:
    """Every facet is flat, convex, counter-clockwise and has 3 to 16 corners."""
    count = np.diff(facets.first)
    assert count.min() >= 3 and count.max() <= MOST_CORNERS
    for i in range(len(count)):
        p = corners(facets, i)
        n, d = facets.plane[i, :3].astype(float), facets.plane[i, 3]
        np.testing.assert_allclose(p @ n, d, atol=2e-5)  # m: float32 at tens of metres
        edge = np.roll(p, -1, axis=0) - p
        turn = np.cross(edge, np.roll(edge, -1, axis=0)) @ n
        # A corner that is hardly one is nearly straight in float32: 1e-6 m beside the line of its neighbours.
        assert (turn > -1e-6 * np.linalg.norm(edge, axis=1).max()).all()


@pytest.fixture(scope="module", params=[0, 3])
def home(request: pytest.FixtureRequest) -> tuple[Scene, Facets]:
    scene = build_scene(generate(request.param), furniture=0.6, seed=request.param)
    return scene, build_facets(scene)


def test_every_instance_keeps_its_area(home: tuple[Scene, Facets]) -> None:
    scene, facets = home
    expected = np.zeros(len(scene.instance_semantic))
    for mesh in scene.meshes:
        np.add.at(expected, mesh.instance, mesh.mesh.area_faces)
    got = np.bincount(facets.instance, areas(facets), len(expected))
    np.testing.assert_allclose(got, expected, rtol=1e-4, atol=1e-5)  # m^2: float32 corners
    check_shapes(facets)


def test_points_keep_what_they_wear(home: tuple[Scene, Facets], rng: np.random.Generator) -> None:
    """A random point of a face lies on one facet of that plane, with the same texture coordinate, tint and class."""
    scene, facets = home
    centre = np.array([corners(facets, i).mean(axis=0) for i in range(len(facets.plane))])
    for _ in range(300):
        number = int(rng.integers(len(scene.meshes)))
        given = scene.meshes[number]
        k = int(rng.integers(len(given.mesh.faces)))
        weights = rng.dirichlet(np.ones(3))
        index, uv = given.mesh.faces[k], np.asarray(given.mesh.visual.uv)  # type: ignore[union-attr]
        p = weights @ given.mesh.vertices[index] - facets.origin
        found = np.flatnonzero(
            (facets.instance == given.instance[k])
            & (facets.material == number)
            & (np.abs(facets.plane[:, :3] @ p - facets.plane[:, 3]) < 1e-4)
            & (facets.plane[:, :3] @ given.mesh.face_normals[k] > 0.999)
        )
        inside = []
        for i in found.tolist():
            q, n = corners(facets, i), facets.plane[i, :3]
            edge = np.roll(q, -1, axis=0) - q
            if (np.cross(edge, p - q) @ n >= -1e-5 * np.linalg.norm(edge, axis=1)).all():
                inside.append(i)
        assert inside, f"no facet at {p}, nearest {centre[np.argmin(np.linalg.norm(centre - p, axis=1))]}"
        if weights.min() < 0.02:
            continue  # on an edge either side of a seam is right
        same = []  # faces of one instance may overlap in one plane
        for i in inside:
            off = facets.texture[i, :, :3] @ p + facets.texture[i, :, 3] - weights @ uv[index]
            alike = np.array_equal(facets.tint[i], given.tint[k]) and facets.glow[i] == given.glow[k]
            # Texture widths: 1e-3 is a quarter of a texel.
            same.append(alike and facets.semantic[i] == given.semantic[k] and np.abs(off - np.rint(off)).max() < 1e-3)
        assert any(same)
        assert facets.materials[number] == given.name


def test_light_rectangles_cover_their_facets(home: tuple[Scene, Facets]) -> None:
    _, facets = home
    assert facets.light_size.min() >= 2 and facets.light_size.max() <= 64
    np.testing.assert_array_equal(np.diff(facets.light_first), facets.light_size.prod(axis=1))
    for i in range(len(facets.plane)):
        place = corners(facets, i) @ facets.light[i, :, :3].T + facets.light[i, :, 3]
        assert (place > -1e-3).all() and (place < facets.light_size[i] - 1 + 1e-3).all()  # texels
        # The axes lie in the plane and are at right angles.
        axes = facets.light[i, :, :3].astype(float)
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        assert abs(axes[0] @ axes[1]) < 1e-5 and np.abs(axes @ facets.plane[i, :3]).max() < 1e-5


def test_light_texels_of_a_scene_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hundred sheets of 4 m in steps of 20 cm are 44 100 texels; at most 9000 leaves a spacing below 50 cm."""
    x, y = (np.arange(10) * 5.0 for _ in range(2))
    corner = np.array([(a, b, 0.0) for a in x for b in y])
    points = (corner[:, None] + np.array([[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]])).reshape(-1, 3)
    faces = np.concatenate([4 * np.arange(100)[:, None] + [0, 1, 2], 4 * np.arange(100)[:, None] + [0, 2, 3]])
    scene = soup(points, faces)
    assert build_facets(scene).light_first[-1] == 100 * 21 * 21
    monkeypatch.setattr("galoc_env.render.facets.MOST_LIGHT", 9000)
    few = build_facets(scene)
    assert 0.6 * 9000 < few.light_first[-1] <= 9000 and few.light_size.min() >= 4.0 / 0.5
    monkeypatch.setattr("galoc_env.render.facets.MOST_LIGHT", 100)  # cannot be: each has four at least
    assert build_facets(scene).light_first[-1] <= 5 * 100


def test_clusters_hold_their_facets(home: tuple[Scene, Facets]) -> None:
    _, facets = home
    assert facets.cluster_first[0] == 0 and facets.cluster_first[-1] == len(facets.plane)
    assert 1 <= np.diff(facets.cluster_first).min() and np.diff(facets.cluster_first).max() <= 24
    for c, (low, high) in enumerate(facets.cluster_box):
        start, end = facets.first[facets.cluster_first[c : c + 2]]
        np.testing.assert_array_equal(facets.vertices[start:end].min(axis=0), low)
        np.testing.assert_array_equal(facets.vertices[start:end].max(axis=0), high)


def test_homes_have_fewer_facets_than_half_their_faces(home: tuple[Scene, Facets]) -> None:
    scene, facets = home
    assert len(facets.plane) < 0.5 * sum(len(mesh.mesh.faces) for mesh in scene.meshes)


def test_same_scene_same_bytes(home: tuple[Scene, Facets]) -> None:
    scene, facets = home
    again = build_facets(scene)
    for name in Facets.__slots__:
        a, b = getattr(facets, name), getattr(again, name)
        assert a == b if isinstance(a, tuple) else a.tobytes() == b.tobytes(), name


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_grid_becomes_one_rectangle(turn: float) -> None:
    """As walls are cut for vertex light: uneven rows and columns, back to four corners."""
    s, z = np.meshgrid([0.0, 0.5, 0.7, 3.1, 4.0], [-0.02, 0.08, 0.5, 2.0, 2.5])
    points = np.column_stack([s.ravel() * math.cos(turn), s.ravel() * math.sin(turn), z.ravel()])
    i, j = np.meshgrid(range(4), range(4), indexing="ij")
    a = (5 * i + j).ravel()
    faces = np.concatenate([np.stack([a, a + 1, a + 6], 1), np.stack([a, a + 6, a + 5], 1)])
    facets = build_facets(soup(points, faces, np.column_stack([s.ravel(), z.ravel()])))
    assert len(facets.plane) == 1 and len(facets.vertices) == 4
    assert areas(facets)[0] == pytest.approx(4.0 * 2.52, rel=1e-6)


def test_both_sides_of_a_sheet_stay_apart() -> None:
    builder = MeshBuilder()
    wall = builder.new_instance(WALL)
    builder.add_quad("plaster", (0, 0, 0), (3, 0, 0), (0, 0, 2), 1.0, wall)
    builder.add_quad("plaster", (3, 0, 0), (-3, 0, 0), (0, 0, 2), 1.0, wall)
    facets = build_facets(scene_of(builder.finish(0)))
    assert sorted(facets.plane[:, 1]) == [-1.0, 1.0]
    check_shapes(facets)


@pytest.mark.parametrize("change", ["tint", "glow", "texture", "instance"])
def test_what_differs_is_not_merged(change: str) -> None:
    builder = MeshBuilder()
    one, two = builder.new_instance(WALL), builder.new_instance(WALL)
    builder.add_quad("plaster", (0, 0, 0), (1, 0, 0), (0, 0, 1), 1.0, one, (0.0, 0.0))
    shift = 1.3 if change == "texture" else 1.0
    builder.add_quad(
        "plaster",
        (1, 0, 0),
        (1, 0, 0),
        (0, 0, 1),
        1.0,
        two if change == "instance" else one,
        (shift, 0.0),
        tint=0.5 if change == "tint" else 1.0,
        glow=0.5 if change == "glow" else 0.0,
    )
    assert len(build_facets(scene_of(builder.finish(0), 2)).plane) == 2


def test_a_curved_body_keeps_its_triangles() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.5)
    facets = build_facets(soup(np.asarray(ball.vertices), np.asarray(ball.faces)))
    assert len(facets.plane) == len(ball.faces)
    assert areas(facets).sum() == pytest.approx(ball.area, rel=1e-5)
    check_shapes(facets)


def test_a_disc_of_many_corners_is_cut() -> None:
    """40 corners: pieces of at most 16, which still are the whole."""
    angle = 2 * np.pi * np.arange(40) / 40
    points = np.column_stack([np.cos(angle), np.sin(angle), np.full(40, 0.7)])
    faces = np.stack([np.zeros(38, int), np.arange(1, 39), np.arange(2, 40)], 1)
    facets = build_facets(soup(points, faces))
    assert 3 <= len(facets.plane) <= 6
    assert areas(facets).sum() == pytest.approx(20 * math.sin(2 * math.pi / 40), rel=1e-5)
    check_shapes(facets)


def test_random_triangulations_are_tiled(rng: np.random.Generator) -> None:
    """Delaunay triangles of a rectangle with a hole, in a slanting plane: the same area, in convex pieces."""
    from scipy.spatial import Delaunay

    for _ in range(10):
        flat = np.concatenate([rng.uniform(0, 5, (40, 2)), [[0, 0], [5, 0], [5, 5], [0, 5]]])
        faces = Delaunay(flat).simplices
        middle = flat[faces].mean(axis=1)
        faces = faces[np.abs(middle - 2.5).max(axis=1) > 0.8]
        x, y = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
        points = flat[:, :1] * x + flat[:, 1:] * y
        edge = flat[faces[:, 1:]] - flat[faces[:, :1]]
        area = edge[:, 0, 0] * edge[:, 1, 1] - edge[:, 0, 1] * edge[:, 1, 0]
        faces[area < 0] = faces[area < 0][:, ::-1]
        facets = build_facets(soup(points, faces, flat))
        assert areas(facets).sum() == pytest.approx(np.abs(area).sum() / 2, rel=1e-5)
        assert len(facets.plane) < 0.7 * len(faces)
        check_shapes(facets)


def test_far_from_zero_nothing_is_lost() -> None:
    """50 km away, in metres: corners are still right to 0.01 mm, which float32 alone would not give."""
    points = np.array([[0, 0, 0], [1.2345678, 0, 0], [1.2345678, 2.3456789, 0], [0, 2.3456789, 0]])
    far = points + [50_000.25, -50_000.5, 0.0]
    facets = build_facets(soup(far, np.array([[0, 1, 2], [0, 2, 3]]), points[:, :2]))
    got = facets.vertices + facets.origin
    for p in far:
        assert np.linalg.norm(got - p, axis=1).min() < 1e-5


def test_faces_without_area_are_dropped() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [2, 0, 0]], float)
    facets = build_facets(soup(points, np.array([[0, 1, 2], [0, 1, 3], [0, 0, 1]])))
    assert len(facets.plane) == 1


def test_a_scene_without_faces() -> None:
    facets = build_facets(scene_of(()))
    assert len(facets.plane) == 0 and facets.light_first.tolist() == [0] and facets.cluster_first.tolist() == [0]


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_corner_that_is_no_number(value: float) -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [1, value, 0]])
    with pytest.raises(GalocError, match="finite"):
        build_facets(soup(points, np.array([[0, 1, 2]]), np.zeros((3, 2))))
