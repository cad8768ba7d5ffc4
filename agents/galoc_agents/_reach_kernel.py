"""Numba kernel: where a body gets to, action by action, on a map of clearances."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

MOVES = 4
"""Forward, backward, left, right: the discrete actions in their order."""
CHECKS = 3
"""Places checked along a step."""


@njit(cache=True)
def reach(  # type: ignore[no-untyped-def]
    start, clearance, origin, resolution, radius, bumps, bump_radius, cell, headings, step_m, deepest, most
):
    """Breadth-first search over the discrete actions.

    States are the poses themselves; of those in one cell of ``cell`` metres with the same number of turns the first one
    reached is kept. A step is possible where the clearance of all places along it is at least ``radius`` or grows, and
    none comes nearer to a bump than ``bump_radius``.

    Args:
        start: (3,) x, y m, heading rad.
        clearance: (H, W) m, 0 outside.
        origin: (2,) m, lower left corner of the clearance grid.
        resolution: m, of the grid.
        radius: m.
        bumps: (B, 2) m, places where the body's centre cannot be.
        bump_radius: m, at most ``radius``.
        cell: m.
        headings: turns in a full circle.
        step_m: length of a step, m.
        deepest: actions at most.
        most: states at most.

    Returns:
        (N, 3) poses, (N,) number of the state before (-1 at the start), (N,) action from there, (N,) actions so far; in
        the order in which they are reached.
    """
    height, width = clearance.shape
    spare = radius - bump_radius
    rows, cols = int(height * resolution / cell) + 2, int(width * resolution / cell) + 2
    seen = np.zeros((rows, cols, headings), np.bool_)
    pose = np.empty((most, 3))
    parent, move = np.empty(most, np.int32), np.empty(most, np.int32)
    depth, turn = np.empty(most, np.int32), np.empty(most, np.int32)
    pose[0], parent[0], move[0], depth[0], turn[0] = start, -1, -1, 0, 0
    count, at = 1, 0
    while at < count:
        if depth[at] < deepest:
            for action in range(MOVES):
                turns = turn[at]
                x, y = pose[at, 0], pose[at, 1]
                if action >= 2:
                    turns = (turns + (1 if action == 2 else headings - 1)) % headings
                else:
                    along = step_m if action == 0 else -step_m
                    dx, dy = along * math.cos(pose[at, 2]), along * math.sin(pose[at, 2])
                    before = _clearance(x, y, clearance, origin, resolution, bumps, spare)
                    free = True
                    for i in range(1, CHECKS + 1):
                        share = i / CHECKS
                        now = _clearance(x + share * dx, y + share * dy, clearance, origin, resolution, bumps, spare)
                        if now < radius and now <= before:
                            free = False
                            break
                        before = now
                    if not free:
                        continue
                    x, y = x + dx, y + dy
                row, col = int((y - origin[1]) / cell), int((x - origin[0]) / cell)
                if row < 0 or row >= rows or col < 0 or col >= cols or seen[row, col, turns]:
                    continue
                seen[row, col, turns] = True
                pose[count, 0], pose[count, 1] = x, y
                pose[count, 2] = start[2] + turns * 2.0 * math.pi / headings
                parent[count], move[count], depth[count], turn[count] = at, action, depth[at] + 1, turns
                count += 1
                if count == most:
                    return pose[:count], parent[:count], move[:count], depth[:count]
        at += 1
    return pose[:count], parent[:count], move[:count], depth[:count]


@njit(cache=True)
def _clearance(x, y, clearance, origin, resolution, bumps, spare):  # type: ignore[no-untyped-def]
    """Distance to the nearest wall, or to a bump and ``spare``, m; 0 outside the map."""
    row, col = math.floor((y - origin[1]) / resolution), math.floor((x - origin[0]) / resolution)
    if row < 0 or col < 0 or row >= clearance.shape[0] or col >= clearance.shape[1]:
        return 0.0
    best = float(clearance[row, col])
    for i in range(bumps.shape[0]):
        best = min(best, math.hypot(x - bumps[i, 0], y - bumps[i, 1]) + spare)
    return best


@njit(cache=True)
def choose(pose, parent, depth, origin, headings, near_depth, blocks, sectors, most):  # type: ignore[no-untyped-def]
    """A part of the states that covers places and directions, each with the whole way to it.

    Args:
        pose: (N, 3) from :func:`reach`.
        parent: (N,) from :func:`reach`.
        depth: (N,) from :func:`reach`.
        origin: (2,) m.
        headings: turns in a full circle.
        near_depth: actions up to which a state is near.
        blocks: (2,) m, near and far; of the states of one block and sector the first one is taken.
        sectors: (2,) sectors of directions, near and far; divisors of ``headings``.
        most: states from which on no more ways are taken; the last one is whole, and may go beyond that.

    Returns:
        (M,) increasing numbers of the states taken, the start among them.
    """
    count = pose.shape[0]
    size = np.zeros((2, 2), np.int64)
    for i in range(count):
        for far in range(2):
            size[far, 0] = max(size[far, 0], int((pose[i, 1] - origin[1]) / blocks[far]) + 1)
            size[far, 1] = max(size[far, 1], int((pose[i, 0] - origin[0]) / blocks[far]) + 1)
    met_near = np.zeros((size[0, 0], size[0, 1], sectors[0]), np.bool_)
    met_far = np.zeros((size[1, 0], size[1, 1], sectors[1]), np.bool_)
    taken = np.zeros(count, np.bool_)
    taken[0] = True
    total = 1
    for i in range(count):
        far = 0 if depth[i] <= near_depth else 1
        met = met_near if far == 0 else met_far
        row, col = int((pose[i, 1] - origin[1]) / blocks[far]), int((pose[i, 0] - origin[0]) / blocks[far])
        turned = (pose[i, 2] - pose[0, 2]) / (2.0 * math.pi)
        sector = int(round(turned * headings)) * sectors[far] // headings % sectors[far]
        if met[row, col, sector]:
            continue
        met[row, col, sector] = True
        at = i
        while not taken[at]:
            taken[at] = True
            total += 1
            at = parent[at]
        if total >= most:
            break
    return np.flatnonzero(taken)
