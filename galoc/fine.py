"""The fine lattice: positions a centimetre apart, in blocks of 8 x 8, and their profiles, cast when they are needed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc._pyramid_kernel import LEAVES, SIDE
from galoc.errors import GalocError
from galoc.floorplan import Floorplan
from galoc.freespace import MAX_CELLS
from galoc.profiles import CLEARANCE, Caster

Array = NDArray[np.float64]
Int = NDArray[np.int64]
Float32 = NDArray[np.float32]

_M = np.arange(LEAVES)
LEAF_X = (_M & 1) | (_M >> 1 & 2) | (_M >> 2 & 4)
"""(64,) column of a leaf in its block: leaves are in Morton order, so that the four of a 2 x 2 cell are neighbours."""
LEAF_Y = (_M >> 1 & 1) | (_M >> 2 & 2) | (_M >> 3 & 4)
"""(64,) row of a leaf in its block."""
_MORTON = np.empty((SIDE, SIDE), np.int64)
_MORTON[LEAF_Y, LEAF_X] = _M
CELL = 0.1
"""Widest cell of the free space that blocks are taken from, m: a cell that a wall runs through holds no leaf with the
clearance of a camera."""
MOST_BLOCKS = 1 << 21
"""Most blocks of a lattice: boxes take some 2.6 kB each, casting their profiles 0.3 ms."""
COARSEST = 4
"""Blocks along the side of the coarsest cell of the pyramid."""


def _spread(value: Int) -> Int:
    """The bits of 20-bit numbers at every second place."""
    out = value.copy()
    for shift, mask in ((16, 0x0000FFFF0000FFFF), (8, 0x00FF00FF00FF00FF), (4, 0x0F0F0F0F0F0F0F0F)):
        out = (out | out << shift) & mask
    for shift, mask in ((2, 0x3333333333333333), (1, 0x5555555555555555)):
        out = (out | out << shift) & mask
    return out


@dataclass(frozen=True, slots=True, eq=False)
class FineGrid:
    """Lattice of leaves. Leaf 64 b + m is the m-th, in Morton order, of block b; its index in x is that times 8, ..."""

    resolution: float
    """Step of the lattice, m."""
    blocks: Int
    """(B, 2) column and row of each block in the lattice of blocks, in Morton order."""
    corner: Int
    """(2,) column and row of the block at index [0, 0]."""
    index: NDArray[np.int32]
    """(H, W) which block lies there, -1 for none."""
    inside: NDArray[np.uint64]
    """(B,) bit m: leaf m of the block is not known to lie outside the building or in a wall."""

    @classmethod
    def of(cls, plan: Floorplan, resolution: float) -> FineGrid:
        """The blocks that can hold a camera.

        A leaf with the clearance of a camera lies in a cell of the free space, at most ``CELL`` wide, whose centre is
        inside and has that clearance less half a diagonal: no wall fits between the two.

        Raises:
            GalocError: the plan is too large, or too large for this resolution, or has no free space.
        """
        side = SIDE * resolution
        parts = math.ceil(side / CELL - 1e-9)
        free = plan.free_space(side / parts)
        if free.resolution > CELL * (1.0 + 1e-9):
            x0, y0, x1, y1 = plan.bounds
            raise GalocError(
                f"an exact search over a plan of {x1 - x0:.0f} m x {y1 - y0:.0f} m",
                f"at most {MAX_CELLS * CELL**2:.0f} m2, walls and margins included",
                "Cut the plan into parts.",
            )
        ok = free.inside & (free.clearance >= CLEARANCE - 0.71 * free.resolution)
        rows, cols = np.nonzero(ok)
        if len(rows) == 0:
            raise GalocError(
                f"plan {plan.name!r} without free space",
                f"walls that enclose room for a camera ({CLEARANCE} m of clearance)",
                "Check the scale and that the walls close; draw the plan with `galoc plan FILE`.",
            )
        corner = np.round(free.origin / free.resolution).astype(np.int64)
        blocks = np.unique((np.stack([cols, rows], axis=1) + corner) // parts, axis=0)
        if len(blocks) > MOST_BLOCKS:
            coarser = math.ceil(100.0 * resolution * math.sqrt(len(blocks) / MOST_BLOCKS)) / 100.0
            raise GalocError(
                f"a lattice of {len(blocks) * LEAVES:,} positions, {resolution:g} m apart",
                f"at most {MOST_BLOCKS * LEAVES:,}",
                f"Use a resolution of {coarser:g} m, or cut the plan into parts.",
            )
        base = blocks.min(axis=0) // COARSEST * COARSEST
        blocks = blocks[np.argsort(_spread(blocks[:, 0] - base[0]) | _spread(blocks[:, 1] - base[1]) << 1)]
        width, height = blocks.max(axis=0) + 1 - base
        index = np.full((height, width), -1, np.int32)
        index[blocks[:, 1] - base[1], blocks[:, 0] - base[0]] = np.arange(len(blocks))
        padded = np.pad(ok, parts)
        leaf = ((np.stack([LEAF_X, LEAF_Y], axis=1) + 0.5) * parts / SIDE).astype(np.int64)
        inside = np.empty(len(blocks), np.uint64)
        for part in range(0, len(blocks), 1 << 16):  # all at once would take a kilobyte a block
            cell = blocks[part : part + (1 << 16), None] * parts + leaf - corner + parts
            bits = padded[cell[..., 1], cell[..., 0]].astype(np.uint64) << _M.astype(np.uint64)
            np.bitwise_or.reduce(bits, axis=1, out=inside[part : part + (1 << 16)])
        return cls(resolution, blocks, base, index, inside)

    def cells(self, leaves: Int) -> Int:
        """(P, 2) column and row of leaves (P,) in the whole lattice."""
        block, m = np.divmod(np.asarray(leaves, dtype=np.int64), LEAVES)
        return np.asarray(SIDE * self.blocks[block] + np.stack([LEAF_X[m], LEAF_Y[m]], axis=-1))

    def positions(self, leaves: Int) -> Array:
        """(P, 2) m: positions of leaves (P,)."""
        return np.asarray((self.cells(leaves) + 0.5) * self.resolution)

    def find(self, cells: Int) -> Int:
        """(P,) leaves at columns and rows (P, 2) of the lattice; -1 outside the blocks."""
        block = cells // SIDE - self.corner
        height, width = self.index.shape
        inside = (block >= 0).all(axis=1) & (block[:, 0] < width) & (block[:, 1] < height)
        found = np.where(inside, self.index[np.where(inside, block[:, 1], 0), np.where(inside, block[:, 0], 0)], -1)
        x, y = (cells % SIDE).T
        return np.where(found >= 0, found.astype(np.int64) * LEAVES + _MORTON[y, x], -1)


class LeafProfiles:
    """Profiles of blocks, cast when first needed; those not used for longest make room for others.

    Args:
        grid: the lattice.
        caster: of the plan.
        limit_bytes: memory for profiles.
    """

    def __init__(self, grid: FineGrid, caster: Caster, limit_bytes: int) -> None:
        self._grid, self._caster = grid, caster
        size = LEAVES * 360 * 4
        self.capacity = int(min(len(grid.blocks), max(64, limit_bytes // size)))
        """Blocks that fit."""
        self._slot = np.full(len(grid.blocks), -1, np.int64)
        self._block = np.full(self.capacity, -1, np.int64)
        self._used = np.zeros(self.capacity, np.int64)
        self._clock = 0
        # Pages are only taken from the system once they are written.
        self._store = np.empty((self.capacity, LEAVES, 360), np.float32)

    @property
    def rows(self) -> Float32:
        """(64 capacity, 360) m: where :meth:`fetch` puts profiles."""
        return self._store.reshape(-1, 360)

    def fetch(self, leaves: Int) -> Int:
        """(P,) rows of these leaves' profiles, valid until the next call.

        Raises:
            ValueError: more than ``capacity`` blocks at once.
        """
        block = leaves // LEAVES
        flag = np.zeros(len(self._slot), bool)
        flag[block] = True
        need = np.flatnonzero(flag)
        slot = self._slot[need]
        self._clock += 1
        self._used[slot[slot >= 0]] = self._clock
        missing = need[slot < 0]
        if len(missing):
            self._cast(missing)
        return np.asarray(self._slot[block] * LEAVES + leaves % LEAVES)

    def batches(self, leaves: Int) -> Iterator[tuple[Int, Int]]:
        """All of these leaves, in parts that fit: which of them, and the rows of their profiles until the next part."""
        block = leaves // LEAVES
        flag = np.zeros(len(self._slot), bool)
        flag[block] = True
        need = int(np.count_nonzero(flag))
        if need <= self.capacity:
            yield np.arange(len(leaves)), self.fetch(leaves)
            return
        part = np.cumsum(flag) // max(1, self.capacity // 2)
        own = part[block]
        for k in range(int(part[-1]) + 1):
            which = np.flatnonzero(own == k)
            if len(which):
                yield which, self.fetch(leaves[which])

    def look(self, leaves: Int) -> Float32:
        """(P, 360) m: profiles of single leaves, of blocks that are there or cast and not kept."""
        slot = self._slot[leaves // LEAVES]
        there = slot >= 0
        out = np.empty((len(leaves), 360), np.float32)
        out[there] = self._store[slot[there], leaves[there] % LEAVES]
        if not there.all():
            out[~there] = self._caster(self._grid.positions(leaves[~there]))
        return out

    @property
    def share(self) -> float:
        """Share of the blocks whose profiles are there."""
        return float(np.count_nonzero(self._slot >= 0)) / len(self._slot)

    def _cast(self, missing: Int) -> None:
        order = np.argsort(self._used, kind="stable")[: len(missing)]
        if len(missing) > self.capacity or np.any(self._used[order] == self._clock):
            raise ValueError(f"{len(missing)} blocks more at once than fit")
        gone = self._block[order]
        self._slot[gone[gone >= 0]] = -1
        self._slot[missing], self._block[order], self._used[order] = order, missing, self._clock
        for part in range(0, len(missing), 256):
            blocks = missing[part : part + 256]
            leaves = (blocks[:, None] * LEAVES + np.arange(LEAVES)).ravel()
            ranges = self._caster(self._grid.positions(leaves))
            self._store[order[part : part + 256]] = ranges.reshape(-1, LEAVES, 360)
