"""Drawing what a search found: the heat map of a view over the plan, the best poses, the truth."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.errors import GalocError
from galoc.floorplan import Floorplan
from galoc.plot import draw_plan

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

Array = NDArray[np.float64]

BEST, TRUTH = "#c8553d", "#12813f"
"""Colours of the poses found and of the true one."""
SHOWN = 0.5
"""Share of the positions that are coloured: the better half."""


def draw_heat_map(
    ax: Axes, plan: Floorplan, xy: ArrayLike, scores: ArrayLike, poses: ArrayLike = (), truth: ArrayLike | None = None
) -> AxesImage:
    """Draw the scores of positions over a plan, the better half of them, and poses as arrows, the best one filled.

    Args:
        ax: matplotlib axes.
        plan: the map.
        xy: (P, 2) m, from :meth:`galoc.Matcher.heat_map`.
        scores: (P,) their scores.
        poses: (K, 3) x, y, heading of the poses found, best first.
        truth: (3,) the true pose, if known.

    Returns:
        The coloured image, for a colour bar.

    Raises:
        GalocError: no position, or arrays that do not go together.
    """
    place, value = np.asarray(xy, dtype=np.float64), np.asarray(scores, dtype=np.float64)
    if place.ndim != 2 or place.shape[1:] != (2,) or value.shape != (len(place),) or len(place) == 0:
        raise GalocError(f"positions {place.shape}, scores {value.shape}", "(P, 2) and (P,)", "Use Matcher.heat_map.")
    draw_plan(ax, plan)
    image, extent = _image(place, value)
    least = np.nanquantile(image, 1.0 - SHOWN)
    points = ax.imshow(
        np.where(image >= least, image, np.nan), origin="lower", extent=extent, interpolation="nearest",
        cmap="magma_r", zorder=1,
    )  # fmt: skip
    for k, pose in enumerate(np.asarray(poses, dtype=np.float64).reshape(-1, 3)):
        _draw_pose(ax, pose, BEST, filled=k == 0)
    if truth is not None:
        _draw_pose(ax, np.asarray(truth, dtype=np.float64), TRUTH, filled=False, size=15.0)
    return points


def save_match_figure(
    plan: Floorplan,
    xy: ArrayLike,
    scores: ArrayLike,
    path: str | Path,
    *,
    poses: ArrayLike = (),
    truth: ArrayLike | None = None,
    label: str = "score of the best heading",
) -> Path:
    """Draw a heat map with its poses into a PNG; the file appears whole or not at all.

    Args:
        plan: the map.
        xy: (P, 2) m.
        scores: (P,).
        path: where to, ``.png``.
        poses: (K, 3), best first.
        truth: (3,) the true pose, if known.
        label: of the colour bar.

    Raises:
        GalocError: suffix other than ``.png``, a place that cannot be written, or as :func:`draw_heat_map`.
    """
    if Path(path).suffix.lower() != ".png":
        raise GalocError(f"{str(path)!r} to draw a heat map to", "a file name that ends in .png", "Fix the suffix.")
    from matplotlib.figure import Figure

    from galoc.formats.atomic import write_atomic

    x0, y0, x1, y1 = plan.bounds
    long = max(x1 - x0, y1 - y0)
    figure = Figure(figsize=(2.0 + 8.0 * (x1 - x0) / long, 1.0 + 8.0 * (y1 - y0) / long), layout="constrained")
    ax = figure.add_subplot()
    points = draw_heat_map(ax, plan, xy, scores, poses, truth)
    figure.colorbar(points, ax=ax, label=label, shrink=0.8)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150)
    return write_atomic(path, buffer.getvalue())


def _image(place: Array, value: Array) -> tuple[Array, tuple[float, float, float, float]]:
    """Values on a grid of the positions' own step, NaN where there is none, and its extent (x0, x1, y0, y1), m."""
    steps = np.concatenate([np.diff(np.unique(np.round(place[:, k], 6))) for k in (0, 1)])
    step = float(steps.min()) if len(steps) else 0.1
    low = place.min(axis=0)
    column, row = np.round((place - low) / step).astype(np.int64).T
    image = np.full((row.max() + 1, column.max() + 1), np.nan)
    image[row, column] = value
    x0, y0 = low - step / 2.0
    return image, (x0, x0 + step * image.shape[1], y0, y0 + step * image.shape[0])


def _draw_pose(ax: Axes, pose: Array, colour: str, *, filled: bool, size: float = 9.0) -> None:
    """A ring at the position and a line along the heading."""
    reach = 0.06 * max(np.ptp(ax.get_xlim()), np.ptp(ax.get_ylim()))
    end = pose[:2] + reach * np.array([np.cos(pose[2]), np.sin(pose[2])])
    ax.plot(*np.array([pose[:2], end]).T, color=colour, linewidth=1.6, zorder=7)
    face = colour if filled else "none"
    ax.plot(*pose[:2], marker="o", markersize=size, markerfacecolor=face, markeredgecolor=colour, zorder=8)
