"""Active localization: how soon a policy gets the camera localized, against others on the same worlds and starts.

    python benchmarks/active.py --policies stay random spin infogain --sets homes-test ambiguous --out runs/active

Each policy and set is an evaluation of its own in OUT/SET/POLICY (as `galoc-env evaluate` leaves it): a run that was
cut off goes on where it stopped, and what is done is not done again. Prints the table; writes it to OUT.md, and
OUT.json and OUT.png. A policy that cannot be made is named and left out.
"""

from __future__ import annotations

import io
import json
import math
import re
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray
from tqdm import tqdm

from galoc import GalocError
from galoc.formats.atomic import write_atomic
from galoc_env.benchmark_sets import make_set
from galoc_env.cli import INTERRUPTED
from galoc_env.evaluate import Evaluation, Job, evaluate, inspect_policy, make_job
from galoc_env.evaluate_figures import draw_success
from galoc_env.evaluate_report import failures, steps_to
from galoc_env.film import writable_folder
from galoc_env.intervals import Interval, Resampling
from galoc_env.partial import jsonable

Array = NDArray[np.float64]

COLOURS = ("#3d6fb4", "#c8553d", "#5a9e6f", "#8f6bb3", "#e3a35a", "#2c323c", "#33a6b8", "#8c6d31")
MARK = "*"
"""Beside policies that see the truth."""


@dataclass(frozen=True)
class Args:
    """Compare policies for active localization on fixed sets of worlds and starts."""

    policies: tuple[str, ...] = ("stay", "random", "spin", "explore", "infogain", "oracle", "ppo")
    """Names of installed policies, "module:Class" or "file.py:Class"."""
    sets: tuple[str, ...] = ("homes-test", "ambiguous")
    """Of homes-test, ambiguous and buildings."""
    plans: Path | None = None
    """Folder of plan files, for the set buildings."""
    against: str = "infogain"
    """Every other policy is compared with this one."""
    episodes: int = 200
    """Per policy and set."""
    steps: int = 60
    """Actions per episode."""
    workers: int = 1
    """Processes."""
    act_timeout: float = 60.0
    """Seconds that a policy has for one action."""
    hfov: float = 60.0
    """Horizontal field of view, degrees."""
    detector: str = "oracle"
    """oracle (true walls plus noise, nothing is drawn), onnx or lines."""
    detector_noise_px: float = 5.0
    """With the oracle: noise of each junction coordinate, px of a 640 px wide image."""
    furniture: float = 0.5
    """Furniture density, 0 to 1."""
    actions: str = "discrete"
    """discrete or continuous."""
    width: int = 640
    """Of the image, px; it is three quarters as high."""
    localizer: str = "galoc"
    """galoc, or your own "module:Class"."""
    out: Path = Path("runs/active")
    """Folder of the evaluations; OUT.md, OUT.json and OUT.png lie beside it."""

    def arguments(self) -> dict[str, Any]:
        """Of the environment."""
        return {
            "detector": self.detector, "detector_noise_px": self.detector_noise_px, "furniture": self.furniture,
            "hfov_deg": self.hfov, "width": self.width, "height": max(16, self.width * 3 // 4),
            "actions": self.actions, "localizer": self.localizer,
            "renderer": "none" if self.detector == "oracle" else "raster",
        }  # fmt: skip


def note(text: str) -> None:
    """Tell the user something beside the progress bar."""
    tqdm.write(f"active: {text}", file=sys.stderr)


def able(args: Args) -> tuple[list[str], dict[str, str]]:
    """The policies that can be made, and why the others cannot."""
    found, missing = [], {}
    for policy in dict.fromkeys(args.policies):
        try:
            inspect_policy(policy)
            found.append(policy)
        except GalocError as error:
            missing[policy] = str(error)
            note(f"{policy} is left out: {error}")
    if not found:
        raise GalocError(f"--policies {' '.join(args.policies)}", "one that can be made", "See the notes above.")
    return found, missing


def run(args: Args, job: Job) -> Evaluation:
    """One evaluation, in a folder of its own."""
    name = re.sub(r"[^\w.-]+", "_", job.game.policy)
    with tqdm(total=args.episodes, desc=f"{job.episode_set.name}, {job.game.policy}", unit="episode") as bar:

        def track(done: int, total: int) -> None:
            bar.update(done - bar.n)

        folder = args.out / job.episode_set.name / name
        return evaluate(job, args.episodes, args.workers, folder, note=note, track=track)


@dataclass(frozen=True, slots=True)
class Score:
    """One policy on one set."""

    policy: str
    sees_truth: bool
    median: Interval
    """Steps to 0.5 m, held."""
    capped: Interval
    """Mean of the same, never = the budget."""
    success: Interval
    """Share of episodes within 0.3 m over all of the last 10 observations."""
    path: Interval
    """m."""
    act_ms: float
    """Median CPU time of an action, ms."""
    failed: int
    median_ratio: Interval | None
    """Median of the compared policy over this one's, same episodes; None for itself, or where it is not there."""
    capped_ratio: Interval | None
    """The same of the capped means."""


def score(found: Evaluation, other: Evaluation | None) -> Score:
    """Score an evaluation, and ``other`` against it."""
    rows, steps = found.rows, found.job.game.steps
    sample = Resampling([row["plan"] for row in rows])
    held = steps_to(rows, 0.5)
    cpu = [t["act_cpu_ms"] for t in found.timing if t["act_cpu_ms"] is not None]
    ratios: list[Interval | None] = [None, None]
    if other is not None and other is not found:
        theirs = steps_to(other.rows, 0.5)
        ratios = [
            sample.ratio(theirs, held, Resampling.medians),
            sample.ratio(np.minimum(theirs, steps), np.minimum(held, steps), Resampling.means),
        ]
    return Score(
        found.job.game.policy,
        found.job.sees_truth,
        sample.median(held),
        sample.mean(np.minimum(held, steps)),
        sample.share([float(row["success"]["f3loc"]["0.3m"]) for row in rows]),
        sample.mean([row["path_m"] for row in rows]),
        float(np.median(cpu)) if cpu else math.nan,
        sum(row["failure"] is not None for row in rows),
        ratios[0],
        ratios[1],
    )


def cell(found: Interval | None, digits: int, scale: float = 1.0) -> str:
    """A value and its interval."""
    if found is None:
        return ""
    value, low, high = (
        f"{scale * v:.{digits}f}" if math.isfinite(v) else "-" for v in (found.value, found.low, found.high)
    )
    return value if value == "-" else f"{value} [{low}, {high}]"


def table(args: Args, scores: dict[str, list[Score]]) -> str:
    """The leaderboard in Markdown, one table per set."""
    lines = []
    for name, ranked in scores.items():
        head = [
            "policy", "steps to 0.5 m held, median", f"capped at {args.steps}, mean", "SR 0.3 m / %", "path / m",
            "CPU ms / action", f"{args.against} / policy, median", f"{args.against} / policy, capped mean",
        ]  # fmt: skip
        body = []
        for s in ranked:
            failed = f" ({s.failed} failed)" if s.failed else ""
            body.append([
                s.policy + (f" {MARK}" if s.sees_truth else "") + failed, cell(s.median, 0), cell(s.capped, 1),
                cell(s.success, 0, 100.0), cell(s.path, 1), f"{s.act_ms:.2f}" if math.isfinite(s.act_ms) else "-",
                cell(s.median_ratio, 2), cell(s.capped_ratio, 2),
            ])  # fmt: skip
        widths = [max(len(row[i]) for row in [head, *body]) for i in range(len(head))]
        rule = ["-" * w for w in widths]
        rows = [" | ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) for row in (head, rule, *body)]
        lines += [f"### {name}", "", *(f"| {row} |" for row in rows), ""]
    lines.append(
        f"[95 % intervals] by bootstrap over plans; -: more than half never got there, or "
        f"nothing to divide by. {MARK} sees the truth."
    )
    return "\n".join(lines)


def draw(args: Args, found: dict[str, list[Evaluation]]) -> bytes:
    """PNG: success curves of all policies, one panel per set."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.6 * len(found), 5.4), dpi=110, layout="constrained")
    for i, (name, evaluations) in enumerate(found.items()):
        axes = figure.add_subplot(1, len(found), 1 + i)
        for k, e in enumerate(evaluations):
            policy, truth = e.job.game.policy, e.job.sees_truth
            line = {"color": COLOURS[k % len(COLOURS)], "ls": "--" if truth else "-"}
            label = f"{policy} (sees the truth)" if truth else policy
            draw_success(axes, e.rows, e.job.game.steps, 0.5, line, label, band=policy == args.against)
        axes.set_title(f"{name}: {args.episodes} episodes", fontsize=11, loc="left")
        if i == 0:
            axes.set_ylabel("episodes within 0.5 m, to stay / %")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    out = io.BytesIO()
    figure.savefig(out)
    return out.getvalue()


def main() -> None:
    """Entry point."""
    args = tyro.cli(Args)
    if args.episodes < 1 or args.workers < 1:
        raise GalocError(f"--episodes {args.episodes} --workers {args.workers}", "at least 1", "Pass 1 or more.")
    if not args.sets:
        raise GalocError("--sets without a name", "at least one set", "Name one.")
    names = list(dict.fromkeys(args.sets))
    sets = [make_set(name, args.plans if name == "buildings" else None, 0, note) for name in names]
    policies, missing = able(args)
    jobs = [make_job(p, args.arguments(), args.steps, s, args.act_timeout) for s in sets for p in policies]
    writable_folder(args.out.parent)
    found: dict[str, list[Evaluation]] = {}
    for job in jobs:
        found.setdefault(job.episode_set.name, []).append(run(args, job))
    scores = {}
    for name, evaluations in found.items():
        against = next((e for e in evaluations if e.job.game.policy == args.against), None)
        scores[name] = [score(e, against) for e in evaluations]
    left_out = [f"not run: {policy}: {reason}" for policy, reason in missing.items()]
    text = "\n".join([table(args, scores), *left_out])
    result = {
        "settings": {**asdict(args), "plans": str(args.plans) if args.plans else None, "out": None},
        "scores": {name: [asdict(s) for s in ranked] for name, ranked in scores.items()},
        "missing": missing,
    }
    write_atomic(Path(f"{args.out}.json"), (json.dumps(jsonable(result), indent=1) + "\n").encode())
    write_atomic(Path(f"{args.out}.md"), (text + "\n").encode())
    write_atomic(Path(f"{args.out}.png"), draw(args, found))
    broken = [line for evaluations in found.values() for e in evaluations for line in failures(e.rows)]
    print("\n".join([text, *broken]))
    print(f"written  {args.out}.md, {args.out}.json, {args.out}.png and the folders in {args.out}")


if __name__ == "__main__":
    try:
        main()
    except GalocError as error:
        sys.exit(f"active: {error}")
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
