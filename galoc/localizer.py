"""GALoc on one screen: image or wireframe -> layout -> rays -> SE(2) scores -> pose, alone or over a sequence."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.belief import Belief
from galoc.camera import Camera
from galoc.detect import Detector
from galoc.errors import GalocError
from galoc.floorplan import Floorplan
from galoc.layout import METHODS, solve_layout
from galoc.match import search
from galoc.profiles import profile_field
from galoc.rays import cast_rays
from galoc.score import SCORINGS, confidence, score_volume
from galoc.types import Estimate, Layout, Rays, Wireframe

CONFIDENCE_RADIUS = 0.5
"""A sequence's confidence is the belief mass within this distance of the reported pose, m."""


@dataclass(frozen=True, slots=True)
class LocalizerConfig:
    """Everything that can be set; the defaults are the paper's where it states them."""

    resolution: float = 0.1
    """Grid step of the coarse search and of the belief, m (large plans are coarsened, see galoc.profiles)."""
    candidates: int = 32
    """Cells refined to 0.01 m by :meth:`Localizer.locate`."""
    diffusion_m: float = 0.0
    """Position diffusion of the filter per metre moved, m/m (paper: none)."""
    diffusion_rad: float = 0.0
    """Heading diffusion of the filter per moving step, rad (paper: none)."""
    motion: str = "carried"
    """What the filter does with the part of a motion below one cell: "carried" or "rounded" (see galoc.belief)."""


class Localizer:
    """Finds a camera's pose in a floorplan.

    Args:
        plan: the map.
        camera: intrinsics of the images.
        detector: turns images into wireframes; not needed if wireframes are passed in.
        geometry: layout method, "paper".
        scoring: "cosine", the paper's.
        config: grid and filter settings.

    Raises:
        GalocError: unknown geometry or scoring; a plan without free space.
    """

    def __init__(
        self,
        plan: Floorplan,
        camera: Camera,
        *,
        detector: Detector | None = None,
        geometry: str = "paper",
        scoring: str = "cosine",
        config: LocalizerConfig | None = None,
    ) -> None:
        for name, value, known in (("geometry", geometry, METHODS), ("scoring", scoring, SCORINGS)):
            if value not in known:
                raise GalocError(f"{name} {value!r}", f"one of {known}", f"Use {name}={known[0]!r}.")
        self.plan, self.camera, self.detector = plan, camera, detector
        self.geometry, self.scoring = geometry, scoring
        self.config = config or LocalizerConfig()
        self.field = profile_field(plan, self.config.resolution)
        self.belief = Belief(
            self.field,
            diffusion_m=self.config.diffusion_m,
            diffusion_rad=self.config.diffusion_rad,
            motion=self.config.motion,
        )

    def reset(self) -> None:
        """Forget the sequence: the belief becomes uniform."""
        self.belief.reset()

    def observe(self, observation: ArrayLike | Wireframe, gravity: ArrayLike) -> tuple[Layout, Rays]:
        """The per-image half of the method: detect, align with gravity, look from above, cast rays.

        Args:
            observation: (H, W, 3) uint8 RGB image, or its wireframe.
            gravity: measured (roll, pitch), rad.
        """
        wireframe = observation if isinstance(observation, Wireframe) else self._detect(observation, gravity)
        layout = solve_layout(wireframe, self.camera, gravity, self.geometry)
        return layout, cast_rays(layout, self.camera)

    def locate(self, observation: ArrayLike | Wireframe, gravity: ArrayLike) -> Estimate:
        """Pose from a single image; does not touch the belief."""
        layout, rays = self.observe(observation, gravity)
        if not rays.known.any():
            return Estimate(np.full(3, np.nan), 0.0, True, rays=rays, layout=layout)
        best = search(self.field, rays, count=self.config.candidates).candidates
        return Estimate(best[0, :3], confidence(rays), False, best, rays=rays, layout=layout)

    def step(
        self, observation: ArrayLike | Wireframe, gravity: ArrayLike, odometry: ArrayLike = (0.0, 0.0, 0.0)
    ) -> Estimate:
        """Pose from the sequence so far: predict by odometry, then fuse this image.

        Args:
            observation: image or wireframe.
            gravity: measured (roll, pitch), rad.
            odometry: (dx forward, dy left, dheading) since the last step in the previous body frame, m and rad.
        """
        layout, rays = self.observe(observation, gravity)
        return self.fuse(rays, odometry, layout)

    def fuse(self, rays: Rays, odometry: ArrayLike, layout: Layout | None = None) -> Estimate:
        """The sequence half of :meth:`step`, for rays from elsewhere (a laser, an oracle, another front end).

        Args:
            rays: N_r rays of this camera's field of view.
            odometry: as for :meth:`step`.
            layout: kept in the estimate.
        """
        self.belief.predict(odometry)
        seen = bool(rays.known.any())
        if seen:
            self.belief.update(score_volume(self.field.ranges, rays), confidence(rays))
        pose = self.belief.peak()
        mass = self.belief.mass_near(pose, CONFIDENCE_RADIUS)
        entropy = self.belief.entropy()
        # Before the first fix a blind frame leaves the belief uniform: there is nothing to report.
        informed = entropy < math.log(self.belief.log_p.size) - 1e-6
        pose = pose if informed else np.full(3, np.nan)
        return Estimate(pose, mass if informed else 0.0, not seen, rays=rays, layout=layout, entropy=entropy)

    def _detect(self, image: ArrayLike, gravity: ArrayLike) -> Wireframe:
        if self.detector is None:
            raise GalocError(
                "an image but no detector",
                "a Wireframe, or a Localizer built with detector=...",
                "Pass Localizer(plan, camera, detector=...), or detect the wireframe yourself and pass that.",
            )
        pixels: NDArray = np.asarray(image)
        expected = (self.camera.height, self.camera.width, 3)
        if pixels.dtype != np.uint8 or pixels.shape != expected:
            raise GalocError(
                f"an image of {pixels.dtype} {pixels.shape}", f"uint8 RGB of shape {expected}", "Resize or convert it."
            )
        roll, pitch = np.asarray(gravity, dtype=np.float64)
        return self.detector.detect(pixels, self.camera, (float(roll), float(pitch)))
