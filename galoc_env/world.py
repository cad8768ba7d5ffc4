"""What the environment keeps: the world of a plan, the state of an episode, and a snapshot of a step."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc import Camera, Estimate, Floorplan, GalocError, Wireframe
from galoc_env import motion
from galoc_env.observe import Observer, make_localizer
from galoc_env.scoring import BELIEF_REWARDS, Score
from galoc_env.sensors import Tilt
from galoc_env.settings import Settings

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

NOISE_WIDTH_PX = 640
"""Image width that the detector noise refers to (the paper's), px."""


@dataclass(slots=True, eq=False)
class World:
    """One furnished plan with its renderer and localizer; kept over episodes as long as the plan stays."""

    plan: Floorplan
    number: int
    """Number of the generated home; 0 for a fixed plan."""
    scene: Any
    furniture: Array
    """(F, 4) m: footprint edges."""
    obstacles: Array
    """(S, 4) m: walls and footprint edges."""
    walkable: motion.Walkable
    observer: Observer | None
    """None with `localizer="none"`."""
    _renderer: Any = None

    @classmethod
    def build(cls, plan: Floorplan, number: int, settings: Settings, camera: Camera) -> World:
        """Furnish a plan and prepare its localizer; the renderer waits for the first image.

        Raises:
            GalocError: camera above the ceiling, or a localizer without the belief that the reward needs.
        """
        from galoc_env.scene import build_scene

        if settings.camera_height >= plan.ceiling_height:
            raise GalocError(
                f"camera_height = {settings.camera_height:g} m under a ceiling of {plan.ceiling_height:g} m",
                "a camera below the ceiling",
                "Lower `camera_height`.",
            )
        scene = build_scene(plan, furniture=settings.furniture, seed=number)
        furniture = np.asarray(scene.obstacles, dtype=np.float64).reshape(-1, 4)
        localizer = make_localizer(settings, plan, camera)
        observer = None if localizer is None else Observer(localizer, plan)
        if observer is not None and settings.reward in BELIEF_REWARDS:
            observer.reset()
            if observer.belief is None:
                raise GalocError(
                    f"reward = {settings.reward!r} with localizer {settings.localizer!r}, which has no belief",
                    '"error" or "success"',
                    "Choose one of these rewards, or give the localizer a `belief`.",
                )
        obstacles = np.concatenate([plan.segments, furniture])
        return cls(plan, number, scene, furniture, obstacles, motion.walkable(plan, furniture), observer)

    def random_pose(self, rng: np.random.Generator) -> Array:
        """(3,) a pose in which the body fits, uniform over the walkable cells and over headings."""
        positions = self.walkable.positions
        # Cell centres keep 5 cm more than the body's radius, so jitter within the cell cannot touch a wall.
        half = min(self.walkable.resolution / 2.0, 0.03)
        for _ in range(1000):
            xy = positions[rng.integers(len(positions))] + rng.uniform(-half, half, size=2)
            heading = rng.uniform(-math.pi, math.pi)
            if motion.distances(xy, self.obstacles).min() >= motion.BODY_RADIUS:
                return np.array([*xy, heading])
        raise GalocError(f"plan {self.plan.name!r} without a free start", "room to stand", "Lower `furniture`.")

    def wireframe(
        self, pose: Array, tilt: tuple[float, float], settings: Settings, camera: Camera, rng: np.random.Generator
    ) -> Wireframe:
        """What the detector sees: the true wireframe of the view with its noise."""
        from galoc.detect.oracle import perturb
        from galoc_env.truth import visible_wireframe

        truth = visible_wireframe(self.plan, camera, pose, settings.camera_height, tilt)
        return perturb(truth, camera, settings.detector_noise_px * camera.width / NOISE_WIDTH_PX, rng)

    def image(self, pose: Array, tilt: tuple[float, float], settings: Settings, camera: Camera) -> Image:
        """(H, W, 3) RGB view; all zero when nothing is to be drawn."""
        if settings.renderer == "none":
            return np.zeros((camera.height, camera.width, 3), np.uint8)
        if self._renderer is None:
            from galoc_env.render import make_renderer

            self._renderer = make_renderer(settings.renderer, self.scene, camera)
        x, y, heading = (float(v) for v in pose)
        frame = self._renderer.render((x, y, heading), settings.camera_height, tilt, rgb_only=True)
        return np.ascontiguousarray(frame.rgb)

    def close(self) -> None:
        """Free the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


@dataclass(slots=True, eq=False)
class Episode:
    """State of the running episode."""

    tilt: Tilt
    sensor_rngs: list[np.random.Generator]
    """Streams of IMU, odometry and detector noise."""
    moved: motion.Moved
    """Where the last motion led."""
    steps: int = 0
    succeeded: bool = False
    wireframe: Wireframe = field(default_factory=Wireframe.empty)
    image: Image | None = None
    estimate: Estimate | None = None
    trail: list[Array] = field(default_factory=list)
    estimates: list[Array] = field(default_factory=list)
    scores: list[Score] = field(default_factory=list)

    @property
    def errors_m(self) -> list[float]:
        """Position error at every observation so far, m."""
        return [s.error_m for s in self.scores]

    def take(self, estimate: Estimate, score: Score) -> None:
        """Remember the localizer's answer to the current observation."""
        self.estimate = estimate
        self.estimates.append(np.array(estimate.pose, dtype=np.float64))
        self.scores.append(score)


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """One step, as a picture or a report shows it."""

    step: int
    camera: Camera
    image: Image | None
    """(H, W, 3) RGB; None when nothing was drawn."""
    wireframe: Wireframe
    wireframe_source: str
    """Where the wireframe comes from, in words."""
    trail: Array
    """(T, 3) true poses since the reset, the last one is current."""
    collided: bool
    estimate: Estimate | None
    """None without a localizer."""
    estimates: Array
    """(T, 3) estimated poses, NaN where there was none."""
    scores: tuple[Score, ...]
    """One per observation."""
    positions: Array | None
    """(P, 2) m: positions of the belief; None without a belief."""
    marginal: Array | None
    """(P,) probability of each position."""
    resolution: float
    """Grid of the positions, m."""

    @classmethod
    def of(cls, world: World, episode: Episode, settings: Settings) -> Snapshot:
        """The current step of an episode."""
        estimate = episode.estimate
        belief = None if world.observer is None else world.observer.belief
        return cls(
            episode.steps,
            settings.camera(),
            None if settings.renderer == "none" else episode.image,
            episode.wireframe,
            f"true wall lines + {settings.detector_noise_px:g} px noise",  # the oracle, the only detector so far
            np.array(episode.trail).reshape(-1, 3),
            episode.moved.collided,
            estimate,
            np.array(episode.estimates).reshape(-1, 3),
            tuple(episode.scores),
            None if belief is None else np.asarray(belief.positions),
            None if belief is None else np.asarray(belief.position_marginal()),
            0.0 if belief is None else float(belief.resolution),
        )
