"""Numba kernels of the plane test: which poses of a block the walls that it sees leave possible.

Along a fixed bearing the range to a wall is linear in the position. Where all 64 positions of a block see the same wall
in a bin, three of their profiles give that line, w = w0 + x wx + y wy with x, y = 0..7; such bins are marked when
the pyramid is built. Over them the squared residual of an observation l at a scale t is a quadratic form whose nine
coefficients are summed once per block and heading, and then

    1 - cos^2 >= e - (h . u)^2 / (u' G u),    u = (1, x, y),

costs a few products per position: nearly the cosine itself, without the profiles of 61 positions.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from galoc._pyramid_kernel import BINS, LEAVES

CORNER_X, CORNER_Y = 21, 42
"""Leaves (7, 0) and (0, 7) of a block, in Morton order; (0, 0) is the first."""
LINEAR = 2e-5
"""A bin is linear over a block when it is to this share of its range."""


@njit(cache=True, parallel=True, error_model="numpy")
def linear_bins(profiles, mask, x, y):  # type: ignore[no-untyped-def]
    """(B, 45) uint8: bit b % 8 of byte b // 8 is set where bin b is linear over the clear leaves of a block.

    Args:
        profiles: (64 B, 360) float32, m.
        mask: (B,) uint64 clear leaves.
        x: (64,) column of each leaf in its block.
        y: (64,) row.
    """
    out = np.zeros((mask.shape[0], BINS // 8), np.uint8)
    for k in prange(mask.shape[0]):
        block = profiles[k * LEAVES : (k + 1) * LEAVES]
        first, right, up = block[0], block[CORNER_X], block[CORNER_Y]
        excess = np.full(BINS, -1.0)
        for m in range(LEAVES):
            if (mask[k] >> np.uint64(m)) & np.uint64(1):
                across, along = x[m] / 7.0, y[m] / 7.0
                own = 1.0 - across - along
                row = block[m]
                for b in range(BINS):
                    line = own * first[b] + across * right[b] + along * up[b]
                    excess[b] = max(excess[b], abs(row[b] - line) - LINEAR * row[b])
        for b in range(BINS):
            if excess[b] <= 0.0:
                out[k, b // 8] |= np.uint8(1 << (b % 8))
    return out


@njit(cache=True, parallel=True)
def block_planes(corners, linear, length):  # type: ignore[no-untyped-def]
    """(B, 4, length) float32: w0, wx, wy and 1 or 0 for linear, of each bin, written on past 360.

    Args:
        corners: (B, 3, 360) float32 profiles of leaves (0, 0), (7, 0), (0, 7), m.
        linear: (B, 45) uint8 from :func:`linear_bins`.
        length: bins written.
    """
    out = np.empty((corners.shape[0], 4, length), np.float32)
    for k in prange(corners.shape[0]):
        for j in range(length):
            b = j % BINS
            w0 = corners[k, 0, b]
            out[k, 0, j] = w0
            out[k, 1, j] = (corners[k, 1, b] - w0) / np.float32(7.0)
            out[k, 2, j] = (corners[k, 2, b] - w0) / np.float32(7.0)
            out[k, 3, j] = np.float32((linear[k, b // 8] >> (b % 8)) & 1)
    return out


@njit(cache=True, fastmath=True, error_model="numpy")
def _sums(plane, at, seen, known, out):  # type: ignore[no-untyped-def]
    """Sums over the linear bins of a view: e, h0, h1, h2, G00, G01, G02, G11, G12, G22."""
    n = seen.shape[0]
    w0, wx, wy, on = plane[0, at : at + n], plane[1, at : at + n], plane[2, at : at + n], plane[3, at : at + n]
    e = h0 = h1 = h2 = g00 = g01 = g02 = g11 = g12 = g22 = 0.0
    for i in range(n):
        k = known[i] * on[i]
        s, a, b, c = seen[i] * k, np.float64(w0[i]) * k, np.float64(wx[i]) * k, np.float64(wy[i]) * k
        e += s * s
        h0 += s * a
        h1 += s * b
        h2 += s * c
        g00 += a * a
        g01 += a * b
        g02 += a * c
        g11 += b * b
        g12 += b * c
        g22 += c * c
    out[0], out[1], out[2], out[3], out[4] = e, h0, h1, h2, g00
    out[5], out[6], out[7], out[8], out[9] = g01, g02, g11, g12, g22


@njit(cache=True, parallel=True, error_model="numpy")
def plane_poses(planes, which, headings, turns, start, seen, known, residual, scale, clear, x, y):  # type: ignore[no-untyped-def]
    """(N, turns) uint64: the leaves of each node's block, as bits, that may have a residual of at most ``residual``.

    Args:
        planes: (B, 4, 360 + n) from :func:`block_planes`.
        which: (N,) block of each node.
        headings: (N,) first whole degree of each node.
        turns: degrees of a node.
        start: bearing of the first ray relative to the heading, degrees.
        seen: (n,) float64 observation of unit norm, 0 where unknown.
        known: (n,) float64 0 or 1.
        residual: 1 - cos^2.
        scale: (2,) least and greatest scale t.
        clear: (B,) uint64 leaves that keep the clearance.
        x: (64,) column of each leaf in its block.
        y: (64,) row.
    """
    out = np.zeros((which.shape[0], turns), np.uint64)
    # A linear bin errs by LINEAR of its range at most; t |w| is at most |l| + the residual's root <= 2.
    limit = (np.sqrt(residual) + 2.1 * LINEAR) ** 2
    for q in prange(which.shape[0]):
        k = which[q]
        sums = np.empty(10)
        for turn in range(turns):
            _sums(planes[k], (start + headings[q] + turn) % BINS, seen, known, sums)
            e, h0, h1, h2, g00, g01, g02, g11, g12, g22 = sums
            keep = np.uint64(0)
            for m in range(LEAVES):
                dot = h0 + x[m] * h1 + y[m] * h2
                energy = g00 + 2.0 * (x[m] * g01 + y[m] * g02) + x[m] * x[m] * g11 + y[m] * y[m] * g22
                energy += 2.0 * x[m] * y[m] * g12
                t = min(max(dot / energy, scale[0]), scale[1]) if energy > 0.0 else scale[0]
                if e - 2.0 * t * dot + t * t * energy <= limit:
                    keep |= np.uint64(1) << np.uint64(m)
            out[q, turn] = keep & clear[k]
    return out


@njit(cache=True)
def listed(bits, blocks, headings):  # type: ignore[no-untyped-def]
    """The poses whose bits are set: (K,) int64 leaves, (K,) int16 headings, (K,) int64 nodes.

    Args:
        bits: (N, T) uint64 from :func:`plane_poses`.
        blocks: (N,) block of each node.
        headings: (N,) first whole degree.
    """
    total = 0
    for q in range(bits.shape[0]):
        for turn in range(bits.shape[1]):
            rest = bits[q, turn]
            while rest:
                rest &= rest - np.uint64(1)
                total += 1
    leaves, degrees = np.empty(total, np.int64), np.empty(total, np.int16)
    nodes = np.empty(total, np.int64)
    z = 0
    for q in range(bits.shape[0]):
        for turn in range(bits.shape[1]):
            for m in range(LEAVES):
                if (bits[q, turn] >> np.uint64(m)) & np.uint64(1):
                    leaves[z] = np.int64(blocks[q]) * LEAVES + m
                    degrees[z] = (headings[q] + turn) % BINS
                    nodes[z] = q
                    z += 1
    return leaves, degrees, nodes
