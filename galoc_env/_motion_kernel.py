"""Numba kernels of the bodies: straight-line contact of a disc, and one step of many bodies with what they feel.

State of a body, one row of float64, by column (m and rad):

    0:3 pose | 3:6 true motion of the last step | 6:8 true tilt | 8:10 measured gravity | 10:13 measured odometry
    13:16 wanted motion | 16:20 frequency of the sway (roll slow, fast; pitch slow, fast) | 20:24 its phase
    24 collided | 25 steps since the reset
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

COLUMNS = 26
"""Columns of the state."""
BLOCK = 128
"""Steps whose noise is drawn at once."""
SKIN_M = 1e-6
"""The body stops this far short of contact, so that rounding never leaves it inside a wall (m)."""
SLOW, FAST = 0.6, 0.4
"""Shares of the slow and the fast sway; they sum to 1, so the tilt never exceeds its amplitude."""
DRIFT_RAD_PER_M = 0.1
"""Cross term of the odometry noise: heading noise per metre travelled, times the noise fraction (rad/m)."""
REST, SENSE, MOVE = 0, 1, 2
"""What a body does in a step: nothing, feel where it has been put, or move and feel."""


@njit(cache=True)
def free_fraction(x, y, dx, dy, segments, first, last, radius):  # type: ignore[no-untyped-def]
    """Share of the shift (dx, dy) that a disc at (x, y) travels before it touches one of segments first to last."""
    length = math.hypot(dx, dy)
    if length < 1e-12:
        return 1.0
    ux, uy = dx / length, dy / length
    reach = length + radius + SKIN_M
    travel = length
    for i in range(first, last):
        ax, ay = segments[i, 0] - x, segments[i, 1] - y
        bx, by = segments[i, 2] - x, segments[i, 3] - y
        if max(min(ax, bx), -max(ax, bx)) > reach or max(min(ay, by), -max(ay, by)) > reach:
            continue
        for px, py in ((ax, ay), (bx, by)):  # its ends
            along = px * ux + py * uy
            room = radius * radius - (px * px + py * py - along * along)
            if along > 0.0 and room > 0.0:
                travel = min(travel, max(along - math.sqrt(room), 0.0))
        ex, ey = bx - ax, by - ay  # its flank
        size = math.hypot(ex, ey)
        ex, ey = ex / max(size, 1e-15), ey / max(size, 1e-15)
        gap = ay * ex - ax * ey
        approach = uy * ex - ux * ey
        if gap < 0.0:
            gap, approach = -gap, -approach
        if approach > 1e-12:
            hit = max(gap - radius, 0.0) / approach
            foot = hit * (ex * ux + ey * uy) - (ax * ex + ay * ey)
            if 0.0 <= foot <= size:
                travel = min(travel, hit)
    return 1.0 if travel >= length else max(0.0, travel - SKIN_M) / length


@njit(cache=True)
def move(body, obstacles, first, last, radius):  # type: ignore[no-untyped-def]
    """Carry out the wanted motion of one body (a row of the state): translate until contact, then turn."""
    c, s = math.cos(body[2]), math.sin(body[2])
    dx, dy = c * body[13] - s * body[14], s * body[13] + c * body[14]
    share = free_fraction(body[0], body[1], dx, dy, obstacles, first, last, radius)
    body[0] += share * dx
    body[1] += share * dy
    body[2] = (body[2] + body[15] + math.pi) % (2.0 * math.pi) - math.pi
    body[3], body[4], body[5] = share * body[13], share * body[14], body[15]
    body[24] = 1.0 if share < 1.0 else 0.0


@njit(cache=True)
def sway(body, amplitude):  # type: ignore[no-untyped-def]
    """Set the true tilt of one body at its step."""
    step = body[25]
    for axis in range(2):
        k = 16 + 2 * axis
        slow, fast = math.sin(body[k] * step + body[k + 4]), math.sin(body[k + 1] * step + body[k + 5])
        body[6 + axis] = 0.0 if amplitude == 0.0 else (slow * SLOW + fast * FAST) * amplitude


@njit(cache=True)
def measure(body, imu_sd, fraction, noise):  # type: ignore[no-untyped-def]
    """Set the measured gravity and odometry of one body from the true ones and five standard normals."""
    for axis in range(2):
        body[8 + axis] = body[6 + axis] if imu_sd == 0.0 else body[6 + axis] + imu_sd * noise[axis]
    distance = math.hypot(body[3], body[4])
    turn_sd = math.hypot(body[5], DRIFT_RAD_PER_M * distance)
    for axis in range(3):
        sd = turn_sd if axis == 2 else distance
        body[10 + axis] = body[3 + axis] if fraction == 0.0 else body[3 + axis] + fraction * noise[2 + axis] * sd


@njit(cache=True)
def step_bodies(state, doing, noise, obstacles, spans, sensors, bounds, reading):  # type: ignore[no-untyped-def]
    """One step of all bodies.

    A loop on one core: a body costs a third of a microsecond, so that waking more cores would not pay, and a process
    that has never started numba's threads can still be forked.

    Args:
        state: (L, COLUMNS), changed.
        doing: (L,) REST, SENSE or MOVE.
        noise: (L, BLOCK, 5) standard normals, two for gravity and three for odometry, by step modulo BLOCK.
        obstacles: (S, 4) m: those of all bodies' homes.
        spans: (L, 2) first and last (excluded) obstacle of each body.
        sensors: (4,) tilt amplitude rad, IMU sd rad, odometry noise fraction, body radius m.
        bounds: (5,) largest absolute reading.
        reading: (L, 5) out: measured gravity and odometry within the bounds.

    Returns:
        How many of the bodies that did something used their last noise.
    """
    spent = 0
    for i in range(state.shape[0]):
        if doing[i] == REST:
            continue
        body = state[i]
        if doing[i] == MOVE:
            move(body, obstacles, spans[i, 0], spans[i, 1], sensors[3])
            body[25] += 1.0
        at = int(body[25]) % BLOCK
        sway(body, sensors[0])
        measure(body, sensors[1], sensors[2], noise[i, at])
        for k in range(5):
            reading[i, k] = min(max(np.float32(body[8 + k]), -bounds[k]), bounds[k])
        spent += at == BLOCK - 1
    return spent
