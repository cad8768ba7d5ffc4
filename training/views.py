"""Random cameras and poses: what a training frame is taken with, and from where."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc import Camera
from galoc.detect.strip import columns_for
from galoc_env.motion import distances, walkable
from galoc_env.scene import Scene

Array = NDArray[np.float64]

WIDTHS = (128, 176, 240)
"""Columns of the strips that are trained on: a camera's strip is filled up to the next of these."""
ASPECTS = ((4, 3), (16, 9), (3, 2), (1, 1), (3, 4), (9, 16))
"""Width to height of the pictures."""
ASPECT_SHARES = (0.55, 0.15, 0.05, 0.05, 0.12, 0.08)
"""How often each comes."""
USUAL_SHARE = 0.35
"""Share of cameras like the environment's own: 4:3, wide."""
CLOSE_SHARE = 0.12
"""Share of views that look straight at something near."""
CLEARANCE_M = 0.18
"""No camera is nearer to walls and furniture than this, m."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Where a frame is taken from, and how it is tilted."""

    pose: Array
    """(3,) x, y (m), heading (rad)."""
    height_m: float
    """Of the camera above the floor."""
    gravity: tuple[float, float]
    """True roll and pitch, rad."""
    measured: tuple[float, float]
    """What the IMU reads, rad."""


def random_camera(rng: np.random.Generator) -> Camera:
    """A camera of 46 to 112 degrees, upright or lying, whose longer side is 160 to 448 px."""
    if rng.random() < USUAL_SHARE:
        (wide, high), hfov = (4, 3), rng.uniform(100.0, 112.0)
    else:
        wide, high = ASPECTS[int(rng.choice(len(ASPECTS), p=ASPECT_SHARES))]
        hfov = rng.uniform(46.0, 112.0) if wide > high else rng.uniform(42.0, 100.0)
    longest = math.exp(rng.uniform(math.log(160.0), math.log(448.0)))
    scale = longest / max(wide, high)
    return Camera.from_hfov(max(32, round(wide * scale)), max(32, round(high * scale)), float(hfov))


def strip_columns(camera: Camera) -> int:
    """The width of strip, one of ``WIDTHS``, that a camera's frames are stored with."""
    return next(width for width in WIDTHS if width >= columns_for(camera))


class Viewpoints:
    """Draws views of a furnished home.

    Args:
        scene: the home.
    """

    def __init__(self, scene: Scene) -> None:
        edges = np.asarray(scene.obstacles, np.float64).reshape(-1, 4)
        self._plan = scene.plan
        self._obstacles = np.concatenate([scene.plan.segments, edges])
        self._positions = walkable(scene.plan, edges, CLEARANCE_M).positions

    def draw(self, rng: np.random.Generator) -> View:
        """One view: somewhere in the home, at any height a camera is carried or mounted at."""
        xy = self._positions[rng.integers(len(self._positions))] + rng.uniform(-0.05, 0.05, 2)
        heading = rng.uniform(-math.pi, math.pi)
        if rng.random() < CLOSE_SHARE:
            heading = self._towards_nearest(xy) + rng.normal(0.0, 0.5)
        usual = rng.random() < 0.6
        height = rng.uniform(1.1, 1.7) if usual else rng.uniform(0.3, 2.0)
        height = min(height, self._plan.ceiling_height - 0.25)
        amplitude = math.radians(2.0 if rng.random() < 0.4 else 15.0)
        gravity = rng.uniform(-amplitude, amplitude, 2)
        error = math.radians(rng.uniform(0.0, 0.9)) * rng.standard_normal(2)
        roll, pitch = (gravity + error).tolist()
        return View(np.array([*xy, heading]), float(height), (float(gravity[0]), float(gravity[1])), (roll, pitch))

    def _towards_nearest(self, xy: Array) -> float:
        """Bearing of the nearest wall or piece of furniture, rad."""
        edge = self._obstacles[int(np.argmin(distances(xy, self._obstacles)))]
        a, b = edge[:2], edge[2:]
        length = max(float((b - a) @ (b - a)), 1e-12)
        foot = a + float(np.clip((xy - a) @ (b - a) / length, 0.0, 1.0)) * (b - a)
        return math.atan2(*(foot - xy)[::-1].tolist())
