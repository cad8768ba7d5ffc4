"""Numba kernels that build the pyramid of profile boxes, and that read single profiles out of it."""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from galoc._box_code import float_code, log_code
from galoc._vector import load_codes

BINS = 360
SIDE = 8
"""Leaves along a block's side."""
LEAVES = SIDE * SIDE
PHASES = 8
"""Bins are stored by phase: bins p, p + 8, p + 16, ... side by side, so that every 8th ray is read as one vector."""
PHASE_BINS = BINS // PHASES
ROW = 64
"""Codes of a phase: its 45 bins, then the first 15 again for views that reach over 360 degrees, then nothing."""


@njit(inline="always")
def codes_at(boxes, cell, bound, bin):  # type: ignore[no-untyped-def]
    """Codes of 16 bins, 8 apart, from ``bin`` (0..719) on; ``bound`` 0: lower, 1: upper."""
    k = bin >> 3
    if k >= PHASE_BINS:
        k -= PHASE_BINS
    return load_codes(boxes, cell, bound, bin & 7, k)


@njit(cache=True, parallel=True)
def clear_leaves(profiles, clearance):  # type: ignore[no-untyped-def]
    """(B,) uint64: bit m is set where leaf m of a block is nowhere nearer to a wall than ``clearance``.

    Args:
        profiles: (64 B, 360) float32, m.
        clearance: m.
    """
    blocks = profiles.shape[0] // LEAVES
    out = np.zeros(blocks, np.uint64)
    for b in prange(blocks):
        mask = np.uint64(0)
        for m in range(LEAVES):
            nearest = profiles[b * LEAVES + m, 0]
            for j in range(1, BINS):
                nearest = min(nearest, profiles[b * LEAVES + m, j])
            if nearest >= clearance:
                mask |= np.uint64(1) << np.uint64(m)
        out[b] = mask
    return out


@njit(cache=True)
def _encode(low, high, width, log, out):  # type: ignore[no-untyped-def]
    """Boxes over ``width`` consecutive bins, as codes: bin b covers b .. b + width - 1."""
    for b in range(BINS):
        least, most = low[b], high[b]
        for t in range(1, width):
            j = b + t if b + t < BINS else b + t - BINS
            least = min(least, low[j])
            most = max(most, high[j])
        if least > most:  # no leaf below: a box that nothing fits
            lower, upper = np.uint16(65535), np.uint16(0)
        elif log:
            lower, upper = log_code(least, False), log_code(most, True)
        else:
            lower, upper = float_code(least, False), float_code(most, True)
        p, k = b % PHASES, b // PHASES
        out[0, p, k], out[1, p, k] = lower, upper
        if k < ROW - PHASE_BINS:
            out[0, p, k + PHASE_BINS], out[1, p, k + PHASE_BINS] = lower, upper


@njit(cache=True, parallel=True)
def reduce_blocks(profiles, mask, log, width2, width3, boxes2, boxes3, low, high):  # type: ignore[no-untyped-def]
    """Boxes of blocks (8 x 8 leaves) and of their quarters.

    Args:
        profiles: (64 B, 360) float32, m, leaves of a block in Morton order.
        mask: (B,) uint64 from :func:`clear_leaves`; other leaves do not count.
        log: code LOG instead of FLOAT.
        width2: bins of a box of 4 x 4 leaves.
        width3: bins of a box of 8 x 8 leaves.
        boxes2: (4 B, 2, 8, 64) uint16 output, or (0, 2, 8, 64) to skip.
        boxes3: (B, 2, 8, 64) uint16 output.
        low: (B, 360) float32 output: least range over the block's leaves, m.
        high: (B, 360) float32 output: greatest.
    """
    for b in prange(mask.shape[0]):
        low4, high4 = np.empty(BINS, np.float32), np.empty(BINS, np.float32)
        low[b], high[b] = np.inf, -np.inf
        for s in range(4):
            low4[:], high4[:] = np.inf, -np.inf
            for m in range(16 * s, 16 * s + 16):
                if (mask[b] >> np.uint64(m)) & np.uint64(1):
                    for j in range(BINS):
                        low4[j] = min(low4[j], profiles[b * LEAVES + m, j])
                        high4[j] = max(high4[j], profiles[b * LEAVES + m, j])
            if boxes2.shape[0]:
                _encode(low4, high4, width2, log, boxes2[4 * b + s])
            for j in range(BINS):
                low[b, j] = min(low[b, j], low4[j])
                high[b, j] = max(high[b, j], high4[j])
        _encode(low[b], high[b], width3, log, boxes3[b])


@njit(cache=True, parallel=True)
def reduce_cells(low, high, first, width, log, boxes, low_out, high_out):  # type: ignore[no-untyped-def]
    """Boxes of cells that each hold the consecutive rows first[c] .. first[c + 1] - 1.

    Args:
        low: (R, 360) float32, m.
        high: (R, 360) float32, m.
        first: (C + 1,).
        width: bins of a box.
        log: code LOG instead of FLOAT.
        boxes: (C, 2, 8, 64) uint16 output.
        low_out: (C, 360) float32 output.
        high_out: (C, 360) float32 output.
    """
    for c in prange(first.shape[0] - 1):
        low_out[c], high_out[c] = np.inf, -np.inf
        for r in range(first[c], first[c + 1]):
            for j in range(BINS):
                low_out[c, j] = min(low_out[c, j], low[r, j])
                high_out[c, j] = max(high_out[c, j], high[r, j])
        _encode(low_out[c], high_out[c], width, log, boxes[c])
