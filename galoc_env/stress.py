"""Stress tests of gauge solvers: sweep one factor at a time around a baseline, and judge the paper's statements."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from galoc import GalocError
from galoc_env import plugin, stress_claims
from galoc_env.homes import KINDS
from galoc_env.stress_scenes import Condition
from galoc_env.stress_scores import BUILT_IN, Solver, built_in, score, summary

SWEEPS: dict[str, tuple[str, tuple[Any, ...]]] = {
    "sigma": ("sigma_px", (1.0, 3.0, 5.0, 7.0, 10.0, 15.0)),
    "tilt": ("tilt_deg", (0.0, 0.5, 1.0, 2.0, 4.0)),
    "pairs": ("pairs", (3, 4, 6, 8, 10, 12)),
    "hfov": ("hfov_deg", (70.0, 80.0, 95.0, 108.0, 120.0)),
    "kind": ("kind", KINDS),
    "outliers": ("outlier_share", (0.0, 0.02, 0.05, 0.1, 0.2)),
    "missed": ("missed_share", (0.0, 0.1, 0.25, 0.5)),
    "one-sided": ("one_sided_share", (0.0, 0.2, 0.4, 0.6)),
    "height": ("camera_height_m", (0.6, 1.0, 1.4, 1.8)),
    "true-tilt": ("true_tilt_deg", (0.0, 3.0, 6.0, 10.0)),
    "noise-known": ("noise_known", (True, False)),
}
"""Sweeps over one factor: field of :class:`Condition` and its levels."""
GRID = "grid"
"""The one sweep over two factors: pixel noise and IMU error."""
GRID_LEVELS = ((3.0, 5.0, 7.0), (0.0, 1.0, 2.0))
CLAIMS = "claims"
"""The part that judges the paper's statements."""
NAMES = (*SWEEPS, GRID, CLAIMS)
"""What ``--sweeps`` takes."""


@dataclass(frozen=True, slots=True)
class Point:
    """One condition as a point of a sweep."""

    sweep: str
    level: str
    condition: Condition


def points(sweeps: Sequence[str], quick: bool) -> list[Point]:
    """Every point of the wanted sweeps.

    Args:
        sweeps: names; none means all.
        quick: three levels of each sweep instead of all.

    Raises:
        GalocError: unknown name.
    """
    unknown = [name for name in sweeps if name not in NAMES]
    if unknown:
        raise GalocError(f"--sweeps {' '.join(unknown)}", f"some of {', '.join(NAMES)}", "Fix the name.")
    out = []
    for name, (factor, levels) in SWEEPS.items():
        if not sweeps or name in sweeps:
            few = tuple(levels[i] for i in sorted({0, len(levels) // 2, len(levels) - 1}))
            for level in few if quick else levels:
                out.append(Point(name, _text(level), replace(Condition(), **{factor: level})))
    if not sweeps or GRID in sweeps:
        for sigma in GRID_LEVELS[0]:
            for tilt in GRID_LEVELS[1]:
                condition = replace(Condition(), sigma_px=sigma, tilt_deg=tilt)
                out.append(Point(GRID, f"{sigma:g} px, {tilt:g} deg", condition))
    return out


def _text(level: Any) -> str:
    return f"{level:g}" if isinstance(level, float) else str(level)


def load_solver(spec: str) -> tuple[Solver, str | None]:
    """A solver from ``package.module:function`` or ``file.py:function``, and the digest of its files.

    Raises:
        GalocError: no such module or function.
    """
    wanted = "module:function or file.py:function, called like galoc.pairs.solve_pairs without method"
    try:
        solver, module = plugin.load(spec)
    except plugin.LOADING as error:
        raise GalocError(f"--solver {spec} ({error})", wanted, "Check the path and the name.") from error
    if not callable(solver):
        raise GalocError(f"--solver {spec}, which is no function", wanted, "Name a function.")
    return solver, plugin.digest(module)


@dataclass(frozen=True, slots=True)
class Plan:
    """A whole run: which conditions, how many views, which solvers."""

    points: tuple[Point, ...]
    claims: tuple[str, ...]
    frames: int
    seed: int
    solver: str | None

    @classmethod
    def make(cls, sweeps: Sequence[str], frames: int, seed: int, solver: str | None, quick: bool) -> Plan:
        """Check the options and lay out the run."""
        if frames < 4 or seed < 0:
            raise GalocError(
                f"--frames {frames} --seed {seed}", "at least 4 views and a seed from 0", "Pass such numbers."
            )
        wanted = not sweeps or CLAIMS in sweeps
        claims = (*stress_claims.CLAIMS, "landscape") if wanted else ()
        return cls(tuple(points(sweeps, quick)), claims, frames, seed, solver)

    @property
    def conditions(self) -> list[Condition]:
        """Distinct conditions: sweeps share the baseline."""
        return list(dict.fromkeys(point.condition for point in self.points))

    @property
    def tasks(self) -> int:
        """Conditions and statements, numbered in this order."""
        return len(self.conditions) + len(self.claims)

    def job(self) -> dict[str, Any]:
        """What a partial result belongs to; an edited solver file makes another job."""
        digest = None if self.solver is None else load_solver(self.solver)[1]
        conditions = [asdict(c) for c in self.conditions]
        own = {"frames": self.frames, "seed": self.seed, "solver": self.solver, "solver_sha256": digest}
        return {**own, "conditions": conditions, "claims": list(self.claims)}

    def solvers(self) -> dict[str, Solver]:
        """Shipped solvers and the user's."""
        own = {} if self.solver is None else {self.solver.rpartition(":")[2]: load_solver(self.solver)[0]}
        if set(own) & set(BUILT_IN):
            raise GalocError(f"--solver {self.solver}", f"a name other than {BUILT_IN}", "Rename the function.")
        return {**built_in(), **own}

    def work(self, task: int, solvers: dict[str, Solver]) -> dict[str, Any]:
        """Result of one task."""
        conditions = self.conditions
        if task < len(conditions):
            scored = score(conditions[task], self.frames, self.seed, solvers)
            return {"seed": task, "solvers": {name: summary(s) for name, s in scored.items()}}
        name = self.claims[task - len(conditions)]
        if name == "landscape":
            return {"seed": task, "landscape": stress_claims.landscape(self.frames, self.seed)}
        return {"seed": task, "claim": stress_claims.judge(name, self.frames, self.seed)}


def run_tasks(plan: Plan, tasks: Sequence[int], jobs: int) -> Iterator[dict[str, Any]]:
    """Results of tasks, as they finish.

    Args:
        plan: the run.
        tasks: their numbers.
        jobs: processes; 1 runs here.
    """
    if jobs <= 1 or len(tasks) <= 1:
        solvers = plan.solvers()
        for task in tasks:
            yield plan.work(task, solvers)
        return
    import multiprocessing

    with multiprocessing.get_context("spawn").Pool(min(jobs, len(tasks)), _start_worker, (plan,)) as pool:
        yield from pool.imap_unordered(_work, tasks)


_worker: tuple[Plan, dict[str, Solver]] | None = None


def _start_worker(plan: Plan) -> None:
    """Give a worker process its solvers; Ctrl-C is the parent's business."""
    import signal

    global _worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _worker = plan, plan.solvers()


def _work(task: int) -> dict[str, Any]:
    assert _worker is not None
    plan, solvers = _worker
    return plan.work(task, solvers)


def collect(plan: Plan, done: dict[int, dict[str, Any]]) -> dict[str, Any]:
    """Settings, rows (one per point and solver), verdicts and the example landscape."""
    index = {condition: i for i, condition in enumerate(plan.conditions)}
    rows = []
    for point in plan.points:
        own = {f.name: getattr(point.condition, f.name) for f in fields(point.condition)}
        for name, numbers in done[index[point.condition]]["solvers"].items():
            # The condition's factor "pairs" and the mean number of pairs seen are two things.
            said = {"mean_pairs" if k == "pairs" else k: v for k, v in numbers.items()}
            rows.append({"sweep": point.sweep, "level": point.level, "solver": name, **own, **said})
    results = [done[i] for i in range(len(index), plan.tasks)]
    return {
        "settings": {**plan.job(), "baseline": asdict(Condition())},
        "rows": rows,
        "claims": [r["claim"] for r in results if "claim" in r],
        "landscape": next((r["landscape"] for r in results if "landscape" in r), None),
    }
