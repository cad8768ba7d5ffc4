"""Renderer in numba: no system library, the same bytes on every machine, safe to fork, spawn and thread."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.camera import MAX_TILT
from galoc.errors import GalocError
from galoc_env.render import Frame, world_from_camera
from galoc_env.render.arena import Arena

if TYPE_CHECKING:
    from galoc.camera import Camera
    from galoc_env.scene import Scene

Array = NDArray[np.float64]


class RasterRenderer:
    """Draws one scene with one camera.

    Args:
        scene: what to draw; it is lit when it is first seen, and the light is kept.
        camera: intrinsics and size.
        quality: "fast" (plain edges, textures blended along one axis), "default" (smooth edges) or "best" (twice as
            fine and averaged, glossy floors).

    Raises:
        GalocError: unknown quality.
    """

    def __init__(self, scene: Scene, camera: Camera, quality: str = "default") -> None:
        self._arena: Arena | None = Arena(camera, quality)
        self._home = np.array([self._arena.add(scene)])
        self._shape = (1, camera.height, camera.width)

    def render(self, pose: ArrayLike, height_m: float, gravity: ArrayLike, *, rgb_only: bool = False) -> Frame:
        """Draw the scene from a pose; see :class:`galoc_env.render.Renderer`."""
        if self._arena is None:
            raise GalocError("a call of render() after close()", "an open renderer", "Make a new renderer.")
        views = _checked(pose, height_m, gravity)
        rgb = np.empty((*self._shape, 3), np.uint8)
        if rgb_only:
            self._arena.render(self._home, *views, rgb)
            return Frame(rgb[0], None, None)
        depth, instance = np.empty(self._shape, np.float32), np.empty(self._shape, np.int32)
        semantic = np.empty(self._shape, np.uint8)
        self._arena.render(self._home, *views, rgb, depth, instance, semantic)
        return Frame(rgb[0], depth[0], instance[0], semantic[0])

    def close(self) -> None:
        """Free what the renderer holds; a second call does nothing."""
        self._arena = None


def _checked(pose: ArrayLike, height_m: float, gravity: ArrayLike) -> tuple[Array, Array, Array]:
    """A view as an arena takes it.

    Raises:
        GalocError: not finite, or tilted beyond 85 degrees.
    """
    try:
        views = (
            np.array(pose, np.float64, ndmin=2),
            np.array([height_m], np.float64),
            np.array(gravity, np.float64, ndmin=2),
        )
    except (TypeError, ValueError):
        views = None
    if views is not None and views[0].shape == (1, 3) and views[2].shape == (1, 2):
        x, y, heading = views[0][0].tolist()
        roll, pitch = views[2][0].tolist()
        if math.isfinite(x + y + heading + views[1][0]) and abs(roll) <= MAX_TILT and abs(pitch) <= MAX_TILT:
            return views
    world_from_camera(pose, height_m, gravity)  # says what is wrong
    raise GalocError(f"a view of pose {pose!r}", "x, y and heading of one camera", "Pass three numbers.")
