"""Tables and figure of benchmarks/sequences.py."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from common import COLOURS, cell, column, draw_reliability, line_of
from numpy.typing import NDArray

from galoc.metrics import (
    HOLD,
    RECALL_THRESHOLDS_M,
    SUCCESS_THRESHOLDS_M,
    aurc,
    calibration_error,
    recall,
    reliability,
    steps_to_converge,
    success,
)
from galoc_env.stress_scores import interval, share

Array = NDArray[np.float64]
Row = dict[str, Any]

LENGTHS = (15, 25, 50, 100)
"""Frames of a sequence at which success is reported (paper, Sec. IV)."""
PROTOCOLS = ("paper", "f3loc")
CORRECT_M = 0.5
"""An answer is correct, and a walk has converged, within this distance, m."""
DRAWS = 2000
"""Bootstrap resamples."""
CURVES_M = ((0.1, "-"), (0.5, ":"))
"""Success thresholds that are drawn, m."""


def summary(rows: Sequence[Row], methods: Sequence[str], conditions: Sequence[str]) -> dict[str, dict[str, Row]]:
    """Numbers by condition and method; values with intervals are (value, low, high)."""
    homes = np.array([r["home"] for r in rows])
    return {c: {m: _method(rows, c, m, homes) for m in methods} for c in conditions}


def errors(rows: Sequence[Row], condition: str, method: str, key: str = "error_m") -> Array:
    """(W, T) error of every walk and frame; infinite without an estimate."""
    return np.stack([column([r], "conditions", condition, method, key, missing=math.inf) for r in rows])


def _method(rows: Sequence[Row], condition: str, method: str, homes: NDArray[np.int64]) -> Row:
    e = errors(rows, condition, method)
    steps = e.shape[1]
    confidence = column(rows, "conditions", condition, method, "confidence")
    correct = e.ravel() < CORRECT_M
    each = [recall(*pair) for pair in zip(e, errors(rows, condition, method, "error_rad"), strict=True)]
    converged = np.array([_or_never(steps_to_converge(walk, CORRECT_M)) for walk in e])
    curves = {
        f"{x:g}m": [float(np.mean([success(w[:t], x, "paper") for w in e])) for t in range(HOLD, steps + 1)]
        for x, _ in CURVES_M
    }
    return {
        "success": {
            p: {
                f"{x:g}m": {str(t): _share([success(w[:t], x, p) for w in e], homes) for t in LENGTHS if t <= steps}
                for x in SUCCESS_THRESHOLDS_M
            }
            for p in PROTOCOLS
        },
        "success_curve": curves,
        "recall": {k: interval(np.array([r[k] for r in each]), homes) for k in each[0]},
        "converged": _share(list(np.isfinite(converged)), homes),
        "steps_to_converge": converged.tolist(),
        "median_step": _median(converged, homes),
        "median_final_m": _median(e[:, -1], homes),
        "error_quartiles": np.quantile(e, (0.25, 0.5, 0.75), axis=0, method="lower").tolist(),
        "aurc": aurc(confidence, correct),
        "ece": calibration_error(confidence, correct),
        "reliability": [np.asarray(v, dtype=float).tolist() for v in reliability(confidence, correct)],
        "ms": float(np.median(column(rows, "conditions", condition, method, "ms"))),
    }


def _or_never(step: int | None) -> float:
    return math.inf if step is None else float(step)


def _share(yes: Sequence[bool], homes: NDArray[np.int64]) -> tuple[float, float, float]:
    """Share of walks: Wilson's interval for one walk per home (20 of 20 must not look certain), else bootstrap."""
    flags = np.array(yes, dtype=float)
    return share(flags) if len(np.unique(homes)) == len(homes) else interval(flags, homes)


def _median(values: Array, homes: NDArray[np.int64]) -> tuple[float, float, float]:
    """Lower median, infinite values included, with its 95 % interval by bootstrap over homes."""
    names = np.unique(homes)
    groups = [values[homes == h] for h in names]
    rng = np.random.default_rng(0)  # the interval of the same walks is always the same
    middle: Callable[[Array], float] = lambda v: float(np.sort(v)[(len(v) - 1) // 2])  # noqa: E731
    chosen = rng.integers(len(names), size=(DRAWS, len(names)))
    draws = np.sort([middle(np.concatenate([groups[i] for i in pick])) for pick in chosen])
    return middle(values), float(draws[int(0.025 * DRAWS)]), float(draws[int(0.975 * DRAWS)])


def title_of(condition: str, noise: Sequence[float]) -> str:
    """Odometry condition in words."""
    return "exact odometry" if not any(noise) else f"odometry {100 * noise[0]:g} %, {noise[1]:g} deg/step"


def report(result: Row) -> str:
    """The tables, for people."""
    settings = result["settings"]
    lines: list[str] = []
    for condition, found in result["summary"].items():
        title = title_of(condition, settings["conditions"][condition])
        lines += ["", f"{title}: {len(result['walks'])} walks of {settings['steps']} frames (95 % intervals)"]
        for p in PROTOCOLS:
            lines.append(f"{f'SR / %, {p}':<18}" + "".join(f"{f'{x:g} m':>21}" for x in SUCCESS_THRESHOLDS_M))
            for m, f in found.items():
                for t in (t for t in LENGTHS if t <= settings["steps"]):
                    rates = [f["success"][p][f"{x:g}m"][str(t)] for x in SUCCESS_THRESHOLDS_M]
                    cells = "".join(f"{cell(rate, digits=0):>21}" for rate in rates)
                    lines.append(f"{m:<10}T={t:<6}{cells}")
        names = [*(f"{x:g}m" for x in RECALL_THRESHOLDS_M), "1m30deg"]
        lines.append(f"{'recall / %':<18}" + "".join(f"{n:>21}" for n in names))
        lines += [f"{m:<18}" + "".join(f"{cell(f['recall'][n]):>21}" for n in names) for m, f in found.items()]
        lines.append(f"{'':<18}{'converged / %':>21}{'median step':>21}{'median final / m':>21}   AURC    ECE  CPU ms")
        for m, f in found.items():
            cells = f"{cell(f['converged'], digits=0):>21}{cell(f['median_step'], 1.0, 0):>21}"
            cells += f"{cell(f['median_final_m'], 1.0, 3):>21}"
            lines.append(f"{m:<18}{cells}{f['aurc']:7.3f}{f['ece']:7.3f}{f['ms']:8.1f}")
    return "\n".join(lines)


def figure(result: Row) -> bytes:
    """A row of panels per condition: success over T, error over time, reliability, convergence."""
    from matplotlib.figure import Figure

    settings, walks = result["settings"], len(result["walks"])
    found = result["summary"]
    page = Figure(figsize=(17.0, 3.7 * len(found) + 0.4), layout="constrained")
    grid = np.asarray(page.subplots(len(found), 4, squeeze=False, width_ratios=(1.2, 1.2, 1.0, 1.0)))
    for axes, (condition, methods) in zip(grid, found.items(), strict=True):
        for m, f in methods.items():
            _success(axes[0], f, m)
            _errors(axes[1], f, m)
            steps = np.sort(np.array(f["steps_to_converge"], dtype=float))
            reached = np.arange(1, len(steps) + 1)[np.isfinite(steps)] / len(steps)
            x = np.concatenate([[0.0], steps[np.isfinite(steps)], [settings["steps"]]])
            y = np.concatenate([[0.0], reached, reached[-1:] if len(reached) else [0.0]])
            axes[3].step(x, 100 * y, where="post", **line_of(m))
        draw_reliability(axes[2], methods, CORRECT_M)
        _dress(axes, settings, f"{title_of(condition, settings['conditions'][condition])}: {walks} walks")
    handles, labels = grid[0, 1].get_legend_handles_labels()
    page.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    out = io.BytesIO()
    page.savefig(out, dpi=100)
    return out.getvalue()


def _dress(axes: Any, settings: Row, title: str) -> None:
    """Scales, labels and titles of a row."""
    last = settings["steps"]
    axes[0].set(xlim=(HOLD, last), ylim=(0, 102), xlabel="T / frames", ylabel="success rate / %", title=title)
    for x, line in CURVES_M:
        axes[0].plot([], [], line, color="black", label=f"within {x:g} m")
    axes[0].legend(fontsize=8, loc="lower right", frameon=False)
    axes[1].set(xlim=(0, last - 1), yscale="log", xlabel="frame", ylabel="position error / m")
    axes[1].set_title("median and quartiles")
    for x in (0.1, 0.5):
        axes[1].axhline(x, color="0.75", lw=0.8, ls="--", zorder=0)
    axes[3].set(xlim=(0, last), ylim=(0, 102), xlabel="frame", ylabel="walks converged / %")
    axes[3].set_title(f"converged: within {CORRECT_M:g} m to the end")
    for a in axes:
        a.spines[["top", "right"]].set_visible(False)


def _success(axes: Any, f: Row, method: str) -> None:
    for x, line in CURVES_M:
        curve = 100.0 * np.array(f["success_curve"][f"{x:g}m"])
        axes.plot(HOLD + np.arange(len(curve)), curve, line, **line_of(method))


def _errors(axes: Any, f: Row, method: str) -> None:
    low, middle, high = np.clip(np.array(f["error_quartiles"], dtype=float), 1e-3, 1e2)
    axes.plot(middle, label=method, **line_of(method))
    axes.fill_between(np.arange(len(middle)), low, high, color=COLOURS[method], alpha=0.15, lw=0)
