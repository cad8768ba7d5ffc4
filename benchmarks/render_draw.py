"""What the render benchmark lets draw, one contestant per process: ours, pyrender by its manual, MiniWorld.

The job says which contestant it is; a case is (width, height, outputs) with outputs "all" (RGB, depth and instance
numbers) or "rgb". A lap draws the next few views.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

from render_serve import Case, serve

HFOV_DEG = 108.0
HEIGHT_M = 1.4
LAP_VIEWS = 16
"""Views of a lap."""
_kept: dict[str, Any] = {}


def build(job: dict[str, Any], case: Any) -> Case:
    """The case of a contestant."""
    makers = {"raster": _ours, "gl": _ours, "pyrender": _manual, "miniworld": _miniworld}
    return makers[job["kind"]](job, *case)


def _case(draw: Callable[[Any], Any], views: list[Any], sample: Callable[[], Any]) -> Case:
    """Draw all views in turn, over and over."""
    coming = itertools.cycle(views)
    count = min(LAP_VIEWS, len(views))

    def lap() -> None:
        for _ in range(count):
            draw(next(coming))

    return count, lap, sample


def _home(job: dict[str, Any]) -> Any:
    """The scene, built once per process."""
    if "scene" not in _kept:
        from galoc_env.homes import generate
        from galoc_env.scene import build_scene

        plan = generate(job["home"], split="test")
        _kept["scene"] = build_scene(plan, furniture=job["furniture"], seed=job["home"])
    return _kept["scene"]


def _ours(job: dict[str, Any], width: int, height: int, outputs: str) -> Case:
    from galoc import Camera
    from galoc_env.render import make_renderer

    camera = Camera.from_hfov(width, height, HFOV_DEG)
    options = {"quality": job["quality"]} if job["kind"] == "raster" else {}
    renderer = make_renderer(job["kind"], _home(job), camera, **options)
    views = [(tuple(v[:3]), tuple(v[3:])) for v in job["views"]]

    def draw(view: Any) -> Any:
        return renderer.render(view[0], HEIGHT_M, view[1], rgb_only=outputs == "rgb").rgb

    return _case(draw, views, lambda: draw(views[job["shown"]]))


def _manual(job: dict[str, Any], width: int, height: int, outputs: str) -> Case:
    """Pyrender as its manual has it: a node for each thing, a colour and depth pass, a pass of node colours.

    Drawn flat, without lights, which is its fastest way; textures are shared between the things.
    """
    import numpy as np

    from galoc import Camera
    from galoc_env.render import FAR, NEAR, world_from_camera
    from galoc_env.render.gl_context import _import_pyrender

    pyrender = _import_pyrender()
    lens = Camera.from_hfov(width, height, HFOV_DEG)
    if "things" not in _kept:  # one scene for all sizes: pyrender forgets the meshes of every other scene
        _kept["things"] = _things(pyrender, _home(job))
        _kept["offscreen"] = pyrender.OffscreenRenderer(viewport_width=width, viewport_height=height)
    (scene, numbers), offscreen = _kept["things"], _kept["offscreen"]
    camera = pyrender.IntrinsicsCamera(lens.fx, lens.fy, lens.cx + 0.5, lens.cy + 0.5, znear=NEAR, zfar=FAR)
    eye = scene.add(camera)
    colours = {node: (n & 255, n >> 8 & 255, n >> 16) for node, n in numbers.items()}
    flags = pyrender.RenderFlags
    flip = np.diag([1.0, -1.0, -1.0, 1.0])

    def draw(view: list[float]) -> Any:
        offscreen.viewport_width, offscreen.viewport_height = width, height
        scene.main_camera_node = eye
        scene.set_pose(eye, world_from_camera(view[:3], HEIGHT_M, view[3:]) @ flip)
        rgb, _depth = offscreen.render(scene, flags=flags.FLAT)
        if outputs == "all":
            offscreen.render(scene, flags=flags.SEG, seg_node_map=colours)
        return rgb

    return _case(draw, job["views"], lambda: draw(job["views"][job["shown"]]))


def _things(pyrender: Any, home: Any) -> tuple[Any, dict[Any, int]]:
    """The scene with a node for each instance, and the nodes' instance numbers."""
    import numpy as np
    from pyrender.constants import GLTF

    parts: dict[int, list[Any]] = {}
    for mesh in home.meshes:
        visual = mesh.mesh.visual
        texture = pyrender.Texture(source=np.asarray(visual.material.baseColorTexture), source_channels="RGB")
        faces, uv = np.asarray(mesh.mesh.faces), np.asarray(visual.uv)
        for number in np.unique(mesh.instance):
            corners = faces[mesh.instance == number].ravel()
            material = pyrender.MetallicRoughnessMaterial(baseColorTexture=texture, alphaMode="OPAQUE")
            parts.setdefault(int(number), []).append(
                pyrender.Primitive(
                    positions=np.asarray(mesh.mesh.vertices)[corners],
                    texcoord_0=uv[corners],
                    color_0=np.column_stack([mesh.shade[corners] / 255.0, np.ones(len(corners))]).astype(np.float32),
                    indices=np.arange(len(corners)).reshape(-1, 3),
                    material=material,
                    mode=GLTF.TRIANGLES,
                )
            )
    scene = pyrender.Scene()
    return scene, {scene.add(pyrender.Mesh(primitives)): number for number, primitives in sorted(parts.items())}


def _miniworld(job: dict[str, Any], width: int, height: int, outputs: str) -> Case:
    """The RGB picture of Farama's MiniWorld, from places all over its rooms."""
    import pyglet

    pyglet.options["headless"] = True
    import numpy as np
    from miniworld import envs

    env = getattr(envs, job["world"])(obs_width=width, obs_height=height)
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    large = [room for room in env.rooms if room.area > 4.0]  # not the passages
    rooms = [large[i] for i in rng.integers(len(large), size=len(job["views"]))]
    places = [
        (np.array([rng.uniform(r.min_x + 0.5, r.max_x - 0.5), 0.0, rng.uniform(r.min_z + 0.5, r.max_z - 0.5)]), turn)
        for r, turn in zip(rooms, rng.uniform(-np.pi, np.pi, len(rooms)), strict=True)
    ]

    def draw(place: Any) -> Any:
        env.agent.pos, env.agent.dir = place
        return env.render_obs()

    # Most places look at a wall: the picture with the most in it.
    return _case(draw, places, lambda: max((draw(place).copy() for place in places), key=lambda rgb: float(rgb.std())))


if __name__ == "__main__":
    serve(build)
