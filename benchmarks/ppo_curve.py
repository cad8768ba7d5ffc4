"""What training buys: learning curves over seeds, and the trained policies against spin and random on test homes.

    for s in 0 1 2; do python -m galoc_agents.train_ppo --minutes 10 --seed $s --out runs/ppo$s; done
    python benchmarks/ppo_curve.py --runs runs/ppo0 runs/ppo1 runs/ppo2 --out docs/figures/ppo_curve

All policies play the same episodes: one per test home, with the full localizer, 60 steps. Counted is the first
observation from which on the position stays within 0.5 m to the end; 60 where there is none. Prints tables; writes
OUT.json and OUT.png. A cut run goes on.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from common import resumable, write
from galoc_agents.ppo import Ppo
from galoc_agents.random_walk import RandomWalk
from galoc_agents.spin import Spin
from galoc_agents.train_ppo import COLUMNS, PROGRESS
from galoc_agents.trial import STEPS, steps_to_localize
from numpy.typing import NDArray

from galoc import GalocError
from galoc_env.env import FloorplanEnv
from galoc_env.intervals import Interval, Resampling

Array = NDArray[np.float64]

COLOURS = {"profile": "#3d6fb4", "canvas": "#8c6d31", "headings": "#5a9e6f", "spin": "#c8553d", "random": "#7f7f7f"}
SEEN = {"profile": "PPO, sees walls around it", "canvas": "the belief's canvas", "headings": "the same with headings"}


@dataclass(frozen=True, slots=True)
class Args:
    """Draw learning curves and score the trained policies."""

    runs: tuple[Path, ...] = (Path("runs/ppo0"), Path("runs/ppo1"), Path("runs/ppo2"))
    """Folders that galoc_agents.train_ppo filled. Those that see "profile" are scored."""
    homes: int = 200
    """Test homes, one episode each."""
    steps: int = STEPS
    """Actions per episode."""
    first: int = 0
    """Number of the first of them."""
    sort: Literal["rooms", "ambiguous"] = "rooms"
    """Sort of the homes."""
    hfov_deg: float = 60.0
    """Horizontal field of view, degrees."""
    jobs: int = 2
    """Processes."""
    out: Path = Path("runs/ppo_curve")
    """Output path without suffix."""


def curve(folder: Path) -> dict[str, Any]:
    """Name, what is seen, and the learning curve of one run."""
    try:
        kept = json.loads((folder / PROGRESS).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        cure = "Train it: python -m galoc_agents.train_ppo --out FOLDER."
        raise GalocError(f"--runs {folder.name} without {PROGRESS}", "a folder of a training run", cure) from error
    rows = np.array(kept["rows"], dtype=np.float64).reshape(-1, len(COLUMNS))
    return {"name": folder.name, "sees": kept["job"]["sees"], "minutes": kept["seconds"] / 60.0, "rows": rows.tolist()}


def play(task: tuple[int, str, float, int, tuple[str, ...]]) -> dict[str, Any]:
    """Steps until localized in one test home, for every policy."""
    seed, sort, hfov_deg, steps, models = task
    makers: dict[str, Callable[[], Any]] = {"spin": Spin, "random": RandomWalk}
    makers |= {Path(model).parent.name: partial(Ppo, model) for model in models}
    env = FloorplanEnv(split="test", detector="oracle", renderer="none", homes=sort, hfov_deg=hfov_deg)
    try:
        return {name: steps_to_localize(env, make(), seed, steps) for name, make in makers.items()}
    finally:
        env.close()


def summary(rows: list[dict[str, Any]], names: list[str]) -> dict[str, Any]:
    """Mean and median per policy, and the paired difference from spin, with 95 % intervals over homes."""
    found = {name: np.array([row[name] for row in rows], dtype=np.float64) for name in names}
    over = Resampling([str(i) for i in range(len(rows))])
    out: dict[str, Any] = {}
    for name, steps in found.items():
        parts: dict[str, Interval] = {"mean": over.mean(steps), "median": over.median(steps)}
        parts["minus_spin"] = over.mean(steps - found["spin"])
        out[name] = {key: asdict(value) for key, value in parts.items()}
        out[name]["steps"] = steps.astype(int).tolist()
    return out


def report(scores: dict[str, Any], curves: list[dict[str, Any]]) -> str:
    """Tables for the terminal."""
    lines = [f"{'':14s}{'mean steps':>12s}   95 %          {'median':>6s}   minus spin, 95 %"]
    for name, s in scores.items():
        mean, minus = s["mean"], s["minus_spin"]
        lines.append(
            f"{name:14s}{mean['value']:12.2f}   {mean['low']:5.2f} to {mean['high']:5.2f}{s['median']['value']:9.0f}"
            f"   {minus['value']:+.2f} ({minus['low']:+.2f} to {minus['high']:+.2f})"
        )
    lines.append(f"\n{'run':14s}{'sees':>10s}{'minutes':>9s}{'steps':>8s}   localized after: first, last 4 rollouts")
    for c in curves:
        values = np.array(c["rows"])
        first, last = values[0, 3], values[-4:, 3].mean()
        lines.append(
            f"{c['name']:14s}{c['sees']:>10s}{c['minutes']:9.1f}{int(values[-1, 0]):8d}   {first:.2f}, {last:.2f}"
        )
    return "\n".join(lines)


def picture(scores: dict[str, Any], curves: list[dict[str, Any]], steps: int) -> bytes:
    """Learning curves, shaded from the worst to the best seed, beside the share localized by each step."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.2, 1.0))
    for sees in dict.fromkeys(c["sees"] for c in curves):
        group = [np.array(c["rows"]) for c in curves if c["sees"] == sees]
        length = min(len(rows) for rows in group)
        values = np.stack([rows[:length, 3] for rows in group])
        taken = group[0][:length, 0] / 1000.0
        label = f"{SEEN[sees]}, {len(group)} seed{'s' * (len(group) > 1)}"
        left.plot(taken, values.mean(axis=0), color=COLOURS[sees], label=label)
        left.fill_between(taken, values.min(axis=0), values.max(axis=0), color=COLOURS[sees], alpha=0.2, lw=0)
    for name in ("random", "spin"):
        left.axhline(
            scores[name]["mean"]["value"], color=COLOURS[name], ls="--", lw=1.2, label=f"{name}, on test homes"
        )
    left.set(xlabel="training steps, thousands", ylabel="steps until localized (mean)", ylim=(0.0, None))
    left.legend(frameon=False, fontsize=8)
    for name, s in scores.items():
        taken = np.array(s["steps"])
        share = [100.0 * np.mean(taken <= n) for n in range(steps)]
        colour = COLOURS.get(name, COLOURS["profile"])
        label = f"{name}: mean {s['mean']['value']:.2f}"
        right.step(range(steps), share, where="post", color=colour, label=label, alpha=0.9 if name in COLOURS else 0.7)
    right.set(xlabel="step", ylabel="episodes localized for good, %", xlim=(0, min(20, steps)), ylim=(0, 101))
    right.xaxis.set_major_locator(MaxNLocator(integer=True))
    right.legend(frameon=False, fontsize=8, loc="lower right")
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=130)
    return png.getvalue()


def main() -> None:
    """Command line."""
    args = tyro.cli(Args, description=__doc__)
    try:
        if args.homes < 1 or args.steps < 1 or args.first < 0:
            raise GalocError(f"--homes {args.homes} --steps {args.steps}", "1 or more", "Raise them.")
        curves = [curve(folder) for folder in args.runs]
        models = tuple(
            str(folder / "ppo.onnx") for folder, c in zip(args.runs, curves, strict=True) if c["sees"] == "profile"
        )
        for model in models:
            Ppo(model)  # a missing one is refused before anybody walks
        seeds = range(args.first, args.first + args.homes)
        tasks = [(seed, args.sort, args.hfov_deg, args.steps, models) for seed in seeds]
        job = {"first": args.first, "sort": args.sort, "hfov_deg": args.hfov_deg, "steps": args.steps, "models": models}
        rows = resumable(play, tasks, job=job, out=args.out, jobs=args.jobs, unit="home")
    except GalocError as error:
        raise SystemExit(f"error: {error}") from None
    scores = summary(rows, ["random", "spin", *(Path(model).parent.name for model in models)])
    print(report(scores, curves))
    write(args.out, {"scores": scores, "curves": curves}, picture(scores, curves, args.steps))


if __name__ == "__main__":
    main()
