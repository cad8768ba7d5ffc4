"""The pyramid: boxes of range profiles over ever larger cells of position and heading.

A box holds, for every bin, the least and the greatest range that any pose of its cell sees there. The cells are 0.32 m
x 8 degrees on top and halve from level to level down to 0.04 m x 1 degree (for leaves 0.01 m apart); on large plans
the lowest level is left out, so that the pyramid stays below ``LIMIT``. It is built tile by tile and kept on disk.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc._plane_kernel import linear_bins
from galoc._pyramid_kernel import LEAVES, PHASES, ROW, clear_leaves, reduce_blocks, reduce_cells
from galoc.cache import Arrays, DiskCache, content_key
from galoc.fine import COARSEST, LEAF_X, LEAF_Y, SIDE, FineGrid
from galoc.floorplan import Floorplan
from galoc.profiles import CASTER_VERSION, CLEARANCE, Caster

Int = NDArray[np.int64]
Float32 = NDArray[np.float32]
Headings = NDArray[np.int16]
Codes = NDArray[np.uint16]

WIDTHS = (1, 1, 1, 2, 4, 8)
"""Degrees of heading of a node at level 0 (leaves) .. 5. Level 1, 2 x 2 leaves, would not pay: scoring four poses costs
no more than testing their box."""
TOP = 5
"""Coarsest level: cells of 32 x 32 leaves."""
BLOCK = 3
"""Level of the blocks, 8 x 8 leaves."""
LIMIT = 1 << 30
"""Most bytes of a pyramid: level 2 is left out beyond."""
BOX = 2 * PHASES * ROW * 2
"""Bytes of a box."""
VERSION = 4
"""Part of the cache's key: counted up when the boxes change."""
CHUNK = 256
"""Blocks cast at once (24 MB of profiles)."""


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """Boxes of one level, in Morton order."""

    boxes: Codes
    """(C, 2, 8, 64) uint16: lower and upper codes (galoc._box_code) of each bin, by phase (galoc._pyramid_kernel)."""
    width: int
    """Degrees of heading of a node: box bin b covers bins b .. b + width - 1."""
    first: Int
    """(C + 1,) first child of each cell on the next stored level (or leaf, on the lowest)."""
    leaves: int
    """Leaves of a whole cell."""
    first_block: Int | None
    """(C + 1,) first block of each cell, where a cell holds several."""

    def every_node(self) -> Nodes:
        """All nodes of the level, cell by cell."""
        headings = np.arange(0, 360, self.width, dtype=np.int16)
        cells = np.arange(len(self.boxes), dtype=np.int32)
        return Nodes(np.repeat(cells, len(headings)), np.tile(headings, len(cells)))


@dataclass(frozen=True, slots=True, eq=False)
class Nodes:
    """Nodes of one level."""

    cells: NDArray[np.int32]
    """(N,) cell of the level."""
    headings: Headings
    """(N,) first whole degree of heading."""
    scales: Float32 | None = None
    """(N, 2) log scales that may still do, where the scoring narrows them down."""

    def __len__(self) -> int:
        """N."""
        return len(self.cells)

    def chosen(self, keep: NDArray[np.bool_]) -> Nodes:
        """Those where ``keep`` is set."""
        scales = None if self.scales is None else self.scales[keep]
        return Nodes(self.cells[keep], self.headings[keep], scales)


@dataclass(frozen=True, slots=True, eq=False)
class Pyramid:
    """Boxes of one plan at one resolution."""

    grid: FineGrid
    """The leaves."""
    mask: NDArray[np.uint64]
    """(B,) bit m: leaf m of the block keeps a camera's clearance."""
    levels: tuple[Level, ...]
    """Coarsest first."""
    linear: NDArray[np.uint8] | None
    """(B, 45) bins in which the range is linear over a block, as bits (see galoc._plane_kernel); None with boxes of log
    ranges."""
    seeds: Int
    """(S,) a leaf near the middle of each top cell, -1 where none is clear."""
    seed_profiles: Float32
    """(S, 360) their ranges, m."""

    @property
    def positions(self) -> int:
        """Number of leaves that keep the clearance."""
        return int(np.bitwise_count(self.mask).sum())

    def is_clear(self, leaves: Int) -> NDArray[np.bool_]:
        """(P,) whether these leaves keep the clearance."""
        return (self.mask[leaves // LEAVES] >> (leaves % LEAVES).astype(np.uint64) & np.uint64(1)).astype(bool)

    def leaves(self) -> Int:
        """(P,) all leaves that keep the clearance."""
        bits = self.mask[:, None] >> np.arange(LEAVES, dtype=np.uint64) & np.uint64(1)
        return np.flatnonzero(bits.ravel())


def build_pyramid(plan: Floorplan, resolution: float, *, log: bool, limit: int = LIMIT) -> Pyramid:
    """The pyramid of a plan: from the disk cache, or built (some 5 us a leaf and core) and kept there.

    Args:
        plan: the map.
        resolution: step of the leaves, m.
        log: boxes of log ranges (for the likelihood) instead of ranges (for the cosine).
        limit: bytes of boxes beyond which the lowest levels are left out.

    Raises:
        GalocError: as :meth:`galoc.fine.FineGrid.of`.
    """
    grid = FineGrid.of(plan, resolution)
    starts = [_starts(grid.blocks, side) for side in (2, COARSEST)]
    counts = {BLOCK: len(grid.blocks), BLOCK + 1: len(starts[0]) - 1, TOP: len(starts[1]) - 1}
    if log and (sum(counts.values()) + 4 * len(grid.blocks)) * BOX <= limit:
        counts[2] = 4 * len(grid.blocks)
    stored = sorted(counts, reverse=True)
    specs: dict[str, tuple[tuple[int, ...], Any]] = {
        f"boxes{level}": ((counts[level], 2, PHASES, ROW), np.uint16) for level in stored
    }
    specs |= {"mask": ((len(grid.blocks),), np.uint64), "seeds": ((counts[TOP],), np.int64)}
    specs |= {"seed_profiles": ((counts[TOP], 360), np.float32)}
    if not log:
        specs["linear"] = ((len(grid.blocks), 45), np.uint8)
    work = _Work(plan, grid, log, starts)
    key = content_key(
        "pyramid",
        VERSION,
        CASTER_VERSION,
        plan.segments,
        grid.blocks,
        grid.inside,
        resolution,
        CLEARANCE,
        int(log),
        *stored,
    )
    kind = "log ranges" if log else "ranges"
    note = f"pyramid of {plan.name or 'a plan'}, {kind} at {resolution:g} m"
    arrays = DiskCache().fetch_filled(key, specs, work.fill, note)
    levels = []
    for level, below in zip(stored, [*stored[1:], 0], strict=True):
        if level == TOP:
            first = _compressed(starts[1], starts[0])
        elif level == TOP - 1:
            first = starts[0]
        else:
            first = np.arange(counts[level] + 1, dtype=np.int64) * 4 ** (level - below)
        blocks = {TOP: starts[1], TOP - 1: starts[0]}.get(level)
        levels.append(Level(arrays[f"boxes{level}"], WIDTHS[level], first, 4**level, blocks))
    return Pyramid(grid, arrays["mask"], tuple(levels), arrays.get("linear"), arrays["seeds"], arrays["seed_profiles"])


def _starts(blocks: Int, side: int) -> Int:
    """(C + 1,) first block of each cell of side x side blocks; blocks in Morton order."""
    cell = blocks // side - blocks.min(axis=0) // COARSEST * COARSEST // side
    new = np.any(np.diff(cell, axis=0) != 0, axis=1)
    return np.concatenate([[0], np.flatnonzero(new) + 1, [len(blocks)]]).astype(np.int64)


def _compressed(coarse: Int, fine: Int) -> Int:
    """First cell of the finer grouping in each of the coarser, both given by their first blocks."""
    return np.searchsorted(fine, coarse).astype(np.int64)


class _Work:
    """Fills the arrays of a pyramid."""

    def __init__(self, plan: Floorplan, grid: FineGrid, log: bool, starts: list[Int]) -> None:
        self._plan, self._grid, self._log, self._starts = plan, grid, log, starts

    def fill(self, arrays: Arrays) -> None:
        """Cast every leaf once; only boxes are kept."""
        from tqdm import tqdm

        caster = Caster(self._plan)
        two, four = self._starts
        in_four = _compressed(four, two)
        label = f"profiles of {self._plan.name or 'the plan'}"
        # Shown only where it takes long enough to wonder, and where somebody looks.
        with tqdm(total=len(self._grid.blocks), unit="block", desc=label, delay=2.0, disable=None) as bar:
            cell = 0
            while cell < len(four) - 1:
                stop = max(cell + 1, int(np.searchsorted(four, four[cell] + CHUNK, side="right")) - 1)
                self._part(arrays, caster, (cell, stop), (int(in_four[cell]), int(in_four[stop])))
                bar.update(int(four[stop] - four[cell]))
                cell = stop

    def _part(self, arrays: Arrays, caster: Caster, top: tuple[int, int], middle: tuple[int, int]) -> None:
        """Whole cells of the top level."""
        two, four = self._starts
        b0, b1 = int(four[top[0]]), int(four[top[1]])
        leaves = np.arange(b0 * LEAVES, b1 * LEAVES)
        profiles = caster(self._grid.positions(leaves))
        mask = clear_leaves(profiles, np.float32(CLEARANCE)) & self._grid.inside[b0:b1]
        arrays["mask"][b0:b1] = mask
        if not self._log:
            arrays["linear"][b0:b1] = linear_bins(profiles, mask, LEAF_X.astype(np.float64), LEAF_Y.astype(np.float64))
        low, high = (np.empty((b1 - b0, 360), np.float32) for _ in range(2))
        boxes = arrays["boxes2"][4 * b0 : 4 * b1] if "boxes2" in arrays else np.empty((0, 2, PHASES, ROW), np.uint16)
        reduce_blocks(profiles, mask, self._log, WIDTHS[2], WIDTHS[3], boxes, arrays["boxes3"][b0:b1], low, high)
        for level, (c0, c1), first in ((4, middle, two - b0), (5, top, _compressed(four, two) - middle[0])):
            low_out, high_out = (np.empty((c1 - c0, 360), np.float32) for _ in range(2))
            reduce_cells(
                low, high, first[c0 : c1 + 1], WIDTHS[level], self._log, arrays[f"boxes{level}"][c0:c1],
                low_out, high_out,
            )  # fmt: skip
            low, high = low_out, high_out
        self._plant(arrays, profiles, mask, b0, b1)

    def _plant(self, arrays: Arrays, profiles: Float32, mask: NDArray[np.uint64], b0: int, b1: int) -> None:
        """Choose the clear leaf nearest the middle of each top cell."""
        cells = self._starts[1]
        bits = (mask[:, None] >> np.arange(LEAVES, dtype=np.uint64) & np.uint64(1)).astype(bool)
        place = (self._grid.blocks[b0:b1, None] * SIDE + np.stack([LEAF_X, LEAF_Y], axis=1)).astype(np.float64)
        for c in range(int(np.searchsorted(cells, b0)), int(np.searchsorted(cells, b1))):
            own = slice(int(cells[c]) - b0, int(cells[c + 1]) - b0)
            middle = (place[own].min(axis=(0, 1)) + place[own].max(axis=(0, 1))) / 2.0
            far = np.where(bits[own], np.sum((place[own] - middle) ** 2, axis=2), np.inf).ravel()
            leaf = int(np.argmin(far)) + own.start * LEAVES
            arrays["seeds"][c] = leaf + b0 * LEAVES if np.isfinite(far.min()) else -1
            arrays["seed_profiles"][c] = profiles[leaf]
