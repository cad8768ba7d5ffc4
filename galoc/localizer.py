"""GALoc on one screen: image or wireframe -> layout -> rays -> SE(2) scores -> pose, alone or over a sequence."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.belief import Belief, checked_odometry
from galoc.camera import Camera, levelling
from galoc.cells import cosine_cells, likely_cells
from galoc.column_rays import column_rays
from galoc.config import LocalizerConfig as LocalizerConfig
from galoc.detect import Detector, checked_detector, detect, make_detector
from galoc.detect.pictures import checked_picture
from galoc.errors import GalocError
from galoc.floorplan import Floorplan
from galoc.heights import Heights
from galoc.layout import METHODS, solve_layout
from galoc.likelihood import Likelihood
from galoc.match import Matcher
from galoc.observation import Observation, observation
from galoc.peaks import search
from galoc.plan_facts import manhattan
from galoc.posterior import NEAR_M, locate_modes, probability_near
from galoc.profiles import profile_field
from galoc.rays import cast_rays
from galoc.rivals import levelled
from galoc.score import SCORINGS, confidence, score_volume
from galoc.tracker import Tracker
from galoc.types import Estimate, Layout, Rays, Wireframe

GRID_SHARE = 0.95
"""Share of the map's wall length on one right-angled grid above which the wall-direction prior is used."""
FRAME_TEMPER = 0.9
"""Weight of one frame's log-likelihood in the belief: errors of neighbouring frames are not independent."""
FRAME_FLOOR = -12.0
"""No frame makes a pose less likely than this against its best one, nats: a wrong frame can be outvoted."""
FIRST_CELLS = 64
"""Cells registered at the first view of a sequence."""
LIKELY_HEADINGS = 72
"""Heading cells with scoring "likelihood"."""
LEAST_LOG_P = -40.0
"""The belief keeps this much of every pose, nats below the best: what was ruled out by mistake can come back."""
FULL_EVERY = 20
"""Each so-many-th frame is scored at all positions, hopeless ones too."""
NEAR_RAD, LEAD = 0.35, 1.5
"""The tracker moves to the belief's peak where that is another place (further than 0.5 m or this, rad) with this many
times the mass."""
SURE, UNSURE = 0.9, 0.3
"""Heights are learned above the first confidence and forgotten below the second."""


class Localizer:
    """Finds a camera's pose in a floorplan.

    Args:
        plan: the map.
        camera: intrinsics of the images.
        detector: turns images into wireframes, made when the first image comes: "onnx", the learned one; "lines", the
            one without weights; or an object (:class:`galoc.detect.Detector`). Where wireframes are passed in, none is.
        geometry: layout method, "ml" or "paper".
        scoring: "likelihood", or "cosine", the paper's. Only "paper" with "cosine" is the paper's method.
        config: grid, filter and what is known of the sensors.

    Raises:
        GalocError: unknown detector, geometry or scoring; a plan without free space.
    """

    def __init__(
        self,
        plan: Floorplan,
        camera: Camera,
        *,
        detector: str | Detector = "onnx",
        geometry: str = "ml",
        scoring: str = "likelihood",
        config: LocalizerConfig | None = None,
    ) -> None:
        for name, value, known in (("geometry", geometry, METHODS), ("scoring", scoring, SCORINGS)):
            if value not in known:
                raise GalocError(f"{name} {value!r}", f"one of {known}", f"Use {name}={known[0]!r}.")
        self.plan, self.camera, self.detector = plan, camera, checked_detector(detector)
        self.geometry, self.scoring = geometry, scoring
        self.config = config = config or LocalizerConfig()
        likely = scoring == "likelihood"
        if config.exact and likely:
            raise GalocError(
                'exact=True with scoring "likelihood"',
                'scoring "cosine": registration to the map, not the lattice, decides otherwise',
                "Leave exact out, or ask galoc.Matcher for the best pose of the lattice.",
            )
        self.field = profile_field(plan, config.resolution)
        # Registration compares each wall with the map itself: a prior on directions would use that twice.
        self._on_grid = geometry == "ml" and not likely and manhattan(plan.segments)[0] >= GRID_SHARE
        spread = (config.odometry_noise, math.radians(config.odometry_turn_deg)) if likely else (0.0, 0.0)
        self.belief = self._belief(*spread)
        self._frames = 0
        self._heights = config.prior(plan)
        self.likelihood = Likelihood(self.field) if likely else None
        """The map as scoring "likelihood" sees it; None with "cosine"."""
        self._matcher = Matcher(plan) if config.exact else None
        self._tracker = Tracker(self.likelihood, self._heights, *spread) if self.likelihood is not None else None

    def _belief(self, noise: float, turn_rad: float) -> Belief:
        config, likely = self.config, self.scoring == "likelihood"
        headings = config.headings or (LIKELY_HEADINGS if likely else 360)
        # What moves along a cell's middle fans out by the width of the cell (uniform, half of it along each axis).
        noise = math.hypot(noise, math.tau / headings / math.sqrt(24.0)) if likely else noise
        return Belief(
            self.field,
            headings=headings,
            diffusion_m=noise if config.diffusion_m is None else config.diffusion_m,
            diffusion_rad=turn_rad if config.diffusion_rad is None else config.diffusion_rad,
            motion=config.motion,
            kidnapped=config.kidnapped,
        )

    def reset(self) -> None:
        """Forget the sequence: the belief becomes uniform, learned heights are dropped."""
        self.belief.reset()
        self._frames = 0
        if self._tracker is not None:
            self._tracker.reset()

    @property
    def heights(self) -> Heights:
        """What is known of the heights by now: given, or learned over the sequence."""
        return self._heights if self._tracker is None else self._tracker.heights

    def observe(
        self, image: ArrayLike | Wireframe, gravity: ArrayLike, heights: Heights | None = None
    ) -> tuple[Layout, Rays]:
        """The per-image half of the method: detect, align with gravity, look from above, cast rays.

        Args:
            image: (H, W, 3) uint8 RGB image, or its wireframe.
            gravity: measured (roll, pitch), rad.
            heights: what is known of the heights; None: what was given.
        """
        known = heights or self._heights
        wireframe = image if isinstance(image, Wireframe) else self._detect(image, gravity, known)
        layout = solve_layout(
            wireframe,
            self.camera,
            gravity,
            self.geometry,
            imu_sigma_rad=math.radians(self.config.imu_sigma_deg),
            heights=known,
            on_grid=self._on_grid,
        )
        if wireframe.columns is None or not self.config.columns or self.geometry == "paper":
            return layout, cast_rays(layout, self.camera)
        return layout, column_rays(wireframe.columns, layout, self.camera, gravity)

    def scores(
        self, image: ArrayLike | Wireframe, gravity: ArrayLike, heights: Heights | None = None
    ) -> NDArray[np.float32]:
        """(P, 360) score of every grid position (``field.positions``) and whole degree: the heat map of one image.

        Scoring "cosine": similarity in [0, 1]; "likelihood": log-likelihood up to a constant. Arguments as for
        :meth:`locate`.
        """
        layout, rays = self.observe(image, gravity, heights)
        if self.likelihood is not None:
            return self.likelihood.volume(observation(layout, rays))
        return score_volume(self.field.ranges, rays)

    def locate(self, image: ArrayLike | Wireframe, gravity: ArrayLike, heights: Heights | None = None) -> Estimate:
        """Pose from a single image; does not touch the belief.

        Args:
            image: (H, W, 3) uint8 RGB image, or its wireframe.
            gravity: measured (roll, pitch), rad.
            heights: what is known of the heights in this image (geometry "ml"); None: what was given.
        """
        layout, rays = self.observe(image, gravity, heights)
        if self.likelihood is not None:
            return self._locate_by_likelihood(self.likelihood, observation(layout, rays), layout, rays)
        if not rays.known.any():
            return Estimate(np.full(3, np.nan), 0.0, True, rays=rays, layout=layout)
        best = search(self.field, rays, count=self.config.candidates or 32).candidates
        if self._matcher is not None:
            best = self._matcher.argmax(rays).before(best)
        exact = self._matcher is not None
        return Estimate(best[0, :3], confidence(rays), False, best, rays=rays, layout=layout, certified=exact)

    def _locate_by_likelihood(self, likelihood: Likelihood, seen: Observation, layout: Layout, rays: Rays) -> Estimate:
        if seen.blind:
            return Estimate(np.full(3, np.nan), 0.0, True, rays=rays, layout=layout)
        modes = locate_modes(likelihood, seen, self.config.candidates or 128)
        sure = probability_near(modes, modes.poses[0, :2])
        candidates = np.column_stack([modes.poses[:, :3], modes.log_mass])
        unsure = sure < self.config.abstain_below
        return Estimate(
            modes.poses[0, :3], sure, unsure, candidates, modes.covariances[0, :3, :3], rays=rays, layout=layout
        )

    def step(self, image: ArrayLike | Wireframe, gravity: ArrayLike, odometry: ArrayLike = (0.0, 0.0, 0.0)) -> Estimate:
        """Pose from the sequence so far: predict by odometry, then fuse this image.

        Args:
            image: (H, W, 3) uint8 RGB image, or its wireframe.
            gravity: measured (roll, pitch), rad.
            odometry: (dx forward, dy left, dheading) since the last step in the previous body frame, m and rad.
        """
        layout, rays = self.observe(image, gravity, self.heights)
        return self.fuse(rays, odometry, layout)

    def fuse(self, rays: Rays, odometry: ArrayLike, layout: Layout | None = None) -> Estimate:
        """The sequence half of :meth:`step`, for rays from elsewhere (a laser, an oracle, another front end).

        Args:
            rays: N_r rays of this camera's field of view.
            odometry: as for :meth:`step`.
            layout: behind the rays; without it (or its covariance) the rays alone are scored.
        """
        move = checked_odometry(odometry)
        self.belief.predict(move)
        seen = bool(rays.known.any())
        if self._tracker is not None and self.likelihood is not None:
            return self._fuse_by_likelihood(self.likelihood, self._tracker, rays, move, layout)
        if seen:
            self.belief.update(cosine_cells(self.field, rays, self.belief), confidence(rays))
        return self._report(self.belief.peak(), not seen, rays, layout)

    def _fuse_by_likelihood(
        self, likelihood: Likelihood, tracker: Tracker, rays: Rays, move: NDArray[np.float64], layout: Layout | None
    ) -> Estimate:
        layout = layout or Layout.unknown(self.geometry)
        seen = observation(layout, rays)
        tracker.predict(move)
        if tracker.mean is None and not seen.blind:  # the first view: registration tells rooms apart that rays do not
            tracker.start(locate_modes(likelihood, seen, FIRST_CELLS).poses[0, :3])
        if not seen.blind:
            self._add_frame(likelihood, seen)
        peak = self.belief.peak()
        if tracker.mean is None or self._leads(peak, tracker.mean):
            tracker.start(peak)
        scale = tracker.update(seen)
        assert tracker.mean is not None
        estimate = self._report(tracker.mean, seen.blind, rays, layout, tracker.covariance)
        if estimate.confidence > SURE and scale is not None and layout.covariance is not None:
            tracker.learn(layout, scale)
        elif estimate.confidence < UNSURE:
            tracker.forget_heights()
        return estimate

    def _add_frame(self, likelihood: Likelihood, seen: Observation) -> None:
        """Score one frame and fuse it; hopeless positions are looked at only now and then."""
        self._frames += 1
        found, rows = likely_cells(likelihood, seen, self.belief, everywhere=self._frames % FULL_EVERY == 0)
        found = levelled(likelihood, seen, self.belief, found, rows, FRAME_TEMPER)
        self.belief.add(found, LEAST_LOG_P, rows=rows, temper=FRAME_TEMPER, frame_floor=FRAME_FLOOR)

    def _leads(self, peak: NDArray[np.float64], tracked: NDArray[np.float64]) -> bool:
        """Whether the belief has come to prefer another place than the tracked one."""
        turned = abs(math.remainder(peak[2] - tracked[2], math.tau))
        if math.hypot(*(peak[:2] - tracked[:2])) < NEAR_M and turned < NEAR_RAD:
            return False
        here, there = (self.belief.mass_near(pose, NEAR_M, NEAR_RAD) for pose in (peak, tracked))
        return here > LEAD * there

    def _report(
        self,
        pose: NDArray[np.float64],
        abstained: bool,
        rays: Rays,
        layout: Layout | None,
        covariance: NDArray[np.float64] | None = None,
    ) -> Estimate:
        """The estimate at a pose under the present belief."""
        entropy = self.belief.entropy()
        # Before the first fix a blind frame leaves the belief uniform: there is nothing to report.
        if entropy >= math.log(self.belief.size) - 1e-6:
            return Estimate(np.full(3, np.nan), 0.0, abstained, rays=rays, layout=layout, entropy=entropy)
        mass = self.belief.mass_near(pose, NEAR_M)
        if self.likelihood is not None:
            abstained = abstained or mass < self.config.abstain_below
        return Estimate(pose.copy(), mass, abstained, covariance=covariance, rays=rays, layout=layout, entropy=entropy)

    def _detect(self, image: ArrayLike, gravity: ArrayLike, heights: Heights) -> Wireframe:
        picture = checked_picture(image, self.camera)
        levelling(gravity)  # refuses what is no gravity
        roll, pitch = np.asarray(gravity, dtype=np.float64)
        return detect(make_detector(self.detector), picture, self.camera, (float(roll), float(pitch)), heights)
