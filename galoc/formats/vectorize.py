"""From a grid of free cells to wall segments: trace the boundary, straighten it, drop specks.

The boundary runs along cell edges, so an axis-aligned wall comes out exactly where the raster has it. Slanted walls
are staircases; each straight stretch is fitted by a line through the middles of its cell edges and neighbouring lines
are intersected, which places corners to a fraction of a cell.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from galoc.errors import GalocError

Array = NDArray[np.float64]

TOLERANCE_PX = 1.0
"""Largest distance between the middles of traced cell edges and their chord: a straight staircase strays up to 0.9."""
MAX_STRAY_PX, RMS_STRAY_PX = 1.5, 0.46
"""Neighbouring stretches merge when one line fits both this well, cells: at worst, and in the mean square."""
MAX_TAIL_PX = 16
"""Longest stretch that counts as the ragged end of a wall at a corner, cells."""
MIN_PATCH_M2 = 0.04
"""Islands of wall below this area, 0.2 m x 0.2 m, are noise."""
MIN_ROOM_WIDTH_M = 0.5
"""Closed patches of free space that are nowhere this wide are gaps between the two lines of a wall, or noise."""
MAX_SEGMENTS, MAX_LOOPS, MAX_EDGES = 100_000, 10_000, 1_500_000
"""More walls, separate boundaries or boundary cells than this are noise or a photograph."""
_STEP = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])


def walls_from_free(free: NDArray[np.bool_], cell: float, name: str) -> Array:
    """Wall segments along the boundary of free space.

    Args:
        free: (H, W), row 0 at the bottom. What lies beyond the grid makes no boundary; pad with the value wanted there.
        cell: cell size, m.
        name: file name, for errors.

    Returns:
        (S, 4) m, origin at the lower left corner of cell (0, 0), free space on the left of every segment.

    Raises:
        GalocError: no boundary at all, or more than 100 000 segments.
    """
    loops = [loop for loop in _loops(_without_slivers(free, cell), name) if abs(_area(loop)) * cell**2 >= MIN_PATCH_M2]
    if len(loops) > MAX_LOOPS:
        raise _no_plan(name, f"{len(loops)} separate patches")
    rows: list[Array] = []
    found = 0
    for loop in loops:
        corners = _straightened(loop)
        if len(corners) >= 3:
            rows.append(np.hstack([corners, np.roll(corners, -1, axis=0)]))
            found += len(corners)
        if found > MAX_SEGMENTS:
            raise _no_plan(name, f"more than {MAX_SEGMENTS} walls")
    if not rows:
        raise _no_plan(name, "no wall at all")
    segments = np.concatenate(rows) * cell
    lengths = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    return np.asarray(segments[lengths > 1e-6 * cell])


def _no_plan(name: str, found: str) -> GalocError:
    return GalocError(
        f"the image of {name!r} with {found}",
        "dark walls on a light ground",
        "Check the image and its thresholds; clean up noise, text and hatching.",
    )


def _without_slivers(free: NDArray[np.bool_], cell: float) -> NDArray[np.bool_]:
    """Free space without the closed patches in which nobody could stand."""
    import cv2

    mask = free.astype(np.uint8)
    distance = np.asarray(cv2.distanceTransform(np.pad(mask, 1), cv2.DIST_L2, 5))[1:-1, 1:-1]
    count, labels = cv2.connectedComponents(mask, connectivity=4)
    wide = np.zeros(count, dtype=np.bool_)
    # the distance runs to the middle of the nearest occupied cell, half a cell beyond the boundary
    wide[np.asarray(labels)[distance + 0.5 >= 0.5 * MIN_ROOM_WIDTH_M / cell]] = True
    wide[0] = False
    return np.asarray(wide[labels])


def _loops(free: NDArray[np.bool_], name: str) -> list[NDArray[np.int64]]:
    """Closed boundaries as (n, 2) integer cell corners x, y, one step a row, free cells on the left."""
    width = free.shape[1] + 1
    starts, directions = _edges(free)
    key = (starts[:, 1] * width + starts[:, 0]) * 4 + directions
    if len(key) > MAX_EDGES:
        raise _no_plan(name, f"{len(key)} cells of boundary")
    order = np.argsort(key)
    key, starts, directions = key[order], starts[order], directions[order]
    ends = starts + _STEP[directions]
    corner = (ends[:, 1] * width + ends[:, 0]) * 4
    successor = np.full(len(key), -1, dtype=np.int64)
    for turn in (3, 0, 1):  # the left turn is written last and wins: free cells that touch at a corner stay apart
        wanted = corner + (directions + turn) % 4
        place = np.minimum(np.searchsorted(key, wanted), max(len(key) - 1, 0))
        hit = key[place] == wanted
        successor[hit] = place[hit]
    return _follow(starts, successor)


def _edges(free: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Unit edges between a free and an occupied cell: start corners (n, 2) and direction (0 +x, 1 +y, 2 -x, 3 -y)."""
    starts, directions = [], []
    for axis, (up, down), offset_up, offset_down in (
        (0, (0, 2), (0, 1), (1, 1)),  # free above the edge: run +x; free below: run -x
        (1, (3, 1), (1, 1), (1, 0)),  # free right of the edge: run -y; free left: run +y
    ):
        first, second = (free[:-1], free[1:]) if axis == 0 else (free[:, :-1], free[:, 1:])
        for mask, direction, offset in ((second & ~first, up, offset_up), (first & ~second, down, offset_down)):
            rows, cols = np.nonzero(mask)
            starts.append(np.stack([cols + offset[0], rows + offset[1]], axis=1))
            directions.append(np.full(len(rows), direction))
    return np.concatenate(starts).astype(np.int64), np.concatenate(directions).astype(np.int64)


def _follow(starts: NDArray[np.int64], successor: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Split the successor permutation into loops; chains that leave the grid are dropped."""
    following = successor.tolist()
    seen = bytearray(len(following))
    loops = []
    for first in range(len(following)):
        chain = []
        here = first
        while here >= 0 and not seen[here]:
            seen[here] = 1
            chain.append(here)
            here = following[here]
        if chain and here == first:
            loops.append(starts[chain])
    return loops


def _area(loop: NDArray[np.int64]) -> float:
    """Signed area of a polygon (n, 2), counter-clockwise positive."""
    after = np.roll(loop, -1, axis=0)
    return 0.5 * float(np.sum(loop[:, 0] * after[:, 1] - after[:, 0] * loop[:, 1]))


def _straightened(loop: NDArray[np.int64]) -> Array:
    """(k, 2) corners, px, of a closed boundary within about one cell of the traced one."""
    points = loop.astype(np.float64)
    middles = 0.5 * (points + np.roll(points, -1, axis=0))
    cuts = _snapped(points, _split(middles))
    spans = [(a, b if b > a else b + len(points)) for a, b in zip(cuts, cuts[1:] + cuts[:1], strict=True)]
    spans = _without_tails(_merged(spans, middles), middles)
    lines = [_fit(_span(middles, span)) for span in spans]
    corners = []
    for index, (span, line) in enumerate(zip(spans, lines, strict=True)):
        dropped = (span[0] - spans[index - 1][1]) % len(points)  # a tail left out between the two stretches
        traced = _span(points, (span[0] - dropped, span[0] + 1))
        corners.append(_corner(lines[index - 1], line, traced[-1], traced))
    return np.array(corners)


def _span(points: Array, span: tuple[int, int]) -> Array:
    return points[np.arange(*span) % len(points)]


def _split(points: Array) -> list[int]:
    """Indices of the corners kept by Douglas-Peucker on a closed polygon."""
    n = len(points)
    far = int(np.argmax(np.sum((points - points.mean(axis=0)) ** 2, axis=1)))  # surely a corner
    opposite = int(np.argmax(np.sum((points - points[far]) ** 2, axis=1)))
    kept = {far, opposite}
    stack = [tuple(sorted((far, opposite))), (max(far, opposite), min(far, opposite) + n)]
    while stack:
        a, b = stack.pop()
        if b - a < 2:
            continue
        chain = points[np.arange(a, b + 1) % n]
        ux, uy = chain[-1] - chain[0]
        offset = np.abs(ux * (chain[:, 1] - chain[0, 1]) - uy * (chain[:, 0] - chain[0, 0])) / math.hypot(ux, uy)
        worst = int(np.argmax(offset))
        if offset[worst] > TOLERANCE_PX:
            kept.add((a + worst) % n)
            stack += [(a, a + worst), (a + worst, b)]
    return sorted(kept)


def _snapped(points: Array, cuts: list[int]) -> list[int]:
    """Move each cut, an edge's middle, to the nearby cell corner that sticks out most from its neighbours' chord."""
    n = len(points)
    out = set()
    for before, cut, after in zip(cuts[-1:] + cuts[:-1], cuts, cuts[1:] + cuts[:1], strict=True):
        near = np.arange(cut - 1, cut + 3) % n
        chord, offset = points[after] - points[before], points[near] - points[before]
        out.add(int(near[np.argmax(np.abs(chord[0] * offset[:, 1] - chord[1] * offset[:, 0]))]))
    return sorted(out)


def _merged(spans: list[tuple[int, int]], middles: Array) -> list[tuple[int, int]]:
    """Join neighbouring stretches that one line fits, going around until nothing changes."""
    changed = True
    while changed and len(spans) > 3:
        changed, index = False, 0
        while index < len(spans) and len(spans) > 3:
            other = (index + 1) % len(spans)
            start = spans[index][0]
            joint = (start, start + sum(b - a for a, b in (spans[index], spans[other])))
            point, direction = _fit(stretch := _span(middles, joint))
            along = (stretch - point) @ direction
            off = (stretch - point) @ np.array([-direction[1], direction[0]])
            # a straight run neither strays (a staircase does by 0.3 on average) nor doubles back
            straight = np.max(np.abs(off)) <= MAX_STRAY_PX and np.sqrt(np.mean(off**2)) <= RMS_STRAY_PX
            if straight and np.ptp(along) > 0.6 * len(stretch):
                spans[index] = joint
                del spans[other]
                changed = True
            else:
                index += 1
    return spans


def _fit(points: Array) -> tuple[Array, Array]:
    """Total least squares line: a point and a unit direction that follows the order of the points."""
    centre = points.mean(axis=0)
    x, y = (points - centre).T
    angle = 0.5 * math.atan2(2.0 * float(x @ y), float(x @ x - y @ y))
    direction = np.array([math.cos(angle), math.sin(angle)])
    if abs(direction[0]) < 1e-12 or abs(direction[1]) < 1e-12:  # rounding must not tilt an axis-aligned wall
        direction = np.round(direction)
    return centre, direction if direction @ (points[-1] - points[0]) >= 0 else -direction


def _meeting(before: tuple[Array, Array], after: tuple[Array, Array]) -> Array | None:
    """Where two lines meet; None when they are within 3 degrees of parallel."""
    (p, u), (q, v) = before, after
    cross = u[0] * v[1] - u[1] * v[0]
    if abs(cross) < 0.05:
        return None
    return np.asarray(p + u * ((q[0] - p[0]) * v[1] - (q[1] - p[1]) * v[0]) / cross)


def _without_tails(spans: list[tuple[int, int]], middles: Array) -> list[tuple[int, int]]:
    """Drop the short stretch that a staircase leaves at a corner of two long ones; the lines meet there without it."""
    index = 0
    while index < len(spans) and len(spans) > 3:
        before, tail, after = spans[index - 1], spans[index], spans[(index + 1) % len(spans)]
        length = tail[1] - tail[0]
        if length <= MAX_TAIL_PX and min(before[1] - before[0], after[1] - after[0]) >= 3 * length:
            lines = [_fit(_span(middles, span)) for span in (before, after)]
            meet, short = _meeting(lines[0], lines[1]), _span(middles, tail)
            off = [np.abs((short - point) @ np.array([-u[1], u[0]])) for point, u in lines]
            near = meet is not None and np.max(np.hypot(*(short - meet).T)) <= length + 1.0
            if near and np.max(np.minimum(*off)) <= 1.25 * TOLERANCE_PX:
                del spans[index]
                continue
        index += 1
    return spans


def _corner(before: tuple[Array, Array], after: tuple[Array, Array], fallback: Array, traced: Array) -> Array:
    """Where two fitted lines meet, if that is near the traced corners (n, 2); else the fallback."""
    meet = _meeting(before, after)
    if meet is not None and np.min(np.hypot(*(traced - meet).T)) <= 2.0 * TOLERANCE_PX:
        return meet
    return fallback
