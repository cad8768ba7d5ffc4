"""The gl renderer: exact pixels, exact instances, one shared context that neither leaks nor drifts."""

import dataclasses
import gc
import math
import os
import subprocess
import sys
import textwrap
import threading
from pathlib import Path

import numpy as np
import pytest
from test_scene import house

from galoc import Camera, Floorplan, GalocError
from galoc_env.render import Frame, make_renderer, world_from_camera
from galoc_env.scene import build_scene
from galoc_env.scene.mesh import CEILING, FITTING, FLOOR, OUTSIDE, WALL

CAMERA = Camera.from_hfov(160, 120, 108)
OFF_CENTRE = Camera(150, 111, 90.0, 84.0, 60.3, 61.7)
POSES = [
    ((1.2, 1.1, 0.6), 1.4, (0.0, 0.0)),
    ((3.9, 2.9, -2.7), 1.1, (0.07, -0.12)),
    ((7.0, 1.2, 2.0), 1.6, (-0.15, 0.2)),
    ((2.5, 2.0, 3.1), 1.9, (0.4, -0.5)),
]


@pytest.fixture(scope="module")
def scene():
    return build_scene(house(), furniture=0.0, seed=1)


@pytest.fixture(scope="module", autouse=True)
def needs_gl(scene):
    try:
        make_renderer("gl", scene, CAMERA).close()
    except GalocError as error:
        pytest.skip(f"no OpenGL here: {error}")


def draw(scene, camera=CAMERA, pose=POSES[0], **kwargs) -> Frame:
    renderer = make_renderer("gl", scene, camera)
    try:
        return renderer.render(*pose, **kwargs)
    finally:
        renderer.close()


def world_points(camera, frame, pose):
    """(H, W, 3) where each pixel's ray ends."""
    v, u = np.mgrid[: camera.height, : camera.width]
    transform = world_from_camera(*pose)
    rays = camera.rays_camera(np.stack([u, v], axis=-1)) @ transform[:3, :3].T
    return transform[:3, 3] + rays * frame.depth[..., None]


def run_script(body, **env):
    """Run a script in a fresh process, with the tests' plans importable; its standard output."""
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    result = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(body)],
        env={**os.environ, "PYTHONPATH": path, **env},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.strip()


@pytest.mark.parametrize("camera", [CAMERA, OFF_CENTRE])
@pytest.mark.parametrize("pose", POSES)
def test_depth_puts_every_pixel_on_the_plane_of_its_instance(scene, camera, pose):
    frame = draw(scene, camera, pose)
    points = world_points(camera, frame, pose)
    semantic = scene.instance_semantic[frame.instance]
    assert np.all(frame.instance > 0) and np.all(np.isfinite(frame.depth))  # closed rooms show no void
    floor = points[(semantic == FLOOR)]
    # 24-bit depth resolves 3 mm at 50 m; the floor of a doorway lies 4 mm higher.
    assert np.abs(floor[:, 2]).max(initial=0.0) < 0.006
    assert np.abs(points[semantic == CEILING][:, 2] - 2.6).max(initial=0.0) < 0.002
    seen = np.unique(frame.instance[semantic == WALL])
    assert len(seen) >= 2
    for number in seen:
        x1, y1, x2, y2 = scene.plan.segments[number - 1]
        normal = np.array([y1 - y2, x2 - x1]) / math.hypot(x2 - x1, y2 - y1)
        mine = points[frame.instance == number]
        assert np.abs((mine[:, :2] - (x1, y1)) @ normal).max() < 0.002
        along = (mine[:, :2] - (x1, y1)) @ np.array([x2 - x1, y2 - y1]) / math.hypot(x2 - x1, y2 - y1)
        assert along.min() > -0.01 and along.max() < math.hypot(x2 - x1, y2 - y1) + 0.01


@pytest.mark.parametrize("camera", [CAMERA, OFF_CENTRE])
@pytest.mark.parametrize("pose", [((1.2, 1.1, 0.6), 1.4, (0.1, 0.05)), POSES[1], ((3.0, 1.2, 2.4), 1.3, (0.2, 0.1))])
def test_a_corner_is_drawn_where_the_camera_model_puts_it(scene, camera, pose):
    """The vertical edge between two walls separates their pixels to within 0.02 px: no half-pixel shift anywhere."""
    frame = draw(scene, camera, pose)
    rotation, origin = world_from_camera(*pose)[:3, :3], world_from_camera(*pose)[:3, 3]
    checked, tight = 0, np.inf
    for corner in ((5.0, 4.0), (0.0, 4.0), (0.0, 0.0), (5.0, 0.0)):
        edge = np.array([[*corner, z] for z in np.linspace(0.1, 2.5, 97)])
        local = (edge - origin) @ rotation
        local = local[local[:, 2] > 0.2]
        u = camera.fx * local[:, 0] / local[:, 2] + camera.cx
        v = camera.fy * local[:, 1] / local[:, 2] + camera.cy
        if len(u) < 2:
            continue
        top_down = np.argsort(v)
        for row in range(math.ceil(max(v.min(), 0)), math.floor(min(v.max(), camera.height - 1)) + 1):
            column = np.interp(row, v[top_down], u[top_down])  # the edge's image is a straight line
            left, right = math.floor(column), math.floor(column) + 1
            if left < 1 or right > camera.width - 2 or min(column - left, right - column) < 0.02:
                continue
            a, b = frame.instance[row, left], frame.instance[row, right]
            assert a != b and a == frame.instance[row, left - 1] and b == frame.instance[row, right + 1]
            checked, tight = checked + 1, min(tight, column - left, right - column)
    assert checked >= 25 and tight < 0.1  # enough rows, and some that a shift of 0.1 px would break


def test_orientation(scene):
    """Facing +y from the west room: the window is ahead, +x is to the right, the ceiling is up."""
    frame = draw(scene, pose=((2.35, 1.0, math.pi / 2), 1.4, (0.0, 0.0)))
    semantic = scene.instance_semantic[frame.instance]
    assert semantic[57, 70] == OUTSIDE
    assert frame.depth[57, 70] == pytest.approx(3.15, abs=0.002)  # the pane is in the middle of a wall 30 cm thick
    assert np.isin(semantic[0], (CEILING, FITTING)).all() and np.all(semantic[-1] == FLOOR)  # a lamp may hang there
    assert np.mean(semantic[0] == CEILING) > 0.5
    right = frame.instance[60, -1]
    assert right == 1 + 9  # segment 9 is the wall at x = 5
    tilted = draw(scene, pose=((2.35, 1.0, math.pi / 2), 1.4, (0.0, 0.2)))  # looking up shows more ceiling
    assert (scene.instance_semantic[tilted.instance] == CEILING).sum() > (semantic == CEILING).sum()


def test_windows_are_bright_and_rooms_are_not_flat(scene):
    frame = draw(scene, pose=((2.35, 1.0, math.pi / 2), 1.4, (0.0, 0.0)))
    semantic = scene.instance_semantic[frame.instance]
    light = frame.rgb.mean(axis=2)
    assert light[semantic == OUTSIDE].mean() > 1.1 * light[semantic == WALL].mean()
    assert light[semantic == CEILING].mean() > light[semantic == FLOOR].mean()
    assert light.std() > 20


def test_instances_survive_the_trip_through_colours(scene):
    """Numbers that use all three bytes come back exactly."""
    numbers = [1, 127, 128, 255, 256, 32768, 65535, 65536, 8_388_608, 16_777_215]
    meshes = tuple(
        dataclasses.replace(m, instance=np.array(numbers, np.int32)[np.arange(len(m.instance)) // 2 % 10])
        for m in scene.meshes
    )
    seen = set()
    renderer = make_renderer("gl", dataclasses.replace(scene, meshes=meshes), CAMERA)
    for pose in POSES:
        seen |= set(np.unique(renderer.render(*pose).instance).tolist())
    renderer.close()
    assert seen <= set(numbers) and len(seen) == len(numbers)


def test_void_is_infinitely_far():
    open_plan = Floorplan.from_segments([[2, -1, 2, 1], [-2, -1, -2, 1]])
    frame = draw(build_scene(open_plan, furniture=0.0), pose=((0.0, 0.0, 0.0), 1.3, (0.0, 0.0)))
    void = frame.instance == 0
    assert void.any() and np.all(np.isinf(frame.depth) == void)


def test_frame_types_and_rgb_only(scene):
    renderer = make_renderer("gl", scene, CAMERA)
    full, quick = renderer.render(*POSES[1]), renderer.render(*POSES[1], rgb_only=True)
    assert full.rgb.shape == (120, 160, 3) and full.rgb.dtype == np.uint8 and full.rgb.flags.c_contiguous
    assert full.depth.shape == full.instance.shape == (120, 160)
    assert full.depth.dtype == np.float32 and full.instance.dtype == np.int32
    assert quick.depth is None and quick.instance is None
    np.testing.assert_array_equal(full.rgb, quick.rgb)
    renderer.close()


def test_renderers_share_the_context_without_touching_each_other(scene):
    other = build_scene(house(), furniture=0.8, seed=2)
    small = Camera.from_hfov(64, 48, 70)
    alone = [draw(scene).rgb, draw(other, small).rgb]
    first, second = make_renderer("gl", scene, CAMERA), make_renderer("gl", other, small)
    for _ in range(2):
        np.testing.assert_array_equal(first.render(*POSES[0]).rgb, alone[0])
        np.testing.assert_array_equal(second.render(*POSES[0]).rgb, alone[1])
    first.close()
    np.testing.assert_array_equal(second.render(*POSES[0]).rgb, alone[1])
    second.close()
    second.close()
    with pytest.raises(GalocError, match="close"):
        second.render(*POSES[0])


def resident_mib() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs /proc")
def test_thirty_scenes_in_a_row_do_not_pile_up():
    """Each holds about 3 MiB of textures in GL alone: kept, 24 of them would be 70 MiB, or 35 if every other was."""
    for k in range(30):
        renderer = make_renderer("gl", build_scene(house(), furniture=0.3, seed=k % 3), CAMERA)
        renderer.render(*POSES[0])
        if k % 2:  # the others are freed by garbage collection
            renderer.close()
        del renderer
        gc.collect()
        if k == 5:
            start = resident_mib()
    assert resident_mib() - start < 20


def test_two_processes_draw_the_same_bytes():
    body = """
        import hashlib
        from test_scene import house
        from galoc import Camera
        from galoc_env.render import make_renderer
        from galoc_env.scene import build_scene
        renderer = make_renderer("gl", build_scene(house(), furniture=0.8, seed=4), Camera.from_hfov(160, 120, 108))
        digest = hashlib.sha256()
        for x in (1.0, 2.0, 7.0):
            frame = renderer.render((x, 1.2, x), 1.4, (0.05, 0.1))
            for part in (frame.rgb, frame.depth, frame.instance):
                digest.update(part.tobytes())
        print(digest.hexdigest())
    """
    first, second = run_script(body, PYTHONHASHSEED="1"), run_script(body, PYTHONHASHSEED="2")
    assert len(first) == 64 and first == second


def test_a_forked_child_is_told_so():
    body = """
        import os, warnings
        warnings.simplefilter("ignore")
        from test_scene import house
        from galoc import Camera, GalocError
        from galoc_env.render import make_renderer
        from galoc_env.scene import build_scene
        scene = build_scene(house(), furniture=0.0)
        renderer = make_renderer("gl", scene, Camera.from_hfov(64, 48, 90))
        renderer.render((1, 1, 0), 1.4, (0, 0))
        if os.fork() == 0:
            for call in (lambda: renderer.render((1, 1, 0), 1.4, (0, 0)),
                         lambda: make_renderer("gl", scene, Camera.from_hfov(64, 48, 90))):
                try:
                    call()
                except GalocError as error:
                    print("told" if "spawn" in str(error) else error, flush=True)
            renderer.close()
            os._exit(0)
        os.wait()
        renderer.render((1, 1, 0), 1.4, (0, 0))
        print("parent lives")
    """
    assert run_script(body).split("\n") == ["told", "told", "parent lives"]


def test_a_second_thread_is_told_so(scene):
    errors = []

    def call():
        try:
            draw(scene)
        except GalocError as error:
            errors.append(str(error))

    thread = threading.Thread(target=call)
    thread.start()
    thread.join()
    assert len(errors) == 1 and "thread" in errors[0]


def test_no_opengl_names_the_cure():
    body = """
        from test_scene import house
        from galoc import Camera, GalocError
        from galoc_env.render import make_renderer
        from galoc_env.scene import build_scene
        try:
            make_renderer("gl", build_scene(house(), furniture=0.0), Camera.from_hfov(64, 48, 90))
        except GalocError as error:
            print(error)
    """
    said = run_script(body, PYOPENGL_PLATFORM="egl", EGL_DEVICE_ID="97")
    assert "libegl1 libgl1 libgles2 libegl-mesa0 libgl1-mesa-dri" in said


def test_bad_arguments(scene):
    with pytest.raises(GalocError, match="gl"):
        make_renderer("vulkan", scene, CAMERA)
    renderer = make_renderer("gl", scene, CAMERA)
    for pose, height, gravity in (
        ((1.0, 2.0), 1.4, (0, 0)),
        ((1.0, 2.0, math.nan), 1.4, (0, 0)),
        ((1.0, 2.0, 0.0), math.inf, (0, 0)),
        ((1.0, 2.0, 0.0), 1.4, (0, 2.0)),
    ):
        with pytest.raises(GalocError):
            renderer.render(pose, height, gravity)
    renderer.close()


def test_importing_the_world_loads_no_opengl():
    body = """
        import sys, galoc_env.render, galoc_env.scene
        print([name for name in ("pyrender", "OpenGL", "trimesh", "matplotlib") if name in sys.modules])
    """
    assert run_script(body) == "[]"
