"""Many round bodies in their homes, as arrays: one step of all of them is one call of a kernel."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc_env import _motion_kernel as kernel
from galoc_env.motion import BODY_RADIUS
from galoc_env.sensors import NoiseBlocks, Tilt
from galoc_env.settings import ODOMETRY_BOUND, TILT_BOUND, Settings

Array = NDArray[np.float64]


class Bodies:
    """Where bodies are and what they feel. The single environment has one, the batched one as many as lanes.

    A body's numbers depend on its own streams, home and actions alone, so one among many does to the last bit what
    it does alone.

    Args:
        count: number of bodies, L.
        settings: of the environment: tilt and the sensors' noise.
    """

    def __init__(self, count: int, settings: Settings) -> None:
        self._state = np.zeros((count, kernel.COLUMNS))
        self._name_columns()
        self.noise = NoiseBlocks(count)
        self.reading = np.zeros((count, 5), np.float32)
        """(L, 5): measured gravity and odometry within the bounds of the observation space."""
        self._doing = np.full(count, kernel.MOVE)
        self._obstacles, self._spans = np.zeros((0, 4)), np.zeros((count, 2), np.int64)
        amplitude, imu = math.radians(settings.tilt_deg), math.radians(settings.imu_noise_deg)
        self._sensors = np.array([amplitude, imu, settings.odometry_noise, BODY_RADIUS], dtype=np.float64)
        self._bounds = np.concatenate([TILT_BOUND, ODOMETRY_BOUND])

    def _name_columns(self) -> None:
        """Views of the state; writing to them changes it."""
        s = self._state
        self.pose, self.moved, self.tilt, self.gravity, self.odometry, self.wanted = (
            s[:, a:b] for a, b in ((0, 3), (3, 6), (6, 8), (8, 10), (10, 13), (13, 16))
        )
        self._sway, self._collided, self._steps = s[:, 16:24], s[:, 24], s[:, 25]

    def __getstate__(self) -> dict[str, Any]:
        """Without the views: copied by themselves they would no longer be views."""
        state = self._state
        views = {k for k, v in vars(self).items() if isinstance(v, np.ndarray) and v.base is state}
        return {k: v for k, v in vars(self).items() if k not in views}

    def __setstate__(self, values: dict[str, Any]) -> None:
        """Restore, and view the restored state."""
        vars(self).update(values)
        self._name_columns()

    @property
    def collided(self) -> NDArray[np.bool_]:
        """(L,): the last motion ended at a wall or at furniture."""
        return self._collided != 0.0

    def has_collided(self, body: int) -> bool:
        """Whether that body's last motion did."""
        return bool(self._collided[body])

    @property
    def steps(self) -> NDArray[np.int64]:
        """(L,) steps since the reset."""
        return self._steps.astype(np.int64)

    def surround(self, obstacles: Sequence[Array | None]) -> None:
        """Put up the obstacles (S, 4) m of every body's home; those that share a home may share the array."""
        homes = {id(array): array for array in obstacles if array is not None}
        last = np.cumsum([0, *(len(array) for array in homes.values())])
        span = {key: last[i : i + 2] for i, key in enumerate(homes)}
        self._spans = np.array([[0, 0] if a is None else span[id(a)] for a in obstacles], dtype=np.int64)
        self._obstacles = np.concatenate([np.zeros((0, 4)), *homes.values()])

    def place(self, body: int, pose: Array, tilt: Tilt, streams: Sequence[np.random.Generator]) -> None:
        """Start an episode: put a body at a pose (3,); ``streams``: those of IMU and odometry."""
        row = self._state[body]
        row[:] = 0.0
        self.pose[body] = pose
        self._sway[body, :4], self._sway[body, 4:] = tilt.frequency.ravel(), tilt.phase.ravel()
        self.noise.start(body, *streams)
        self._doing[:] = kernel.REST
        self._doing[body] = kernel.SENSE
        self._run()
        self._doing[:] = kernel.MOVE

    def step(self, resting: Iterable[int] = ()) -> None:
        """Carry out the wanted motion of all bodies but the resting ones, and sense."""
        for body in resting:
            self._doing[body] = kernel.REST
        self._run()
        for body in resting:
            self._doing[body] = kernel.MOVE

    def _run(self) -> None:
        spent = kernel.step_bodies(
            self._state,
            self._doing,
            self.noise.values,
            self._obstacles,
            self._spans,
            self._sensors,
            self._bounds,
            self.reading,
        )
        if spent:
            for body in np.flatnonzero((self._doing != kernel.REST) & ((self.steps + 1) % kernel.BLOCK == 0)):
                self.noise.refill(int(body))
