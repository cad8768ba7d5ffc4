"""Pictures of a scene: the ``Renderer`` protocol and its backends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.camera import levelling
from galoc.errors import GalocError

if TYPE_CHECKING:
    from galoc.camera import Camera
    from galoc_env.scene import Scene

RENDERERS = ("raster", "gl")
"""Names that :func:`make_renderer` knows."""

NEAR, FAR = 0.05, 250.0
"""What is nearer or farther than this "gl" does not draw, m; "raster" draws from 5 mm on, and everything."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """What the camera sees from one pose; pixel (row, col) is at u = col, v = row."""

    rgb: NDArray[np.uint8]
    """(H, W, 3) sRGB."""
    depth: NDArray[np.float32] | None
    """(H, W) m along the optical axis at the pixel's centre; inf where nothing is hit. None: not asked for."""
    instance: NDArray[np.int32] | None
    """(H, W) instance seen at the pixel's centre (see ``Scene.instance_semantic``); 0: nothing. None: not asked for."""
    semantic: NDArray[np.uint8] | None = None
    """(H, W) its class (see ``galoc_env.scene.SEMANTIC_NAMES``). None: not asked for."""


class Renderer(Protocol):
    """Draws one scene with one camera."""

    def render(self, pose: ArrayLike, height_m: float, gravity: ArrayLike, *, rgb_only: bool = False) -> Frame:
        """Draw the scene from a pose.

        Args:
            pose: x, y (m) and heading (rad) in the plan frame.
            height_m: camera height above the floor, m.
            gravity: true roll and pitch, rad (what an IMU without noise reads).
            rgb_only: leave depth, instance and semantic out, which is faster.

        Raises:
            GalocError: not finite, or out of range.
        """
        ...

    def close(self) -> None:
        """Free what the renderer holds; a second call does nothing."""
        ...


def make_renderer(name: str, scene: Scene, camera: Camera, *, quality: str = "default") -> Renderer:
    """The named backend for a scene and a camera.

    Args:
        name: "raster" (numba: no system library, same bytes everywhere) or "gl" (pyrender).
        scene: what to draw.
        camera: intrinsics and size.
        quality: "fast", "default" or "best"; "gl" has one quality only.

    Raises:
        GalocError: unknown name or quality, or the backend cannot work on this machine.
    """
    if name == "raster":
        from galoc_env.render.raster import RasterRenderer

        return RasterRenderer(scene, camera, quality)
    if name == "gl":
        from galoc_env.render.gl import GlRenderer

        return GlRenderer(scene, camera)
    raise GalocError(f"renderer {name!r}", f"one of {', '.join(RENDERERS)}", "Pass one of these names.")


def world_from_camera(pose: ArrayLike, height_m: float, gravity: ArrayLike) -> NDArray[np.float64]:
    """(4, 4) rigid transform from the camera frame (x right, y down, z forward) to the world (z up), m.

    Raises:
        GalocError: not finite, or tilted beyond 85 degrees.
    """
    try:
        values = np.asarray(pose, dtype=np.float64)
    except (TypeError, ValueError):
        values = np.full(3, np.nan)
    if values.shape != (3,) or not np.all(np.isfinite(values)):
        raise GalocError(f"pose = {pose!r}", "x, y in metres and heading in radians, finite", "Pass (x, y, heading).")
    if not isinstance(height_m, int | float | np.number) or not math.isfinite(height_m):
        raise GalocError(f"height_m = {height_m!r}", "the camera's height in metres", "Pass 1.4, say.")
    c, s = math.cos(values[2]), math.sin(values[2])
    world_from_level = np.array([[s, 0.0, c], [-c, 0.0, s], [0.0, -1.0, 0.0]])
    out = np.eye(4)
    out[:3, :3] = world_from_level @ levelling(gravity)
    out[:3, 3] = values[0], values[1], height_m
    return out
