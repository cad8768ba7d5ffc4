"""Tables and figure of benchmarks/detector.py."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc.metrics import roc_auc
from galoc_env.stress_scores import interval

Array = NDArray[np.float64]
Row = dict[str, Any]

COLUMNS = (
    ("iou", "mask IoU", "{:.3f}"),
    ("visible_median", "visible deg", "{:.2f}"),
    ("visible_p90", "p90", "{:.2f}"),
    ("visible_missing", "missing %", "{:.1f}"),
    ("hidden_median", "hidden deg", "{:.2f}"),
    ("hidden_p90", "p90", "{:.1f}"),
    ("recall", "corner R", "{:.2f}"),
    ("precision", "corner P", "{:.2f}"),
    ("coverage", "coverage %", "{:.0f}"),
    ("abstained", "abstained %", "{:.0f}"),
    ("blind_auc", "blind AUC", "{:.3f}"),
    ("ms", "ms", "{:.1f}"),
)
"""Key, heading and format of the table's columns."""


def summary(rows: Sequence[Row], conditions: Sequence[str], methods: Sequence[str]) -> list[Row]:
    """Numbers of every condition and method."""
    out = []
    for condition in conditions:
        mine = [row for row in rows if row["condition"] == condition]
        blind = np.array([b for row in mine for b in row["blind"]], bool)
        for method in methods:
            frames = [frame for row in mine for frame in row["methods"][method]]
            home = np.array([i for i, row in enumerate(mine) for _ in row["blind"]])
            out.append({"condition": condition, "method": method, **_numbers(frames, blind, home)})
    return out


def _numbers(frames: list[Row], blind: NDArray[np.bool_], home: NDArray[np.int64]) -> Row:
    def joined(key: str) -> Array:
        return np.concatenate([np.array(f[key], float) for f in frames]) if frames else np.zeros(0)

    def of(key: str) -> Array:
        return np.array([f[key] for f in frames], float)

    def quantile(values: Array, q: float) -> float:
        return float(np.quantile(values, q)) if len(values) else math.nan

    visible, hidden = joined("visible"), joined("hidden")
    sighted = ~blind
    iou = of("iou")[sighted]
    found, wanted = of("corners_found").sum(), of("corners_wanted").sum()
    return {
        "frames": len(frames),
        "blind": float(blind.mean()),
        "iou": float(iou.mean()) if len(iou) else math.nan,
        "iou_interval": interval(iou, home[sighted])[1:] if len(iou) > 1 else (math.nan, math.nan),
        "iou_median": quantile(iou, 0.5),
        "visible_median": quantile(visible, 0.5),
        "visible_p90": quantile(visible, 0.9),
        "visible_missing": 100.0 * of("visible_missing").sum() / max(of("visible_missing").sum() + len(visible), 1),
        "hidden_median": quantile(hidden, 0.5),
        "hidden_p90": quantile(hidden, 0.9),
        "recall": float(of("corners_hit").sum() / wanted) if wanted else math.nan,
        "precision": float(of("corners_right").sum() / found) if found else math.nan,
        "coverage": 100.0 * float(of("coverage").mean()),
        "abstained": 100.0 * float(of("abstained").mean()),
        "abstained_blind": 100.0 * float(of("abstained")[blind].mean()) if blind.any() else math.nan,
        "blind_auc": roc_auc(of("seen"), sighted),
        "ms": float(np.median(of("ms"))),
    }


def report(result: Row) -> str:
    """The table as text."""
    rows = result["summary"]
    several = len({row["condition"] for row in rows}) > 1
    first = "condition" if several else "method"
    head = [first, *([] if not several or _one_method(rows) else ["method"]), *(title for _, title, _ in COLUMNS)]
    lines = [head]
    for row in rows:
        name = [row["condition"] if several else row["method"]]
        name += [row["method"]] if several and not _one_method(rows) else []
        lines.append(name + [_cell(row[key], text) for key, _, text in COLUMNS])
    widths = [max(len(line[i]) for line in lines) for i in range(len(head))]
    body = [
        "  ".join(cell.rjust(w) if i else cell.ljust(w) for i, (cell, w) in enumerate(zip(line, widths, strict=True)))
        for line in lines
    ]
    frames, blind = rows[0]["frames"], 100.0 * rows[0]["blind"]
    return "\n".join([*body, f"{frames} frames per row, {blind:.0f} % of them blind; IoU over the others."])


def _one_method(rows: list[Row]) -> bool:
    return len({row["method"] for row in rows}) == 1


def _cell(value: float | None, text: str) -> str:
    return "-" if value is None or math.isnan(value) else text.format(value)


def figure(result: Row) -> bytes:
    """Distribution of the boundary error and of the IoU, or the IoU by condition."""
    from matplotlib.figure import Figure

    rows = result["summary"]
    conditions = list(dict.fromkeys(row["condition"] for row in rows))
    page = Figure(figsize=(11.0, 4.2), layout="constrained")
    axes = page.subplots(1, 2)
    if len(conditions) == 1:
        _distributions(axes, result)
    else:
        _by_condition(axes, rows, conditions)
    buffer = io.BytesIO()
    page.savefig(buffer, format="png", dpi=110)
    return buffer.getvalue()


def _distributions(axes: Any, result: Row) -> None:
    for method in result["settings"]["methods"]:
        frames = [f for row in result["homes"] for f in row["methods"][method]]
        errors = np.sort(np.concatenate([np.array(f["visible"], float) for f in frames]))
        style = "--" if method.startswith("oracle") else "-"
        if len(errors):
            axes[0].plot(errors, np.linspace(0, 1, len(errors)), style, label=method)
        pairs = [(f, b) for row in result["homes"] for f, b in zip(row["methods"][method], row["blind"], strict=True)]
        iou = np.sort([f["iou"] for f, b in pairs if not b])
        axes[1].plot(iou, np.linspace(0, 1, len(iou)), style, label=method)
    axes[0].set(
        xscale="log", xlim=(0.03, 30), xlabel="error of a visible wall line, degrees", ylabel="share of columns"
    )
    axes[1].set(xlim=(0.5, 1), xlabel="mask IoU", ylabel="share of frames")
    for ax in axes:
        ax.grid(alpha=0.3)
        ax.legend(fontsize=8)


def _by_condition(axes: Any, rows: list[Row], conditions: list[str]) -> None:
    at = np.arange(len(conditions))[::-1]
    for ax, key, label in (
        (axes[0], "iou", "mask IoU, mean"),
        (axes[1], "visible_median", "visible wall line, degrees (median)"),
    ):
        for method in dict.fromkeys(row["method"] for row in rows):
            values = [row[key] for row in rows if row["method"] == method]
            ax.plot(values, at, "o", label=method)
        ax.set(yticks=at, yticklabels=conditions, xlabel=label)
        ax.grid(alpha=0.3)
        ax.legend(fontsize=8)
