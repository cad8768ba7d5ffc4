"""What the episodes of an evaluation come to: statistics with intervals, and the printed tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from galoc.metrics import HOLD, RECALL_THRESHOLDS_M, SUCCESS_THRESHOLDS_M
from galoc_env.intervals import Interval, Resampling

if TYPE_CHECKING:
    from galoc_env.evaluate import Evaluation, Job

Row = dict[str, Any]
Array = NDArray[np.float64]

HELD_M = (0.5, 0.3, 0.1)
"""Distances of the steps_to entries of a row, m."""
LISTED_EPISODES = 25
"""Runs up to this long are listed episode by episode."""
LISTED_FAILURES = 3
"""Failures that are quoted."""


@dataclass(frozen=True, slots=True)
class Line:
    """A statistic over the episodes, its 95 % interval and its unit; infinity: it was never reached."""

    value: float
    low: float
    high: float
    unit: str
    """"%" (the numbers are shares, 0..1), "steps", "m", "deg" or "" for a count."""

    @classmethod
    def of(cls, found: Interval, unit: str) -> Line:
        """A line from an interval."""
        return cls(found.value, found.low, found.high, unit)

    def cells(self) -> tuple[str, str, str]:
        """Value, low and high, for a table."""
        scale, digits = {"%": (100.0, 0), "steps": (1.0, 1), "deg": (1.0, 1)}.get(self.unit, (1.0, 2))
        cells = [f"{scale * v:.{digits}f}" if math.isfinite(v) else "-" for v in (self.value, self.low, self.high)]
        return cells[0], cells[1], cells[2]


def steps_to(rows: Sequence[Row], threshold_m: float) -> Array:
    """(E,) first step from which the error stays below the threshold; infinity: never."""
    return _numbers([row[f"steps_to_{threshold_m:g}m"] for row in rows])


def _numbers(values: Sequence[Any]) -> Array:
    """JSON's null was infinity."""
    return np.array([math.inf if v is None else v for v in values], dtype=np.float64)


def summarize(rows: Sequence[Row], steps: int) -> dict[str, Line]:
    """Statistics over episodes with 95 % intervals, by bootstrap over plans.

    Args:
        rows: of ``episodes.jsonl``.
        steps: actions per episode.
    """
    sample = Resampling([row["plan"] for row in rows])
    out: dict[str, Line] = {}
    held = steps_to(rows, 0.5)
    for x in HELD_M:
        out[f"steps to {x:g} m, held (median)"] = Line.of(sample.median(steps_to(rows, x)), "steps")
    out[f"steps to 0.5 m, at most {steps} (mean)"] = Line.of(sample.mean(np.minimum(held, steps)), "steps")
    for by in (10, 30):  # it must hold for ten steps, so later ones need longer walks
        if by + HOLD <= steps:
            out[f"held 0.5 m by step {by}"] = Line.of(sample.share(held <= by), "%")
    out["held 0.5 m at the end"] = Line.of(sample.share(np.isfinite(held)), "%")
    out["final error m (median)"] = Line.of(sample.median(_numbers([r["final_error_m"] for r in rows])), "m")
    turned = np.degrees([r["final_error_rad"] for r in rows])
    out["final heading error deg (median)"] = Line.of(sample.median(turned), "deg")
    for protocol in ("f3loc", "paper"):
        for x in SUCCESS_THRESHOLDS_M:
            values = [float(r["success"][protocol][f"{x:g}m"]) for r in rows]
            out[f"SR {x:g}m ({protocol})"] = Line.of(sample.share(values), "%")
    for key in [*(f"{x:g}m" for x in RECALL_THRESHOLDS_M), "1m30deg"]:
        out[f"recall {key}"] = Line.of(sample.mean([r["recall"][key] for r in rows]), "%")
    out["path m (mean)"] = Line.of(sample.mean([r["path_m"] for r in rows]), "m")
    out["turned deg (mean)"] = Line.of(sample.mean(np.degrees([r["turns_rad"] for r in rows])), "deg")
    out["collisions (mean)"] = Line.of(sample.mean([r["collisions"] for r in rows]), "")
    out["views without structure"] = Line.of(sample.mean([r["abstained"] for r in rows]), "%")
    out["rays known"] = Line.of(sample.mean([r["coverage"] for r in rows]), "%")
    out["failed episodes"] = Line.of(sample.share([float(r["failure"] is not None) for r in rows]), "%")
    return out


def title(job: Job, rows: Sequence[Row]) -> str:
    """What was evaluated on what, in one line."""
    plans = len({row["plan"] for row in rows})
    truth = " (sees the truth)" if job.sees_truth else ""
    where = "" if job.episode_set.name == "plan" else f" on {job.episode_set.name}"
    failed = sum(row["failure"] is not None for row in rows)
    lost = f", {failed} failed" if failed else ""
    return f"policy {job.game.policy}{truth}{where}: {_count(len(rows), 'episode')} in {_count(plans, 'plan')}{lost}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def table(found: Evaluation) -> str:
    """Episodes and summary, for people."""
    lines = [f"{title(found.job, found.rows)}, {found.job.game.steps} steps each", ""]
    if len(found.rows) <= LISTED_EPISODES:
        lines += [*_episodes(found.rows), ""]
    width = max(map(len, found.summary))
    over = "plans" if len({row["plan"] for row in found.rows}) > 1 else "walks"
    lines.append(f"{'':<{width}}  {'value':>8}   95 % interval over {over}")
    for name, line in found.summary.items():
        value, low, high = line.cells()
        percent = " %" if line.unit == "%" else ""
        lines.append(f"{name:<{width}}  {value + percent:>8}   {low} to {high}{percent}")
    cpu = [row["act_cpu_ms"] for row in found.timing if row["act_cpu_ms"] is not None]
    if cpu:
        lines.append(f"{'CPU ms per action (median)':<{width}}  {np.median(cpu):>8.2f}")
    if found.job.game.steps + 1 < HOLD:
        lines.append(f"Too short to count as held: that takes {HOLD} observations, so --steps {HOLD - 1} or more.")
    return "\n".join(lines + failures(found.rows))


def _episodes(rows: Sequence[Row]) -> list[str]:
    width = min(28, max(len("plan"), *(len(r["plan"]) for r in rows)))
    head = f"{'held 0.5 m':>10}  {'final m':>8}  {'<0.5 m':>7}  {'path m':>7}  {'bumps':>5}"
    lines = [f"{'seed':>6}  {'plan':<{width}}  {head}"]
    for r in rows:
        step = "failed" if r["failure"] else "-" if r["steps_to_0.5m"] is None else f"step {r['steps_to_0.5m']}"
        final = "-" if r["final_error_m"] is None else f"{r['final_error_m']:.2f}"
        share = f"{100 * r['recall']['0.5m']:.0f} %"
        lines.append(
            f"{r['seed']:>6}  {r['plan'][:width]:<{width}}  {step:>10}  {final:>8}  {share:>7}  {r['path_m']:>7.1f}"
            f"  {r['collisions']:>5}"
        )
    return lines


def failures(rows: Sequence[Row]) -> list[str]:
    """How many episodes failed, of which policy, and the first ones; nothing where none did."""
    failed = [row for row in rows if row["failure"] is not None]
    if not failed:
        return []
    policy, all_of = rows[0]["policy"], _count(len(rows), "episode")
    lines = ["", f"{len(failed)} of {all_of} failed and count as not localized; policy {policy}:"]
    for row in failed[:LISTED_FAILURES]:
        lines.append(f"  episode {row['episode']} ({row['plan']}): {row['failure']}")
    if len(failed) > LISTED_FAILURES:
        lines.append(f"  and {len(failed) - LISTED_FAILURES} more")
    return lines
