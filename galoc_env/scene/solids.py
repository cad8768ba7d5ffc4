"""Solids of few facets: what furniture and frames are put together from."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc_env.scene.light import Lighting
from galoc_env.scene.mesh import MeshBuilder
from galoc_env.scene.solids_faces import circle, facing, normals, texture

Array = NDArray[np.float64]
Triple = tuple[float, float, float]

FOOT_SHADE = 0.80
"""Light at the foot of an upright face, relative to its top."""
SIDES = "xXyYzZ"
"""Names of a box's faces: small letters for the low side, capitals for the high side of each axis."""
# Corner of a box by the bits x, y, z (1, 2, 4); four corners a face, counter-clockwise from outside, in SIDES' order.
_CORNER = np.array([[k & 1, k >> 1 & 1, k >> 2] for k in range(8)], bool)
_FACES = np.array([[2, 0, 4, 6], [1, 3, 7, 5], [0, 1, 5, 4], [3, 2, 6, 7], [2, 3, 1, 0], [4, 5, 7, 6]])


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Convex polygons of one look that wait to be added."""

    look: tuple[str, tuple[float, ...], float]
    """Material, tint, glow."""
    flat: Array
    """(F, K, 3) m: corners in the part's own frame, which its texture is aligned with."""
    corners: Array
    """(F, K, 3) m: corners in the piece's frame."""


@dataclass(frozen=True, slots=True, eq=False)
class SolidPainter:
    """Adds solids of one instance, placed in a frame that stands on the floor at (x, y), turned by heading.

    Faces are seen from outside only; textures run in metres, upright on upright faces. Nothing is in the builder before
    :meth:`flush`.
    """

    builder: MeshBuilder
    """Where the faces go."""
    lighting: Lighting
    """Brightness by direction."""
    x: float
    """Origin of the frame, m."""
    y: float
    """Origin of the frame, m."""
    heading: float
    """Bearing of the frame's x axis, rad."""
    light: float
    """Factor on the brightness."""
    instance: int
    """Instance number of all faces."""
    queue: list[Part] = field(default_factory=list)
    """Parts that wait for :meth:`flush`: adding many at once is much faster."""
    turn: Array | None = None
    """(3, 3) rotation of the part's frame (rows are its axes) within the piece's; None: none."""
    shift: Triple = (0.0, 0.0, 0.0)
    """Origin of the part's frame within the piece's, m."""

    def at(self, shift: Triple, *, tilt: float = 0.0, roll: float = 0.0, turn: float = 0.0) -> SolidPainter:
        """The same painter with a frame of its own.

        Args:
            shift: origin of the new frame in this one, m.
            tilt: about y, rad: leans an upright part backwards, towards -x.
            roll: about x, rad: leans it sideways, towards -y.
            turn: about z, rad, counter-clockwise, after the others.
        """
        ct, st, cr, sr, cz, sz = (f(a) for a in (tilt, roll, turn) for f in (math.cos, math.sin))
        lean = np.array([[ct, 0, st], [0, 1, 0], [-st, 0, ct]])
        side = np.array([[1, 0, 0], [0, cr, sr], [0, -sr, cr]])
        axes = lean @ side @ np.array([[cz, sz, 0], [-sz, cz, 0], [0, 0, 1]])
        place = np.asarray(shift, np.float64)
        if self.turn is not None:
            axes, place = axes @ self.turn, place @ self.turn
        place = place + self.shift
        return replace(self, turn=axes, shift=(float(place[0]), float(place[1]), float(place[2])))

    def polygons(self, name: str, corners: ArrayLike, tint: ArrayLike = 1.0, *, glow: float = 0.0) -> None:
        """Flat convex polygons (F, K, 3) m, counter-clockwise from the visible side."""
        flat = np.asarray(corners, np.float64)
        placed = flat if self.turn is None else flat @ self.turn + self.shift
        colour = tuple(np.broadcast_to(np.asarray(tint, np.float64), (3,)).tolist())
        self.queue.append(Part((name, colour, glow), flat, placed))

    def flush(self) -> None:
        """Add what the queue holds."""
        for count in sorted({part.flat.shape[1] for part in self.queue}):
            self._add([part for part in self.queue if part.flat.shape[1] == count])
        self.queue.clear()

    def _add(self, parts: list[Part]) -> None:
        """Add parts whose polygons all have the same number of corners: one call of the builder for each look."""
        parts = sorted(parts, key=lambda part: part.look)
        flat = np.concatenate([part.flat for part in parts])
        corners = np.concatenate([part.corners for part in parts])
        c, s = math.cos(self.heading), math.sin(self.heading)
        world = corners @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + (self.x, self.y, 0.0)
        normal = normals(world)
        light = self.light * facing(self.lighting, normal)[:, None] * np.ones(flat.shape[1])
        upright = np.abs(normal[:, 2]) < 0.5
        low = FOOT_SHADE + (1 - FOOT_SHADE) * np.minimum(1.0, np.abs(world[upright, :, 2]) / 0.6)
        light[upright] *= low
        uv = texture(flat)
        ends = np.cumsum([len(part.flat) for part in parts])
        first = 0
        for k, part in enumerate(parts):
            if k + 1 < len(parts) and parts[k + 1].look == part.look:
                continue
            mine = slice(first, int(ends[k]))
            name, tint, glow = part.look
            count, sides = world[mine].shape[:2]
            fan = np.stack([np.zeros(sides - 2, np.int64), np.arange(1, sides - 1), np.arange(2, sides)], 1)
            faces = (sides * np.arange(count)[:, None, None] + fan).reshape(-1, 3)
            points, where, shade = world[mine].reshape(-1, 3), uv[mine].reshape(-1, 2), light[mine].ravel()
            self.builder.add(name, points, where, shade, faces, self.instance, tint=tint, glow=glow)
            first = int(ends[k])

    def box(
        self, name: str, low: ArrayLike, high: ArrayLike, tint: ArrayLike = 1.0, *, glow: float = 0.0, hide: str = ""
    ) -> None:
        """Boxes between two corners of the frame: (3,) each, or (N, 3) for many. ``hide`` leaves :data:`SIDES` out."""
        a, b = np.asarray(low, np.float64).reshape(-1, 3), np.asarray(high, np.float64).reshape(-1, 3)
        self.hexahedra(name, np.where(_CORNER, b[:, None], a[:, None]), tint, glow=glow, hide=hide)

    def hexahedra(
        self, name: str, corners: ArrayLike, tint: ArrayLike = 1.0, *, glow: float = 0.0, hide: str = ""
    ) -> None:
        """Solids (N, 8, 3) with a box's faces; corner k is low or high in x, y, z by the bits 1, 2, 4 of k."""
        c = np.asarray(corners, np.float64).reshape(-1, 8, 3)
        if self.turn is None and c[:, :, 2].min() < 0.01 and c[:, :4, 2].max() < 0.01:
            hide += "z"  # stands on the floor
        shown = [k for k, side in enumerate(SIDES) if side not in hide]
        self.polygons(name, c[:, _FACES[shown]].reshape(-1, 4, 3), tint, glow=glow)

    def frustum(
        self,
        name: str,
        low: ArrayLike,
        high: ArrayLike,
        inset: tuple[float, float],
        tint: ArrayLike = 1.0,
        *,
        hide: str = "",
        foot: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """A box whose top is smaller by ``inset`` (x, y) m on each side, and its bottom by ``foot``."""
        a, b = np.asarray(low, np.float64), np.asarray(high, np.float64)
        corners = np.where(_CORNER, b, a)
        shrink = np.where(_CORNER[:, 2:], np.array(inset), np.array(foot))
        corners[:, :2] += np.where(_CORNER[:, :2], -shrink, shrink)
        self.hexahedra(name, corners, tint, hide=hide)

    def loft(
        self,
        name: str,
        rings: ArrayLike,
        tint: ArrayLike = 1.0,
        *,
        low: bool = False,
        high: bool = True,
        glow: float = 0.0,
    ) -> None:
        """Skin over rings (R, K, 3), each counter-clockwise seen from the last; ``low`` and ``high`` close the ends."""
        r = np.asarray(rings, np.float64)
        after = np.roll(r, -1, axis=1)
        faces = np.stack([r[:-1], after[:-1], after[1:], r[1:]], axis=2)
        point = np.abs(r - r[:, :1]).max(axis=(1, 2)) < 1e-9  # rings that have shrunk to a point
        full = ~(point[:-1] | point[1:])
        if full.any():
            self.polygons(name, faces[full].reshape(-1, 4, 3), tint, glow=glow)
        for k in np.flatnonzero(~full):
            self.polygons(name, faces[k][:, 1:] if point[k] else faces[k][:, :3], tint, glow=glow)
        if low:
            self.polygons(name, r[:1, ::-1], tint, glow=glow)
        if high:
            self.polygons(name, r[-1:], tint, glow=glow)

    def cushion(
        self, name: str, low: Triple, high: Triple, bevel: float, tint: ArrayLike = 1.0, *, both: bool = False
    ) -> None:
        """A box with rounded upright edges and upper rim, m; ``both``: a rounded lower rim too, and a bottom."""
        bevel = min(bevel, 0.49 * (high[2] - low[2]), 0.28 * (high[0] - low[0]), 0.28 * (high[1] - low[1]))
        rims = [(0.0, low[2]), (0.0, high[2] - bevel), (bevel, high[2])]
        if both:
            rims = [(bevel, low[2]), (0.0, low[2] + bevel), *rims[1:]]
        rings = []
        for inset, z in rims:
            x0, y0, x1, y1 = low[0] + inset, low[1] + inset, high[0] - inset, high[1] - inset
            c = 0.7 * bevel
            flat = [(x0 + c, y0), (x1 - c, y0), (x1, y0 + c), (x1, y1 - c)]
            flat += [(x1 - c, y1), (x0 + c, y1), (x0, y1 - c), (x0, y0 + c)]
            rings.append([(x, y, z) for x, y in flat])
        self.loft(name, rings, tint, low=both)

    def prism(
        self,
        name: str,
        centre: ArrayLike,
        radii: tuple[float, float],
        tint: ArrayLike = 1.0,
        *,
        sides: int = 10,
        glow: float = 0.0,
    ) -> None:
        """Upright frustum with ``centre`` = (x, y, z_low, z_high) and the radii of its lower and upper end, m."""
        x, y, z0, z1 = (float(v) for v in np.asarray(centre, np.float64))
        self.lathe(name, (x, y), ((radii[0], z0), (radii[1], z1)), tint, sides=sides, low=z0 > 0.01, glow=glow)

    def lathe(
        self,
        name: str,
        centre: tuple[float, float],
        profile: ArrayLike,
        tint: ArrayLike = 1.0,
        *,
        sides: int = 10,
        low: bool = False,
        high: bool = True,
        glow: float = 0.0,
        stretch: float = 1.0,
    ) -> None:
        """Solid of revolution about an upright axis through ``centre``.

        Args:
            name: material.
            centre: (x, y) m.
            profile: (R, 2) radius and height, m, upwards; going inwards and down again makes a hollow.
            tint: factor on the texture.
            sides: corners of each ring.
            low: close the lower end.
            high: close the upper end.
            glow: brightness of a body that shines by itself.
            stretch: factor on the extent along x.
        """
        p = np.asarray(profile, np.float64)
        ring = circle(sides) * (stretch, 1.0)
        rings = np.empty((len(p), sides, 3))
        rings[..., :2] = p[:, None, :1] * ring + centre
        rings[..., 2] = p[:, 1:]
        high, low = high and p[-1, 0] > 1e-9, low and p[0, 0] > 1e-9
        self.loft(name, rings, tint, low=low, high=high, glow=glow)

    def tube(
        self,
        name: str,
        start: Triple,
        end: Triple,
        radii: tuple[float, float],
        tint: ArrayLike = 1.0,
        *,
        sides: int = 5,
        ends: bool = True,
    ) -> None:
        """Round bar from point to point with the radii of both ends, m."""
        a, b = np.asarray(start, np.float64), np.asarray(end, np.float64)
        along = (b - a) / max(float(np.linalg.norm(b - a)), 1e-9)
        side = np.array([1.0, 0.0, 0.0]) if abs(along[0]) < 0.7 else np.array([0.0, 1.0, 0.0])
        u = side - along * (side @ along)
        u /= np.linalg.norm(u)
        v = np.array(
            [
                along[1] * u[2] - along[2] * u[1],
                along[2] * u[0] - along[0] * u[2],
                along[0] * u[1] - along[1] * u[0],
            ]
        )
        ring = circle(sides) @ np.stack([u, v])
        low = ends and (self.turn is not None or a[2] > 0.01)  # what stands on the floor has no bottom
        rings = np.stack([a + radii[0] * ring, b + radii[1] * ring])
        if self.turn is None:
            rings[..., 2] = np.maximum(rings[..., 2], 0.0)  # a splayed leg ends on the floor
        self.loft(name, rings, tint, low=low, high=ends)

    def extrusion(
        self, name: str, outline: ArrayLike, z: tuple[float, float], tint: ArrayLike = 1.0, *, low: bool = True
    ) -> None:
        """Upright solid over a convex outline (K, 2) m, counter-clockwise, between two heights."""
        flat = np.asarray(outline, np.float64)
        rings = [np.column_stack([flat, np.full(len(flat), height)]) for height in z]
        self.loft(name, rings, tint, low=low and z[0] > 0.01)

    def sheets(self, name: str, corners: ArrayLike, tint: ArrayLike = 1.0, *, glow: float = 0.0) -> None:
        """Flat convex polygons (F, K, 3) m seen from both sides."""
        c = np.asarray(corners, np.float64)
        self.polygons(name, np.concatenate([c, c[:, ::-1]]), tint, glow=glow)


MakePainter = Callable[[], SolidPainter]
"""Makes an instance only when there is something to draw."""
