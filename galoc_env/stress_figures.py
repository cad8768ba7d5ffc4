"""The page of figures of a stress run."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from galoc_env.stress import SWEEPS
from galoc_env.stress_scores import Z_EDGES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = {"paper": "#c8553d", "paper-fixed": "#e3a35a", "tls": "#5a9e6f", "ml": "#3d6fb4"}
"""One colour per shipped solver; the user's is purple."""
OWN = "#7b3fa0"
MARKS = {"paper": "o", "paper-fixed": "s", "tls": "^", "ml": "o"}
LABELS = {
    "sigma": "pixel noise / px",
    "tilt": "IMU error / deg (sd per angle)",
    "pairs": "pairs in view",
    "hfov": "horizontal field of view / deg",
    "kind": "homes",
    "outliers": "wrong junctions (30 to 80 px) / %",
    "missed": "corners overlooked / %",
    "one-sided": "one-sided pairs / %",
    "height": "camera height / m",
    "true-tilt": "true tilt / deg (sd per angle)",
    "noise-known": "solver told the pixel noise",
}
PERCENT = {"outliers", "missed", "one-sided"}
COLUMNS = 6


def page(result: dict[str, Any]) -> bytes:
    """PNG of all figures.

    Args:
        result: of :func:`galoc_env.stress.collect`, NaN as None.
    """
    from matplotlib.figure import Figure

    sweeps = [name for name in SWEEPS if any(row["sweep"] == name for row in result["rows"])]
    lines = -(-len(sweeps) // COLUMNS)
    figure = Figure(figsize=(19.0, 3.4 + 3.0 * (2 * lines + (1 if sweeps else 0))), layout="constrained")
    heights = [1.0] + [0.9] * (2 * lines + (1 if sweeps else 0))
    grid = figure.add_gridspec(len(heights), COLUMNS, height_ratios=heights)
    _first_row(figure, grid, result)
    for i, name in enumerate(sweeps):
        row, column = 1 + i // COLUMNS, i % COLUMNS
        error = figure.add_subplot(grid[row, column])
        _sweep(error, result, name, "ray_error", "ray error / %", bars=True)
        failure = figure.add_subplot(grid[row + lines, column])
        _sweep(failure, result, name, "failure", "failed views / %", bars=True)
    if sweeps:
        _last_row(figure, grid, len(heights) - 1, result)
    _legend(figure, result)
    out = io.BytesIO()
    figure.savefig(out, dpi=90)
    return out.getvalue()


def _first_row(figure: Figure, grid: Any, result: dict[str, Any]) -> None:
    """Landscape, theta_hat against the walls, verdicts."""
    claims = {c["name"]: c for c in result["claims"]}
    if result["landscape"] is not None:
        _landscape(figure, grid[0, :2], result["landscape"])
    if "yaw" in claims:
        axes = figure.add_subplot(grid[0, 2])
        folded = claims["yaw"]["numbers"]["folded_deg"]
        axes.hist(folded, bins=np.arange(-45.0, 46.0, 7.5).tolist(), color=COLOURS["paper"], edgecolor="white")
        axes.axhline(len(folded) / 12.0, color="0.4", lw=1, ls="--")
        axes.set(xlabel="theta_hat against the longest wall / deg", ylabel="views", xticks=(-45, 0, 45))
        near = claims["yaw"]["numbers"]["share"]
        axes.set_title(f"{100 * near:.0f} % within 5 deg of 0 (dashed: chance)", fontsize=9)
    if claims:
        axes = figure.add_subplot(grid[0, 3:])
        axes.axis("off")
        axes.set_title("verdicts", fontsize=9, loc="left")
        tone = {"holds": "#2e7d4f", "does not hold": "#b23b2a", "not shown": "0.4"}
        for i, claim in enumerate(claims.values()):
            y = 0.95 - i / max(9, len(claims))
            axes.text(0.0, y, claim["verdict"], color=tone[claim["verdict"]], fontsize=9, weight="bold", va="top")
            axes.text(0.13, y, claim["claim"], fontsize=9, va="top")
            axes.text(0.13, y - 0.048, claim["measured"], fontsize=7.5, color="0.35", va="top")


def _landscape(figure: Figure, place: Any, shown: dict[str, Any]) -> None:
    """The noisy landscape, and below it the noise-free one on its own scale."""
    theta = np.array(shown["theta_deg"])
    cells = place.subgridspec(2, 1, height_ratios=(3.0, 1.0), hspace=0.0)
    upper = figure.add_subplot(cells[0])
    lower = figure.add_subplot(cells[1], sharex=upper)
    noisy = np.array(shown["noisy"], dtype=float)
    upper.semilogy(theta, noisy, color=COLOURS["paper"], lw=1.2, label="5 px noise")
    lower.semilogy(theta, np.maximum(shown["exact"], 1e-18), color=COLOURS["ml"], lw=0.8, label="noise-free")
    for k, pole in enumerate(shown["poles_deg"]):
        for axes in (upper, lower):
            axes.axvline(pole, color="0.7", lw=0.8, ls=":", label=None if k or axes is lower else "poles of lambda")
    for turn in (-180.0, 0.0, 180.0):
        at = shown["theta_hat_deg"] + turn
        if -180.0 <= at <= 180.0:
            near = noisy[int(np.argmin(np.abs(theta - at)))]
            upper.plot(at, near, "v", color="black", ms=6, label="theta_hat" if turn == 0.0 else None)
    upper.set(ylabel="sigma_min / sigma_max", xlim=(-180, 180), xticks=range(-180, 181, 60))
    upper.set_title("gauge landscape of one view", fontsize=9)
    upper.tick_params(labelbottom=False)
    lower.set(xlabel="theta / deg", ylim=(1e-18, 1e-12), yticks=(1e-16, 1e-13))
    for axes in (upper, lower):
        axes.tick_params(labelsize=8)
        axes.legend(fontsize=7, loc="upper center")


def _solvers(result: dict[str, Any]) -> list[str]:
    return list(dict.fromkeys(row["solver"] for row in result["rows"]))


def _style(solver: str) -> dict[str, Any]:
    hollow = (
        {"mfc": "white", "zorder": 1.9} if solver in ("paper", "tls") else {}
    )  # often nearly hidden by the next one
    size = 6.5 if hollow else 3.5
    return {"color": COLOURS.get(solver, OWN), "marker": MARKS.get(solver, "D"), "ms": size, "lw": 1.3, **hollow}


def _sweep(axes: Axes, result: dict[str, Any], name: str, value: str, label: str, *, bars: bool = False) -> None:
    """One number of every solver against the levels of a sweep."""
    factor = SWEEPS[name][0]
    for solver in _solvers(result):
        rows = [r for r in result["rows"] if r["sweep"] == name and r["solver"] == solver]
        levels = [r[factor] for r in rows]
        words = isinstance(levels[0], str | bool)
        x = np.arange(len(rows), dtype=float) if words else np.array(levels, float) * (100.0 if name in PERCENT else 1)
        y = _column(rows, value)
        if words:
            x = x + 0.12 * (_solvers(result).index(solver) - 1.5)
        axes.plot(x, 100 * y, **_style(solver), ls="none" if words else "-")
        if bars:
            low, high = 100 * _column(rows, f"{value}_low"), 100 * _column(rows, f"{value}_high")
            if words:
                axes.vlines(x, low, high, color=COLOURS.get(solver, OWN), lw=1.2)
            else:
                axes.fill_between(x, low, high, color=COLOURS.get(solver, OWN), alpha=0.1, lw=0)
        if words:
            said = [{True: "yes", False: "no"}.get(v, str(v)) for v in levels]
            axes.set_xticks(np.arange(len(rows)), said)
            axes.set_xlim(-0.5, len(rows) - 0.5)
    axes.set_ylim(0.0, max(axes.get_ylim()[1], 5.0 if value == "failure" else 0.0))
    axes.set_xlabel(LABELS[name], fontsize=9)
    axes.set_ylabel(label, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(color="0.92")
    axes.set_axisbelow(True)


def _column(rows: list[dict[str, Any]], name: str) -> Any:
    return np.array([math.nan if r[name] is None else r[name] for r in rows], dtype=float)


def _last_row(figure: Figure, grid: Any, row: int, result: dict[str, Any]) -> None:
    """Tilt, coverage, normalized errors, recovered share and time."""
    present = {r["sweep"] for r in result["rows"]}
    panels = [
        ("tilt", "tilt_error_deg", "tilt error after solving / deg"),
        ("sigma", "within_2_sigma", "rays within 2 sigma / %"),
        ("tilt", "within_2_sigma", "rays within 2 sigma / %"),
    ]
    for column, (name, value, label) in enumerate(panels):
        if name not in present:
            continue
        axes = figure.add_subplot(grid[row, column])
        scale = 1.0 if value == "tilt_error_deg" else 100.0
        for solver in _solvers(result):
            rows = [r for r in result["rows"] if r["sweep"] == name and r["solver"] == solver]
            y = _column(rows, value)
            if np.isfinite(y).any():
                axes.plot(_column(rows, SWEEPS[name][0]), scale * y, **_style(solver))
        if value == "tilt_error_deg":
            rows = [r for r in result["rows"] if r["sweep"] == name]
            x, y = _column(rows, "tilt_deg"), _column(rows, "imu_error_deg")
            axes.plot(*np.array(sorted(set(zip(x, y, strict=True)))).T, "k--", lw=1, label="IMU")
            axes.legend(fontsize=7)
            axes.set_ylim(bottom=0.0)
        else:
            axes.axhline(95.45, color="0.4", lw=1, ls="--")
            axes.set_ylim(60, 100)
        axes.set_xlabel(LABELS[name], fontsize=9)
        axes.set_ylabel(label, fontsize=9)
        axes.tick_params(labelsize=8)
        axes.grid(color="0.92")
    _z_histogram(figure.add_subplot(grid[row, 3]), result)
    _times(figure.add_subplot(grid[row, 4]), result)
    _sweep_if(figure, grid[row, 5], result, "one-sided", "recovered", "rays recovered / %")


def _sweep_if(figure: Figure, place: Any, result: dict[str, Any], name: str, value: str, label: str) -> None:
    if any(r["sweep"] == name for r in result["rows"]):
        _sweep(figure.add_subplot(place), result, name, value, label)


def _z_histogram(axes: Axes, result: dict[str, Any]) -> None:
    """Normalized ray errors of all views at the baseline factors, against the standard normal."""
    base = result["settings"]["baseline"]
    middle = 0.5 * (Z_EDGES[1:] + Z_EDGES[:-1])
    for solver in _solvers(result):
        rows = [r for r in result["rows"] if r["solver"] == solver and all(r[k] == v for k, v in base.items())]
        counts = next((np.array(r["z_histogram"], dtype=float) for r in rows if r["z_histogram"]), None)
        if counts is not None:
            density = counts / counts.sum() / (Z_EDGES[1] - Z_EDGES[0])
            axes.step(middle, density, where="mid", color=COLOURS.get(solver, OWN), lw=1.4)
    axes.plot(middle, np.exp(-0.5 * middle**2) / math.sqrt(2.0 * math.pi), "k--", lw=1)
    axes.set_xlabel("log range error / its sd (dashed: normal)", fontsize=9)
    axes.set_ylabel("density, baseline", fontsize=9)
    axes.tick_params(labelsize=8)


def _times(axes: Axes, result: dict[str, Any]) -> None:
    """Processor time per solve against the number of pairs."""
    for solver in _solvers(result):
        rows = [r for r in result["rows"] if r["solver"] == solver and r["sweep"] == "pairs"]
        if rows:
            axes.semilogy(_column(rows, "pairs"), 1e3 * _column(rows, "ms_per_solve"), **_style(solver))
    axes.set_xlabel("pairs in view", fontsize=9)
    axes.set_ylabel("time per solve / us", fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(color="0.92", which="both")


def _legend(figure: Figure, result: dict[str, Any]) -> None:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], **_style(s), label=s) for s in _solvers(result)]
    if handles:
        settings = result["settings"]
        title = (
            f"{settings['frames']} views per condition; baseline: 5 px noise, 1 deg IMU error, 108 deg; bands: 95 %; "
            "failed: ray error above 20 % or not recovered"
        )
        figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), title=title, fontsize=9)
