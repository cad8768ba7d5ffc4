"""Seeded multi-room homes: rectilinear, Atlanta (a few walls at other angles) and free-angled.

The same seed gives the same bytes. Training and test homes come from disjoint seed ranges, so no policy or detector
can have met a test home.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from shapely import Polygon, contains_xy, prepare

from galoc import Floorplan, GalocError
from galoc_env import homes_openings, homes_rooms
from galoc_env.wall_builder import Shell, build_plan, rectangle

KINDS = ("rectilinear", "atlanta", "free")
"""Families of wall directions."""
SPLITS = {"train": 0, "test": 1_000_000}
"""First internal seed of each split; each holds a million homes."""
SEEDS_PER_SPLIT = 1_000_000
CLEARANCE_M = 0.3
"""Every room can be reached by a disc of this radius."""
_VERSION = 1
"""Part of every seed: raise it when a change alters the homes."""
_ATTEMPTS = 60


def generate(seed: int, *, kind: str | None = None, split: str = "train") -> Floorplan:
    """A home drawn from a seed.

    Rooms are 3 to 8 m on a side (halls 1.4 to 2 m wide), ceilings 2.4 to 3.2 m, walls 0.08 to 0.3 m, doors 0.75 to
    1 m with some doorless openings of 1.4 to 2.4 m, windows with sills at 0.4 to 1.1 m and heads at 2.0 to 2.3 m. Every
    room can be reached from every other. Entrance doors are shut, hence wall.

    Args:
        seed: 0 to 999 999.
        kind: "rectilinear", "atlanta" or "free"; None: drawn from the seed.
        split: "train" (internal seeds 0 to 999 999) or "test" (1 000 000 to 1 999 999).

    Raises:
        GalocError: seed out of range, unknown kind or split.
    """
    rng = np.random.default_rng([internal_seed(seed, split, kind, KINDS), _VERSION])
    drawn = KINDS[int(rng.integers(len(KINDS)))]
    for _ in range(_ATTEMPTS):
        plan = _attempt(rng, kind or drawn, f"home-{split}-{int(seed)}")
        if plan is not None:
            return plan
    raise GalocError(f"seed {seed} that gave no sound home", "a seed that works", "Choose another seed and report it.")


def internal_seed(seed: int, split: str, kind: str | None, kinds: Sequence[str]) -> int:
    """The seed that a generator draws from: no two splits share one.

    Raises:
        GalocError: seed out of range, unknown split, or a kind that is not among ``kinds``.
    """
    if split not in SPLITS:
        raise GalocError(f"split = {split!r}", f"one of {sorted(SPLITS)}", "Fix the split.")
    if kind is not None and kind not in kinds:
        raise GalocError(f"kind = {kind!r}", f"one of {kinds} or None", "Fix the kind.")
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or not 0 <= seed < SEEDS_PER_SPLIT:
        raise GalocError(f"seed = {seed!r}", f"a whole number from 0 to {SEEDS_PER_SPLIT - 1}", "Choose another seed.")
    return SPLITS[split] + int(seed)


def _attempt(rng: np.random.Generator, kind: str, name: str) -> Floorplan | None:
    """One try at a home, or None when its rooms cannot all be joined."""
    ceiling = round(float(rng.uniform(2.4, 3.2)), 2)
    inner = round(float(rng.uniform(0.08, 0.18)), 2)
    outer = round(float(rng.uniform(0.18, 0.30)), 2)
    rooms = homes_rooms.draw_rooms(rng, kind)
    if rooms is None:
        return None
    shell = Shell(tuple(rooms), inner, outer, tuple(_solids(rng, rooms, inner)))
    if not isinstance(shell.footprint, Polygon) or shell.footprint.interiors:
        return None
    doors = homes_openings.draw_doors(rng, shell, ceiling)
    if doors is None:
        return None
    windows = homes_openings.draw_windows(rng, shell, ceiling)
    plan = build_plan(shell, (*doors, *windows), ceiling, name, f"Generated home, {kind}.")
    return plan if rooms_connected(plan, rooms) else None


def _solids(rng: np.random.Generator, rooms: Sequence[Polygon], inner: float) -> list[Polygon]:
    """Chimneys and closets in some corners, and now and then a pillar."""
    solids = []
    for room in rooms:
        if homes_rooms.narrow(room):
            continue
        corner = np.array(room.exterior.coords[int(rng.integers(len(room.exterior.coords) - 1))])
        width, depth, chance = rng.uniform(0.4, 1.1), rng.uniform(0.4, 0.8), rng.random()
        if chance < 0.35:
            x, y = corner
            box = Polygon(rectangle(x - width, y - depth, x + width, y + depth)).intersection(room)
            solids.append(box)
        elif chance < 0.45:
            side = rng.uniform(0.25, 0.45) / 2.0
            centre = np.array(room.centroid.coords[0]) + rng.uniform(-0.8, 0.8, 2)
            pillar = Polygon(rectangle(centre[0] - side, centre[1] - side, centre[0] + side, centre[1] + side))
            if pillar.within(room.buffer(-inner / 2.0 - 0.7)):  # room to walk around it
                solids.append(pillar)
    return [solid for solid in solids if isinstance(solid, Polygon) and solid.area > 0.02]


def rooms_connected(plan: Floorplan, rooms: Sequence[Polygon]) -> bool:
    """Whether a disc of 0.3 m gets from any room into most of every other."""
    free = plan.free_space(0.05)
    reachable = free.largest_room(CLEARANCE_M)
    roomy = free.positions(CLEARANCE_M)
    rows, cols = free.index(roomy).T
    connected = reachable[rows, cols]
    for room in rooms:
        prepare(room)
        within = contains_xy(room, roomy[:, 0], roomy[:, 1])
        if not np.any(within) or np.mean(connected[within]) < 0.8:
            return False
    return True
