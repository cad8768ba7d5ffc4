"""Tables and figure of benchmarks/pixels.py."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from common import cell, column
from numpy.typing import NDArray

from galoc.metrics import (
    HOLD,
    RECALL_THRESHOLDS_M,
    SUCCESS_THRESHOLDS_M,
    aurc,
    calibration_error,
    recall,
    reliability,
    success,
)
from galoc_env.stress_scores import interval, share

Array = NDArray[np.float64]
Row = dict[str, Any]

CORRECT_M = 0.5
"""An answer is correct within this distance, m."""
COLOURS = {"onnx": "#3d6fb4", "onnx+heights": "#8f6bb3", "lines": "#b59a3c", "oracle5": "#7f7f7f", "paper7": "#c8553d"}


def summary(rows: Sequence[Row], methods: Sequence[str], mode: str) -> dict[str, Row]:
    """Numbers of every method; values with intervals are (value, low, high)."""
    out: dict[str, Row] = {}
    for method in methods:
        error = column(rows, "methods", method, "error_m", missing=np.inf)
        turn = column(rows, "methods", method, "error_rad", missing=np.pi)
        confidence = column(rows, "methods", method, "confidence")
        homes = np.repeat(np.arange(len(rows)), [len(row["methods"][method]["error_m"]) for row in rows])
        correct = error < CORRECT_M
        found: Row = {
            "recall": {f"{x:g}m": interval((error < x).astype(float), homes) for x in RECALL_THRESHOLDS_M},
            "recall_1m30deg": recall(error, turn)["1m30deg"],
            "aurc": aurc(confidence, correct),
            "ece": calibration_error(confidence, correct),
            "reliability": [np.asarray(v, dtype=float).tolist() for v in reliability(confidence, correct)],
            "coverage": float(np.mean(column(rows, "methods", method, "coverage"))),
            "ms": float(np.median(column(rows, "methods", method, "ms"))),
        }
        if mode == "walks":
            found |= _walks([np.array(row["methods"][method]["error_m"], dtype=float) for row in rows])
        out[method] = found
    return out


def _walks(errors: list[Array]) -> Row:
    """Success of whole walks under both protocols; NaN (JSON's infinity) is far."""
    errors = [np.where(np.isfinite(e), e, np.inf) for e in errors]
    rates = {
        p: {f"{x:g}m": share(np.array([success(e, x, p) for e in errors], dtype=float)) for x in SUCCESS_THRESHOLDS_M}
        for p in ("paper", "f3loc")
    }
    quartiles = np.quantile(np.stack(errors), (0.25, 0.5, 0.75), axis=0, method="lower")
    return {"success": rates, "final_m": [float(e[-1]) for e in errors], "error_quartiles": quartiles.tolist()}


def report(result: Row) -> str:
    """The tables, for people."""
    settings, found = result["settings"], result["summary"]
    homes = len(result["homes"])
    lines = [f"{settings['mode']}: {homes} homes, {settings['frames']} frames each (95 % intervals)"]
    names = [f"{x:g}m" for x in RECALL_THRESHOLDS_M]
    lines.append(f"{'recall / %':<16}" + "".join(f"{n:>20}" for n in names) + "   AURC    ECE  cover  CPU ms")
    for method, f in found.items():
        cells = "".join(f"{cell(f['recall'][n]):>20}" for n in names)
        lines.append(f"{method:<16}{cells}{f['aurc']:7.3f}{f['ece']:7.3f}{100 * f['coverage']:7.0f}{f['ms']:8.1f}")
    if settings["mode"] == "walks":
        for p in ("paper", "f3loc"):
            lines += ["", f"{f'SR / %, {p}':<16}" + "".join(f"{f'{x:g} m':>20}" for x in SUCCESS_THRESHOLDS_M)]
            for method, f in found.items():
                rates = [f["success"][p][f"{x:g}m"] for x in SUCCESS_THRESHOLDS_M]
                lines.append(f"{method:<16}" + "".join(f"{cell(r, digits=0):>20}" for r in rates))
        lines.append(f"paper: {HOLD} frames in a row within; f3loc: the last {HOLD}.")
    return "\n".join(lines)


def figure(result: Row) -> bytes:
    """Recall by distance (or error over time), reliability."""
    from matplotlib.figure import Figure

    found, walks = result["summary"], result["settings"]["mode"] == "walks"
    page = Figure(figsize=(13.0, 4.2), layout="constrained")
    axes = page.subplots(1, 3)
    for method, f in found.items():
        colour = COLOURS[method]
        errors = np.sort(column(result["homes"], "methods", method, "error_m", missing=np.inf))
        axes[0].plot(errors, 100 * np.linspace(0, 1, len(errors)), color=colour, label=method)
        count, stated, right = np.array(f["reliability"], dtype=float)
        full = count > 0
        axes[1].scatter(stated[full], right[full], 8 + 250 * count[full] / count.sum(), color=colour, alpha=0.7, lw=0)
        if walks:
            low, middle, high = np.clip(np.array(f["error_quartiles"], dtype=float), 1e-3, 1e2)
            axes[2].plot(middle, color=colour)
            axes[2].fill_between(np.arange(len(middle)), low, high, color=colour, alpha=0.15, lw=0)
        else:
            coverage = np.sort(column(result["homes"], "methods", method, "coverage"))
            axes[2].plot(100 * coverage, 100 * np.linspace(0, 1, len(coverage)), color=colour)
    axes[0].set(xscale="log", xlim=(0.01, 20), ylim=(0, 100), xlabel="position error / m", ylabel="frames / %")
    axes[0].legend(frameon=False, fontsize=9)
    axes[1].plot([0, 1], [0, 1], "--", color="0.7", lw=1, zorder=0)
    axes[1].set(xlabel="stated confidence (dot area: share of frames)", ylabel=f"share within {CORRECT_M:g} m")
    if walks:
        axes[2].set(yscale="log", xlabel="frame", ylabel="position error / m", title="median and quartiles")
    else:
        axes[2].set(xlabel="known rays / %", ylabel="frames / %")
    for a in axes:
        a.grid(alpha=0.25)
        a.spines[["top", "right"]].set_visible(False)
    out = io.BytesIO()
    page.savefig(out, dpi=100)
    return out.getvalue()
