"""The raster renderer against rays cast through every triangle, against gl, and against itself drawn finer."""

import concurrent.futures
import dataclasses
import math
import multiprocessing
import os
import resource
import subprocess
import sys
import textwrap
from pathlib import Path

import cv2
import numba
import numpy as np
import pytest
from test_scene import house

from galoc import Camera, Floorplan, GalocError
from galoc_env.motion import walkable
from galoc_env.render import make_renderer, world_from_camera
from galoc_env.render._gloss_kernel import mirror
from galoc_env.render.arena import Arena
from galoc_env.scene import build_scene
from galoc_env.scene.mesh import FLOOR

CAMERA = Camera.from_hfov(96, 72, 100)
OFF_CENTRE = Camera(75, 61, 44.0, 40.0, 30.3, 33.7)
BENDS = [np.array(k, float) for k in ([[1, -2, 1]], [[1], [-2], [1]], [[1, 0, 0], [0, -2, 0], [0, 0, 1]])]
SHIPPED = ("apartment", "house", "office", "corridor", "gallery")


@pytest.fixture(scope="module")
def scene():
    return build_scene(house(), furniture=0.7, seed=3)


def views(scene, count, seed=0, tilt=0.3):
    """Random places where a body fits, at any heading, tilted, at several heights."""
    rng = np.random.default_rng(seed)
    positions = walkable(scene.plan, scene.obstacles).positions
    places = positions[rng.integers(len(positions), size=count)]
    return [
        ((*xy, rng.uniform(-math.pi, math.pi)), rng.uniform(0.3, 2.2), tuple(rng.uniform(-tilt, tilt, size=2)))
        for xy in places
    ]


def draw(scene, view, camera=CAMERA, quality="fast"):
    renderer = make_renderer("raster", scene, camera, quality=quality)
    frame = renderer.render(*view)
    renderer.close()
    return frame


def edges(*instances):
    """Pixels at which one of the pictures shows more than one instance within a pixel."""
    found = np.zeros(instances[0].shape, bool)
    for picture in instances:
        found |= cv2.morphologyEx(picture.astype(np.float32), cv2.MORPH_GRADIENT, np.ones((3, 3))) > 0
    return found


def cast(scene, view, camera, pixels):
    """Depth (N,) and instance (N,) at pixels (N, 2), by a ray through every triangle of the scene."""
    triangles = np.concatenate([m.mesh.triangles for m in scene.meshes])
    instance = np.concatenate([m.instance for m in scene.meshes])
    transform = world_from_camera(*view)
    rays = camera.rays_camera(pixels) @ transform[:3, :3].T
    a, b, c = (triangles[:, k] - transform[:3, 3] for k in range(3))
    normal = np.cross(b - a, c - a)
    facing = (a * normal).sum(axis=1) < 0
    a, b, c, normal, instance = a[facing], b[facing], c[facing], normal[facing], instance[facing]
    # A ray meets a triangle where its three barycentric volumes have one sign.
    volumes = [rays @ np.cross(p, q).T for p, q in ((b, c), (c, a), (a, b))]
    hit = np.all([v <= 0 for v in volumes], axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(hit, (a * normal).sum(axis=1) / (rays @ normal.T), np.inf)
    depth[depth < 0.005] = np.inf
    nearest = depth.argmin(axis=1)
    return depth[np.arange(len(rays)), nearest], instance[nearest]


@pytest.mark.parametrize("camera", [CAMERA, OFF_CENTRE])
def test_depth_and_instance_are_what_rays_meet(scene, camera):
    """Every third pixel of 8 tilted views: instances equal but at edges, depth to 1e-4 where the facet is the same."""
    v, u = np.mgrid[1 : camera.height : 3, 1 : camera.width : 3]
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    near_edge = off = total = 0
    for view in views(scene, 8):
        frame = draw(scene, view, camera)
        depth, instance = cast(scene, view, camera, pixels)
        mine = frame.instance[v, u].ravel()
        inside = ~edges(frame.instance)[v, u].ravel()
        np.testing.assert_array_equal(mine[inside], instance[inside])
        wrong = np.abs(frame.depth[v, u].ravel() / depth - 1.0) > 1e-4
        off += np.count_nonzero(wrong)
        near_edge += np.count_nonzero(mine != instance)
        total += len(pixels)
        np.testing.assert_array_equal(frame.semantic, scene.instance_semantic[frame.instance])
    assert near_edge < 0.002 * total  # rays through an edge itself
    assert off < 0.004 * total


def compare_with_gl(plans, poses, size):
    """Share of pixels away from edges at which instances differ, and the largest relative difference in depth."""
    camera = Camera.from_hfov(*size, 100)
    wrong = total = seen = 0
    worst = 0.0
    for number, plan in enumerate(plans):
        scene = build_scene(plan, furniture=0.6, seed=number)
        try:
            theirs = make_renderer("gl", scene, camera)
        except GalocError as error:
            pytest.skip(f"no OpenGL here: {error}")
        mine = make_renderer("raster", scene, camera, quality="fast")
        for view in views(scene, poses, seed=number):
            a, b = mine.render(*view), theirs.render(*view)
            if a.depth.min() < 0.06:
                continue  # a lamp's shade before the lens: gl cuts off what is nearer than 5 cm
            inside = ~edges(a.instance, b.instance)
            wrong += np.count_nonzero((a.instance != b.instance) & inside)
            total += np.count_nonzero(inside)
            # Within one instance a corner can hide another: compare where both see one plane.
            flat = inside & one_plane(a.depth) & one_plane(b.depth)
            worst = max(worst, np.abs(a.depth / b.depth - 1.0)[flat].max(initial=0.0))
            seen += np.count_nonzero(flat)
        theirs.close()
    assert seen > 0.5 * total
    return wrong / total, worst


def one_plane(depth):
    """Where inverse depth is linear over 3 x 3 pixels, to the 24 bits of a depth buffer."""
    inverse = 1.0 / depth.astype(np.float64)
    bend = [np.abs(cv2.filter2D(inverse, -1, kernel)) for kernel in BENDS]
    return np.max(bend, axis=0) < 6e-6


def test_gl_sees_the_same():
    wrong, worst = compare_with_gl([house()], 12, (160, 120))
    assert wrong <= 1e-4
    assert worst < 1e-4


def test_gl_sees_the_same_in_all_shipped_plans():
    wrong, worst = compare_with_gl([Floorplan.load(name) for name in SHIPPED], 24, (320, 240))
    assert wrong <= 1e-4
    assert worst < 1e-4


@pytest.mark.parametrize("view", views(build_scene(house(), furniture=0.0), 6, seed=4, tilt=1.45))
def test_no_hole_at_any_tilt(scene, view):
    """In closed rooms every pixel sees something, straight up and down included."""
    frame = draw(scene, view, Camera.from_hfov(160, 120, 120))
    assert np.all(frame.instance > 0)
    assert np.all(np.isfinite(frame.depth)) and frame.depth.min() > 0.00499


def test_a_wall_through_the_near_plane(scene):
    """2 cm from a wall, half of it behind the camera: the wall fills its part of the view."""
    frame = draw(scene, ((0.02, 2.0, math.pi / 2), 1.4, (0.0, 0.0)))
    assert np.all(frame.instance > 0)
    assert np.all(frame.instance[36, :20] == frame.instance[36, 5])  # the wall at x = 0 to the left
    assert frame.depth[36, 0] < 0.3
    ahead = draw(scene, ((0.01, 2.0, math.pi), 1.4, (0.0, 0.0)))  # 1 cm from it, facing it
    assert np.all(ahead.instance[30:50, 30:60] == frame.instance[36, 5])
    np.testing.assert_allclose(ahead.depth[30:50, 30:60], 0.01, atol=1e-4)


def test_inside_furniture(scene):
    """From inside a body its faces are not seen: the room beyond is."""
    item = scene.furniture[0]
    frame = draw(scene, ((item.x, item.y, 0.3), 0.25, (0.0, 0.1)))
    assert np.all(frame.instance > 0)


def test_degenerate_triangles_are_left_out(scene):
    import trimesh

    first = scene.meshes[0]
    corners = np.array([[1.0, 1, 1], [2, 1, 1], [3, 1, 1], [1, 1, 1], [1, 1, 1], [1, 1, 1]])
    vertices = np.concatenate([first.mesh.vertices, corners])
    more = np.arange(6).reshape(2, 3) + len(first.mesh.vertices)
    uv = np.concatenate([first.mesh.visual.uv, np.zeros((6, 2))])
    visual = trimesh.visual.TextureVisuals(uv=uv, material=first.mesh.visual.material)
    mesh = trimesh.Trimesh(vertices, np.concatenate([first.mesh.faces, more]), visual=visual, process=False)

    def longer(values):
        return np.concatenate([values, values[:1], values[:1]])

    changed = dataclasses.replace(
        first,
        mesh=mesh,
        tint=longer(first.tint),
        glow=longer(first.glow),
        semantic=longer(first.semantic),
        instance=longer(first.instance),
        shade=np.concatenate([first.shade, np.zeros((6, 3), np.uint8)]),
    )
    other = dataclasses.replace(scene, meshes=(changed, *scene.meshes[1:]))
    for view in views(scene, 3):
        np.testing.assert_array_equal(draw(scene, view).instance, draw(other, view).instance)


def test_any_triangle_mesh_can_be_drawn(scene):
    """A sphere of 320 triangles that no two share a plane: its outline is a circle, its depth that of a sphere."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.4)
    like = scene.meshes[0]
    ball.apply_translation((2.0, 2.0, 1.4))
    visual = trimesh.visual.TextureVisuals(uv=np.asarray(ball.vertices)[:, :2], material=like.mesh.visual.material)
    count = len(ball.faces)
    mesh = dataclasses.replace(
        like,
        name="ball",
        mesh=trimesh.Trimesh(ball.vertices, ball.faces, visual=visual, process=False),
        shade=np.full((len(ball.vertices), 3), 255, np.uint8),
        tint=np.ones((count, 3), np.float32),
        glow=np.zeros(count, np.float32),
        semantic=np.full(count, 6, np.int8),
        instance=np.full(count, len(scene.instance_semantic), np.int32),
    )
    empty = build_scene(house(), furniture=0.0)
    number = np.append(empty.instance_semantic, np.int8(6))
    mesh = dataclasses.replace(mesh, instance=np.full(count, len(number) - 1, np.int32))
    world = dataclasses.replace(empty, meshes=(*empty.meshes, mesh), instance_semantic=number)
    frame = draw(world, ((0.8, 2.0, 0.0), 1.4, (0.0, 0.0)), Camera.from_hfov(160, 120, 90))
    seen = frame.instance == len(number) - 1
    # A ball of radius r at distance d appears as a disc of tan(asin(r / d)) * f px.
    radius = math.tan(math.asin(0.4 / 1.2)) * 80.0
    assert np.count_nonzero(seen) == pytest.approx(math.pi * radius**2, rel=0.05)
    assert frame.depth[seen].min() == pytest.approx(0.8, abs=0.01)


def finer(scene, view, camera, factor):
    """The picture drawn ``factor`` times as fine and averaged, in squares as the renderer does."""
    fine = Camera(
        camera.width * factor, camera.height * factor, camera.fx * factor, camera.fy * factor,
        (camera.cx + 0.5) * factor - 0.5, (camera.cy + 0.5) * factor - 0.5,
    )  # fmt: skip
    rgb = draw(scene, view, fine).rgb.astype(float) ** 2
    shape = (camera.height, factor, camera.width, factor, 3)
    return np.sqrt(rgb.reshape(shape).mean(axis=(1, 3)))


def test_better_quality_comes_closer_to_a_finer_picture(scene):
    """At edges, the mean error against 6 x 6 samples: smooth edges halve it, "best" halves it again or more."""
    error = dict.fromkeys(("fast", "default", "best"), 0.0)
    for view in views(scene, 6, seed=2):
        exact = finer(scene, view, CAMERA, 6)
        frames = {quality: draw(scene, view, quality=quality) for quality in error}
        edge = edges(frames["fast"].instance)
        for quality, frame in frames.items():
            error[quality] += np.abs(frame.rgb - exact)[edge].mean()
            np.testing.assert_array_equal(frame.instance, frames["fast"].instance)
            np.testing.assert_array_equal(frame.depth, frames["fast"].depth)
    assert error["default"] < 0.6 * error["fast"]
    assert error["best"] < 0.6 * error["default"]


def test_glossy_floors_reflect_in_the_best_quality(scene, monkeypatch):
    """Gloss changes floors and nothing else, and the mirrored view's rays are those that a level floor throws back."""
    glossy = make_renderer("raster", scene, CAMERA, quality="best")
    monkeypatch.setattr("galoc_env.render.drawable.GLOSS", {})
    dull = make_renderer("raster", scene, CAMERA, quality="best")
    changed = 0
    for view in views(scene, 6, seed=1):
        frame, other = glossy.render(*view), dull.render(*view)
        differs = np.any(frame.rgb != other.rgb, axis=2)
        assert not np.any(differs & ~edges(frame.instance) & (frame.semantic != FLOOR))
        changed += np.count_nonzero(differs)
    assert changed > 200

    view = np.concatenate([world_from_camera((1.0, 2.0, 0.7), 1.4, (0.1, -0.2))[:3, :3].ravel(), (1.0, 2.0, 1.4)])
    below = np.empty(16)
    mirror.py_func(np.concatenate([view, np.ones(4)]), 0.25, below)
    rays = np.random.default_rng(0).normal(size=(20, 3))
    there, back = rays @ view[:9].reshape(3, 3).T, rays @ below[:9].reshape(3, 3).T
    np.testing.assert_allclose(back, there * (1, 1, -1), atol=1e-12)
    np.testing.assert_allclose(below[9:12], (1.0, 2.0, 0.25 - (1.4 - 0.25)), atol=1e-12)


def test_brightness_does_not_depend_on_quality_or_size(scene):
    view = views(scene, 1, seed=9)[0]
    means = [draw(scene, view, quality=q).rgb.mean() for q in ("fast", "default", "best")]
    means.append(draw(scene, view, Camera.from_hfov(384, 288, 100)).rgb.mean())
    assert np.ptp(means) < 1.5  # of 255


def test_views_are_checked_and_closed_renderers_say_so(scene):
    renderer = make_renderer("raster", scene, CAMERA)
    for view in (
        ((0.0, 0.0), 1.4, (0.0, 0.0)),
        ((0.0, math.nan, 0.0), 1.4, (0.0, 0.0)),
        ((1.0, 1.0, 0.0), math.inf, (0.0, 0.0)),
        ((1.0, 1.0, 0.0), 1.4, (0.0, 1.6)),
        ((1.0, 1.0, 0.0), 1.4, (math.nan, 0.0)),
        (((1.0, 1.0, 0.0), (1.0, 1.0, 0.0)), 1.4, (0.0, 0.0)),
        (("a", 1.0, 0.0), 1.4, (0.0, 0.0)),
        ((1.0, 1.0, 0.0), None, (0.0, 0.0)),
    ):
        with pytest.raises(GalocError):
            renderer.render(*view)
    renderer.close()
    renderer.close()
    with pytest.raises(GalocError, match="close"):
        renderer.render((1.0, 1.0, 0.0), 1.4, (0.0, 0.0))
    with pytest.raises(GalocError, match="quality"):
        make_renderer("raster", scene, CAMERA, quality="superb")
    with pytest.raises(GalocError, match="without faces"):
        make_renderer("raster", dataclasses.replace(scene, meshes=()), CAMERA)


def arena_of(scenes, quality="default"):
    arena = Arena(CAMERA, quality)
    return arena, [arena.add(scene) for scene in scenes]


def arena_frames(arena, homes, poses):
    count, shape = len(homes), (CAMERA.height, CAMERA.width)
    rgb = np.empty((count, *shape, 3), np.uint8)
    depth, instance = np.empty((count, *shape), np.float32), np.empty((count, *shape), np.int32)
    arena.render(
        np.array(homes),
        np.array([p[0] for p in poses]),
        np.array([p[1] for p in poses]),
        np.array([p[2] for p in poses]),
        rgb,
        depth,
        instance,
    )
    return rgb, depth, instance


@pytest.mark.parametrize("quality", ["fast", "default", "best"])
def test_an_arena_draws_what_single_renderers_draw(scene, quality):
    """Two homes, lanes mixed, one thread and two: byte for byte; also after a third home came and went."""
    other = build_scene(house(), furniture=0.2, seed=8)
    arena, numbers = arena_of([scene, other], quality)
    assert arena.add(scene) == numbers[0]  # known already
    order = [0, 1, 1, 0, 1]
    poses = [*views(scene, 1), *views(other, 2), *views(scene, 1, seed=5), *views(other, 1, seed=6)]
    single = [make_renderer("raster", s, CAMERA, quality=quality) for s in (scene, other)]
    expected = [single[k].render(*view) for k, view in zip(order, poses, strict=True)]
    before = numba.get_num_threads()
    try:
        for threads in sorted({1, min(2, numba.config.NUMBA_NUM_THREADS)}):
            numba.set_num_threads(threads)
            third = arena.add(build_scene(house(), furniture=0.0, seed=1))
            for _ in range(2):
                rgb, depth, instance = arena_frames(arena, [numbers[k] for k in order], poses)
                for k, frame in enumerate(expected):
                    np.testing.assert_array_equal(rgb[k], frame.rgb)
                    np.testing.assert_array_equal(depth[k], frame.depth)
                    np.testing.assert_array_equal(instance[k], frame.instance)
                if third is not None:
                    arena.remove(third)
                    third = None
    finally:
        numba.set_num_threads(before)


def test_arena_says_what_is_wrong(scene):
    arena, (home,) = arena_of([scene])
    rgb = np.empty((1, CAMERA.height, CAMERA.width, 3), np.uint8)
    good = (np.array([home]), np.zeros((1, 3)), np.ones(1), np.zeros((1, 2)))
    with pytest.raises(GalocError, match="home"):
        arena.render(np.array([home + 7]), *good[1:], rgb)
    with pytest.raises(GalocError, match="rgb"):
        arena.render(*good, rgb[:, :, ::-1])
    with pytest.raises(GalocError, match="depth"):
        arena.render(*good, rgb, np.empty((1, 3, 3), np.float32))
    with pytest.raises(GalocError, match="views"):
        arena.render(good[0], np.zeros((2, 3)), *good[2:], rgb)
    with pytest.raises(GalocError, match="home"):
        arena.remove(home + 7)
    with pytest.raises(GalocError, match="without homes"):
        Arena(CAMERA).render(*good, rgb)


def test_threads_and_forks(scene):
    view = views(scene, 1)[0]
    expected = draw(scene, view).rgb.tobytes()
    renderer = make_renderer("raster", scene, CAMERA, quality="fast")
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        for frame in pool.map(lambda _: renderer.render(*view), range(24)):
            assert frame.rgb.tobytes() == expected
    if sys.platform == "linux":
        context = multiprocessing.get_context("fork")
        queue = context.Queue()
        child = context.Process(target=lambda: queue.put(renderer.render(*view).rgb.tobytes()))
        import warnings

        with warnings.catch_warnings():  # newer Pythons warn of any fork beside threads
            warnings.simplefilter("ignore")
            child.start()
        assert queue.get(timeout=60) == expected
        child.join(timeout=60)


SCRIPT = """
    import hashlib, sys
    import numpy as np
    from test_scene import house
    from galoc import Camera
    from galoc_env.render import make_renderer
    from galoc_env.scene import build_scene
    scene = build_scene(house(), furniture=0.7, seed=3)
    digest = hashlib.sha256()
    for quality in ("fast", "default", "best"):
        renderer = make_renderer("raster", scene, Camera.from_hfov(83, 61, 100), quality=quality)
        for k in range(4):
            frame = renderer.render((2.0 + 0.3 * k, 2.0, 1.1 * k), 1.4, (0.05 * k, -0.1))
            for array in (frame.rgb, frame.depth, frame.instance, frame.semantic):
                digest.update(array.tobytes())
    print(digest.hexdigest())
"""


def fingerprint(tmp_path, name, **env):
    """Digest of frames drawn in a process of its own, scene, light and all."""
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    places = {"PYTHONPATH": path, "GALOC_CACHE": str(tmp_path / name)}
    result = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(SCRIPT)],
        env={**os.environ, **places, **env},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.strip()


def test_bytes_depend_on_neither_process_nor_threads(tmp_path):
    first = fingerprint(tmp_path, "a", PYTHONHASHSEED="1")
    assert fingerprint(tmp_path, "b", PYTHONHASHSEED="2", NUMBA_NUM_THREADS="1") == first


@pytest.mark.slow
def test_bytes_do_not_depend_on_the_processor(tmp_path):
    """Compiled for the plainest x86-64, and with numpy's vector code switched off."""
    plain = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    known = np._core._multiarray_umath.__cpu_dispatch__  # type: ignore[attr-defined]
    features = [name for name, have in np._core._multiarray_umath.__cpu_features__.items() if have and name in known]
    plain["NPY_DISABLE_CPU_FEATURES"] = " ".join(features)
    assert fingerprint(tmp_path, "a", **plain) == fingerprint(tmp_path, "b")


@pytest.mark.slow
def test_memory_stays_flat_over_10000_pictures(scene):
    renderer = make_renderer("raster", scene, Camera.from_hfov(80, 60, 100))
    poses = views(scene, 50)
    for view in poses:
        renderer.render(*view)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for k in range(10_000):
        renderer.render(*poses[k % 50])
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000  # kB; one picture is 14 kB
