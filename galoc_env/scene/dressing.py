"""What hangs at windows and stands below them: curtains, blinds, radiators."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from galoc_env.scene.ground import Clutter
from galoc_env.scene.light import Lighting
from galoc_env.scene.mesh import FITTING, MeshBuilder
from galoc_env.scene.openings import Hole
from galoc_env.scene.rooms import Rooms
from galoc_env.scene.solids import MakePainter, SolidPainter
from galoc_env.scene.styles import tinge
from galoc_env.scene.windows import FRAME_DEPTH, inner_side, span

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan

Array = NDArray[np.float64]

_CLOTHS = ("fabric", "fabric", "weave", "velvet", "check", "ticking")
_OFF = 0.09
"""Curtains hang this far off the wall, m."""


def add_dressing(
    builder: MeshBuilder,
    plan: Floorplan,
    holes: list[Hole],
    rooms: Rooms,
    clutter: Clutter,
    lighting: Lighting,
    density: float,
    rng: np.random.Generator,
) -> None:
    """Radiators, blinds and curtains, one instance each; their number grows with the density (0..1)."""
    habit = rng.uniform(size=3)  # a home's windows are dressed alike
    ribbed, cloth = bool(rng.uniform() < 0.5), (str(rng.choice(_CLOTHS)), tinge(rng, 0.5, (0.6, 1.05)))
    share = min(1.0, 0.3 + density)
    for hole in holes:
        draws, side = rng.uniform(size=4), inner_side(hole)
        own = np.random.default_rng(rng.integers(1 << 31))
        if hole.opening.kind != "window" or side == 0.0 or hole.opening.width < 0.5:
            continue
        low, high = span(plan, hole)
        window = _Window(hole, rooms, clutter, side, low, high, plan.ceiling_height)

        def painter(hole: Hole = hole, side: float = side) -> SolidPainter:
            return hole.painter(builder, lighting, builder.new_instance(FITTING), side)

        use = rooms.use(window.room)
        if draws[0] < 0.8 * share and low > 0.42:
            window.radiator(painter, ribbed, own)
        if draws[1] < share * (0.2 + 0.6 * habit[0]):
            (window.blind if habit[1] < 0.55 or use in ("office", "kitchen") else window.roller)(painter, own)
        if draws[2] < share * (0.15 + 0.75 * habit[2]) and use not in ("bath", "office"):
            window.curtains(painter, cloth if draws[3] < 0.6 else (str(own.choice(_CLOTHS)), tinge(own, 0.5)), own)


class _Window:
    """A window seen from its room: x along the wall, y into the room from the wall's middle plane, z up."""

    def __init__(
        self, hole: Hole, rooms: Rooms, clutter: Clutter, side: float, low: float, high: float, ceiling: float
    ) -> None:
        self.half, self.face = hole.opening.width / 2, hole.opening.thickness / 2
        self.low, self.high, self.ceiling = low, high, ceiling
        self._hole, self._side, self._rooms, self._clutter = hole, side, rooms, clutter
        self.room = hole.rooms[0 if side > 0 else 1]

    def free(self, x: tuple[float, float], y: tuple[float, float], low: float) -> bool:
        """Whether a box above ``low`` is inside the room and in no piece of furniture."""
        along, out = self._side * self._hole.along, self._side * self._hole.normal
        points = [self._hole.middle + a * along + b * out for a in np.linspace(x[0], x[1], 7) for b in y]
        return bool(np.all(self._rooms.at(points) == self.room)) and not self._clutter.hits(points, low)

    def radiator(self, painter: MakePainter, ribbed: bool, rng: np.random.Generator) -> None:
        """Ribs or a flat panel, on the wall under the sill."""
        half = self.half * rng.uniform(0.6, 1.0)
        bottom, top = 0.12, min(self.low - 0.08, 0.12 + rng.uniform(0.45, 0.65))
        near, far = self.face + 0.03, self.face + 0.11
        if not self.free((-half, half), (near, far), bottom) or top - bottom < 0.2:
            return
        paint, tint = painter(), tinge(rng, 0.05, (0.85, 1.0))
        paint.box("lacquer", (-half, near, bottom), (half, far - 0.025, top), tint, hide="y")
        count = max(3, round(2 * half / (0.07 if ribbed else 0.16)))
        wide = 2 * half / count
        x = -half + wide * np.arange(count)
        a = np.column_stack([x + 0.12 * wide, np.full((count, 1), far - 0.025), np.full((count, 1), bottom)])
        b = np.column_stack([x + 0.88 * wide, np.full((count, 1), far), np.full((count, 1), top)])
        if not ribbed:
            a, b = a[:1] * (1, 1, 1), b[-1:]
        paint.box("lacquer", a, b, tint, hide="yz")
        paint.box("metal", (half, near + 0.02, 0.0), (half + 0.02, near + 0.04, bottom + 0.06), 0.9)
        paint.flush()

    def _shade_plane(self) -> float:
        """Where a blind hangs: in the reveal where it is deep enough, else before the wall."""
        y = FRAME_DEPTH / 2 + 0.05
        return y if self.face > y + 0.02 else self.face + 0.05

    def blind(self, painter: MakePainter, rng: np.random.Generator) -> None:
        """Slats that cover the upper part of the window, more or less open."""
        share, tilt, pitch = rng.uniform(0.25, 1.0), rng.uniform(0.75, 1.3), float(rng.choice((0.06, 0.08)))
        tilt *= float(rng.choice((-1.0, 1.0)))
        y, half, top = self._shade_plane(), self.half - 0.01, self.high - 0.005
        paint = painter()
        wooden = rng.uniform() < 0.25
        name, tint = ("oak", tinge(rng, 0.1, (0.7, 1.0))) if wooden else ("lacquer", tinge(rng, 0.15, (0.75, 1.0)))
        paint.box(name, (-half, y - 0.025, top - 0.05), (half, y + 0.025, top), tint)
        count = max(2, int(share * (top - 0.06 - self.low) / pitch))
        z = top - 0.06 - pitch * (np.arange(count) + 0.5)
        dy, dz = 0.45 * pitch * math.cos(tilt), 0.45 * pitch * math.sin(tilt)
        corners = np.empty((count, 4, 3))
        corners[:, :, 0] = (-half, half, half, -half)
        corners[:, :, 1] = y + np.array([dy, dy, -dy, -dy])
        corners[:, :, 2] = z[:, None] + np.array([-dz, -dz, dz, dz])
        # Between slats lies more light than points far apart can tell: they pass it on, and are seen by it.
        paint.sheets(name, corners, tint, glow=float(rng.uniform(0.65, 0.95)))
        bottom = float(z[-1]) - pitch / 2
        paint.box(name, (-half, y - 0.015, bottom - 0.015), (half, y + 0.015, bottom), tint)
        paint.flush()

    def roller(self, painter: MakePainter, rng: np.random.Generator) -> None:
        """A cloth that lets daylight through, part of the way down."""
        y, half, top = self._shade_plane(), self.half - 0.01, self.high - 0.005
        bottom = top - rng.uniform(0.15, 0.9) * (top - self.low)
        paint, tint = painter(), tinge(rng, 0.35, (0.75, 1.0))
        paint.box("lacquer", (-half, y - 0.025, top - 0.06), (half, y + 0.025, top), 0.95)
        cloth = np.array([[(half, y, bottom), (-half, y, bottom), (-half, y, top - 0.05), (half, y, top - 0.05)]])
        paint.polygons("fabric", cloth, tint, glow=float(rng.uniform(0.8, 1.05)))
        paint.polygons("fabric", cloth[:, ::-1], tint)
        paint.box("lacquer", (-half, y - 0.008, bottom - 0.02), (half, y + 0.012, bottom), 0.9)
        paint.flush()

    def curtains(self, painter: MakePainter, cloth: tuple[str, Array], rng: np.random.Generator) -> None:
        """Two folded cloths on a rod, drawn aside or partly over the window."""
        y, rod = self.face + _OFF, min(self.high + rng.uniform(0.08, 0.3), self.ceiling - 0.06)
        beside, drawn = rng.uniform(0.12, 0.3), rng.uniform(0.0, 0.45)
        outer = self.half + beside
        long = rng.uniform() < 0.65
        bottom = 0.03 if long and self.free((-outer, outer), (y - 0.05, y + 0.06), 0.05) else self.low - 0.12
        if not self.free((-outer - 0.05, outer + 0.05), (y - 0.05, y + 0.06), bottom):
            return
        paint = painter()
        metal = np.full(3, rng.uniform(0.3, 1.0))
        paint.tube("metal", (-outer - 0.06, y, rod), (outer + 0.06, y, rod), (0.012, 0.012), metal, sides=6)
        inner = self.half * (1.0 - drawn)
        for end in (-1.0, 1.0):
            _cloth(paint, cloth, (end * inner, end * outer), (y, bottom, rod - 0.015), rng)
        paint.flush()


def _cloth(
    paint: SolidPainter,
    cloth: tuple[str, Array],
    x: tuple[float, float],
    place: tuple[float, float, float],
    rng: np.random.Generator,
) -> None:
    """A hanging cloth with upright folds that open downwards, seen from the room."""
    low, high = sorted(x)
    y, bottom, top = place
    folds = 2 * max(3, min(7, round((high - low) / 0.075)))
    along = np.linspace(low, high, folds + 1)
    along[1:-1] += rng.uniform(-0.25, 0.25, folds - 1) * (high - low) / folds
    depth = np.where(np.arange(folds + 1) % 2, 1.0, -1.0) * rng.uniform(0.5, 1.0, folds + 1)
    upper = np.column_stack([along, y + 0.022 * depth, np.full(folds + 1, top)])
    lower = np.column_stack([along, y + 0.045 * depth, np.full(folds + 1, bottom)])
    # The room is towards +y, so that a viewer there has x running to the left.
    corners = np.stack([lower[1:], lower[:-1], upper[:-1], upper[1:]], axis=1)
    # A fold's four corners are not quite in one plane: two triangles each.
    paint.polygons(cloth[0], np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]]), cloth[1])
