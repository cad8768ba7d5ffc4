"""Shortest ways over a map's free space, and the moves that walk them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc import Floorplan, GalocError
from galoc_agents.moves import FORWARD, LEFT, RIGHT, STEP_M, TURN_RAD, TURNS_AROUND
from galoc_env import motion
from galoc_env.motion import BODY_RADIUS

Array = NDArray[np.float64]

CELL_M = 0.1
"""Grid on which ways are sought, m."""
MAX_CELLS = 60_000
"""Ways are sought on coarser cells in plans with more than this."""
MARGIN_M = 0.02
"""Ways keep this much more than the body's radius from walls, m."""
TOUCH_M = 0.01
"""A step that comes closer to a wall than this might end there, m."""
WIDE_M = 0.2
"""Within this of the nearest that the body can get to a wall, metres count double at most: ways keep off walls."""
OBSTACLE_M = 0.35
"""An obstacle reaches this far: the body's radius and a little, m."""
OBSTACLE_COST = 12.0
"""What each metre near an obstacle costs more. Finite: a wrong obstacle must not shut a door for good."""
ARRIVED_M = 0.25
"""Closer to a goal than this is there, m."""
TURN_COST_M = 0.1
"""What a turn costs against walking, m: keeps the way from zigzagging."""
MOST_MOVES = 400
"""Longer ways are cut."""


class Paths:
    """Ways over the free space of a plan in which the body fits.

    Args:
        plan: the map.

    Raises:
        GalocError: the body fits nowhere.
    """

    def __init__(self, plan: Floorplan) -> None:
        cell = CELL_M
        while True:
            free = plan.free_space(cell)
            mask = free.largest_room(BODY_RADIUS + MARGIN_M)
            if np.count_nonzero(mask) <= MAX_CELLS:
                break
            cell *= 1.25
        if not mask.any():
            raise GalocError(f"plan {plan.name!r}", f"room for a body of {BODY_RADIUS} m", "Check the plan's scale.")
        self.plan = plan
        """The map."""
        self._origin, self._cell = np.asarray(free.origin, dtype=np.float64), float(free.resolution)
        rows, cols = np.nonzero(mask)
        self.positions: Array = self._origin + (np.stack([cols, rows], axis=1) + 0.5) * self._cell
        """(N, 2) m: cells where the body fits."""
        self._node: NDArray[np.int64] = np.full(mask.shape, -1, np.int64)
        self._node[mask] = np.arange(len(rows))
        spare = free.clearance[mask] - (BODY_RADIUS + MARGIN_M)
        self._plain = 1.0 + np.clip(1.0 - spare / WIDE_M, 0.0, 1.0)
        self._weight = self._plain
        self._ends, self._lengths = _edges(self._node, self._cell)
        self._build()

    def obstruct(self, obstacles: ArrayLike, walked: ArrayLike = ()) -> None:
        """Keep off places where there is another way; those of before are forgotten.

        Args:
            obstacles: (K, 2) m.
            walked: (W, 2) m, where the body has been: free, whatever is near.
        """
        places = np.asarray(obstacles, dtype=np.float64).reshape(-1, 2)
        if len(places) == 0 and self._weight is self._plain:
            return
        self._weight = self._plain
        if len(places):
            near = np.zeros(len(self.positions))
            for place in places:
                near += np.sum((self.positions - place) ** 2, axis=1) < OBSTACLE_M**2
            near[self._around(np.asarray(walked, dtype=np.float64).reshape(-1, 2))] = 0.0
            self._weight = self._plain + OBSTACLE_COST * near
        self._build()

    def node(self, xy: ArrayLike) -> int:
        """Index of the cell that holds a point (2,), or the nearest one to it."""
        point = np.asarray(xy, dtype=np.float64)
        col, row = np.floor((point - self._origin) / self._cell).astype(int)
        if 0 <= row < self._node.shape[0] and 0 <= col < self._node.shape[1] and self._node[row, col] >= 0:
            return int(self._node[row, col])
        return int(np.argmin(np.sum((self.positions - point) ** 2, axis=1)))

    def distance(self, xy: ArrayLike) -> Array:
        """(N,) m: length of the way from a point (2,) to each cell, longer along walls and near obstacles."""
        from scipy.sparse.csgraph import dijkstra

        return np.asarray(dijkstra(self._graph, indices=self.node(xy)))

    def next_move(self, pose: ArrayLike, distance: Array) -> int | None:
        """The next move down the way to a goal.

        Args:
            pose: (3,) m, m, rad.
            distance: from the goal, see :meth:`distance`.

        Returns:
            ``FORWARD``, ``LEFT`` or ``RIGHT``; None: there, or no step of any direction leads closer.
        """
        at = np.asarray(pose, dtype=np.float64)
        here = float(distance[self.node(at[:2])])
        if here < ARRIVED_M:
            return None
        best, best_cost = None, math.inf
        for turns in range(1 - TURNS_AROUND // 2, 1 + TURNS_AROUND // 2):
            bearing = at[2] + turns * TURN_RAD
            shift = STEP_M * np.array([math.cos(bearing), math.sin(bearing)])
            left = self._after(at[:2], shift, distance)
            cost = left + TURN_COST_M * abs(turns)
            if left < here - 0.05 and cost < best_cost:
                best, best_cost = turns, cost
        if best is None:
            return None
        return FORWARD if best == 0 else LEFT if best > 0 else RIGHT

    def moves_to(self, pose: ArrayLike, goal_xy: ArrayLike) -> list[int]:
        """The moves from a pose (3,) to within ``ARRIVED_M`` of a goal (2,), or to where they end."""
        return self.moves_down(pose, self.distance(goal_xy), MOST_MOVES)

    def moves_down(self, pose: ArrayLike, distance: Array, count: int) -> list[int]:
        """The first so many of the moves from a pose (3,) down the way to a goal, see :meth:`next_move`."""
        at, moves = np.array(pose, dtype=np.float64), list[int]()
        while len(moves) < count and (move := self.next_move(at, distance)) is not None:
            moves.append(move)
            if move == FORWARD:
                at[:2] += STEP_M * np.array([math.cos(at[2]), math.sin(at[2])])
            else:
                at[2] += TURN_RAD if move == LEFT else -TURN_RAD
        return moves

    def _around(self, points: Array) -> NDArray[np.int64]:
        """The cells that hold points (W, 2), and those next to them."""
        cell = np.floor((points - self._origin) / self._cell).astype(np.int64)
        ring = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
        cols, rows = (cell[:, None] + ring).reshape(-1, 2).T
        height, width = self._node.shape
        within = (rows >= 0) & (rows < height) & (cols >= 0) & (cols < width)
        node = self._node[rows[within], cols[within]]
        return node[node >= 0]

    def _after(self, start: Array, shift: Array, distance: Array) -> float:
        """What is left of the way after a step; infinite where the body would touch a wall of the map."""
        if motion.free_fraction(start, shift, self.plan.segments, BODY_RADIUS + TOUCH_M) < 1.0:
            return math.inf
        end = start + shift
        node = self.node(end)
        off = float(np.hypot(*(self.positions[node] - end)))
        return math.inf if off > 2.0 * self._cell else float(distance[node]) + off

    def _build(self) -> None:
        """The graph, with what a metre costs in each cell."""
        from scipy.sparse import csr_matrix

        i, j = self._ends
        cost = self._lengths * (self._weight[i] + self._weight[j]) / 2.0
        count = len(self.positions)
        self._graph = csr_matrix((cost, (i, j)), shape=(count, count))


def _edges(node: NDArray[np.int64], cell: float) -> tuple[NDArray[np.int64], Array]:
    """(2, E) neighbouring cells, each pair both ways, and (E,) how far apart they are, m."""
    pairs, lengths = [], []
    height, width = node.shape
    for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = node[: height - dr, max(0, -dc) : width - max(0, dc)]
        b = node[dr:, max(0, dc) : width + min(0, dc)]
        both = (a >= 0) & (b >= 0)
        pairs.append(np.stack([a[both], b[both]]))
        lengths.append(np.full(np.count_nonzero(both), math.hypot(dr, dc) * cell))
    ends, apart = np.concatenate(pairs, axis=1), np.concatenate(lengths)
    return np.concatenate([ends, ends[::-1]], axis=1), np.concatenate([apart, apart])
