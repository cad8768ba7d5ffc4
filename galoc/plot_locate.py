"""One photo, found on a plan: the walls seen in it, and beside them where that may be."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from galoc.floorplan import Floorplan
from galoc.places import Place
from galoc.plot import draw_plan
from galoc.plot_detect import draw_detection
from galoc.plot_match import BEST
from galoc.types import Rays, Wireframe

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

OTHER = "#5b6b8c"
"""Colour of the places that are less likely."""
FAINT_SHARE = 0.01
"""Less likely places are not drawn."""
PLAN_INCH = 6.0
"""Longer side of the plan, inches; the photo is as high as the plan, but not higher than this."""


def save_location_figure(
    plan: Floorplan,
    picture: NDArray[np.uint8],
    wireframe: Wireframe,
    found: Sequence[Place],
    path: str | Path,
    *,
    walls: Array | None = None,
    title: str = "",
) -> Path:
    """Draw a photo with its walls beside the plan with the places it may be from; whole or not at all.

    Args:
        plan: the map.
        picture: (H, W, 3) uint8 RGB.
        wireframe: seen in it.
        found: the places, best first; none: the plan alone.
        path: where to, .png or .jpg.
        walls: (n, 2) m: observed walls at the best place (:func:`observed_walls`), NaN rows between pieces.
        title: one line above.

    Raises:
        GalocError: a place that cannot be written.
    """
    from matplotlib.figure import Figure

    from galoc.formats.atomic import write_atomic

    drawn = draw_detection(picture, wireframe)
    x0, y0, x1, y1 = plan.bounds
    long = max(x1 - x0, y1 - y0)
    wide, high = PLAN_INCH * (x1 - x0) / long, max(PLAN_INCH * (y1 - y0) / long, 3.0)
    photo = min(high * drawn.shape[1] / drawn.shape[0], 1.4 * PLAN_INCH)
    figure = Figure(figsize=(photo + wide + 0.4, high + 0.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(photo, wide))
    left.imshow(drawn)
    left.set_axis_off()
    draw_plan(right, plan)
    _draw_places(right, found, walls)
    figure.suptitle(title.replace("$", r"\$"), fontsize=11, x=0.01, ha="left")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png" if Path(path).suffix.lower() == ".png" else "jpeg", dpi=150)
    return write_atomic(path, buffer.getvalue())


def observed_walls(rays: Rays, pose: Array, positions: Array, ranges: NDArray[np.floating]) -> Array:
    """(n, 2) m: the walls that a photo shows, put on the plan at a pose; rows of NaN where they break off.

    Rays have a scale of their own; they are drawn at the one at which they fit the plan best.

    Args:
        rays: what was seen.
        pose: (3,) where from.
        positions: (P, 2) m, the grid of a :class:`galoc.profiles.ProfileField`.
        ranges: (P, 360) m, its profiles.
    """
    known = np.flatnonzero(rays.known)
    if len(known) == 0:
        return np.zeros((0, 2))
    bearing = pose[2] + rays.bearings_rad[known]
    nearest = int(np.argmin(np.hypot(*(positions - pose[:2]).T)))
    there = ranges[nearest, np.round(np.degrees(bearing)).astype(int) % 360]
    reach = rays.range[known] * float(np.median(there / rays.range[known]))
    points = pose[:2] + reach[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    # Between two rays a degree apart a wall is hardly ever longer than this: there one wall hides another.
    jumps = np.hypot(*np.diff(points, axis=0).T) > 0.15 * np.minimum(reach[1:], reach[:-1]) + 0.1
    apart = np.flatnonzero(jumps | (np.diff(known) > 1)) + 1
    return np.insert(points, apart, np.nan, axis=0)


def _draw_places(ax: Axes, found: Sequence[Place], walls: Array | None) -> None:
    """Numbered arrows; the less likely a place, the smaller."""
    x_span, y_span = np.ptp(ax.get_xlim()), np.ptp(ax.get_ylim())
    shown = [place for k, place in enumerate(found) if k == 0 or place.share >= FAINT_SHARE]
    if walls is not None and len(walls):
        ax.plot(*walls.T, color=BEST, linewidth=2.2, alpha=0.8, zorder=6, solid_capstyle="round")
    for k, place in reversed(list(enumerate(shown))):
        reach = 0.07 * max(x_span, y_span) * (0.6 + 0.4 * math.sqrt(place.share))
        x, y, heading = (float(value) for value in place.pose)
        tip = x + reach * math.cos(heading), y + reach * math.sin(heading)
        colour = BEST if k == 0 else OTHER
        arrow = {"arrowstyle": "-|>", "color": colour, "linewidth": 2.0, "shrinkA": 0, "shrinkB": 0}
        ax.annotate("", tip, (x, y), arrowprops=arrow, zorder=7)
        ax.plot(x, y, marker="o", markersize=13, color=colour, markeredgecolor="white", zorder=8)
        ax.annotate(str(k + 1), (x, y), color="white", fontsize=8, ha="center", va="center_baseline", zorder=9)
