"""Which furniture goes into which room, and how much of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from galoc_env.furniture import AREA_PER_ITEM, MAX_ITEMS, WALL_GAP, Furniture
from galoc_env.furniture.groups import Furnisher, dine, lounge, sleep, work_place
from galoc_env.furniture.kitchen import place_kitchen
from galoc_env.furniture.room import FreeRoom
from galoc_env.furniture.space import Space, spaces

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan
    from galoc_env.scene.rooms import Rooms

_GROUPS: dict[str, Callable[[Furnisher, Space], bool]] = {
    "dine": dine,
    "lounge": lounge,
    "sleep": sleep,
    "work_place": work_place,
}
_FIRST = {
    "living": (("lounge", 1.0), ("shelf", 0.7), ("plant", 0.8), ("dine", 0.5), ("cabinet", 0.7), ("piano", 0.12)),
    "kitchen": (("dine", 0.85), ("cabinet", 0.3), ("shelf", 0.3), ("plant", 0.3)),
    "bed": (("sleep", 1.0), ("wardrobe", 1.0), ("work_place", 0.4), ("cabinet", 0.5), ("plant", 0.4), ("basket", 0.3)),
    "bath": (("bathtub", 0.6), ("toilet", 0.8), ("basin", 1.0), ("shower", 0.6), ("washer", 0.6), ("basket", 0.6)),
    "hall": (("coat_rack", 0.6), ("cabinet", 0.6), ("wardrobe", 0.4), ("basket", 0.3), ("plant", 0.4)),
    "study": (("work_place", 1.0), ("shelf", 1.0), ("armchair", 0.5), ("cabinet", 0.6), ("plant", 0.6), ("sofa", 0.2)),
    "dining": (("dine", 1.0), ("cabinet", 0.9), ("plant", 0.7), ("shelf", 0.4), ("piano", 0.2)),
    "office": (("work_place", 1.0), ("shelf", 0.7), ("work_place", 0.7), ("cabinet", 0.6), ("dine", 0.2)),
}
"""What each use calls for, in order, with how often."""
_THEN = {
    "living": "shelf cabinet plant armchair lamp sofa plant shelf cabinet pouf",
    "kitchen": "shelf cabinet plant cabinet",
    "bed": "wardrobe shelf cabinet plant lamp wardrobe armchair work_place",
    "bath": "basket cabinet shelf plant",
    "hall": "cabinet plant wardrobe shelf wardrobe cabinet coat_rack",
    "study": "shelf shelf cabinet plant lamp work_place armchair",
    "dining": "plant cabinet shelf lamp armchair sofa",
    "office": "work_place shelf cabinet plant work_place wardrobe coat_rack basket armchair",
}
"""What fills a room up afterwards."""
_AREA_OF_ONE = 12.0
"""A room gets one more of the same kind for each of so many m2."""
_ANYWHERE = "armchair bed cabinet desk lamp plant shelf sofa table wardrobe basket cabinet shelf"
"""What stands where no rooms are known."""


def furnish_rooms(
    plan: Floorplan, density: float, rng: np.random.Generator, rooms: Rooms | None
) -> tuple[Furniture, ...]:
    """Furnish every room; see :func:`galoc_env.furniture.furnish`."""
    if rooms is None:
        from galoc_env.scene.rooms import find_rooms

        rooms = find_rooms(plan, np.random.default_rng(0))  # for its polygons only
    room = FreeRoom(plan)
    found = spaces(rooms, plan, room.open_spots, rng)
    area = max(room.area, 1e-9)
    wanted = density * min(area / AREA_PER_ITEM, MAX_ITEMS)
    per_area = wanted / area
    work = Furnisher(room, rng, math.ceil(wanted) if area / AREA_PER_ITEM > MAX_ITEMS else MAX_ITEMS)
    if density > rng.uniform(0.0, 0.3):
        for space in _for_a_kitchen(found):
            if place_kitchen(room, space, rng):
                break
    for k in rng.permutation(len(found)):
        _furnish_room(work, found[k], per_area * found[k].area + rng.uniform(-0.5, 0.5))
    enclosed = sum(space.area for space in found)
    _scatter(work, round(per_area * max(area - enclosed, 0.0)))
    return (*room.items, *room.rugs)


def _for_a_kitchen(found: list[Space]) -> list[Space]:
    """Where the kitchen goes, best first; it shares a room with something else only where it has to."""
    fit = [space for space in found if space.area >= 6.0]
    order = ("kitchen", "dining", "study", "living") if len(found) < 16 else ("kitchen",)
    return [space for use in order for space in fit if space.use == use]


def _furnish_room(work: Furnisher, space: Space, quota: float) -> None:
    """Put about ``quota`` pieces into a room: what its use calls for, then whatever suits it."""
    rng, begin = work.rng, len(work.room.items)
    missing = [name for name, chance in _FIRST[space.use] if rng.uniform() < chance]
    fillers, counts = _THEN[space.use].split(), dict[str, int]()
    while len(work.room.items) - begin < round(quota) and not work.full and (missing or fillers):
        name = missing.pop(0) if missing else str(rng.choice(fillers))
        done = _GROUPS[name](work, space) if name in _GROUPS else work.single(name, space) is not None
        counts[name] = counts.get(name, 0) + 1
        if not done or counts[name] > space.area / _AREA_OF_ONE:  # what does not fit now will not fit later
            fillers = [filler for filler in fillers if filler != name]


def _scatter(work: Furnisher, target: int) -> None:
    """Put pieces against any wall, or freely in the open: for what no wall encloses."""
    room, rng, names = work.room, work.rng, _ANYWHERE.split()
    begin = len(room.items)
    for _ in range(12 * target):
        if len(room.items) - begin >= target or work.full:
            return
        name = str(rng.choice(names))
        length, width, height = work.size(name)
        if name == "table":
            spot = room.open_spot(rng)
            if spot is not None:
                work.put(Furniture(name, spot[0], spot[1], room.wall_bearing(rng), length, width, height))
            continue
        foot, normal = room.wall_spot(width, rng)
        x, y = foot + normal * (length / 2 + WALL_GAP)
        work.put(Furniture(name, float(x), float(y), math.atan2(normal[1], normal[0]), length, width, height))
