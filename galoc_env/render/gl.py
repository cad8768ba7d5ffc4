"""Renderer on OpenGL, through pyrender."""

from __future__ import annotations

import weakref
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.errors import GalocError
from galoc_env.render import FAR, NEAR, Frame, world_from_camera
from galoc_env.render.gl_context import get_context

if TYPE_CHECKING:
    from galoc.camera import Camera
    from galoc_env.scene import Scene

MAX_INSTANCES = 1 << 24
"""Instances are drawn as 24-bit colours."""


class GlRenderer:
    """Renderer on OpenGL through pyrender; all objects of a process share one context."""

    def __init__(self, scene: Scene, camera: Camera) -> None:
        """Prepare a scene for drawing.

        Raises:
            GalocError: no OpenGL on this machine, or a forked process or second thread.
        """
        if len(scene.instance_semantic) > MAX_INSTANCES:
            raise GalocError(f"{len(scene.instance_semantic)} instances", f"at most {MAX_INSTANCES}", "Split the plan.")
        self._context = get_context()
        self._camera = camera
        self._semantic = scene.instance_semantic.astype(np.uint8)
        pyrender = self._context.pyrender
        flags = pyrender.constants.RenderFlags
        self._flat, self._seg = flags.FLAT, flags.SEG
        meshes = [_textured_mesh(pyrender, mesh) for mesh in scene.meshes]
        ids = _instance_mesh(pyrender, scene)
        self._colour_scene = _pyrender_scene(pyrender, meshes, camera)
        self._id_scene = _pyrender_scene(pyrender, [ids], camera)
        # Without close(), garbage collection hands the GL objects over for deletion at the next drawing.
        self._finalizer = weakref.finalize(self, self._context.released.extend, [*meshes, ids])
        self._finalizer.atexit = False

    def render(self, pose: ArrayLike, height_m: float, gravity: ArrayLike, *, rgb_only: bool = False) -> Frame:
        """Draw the scene from a pose; see :class:`galoc_env.render.Renderer`."""
        if not self._finalizer.alive:
            raise GalocError("a call of render() after close()", "an open renderer", "Make a new renderer.")
        get_context()
        world_from_gl = world_from_camera(pose, height_m, gravity) @ np.diag([1.0, -1.0, -1.0, 1.0])
        rgb = self._draw(self._colour_scene, world_from_gl, self._flat)
        rgb = np.ascontiguousarray(rgb)
        if rgb_only:
            return Frame(rgb, None, None)
        code, z_buffer = self._draw(self._id_scene, world_from_gl, self._seg)
        instance = (code & 0xFFFFFF).astype(np.int32)
        return Frame(rgb, _metric_depth(z_buffer), instance, self._semantic.take(instance, mode="clip"))

    def _draw(self, scene: Any, world_from_gl: NDArray[np.float64], flags: int) -> Any:
        scene.set_pose(scene.main_camera_node, world_from_gl)
        return self._context.draw(scene, self._camera.width, self._camera.height, flags)

    def close(self) -> None:
        """Free the scene's GL objects; a second call does nothing."""
        self._finalizer()
        if self._context.usable:
            self._context.sweep()


def _pyrender_scene(pyrender: ModuleType, meshes: list, camera: Camera) -> Any:
    scene = pyrender.Scene()
    for mesh in meshes:
        scene.add(mesh)
    # Pixel centres are at half-integers there, at integers here.
    lens = pyrender.IntrinsicsCamera(camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5, znear=NEAR, zfar=FAR)
    scene.main_camera_node = scene.add(lens)
    return scene


def _textured_mesh(pyrender: ModuleType, mesh: Any) -> Any:
    from pyrender.constants import GLTF

    visual = mesh.mesh.visual
    texture = pyrender.Texture(
        source=np.asarray(visual.material.baseColorTexture),
        source_channels="RGB",
        sampler=pyrender.Sampler(wrapS=GLTF.REPEAT, wrapT=GLTF.REPEAT),
    )
    material = pyrender.MetallicRoughnessMaterial(baseColorTexture=texture, alphaMode="OPAQUE", doubleSided=False)
    primitive = pyrender.Primitive(
        positions=np.asarray(mesh.mesh.vertices),
        texcoord_0=np.asarray(visual.uv),
        color_0=_rgba(mesh.shade),
        indices=np.asarray(mesh.mesh.faces),
        material=material,
        mode=GLTF.TRIANGLES,
    )
    return pyrender.Mesh([primitive], name=mesh.name)


def _instance_mesh(pyrender: ModuleType, scene: Scene) -> Any:
    """All faces of the scene in one mesh, coloured by instance number."""
    from pyrender.constants import GLTF

    # Vertices of their own for each face: no vertex has to serve two instances.
    corners = np.concatenate(
        [np.asarray(m.mesh.vertices)[np.asarray(m.mesh.faces)].reshape(-1, 3) for m in scene.meshes]
    )
    number = np.repeat(np.concatenate([m.instance for m in scene.meshes]), 3)
    code = np.stack([number & 255, (number >> 8) & 255, number >> 16], axis=1)
    material = pyrender.MetallicRoughnessMaterial(alphaMode="OPAQUE", doubleSided=False)
    primitive = pyrender.Primitive(
        positions=corners,
        color_0=_rgba(code),
        indices=np.arange(len(corners)).reshape(-1, 3),
        material=material,
        mode=GLTF.TRIANGLES,
    )
    return pyrender.Mesh([primitive], name="instances")


def _rgba(rgb: NDArray) -> NDArray[np.float32]:
    return np.column_stack([rgb.astype(np.float32) / 255.0, np.ones(len(rgb), np.float32)])


def _metric_depth(z_buffer: NDArray[np.float32]) -> NDArray[np.float32]:
    """Distance along the optical axis from window depth 0..1; 1 - z is exact where it matters, z * FAR is not."""
    depth = np.float32(NEAR * FAR) / (np.float32(NEAR) + (np.float32(1.0) - z_buffer) * np.float32(FAR - NEAR))
    depth[z_buffer >= 1.0] = np.inf
    return depth
