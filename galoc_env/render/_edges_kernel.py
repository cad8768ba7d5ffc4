"""Smooth edges: where neighbouring pixels see different facets, the facet's edge between them says in what shares.

An edge is the line in which the planes of both facets meet, or part of the outline of the nearer one. If it runs more
upright than level it shifts the border between left and right neighbours, else that between upper and lower ones: a
pixel takes as much of its neighbour's colour as the edge leaves to the neighbour
within it. That is exact for one straight edge, at any angle and without steps, and costs little, because only the
pixels along edges are looked at. What is thinner than a pixel stays as it was drawn.
"""

import math

import numpy as np
from numba import njit

from galoc_env.render._lanes import LANES, differ, first_bit, load

u4 = np.uint32


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def crossing(outlines, slot, at, along, axis):  # type: ignore[no-untyped-def]
    """Where an outline crosses the line between the centres ``along`` and ``along`` + 1; -1 where it does not.

    Args:
        outlines: of all slots.
        slot: whose.
        at: the row (axis 0) or column (axis 1) of both pixels.
        along: the first pixel's column or row.
        axis: 0 for pixels side by side, 1 for one above the other.
    """
    for k in range(1, int(outlines[slot, 0, 0]) + 1):
        x, low, high, slope = outlines[slot, k, 0], outlines[slot, k, 1], outlines[slot, k, 2], outlines[slot, k, 3]
        if axis == 0:
            if not low < at <= high or abs(slope) > 1.0:
                continue
            where = x + (at - low) * slope
        else:
            other = x + (high - low) * slope
            if (x < at) == (other < at) or abs(slope) <= 1.0:
                continue
            where = low + (at - x) / slope
        if along <= where <= along + 1.0:
            return where
    return -1.0


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def share(slots, planes, outlines, at, beside, row, column, axis):  # type: ignore[no-untyped-def]
    """How far the border between two neighbours lies from the middle between them, px; 0 if no edge is there."""
    one, other = slots[at], slots[beside]
    if one < 0 or other < 0:
        return 0.0
    # By how much the first pixel's facet is the nearer one, in inverse depth, at both pixels.
    bx, by = planes[one, 1] - planes[other, 1], planes[one, 2] - planes[other, 2]
    here = planes[one, 0] - planes[other, 0] + bx * column + by * row
    change = bx if axis == 0 else by
    there = here + change
    if here >= 0.0 >= there and here > there:
        # The planes meet between the pixels: at an edge that both share, or where one facet pierces the other.
        upright = abs(bx) >= abs(by)
        return here / (here - there) - 0.5 if upright == (axis == 0) else 0.0
    fixed, along = (row, column) if axis == 0 else (column, row)
    near, far = (one, other) if here + 0.5 * change >= 0.0 else (other, one)
    where = crossing(outlines, near, fixed, along, axis)
    if where < 0.0:
        where = crossing(outlines, far, fixed, along, axis)
    return 0.0 if where < 0.0 else where - along - 0.5


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def mix(rgb, to, beside, weight):  # type: ignore[no-untyped-def]
    """Give a pixel a share of another's colour, as a mean of squares, close to that of light."""
    for k in range(3):
        own, others = float(rgb[to + k]), float(rgb[beside + k])
        rgb[to + k] = np.uint8(math.sqrt(own * own + weight * (others * others - own * own)) + 0.5)


@njit(cache=True, nogil=True, error_model="numpy")
def smooth(width, height, stride, work, rgb):  # type: ignore[no-untyped-def]
    """Smooth the edges of a picture (H * W * 3,) that ``shade`` has written."""
    slots, planes, outlines = work.slots, work.planes, work.outlines
    for y in range(height):
        for axis in range(2):  # this row's neighbours side by side, then those above
            top = y - axis
            if top < 0:
                continue
            step, skip = (1, 3) if axis == 0 else (stride, 3 * width)
            for x0 in range(0, width, LANES):
                at = top * stride + x0
                edges = differ(load(slots, at), load(slots, at + step))
                while edges != 0:
                    x = x0 + first_bit(edges)
                    edges &= edges - u4(1)
                    if x >= width - (1 - axis):
                        break
                    off = share(slots, planes, outlines, top * stride + x, top * stride + x + step, top, x, axis)
                    to = 3 * (top * width + x)
                    if off < 0.0:
                        mix(rgb, to, to + skip, -off)
                    elif off > 0.0:
                        mix(rgb, to + skip, to, off)
