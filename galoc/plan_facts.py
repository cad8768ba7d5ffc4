"""What one wants to know about a plan at a glance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.floorplan import Floorplan

MANHATTAN_TOLERANCE_DEG = 2.0
"""A wall within this of the dominant right-angled grid counts as on it."""
DOOR_HALF_WIDTH = 0.55
"""Where a plan gives no doors, rooms are the regions that stay apart for a disc of this radius, m."""
BODY_RADIUS = 0.3
"""The disc, m, where the plan gives its doors and these part the rooms."""
MIN_ROOM_M2 = 0.25
"""Smallest area of such a region, shrunk by the disc, that counts as a room."""


@dataclass(frozen=True, slots=True)
class PlanFacts:
    """Summary of a plan."""

    width: float
    """Extent along x, m."""
    depth: float
    """Extent along y, m."""
    segments: int
    """Number of wall segments."""
    wall_length: float
    """Summed length of all segments (both faces of a wall count), m."""
    free_area: float
    """Area inside the building, walls excluded, m2."""
    rooms: int
    """Regions parted by walls and doors (see :func:`room_count`)."""
    doors: int
    """Doors and doorless passages."""
    windows: int
    """Windows."""
    ceiling_height: float
    """Floor to ceiling, m."""
    manhattan_share: float
    """Share of wall length within 2 degrees of the dominant right-angled grid, 0..1."""
    manhattan_rad: float
    """Direction of that grid, rad in [0, pi/2)."""


def plan_facts(plan: Floorplan, resolution: float = 0.05) -> PlanFacts:
    """Summarize a plan; ``resolution`` (m) is that of the free-space grid."""
    x_min, y_min, x_max, y_max = plan.bounds
    share, angle = manhattan(plan.segments)
    doors = sum(opening.kind == "door" for opening in plan.openings)
    steps = plan.segments[:, 2:] - plan.segments[:, :2]
    return PlanFacts(
        width=x_max - x_min,
        depth=y_max - y_min,
        segments=len(plan.segments),
        wall_length=float(np.hypot(*steps.T).sum()),
        free_area=plan.free_space(resolution).area,
        rooms=room_count(plan, resolution),
        doors=doors,
        windows=len(plan.openings) - doors,
        ceiling_height=plan.ceiling_height,
        manhattan_share=share,
        manhattan_rad=angle,
    )


def room_count(plan: Floorplan, resolution: float = 0.05) -> int:
    """Rooms: regions that given doors part, or, where the plan gives none, that gaps up to 1.1 m wide part."""
    import cv2

    free = plan.free_space(resolution)
    doors = [opening for opening in plan.openings if opening.kind == "door"]
    mask = (free.inside & (free.clearance >= (BODY_RADIUS if doors else DOOR_HALF_WIDTH))).astype(np.uint8)
    for door in doors:
        ends = (np.array([[door.x1, door.y1], [door.x2, door.y2]]) - free.origin) / free.resolution - 0.5
        start, end = np.round(ends).astype(int).tolist()
        cv2.line(mask, start, end, 0, 3)
    _, _, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    return int(np.count_nonzero(np.asarray(stats)[1:, cv2.CC_STAT_AREA] * free.resolution**2 >= MIN_ROOM_M2))


def manhattan(segments: ArrayLike) -> tuple[float, float]:
    """Share of wall length on the dominant right-angled grid, and that grid's direction.

    Args:
        segments: (S, 4), m.

    Returns:
        Share 0..1 within 2 degrees, and the direction, rad in [0, pi/2).
    """
    array = np.asarray(segments, dtype=np.float64)
    steps = array[:, 2:] - array[:, :2]
    length = np.hypot(*steps.T)
    angle = np.mod(np.arctan2(steps[:, 1], steps[:, 0]), math.pi / 2.0)
    tolerance = math.radians(MANHATTAN_TOLERANCE_DEG)
    bins = np.round(angle / (tolerance / 8.0)).astype(np.int64)
    centres = np.unique(bins).astype(np.float64) * (tolerance / 8.0)
    on_grid: NDArray[np.bool_] = _turn(angle[None, :], centres[:, None]) <= tolerance
    best = int(np.argmax(on_grid @ length))
    near = on_grid[best]
    # refine: length-weighted circular mean of the walls that agree
    mean = math.atan2(float(length[near] @ np.sin(4 * angle[near])), float(length[near] @ np.cos(4 * angle[near]))) / 4
    return float(length[near].sum() / length.sum()), mean % (math.pi / 2.0)


def _turn(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Smallest angle between two directions modulo a right angle, rad."""
    return np.abs((a - b + math.pi / 4.0) % (math.pi / 2.0) - math.pi / 4.0)
