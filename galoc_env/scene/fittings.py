"""What hangs on the walls: pictures, mirrors, clocks, shelves, screens, switches."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from galoc_env.scene.fittings_draw import DRAW
from galoc_env.scene.ground import Clutter
from galoc_env.scene.light import Lighting
from galoc_env.scene.litter import DEPTH, add_scuffs
from galoc_env.scene.litter import DRAW as DRAW_LITTER
from galoc_env.scene.mesh import FITTING, MeshBuilder
from galoc_env.scene.openings import Hole
from galoc_env.scene.rooms import CORE, Rooms
from galoc_env.scene.solids import SolidPainter
from galoc_env.scene.walls import Cut, Side

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan

Array = NDArray[np.float64]

MAX_FITTINGS = 220
"""Most fittings of a plan, beside switches: huge plans stay fast to build and to draw."""
WALL_PER_FITTING = 3.2
"""Length of wall for each fitting at density 1, m."""
WALL_PER_THING = 4.5
"""Length of wall for each thing on the floor at density 1, m; half the density has a quarter of them."""
_CLEAR = 0.25
"""From the edge of a window to a fitting: room for curtains, m."""
_TRIES = 4
"""Places that are tried for each fitting."""

_WANTED: dict[str, dict[str, float]] = {
    "living": {"pictures": 5, "poster": 0.8, "mirror": 0.7, "tv": 1.2, "shelf": 1.2, "clock": 0.5, "sconce": 0.6},
    "bed": {"pictures": 3, "poster": 1.5, "mirror": 1.0, "shelf": 0.8, "sconce": 0.8, "hooks": 0.4, "tv": 0.3},
    "kitchen": {"pictures": 1.5, "calendar": 0.8, "notes": 0.8, "clock": 1.2, "shelf": 1.8, "hooks": 0.5, "board": 0.3},
    "bath": {"mirror": 2.0, "towels": 2.0, "hooks": 0.8, "shelf": 0.6},
    "hall": {"pictures": 4, "calendar": 0.5, "mirror": 1.2, "hooks": 1.2, "clock": 0.5, "sconce": 0.7},
    "office": {"board": 2.0, "pictures": 1.5, "calendar": 1.0, "notes": 1.0, "clock": 1.0, "shelf": 1.0, "tv": 0.5},
    "other": {"pictures": 3.0, "board": 1.0, "clock": 0.5, "sconce": 0.5, "shelf": 0.5},
}
"""How often each kind is tried, by the use of the room."""
_LITTER: dict[str, dict[str, float]] = {
    "living": {"books": 1.0, "cable": 1.5, "toys": 1.5, "bag": 0.7, "leaning": 0.5, "carton": 0.4},
    "bed": {"books": 1.0, "shoes": 1.0, "toys": 1.0, "bag": 1.0, "cable": 1.0, "carton": 0.6, "leaning": 0.5},
    "kitchen": {"bin": 2.0, "carton": 0.6, "bag": 1.0, "toys": 0.4},
    "bath": {"bin": 1.5, "shoes": 0.4, "bag": 0.4},
    "hall": {"shoes": 3.0, "bag": 1.5, "carton": 0.7, "toys": 0.4},
    "office": {"bin": 1.5, "cable": 2.0, "carton": 1.0, "bag": 0.7, "books": 1.0},
    "other": {"carton": 1.0, "cable": 1.0, "bin": 1.0, "leaning": 0.5, "books": 0.5},
}
"""The same for what stands on the floor."""
_ONCE = {"tv", "clock", "board", "bin", "calendar"}
"""No room has two of these."""
_BELOW = {"tv": 0.55}
"""What hangs over no higher furniture, m: nobody watches a screen above a sofa."""


@dataclass(frozen=True, slots=True)
class _Size:
    """Extent of a kind of fitting, m."""

    width: tuple[float, float]
    height: tuple[float, float]
    bottom: tuple[float, float]
    depth: float


_SIZES = {
    "bag": _Size((0.3, 0.4), (0.35, 0.5), (0.0, 0.0), DEPTH),
    "bin": _Size((0.24, 0.26), (0.25, 0.4), (0.0, 0.0), DEPTH),
    "board": _Size((0.9, 1.8), (0.6, 1.0), (0.9, 1.1), 0.03),
    "books": _Size((0.26, 0.28), (0.2, 0.2), (0.0, 0.0), DEPTH),
    "cable": _Size((0.7, 1.3), (0.3, 0.3), (0.0, 0.0), DEPTH),
    "calendar": _Size((0.24, 0.34), (0.34, 0.48), (1.2, 1.4), 0.01),
    "carton": _Size((0.3, 0.45), (0.2, 0.35), (0.0, 0.0), DEPTH),
    "clock": _Size((0.24, 0.38), (0.24, 0.38), (1.7, 1.9), 0.05),
    "hooks": _Size((0.4, 0.9), (0.6, 0.7), (1.1, 1.2), 0.16),
    "leaning": _Size((0.4, 0.8), (0.4, 0.7), (0.0, 0.0), 0.15),
    "mirror": _Size((0.4, 0.9), (0.6, 1.5), (0.4, 1.1), 0.04),
    "notes": _Size((0.3, 0.6), (0.2, 0.4), (1.2, 1.4), 0.01),
    "pictures": _Size((0.3, 1.4), (0.3, 0.9), (1.0, 1.5), 0.04),
    "poster": _Size((0.4, 0.75), (0.55, 1.0), (0.9, 1.2), 0.01),
    "sconce": _Size((0.14, 0.2), (0.2, 0.3), (1.5, 1.7), 0.14),
    "shelf": _Size((0.5, 1.2), (0.3, 0.7), (1.2, 1.6), 0.22),
    "shoes": _Size((0.3, 0.6), (0.12, 0.12), (0.0, 0.0), DEPTH),
    "towels": _Size((0.45, 0.7), (0.6, 1.2), (0.5, 1.0), 0.12),
    "toys": _Size((0.4, 0.6), (0.2, 0.2), (0.0, 0.0), DEPTH),
    "tv": _Size((0.9, 1.5), (0.52, 0.85), (0.8, 1.1), 0.07),
}
_DRAW = DRAW | DRAW_LITTER


class _Walls:
    """Sides of walls that face rooms, with what is taken of each."""

    def __init__(self, plan: Floorplan, sides: list[Side], cuts: list[list[Cut]], clutter: Clutter) -> None:
        self._plan, self._clutter = plan, clutter
        self.sides = self._inner([side for side in sides if side.room != CORE and side.end - side.start > 0.5])
        self.length = np.array([side.end - side.start for side in self.sides])
        self._taken = [
            [(c.start - _CLEAR, c.end + _CLEAR, -math.inf, math.inf) for c in cuts[side.segment]] for side in self.sides
        ]

    def _inner(self, sides: list[Side]) -> list[Side]:
        """Those that face the inside of the building."""
        space, off = self._plan.free_space(), 0.3
        if not sides:
            return []
        before = np.array([self.foot(side, (side.start + side.end) / 2) + off * side.normal for side in sides])
        row, col = space.index(before).T
        found = (row >= 0) & (row < space.inside.shape[0]) & (col >= 0) & (col < space.inside.shape[1])
        found[found] = space.inside[row[found], col[found]]
        return [side for side, inside in zip(sides, found, strict=True) if inside]

    def foot(self, side: Side, s: float) -> Array:
        """(2,) m: a point of the wall at its foot."""
        return np.asarray(self._plan.segments[side.segment, :2] + s * side.along)

    def find(
        self,
        mine: NDArray[np.int64],
        size: tuple[float, float, float],
        low: float,
        rng: np.random.Generator,
        below: float = math.inf,
    ) -> tuple[Side, float] | None:
        """Free room on one of some sides: the side, and how far along it, m.

        Args:
            mine: numbers of the sides.
            size: width, height and depth of a box, m.
            low: its lower edge, m.
            rng: source of the choice.
            below: nothing higher than this may stand under it, m.
        """
        width, height, depth = size
        high = low + height
        fits = np.where(self.length[mine] > width + 0.2, np.minimum(self.length[mine], 6.0), 0.0)
        if fits.sum() == 0.0 or high > self._plan.ceiling_height - 0.12:
            return None
        for k in rng.choice(mine, _TRIES, p=fits / fits.sum()):
            side = self.sides[k]
            s = float(rng.uniform(side.start + width / 2 + 0.1, side.end - width / 2 - 0.1))
            span = (s - width / 2 - 0.06, s + width / 2 + 0.06)
            if any(span[1] > t[0] and span[0] < t[1] and low < t[3] and high > t[2] for t in self._taken[k]):
                continue
            line = np.array([self.foot(side, v) for v in np.linspace(*span, 6)])
            if self._clutter.hits(
                np.concatenate([line + 0.05 * side.normal, line + depth * side.normal]), min(low, below)
            ):
                continue
            self._taken[k].append((*span, low - 0.05, high + 0.05))
            return side, s
        return None


def _draw_kinds(use: str, wall: float, density: float, most: int, rng: np.random.Generator) -> list[str]:
    """What is tried in a room with so many m of wall: fittings, then things on the floor, ``most`` at most."""
    kinds: list[str] = []
    for table, mean in ((_WANTED, density * wall / WALL_PER_FITTING), (_LITTER, density**2 * wall / WALL_PER_THING)):
        chances = np.array(list(table[use].values()))
        count = min(int(rng.poisson(mean)), most - len(kinds))
        kinds += [str(kind) for kind in rng.choice(list(table[use]), count, p=chances / chances.sum())]
    return kinds


def add_fittings(
    builder: MeshBuilder,
    plan: Floorplan,
    rooms: Rooms,
    sides: list[Side],
    cuts: list[list[Cut]],
    clutter: Clutter,
    lighting: Lighting,
    density: float,
    rng: np.random.Generator,
) -> None:
    """Things on the walls, one instance each; their number grows with the density (0..1)."""
    walls = _Walls(plan, sides, cuts, clutter)
    if not walls.sides or density == 0.0:
        return
    left = MAX_FITTINGS
    stands = [(box.x, box.y) for box in clutter.boxes if getattr(box, "kind", "") == "tv_stand"]
    screens = rooms.at(np.array(stands).reshape(-1, 2)).tolist()
    by_room: dict[int, list[int]] = {}
    for k, side in enumerate(walls.sides):
        by_room.setdefault(side.room, []).append(k)
    for room in sorted(by_room):
        own = np.random.default_rng(rng.integers(1 << 31))
        mine = np.array(by_room[room])
        most = 18 if room >= 0 else left
        kinds = _draw_kinds(rooms.use(room), walls.length[mine].sum(), density, min(most, left), own)
        left -= len(kinds)
        once = {"tv"} if room in screens else set[str]()
        for kind in kinds:
            size = _SIZES[kind]
            width, height, low = (float(own.uniform(*span)) for span in (size.width, size.height, size.bottom))
            if kind in once:
                continue
            found = walls.find(mine, (width, height, size.depth), low, own, _BELOW.get(kind, math.inf))
            if found is not None:
                side, s = found
                once.update({kind} & _ONCE)
                paint = _painter(builder, walls.foot(side, s), side.normal, low, rooms.style(room).light, lighting)
                _DRAW[kind](paint, width, height, own)
                paint.flush()
    add_scuffs(builder, plan, rooms, walls.sides, cuts, lighting, density, rng)


def add_switches(
    builder: MeshBuilder, plan: Floorplan, holes: list[Hole], lighting: Lighting, rng: np.random.Generator
) -> None:
    """A switch beside every door, on each side that has wall there, some above a socket; one instance each."""
    import shapely

    walls = shapely.multilinestrings(shapely.linestrings(plan.segments.reshape(-1, 2, 2)))
    shapely.prepare(walls)
    for hole in holes[:MAX_FITTINGS]:
        if hole.opening.kind != "door" or hole.opening.top < 1.5:
            continue
        end, high = float(rng.choice((-1.0, 1.0))), float(rng.uniform(0.95, 1.15))
        for side, room, style in zip((1.0, -1.0), hole.rooms, hole.styles, strict=True):
            socket = rng.uniform() < 0.5
            foot = hole.middle + side * hole.opening.thickness / 2 * hole.normal
            foot = foot + end * (hole.opening.width / 2 + 0.2) * hole.along
            if room < 0 or shapely.distance(walls, shapely.points(foot)) > 0.01:
                continue
            paint = _painter(builder, foot, side * hole.normal, high, style.light, lighting)
            DRAW["switch"](paint, 0.085, 0.085, rng)
            if socket:
                DRAW["switch"](paint.at((0.0, 0.0, 0.3 - high)), 0.085, 0.085, rng)
            paint.flush()


def _painter(
    builder: MeshBuilder, foot: Array, normal: Array, low: float, light: float, lighting: Lighting
) -> SolidPainter:
    """Frame on a wall at a height: x off the wall, y along it (to the left for who looks out of it), z up."""
    heading = math.atan2(normal[1], normal[0])
    instance = builder.new_instance(FITTING)
    paint = SolidPainter(builder, lighting, float(foot[0]), float(foot[1]), heading, light, instance)
    return paint.at((0.0, 0.0, low))
