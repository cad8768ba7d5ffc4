"""Photographs of furnished test homes with their truth, and what a wireframe says of each column."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc import Camera, Floorplan, Wireframe
from galoc.detect.strip import MOST_COLUMNS, columns_for
from galoc.types import BORDER
from galoc_env.homes import generate
from galoc_env.imaging import Imaging
from galoc_env.render import make_renderer
from galoc_env.scene import Scene, build_scene
from galoc_env.truth import visible_wireframe
from training.labels import Labels, label
from training.views import View, Viewpoints

Array = NDArray[np.float64]

IMU_DEG = 1.0
"""Noise of roll and pitch, degrees."""


@dataclass(frozen=True, slots=True)
class Condition:
    """What the photographs of a table have in common; the defaults are the baseline."""

    width: int = 640
    height: int = 480
    hfov_deg: float = 108.0
    tilt_deg: float = 5.0
    """Roll and pitch are uniform up to this."""
    camera_m: tuple[float, float] = (1.0, 1.7)
    """Range of the camera's height."""
    furniture: float = 0.5
    imaging: str | dict[str, Any] | None = "random"
    """"random": anything up to "poor"; else what Imaging.of takes."""
    renderer: str = "raster"
    quality: str = "default"
    after: str = ""
    """Name of a degradation beyond the training range, see ``DEGRADED``."""

    def camera(self) -> Camera:
        """The camera."""
        return Camera.from_hfov(self.width, self.height, self.hfov_deg)


@dataclass(frozen=True, slots=True, eq=False)
class Photo:
    """One image as the sensors give it, and the truth."""

    image: NDArray[np.uint8]
    camera: Camera
    view: View
    truth: Wireframe
    labels: Labels
    ceiling_m: float
    """Above the floor."""


DEGRADED = {
    "dark": lambda x, rng: (x * 0.12).astype(np.uint8),
    "noisy": lambda x, rng: np.clip(x + rng.normal(0.0, 60.0, x.shape), 0, 255).astype(np.uint8),
    "blurred": lambda x, rng: _blurred(x, 0.012),
    "washed out": lambda x, rng: (205 + 0.15 * x).astype(np.uint8),
    "ruined: dark": lambda x, rng: (x * 0.015).astype(np.uint8),
    "ruined: noisy": lambda x, rng: np.clip(x + rng.normal(0.0, 250.0, x.shape), 0, 255).astype(np.uint8),
    "ruined: blurred": lambda x, rng: _blurred(x, 0.05),
    "ruined: washed out": lambda x, rng: (250 + 0.012 * x).astype(np.uint8),
}
"""Bad: an eighth of the light, noise of 60 of 255, blur of 1.2 % of the width, a sixth of the contrast. Ruined, beyond
what training has: four grey levels, noise of 250, blur of 5 %, four grey levels near white."""


def _blurred(image: NDArray[np.uint8], share: float) -> NDArray[np.uint8]:
    import cv2

    return np.asarray(cv2.GaussianBlur(image, (0, 0), share * image.shape[1]), np.uint8)


def furnished_plan(source: int | str, condition: Condition) -> Scene:
    """The scene of a test home or of a plan file."""
    plan = generate(source, split="test") if isinstance(source, int) else Floorplan.load(source)
    seed = source if isinstance(source, int) else 0
    return build_scene(plan, furniture=condition.furniture, seed=seed)


def photographs(scene: Scene, condition: Condition, count: int, seed: list[int]) -> Iterator[Photo]:
    """Photographs from random poses; poses depend on the scene and the seed alone, not on camera or renderer."""
    camera = condition.camera()
    places, noise = np.random.default_rng([*seed, 0]), np.random.default_rng([*seed, 1])
    renderer = make_renderer(condition.renderer, scene, camera, quality=condition.quality)
    exact_renderer = None if condition.renderer == "raster" else make_renderer("raster", scene, camera)
    viewpoints = Viewpoints(scene)
    made = 0
    while made < count:
        view = _view(viewpoints, scene.plan.ceiling_height, condition, places)
        frame = renderer.render(view.pose, view.height_m, view.gravity)
        exact = frame if exact_renderer is None else exact_renderer.render(view.pose, view.height_m, view.gravity)
        random = condition.imaging == "random"
        imaging = Imaging.random(noise, 1.0) if random else Imaging.of(condition.imaging)
        turn = float(noise.normal(0.0, 0.2))
        image = imaging.apply(np.ascontiguousarray(frame.rgb), camera, noise, turn_rad=turn, gravity=view.gravity)
        if condition.after:
            image = DEGRADED[condition.after](image, noise)
        labels = label(scene, camera, view, exact, min(MOST_COLUMNS, columns_for(camera)))
        if labels is None:
            continue
        assert scene.sight_plan is not None
        truth = visible_wireframe(scene.sight_plan, camera, view.pose, view.height_m, view.gravity)
        made += 1
        yield Photo(image, camera, view, truth, labels, scene.plan.ceiling_height)
    renderer.close()


def _view(viewpoints: Viewpoints, ceiling_m: float, condition: Condition, rng: np.random.Generator) -> View:
    drawn = viewpoints.draw(rng)
    low, high = condition.camera_m
    height = min(float(rng.uniform(low, high)), ceiling_m - 0.2)
    heading = float(rng.uniform(-math.pi, math.pi))
    roll, pitch = (math.radians(condition.tilt_deg) * rng.uniform(-1.0, 1.0, 2)).tolist()
    error = math.radians(IMU_DEG) * rng.standard_normal(2)
    measured = roll + float(error[0]), pitch + float(error[1])
    return View(np.array([*drawn.pose[:2], heading]), height, (roll, pitch), measured)


def boundary_of(wireframe: Wireframe, camera: Camera, gravity: tuple[float, float], azimuths: Array) -> Array:
    """(2, C) elevation, rad, of the ceiling and floor line of the wall in each column; NaN where none is measured."""
    found = np.full((2, len(azimuths)), np.nan)
    m = np.tan(azimuths)
    for row in (0, 1):
        for _, *ends in wireframe.shown_lines(row):
            rays = camera.rays_level(np.array(ends), gravity)
            (x0, y0), (x1, y1) = rays[:, :2] / rays[:, 2:]
            if not x1 > x0:
                continue
            inside = (m >= x0) & (m <= x1)
            y = y0 + (y1 - y0) * (m - x0) / (x1 - x0)
            found[row] = np.where(inside, np.arctan(-y / np.sqrt(1.0 + m**2)), found[row])
    return found


def edges_of(wireframe: Wireframe, camera: Camera, gravity: tuple[float, float]) -> Array:
    """(E,) azimuths of the vertical wall edges of a wireframe, rad; edges 0.5 degrees apart are one."""
    inner = np.flatnonzero(np.asarray(wireframe.kind) != BORDER)
    if len(inner) == 0:
        return np.zeros(0)
    middle = 0.5 * (wireframe.ceiling[inner] + wireframe.floor[inner])
    rays = camera.rays_level(middle, gravity)
    found = np.sort(np.arctan2(rays[:, 0], rays[:, 2]))
    return found[np.concatenate([[True], np.diff(found) > math.radians(0.5)])]
