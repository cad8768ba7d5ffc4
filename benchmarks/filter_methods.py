"""Matchers and filters that benchmarks/filter.py compares; every one is timed in two parts."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve, convolve1d

from galoc import Camera, Floorplan, Localizer, LocalizerConfig, Rays, Wireframe
from galoc.cells import cosine_cells, likely_cells
from galoc.localizer import FRAME_FLOOR, FRAME_TEMPER, FULL_EVERY, LEAST_LOG_P, NEAR_M
from galoc.observation import Observation
from galoc.particles import ParticleFilter
from galoc.profiles import ProfileField
from galoc.score import confidence

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

NOISE = {"detector_noise_px": 5.0, "imu_noise_deg": 0.5, "odometry_noise": 0.02}
TURN_DEG = 0.5
"""Heading noise per step that the filters are told, degrees."""


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """One step of a walk, as every method gets it."""

    pose: Array
    """(3,) truth."""
    odometry: Array
    wireframe: Wireframe
    gravity: Array
    rays: Rays
    """Metric: the heights are known to 3 %."""
    seen: Observation


def config(plan: Floorplan, height: float, headings: int | None = None, **more: float) -> LocalizerConfig:
    """What all methods are told of the sensors."""
    return LocalizerConfig(
        heights=(height, plan.ceiling_height), imu_sigma_deg=NOISE["imu_noise_deg"],
        odometry_noise=NOISE["odometry_noise"], odometry_turn_deg=TURN_DEG, headings=headings, **more,
    )  # fmt: skip


class Method:
    """One matcher and filter, fresh for a walk."""

    def match(self, step: Step) -> Float32 | None:
        """Scores of a view."""
        raise NotImplementedError

    def predict(self, odometry: Array) -> None:
        """Motion."""
        raise NotImplementedError

    def fuse(self, step: Step, scores: Float32 | None) -> Array:
        """Take in the scores; the pose."""
        raise NotImplementedError

    def timed(self, step: Step) -> tuple[dict[str, float], Array]:
        """CPU ms of matching, filter and what is neither, and the pose after a step."""
        start = time.process_time()
        self.predict(step.odometry)
        predicted = time.process_time()
        scores = self.match(step)
        matched = time.process_time()
        pose = self.fuse(step, scores)
        end = time.process_time()
        spent = {"matching": matched - predicted, "filter": predicted - start + end - matched, "rest": 0.0}
        return {k: 1e3 * v for k, v in spent.items()}, pose


class Plain(Method):
    """The common depth matcher and histogram filter, restated in numpy and scipy.

    Eleven rays 10 degrees apart against depths in 36 directions per cell, exp(-L1 / 40 cells); the filter convolves
    each heading's slice of the (36, H, W) grid with 7 x 7 taps around its motion, and the headings with 7 taps around
    the turn. All are operations on whole arrays, no loop over cells.

    Args:
        field: profiles of the plan.
        separable: 7 taps along x, then 7 along y: the same result, faster than the common filter.
    """

    HEADINGS, REACH, SCALE, LEAST_SD = 36, 3, 40.0, 0.5

    def __init__(self, field: ProfileField, *, separable: bool) -> None:
        self.field, self.separable = field, separable
        self.free = field.index >= 0
        self.depth = np.zeros((self.HEADINGS, *field.index.shape), np.float32)
        self.depth[:, self.free] = (field.ranges[:, ::10] / field.resolution).T[:, field.index[self.free]]
        # Rays of a heading lie side by side, from 50 degrees right to 50 left.
        self.around = np.concatenate([self.depth[-5:], self.depth, self.depth[:5]])
        self.p = np.where(self.free, np.float32(1.0 / (self.HEADINGS * self.free.sum())), np.float32(0.0))
        self.p = np.repeat(self.p[None], self.HEADINGS, axis=0)

    def _taps(self, shift: float, sd: float) -> Array:
        taps = np.exp(-0.5 * ((np.arange(-self.REACH, self.REACH + 1) - shift) / max(sd, self.LEAST_SD)) ** 2)
        return np.asarray(taps / taps.sum())

    def predict(self, odometry: Array) -> None:
        """Motion."""
        dx, dy = odometry[:2] / self.field.resolution
        sd = NOISE["odometry_noise"] * math.hypot(dx, dy)
        for v in range(self.HEADINGS):
            c, s = math.cos(math.radians(10 * v)), math.sin(math.radians(10 * v))
            along_x, along_y = self._taps(c * dx - s * dy, sd), self._taps(s * dx + c * dy, sd)
            if self.separable:
                row = convolve1d(self.p[v], along_x, axis=1, mode="constant")
                self.p[v] = convolve1d(row, along_y, axis=0, mode="constant")
            else:
                self.p[v] = convolve(self.p[v], np.outer(along_y, along_x), mode="constant")
        self.p = convolve1d(self.p, self._taps(math.degrees(odometry[2]) / 10, TURN_DEG / 10), axis=0, mode="wrap")
        self.p *= self.free
        self.p /= self.p.sum()

    def match(self, step: Step) -> Float32:
        """Scores of a view."""
        middle = (len(step.rays.known) - 1) // 2
        at = middle + 10 * np.arange(-5, 6)
        at, k = at[step.rays.known[at]], np.flatnonzero(step.rays.known[at])
        if len(at) == 0:
            return np.ones_like(self.p)
        ranges = (step.rays.range[at] / self.field.resolution).astype(np.float32)[:, None, None]
        scores = np.stack([np.abs(self.around[v + k] - ranges).sum(axis=0) for v in range(self.HEADINGS)])
        return np.exp(scores * np.float32(-11.0 / len(at) / self.SCALE))

    def fuse(self, step: Step, scores: Float32 | None) -> Array:
        """Take in the scores; the pose."""
        self.p *= scores
        self.p /= self.p.sum()
        v, row, column = np.unravel_index(int(np.argmax(self.p)), self.p.shape)
        xy = self.field.origin + (np.array([column, row]) + 0.5) * self.field.resolution
        return np.array([*xy, math.radians(10 * v)])


class Histogram(Method):
    """galoc's matching and belief."""

    def __init__(self, localizer: Localizer) -> None:
        localizer.reset()
        self.localizer, self.belief, self.frames = localizer, localizer.belief, 0
        self.rows: NDArray[np.intp] | None = None

    def predict(self, odometry: Array) -> None:
        """Motion."""
        self.belief.predict(odometry)

    def match(self, step: Step) -> Float32 | None:
        """Scores of a view."""
        likelihood = self.localizer.likelihood
        if likelihood is None:
            return cosine_cells(self.localizer.field, step.rays, self.belief)
        if step.seen.blind:
            return None
        self.frames += 1
        everywhere = self.frames % FULL_EVERY == 0
        scores, self.rows = likely_cells(likelihood, step.seen, self.belief, everywhere=everywhere)
        return scores

    def fuse(self, step: Step, scores: Float32 | None) -> Array:
        """Take in the scores; the pose."""
        if self.localizer.likelihood is None:
            self.belief.update(scores, confidence(step.rays))
        elif scores is not None:
            self.belief.add(scores, LEAST_LOG_P, rows=self.rows, temper=FRAME_TEMPER, frame_floor=FRAME_FLOOR)
        pose = self.belief.peak()
        self.belief.entropy()
        self.belief.mass_near(pose, NEAR_M)
        return pose


class Particles(Method):
    """galoc's particle filter; evaluating the likelihood at the particles counts as matching."""

    def __init__(self, localizer: Localizer, count: int, seed: int) -> None:
        assert localizer.likelihood is not None
        self.particles = ParticleFilter(
            localizer.likelihood, count, rng=np.random.default_rng(seed),
            odometry_noise=NOISE["odometry_noise"], odometry_turn_rad=math.radians(TURN_DEG),
        )  # fmt: skip

    def predict(self, odometry: Array) -> None:
        """Motion."""
        self.particles.predict(odometry)

    def match(self, step: Step) -> None:
        """Weigh the particles by a view, and resample if due."""
        self.particles.update(step.seen)

    def fuse(self, step: Step, scores: Float32 | None) -> Array:
        """Take in the scores; the pose."""
        return self.particles.estimate()[0]


class Whole(Method):
    """Localizer.step as users call it: layout, matching, filter and tracker."""

    def __init__(self, localizer: Localizer) -> None:
        localizer.reset()
        self.localizer = localizer

    def timed(self, step: Step) -> tuple[dict[str, float], Array]:
        """CPU ms and the pose after a step; the parts cannot be told apart from outside."""
        start = time.process_time()
        estimate = self.localizer.step(step.wireframe, step.gravity, step.odometry)
        spent = 1e3 * (time.process_time() - start)
        return {"matching": 0.0, "filter": 0.0, "rest": spent}, estimate.pose


def methods(plan: Floorplan, camera: Camera, height: float, particles: int) -> dict[str, Callable[[], Method]]:
    """Every method on a plan, the plain one first; called, each starts a walk."""
    coarse = Localizer(plan, camera, config=config(plan, height, 36))
    default, whole = (Localizer(plan, camera, config=config(plan, height)) for _ in range(2))
    spread = {"diffusion_m": NOISE["odometry_noise"], "diffusion_rad": math.radians(TURN_DEG)}
    cosine = Localizer(plan, camera, scoring="cosine", config=config(plan, height, 36, **spread))
    return {
        "plain, 36 headings": lambda: Plain(default.field, separable=False),
        "plain, separable taps": lambda: Plain(default.field, separable=True),
        "cosine, 36": lambda: Histogram(cosine),
        "likelihood, 36": lambda: Histogram(coarse),
        f"likelihood, {default.belief.headings}": lambda: Histogram(default),
        f"{particles} particles": lambda: Particles(default, particles, 0),
        "Localizer.step": lambda: Whole(whole),
    }
