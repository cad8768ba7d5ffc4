"""Tables and figure of benchmarks/single_image.py."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from common import COLOURS, cell, column, draw_reliability, line_of
from numpy.typing import NDArray

from galoc.metrics import (
    MAX_HEADING_ERROR,
    RANK_THRESHOLDS,
    RECALL_THRESHOLDS_M,
    aurc,
    calibration_error,
    reliability,
    risk_coverage,
)
from galoc_env.stress_scores import interval, ratio_interval

Array = NDArray[np.float64]
Row = dict[str, Any]

CORRECT_M = 0.5
"""An answer is correct within this distance, m: what the confidence is about."""
THRESHOLDS = (*(f"{x:g}m" for x in RECALL_THRESHOLDS_M), "1m30deg")
COVERAGE = ("0", "0-20", "20-40", "40-60", "60-80", "80-100")
"""Bins of the share of rays that the paper's layout knows, %; 20-40 means above 20, up to 40."""
PAIRS = ("0", "1", "2", "3", "4+")
"""Bins of the number of fully seen corner pairs."""

SHOWN = ("oracle", "paper", "ml")
"""Methods in the panel of recall by coverage; the tables have all."""


def name_of(condition: Sequence[float]) -> str:
    """Condition in words."""
    return f"hFOV {condition[0]:g} deg, {condition[1]:g} px, IMU {condition[2]:g} deg"


def hits(error_m: Array, error_rad: Array) -> dict[str, Array]:
    """(F,) 0 or 1 of each threshold."""
    out = {f"{x:g}m": (error_m < x).astype(float) for x in RECALL_THRESHOLDS_M}
    return out | {"1m30deg": ((error_m < 1.0) & (error_rad < MAX_HEADING_ERROR)).astype(float)}


def bins(rows: Sequence[Row]) -> dict[str, NDArray[np.bool_]]:
    """(F,) membership of every bin of coverage and of corner pairs."""
    coverage, pairs = column(rows, "coverage"), column(rows, "corner_pairs")
    index = np.ceil(np.round(coverage, 9) * 5.0).astype(int)
    out = {f"coverage {name} %": index == i for i, name in enumerate(COVERAGE)}
    return out | {f"corner pairs {name}": np.minimum(pairs, 4) == i for i, name in enumerate(PAIRS)}


def summary(rows: Sequence[Row], methods: Sequence[str]) -> list[Row]:
    """Numbers of every condition and method; values with intervals are (value, low, high)."""
    out = []
    for condition in sorted({tuple(r["condition"]) for r in rows}, reverse=True):
        own = [r for r in rows if tuple(r["condition"]) == condition]
        plans = np.repeat([r["number"] for r in own], [len(r["coverage"]) for r in own])
        found = {m: _method(own, m, plans) for m in methods}
        row: Row = {"condition": list(condition), "frames": len(plans), "plans": len(own)}
        parts = bins(own)
        row["bins"] = {name: int(inside.sum()) for name, inside in parts.items()}
        for f in found.values():
            f["bins"] = {
                b: {t: interval(f["hits"][t][inside], plans[inside]) if inside.any() else (math.nan,) * 3
                    for t in THRESHOLDS}
                for b, inside in parts.items()
            }  # fmt: skip
        if "paper" in found:
            base = found["paper"]["hits"]
            for f in found.values():
                f["ratio_to_paper_0.1m"] = ratio_interval(f["hits"]["0.1m"], base["0.1m"], plans)
            if "ml" in found:
                row["ml_below_paper"] = _below(found["ml"]["hits"], base, plans, parts)
        for f in found.values():
            del f["hits"]
        out.append(row | {"methods": found})
    return out


def _method(rows: Sequence[Row], method: str, plans: NDArray[np.int64]) -> Row:
    error_m = column(rows, "methods", method, "error_m", missing=math.inf)
    confidence = column(rows, "methods", method, "confidence")
    ranks = column(rows, "methods", method, "rank")
    good = hits(error_m, column(rows, "methods", method, "error_rad"))
    correct = error_m < CORRECT_M
    risk = risk_coverage(confidence, correct)
    at = np.unique(np.linspace(0, len(correct) - 1, min(200, len(correct))).astype(int))
    return {
        "hits": good,
        "recall": {t: interval(v, plans) for t, v in good.items()},
        "rank": {f"{100 * x:g}%": interval((ranks < x).astype(float), plans) for x in RANK_THRESHOLDS},
        "abstained": float(np.mean(confidence == 0.0)),
        "aurc": aurc(confidence, correct),
        "ece": calibration_error(confidence, correct),
        "risk_coverage": [risk[0][at].tolist(), risk[1][at].tolist()],
        "reliability": [np.asarray(v, dtype=float).tolist() for v in reliability(confidence, correct)],
        "ms": float(np.median(column(rows, "methods", method, "ms"))),
    }


def _below(
    ml: dict[str, Array], paper: dict[str, Array], plans: NDArray[np.int64], parts: dict[str, NDArray[np.bool_]]
) -> list[Row]:
    """Thresholds and bins in which the default finds fewer than the paper's method, with the paired difference."""
    out = []
    for name, inside in {"all": np.ones(len(plans), bool), **parts}.items():
        for t in THRESHOLDS:
            difference = (ml[t] - paper[t])[inside]
            if len(difference) and difference.mean() < 0.0:
                out.append(
                    {
                        "bin": name,
                        "threshold": t,
                        "frames": len(difference),
                        "paper": float(paper[t][inside].mean()),
                        "ml": float(ml[t][inside].mean()),
                        "difference": interval(difference, plans[inside]),
                    }
                )
    return out


def report(result: Row, *, per_plan: bool) -> str:
    """The tables, for people."""
    lines: list[str] = []
    for s in result["summary"]:
        lines += ["", f"{name_of(s['condition'])}: {s['frames']} frames of {s['plans']} plans (95 % intervals)"]
        lines.append(f"{'recall / %':<12}" + "".join(f"{t:>21}" for t in THRESHOLDS) + f"{'0.1m / paper':>21}")
        for m, f in s["methods"].items():
            ratio = cell(f.get("ratio_to_paper_0.1m", (math.nan,) * 3), 1.0, 2)
            lines.append(f"{m:<12}" + "".join(f"{cell(f['recall'][t]):>21}" for t in THRESHOLDS) + f"{ratio:>21}")
        shares = [f"top {100 * x:g} %" for x in RANK_THRESHOLDS]
        lines.append(f"{'rank / %':<12}" + "".join(f"{t:>21}" for t in shares) + "   AURC    ECE  abstained  CPU ms")
        for m, f in s["methods"].items():
            ranks = "".join(f"{cell(v):>21}" for v in f["rank"].values())
            tail = f"{f['aurc']:7.3f}{f['ece']:7.3f}{100 * f['abstained']:9.1f} %{f['ms']:8.1f}"
            lines.append(f"{m:<12}{ranks}{tail}")
        lines.append(f"{'0.1 / 0.5 m recall / % in bin':<32}{'frames':>7}" + "".join(f"{m:>15}" for m in s["methods"]))
        for b, n in s["bins"].items():
            if n:
                own = [[f["bins"][b][t][0] for t in ("0.1m", "0.5m")] for f in s["methods"].values()]
                cells = "".join(f"{100 * a:>8.1f} /{100 * c:5.1f}" for a, c in own)
                lines.append(f"{b:<32}{n:>7}{cells}")
        if "ml_below_paper" in s:
            lines.append("ml below paper: " + ("" if s["ml_below_paper"] else "nowhere"))
        for b in s.get("ml_below_paper", []):
            low_high = cell(b["difference"])
            lines.append(
                f"  {b['bin']:<22}{b['threshold']:>8}: paper {100 * b['paper']:5.1f} %, ml {100 * b['ml']:5.1f} % of "
                f"{b['frames']} frames, difference {low_high}"
            )
    if per_plan:
        lines += _plan_rows(result)
    return "\n".join(lines)


def _plan_rows(result: Row) -> list[str]:
    methods = result["settings"]["methods"]
    lines = ["", f"{'recall 0.1 / 0.5 m / %':<28}{'condition':<34}{'cells':>7}" + "".join(f"{m:>15}" for m in methods)]
    for r in result["frames"]:
        cells = ""
        for m in methods:
            e = column([r], "methods", m, "error_m", missing=math.inf)
            cells += f"{100 * np.mean(e < 0.1):>8.1f} /{100 * np.mean(e < 0.5):5.1f}"
        lines.append(f"{r['plan'][:27]:<28}{name_of(r['condition']):<34}{r['positions']:>7}{cells}")
    return lines


def figure(result: Row) -> bytes:
    """A row of panels per condition: recall, risk over coverage, reliability, recall by the paper's coverage."""
    from matplotlib.figure import Figure

    rows = result["summary"]
    page = Figure(figsize=(17.0, 3.9 * len(rows)), layout="constrained")
    grid = np.asarray(page.subplots(len(rows), 4, squeeze=False, width_ratios=(1.5, 1.0, 1.0, 1.5)))
    for axes, s in zip(grid, rows, strict=True):
        _recall(axes[0], s)
        _confidence(axes[1], axes[2], s)
        _by_coverage(axes[3], s)
        for a in axes:
            a.spines[["top", "right"]].set_visible(False)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    page.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    out = io.BytesIO()
    page.savefig(out, dpi=100)
    return out.getvalue()


def _recall(axes: Any, s: Row) -> None:
    methods = s["methods"]
    width = 0.84 / len(methods)
    for k, (m, f) in enumerate(methods.items()):
        value, low, high = 100.0 * np.array([f["recall"][t] for t in THRESHOLDS], dtype=float).T
        x = np.arange(len(THRESHOLDS)) + width * (k - (len(methods) - 1) / 2)
        axes.bar(x, value, 0.9 * width, color=COLOURS[m], label=m)
        axes.vlines(x, low, high, color="black", lw=0.9)
    axes.set_xticks(range(len(THRESHOLDS)), [f"{x:g} m" for x in RECALL_THRESHOLDS_M] + ["1 m, 30°"])
    axes.set(ylim=(0, 100), ylabel="recall / %", title=f"{name_of(s['condition'])}: {s['frames']} frames")


def _confidence(curve: Any, diagram: Any, s: Row) -> None:
    for m, f in s["methods"].items():
        curve.plot(*(100.0 * np.array(f["risk_coverage"])), **line_of(m))
    curve.set(xlim=(0, 100), ylim=(0, 100), xlabel="most confident answers given / %", ylabel="of them wrong / %")
    curve.set_title(f"risk over coverage ({CORRECT_M:g} m)")
    # The oracle states no confidence: always 1.
    draw_reliability(diagram, {m: f for m, f in s["methods"].items() if m != "oracle"}, CORRECT_M)


def _by_coverage(axes: Any, s: Row) -> None:
    names = [f"coverage {b} %" for b in COVERAGE]
    x = np.arange(len(names))
    for m in (m for m in SHOWN if m in s["methods"]):
        for t, line, marker in (("0.1m", "-", "o"), ("0.5m", ":", "^")):
            value, low, high = 100.0 * np.array([s["methods"][m]["bins"][b][t] for b in names], dtype=float).T
            axes.plot(x, value, line, marker=marker, ms=4, **line_of(m))
            if m != "oracle" and t == "0.1m":
                axes.fill_between(x, low, high, color=COLOURS[m], alpha=0.12, lw=0)
    for label, line in (("0.1 m, 95 %", "-"), ("0.5 m", ":")):
        axes.plot([], [], line, color="black", label=label)
    axes.legend(fontsize=8, loc="lower right", framealpha=0.8, edgecolor="none")
    axes.set_xticks(x, [f"{b} %\nn={s['bins'][n]}" for b, n in zip(COVERAGE, names, strict=True)], fontsize=8)
    axes.set(ylim=(0, 102), ylabel="recall / %", xlabel="rays known to the paper's layout")
    axes.set_title("recall by what the paper's layout knows")
