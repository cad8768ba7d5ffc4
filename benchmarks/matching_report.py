"""Tables and figure of the matching benchmark."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

Row = dict[str, Any]

COLOURS = {"cosine": "#c8553d", "likelihood": "#3d6fb4"}
TICKS_M2 = (20, 50, 100, 200, 500, 1000, 2000, 5000)


def summary(rows: list[Row]) -> list[Row]:
    """For each plan, step and scoring: equality, times and ratios."""
    out = []
    for row in rows:
        for scoring, build in row["build"].items():
            mine = [c for c in row["cases"] if c["scoring"] == scoring]
            cpu, wall, cold, dense = (
                np.array([c[k] for c in mine]) for k in ("cpu_s", "wall_s", "cold_s", "reference_s")
            )
            out.append(
                {
                    "plan": row["plan"], "step": row["step"], "scoring": scoring, "area_m2": row["area_m2"],
                    "positions": row["positions"], "whole": row["whole"], "frames": len(mine),
                    "same": sum(c["same"] for c in mine), "equal": sum(c["equal"] for c in mine),
                    "certified": sum(c["certified"] for c in mine), "least_lead": min(c["lead"] for c in mine),
                    "ms": {"median": 1e3 * np.median(cpu), "mean": 1e3 * cpu.mean(), "worst": 1e3 * cpu.max()},
                    "wall_ms": {"median": 1e3 * np.median(wall), "mean": 1e3 * wall.mean()},
                    "cold_ms": {"median": 1e3 * np.median(cold), "mean": 1e3 * cold.mean(), "worst": 1e3 * cold.max()},
                    "reference_ms": {"median": 1e3 * np.median(dense), "mean": 1e3 * dense.mean()},
                    "ratio": {
                        "median": np.median(dense / cpu), "of_means": dense.mean() / cpu.mean(),
                        "worst": np.min(dense / cpu), "cold_median": np.median(dense / cold),
                        "cold_of_means": dense.mean() / cold.mean(), "cold_worst": np.min(dense / cold),
                    },
                    "build": build,
                }
            )  # fmt: skip
    return out


def report(result: Row) -> str:
    """The tables."""
    rows = result["summary"]
    head = f"{'plan':<20}{'step':>6}{'m2':>7}  {'scoring':<11}"
    lines = [
        "", f"{head}{'frames':>7}{'same':>6}{'equal':>7}{'certified':>11}  least lead over the dense best",
    ]  # fmt: skip
    for r in rows:
        same = r["same"] if r["whole"] else "-"
        note = "" if r["whole"] else "  (over a part of the poses)"
        counts = f"{r['frames']:>7}{same:>6}{r['equal']:>7}{r['certified']:>11}"
        lines.append(f"{_head(r)}{counts}  {r['least_lead']:.1e}{note}")
    total = {k: sum(r[k] for r in rows) for k in ("frames", "equal", "certified")}
    whole = sum(r["frames"] for r in rows if r["whole"])
    lines.append(f"{'all':<46}{total['frames']:>7}{'':>6}{total['equal']:>7}{total['certified']:>11}")
    lines += [
        f"{whole} of them against every pose",
        "",
        "CPU ms of the search, profiles cast before (warm) or not (cold);",
    ]
    lines.append(f"ratio: CPU time of the dense reference over the search's; threads: {result['settings']['threads']}")
    lines.append(
        f"{head}{'dense':>8}{'median':>8}{'mean':>7}{'worst':>8}{'wall':>7}"
        f"{'ratio: median':>15}{'of means':>10}{'worst':>8}{'cold: median':>14}{'mean':>7}{'worst':>8}{'ratio':>7}"
    )
    for r in rows:
        t, c, q = r["ms"], r["cold_ms"], r["ratio"]
        lines.append(
            f"{_head(r)}{r['reference_ms']['mean']:>8.0f}{t['median']:>8.1f}{t['mean']:>7.1f}{t['worst']:>8.0f}"
            f"{r['wall_ms']['median']:>7.1f}{q['median']:>15.0f}{q['of_means']:>10.0f}{q['worst']:>8.1f}"
            f"{c['median']:>14.1f}{c['mean']:>7.0f}{c['worst']:>8.0f}{q['cold_median']:>7.0f}"
        )
    lines += ["", f"{head}{'build: CPU s':>14}{'wall s':>8}{'MB':>7}{'levels':>8}"]
    for r in rows:
        b = r["build"]
        lines.append(f"{_head(r)}{b['cpu_s']:>14.1f}{b['wall_s']:>8.1f}{b['bytes'] / 1e6:>7.0f}{b['levels']:>8}")
    return "\n".join(lines)


def _head(r: Row) -> str:
    return f"{r['plan'][:19]:<20}{r['step']:>6g}{r['area_m2']:>7.0f}  {r['scoring']:<11}"


def figure(result: Row) -> bytes:
    """Cost over area, cost over step, and how the ratios are distributed."""
    from matplotlib.figure import Figure

    page = Figure(figsize=(14.0, 4.4), layout="constrained")
    area, step, share = page.subplots(1, 3)
    finest = result["settings"]["steps"][0]
    rows = result["summary"]
    _lines(area, [r for r in rows if r["step"] == finest], "area_m2")
    area.set(xlabel="area of the plan / m²", ylabel="CPU time of a frame / ms", title=f"{finest:g} m × 1°")
    first = rows[0]["plan"]
    _lines(step, [r for r in rows if r["plan"] == first], "step")
    step.set(xlabel="step of the lattice / m", ylabel="CPU time of a frame / ms", title=first)
    for scoring, colour in COLOURS.items():
        found = [
            c["reference_s"] / c["cpu_s"]
            for row in result["rows"] if row["step"] == finest
            for c in row["cases"] if c["scoring"] == scoring
        ]  # fmt: skip
        if found:
            share.plot(
                np.sort(found), np.linspace(0, 100, len(found)), color=colour, label=f"{scoring}, n={len(found)}"
            )
    share.axvline(1.0, color="0.7", lw=1, ls="--")
    share.set(xscale="log", ylim=(0, 101), xlabel="dense reference over search, CPU time", ylabel="frames below / %")
    share.set_title(f"all frames at {finest:g} m")
    share.legend(frameon=False)
    for axes in (area, step, share):
        axes.spines[["top", "right"]].set_visible(False)
    handles, labels = area.get_legend_handles_labels()
    page.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    out = io.BytesIO()
    page.savefig(out, dpi=110)
    return out.getvalue()


def _lines(axes: Any, rows: list[Row], key: str) -> None:
    """Median, mean and worst frame of the search, and the dense reference (dashed)."""
    for scoring, colour in COLOURS.items():
        mine = sorted((r for r in rows if r["scoring"] == scoring), key=lambda r: r[key])
        if not mine:
            continue
        x = [r[key] for r in mine]
        axes.plot(x, [r["reference_ms"]["mean"] for r in mine], "--", color=colour, lw=1.2, label=f"{scoring}, dense")
        axes.plot(
            x,
            [r["ms"]["median"] for r in mine],
            "-o" if key == "step" else "o",
            color=colour,
            ms=4,
            label=f"{scoring}, median",
        )
        axes.plot(x, [r["ms"]["mean"] for r in mine], "x", color=colour, ms=6, label="mean")
        axes.plot(x, [r["ms"]["worst"] for r in mine], "^", color=colour, ms=5, mfc="none", label="worst")
    axes.set(xscale="log", yscale="log")
    values = sorted({r[key] for r in rows})
    ticks = values if key == "step" else [a for a in TICKS_M2 if 0.8 * values[0] < a < 1.25 * values[-1]]
    axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axes.set_xticks([], minor=True)
    axes.grid(True, which="major", alpha=0.25, lw=0.6)
