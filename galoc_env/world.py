"""What the environment keeps: the world of a plan, the state of an episode, and a snapshot of a step."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc import Camera, Estimate, Floorplan, GalocError, Wireframe
from galoc.detect import make_detector
from galoc_env import detection, motion, process, scoring
from galoc_env.bodies import Bodies
from galoc_env.observe import Observer, estimate_observation, make_localizer
from galoc_env.sensors import Tilt
from galoc_env.settings import ESTIMATE_BOUNDS, Settings

Array = NDArray[np.float64]
Image = NDArray[np.uint8]


@dataclass(slots=True, eq=False)
class World:
    """One furnished plan and what draws it; kept over episodes as long as the plan stays."""

    plan: Floorplan
    number: int
    """Number of the generated home; 0 for a fixed plan."""
    scene: Any
    seen_plan: Floorplan
    """The plan as the camera sees it: shut doors are walls."""
    furniture: Array
    """(F, 4) m: edges of the footprints and of shut doors."""
    obstacles: Array
    """(S, 4) m: walls and these edges."""
    walkable: motion.Walkable
    observer: Observer | None = None
    """That of the single environment; None with `localizer="none"`."""
    _renderer: Any = None

    @classmethod
    def build(cls, plan: Floorplan, number: int, settings: Settings) -> World:
        """Furnish a plan; the renderer waits for the first image.

        Raises:
            GalocError: camera above the ceiling, or no room to stand.
        """
        process.import_whole("trimesh")
        from galoc_env.scene import build_scene

        if settings.camera_height >= plan.ceiling_height:
            raise GalocError(
                f"camera_height = {settings.camera_height:g} m under a ceiling of {plan.ceiling_height:g} m",
                "a camera below the ceiling",
                "Lower `camera_height`.",
            )
        scene = build_scene(plan, furniture=settings.furniture, seed=number, shut_doors=settings.shut_doors)
        furniture = np.asarray(scene.obstacles, dtype=np.float64).reshape(-1, 4)
        obstacles = np.concatenate([plan.segments, furniture])
        seen_plan = plan if scene.sight_plan is None else scene.sight_plan
        return cls(plan, number, scene, seen_plan, furniture, obstacles, motion.walkable(plan, furniture))

    def make_observer(self, settings: Settings, camera: Camera) -> Observer | None:
        """A localizer with a belief of its own about this world; None with `localizer="none"`.

        Raises:
            GalocError: no such localizer or model, a localizer without the belief that the reward needs, or threads
                lost in a fork.
        """
        if settings.localizer == "galoc":
            process.refuse_lost_threads()
        if settings.looks and settings.localizer != "none":
            make_detector(settings.detector)  # a missing model is refused before anybody walks
        localizer = make_localizer(settings, self.plan, camera)
        if localizer is None:
            return None
        observer = Observer(localizer, self.plan)
        if settings.reward in scoring.BELIEF_REWARDS:
            observer.reset()
            if observer.belief is None:
                raise GalocError(
                    f"reward = {settings.reward!r} with localizer {settings.localizer!r}, which has no belief",
                    '"error" or "success"',
                    "Choose one of these rewards, or give the localizer a `belief`.",
                )
        return observer

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

    def image(self, pose: Array, tilt: Array, settings: Settings, camera: Camera) -> Image:
        """(H, W, 3) RGB view; all zero when nothing is to be drawn."""
        if not settings.draws:
            return np.zeros((camera.height, camera.width, 3), np.uint8)
        if self._renderer is None:
            from galoc_env.render import make_renderer

            self._renderer = make_renderer(settings.renderer, self.scene, camera, quality=settings.quality)
        frame = self._renderer.render(tuple(pose.tolist()), settings.camera_height, tuple(tilt.tolist()), rgb_only=True)
        return np.ascontiguousarray(frame.rgb)

    def __getstate__(self) -> tuple[None, dict[str, Any]]:
        """Without the renderer: the copy makes its own."""
        return None, {**{name: getattr(self, name) for name in self.__slots__}, "_renderer": None}

    def close(self) -> None:
        """Free the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


@dataclass(slots=True, eq=False)
class Episode:
    """One body's running episode: what is not in the arrays of :class:`galoc_env.bodies.Bodies`."""

    world: World
    observer: Observer | None
    settings: Settings
    camera: Camera
    bodies: Bodies
    body: int
    """Which of the bodies."""
    detector_key: int
    """With the step it seeds the oracle's noise: whether anybody looks changes nothing that follows."""
    imaging_key: int
    """The same for what the camera does to its picture."""
    succeeded: bool = False
    image: Image | None = None
    """(H, W, 3): this step's picture, after lens and sensor."""
    estimate: Estimate | None = None
    trail: list[Array] = field(default_factory=list)
    """True poses since the reset, the last one is current."""
    estimates: list[Array] = field(default_factory=list)
    scores: list[scoring.Score] = field(default_factory=list)
    _seen: tuple[int, Wireframe] | None = None

    @classmethod
    def start(
        cls,
        world: World,
        observer: Observer | None,
        settings: Settings,
        camera: Camera,
        bodies: Bodies,
        body: int,
        rng: np.random.Generator,
        pose: object = None,
    ) -> Episode:
        """Put a body at a pose, a random one by default, and forget all that was.

        Raises:
            GalocError: a pose where the body does not fit.
        """
        start_rng, tilt_rng, imu_rng, odometry_rng, detector_rng, imaging_rng = rng.spawn(6)
        where = (
            world.random_pose(start_rng) if pose is None else motion.checked_start(pose, world.plan, world.obstacles)
        )
        tilt = Tilt.random(math.radians(settings.tilt_deg), tilt_rng)
        bodies.place(body, where, tilt, (imu_rng, odometry_rng))
        detector, imaging = (int(stream.integers(2**62)) for stream in (detector_rng, imaging_rng))
        if observer is not None:
            observer.reset()
        return cls(world, observer, settings, camera, bodies, body, detector, imaging)

    @property
    def steps(self) -> int:
        """Steps since the reset."""
        return int(self.bodies.steps[self.body])

    @property
    def moved(self) -> motion.Moved:
        """Where the last motion led."""
        bodies, i = self.bodies, self.body
        return motion.Moved(bodies.pose[i].copy(), bodies.moved[i].copy(), bool(bodies.collided[i]))

    @property
    def wireframe(self) -> Wireframe:
        """What the detector makes of this step's view; computed when somebody looks.

        Raises:
            GalocError: the detector looks at pictures, and none is drawn.
        """
        step = self.steps
        if self._seen is None or self._seen[0] != step:
            self._seen = step, self._detect(step)
        return self._seen[1]

    def _detect(self, step: int) -> Wireframe:
        bodies, i = self.bodies, self.body
        if self.settings.looks:
            assert self.image is not None
            heights = None if self.observer is None else self.observer.heights
            return detection.look(self.image, bodies.gravity[i], self.settings, self.camera, heights)
        plan, key = self.world.seen_plan, (self.detector_key, step)
        return detection.oracle(plan, bodies.pose[i], bodies.tilt[i], self.settings, self.camera, key)

    def imaged(self, image: Image, imaging: Any) -> Image:
        """(H, W, 3): a picture after lens and sensor."""
        bodies, i = self.bodies, self.body
        rng = np.random.default_rng((self.imaging_key, self.steps))
        turn, (roll, pitch) = float(bodies.moved[i, 2]), bodies.tilt[i].tolist()
        return np.ascontiguousarray(imaging.apply(image, self.camera, rng, turn_rad=turn, gravity=(roll, pitch)))

    def localize(self) -> dict[str, NDArray[np.float32]]:
        """Let the observer take this step's readings, score it, and return its part of the observation."""
        assert self.observer is not None
        bodies, i = self.bodies, self.body
        estimate = self.observer.step(self.wireframe, bodies.gravity[i].copy(), bodies.odometry[i].copy())
        self.estimate = estimate
        self.estimates.append(np.array(estimate.pose, dtype=np.float64))
        self.scores.append(scoring.score(estimate, self.observer.belief, bodies.pose[i].copy()))
        return {
            "belief": self.observer.belief_observation(),
            "estimate": estimate_observation(estimate, ESTIMATE_BOUNDS),
        }

    def pay(self) -> tuple[float, bool]:
        """Reward of this step, and whether it ends the episode."""
        if len(self.scores) < 2:  # no localizer, nothing scored
            return 0.0, False
        recent = [s.error_m for s in self.scores[-scoring.HOLD_STEPS :]]
        held = scoring.has_held(recent) and not self.succeeded
        self.succeeded |= held
        name = self.settings.reward
        return scoring.reward(name, self.scores[-2], self.scores[-1], held), held and name == "success"

    def verdict(self) -> dict[str, Any]:
        """The localizer's part of the info; empty without one."""
        estimate = self.estimate
        if estimate is None:
            return {}
        now = self.scores[-1]
        return {
            **({} if math.isnan(now.entropy) else {"entropy": now.entropy}),
            # No NaN in here: it is not equal to itself, and determinism is checked by comparing infos.
            "estimate": np.array(estimate.pose if math.isfinite(now.error_m) else np.zeros(3), dtype=np.float64),
            "error_m": now.error_m,
            "error_rad": now.error_rad,
            "coverage": 0.0 if estimate.rays is None else estimate.rays.coverage,
            "abstained": bool(estimate.abstained),
            "metrics": scoring.episode_metrics([s.error_m for s in self.scores], [s.error_rad for s in self.scores]),
        }


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """One step, as a picture or a report shows it."""

    step: int
    camera: Camera
    image: Image | None
    """(H, W, 3) RGB; None when nothing was drawn."""
    wireframe: Wireframe
    wireframe_source: str
    """Which detector the wireframe comes from, in words."""
    trail: Array
    """(T, 3) true poses since the reset, the last one is current."""
    collided: bool
    estimate: Estimate | None
    """None without a localizer."""
    estimates: Array
    """(T, 3) estimated poses, NaN where there was none."""
    scores: tuple[scoring.Score, ...]
    """One per observation."""
    positions: Array | None
    """(P, 2) m: positions of the belief; None without a belief."""
    marginal: Array | None
    """(P,) probability of each position."""
    resolution: float
    """Grid of the positions, m."""

    @classmethod
    def of(cls, episode: Episode) -> Snapshot:
        """The current step of an episode."""
        belief = None if episode.observer is None else episode.observer.belief
        return cls(
            episode.steps,
            episode.camera,
            episode.image if episode.settings.draws else None,
            episode.wireframe,
            detection.source(episode.settings),
            np.array(episode.trail).reshape(-1, 3),
            episode.moved.collided,
            episode.estimate,
            np.array(episode.estimates).reshape(-1, 3),
            tuple(episode.scores),
            None if belief is None else np.asarray(belief.positions),
            None if belief is None else np.asarray(belief.position_marginal()),
            0.0 if belief is None else float(belief.resolution),
        )
