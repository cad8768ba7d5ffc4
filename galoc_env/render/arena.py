"""Arena: many homes drawn from many poses in one call."""

from __future__ import annotations

import os
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import numba
import numpy as np
from numpy.typing import NDArray

from galoc.errors import GalocError
from galoc_env.render.drawable import Drawable, Homes, SceneArrays, arena_arrays, drawable
from galoc_env.render.textures import finest_level
from galoc_env.render.workspace import LANES, Sizes, Workspace

if TYPE_CHECKING:
    from galoc.camera import Camera
    from galoc_env.scene import Scene

Arrays = tuple[NDArray, ...]

QUALITIES = ("fast", "default", "best")
"""Plain edges, texels blended along rows only; smooth edges and texels; drawn twice as fine, with glossy floors."""

_pools: dict[tuple[int, int], ThreadPoolExecutor] = {}
_pools_lock = threading.Lock()


class Arena:
    """Draws any of its homes with one camera; each frame's bytes are those of ``RasterRenderer``.

    Frames do not depend on the number of threads. A call draws with as many threads as numba is set to use
    (``NUMBA_NUM_THREADS``, ``numba.set_num_threads``). Calls from several threads wait for each other.

    Args:
        camera: intrinsics and size of all pictures.
        quality: one of :data:`QUALITIES`.

    Raises:
        GalocError: unknown quality.
    """

    def __init__(self, camera: Camera, quality: str = "default") -> None:
        if quality not in QUALITIES:
            raise GalocError(f"quality = {quality!r}", " or ".join(map(repr, QUALITIES)), "Pass one of these.")
        self.camera = camera
        stride = -(-camera.width // LANES) * LANES
        focal = max(camera.fx, camera.fy) * (2 if quality == "best" else 1)
        self._size = (camera.width, camera.height, stride, QUALITIES.index(quality), finest_level(focal))
        self._lens = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        self._homes: dict[int, Drawable] = {}
        self._number: dict[int, tuple[Scene, int]] = {}
        self._next = 0
        self._row: dict[int, int] = {}
        self._arrays: tuple[SceneArrays, Homes] | None = None
        self._work: list[Workspace] = []
        self._sizes: Sizes = (0, 0, 0)
        self._lock = threading.Lock()

    def add(self, scene: Scene) -> int:
        """Number of a home, which is prepared and lit when it is new.

        Raises:
            GalocError: nothing in it, or a face that is not finite.
        """
        known = self._number.get(id(scene))
        if known is not None:
            return known[1]
        from galoc_env.render.light import lit

        if not any(len(mesh.instance) for mesh in scene.meshes):
            raise GalocError("a scene without faces", "something to draw", "Build it with build_scene(plan).")
        facets, light = lit(scene)
        with self._lock:
            number, self._next = self._next, self._next + 1
            self._homes[number] = drawable(scene, facets, light, self._size[4])
            self._number[id(scene)] = (scene, number)
            self._arrays = None
        return number

    def remove(self, home: int) -> None:
        """Forget a home; its number is not used again.

        Raises:
            GalocError: no such home.
        """
        if home not in self._homes:
            raise GalocError(f"home {home}", f"one of {sorted(self._homes)}", "Pass a number that add() returned.")
        with self._lock:
            del self._homes[home]
            self._number = {key: value for key, value in self._number.items() if value[1] != home}
            self._arrays = None

    def render(
        self,
        homes: NDArray[np.int64],
        poses: NDArray[np.float64],
        heights: NDArray[np.float64],
        gravities: NDArray[np.float64],
        rgb: NDArray[np.uint8],
        depth: NDArray[np.float32] | None = None,
        instance: NDArray[np.int32] | None = None,
        semantic: NDArray[np.uint8] | None = None,
    ) -> None:
        """Draw L views into arrays of the caller's. Nothing of the views is checked beyond shapes.

        Args:
            homes: (L,) numbers from :meth:`add`.
            poses: (L, 3) x, y (m) and heading (rad), plan frame.
            heights: (L,) camera height, m.
            gravities: (L, 2) true roll and pitch, rad.
            rgb: (L, H, W, 3) uint8, C-contiguous; written.
            depth: (L, H, W) float32 m along the optical axis, inf where nothing is hit; written. None: left out.
            instance: (L, H, W) int32, 0 for nothing; written. None: left out.
            semantic: (L, H, W) uint8, class of the instance; written. None: left out.

        Raises:
            GalocError: wrong shape or kind of array, or an unknown home.
        """
        count = len(homes)
        shape = (count, self.camera.height, self.camera.width)
        outputs = (
            _flat("rgb", rgb, (*shape, 3), np.uint8),
            _flat("depth", depth, shape, np.float32),
            _flat("instance", instance, shape, np.int32),
            _flat("semantic", semantic, shape, np.uint8),
        )
        views = (
            np.ascontiguousarray(poses, np.float64),
            np.ascontiguousarray(heights, np.float64),
            np.ascontiguousarray(gravities, np.float64),
        )
        if views[0].shape != (count, 3) or views[1].shape != (count,) or views[2].shape != (count, 2):
            got = f"views of shapes {[view.shape for view in views]}"
            raise GalocError(
                got, f"({count}, 3), ({count},) and ({count}, 2)", "Pass one row for each home in `homes`."
            )
        with self._lock:
            scene, ranges = self._prepared()
            self._draw((self._rows(homes), *views), ranges, scene, outputs)

    def _rows(self, homes: NDArray[np.int64]) -> NDArray[np.int64]:
        try:
            return np.array([self._row[int(home)] for home in homes], np.int64)
        except KeyError as missing:
            expected = f"one of {sorted(self._homes)}"
            raise GalocError(f"home {missing}", expected, "Pass a number that add() returned.") from None

    def _prepared(self) -> tuple[SceneArrays, Homes]:
        """The arrays of all homes, put together again after a home came or went."""
        if self._arrays is None:
            if not self._homes:
                raise GalocError("an arena without homes", "at least one", "Call add(scene) first.")
            self._row = {number: row for row, number in enumerate(self._homes)}
            self._arrays = arena_arrays(list(self._homes.values()), self._size[4])
            sizes = np.array([home.sizes for home in self._homes.values()]).max(axis=0)
            self._sizes = (int(sizes[0]), int(sizes[1]), int(sizes[2]))
            if self._work and np.any(np.array(self._work[0].sizes) < sizes):
                self._work = []
        return self._arrays

    def _draw(self, lanes: Arrays, ranges: Homes, scene: SceneArrays, outputs: Arrays) -> None:
        from galoc_env.render._draw_kernel import draw

        count = len(lanes[0])
        workers = 1 if count == 1 else max(1, min(int(numba.get_num_threads()), count))
        spaces = self._spaces(workers)
        if workers == 1:
            draw(0, count, lanes, self._lens, self._size, ranges, scene, spaces[0].buffers, outputs)
            return
        edges = [count * k // workers for k in range(workers + 1)]

        def task(k: int) -> None:
            part = edges[k], edges[k + 1]
            draw(*part, lanes, self._lens, self._size, ranges, scene, spaces[k].buffers, outputs)

        list(_pool(workers).map(task, range(workers)))

    def _spaces(self, workers: int) -> list[Workspace]:
        while len(self._work) < workers:
            width, height, _, quality, _ = self._size
            self._work.append(Workspace.of(width, height, 2 if quality == 2 else 1, self._sizes))
        return self._work


def _flat(name: str, array: NDArray | None, shape: tuple[int, ...], kind: type) -> NDArray:
    """An output as (L, pixels), without a copy; empty for one that is not wanted."""
    if array is None:
        return np.empty((shape[0], 0), kind)
    if array.shape != shape or array.dtype != kind or not array.flags.c_contiguous or not array.flags.writeable:
        got = f"{name} of shape {array.shape}, {array.dtype}"
        raise GalocError(got, f"{shape}, {np.dtype(kind)}, C-contiguous, writeable", "Pass such an array.")
    return array.reshape(shape[0], -1)


def _pool(workers: int) -> ThreadPoolExecutor:
    """Threads of this process: a forked child starts its own."""
    with _pools_lock:
        key = (os.getpid(), workers)
        if key not in _pools:
            _pools[key] = ThreadPoolExecutor(workers, thread_name_prefix="galoc-raster")
        return _pools[key]
