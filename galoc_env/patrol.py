"""A scripted walker: wanders from room to room with the discrete actions.

It knows the true pose and every obstacle, so it is a way to make trajectories (for films, evaluation and data): an
agent that is to be localized does not have what it uses. As the policy "patrol" it says so; others live in
`galoc_agents`.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc_env import motion
from galoc_env.motion import FORWARD, LEFT, RIGHT, STEP_M, TURN_RAD, Walkable
from galoc_env.policy import Robot
from galoc_env.world import World

Array = NDArray[np.float64]

CELL_M = 0.1
"""Grid on which paths are planned, m."""
MAX_CELLS = 250_000
"""Paths are planned on coarser cells in plans with more than this."""
LEG_M = (2.5, 9.0)
"""Length of the walk to the next waypoint: preferred range, m."""
ARRIVED_M = 0.4
"""A waypoint closer than this along the path is reached, m."""
LOOK_SHARE = 0.4
"""Share of the waypoints at which the walker looks around."""
TURN_COST_M = 0.12
"""What a turn of 30 degrees costs against walking, m: keeps the walker from zigzagging."""
CLEARANCE_M = 0.08
"""The walker keeps this much more than the body's radius from walls where it can, m."""


class Patrol:
    """Walks through the largest region in which the body fits, turning and walking, without touching anything.

    Args:
        world: a built world (its obstacles and walkable region are used).
        rng: chooses waypoints and looks.
    """

    def __init__(self, world: World, rng: np.random.Generator) -> None:
        self._obstacles = world.obstacles
        self._rng = rng
        self._grid = _coarse(world.walkable)
        self._graph, self._node = _graph(self._grid)
        self._cells = np.argwhere(self._grid.mask)
        self._cost: Array | None = None
        self._queue: deque[int] = deque(self._look())

    def action(self, pose: Array) -> int:
        """The next discrete action at the true pose (3,)."""
        if self._queue:
            return self._queue.popleft()
        for _ in range(8):
            if self._cost is None:
                self._choose_waypoint(pose)
            action = self._follow(pose)
            if action is not None:
                return action
            self._cost = None
            if self._rng.random() < LOOK_SHARE:
                self._queue.extend(self._look())
                return self._queue.popleft()
        return LEFT  # nowhere to go from here: look for a way out

    def _look(self) -> list[int]:
        """Turns: a third of a round trip to one side, sometimes a full one."""
        side = LEFT if self._rng.random() < 0.5 else RIGHT
        return [side] * int(self._rng.choice([3, 4, 6, 12], p=[0.35, 0.35, 0.2, 0.1]))

    def _choose_waypoint(self, pose: Array) -> None:
        """Draw a goal at a walk of a few metres and keep the path length to it from everywhere near."""
        from scipy.sparse.csgraph import dijkstra

        here = self._nearest_node(pose[:2])
        reach = dijkstra(self._graph, indices=here, limit=1.5 * LEG_M[1])
        inside = np.flatnonzero((reach >= LEG_M[0]) & (reach <= LEG_M[1]))
        if len(inside) == 0:
            inside = np.flatnonzero(np.isfinite(reach))
        goal = int(self._rng.choice(inside))
        self._cost = dijkstra(self._graph, indices=goal, limit=reach[goal] + 4.0)

    def _follow(self, pose: Array) -> int | None:
        """One turn or step down the path length; None when arrived or stuck."""
        assert self._cost is not None
        here = self._path_left(pose[:2])
        if not math.isfinite(here) or here < ARRIVED_M:
            return None
        best, best_cost = None, here - 0.05
        for turns in range(-5, 7):
            heading = pose[2] + turns * TURN_RAD
            shift = STEP_M * np.array([math.cos(heading), math.sin(heading)])
            # The step must not end against a wall either, hence the margin on the body's radius.
            if motion.free_fraction(pose[:2], shift, self._obstacles, motion.BODY_RADIUS + 0.02) < 1.0:
                continue
            cost = self._path_left(pose[:2] + shift) + TURN_COST_M * abs(turns)
            if cost < best_cost + TURN_COST_M * abs(turns) and (best is None or cost < best[0]):
                best = (cost, turns)
        if best is None:
            return None
        turns = best[1]
        return FORWARD if turns == 0 else LEFT if turns > 0 else RIGHT

    def _path_left(self, xy: Array) -> float:
        """Length of the path from a point to the waypoint, m; infinite off the walkable grid."""
        assert self._cost is not None
        row, col = self._grid.cell(xy)
        if not (0 <= row < self._node.shape[0] and 0 <= col < self._node.shape[1]) or self._node[row, col] < 0:
            return math.inf
        return float(self._cost[self._node[row, col]])

    def _nearest_node(self, xy: Array) -> int:
        """The node at a point, or the nearest one to it."""
        centres = self._grid.origin + (self._cells[:, ::-1] + 0.5) * self._grid.resolution
        row, col = self._cells[int(np.argmin(np.sum((centres - xy) ** 2, axis=1)))]
        return int(self._node[row, col])


class Patroller:
    """The scripted walker as a policy, "patrol"; told the truth, in a world that it must ``enter`` first."""

    sees_truth = True
    _SPEEDS = {FORWARD: (1, 0, 0), LEFT: (0, 0, 1), RIGHT: (0, 0, -1)}

    def enter(self, world: World) -> None:
        """Get to know the obstacles of the next episodes."""
        self._world = world

    def reset(self, robot: Robot) -> None:
        """Start a walk."""
        self._discrete = robot.actions == "discrete"
        self._walker = Patrol(self._world, np.random.default_rng([robot.seed, 1]))

    def act(self, observation: dict[str, NDArray[Any]], info: dict[str, Any]) -> Any:
        """The next action, from the true pose."""
        action = self._walker.action(info["pose"])
        return action if self._discrete else np.array(self._SPEEDS[action], np.float32)


def _coarse(fine: Walkable) -> Walkable:
    """Walkable grid on cells of about ``CELL_M`` (more for huge plans): a cell counts if most of it does."""
    import cv2

    factor = max(1, round(CELL_M / fine.resolution), math.ceil(math.sqrt(fine.mask.sum() / MAX_CELLS)))
    if factor == 1:
        return fine
    rows, cols = (math.ceil(n / factor) for n in fine.mask.shape)
    padded = np.zeros((rows * factor, cols * factor), np.float32)
    padded[: fine.mask.shape[0], : fine.mask.shape[1]] = fine.mask
    share = padded.reshape(rows, factor, cols, factor).mean(axis=(1, 3))
    mask = (share >= 0.5).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    largest = 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax()) if len(stats) > 1 else -1
    return Walkable(fine.origin, fine.resolution * factor, labels == largest)


def _graph(grid: Walkable) -> tuple[object, NDArray[np.int64]]:
    """Sparse graph of the 8-neighbourhood with lengths in metres (longer near walls), and the node of each cell."""
    import cv2
    from scipy.sparse import csr_matrix

    mask = grid.mask
    node = np.full(mask.shape, -1, np.int64)
    node[mask] = np.arange(mask.sum())
    room = cv2.distanceTransform(np.pad(mask.astype(np.uint8), 1), cv2.DIST_L2, 5)[1:-1, 1:-1] * grid.resolution
    # Cells at the rim of the walkable region cost up to twice as much: paths keep away from walls where they can.
    weight = 1.0 + np.clip((CLEARANCE_M + 0.12 - room) / 0.2, 0.0, 1.0)
    rows, cols, lengths = [], [], []
    for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = (slice(0, mask.shape[0] - dr), slice(max(0, -dc), mask.shape[1] - max(0, dc)))
        b = (slice(dr, mask.shape[0]), slice(max(0, dc), mask.shape[1] + min(0, dc)))
        both = mask[a] & mask[b]
        if dr and dc:  # no cutting of corners
            across = mask[a[0], b[1]] & mask[b[0], a[1]]
            both &= across
        length = math.hypot(dr, dc) * grid.resolution * (weight[a] + weight[b]) / 2.0
        rows.append(node[a][both])
        cols.append(node[b][both])
        lengths.append(length[both])
    i, j, w = np.concatenate(rows), np.concatenate(cols), np.concatenate(lengths)
    count = int(mask.sum())
    one_way = csr_matrix((w, (i, j)), shape=(count, count))
    return one_way + one_way.T, node
