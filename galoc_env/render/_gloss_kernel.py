"""Glossy floors: what stands on them, seen upside down in them, the more the flatter the view.

All floors lie in one plane, so one more picture serves them all: the view from the camera's mirror image below the
floor shows, pixel for pixel, what a ray meets that the floor throws back.
"""

import math

import numpy as np
from numba import njit

SPREAD = 2
"""A reflection is the mean of five pixels this far apart: floors are not mirrors."""
HEAD_ON = 0.04
"""Share that a glossy surface reflects when it is looked at squarely."""


@njit(cache=True, nogil=True, error_model="numpy")
def mirror(view, floor, out):  # type: ignore[no-untyped-def]
    """The view (16,) from below the floor, whose height in the facets' frame is ``floor``, m."""
    out[:] = view
    for k in range(6, 9):
        out[k] = -view[k]
    out[11] = 2.0 * floor - view[11]


@njit(cache=True, nogil=True, error_model="numpy")
def reflect(view, width, height, stride, floor, numbers, work, rgb):  # type: ignore[no-untyped-def]
    """Blend ``work.reflection`` into the glossy pixels of the picture (H * W * 3,) that ``work`` was last used for."""
    reflection = work.reflection
    slots, planes, facet_of = work.slots, work.planes, work.facet_of
    fx, fy, cx, cy = view[12], view[13], view[14], view[15]
    for y in range(height):
        for x in range(width):
            slot = slots[y * stride + x]
            if slot < 0:
                continue
            gloss = numbers[facet_of[slot], 8]
            if gloss == 0:
                continue
            inverse = planes[slot, 0] + planes[slot, 1] * x + planes[slot, 2] * y
            across, down = (x - cx) / fx, (y - cy) / fy
            # The floor is level, so its distance from the camera is the camera's height above it.
            cosine = min((view[11] - floor) * inverse / math.sqrt(1.0 + across * across + down * down), 1.0)
            rest = 1.0 - cosine
            share = gloss / 255.0 * (HEAD_ON + (1.0 - HEAD_ON) * rest * rest * rest * rest * rest)
            to = 3 * (y * width + x)
            left, right = 3 * min(x, SPREAD), 3 * min(width - 1 - x, SPREAD)
            up, below = 3 * width * min(y, SPREAD), 3 * width * min(height - 1 - y, SPREAD)
            for k in range(3):
                at = to + k
                sum2 = 0.0
                for other in (at, at - left, at + right, at - up, at + below):
                    sum2 += float(reflection[other]) ** 2
                own = float(rgb[at])
                rgb[at] = np.uint8(math.sqrt(own * own + share * (0.2 * sum2 - own * own)) + 0.5)
