"""SE(2) motion of a round body among walls: actions, contact, odometry, and where the body fits."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc import Floorplan, GalocError

Array = NDArray[np.float64]

BODY_RADIUS = 0.25
"""Radius of the agent's round body, m."""
STEP_M = 0.3
"""Length of one discrete forward or backward step, and of a full continuous one, m."""
TURN_RAD = math.radians(30.0)
"""Angle of one discrete turn, and of a full continuous one, rad."""
SKIN_M = 1e-6
"""The body stops this far short of contact, so that rounding never leaves it inside a wall (m)."""

FORWARD, BACKWARD, LEFT, RIGHT = 0, 1, 2, 3
"""The discrete actions."""
_DISCRETE = np.array([[STEP_M, 0, 0], [-STEP_M, 0, 0], [0, 0, TURN_RAD], [0, 0, -TURN_RAD]], dtype=np.float64)
_CONTINUOUS = np.array([STEP_M, STEP_M, TURN_RAD])


@dataclass(frozen=True, slots=True, eq=False)
class Moved:
    """Outcome of one motion."""

    pose: Array
    """(3,) x, y in m and heading in rad within [-pi, pi), plan frame."""
    odometry: Array
    """(3,) true motion in the previous body frame: dx forward, dy left in m, dheading in rad."""
    collided: bool
    """The body touched a wall or furniture and stopped there."""


def wrap(angle_rad: float) -> float:
    """The same angle within [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def commanded_motion(action: object, actions: str) -> Array:
    """Body-frame motion (dx forward m, dy left m, dheading rad) that an action asks for.

    Args:
        action: ``actions="discrete"``: 0 forward, 1 backward, 2 turn left, 3 turn right. ``"continuous"``: three
            numbers within [-1, 1], scaled by 0.3 m forward, 0.3 m left, 30 degrees.
        actions: "discrete" or "continuous".

    Raises:
        GalocError: not an action of that space (NaN and out of range included).
    """
    if actions == "discrete":
        value = np.asarray(action)
        if value.size != 1 or value.dtype.kind not in "iu" or not 0 <= int(value.reshape(())) < len(_DISCRETE):
            raise GalocError(
                f"action = {action!r}",
                "0 (forward), 1 (backward), 2 (turn left) or 3 (turn right)",
                "Draw actions from env.action_space.",
            )
        return _DISCRETE[int(value.reshape(()))].copy()
    try:
        vector = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError):
        vector = np.full(1, np.nan)
    if vector.shape != (3,) or not np.all(np.abs(vector) <= 1.0):
        raise GalocError(
            f"action = {action!r}",
            "three finite numbers within [-1, 1]",
            "Clip the policy's output to the action space.",
        )
    return vector * _CONTINUOUS


def distances(xy: ArrayLike, segments: Array) -> Array:
    """(S,) exact distance (m) of point (2,) to segments (S, 4)."""
    p = np.asarray(xy, dtype=np.float64)
    a = segments[:, :2]
    d = segments[:, 2:] - a
    t = np.clip(np.einsum("ij,ij->i", p - a, d) / np.maximum(np.einsum("ij,ij->i", d, d), 1e-30), 0.0, 1.0)
    gap = a + t[:, None] * d - p
    return np.asarray(np.hypot(gap[:, 0], gap[:, 1]))


def free_fraction(start: Array, shift: Array, segments: Array, radius: float = BODY_RADIUS) -> float:
    """Share of a straight shift that a disc can travel before it touches a segment, 0..1. Exact, so no tunnelling.

    A disc that already overlaps a segment may leave it but not press on: distance to a segment is convex along a
    straight line, so once it grows it keeps growing.

    Args:
        start: (2,) centre, m.
        shift: (2,) wanted translation, m.
        segments: (S, 4) m.
        radius: m.
    """
    length = float(np.hypot(shift[0], shift[1]))
    if length < 1e-12 or len(segments) == 0:
        return 1.0
    a, b = segments[:, :2] - start, segments[:, 2:] - start
    gap = np.maximum(np.minimum(a, b), -np.maximum(a, b)).max(axis=1)  # to the bounding box, along the worse axis
    near = gap <= length + radius + SKIN_M
    a, b = a[near], b[near]
    if len(a) == 0:
        return 1.0
    u = shift / length
    travel = min(_first_disc_hit(np.concatenate([a, b]), u, radius), _first_side_hit(a, b, u, radius), length)
    return 1.0 if travel >= length else max(0.0, travel - SKIN_M) / length


def _first_disc_hit(points: Array, u: Array, radius: float) -> float:
    """Distance along unit u at which a disc at the origin first touches one of the points, inf for never."""
    along = points @ u
    off2 = np.einsum("ij,ij->i", points, points) - along**2
    hit = (along > 0.0) & (off2 < radius**2)
    if not hit.any():
        return math.inf
    return float(np.maximum(along[hit] - np.sqrt(radius**2 - off2[hit]), 0.0).min())


def _first_side_hit(a: Array, b: Array, u: Array, radius: float) -> float:
    """Distance along unit u at which a disc at the origin first touches the flank of one of the segments a-b."""
    d = b - a
    size = np.hypot(d[:, 0], d[:, 1])
    d = d / np.maximum(size, 1e-15)[:, None]
    normal = np.stack([-d[:, 1], d[:, 0]], axis=1)
    gap = np.einsum("ij,ij->i", a, normal)
    normal = np.where(gap[:, None] < 0.0, -normal, normal)
    gap = np.abs(gap)
    approach = normal @ u
    with np.errstate(divide="ignore", invalid="ignore"):
        travel = np.maximum(gap - radius, 0.0) / approach
        foot = travel * (d @ u) - np.einsum("ij,ij->i", a, d)
    hit = (approach > 1e-12) & (foot >= 0.0) & (foot <= size)
    return float(travel[hit].min()) if hit.any() else math.inf


def move(pose: Array, motion: Array, obstacles: Array, radius: float = BODY_RADIUS) -> Moved:
    """Carry out a body-frame motion: translate in a straight line until contact, then turn.

    Args:
        pose: (3,) x, y m, heading rad.
        motion: (3,) dx forward m, dy left m, dheading rad.
        obstacles: (S, 4) m: walls and furniture edges.
        radius: body radius, m.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    shift = np.array([c * motion[0] - s * motion[1], s * motion[0] + c * motion[1]])
    share = free_fraction(pose[:2], shift, obstacles, radius)
    turned = np.array([*(pose[:2] + share * shift), wrap(pose[2] + motion[2])])
    return Moved(turned, np.array([share * motion[0], share * motion[1], motion[2]]), share < 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Walkable:
    """Cells in which the body fits, connected to each other: the largest such region of a furnished plan."""

    origin: Array
    """(2,) m: lower left corner of cell (0, 0)."""
    resolution: float
    """Cell size, m."""
    mask: NDArray[np.bool_]
    """(H, W): the body fits here, and can get here from every other such cell."""

    @property
    def positions(self) -> Array:
        """(P, 2) m: the cell centres, row by row."""
        rows, cols = np.nonzero(self.mask)
        return self.origin + (np.stack([cols, rows], axis=1) + 0.5) * self.resolution

    def cell(self, xy: ArrayLike) -> tuple[int, int]:
        """Row and column of the cell that holds a point (2,); may lie outside the grid."""
        col, row = np.floor((np.asarray(xy, dtype=np.float64) - self.origin) / self.resolution).astype(int)
        return int(row), int(col)


def walkable(plan: Floorplan, furniture: Array, clearance: float = BODY_RADIUS + 0.05) -> Walkable:
    """Where a body can roam: the largest region at this clearance (m) from walls and furniture edges (F, 4).

    Raises:
        GalocError: the body fits nowhere.
    """
    import cv2

    free = plan.free_space()
    room = free.inside & (free.clearance >= clearance)
    if len(furniture):
        edges = np.ones(room.shape, np.uint8)
        ends = (furniture.reshape(-1, 2, 2) - free.origin) / free.resolution - 0.5
        cv2.polylines(edges, list(np.round(ends).astype(np.int32)), False, 0)
        # Half a cell diagonal: the drawn edge and the tested centre are each rounded to their cell.
        room &= cv2.distanceTransform(edges, cv2.DIST_L2, 5) * free.resolution >= clearance + 0.71 * free.resolution
    count, labels, stats, _ = cv2.connectedComponentsWithStats(room.astype(np.uint8), connectivity=4)
    if count < 2:
        raise GalocError(
            f"plan {plan.name!r} in which no place is {clearance:.2f} m clear of walls and furniture",
            f"room for a body of radius {BODY_RADIUS} m",
            "Check the plan's unit (metres) or lower `furniture`.",
        )
    return Walkable(free.origin, free.resolution, labels == 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax()))


def checked_start(value: object, plan: Floorplan, obstacles: Array) -> Array:
    """A start pose (3,) as given by the user, if the body fits there.

    Raises:
        GalocError: not three finite numbers, outside the building, or closer to a wall than the body's radius.
    """
    try:
        pose = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        pose = np.zeros(0)
    if pose.shape != (3,) or not np.all(np.isfinite(pose)):
        raise GalocError(f"start pose {value!r}", "(x m, y m, heading rad), all finite", "Pass three numbers.")
    free = plan.free_space()
    clearance = float(distances(pose[:2], obstacles).min(initial=math.inf))
    cell = free.index(pose[:2])
    inside = bool(np.all(cell >= 0) and np.all(cell < free.inside.shape)) and bool(free.inside[tuple(cell)])
    if not inside or clearance < BODY_RADIUS:
        where = (
            f"{clearance:.2f} m from the nearest wall or furniture" if inside else "outside the building or in a wall"
        )
        raise GalocError(
            f"start pose ({pose[0]:.2f}, {pose[1]:.2f}) {where}",
            f"a place inside with {BODY_RADIUS} m of clearance",
            "Choose another start, or leave `pose` out for a random one.",
        )
    pose[2] = wrap(pose[2])
    return pose
