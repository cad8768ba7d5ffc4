"""Room polygons of generated homes: a random subdivision, then cuts, wings and warps for the other kinds."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from shapely import LineString, Point, Polygon, affinity, unary_union

from galoc_env.wall_builder import rectangle

MIN_SIDE_M, MAX_SIDE_M = 3.0, 8.0
"""Side lengths of rooms in the subdivision."""
HALL_M = (1.4, 2.0)
"""Width of halls."""
MIN_ANGLE_DEG = 40.0
"""Sharper room corners are refused: nobody builds them and nobody fits in."""

Box = tuple[float, float, float, float]


def draw_rooms(rng: np.random.Generator, kind: str) -> list[Polygon] | None:
    """Rooms that meet at wall centrelines, or None when this draw came out unsound.

    Args:
        rng: source of randomness.
        kind: "rectilinear", "atlanta" or "free".
    """
    rooms = _without_corner(rng, [Polygon(rectangle(*box)) for box in _boxes(rng)])
    if kind == "atlanta":
        rooms = _with_wing(rng, rooms) if rng.random() < 0.5 else rooms
        rooms = _chamfered(rng, rooms)
    elif kind == "free":
        rooms = _warped(rng, rooms)
    return rooms if 3 <= len(rooms) <= 14 and all(_sound(room) for room in rooms) else None


def narrow(room: Polygon) -> bool:
    """Whether a room is a hall: nowhere much wider than one."""
    return bool(room.buffer(-0.55 * HALL_M[1]).is_empty)


def _boxes(rng: np.random.Generator) -> list[Box]:
    """Guillotine subdivision of a random rectangle, now and then with a hall through it."""
    width, depth = round(float(rng.uniform(8.5, 17.0)), 2), round(float(rng.uniform(7.0, 13.0)), 2)
    target = int(rng.integers(4, 10))
    if rng.random() < 0.4:
        hall = float(rng.uniform(*HALL_M))
        y = float(rng.uniform(MIN_SIDE_M, depth - MIN_SIDE_M - hall)) if depth > 2 * MIN_SIDE_M + hall else 0.0
        done = [(0.0, y, width, y + hall)]
        boxes = [(0.0, a, width, b) for a, b in ((0.0, y), (y + hall, depth)) if b > a]
    else:
        done, boxes = [], [(0.0, 0.0, width, depth)]
    while True:
        boxes.sort(key=lambda b: (b[2] - b[0]) * (b[3] - b[1]))
        splittable = [b for b in boxes if max(b[2] - b[0], b[3] - b[1]) > 2.0 * MIN_SIDE_M + 0.2]
        forced = [b for b in splittable if max(b[2] - b[0], b[3] - b[1]) > MAX_SIDE_M]
        if not splittable or (not forced and len(boxes) + len(done) >= target):
            return [_rounded(box) for box in boxes + done]
        box = (forced or splittable)[-1]
        boxes.remove(box)
        boxes += _halves(rng, box)


def _halves(rng: np.random.Generator, box: Box) -> list[Box]:
    """Cut a box across its longer side, no part thinner than the smallest room."""
    x1, y1, x2, y2 = box
    if x2 - x1 >= y2 - y1:
        cut = round(float(rng.uniform(x1 + MIN_SIDE_M, x2 - MIN_SIDE_M)), 2)
        return [(x1, y1, cut, y2), (cut, y1, x2, y2)]
    cut = round(float(rng.uniform(y1 + MIN_SIDE_M, y2 - MIN_SIDE_M)), 2)
    return [(x1, y1, x2, cut), (x1, cut, x2, y2)]


def _rounded(box: Box) -> Box:
    x1, y1, x2, y2 = (round(value, 2) for value in box)
    return x1, y1, x2, y2


def _without_corner(rng: np.random.Generator, rooms: list[Polygon]) -> list[Polygon]:
    """Drop one room from the rim now and then, so that footprints are L- and U-shaped."""
    if len(rooms) < 5 or rng.random() > 0.5:
        return rooms
    for index in rng.permutation(len(rooms)):
        rest = [room for i, room in enumerate(rooms) if i != index]
        storey = unary_union(rest)
        if isinstance(storey, Polygon) and not storey.interiors and not narrow(rooms[index]):
            return rest
    return rooms


def _chamfered(rng: np.random.Generator, rooms: list[Polygon]) -> list[Polygon]:
    """Cut one to three convex corners of the footprint diagonally."""
    ring = list(unary_union(rooms).normalize().exterior.coords)[:-1]
    wanted = int(rng.integers(1, 4))
    for index in rng.permutation(len(ring)):
        corner = np.array(ring[index])
        before, after = np.array(ring[index - 1]) - corner, np.array(ring[(index + 1) % len(ring)]) - corner
        legs = rng.uniform(0.9, 2.2, 2)
        if wanted == 0 or min(np.linalg.norm(before), np.linalg.norm(after)) < 2.5:
            continue
        a = corner + legs[0] * before / np.linalg.norm(before)
        b = corner + legs[1] * after / np.linalg.norm(after)
        triangle = Polygon([corner, a, b])
        owners = [i for i, room in enumerate(rooms) if room.intersection(triangle).area > 1e-6]
        if len(owners) != 1 or narrow(rooms[owners[0]]):
            continue
        cut = rooms[owners[0]].difference(triangle)
        if isinstance(cut, Polygon) and _sound(cut):
            rooms = [cut if i == owners[0] else room for i, room in enumerate(rooms)]
            wanted -= 1
    return rooms


def _with_wing(rng: np.random.Generator, rooms: list[Polygon]) -> list[Polygon]:
    """Add a room turned by 20 to 50 degrees against one side of the footprint."""
    storey = unary_union(rooms).normalize()
    ring = np.array(storey.exterior.coords)
    for _ in range(12):
        index = int(rng.integers(len(ring) - 1))
        start, end = ring[index], ring[index + 1]
        width, length = rng.uniform(3.2, 4.8), rng.uniform(3.6, 5.5)
        turn = math.radians(rng.uniform(20.0, 50.0)) * (1 if rng.random() < 0.5 else -1)
        place = start + rng.uniform(0.3, 0.7) * (end - start)
        outwards = math.atan2(start[0] - end[0], end[1] - start[1])  # normal of a counter-clockwise ring, times -1
        outwards += math.pi if storey.contains(Point(place + 0.1 * _unit(outwards))) else 0.0
        box = Polygon(rectangle(-3.0, -width / 2.0, length, width / 2.0))
        wing = affinity.translate(affinity.rotate(box, outwards + turn, (0, 0), use_radians=True), *place)
        wing = wing.difference(storey)
        if not isinstance(wing, Polygon) or not _sound(wing):
            continue
        contact = wing.intersection(LineString([start, end]).buffer(1e-6)).length / 2.0
        touching = wing.intersection(storey.buffer(1e-6)).length / 2.0
        if contact > 2.0 and touching < contact + 1e-3:
            return [*rooms, wing]
    return rooms


def _unit(angle: float) -> np.ndarray:
    return np.array([math.cos(angle), math.sin(angle)])


def _warped(rng: np.random.Generator, rooms: list[Polygon]) -> list[Polygon]:
    """Move every corner, also where a wall ends on another, and shear the whole."""
    noded = [_noded(room, rooms) for room in rooms]
    reach = 0.22 if any(narrow(room) for room in rooms) else 0.45
    shear = math.tan(math.radians(float(rng.uniform(-9.0, 9.0))))
    corners = sorted({point for ring in noded for point in ring})
    shift = dict(zip(corners, rng.uniform(-reach, reach, (len(corners), 2)), strict=True))
    return [Polygon([(x + shear * y + shift[x, y][0], y + shift[x, y][1]) for x, y in ring]) for ring in noded]


def _noded(room: Polygon, rooms: Sequence[Polygon]) -> list[tuple[float, float]]:
    """The room's ring with every corner of its neighbours that lies on it."""
    ring = room.exterior
    others = {point for other in rooms for point in other.exterior.coords}
    on_ring = [(float(x), float(y)) for x, y in others if ring.distance(Point(x, y)) < 1e-6]
    return sorted(set(on_ring), key=lambda point: (ring.project(Point(point)), point))


def _sound(room: Polygon) -> bool:
    """Simple, wide enough to walk in, and without sharp corners."""
    if not room.is_valid or room.area < 3.0:
        return False
    if not isinstance(core := room.buffer(-0.55), Polygon) or core.is_empty:
        return False
    points = np.array(room.exterior.coords[:-1])
    before, after = np.roll(points, 1, axis=0) - points, np.roll(points, -1, axis=0) - points
    cosine = np.sum(before * after, axis=1) / (np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1))
    return bool(np.max(cosine) < math.cos(math.radians(MIN_ANGLE_DEG)))
