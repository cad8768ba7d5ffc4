"""Rollouts of the scripted walker, and what they say about the localizer."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from galoc import GalocError
from galoc.metrics import HOLD, RECALL_THRESHOLDS_M, SUCCESS_THRESHOLDS_M, recall, steps_to_converge, success
from galoc_env import detection
from galoc_env.env import FloorplanEnv
from galoc_env.patrol import Patrol
from galoc_env.settings import DEFAULT_DETECTOR

BOOTSTRAP_DRAWS = 2000
"""Resamples of the episodes behind each interval."""


@dataclass(frozen=True, slots=True)
class Step:
    """One observation of a rollout."""

    pose: tuple[float, float, float]
    """True x, y m, heading rad."""
    estimate: tuple[float, float, float] | None
    """Estimated pose; None where there was nothing to report."""
    error_m: float
    """Position error, m; infinity without an estimate."""
    error_rad: float
    """Heading error, rad; pi without an estimate."""
    entropy: float
    """Of the belief, nats; NaN without one."""
    coverage: float
    """Share of rays known, 0..1."""
    abstained: bool
    """This image showed no usable structure."""
    collided: bool
    """The walker touched something on the way here."""


@dataclass(frozen=True, slots=True)
class Rollout:
    """One walk; ``steps[0]`` is the observation of the reset."""

    seed: int
    plan: str
    steps: tuple[Step, ...]

    @property
    def errors_m(self) -> list[float]:
        """Position error per observation, m."""
        return [s.error_m for s in self.steps]

    def metrics(self) -> dict[str, Any]:
        """Recall, success under both protocols, convergence and final error of this walk."""
        errors = self.errors_m
        return {
            "seed": self.seed,
            "plan": self.plan,
            "steps_to_converge": steps_to_converge(errors),
            "final_error_m": errors[-1],
            "recall": recall(errors, [s.error_rad for s in self.steps]),
            "success": {
                p: {f"{x:g}m": success(errors, x, p) for x in SUCCESS_THRESHOLDS_M} for p in ("paper", "f3loc")
            },
            "coverage": float(np.mean([s.coverage for s in self.steps])),
            "abstained": float(np.mean([s.abstained for s in self.steps])),
            "collisions": sum(s.collided for s in self.steps),
        }


def rollout(
    env: FloorplanEnv,
    seed: int,
    steps: int,
    *,
    options: dict[str, Any] | None = None,
    on_step: Callable[[FloorplanEnv], None] | None = None,
) -> Rollout:
    """Let the scripted walker walk one episode.

    Args:
        env: unwrapped, discrete actions, with a localizer.
        seed: of the environment and of the walker.
        steps: actions; the rollout has one observation more.
        options: of the reset.
        on_step: called after the reset and after every step.
    """
    if env.settings.actions != "discrete" or env.settings.localizer == "none":
        raise GalocError("an environment without localizer or discrete actions", "both", "Change its arguments.")
    _, info = env.reset(seed=seed, options=options)
    assert env.world is not None
    walker = Patrol(env.world, np.random.default_rng([seed, 1]))
    taken = [_step(info)]
    if on_step:
        on_step(env)
    for _ in range(steps):
        _, _, _, _, info = env.step(walker.action(info["pose"]))
        taken.append(_step(info))
        if on_step:
            on_step(env)
    return Rollout(seed, env.world.plan.name, tuple(taken))


def _step(info: dict[str, Any]) -> Step:
    estimate = info["estimate"]
    x, y, heading = (float(v) for v in info["pose"])
    found = tuple(float(v) for v in estimate) if math.isfinite(info["error_m"]) else None
    return Step(
        (x, y, heading),
        found,  # type: ignore[arg-type]
        float(info["error_m"]),
        float(info["error_rad"]),
        float(info.get("entropy", math.nan)),
        float(info["coverage"]),
        bool(info["abstained"]),
        bool(info["collided"]),
    )


def run_seeds(arguments: dict[str, Any], seeds: Sequence[int], steps: int, jobs: int) -> Iterator[dict[str, Any]]:
    """Metrics of the walks of these seeds, as they finish.

    Args:
        arguments: of :class:`FloorplanEnv`.
        seeds: one walk each.
        steps: actions per walk.
        jobs: processes; 1 runs here.

    Raises:
        GalocError: bad arguments, or the detector's model was replaced before all processes had opened it.
    """
    if jobs <= 1 or len(seeds) <= 1:
        env = FloorplanEnv(**arguments)
        try:
            for seed in seeds:
                yield rollout(env, seed, steps).metrics()
        finally:
            env.close()
        return
    import multiprocessing

    model = detection.model(arguments.get("detector", DEFAULT_DETECTOR))
    with multiprocessing.get_context("spawn").Pool(min(jobs, len(seeds)), _start_worker, (arguments,)) as pool:
        yield from pool.imap_unordered(_work, [(seed, steps, model) for seed in seeds])


_worker_env: FloorplanEnv | None = None


def _start_worker(arguments: dict[str, Any]) -> None:
    """Give a worker process its environment; Ctrl-C is the parent's business."""
    import signal

    global _worker_env
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _worker_env = FloorplanEnv(**arguments)


def _work(task: tuple[int, int, str | None]) -> dict[str, Any]:
    assert _worker_env is not None
    seed, steps, model = task
    found = detection.model(_worker_env.settings.detector)
    if found != model:
        cure = "Its file was replaced meanwhile: start the command again."
        raise GalocError(f"a worker with model {found}", f"model {model}, as the others have", cure)
    return rollout(_worker_env, seed, steps).metrics()


def summarize(episodes: Sequence[dict[str, Any]], steps: int) -> dict[str, Any]:
    """Means over episodes with 95 % intervals: bootstrap over episodes, Wilson for shares of yes/no walks.

    Returns:
        name -> {"value", "low", "high"}; values are None where nothing converged.
    """
    rows: dict[str, list[float]] = {}
    converged = [math.inf if e["steps_to_converge"] is None else e["steps_to_converge"] for e in episodes]
    for by in (10, 30):  # convergence must hold for ten steps, so later ones need longer walks
        if by + HOLD <= steps:
            rows[f"converged by step {by}"] = [float(c <= by) for c in converged]
    rows["converged at all"] = [float(math.isfinite(c)) for c in converged]
    for key in [*(f"{x:g}m" for x in RECALL_THRESHOLDS_M), "1m30deg"]:
        rows[f"recall {key}"] = [e["recall"][key] for e in episodes]
    for protocol in ("paper", "f3loc"):
        for x in SUCCESS_THRESHOLDS_M:
            rows[f"SR {x:g}m ({protocol})"] = [float(e["success"][protocol][f"{x:g}m"]) for e in episodes]
    out: dict[str, Any] = {
        "steps to converge (median)": _interval(converged, _median),
        "final error m (median)": _interval([e["final_error_m"] for e in episodes], _median),
    }
    out |= {name: _share([float(v) for v in values]) for name, values in rows.items()}
    return out


def _median(values: Any) -> float:
    """Lower median: stays a number of the sample, infinity included."""
    return float(np.sort(values)[(len(values) - 1) // 2])


def _interval(values: Sequence[float], statistic: Callable[[Any], float]) -> dict[str, float | None]:
    sample = np.asarray(values, dtype=np.float64)
    rng = np.random.default_rng(0)  # the interval of the same episodes is always the same
    draws = [statistic(sample[rng.integers(len(sample), size=len(sample))]) for _ in range(BOOTSTRAP_DRAWS)]
    low, high = (float(np.sort(draws)[int(q * (BOOTSTRAP_DRAWS - 1))]) for q in (0.025, 0.975))
    return {"value": _finite(statistic(sample)), "low": _finite(low), "high": _finite(high)}


def _share(values: Sequence[float]) -> dict[str, float | None]:
    """Mean with its interval; shares of yes/no walks get Wilson's, since resampling 20 of 20 shows no spread at all."""
    if not set(values) <= {0.0, 1.0}:
        return _interval(values, lambda v: float(np.mean(v)))
    from scipy.stats import binomtest

    found = binomtest(int(sum(values)), len(values)).proportion_ci(0.95, method="wilson")
    return {"value": float(np.mean(values)), "low": float(found.low), "high": float(found.high)}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def jsonable(value: Any) -> Any:
    """The same data with None for numbers that JSON does not have (NaN, infinity)."""
    if isinstance(value, dict):
        return {str(k): jsonable(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [jsonable(v) for v in value]
    if isinstance(value, float | np.floating):
        return _finite(float(value))
    if isinstance(value, np.integer | np.bool_):
        return value.item()
    return value


def table(episodes: Sequence[dict[str, Any]], summary: dict[str, Any]) -> str:
    """Walks and summary, for people."""
    lines = [f"{'seed':>6}  {'plan':<22} {'converged':>9}  {'final m':>8}  {'<0.5 m':>7}  {'known':>6}  {'bumps':>5}"]
    for e in episodes:
        step = "-" if e["steps_to_converge"] is None else f"step {e['steps_to_converge']}"
        final = f"{e['final_error_m']:.2f}" if math.isfinite(e["final_error_m"]) else "-"
        shares = f"{100 * e['recall']['0.5m']:5.0f} %  {100 * e['coverage']:4.0f} %"
        lines.append(f"{e['seed']:>6}  {e['plan'][:22]:<22} {step:>9}  {final:>8}  {shares}  {e['collisions']:>5}")
    lines += ["", f"{'over ' + str(len(episodes)) + ' walks':<30} {'value':>8}   95 % interval"]
    for name, row in summary.items():
        percent = not name.endswith("(median)")
        cells = [
            "-" if row[k] is None else f"{100 * row[k]:.0f} %" if percent else f"{row[k]:.2f}"
            for k in ("value", "low", "high")
        ]
        lines.append(f"{name:<30} {cells[0]:>8}   {cells[1]} to {cells[2]}")
    return "\n".join(lines)


def steps_table(walk: Rollout) -> list[dict[str, Any]]:
    """The steps of a walk as JSON rows."""
    return [{"step": i, **jsonable(asdict(step))} for i, step in enumerate(walk.steps)]


class Partial:
    """Episodes finished so far, one JSON line each, beside the output; the first line says what they belong to."""

    def __init__(self, path: Path, job: dict[str, Any]) -> None:
        self.path, self._job = path, jsonable(job)
        self.dropped: str | None = None
        """What :meth:`load` did not take over, for people; None: nothing was there, or all of it."""

    def load(self) -> dict[int, dict[str, Any]]:
        """Finished episodes by seed; none if the file is of another job. A torn last line is dropped."""
        try:
            lines = self.path.read_text(encoding="utf-8").splitlines()
        except FileNotFoundError:
            lines = []
        rows = []
        for line in lines:
            try:
                rows.append(json.loads(line))
            except json.JSONDecodeError:
                break
        if not rows or rows[0] != self._job:
            self.dropped = self._difference(rows) if len(rows) > 1 else None
            rows = [self._job]
        # Written anew: the torn line must not swallow the next one.
        from galoc.formats.atomic import write_atomic

        write_atomic(self.path, ("".join(json.dumps(row) + "\n" for row in rows)).encode())
        return {row["seed"]: _revived(row) for row in rows[1:]}

    def _difference(self, rows: list[dict[str, Any]]) -> str:
        """How another job differs from this one, and what is lost with it."""
        theirs, ours = _flat(rows[0]), _flat(self._job)
        keys = [key for key in {**theirs, **ours} if theirs.get(key) != ours.get(key)]
        parts = ", ".join(f"{key} {theirs.get(key)} there, {ours.get(key)} now" for key in keys)
        return f"{self.path.name} holds {len(rows) - 1} finished of another run ({parts}); starting anew"

    def add(self, episode: dict[str, Any]) -> None:
        """Append a finished episode."""
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(jsonable(episode)) + "\n")

    def remove(self) -> None:
        """The result is written: the partial has done its work."""
        self.path.unlink(missing_ok=True)


def _flat(job: Any) -> dict[str, Any]:
    """The settings of a job by name, whatever group they are in."""
    out: dict[str, Any] = {}
    for key, value in job.items() if isinstance(job, dict) else ():
        out.update(value if isinstance(value, dict) else {key: value})
    return out


def _revived(row: dict[str, Any]) -> dict[str, Any]:
    """An episode read back: an error that JSON could not hold was infinite."""
    if "final_error_m" not in row:
        return row
    return {**row, "final_error_m": math.inf if row["final_error_m"] is None else row["final_error_m"]}
