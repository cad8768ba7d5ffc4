"""Views behind the stress tests: wall chains that a camera in a generated home truly sees."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from galoc import Camera, Floorplan, GalocError
from galoc.rays import chain_rays, ray_count
from galoc.types import BORDER
from galoc_env.homes import KINDS, SEEDS_PER_SPLIT, generate
from galoc_env.truth import Panel, visible_panels

Array = NDArray[np.float64]

WIDTH, HEIGHT = 640, 480
"""Image size, px."""
MIN_PAIRS = 3
"""A view needs this many pairs with both junctions inside the image."""
MIN_COVERAGE = 0.4
"""And walls between such pairs over this share of the field of view."""
CLEARANCE_M = 0.4
"""Least distance of the camera from any wall, m."""
VIEWS_PER_PLAN = 4
"""Views taken in one home."""
TRIES_PER_PLAN = 24
"""Random poses tried for them."""
PLANS_PER_FRAME = 40
"""Give up when this many homes per wanted view were not enough."""
LOOK_ASIDE = math.radians(20.0)
"""How far beyond the level field of view walls are followed, for cameras that are tilted, rad."""
MIXED = "mixed"
"""Room kind: rectilinear, Atlanta and free-angled homes in turn."""


@dataclass(frozen=True, slots=True)
class Condition:
    """One setting of every factor; the defaults are the baseline that the sweeps vary one factor at a time."""

    sigma_px: float = 5.0
    """Gaussian noise of each junction coordinate, px of a 640 px wide image."""
    tilt_deg: float = 1.0
    """Standard deviation of the IMU's error in roll and in pitch, degrees."""
    pairs: int | None = None
    """Exactly this many pairs in view; None: as they come, at least 3."""
    hfov_deg: float = 108.0
    """Horizontal field of view, degrees."""
    kind: str = MIXED
    """Homes: rectilinear, atlanta, free, or mixed."""
    outlier_share: float = 0.0
    """Probability of each junction to be displaced by 30 to 80 px."""
    wrong_junctions: int = 0
    """Exactly this many junctions of each view displaced by 30 to 80 px, at most one of a pair."""
    missed_share: float = 0.0
    """Probability of each corner between two walls to be overlooked: its pair is gone and the walls are one."""
    one_sided_share: float = 0.0
    """Probability of each pair to show only its ceiling or only its floor junction; two pairs stay whole."""
    camera_height_m: float = 1.4
    """Above the floor, m."""
    true_tilt_deg: float = 0.0
    """Standard deviation of the camera's true roll and pitch, degrees."""
    noise_known: bool = True
    """Whether the solver is told ``sigma_px``; else it estimates the noise from the residuals."""

    def __post_init__(self) -> None:
        """Refuse what no view can be made for."""
        shares = (self.outlier_share, self.missed_share, self.one_sided_share)
        if self.kind not in (*KINDS, MIXED):
            raise GalocError(f"kind = {self.kind!r}", f"one of {(*KINDS, MIXED)}", "Fix the kind.")
        if any(not 0.0 <= share <= 1.0 for share in shares):
            raise GalocError(f"shares {shares}", "probabilities from 0 to 1", "Fix the share.")
        if not all(math.isfinite(v) and v >= 0.0 for v in (self.sigma_px, self.tilt_deg, self.true_tilt_deg)):
            raise GalocError("a negative or infinite noise", "standard deviations of 0 or more", "Fix the noise.")
        if not 0.2 <= self.camera_height_m <= 2.2:
            raise GalocError(
                f"camera_height_m = {self.camera_height_m!r}", "0.2 to 2.2 m, under every ceiling", "Fix the height."
            )

    @property
    def camera(self) -> Camera:
        """The camera of this condition."""
        return Camera.from_hfov(WIDTH, HEIGHT, self.hfov_deg)


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What is true of one view."""

    plan: int
    """Seed of the home: views of one home are not independent."""
    kind: str
    """Kind of the home."""
    points: Array
    """(N, 2) m: (x right, z forward) of each pair in the level camera frame, left to right."""
    walls: NDArray[np.int64]
    """(M, 2): left and right pair of each wall seen between two pairs."""
    ceiling: Array
    """(N, 2) px, exact."""
    floor: Array
    """(N, 2) px, exact."""
    heights: Array
    """(2,) m: ceiling above and floor below the camera."""
    gravity: Array
    """(2,) rad: true roll and pitch."""
    azimuths: Array
    """(R,) rad: one ray per degree, right positive."""
    ranges: Array
    """(R,) m: distance to the walls; NaN where no wall of the chain is."""


def scenes(condition: Condition, frames: int, seed: int) -> tuple[Scene, ...]:
    """Views for a condition. They depend on its homes and camera only, so all noise levels share them.

    Args:
        condition: which homes, camera, height and tilt, and how many pairs.
        frames: number of views.
        seed: of the homes (of the test split) and poses.

    Raises:
        GalocError: such views are too rare in the generated homes.
    """
    c = condition
    return _scenes(c.kind, c.hfov_deg, c.camera_height_m, c.true_tilt_deg, c.pairs, frames, seed)


@lru_cache(maxsize=24)
def _scenes(
    kind: str, hfov_deg: float, height_m: float, tilt_deg: float, pairs: int | None, frames: int, seed: int
) -> tuple[Scene, ...]:
    camera = Camera.from_hfov(WIDTH, HEIGHT, hfov_deg)
    found: list[Scene] = []
    for index in range(PLANS_PER_FRAME * max(10, -(-frames // VIEWS_PER_PLAN))):
        home = (seed * 7919 + index) % SEEDS_PER_SPLIT
        own = KINDS[index % len(KINDS)] if kind == MIXED else kind
        plan = home_of(home, own)
        rng = np.random.default_rng([seed, index, 11])
        positions = plan.free_space(0.1).positions(CLEARANCE_M)
        views = 0
        for _ in range(TRIES_PER_PLAN):
            pose = np.array([*positions[rng.integers(len(positions))], rng.uniform(-math.pi, math.pi)])
            gravity = np.radians(tilt_deg) * np.clip(rng.standard_normal(2), -3.0, 3.0)
            scene = view(plan, (home, own), camera, pose, height_m, gravity)
            if scene is None or (pairs is not None and len(scene.points) != pairs):
                continue
            found.append(scene)
            views += 1
            if len(found) == frames:
                return tuple(found)
            if views == VIEWS_PER_PLAN:
                break
    raise GalocError(
        f"only {len(found)} of {frames} views with {pairs or MIN_PAIRS} pairs at {hfov_deg:g} degrees",
        "factors under which such views are common in the generated homes",
        "Ask for fewer pairs, a wider field of view or fewer frames.",
    )


@lru_cache(maxsize=512)
def home_of(seed: int, kind: str) -> Floorplan:
    """The home of a scene."""
    return generate(seed, kind=kind, split="test")


def view(
    plan: Floorplan, home: tuple[int, str], camera: Camera, pose: Array, height_m: float, gravity: Array
) -> Scene | None:
    """The scene at a pose; None when it shows too few whole pairs or walls over too little of the field of view.

    Args:
        plan: the home.
        home: its seed and kind, kept in the scene.
        camera: intrinsics.
        pose: (x, y, heading), m and rad.
        height_m: of the camera, m.
        gravity: true (roll, pitch), rad.
    """
    limit = min(camera.hfov_rad / 2.0 + LOOK_ASIDE, math.radians(85.0))
    azimuth, distance, corner, walls = _chain(visible_panels(plan, pose, -limit, limit))
    if len(walls) == 0:
        return None
    heights = np.array([plan.ceiling_height - height_m, height_m])
    points = np.stack([distance * np.sin(azimuth), distance * np.cos(azimuth)], axis=1)
    pixels = [
        camera.project_level(np.stack([points[:, 0], np.full(len(points), y), points[:, 1]], axis=1), gravity)
        for y in (-heights[0], heights[1])
    ]
    whole = corner & camera.contains(pixels[0]) & camera.contains(pixels[1])
    walls = walls[whole[walls].all(axis=1)]
    keep = np.unique(walls)
    covered = float(np.sum(azimuth[walls[:, 1]] - azimuth[walls[:, 0]])) / camera.hfov_rad
    if len(keep) < MIN_PAIRS or covered < MIN_COVERAGE:
        return None
    walls = np.searchsorted(keep, walls).astype(np.int64)
    n = ray_count(camera.hfov_deg)
    azimuths = np.radians(np.arange(n) - (n - 1) / 2.0)
    ranges = np.exp(chain_rays(points[keep], walls, azimuths)[0])
    return Scene(*home, points[keep], walls, pixels[0][keep], pixels[1][keep], heights, gravity, azimuths, ranges)


def _chain(panels: list[Panel]) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.int64]]:
    """Panels as nodes (azimuth, range, whether it is a true end) and walls between them; touching panels share one."""
    azimuth: list[float] = []
    distance: list[float] = []
    true_end: list[bool] = []
    walls: list[tuple[int, int]] = []
    for panel in panels:
        for side in (0, 1):
            a, r = float(panel.azimuth[side]), float(panel.range[side])
            met = side == 0 and azimuth and abs(azimuth[-1] - a) < 1e-9 and abs(distance[-1] / r - 1.0) < 2e-3
            if not met:
                azimuth.append(a)
                distance.append(r)
                true_end.append(panel.kind[side] != BORDER)
        walls.append((len(azimuth) - 2, len(azimuth) - 1))
    ends = np.array(walls, dtype=np.int64).reshape(-1, 2)
    return np.array(azimuth), np.array(distance), np.array(true_end, dtype=bool), ends
