"""The images of many bodies: one call of the rasteriser for all of them, or one renderer after the other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc import Camera
from galoc_env.bodies import Bodies
from galoc_env.settings import Settings, imaging
from galoc_env.world import Episode, World
from galoc_env.worlds import Worlds


class Pictures:
    """Draws what bodies see into the arrays of the observation.

    Args:
        settings: of the environment: renderer, quality, camera height and imaging.
        camera: intrinsics.
    """

    def __init__(self, settings: Settings, camera: Camera) -> None:
        self._settings, self._camera = settings, camera
        self._imaging = imaging(settings)
        self._arena: Any = None
        self._homes: dict[int, tuple[World, int]] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Without what is only there to draw faster: the tables of the homes are made again."""
        return {**vars(self), "_arena": None, "_homes": {}}

    def draw(self, episodes: Sequence[Episode], bodies: Bodies, images: NDArray[np.uint8]) -> None:
        """Draw the current view of some episodes.

        Args:
            episodes: whose views.
            bodies: where they are.
            images: (L, H, W, 3) out, by body; left as they are with `renderer="none"`.
        """
        if not self._settings.draws or not episodes:
            return
        lanes = np.array([episode.body for episode in episodes])
        if self._settings.renderer == "raster":
            self._draw_arena(episodes, lanes, bodies, images)
        else:
            for lane, episode in zip(lanes, episodes, strict=True):
                pose, tilt = bodies.pose[lane], bodies.tilt[lane]
                images[lane] = episode.world.image(pose, tilt, self._settings, self._camera)
        if self._imaging is not None:
            for lane, episode in zip(lanes, episodes, strict=True):
                images[lane] = episode.imaged(images[lane], self._imaging)

    def _draw_arena(
        self, episodes: Sequence[Episode], lanes: NDArray[np.int64], bodies: Bodies, images: NDArray[np.uint8]
    ) -> None:
        homes = np.array([self._home(episode.world) for episode in episodes], dtype=np.int64)
        whole = len(lanes) == len(images)
        rgb = images if whole else np.empty((len(lanes), *images.shape[1:]), np.uint8)
        heights = np.full(len(lanes), float(self._settings.camera_height))
        poses, tilts = (np.ascontiguousarray(values[lanes]) for values in (bodies.pose, bodies.tilt))
        self._arena.render(homes, poses, heights, tilts, rgb)
        if not whole:
            images[lanes] = rgb

    def _home(self, world: World) -> int:
        """Number of a world in the arena, where it is put on first sight."""
        known = self._homes.get(world.number)
        if known is not None and known[0] is world:
            return known[1]
        if self._arena is None:
            from galoc_env.render.arena import Arena

            self._arena = Arena(self._camera, quality=self._settings.quality)
        home = int(self._arena.add(world.scene))
        self._homes[world.number] = world, home
        return home

    def keep(self, worlds: Worlds) -> None:
        """Take worlds that are no longer kept out of the arena."""
        for number, (world, home) in list(self._homes.items()):
            if world not in worlds:
                self._arena.remove(home)
                del self._homes[number]

    def close(self) -> None:
        """Free the arena."""
        self._arena = None
        self._homes.clear()
