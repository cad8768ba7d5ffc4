"""SE(2) motion of a round body among walls: actions, contact, odometry, and where the body fits."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc import Floorplan, GalocError
from galoc_env import _motion_kernel as kernel

Array = NDArray[np.float64]

BODY_RADIUS = 0.25
"""Radius of the agent's round body, m."""
STEP_M = 0.3
"""Length of one discrete forward or backward step, and of a full continuous one, m."""
TURN_RAD = math.radians(30.0)
"""Angle of one discrete turn, and of a full continuous one, rad."""
SKIN_M = kernel.SKIN_M
"""The body stops this far short of contact, so that rounding never leaves it inside a wall (m)."""

FORWARD, BACKWARD, LEFT, RIGHT = 0, 1, 2, 3
"""The discrete actions."""
_DISCRETE = np.array([[STEP_M, 0, 0], [-STEP_M, 0, 0], [0, 0, TURN_RAD], [0, 0, -TURN_RAD]], dtype=np.float64)
_DISCRETE.setflags(write=False)
_ROWS = tuple(_DISCRETE)
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
        # What action_space.sample() and agents give; numpy's own conversions would cost more than the motion.
        kind = type(action)
        if (kind is int or kind is np.int64) and 0 <= action < len(_ROWS):  # type: ignore[operator]
            return _ROWS[action]  # type: ignore[call-overload]
        value = np.asarray(action)
        if value.size != 1:
            raise _not_an_action(action, actions)
        return commanded_motions(value.reshape(1), actions)[0]
    try:
        vector = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError):
        vector = np.zeros(0)
    if vector.shape != (3,):
        raise _not_an_action(action, actions)
    return commanded_motions(vector[None], actions)[0]


def commanded_motions(chosen: NDArray, actions: str) -> Array:
    """(L, 3) the same for many bodies: L whole numbers, or (L, 3) numbers within [-1, 1].

    Raises:
        GalocError: one of them is not an action of that space.
    """
    if actions == "discrete":
        if chosen.dtype.kind not in "iu" or not np.all((chosen >= 0) & (chosen < len(_ROWS))):
            raise _not_an_action(chosen, actions)
        return _DISCRETE[chosen]
    if not np.all(np.abs(chosen) <= 1.0):
        raise _not_an_action(chosen, actions)
    return chosen * _CONTINUOUS


def _not_an_action(action: object, actions: str) -> GalocError:
    if actions == "discrete":
        expected = "0 (forward), 1 (backward), 2 (turn left) or 3 (turn right)"
        return GalocError(f"action = {action!r}", expected, "Draw actions from env.action_space.")
    return GalocError(
        f"action = {action!r}",
        "three finite numbers within [-1, 1]",
        "Clip the policy's output to the action space.",
    )


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
    (x, y), (dx, dy) = start, shift
    walls = np.ascontiguousarray(segments, dtype=np.float64)
    return float(kernel.free_fraction(float(x), float(y), float(dx), float(dy), walls, 0, len(walls), float(radius)))


def move(pose: Array, motion: Array, obstacles: Array, radius: float = BODY_RADIUS) -> Moved:
    """Carry out a body-frame motion: translate in a straight line until contact, then turn.

    Args:
        pose: (3,) x, y m, heading rad.
        motion: (3,) dx forward m, dy left m, dheading rad.
        obstacles: (S, 4) m: walls and furniture edges.
        radius: body radius, m.
    """
    body = np.zeros(kernel.COLUMNS)
    body[:3], body[13:16] = pose, motion
    walls = np.ascontiguousarray(obstacles, dtype=np.float64)
    kernel.move(body, walls, 0, len(walls), float(radius))
    return Moved(body[:3].copy(), body[3:6].copy(), bool(body[24]))


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
