"""Drawing floorplans: walls solid, doors with their swing, windows blue, free space light."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from galoc.errors import GalocError
from galoc.floorplan import Floorplan, Opening

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WALL, FREE, WINDOW, DOOR = "#2f3136", "#f4efe3", "#3f8fd6", "#9a7b4f"
"""Colours."""
SWING_MAX_M = 1.25
"""Wider doors are passages without a leaf."""
WALL_HALF_M = 0.35
"""A closed face hardly anywhere this far from its edge is the inside of a wall or a pillar, m."""


def draw_plan(ax: Axes, plan: Floorplan) -> None:
    """Draw a plan into axes in plan coordinates (m), equal aspect, without ticks.

    Args:
        ax: matplotlib axes.
        plan: what to draw.
    """
    from matplotlib.collections import LineCollection

    _draw_free(ax, plan)
    _draw_solids(ax, plan)
    ax.add_collection(LineCollection(list(plan.segments.reshape(-1, 2, 2)), colors=WALL, linewidths=0.6, zorder=3))
    for opening in plan.openings:
        if opening.kind == "window":
            _draw_window(ax, opening)
        else:
            _draw_door(ax, opening, plan)
    x_min, y_min, x_max, y_max = plan.bounds
    margin = 0.03 * max(x_max - x_min, y_max - y_min)
    ax.set_xlim(x_min - margin, x_max + margin)
    ax.set_ylim(y_min - margin, y_max + margin)
    ax.set_aspect("equal")
    ax.set_axis_off()


def save_plan_figure(plan: Floorplan, path: str | Path) -> Path:
    """Draw a plan with title, facts and scale bar into a PNG; the file appears whole or not at all.

    Raises:
        GalocError: suffix other than ``.png``, or a place that cannot be written.
    """
    if Path(path).suffix.lower() != ".png":
        raise GalocError(f"{str(path)!r} to draw a plan to", "a file name that ends in .png", "Fix the suffix.")
    from matplotlib.figure import Figure

    from galoc.formats.atomic import write_atomic
    from galoc.plan_facts import plan_facts

    facts = plan_facts(plan, _resolution(plan))
    long = max(facts.width, facts.depth)
    figure = Figure(
        figsize=(max(5.5, 10.0 * facts.width / long), 1.1 + 10.0 * facts.depth / long), layout="constrained"
    )
    ax = figure.add_subplot()
    draw_plan(ax, plan)
    _draw_scale_bar(ax, plan)
    words = f"{facts.width:.1f} m x {facts.depth:.1f} m   free {facts.free_area:.0f} m$^2$   {facts.rooms} rooms"
    openings = f"   {facts.doors} doors   {facts.windows} windows" if plan.openings else ""
    ax.set_title((plan.name or "floorplan").replace("$", r"\$"), fontsize=14, loc="left", pad=22)
    ax.annotate(
        f"{words}{openings}   ceiling {facts.ceiling_height:.2f} m",
        (0.0, 1.0),
        (0.0, 8.0),
        xycoords="axes fraction",
        textcoords="offset points",
        fontsize=9,
        color="#555555",
    )
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150)
    return write_atomic(path, buffer.getvalue())


def _resolution(plan: Floorplan) -> float:
    """Grid cell that shows free space well at the size of a picture, m."""
    x_min, y_min, x_max, y_max = plan.bounds
    return max(0.05, max(x_max - x_min, y_max - y_min) / 2000.0)


def _draw_free(ax: Axes, plan: Floorplan) -> None:
    """Light ground where one can stand, grown by two cells so that it reaches under the walls' edges."""
    import cv2

    free = plan.free_space(_resolution(plan))
    grown = np.asarray(cv2.dilate(free.inside.astype(np.uint8), np.ones((5, 5), np.uint8)))
    if plan.outline is None:  # nothing solid hides the growth along the outer face of a wall drawn as one line
        grown = np.asarray(cv2.morphologyEx(free.inside.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)))
    rows, cols = grown.shape
    x, y = free.origin
    extent = (x, x + cols * free.resolution, y, y + rows * free.resolution)
    colour = tuple(int(FREE[i : i + 2], 16) for i in (1, 3, 5))
    rgba = np.zeros((rows, cols, 4), np.uint8)
    rgba[grown > 0] = (*colour, 255)
    ax.imshow(rgba, origin="lower", extent=extent, interpolation="nearest", zorder=0)


def _draw_solids(ax: Axes, plan: Floorplan) -> None:
    """Fill wall cores and pillars: the closed faces between segments that are too narrow to be rooms."""
    from matplotlib.collections import PathCollection
    from matplotlib.path import Path as Outline
    from shapely import MultiLineString, get_parts, polygonize, unary_union

    lines = unary_union(MultiLineString(list(plan.segments.reshape(-1, 2, 2))))
    paths = []
    for face in get_parts(polygonize(get_parts(lines))):
        if face.buffer(-WALL_HALF_M).area < 0.05 * face.area:
            rings = [np.asarray(ring.coords) for ring in (face.exterior, *face.interiors)]
            paths.append(Outline.make_compound_path(*[Outline(ring, closed=True) for ring in rings]))
    ax.add_collection(PathCollection(paths, facecolors=WALL, edgecolors="none", zorder=2))


def _frame(opening: Opening) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Start, unit direction along and unit normal to the left of an opening's centreline."""
    start = np.array([opening.x1, opening.y1])
    along = (np.array([opening.x2, opening.y2]) - start) / opening.width
    return start, along, np.array([-along[1], along[0]])


def _draw_window(ax: Axes, opening: Opening) -> None:
    """White gap with two blue panes."""
    start, along, normal = _frame(opening)
    half = max(opening.thickness, 0.08) / 2.0
    corners = [
        start + side * half * normal + t * opening.width * along for side, t in ((1, 0), (1, 1), (-1, 1), (-1, 0))
    ]
    ax.fill(*np.array(corners).T, facecolor="white", edgecolor=WINDOW, linewidth=0.8, zorder=4)
    pane = np.array([start, start + opening.width * along])
    ax.plot(*pane.T, color=WINDOW, linewidth=1.0, zorder=5, solid_capstyle="butt")


def _draw_door(ax: Axes, opening: Opening, plan: Floorplan) -> None:
    """Leaf and quarter circle towards the side with more room; wide passages get two dashed edges."""
    start, along, normal = _frame(opening)
    end = start + opening.width * along
    half = opening.thickness / 2.0
    if opening.width > SWING_MAX_M:
        for side in (-half, half):
            edge = np.array([start + side * normal, end + side * normal])
            ax.plot(*edge.T, color=DOOR, linewidth=0.6, linestyle=(0, (4, 3)), zorder=4)
        return
    choices = [(h, a, side * normal) for h, a in ((start, along), (end, -along)) for side in (1, -1)]
    free = plan.free_space(_resolution(plan))
    # the leaf stands open at the hinge: best where the opened leaf keeps clear of walls
    hinge, shut, opened = max(
        choices, key=lambda c: float(free.clearance_at(c[0] + (0.7 * opening.width + half) * c[2] + 0.05 * c[1]))
    )
    hinge = hinge + half * opened
    turn = np.linspace(0.0, math.pi / 2.0, 24)[:, None]
    arc = hinge + opening.width * (np.cos(turn) * shut + np.sin(turn) * opened)
    ax.plot(*arc.T, color=DOOR, linewidth=0.5, zorder=4)
    ax.plot(*np.array([hinge, arc[-1]]).T, color=DOOR, linewidth=1.2, zorder=4)


def _draw_scale_bar(ax: Axes, plan: Floorplan) -> None:
    """Bar of a round length below the plan's lower left corner."""
    x_min, y_min, x_max, y_max = plan.bounds
    long = max(x_max - x_min, y_max - y_min)
    wanted = long / 5.0
    power = 10.0 ** math.floor(math.log10(wanted))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power <= wanted)
    y = y_min - 0.045 * long
    ax.plot([x_min, x_min + length], [y, y], color="black", linewidth=2.0, solid_capstyle="butt")
    ax.text(x_min + length + 0.01 * long, y, f"{length:g} m", fontsize=9, va="center")
    low, high = ax.get_ylim()
    ax.set_ylim(min(low, y - 0.03 * long), high)
