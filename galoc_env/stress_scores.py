"""Running solvers over the views of a condition, and scoring what they recover."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc import GalocError
from galoc.camera import levelling
from galoc.pairs import PairSolution, solve_pairs
from galoc.rays import chain_rays
from galoc_env.stress_observe import Observation, observe
from galoc_env.stress_scenes import Condition, Scene, scenes

Array = NDArray[np.float64]
Solver = Callable[..., "PairSolution | Array"]
"""Called like :func:`galoc.pairs.solve_pairs` without ``method``; may return the points (B, N, 2) alone."""

BUILT_IN = ("paper", "paper-fixed", "tls", "ml")
"""Solvers that every run compares."""
FAILED = 0.2
"""A view whose mean ray error exceeds this share, or that was not recovered, has failed."""
MIN_RAYS = 5
"""Fewer recovered rays than this are no recovery."""
WORST = 1.0
"""A view's ray error counts as at most 100 %, so that no single broken view makes a mean."""
LEAST_IMU_DEG = 0.1
"""Solvers are told the IMU's true noise, but never less than this, degrees."""
DRAWS = 2000
"""Bootstrap resamples."""
Z_EDGES = np.linspace(-5.0, 5.0, 41)
"""Bins of the histogram of normalized ray errors; the outermost take what lies beyond."""


@dataclass(frozen=True, slots=True, eq=False)
class Scores:
    """F views scored for one solver."""

    plan: NDArray[np.int64]
    """(F,) home of each view."""
    pairs: NDArray[np.int64]
    """(F,) pairs given to the solver."""
    ray_error: Array
    """(F,) mean of |s r / r_true - 1| over recovered rays, s the median ratio; capped at 1, NaN: not recovered."""
    failed: NDArray[np.bool_]
    """(F,) ray error above 20 %, a point behind the camera, or not recovered."""
    recovered: Array
    """(F,) share of the true known rays that were recovered."""
    tilt: Array
    """(F,) angle between the solver's and the true gravity, rad."""
    imu: Array
    """(F,) the same for the measured gravity, rad."""
    z: list[Array]
    """F arrays: (log r - log r_true) / sd of each recovered ray in the solver's own unit; empty without covariance."""
    found: Array
    """(F,) share of the wrong pairs that were refused; NaN where none was wrong."""
    refused: Array
    """(F,) share of the right pairs that were refused."""
    seconds: Array
    """(F,) processor time of the solve."""


@dataclass(slots=True)
class _Lists:
    """Scores while they are collected."""

    rows: dict[int, dict[str, Any]] = field(default_factory=dict)

    def scores(self) -> Scores:
        order = [self.rows[i] for i in sorted(self.rows)]
        columns = {name: [row[name] for row in order] for name in Scores.__dataclass_fields__}
        return Scores(**{k: v if k == "z" else np.array(v) for k, v in columns.items()})  # type: ignore[arg-type]


def built_in(names: Sequence[str] = BUILT_IN) -> dict[str, Solver]:
    """Shipped solvers by name."""
    return {name: partial(solve_pairs, method=name) for name in names}


def score(condition: Condition, frames: int, seed: int, solvers: dict[str, Solver]) -> dict[str, Scores]:
    """Score solvers on the views of a condition; all see the same observations.

    Args:
        condition: the factors.
        frames: views.
        seed: of views and noise.
        solvers: by name.
    """
    views = scenes(condition, frames, seed)
    seen = [observe(scene, condition, i, seed) for i, scene in enumerate(views)]
    sizes: dict[int, list[int]] = {}
    for i, observation in enumerate(seen):
        sizes.setdefault(len(observation.ceiling), []).append(i)
    lists = {name: _Lists() for name in solvers}
    for members in sizes.values():
        batch = _batch([seen[i] for i in members], condition)
        for name, solver in solvers.items():
            solution, seconds = timed(name, solver, batch)
            for b, i in enumerate(members):
                row = _scored(views[i], seen[i], solution, b)
                lists[name].rows[i] = row | {"seconds": seconds / len(members)}
    return {name: found.scores() for name, found in lists.items()}


def _batch(seen: list[Observation], condition: Condition) -> dict[str, Any]:
    """Arguments of a solver for views with equally many pairs."""
    names = ("ceiling", "floor", "gravity", "ceiling_seen", "floor_seen")
    return {
        **{name: np.stack([getattr(o, name) for o in seen]) for name in names},
        "camera": condition.camera,
        "sigma_px": condition.sigma_px if condition.noise_known else None,
        "imu_sigma_rad": math.radians(max(condition.tilt_deg, LEAST_IMU_DEG)),
    }


_warm: dict[int, Solver] = {}


def timed(name: str, solver: Solver, batch: dict[str, Any]) -> tuple[PairSolution, float]:
    """A solver's answer and its processor time, s. The first call of each solver is repeated, so compiling is free."""
    if id(solver) not in _warm:
        solver(**batch)
        _warm[id(solver)] = solver
    start = time.process_time()
    answer = solver(**batch)
    seconds = time.process_time() - start
    return _solution(name, answer, batch), seconds


def _solution(name: str, answer: PairSolution | Array, batch: dict[str, Any]) -> PairSolution:
    """The answer as a PairSolution, checked."""
    frames, n = batch["ceiling"].shape[:2]
    if isinstance(answer, PairSolution):
        solution = answer
    else:
        try:
            points = np.asarray(answer, dtype=np.float64)
        except (TypeError, ValueError):
            points = np.empty(0)
        none = np.zeros((frames, n), dtype=bool)
        nothing = np.full((frames, 2), np.nan)
        solution = PairSolution(points, nothing, batch["gravity"], None, none, np.full(frames, np.nan))
    if solution.points.shape != (frames, n, 2):
        raise GalocError(
            f"an answer of solver {name!r} with points of shape {np.shape(solution.points)}",
            f"points of shape ({frames}, {n}, 2): (x right, z forward) of each pair, NaN where not recovered",
            "Return a PairSolution or such an array.",
        )
    return solution


def _scored(scene: Scene, seen: Observation, solution: PairSolution, b: int) -> dict[str, Any]:
    """One view of one solver."""
    points = np.asarray(solution.points[b], dtype=np.float64)
    covariance = None if solution.covariance is None else solution.covariance[b]
    log_range, variance, behind = rays_of(points, seen.walls, scene.azimuths, covariance)
    known = np.isfinite(scene.ranges) & np.isfinite(log_range)
    error = ray_error(log_range, scene.ranges)
    z = np.zeros(0)
    if covariance is not None and math.isfinite(error):
        unit = 0.5 * math.log(scene.heights[0] * scene.heights[1])
        off = log_range[known] - (np.log(scene.ranges[known]) - unit)
        z = off / np.sqrt(np.maximum(variance[known], 1e-18))
    wrong, flagged = seen.wrong, np.asarray(solution.flagged[b], dtype=bool)
    return {
        "plan": scene.plan,
        "pairs": len(points),
        "ray_error": error,
        "failed": behind or not error <= FAILED,
        "recovered": known.sum() / max(1, np.isfinite(scene.ranges).sum()),
        "tilt": _tilt_between(solution.gravity[b], scene.gravity),
        "imu": _tilt_between(seen.gravity, scene.gravity),
        "z": z,
        "found": float(flagged[wrong].mean()) if wrong.any() else math.nan,
        "refused": float(flagged[~wrong].mean()) if (~wrong).any() else math.nan,
    }


def rays_of(
    points: Array, walls: NDArray[np.int64], azimuths: Array, covariance: Array | None = None
) -> tuple[Array, Array, bool]:
    """Log ranges and variances of a recovered chain, and whether a point lies behind the camera (its walls are not)."""
    there = np.isfinite(points).all(axis=1)
    front = there & (np.where(there, points[:, 1], 0.0) > 1e-9)
    safe = np.where(front[:, None], points, 1.0)  # ends of walls that are left out
    log_range, variance = chain_rays(safe, walls[front[walls].all(axis=1)], azimuths, covariance)
    return log_range, variance, bool((there & ~front).any())


def ray_error(log_range: Array, ranges: Array) -> float:
    """Mean of |s r / r_true - 1| over the rays known in both, s the median ratio; at most 1, NaN below 5 rays."""
    known = np.isfinite(ranges) & np.isfinite(log_range)
    if known.sum() < MIN_RAYS:
        return math.nan
    ratio = np.exp(log_range[known]) / ranges[known]
    return min(WORST, float(np.mean(np.abs(ratio / np.median(ratio) - 1.0))))


def _tilt_between(a: Array, b: Array) -> float:
    """Angle between two gravity readings (roll, pitch), rad."""
    down = np.array([levelling(g)[1] for g in (a, b)])
    return float(math.atan2(np.linalg.norm(np.cross(down[0], down[1])), down[0] @ down[1]))


def share(yes: NDArray[np.bool_]) -> tuple[float, float, float]:
    """Share of yes with Wilson's 95 % interval: resampling views of which none failed shows no spread at all."""
    from scipy.stats import binomtest

    found = binomtest(int(np.sum(yes)), len(yes)).proportion_ci(0.95, method="wilson")
    return float(np.mean(yes)), float(found.low), float(found.high)


def summary(scores: Scores, seed: int = 0) -> dict[str, Any]:
    """Numbers of one condition and solver: means over views, intervals by bootstrap over homes (failures: Wilson)."""
    z = np.concatenate(scores.z) if scores.z else np.zeros(0)
    out: dict[str, Any] = {"views": len(scores.plan), "homes": len(np.unique(scores.plan))}
    out["pairs"] = float(np.mean(scores.pairs))
    out["ray_error"], out["ray_error_low"], out["ray_error_high"] = interval(scores.ray_error, scores.plan, seed=seed)
    out["failure"], out["failure_low"], out["failure_high"] = share(scores.failed)
    out["ray_error_median"] = _mean(scores.ray_error, np.nanmedian)
    out["recovered"] = float(np.mean(scores.recovered))
    out["tilt_error_deg"] = math.degrees(_mean(scores.tilt))
    out["imu_error_deg"] = math.degrees(_mean(scores.imu))
    out["within_2_sigma"] = float(np.mean(np.abs(z) < 2.0)) if len(z) else math.nan
    out["outliers_found"], out["right_pairs_refused"] = _mean(scores.found), _mean(scores.refused)
    out["ms_per_solve"] = 1e3 * float(np.median(scores.seconds))
    out["z_histogram"] = np.histogram(np.clip(z, -4.99, 4.99), Z_EDGES)[0].tolist() if len(z) else None
    return out


def _mean(values: Array, statistic: Callable[[Array], Any] = np.nanmean) -> float:
    """Statistic of the values that exist; NaN where none does."""
    return float(statistic(values)) if np.isfinite(values).any() else math.nan


def interval(values: Array, plans: NDArray[np.int64], *, seed: int = 0) -> tuple[float, float, float]:
    """Mean with its 95 % interval, by bootstrap over homes: views of one home are not independent.

    Args:
        values: (F,); NaN is left out.
        plans: (F,) home of each view.
        seed: of the resampling.
    """
    return ratio_interval(values, np.ones(len(values)), plans, seed=seed)


def ratio_interval(
    above: Array, below: Array, plans: NDArray[np.int64], *, seed: int = 0
) -> tuple[float, float, float]:
    """Ratio of two means over the same views, with its 95 % interval by bootstrap over homes.

    Args:
        above: (F,); a view that is NaN in either is left out.
        below: (F,).
        plans: (F,) home of each view.
        seed: of the resampling.
    """
    both = np.isfinite(above) & np.isfinite(below)
    index = np.unique(plans, return_inverse=True)[1].reshape(-1)
    sums = np.stack([np.bincount(index, np.where(both, v, 0.0)) for v in (above, below)])
    chosen = np.random.default_rng([seed, 31]).integers(sums.shape[1], size=(DRAWS, sums.shape[1]))
    with np.errstate(divide="ignore", invalid="ignore"):
        value = float(np.divide(*sums.sum(axis=1)))
        draws = np.divide(*sums[:, chosen].sum(axis=2))
    if not math.isfinite(value):
        return math.nan, math.nan, math.nan
    low, high = np.quantile(draws[np.isfinite(draws)], (0.025, 0.975))
    return value, float(low), float(high)
