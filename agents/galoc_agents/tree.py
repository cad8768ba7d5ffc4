"""The ways a body can go from where it is: a tree of poses, action by action."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc import Floorplan
from galoc_agents._reach_kernel import choose, reach
from galoc_agents.frames import relative
from galoc_agents.moves import STEP_M, TURNS_AROUND
from galoc_env.motion import BODY_RADIUS

Array = NDArray[np.float64]

CLEARANCE_M = BODY_RADIUS + 0.02
"""Distance kept from walls, m."""
BUMP_M = 0.15
"""Distance kept from places that turned out to be taken, m: what is there may be slim."""
CELL_M = 0.15
"""Of the states of one cell and direction only the first is followed up, m."""
NEAR_ACTIONS = 6
"""Views so many actions away are near, ..."""
BLOCKS_M = (0.5, 1.2)
"""... and one view is considered per block of this size, near and far, ..."""
SECTORS = (12, 4)
"""... and sector of directions."""
MOST_STATES = 40_000
"""Searches end at this many states: some 20 rooms."""
MAP_M = 0.05
"""Grid of the clearance, m."""


@dataclass(frozen=True, slots=True, eq=False)
class Tree:
    """Ways from one pose; node 0 is that pose."""

    motion: Array
    """(M, 3) from node 0 to each node, in the body frame of node 0: m, m, rad."""
    parent: NDArray[np.int32]
    """(M,) node before, -1 for node 0; parents come before their children."""
    move: NDArray[np.int32]
    """(M,) discrete action from there, -1 for node 0."""
    depth: NDArray[np.int32]
    """(M,) actions from node 0."""

    @classmethod
    def grow(cls, plan: Floorplan, pose: Array, bumps: Array, deepest: int, most: int) -> Tree:
        """All ways on a map, thinned out to places and directions that differ.

        Args:
            plan: the map.
            pose: (3,) where the body is.
            bumps: (B, 2) m: places that are taken by what is not on the map.
            deepest: actions at most.
            most: nodes, the nearest first; no more ways are taken beyond that, but the last one is whole.
        """
        free = plan.free_space(MAP_M)
        states = reach(
            pose, free.clearance, free.origin, free.resolution, CLEARANCE_M, np.ascontiguousarray(bumps), BUMP_M,
            CELL_M, TURNS_AROUND, STEP_M,
            deepest, MOST_STATES,
        )  # fmt: skip
        taken = choose(
            states[0], states[1], states[3], free.origin, TURNS_AROUND, NEAR_ACTIONS, np.array(BLOCKS_M),
            np.array(SECTORS), most,
        )  # fmt: skip
        where = np.full(len(states[0]), -1, np.int32)
        where[taken] = np.arange(len(taken), dtype=np.int32)
        poses, parent = states[0][taken], states[1][taken]
        parent = np.where(parent >= 0, where[np.maximum(parent, 0)], -1).astype(np.int32)
        return cls(relative(pose, poses), parent, states[2][taken], states[3][taken])

    def first_move(self, node: int) -> int:
        """The action that starts the way to a node other than 0."""
        while self.parent[node] > 0:
            node = int(self.parent[node])
        return int(self.move[node])

    def cost(self, entropy: Array, horizon: int) -> Array:
        """(M,) sum over a horizon of the entropy that is left if one goes to a node and stays.

        Args:
            entropy: (M,) expected at each node, nats.
            horizon: actions.
        """
        along = np.zeros(len(entropy))
        for node in range(1, len(entropy)):
            along[node] = along[self.parent[node]] + entropy[node]
        return np.asarray(along + np.maximum(horizon - self.depth, 0) * entropy)
