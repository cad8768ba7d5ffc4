"""Descent through the pyramid: which poses of the lattice the boxes do not rule out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from galoc._frontier_kernel import children, clear_poses
from galoc._pyramid_kernel import LEAVES
from galoc.bound import Bound
from galoc.fine import LeafProfiles
from galoc.planes import plane_leaves
from galoc.pyramid import Float32, Headings, Int, Level, Nodes, Pyramid

CAST_NS = 4000.0
"""Rough cost of casting a profile, ns."""
PART = 256
"""Blocks scored between two looks at the clock."""
SURVIVE = 0.3
"""Share of children that survives, roughly: for the choice between testing on and scoring densely."""


@dataclass(frozen=True, slots=True, eq=False)
class Remainder:
    """What has to be scored."""

    leaves: Int
    """(N,) leaves of single poses."""
    headings: Headings
    """(N,) their headings, degrees."""
    blocks: Int
    """(D,) blocks that are to be scored densely: so much of them is left that this is cheaper."""
    boxes: int
    """Boxes tested."""
    leaf_limits: Float32 | None = None
    """(N,) what each pose can score at most; None: not asked for."""
    block_limits: Float32 | None = None
    """(D,) what a pose of each block can score at most."""
    limit: float = math.inf
    """What any of this can score at most."""

    @classmethod
    def nothing(cls) -> Remainder:
        """Nothing is left."""
        none = np.zeros(0, np.float32)
        return cls(np.zeros(0, np.int64), np.zeros(0, np.int16), np.zeros(0, np.int64), 0, none, none)

    def in_order(self) -> Iterator[Remainder]:
        """All of it in parts of some blocks, the most promising first; in one part where the limits are not known."""
        if self.leaf_limits is None or self.block_limits is None:
            yield self
            return
        own = self.leaves // LEAVES
        of_block = np.full(int(max(own.max(initial=0), self.blocks.max(initial=0))) + 1, -np.inf, np.float32)
        np.maximum.at(of_block, own, self.leaf_limits)
        of_block[self.blocks] = self.block_limits
        order = np.argsort(-of_block, kind="stable")[: int(np.count_nonzero(of_block > -np.inf))]
        part_of = np.full(len(of_block), -1, np.int64)
        part_of[order] = np.arange(len(order)) // PART
        for k in range(-(-len(order) // PART)):
            here = part_of[own] == k
            blocks = self.blocks[part_of[self.blocks] == k]
            yield Remainder(self.leaves[here], self.headings[here], blocks, 0, limit=float(of_block[order[k * PART]]))


def descend(bound: Bound, pyramid: Pyramid, profiles: LeafProfiles, score: float, *, limits: bool = False) -> Remainder:
    """Every pose that may reach a score.

    The cost is bounded: where the boxes rule out too little of a block, it is not descended into any further.

    Args:
        bound: the observation.
        pyramid: of the plan.
        profiles: of the leaves.
        score: to be reached.
        limits: also find what each remaining pose can score at most.
    """
    levels = pyramid.levels
    per_leaf = 360.0 * bound.dense_ns + CAST_NS * (1.0 - profiles.share)
    most = _most_nodes(bound, levels, per_leaf)
    nodes = bound.roots(levels[0], score)
    boxes = len(levels[0].boxes) * 360 // levels[0].width
    dense: list[Int] = []
    for k, level in enumerate(levels):
        if k:
            above = levels[k - 1]
            cells, headings, parents = children(nodes.cells, nodes.headings, above.first, above.width, level.width)
            scales = None if nodes.scales is None else nodes.scales[parents]
            boxes += len(cells)
            nodes = bound.nodes(level, Nodes(cells, headings, scales), score)
        blocks, nodes = _crowded(level, nodes, most[k])
        dense.append(blocks)
    view = bound.planes(score)
    if view is None:
        cells, headings, parents = children(nodes.cells, nodes.headings, levels[-1].first, levels[-1].width, 1)
        leaves, headings, parents = clear_poses(cells, headings, parents, pyramid.mask)
    else:
        poses = LEAVES * per_leaf / bound.leaf_ns
        leaves, headings, parents, blocks = plane_leaves(view, pyramid, profiles, levels[-1], nodes, poses)
        dense.append(blocks)
    blocks = np.concatenate(dense)
    if not limits:
        return Remainder(leaves, headings, blocks, boxes)
    most_of_blocks = np.full(len(blocks), bound.most, np.float32)
    return Remainder(leaves, headings, blocks, boxes, bound.limits(levels[-1], nodes)[parents], most_of_blocks)


def _most_nodes(bound: Bound, levels: tuple[Level, ...], per_leaf: float) -> list[float]:
    """For each level: nodes of a cell beyond which scoring all its poses is cheaper than going on with them.

    Args:
        bound: with the costs of its steps.
        levels: coarsest first.
        per_leaf: cost of scoring a leaf at all headings, ns.
    """
    cost = bound.last_ns
    most = [max(levels[-1].leaves, LEAVES) * per_leaf / cost]
    for level, below in zip(levels[-2::-1], levels[:0:-1], strict=True):
        fan = level.leaves / below.leaves * level.width / below.width
        cost = fan * (bound.node_ns + SURVIVE * cost)
        most.append(level.leaves * per_leaf / cost)
    return most[::-1]


def _crowded(level: Level, nodes: Nodes, limit: float) -> tuple[Int, Nodes]:
    """Blocks of cells with more nodes than the limit, and the nodes elsewhere."""
    inner = LEAVES // level.leaves if level.leaves < LEAVES else 1  # cells of a block
    owner = nodes.cells // inner
    count = np.bincount(owner, minlength=len(level.boxes) // inner)
    crowded = count > limit
    if not crowded.any():
        return np.zeros(0, np.int64), nodes
    cells = np.flatnonzero(crowded)
    if level.first_block is None:
        blocks = cells
    else:
        blocks = np.concatenate([np.arange(level.first_block[c], level.first_block[c + 1]) for c in cells])
    return blocks, nodes.chosen(~crowded[owner])
