"""Numba kernels for exact visibility in a plan."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from galoc._visibility_kernel import cast as nearest_hit


@njit(cache=True)
def line_range(segments, k, x, y, c, s):  # type: ignore[no-untyped-def]
    """Distance along (c, s) to the infinite line of segment k."""
    x0, y0 = segments[k, 0] - x, segments[k, 1] - y
    dx, dy = segments[k, 2] - segments[k, 0], segments[k, 3] - segments[k, 1]
    return (x0 * dy - y0 * dx) / (c * dy - s * dx)


@njit(cache=True)
def visible_pieces(segments, x, y, heading, events):  # type: ignore[no-untyped-def]
    """Which segment is seen in each azimuth interval between sorted ``events`` (rad, right positive).

    Between two events only crossing walls can change the nearest one; such an interval is split at the crossing
    (by bisection to 1e-10 rad, since a third wall may cut in).

    Returns:
        (K, 3): azimuth from, azimuth to, segment index (-1: nothing hit).
    """
    out = np.empty((4 * events.shape[0] + 64, 3))
    count = 0
    stack = np.empty((256, 2))
    for e in range(events.shape[0] - 1):
        if events[e + 1] - events[e] < 1e-9:
            continue
        stack[0, 0], stack[0, 1] = events[e], events[e + 1]
        depth = 1
        while depth > 0:
            depth -= 1
            a0, a1 = stack[depth, 0], stack[depth, 1]
            inset = min(1e-9, 0.25 * (a1 - a0))
            _, k0 = nearest_hit(segments, x, y, math.cos(heading - a0 - inset), math.sin(heading - a0 - inset))
            _, k1 = nearest_hit(segments, x, y, math.cos(heading - a1 + inset), math.sin(heading - a1 + inset))
            if k0 == k1 or a1 - a0 < 1e-10 or depth + 2 >= 256:
                if count < out.shape[0]:
                    out[count, 0], out[count, 1], out[count, 2] = a0, a1, k0
                    count += 1
            else:
                middle = 0.5 * (a0 + a1)
                stack[depth, 0], stack[depth, 1] = middle, a1
                stack[depth + 1, 0], stack[depth + 1, 1] = a0, middle
                depth += 2
    return out[:count]
