"""The pictures of an evaluation: how soon it is localized, and how the error shrinks."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from galoc.metrics import HOLD
from galoc_env.evaluate_report import steps_to
from galoc_env.intervals import Resampling

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Row = dict[str, Any]
Array = NDArray[np.float64]

COLOURS = {0.5: "#16963f", 0.3: "#3d6fb4", 0.1: "#e8541c"}
"""One per distance, m."""
WIDTHS = {0.5: 4.0, 0.3: 2.5, 0.1: 1.2}
"""Of their lines: where they coincide, all are seen."""
FLOOR_M = 0.003
"""Smaller errors are drawn here, m."""


def success(rows: Sequence[Row], steps: int, title: str) -> bytes:
    """PNG: share of episodes that are localized for good, against steps."""
    figure, axes = _page(title, 1)
    for threshold, colour in COLOURS.items():
        line = {"color": colour, "lw": WIDTHS[threshold]}
        draw_success(axes[0], rows, steps, threshold, line, f"within {threshold:g} m", band=threshold == 0.5)
    if not np.isfinite(steps_to(rows, max(COLOURS))).any():
        note = f"none of {len(rows)} episodes" if steps + 1 >= HOLD else f"too short: it takes {HOLD} observations"
        axes[0].text(0.5, 0.5, note, transform=axes[0].transAxes, ha="center", va="center", color="#777777")
    axes[0].legend(loc="best", fontsize=9)
    axes[0].set_ylabel("episodes that stay localized / %")
    return _png(figure)


def draw_success(
    axes: Axes, rows: Sequence[Row], steps: int, threshold_m: float, line: dict[str, Any], label: str, *, band: bool
) -> None:
    """Draw the share of episodes that are within a distance from some step on, and its interval over plans.

    Args:
        axes: to draw into.
        rows: episodes.
        steps: actions per episode.
        threshold_m: the distance, m.
        line: colour and style, as matplotlib has them.
        label: for the legend.
        band: draw the interval.
    """
    held = steps_to(rows, threshold_m)
    # To count as held it must last for ten observations: later steps cannot be the first.
    upto = np.arange(max(2, steps + 2 - HOLD))  # two at least: one would be no line
    shares = [100.0 * float(np.mean(held <= s)) for s in upto]
    axes.step(upto, shares, where="post", label=label, **{"lw": 2.0, **line})
    if band:
        sample = Resampling([row["plan"] for row in rows])
        found = [sample.mean(held <= s) for s in upto]
        low, high = ([100.0 * getattr(i, side) for i in found] for side in ("low", "high"))
        axes.fill_between(upto, low, high, step="post", color=line["color"], alpha=0.15, lw=0)
    axes.set(xlim=(0, upto[-1]), ylim=(-3, 103), xlabel="step")  # below 0, lest the frame hide a line there
    axes.locator_params(axis="x", integer=True)
    axes.grid(alpha=0.25)


def error(rows: Sequence[Row], steps: int, title: str) -> bytes:
    """PNG: median and quartiles over the episodes of the position error and of the belief's entropy, against steps."""
    entropy = _curves(rows, "entropy", steps, math.nan)
    knows = bool(np.isfinite(entropy).any())
    figure, axes = _page(title, 2 if knows else 1)
    errors = np.maximum(_curves(rows, "error_m", steps, math.inf), FLOOR_M)
    finite = errors[np.isfinite(errors)]
    top = 1.5 * max(1.0, float(finite.max()) if finite.size else 1.0)
    _quartiles(axes[0], np.minimum(errors, 10.0 * top), "#e8541c")
    axes[0].set(yscale="log", ylim=(FLOOR_M, top), ylabel="position error / m")
    ticks = [t for t in (0.01, 0.1, 0.5, 1.0, 10.0, 100.0) if t <= top]
    axes[0].set_yticks(ticks, [f"{t:g}" for t in ticks])
    axes[0].set_yticks([], minor=True)
    axes[0].axhline(0.5, color=COLOURS[0.5], lw=1)
    axes[0].legend(loc="upper right", fontsize=9, frameon=False)
    if knows:
        _quartiles(axes[1], entropy, "#3a2caa")
        axes[1].set(ylabel="entropy of the belief / nats")
        axes[1].set_ylim(bottom=0.0)
    for panel in axes:
        panel.set(xlim=(0, steps), xlabel="step")
        panel.grid(alpha=0.25)
    return _png(figure)


def _curves(rows: Sequence[Row], key: str, steps: int, missing: float) -> Array:
    """(E, steps + 1) a curve of every episode; ``missing`` where JSON had none and after a failure."""
    out = np.full((len(rows), steps + 1), missing)
    for i, row in enumerate(rows):
        values = [missing if v is None else v for v in row[key]]
        out[i, : len(values)] = values
    return out


def _quartiles(axes: Axes, curves: Array, colour: str) -> None:
    # No interpolation between episodes: half-way to one without an estimate there is nothing.
    ranked = np.sort(curves, axis=0)
    count = np.isfinite(curves).sum(axis=0)
    at = np.arange(curves.shape[1])
    low, middle, high = (ranked[np.clip(np.ceil(q * count).astype(int) - 1, 0, None), at] for q in (0.25, 0.5, 0.75))
    axes.fill_between(at, low, high, color=colour, alpha=0.2, lw=0, label="middle half of the episodes")
    axes.plot(at, middle, color=colour, lw=2, label="median")


def _page(title: str, panels: int) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.6 * panels, 4.6), dpi=110, layout="constrained")
    axes = [figure.add_subplot(1, panels, 1 + i) for i in range(panels)]
    axes[0].set_title(title, fontsize=11, loc="left")
    return figure, axes


def _png(figure: Figure) -> bytes:
    out = io.BytesIO()
    figure.savefig(out)
    return out.getvalue()
