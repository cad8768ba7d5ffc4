"""What people leave about: things on the floor along the walls, and scuffs on the walls above them.

Things stand so close to walls that no body's centre gets there: they stop nobody, and are no furniture.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from galoc_env.scene.furniture_palette import muted
from galoc_env.scene.light import Lighting
from galoc_env.scene.mesh import MeshBuilder
from galoc_env.scene.rooms import Rooms
from galoc_env.scene.solids import SolidPainter
from galoc_env.scene.walls import Cut, Side

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan

Array = NDArray[np.float64]

DEPTH = 0.24
"""Things reach no further off the wall, m."""
MAX_SCUFFS = 60
"""Most scuffs of a plan."""
WALL_PER_SCUFF = 3.0
"""Length of wall for each scuff at density 1, m."""
_SCUFFED = ("plaster", "rough_plaster", "lacquer", "stripes")
_BRIGHT = np.array([[0.85, 0.25, 0.2], [0.2, 0.42, 0.8], [0.95, 0.78, 0.25], [0.35, 0.65, 0.35], [0.95, 0.95, 0.93]])


def _toy_tint(rng: np.random.Generator) -> Array:
    return np.asarray(_BRIGHT[int(rng.integers(len(_BRIGHT)))] * rng.uniform(0.8, 1.05))


def shoes(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """One or two pairs, toes to the wall."""
    for pair in range(2 if width > 0.5 else 1):
        tint, long, tall = rng.uniform(0.3, 1.0) * muted(rng), rng.uniform(0.17, 0.21), rng.uniform(0.07, 0.11)
        for foot in (-1.0, 1.0):
            y = (0.25 if pair else 0.0) + foot * rng.uniform(0.055, 0.08)
            one = paint.at((0.125, y, 0.0), turn=rng.uniform(-0.15, 0.15))
            a, b, low = long / 2, 0.038, 0.5 * tall
            corners = [(-a, -b, 0.0), (a, -b, 0.0), (-a, b, 0.0), (a, b, 0.0)]
            corners += [(-a, -0.7 * b, low), (a, -0.8 * b, tall), (-a, 0.7 * b, low), (a, 0.8 * b, tall)]
            one.hexahedra("fabric", corners, tint, hide="z")


def books(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """A pile of books or magazines."""
    z = 0.0
    for _ in range(int(rng.integers(2, 6))):
        one = paint.at((0.12, 0.0, z), turn=rng.uniform(-0.35, 0.35))
        a, b, thick = rng.uniform(0.06, 0.085), rng.uniform(0.09, 0.12), rng.uniform(0.012, 0.04)
        one.box("lacquer", (-a, -b, 0.0), (a, b, thick), muted(rng), hide="z")
        z += thick


def toys(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """A ball and blocks."""
    r, y = rng.uniform(0.05, 0.09), rng.uniform(-0.5, 0.5) * (width - 0.2)
    angle = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 5)
    paint.lathe("lacquer", (0.13, y), np.column_stack([r * np.cos(angle), r + r * np.sin(angle)]), _toy_tint(rng),
                sides=8)  # fmt: skip
    for k in range(int(rng.integers(1, 5))):
        s = rng.uniform(0.02, 0.045)
        side = (1.0 if k % 2 else -1.0) * (r + 0.05 + 0.06 * (k // 2))
        block = paint.at((rng.uniform(0.06, 0.17), y + side, 0.0), turn=rng.uniform(0, 3))
        block.box("lacquer", (-s, -s, 0.0), (s, s, rng.uniform(1.0, 2.5) * s), _toy_tint(rng), hide="z")


def bag(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """A bag of cloth with its handle."""
    tint, half, top = muted(rng) * rng.uniform(0.4, 1.0), 0.45 * width, 0.75 * height
    paint.frustum("fabric", (0.04, -half, 0.0), (0.22, half, top), (0.06, 0.12 * width), tint, hide="z")
    points = [
        (0.13, -0.4 * half, top),
        (0.13, -0.3 * half, height),
        (0.13, 0.3 * half, height),
        (0.13, 0.4 * half, top),
    ]
    for start, end in zip(points[:-1], points[1:], strict=True):
        paint.tube("fabric", start, end, (0.008, 0.008), 0.7 * tint, sides=3, ends=False)


def waste_bin(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """A bin, more or less full."""
    r, made = min(width / 2, 0.11), ("metal", "lacquer")[int(rng.integers(2))]
    profile = [(0.8 * r, 0.0), (r, height), (0.93 * r, height), (0.85 * r, rng.uniform(0.4, 0.9) * height)]
    paint.lathe(made, (0.12, 0.0), profile, rng.uniform(0.25, 1.0), sides=8)


def carton(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """A cardboard box, taped up."""
    card = np.array([0.78, 0.62, 0.44]) * rng.uniform(0.8, 1.1)
    half = width / 2 - 0.02
    box = paint.at((0.125, 0.0, 0.0), turn=rng.uniform(-0.06, 0.06))
    box.box("lacquer", (-0.1, -half, 0.0), (0.1, half, height), card, hide="z")
    box.box("lacquer", (-0.1, -0.025, height), (0.1, 0.025, height + 0.002), 1.15 * card, hide="xyYz")


def leaning(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """A picture that nobody has hung up yet."""
    frame = paint.at((0.03 + 0.13 * height, 0.0, 0.0), tilt=0.13)
    half, rim = width / 2, rng.uniform(0.015, 0.04)
    frame.box("lacquer", (-0.02, -half, 0.0), (0.0, half, height), rng.uniform(0.1, 1.0), hide="z")
    low, high = (0.002, rim - half, rim), (0.002, half - rim, height - rim)
    sheet = [[(0.002, low[1], low[2]), (0.002, high[1], low[2]), (0.002, high[1], high[2]), (0.002, low[1], high[2])]]
    frame.polygons(f"art.{int(rng.integers(4))}", sheet, 1.0)


def cable(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """A cable from a socket down and along the wall, to a block of sockets."""
    tint, half = (0.15 if rng.uniform() < 0.5 else 0.9), width / 2
    paint.box("lacquer", (0.0, -half, 0.22), (0.012, 0.08 - half, 0.3), 0.96, hide="x")
    x, y = rng.uniform(0.02, 0.2, 4), np.linspace(0.04 - half, half - 0.2, 5)
    points = [(0.015, float(y[0]), 0.26), *((float(a), float(b), 0.005) for a, b in zip(x, y[1:], strict=True))]
    for start, end in zip(points[:-1], points[1:], strict=True):
        paint.tube("lacquer", start, end, (0.005, 0.005), tint, sides=3, ends=False)
    end = points[-1]
    paint.box("lacquer", (end[0] - 0.025, end[1], 0.0), (end[0] + 0.025, end[1] + 0.2, 0.04), tint, hide="z")


DRAW: dict[str, Callable[[SolidPainter, float, float, np.random.Generator], None]] = {
    "bag": bag,
    "bin": waste_bin,
    "books": books,
    "cable": cable,
    "carton": carton,
    "leaning": leaning,
    "shoes": shoes,
    "toys": toys,
}
"""How each thing on the floor is drawn: at the foot of a wall, x off it, y along it, z up; width and height in m."""


def add_scuffs(
    builder: MeshBuilder,
    plan: Floorplan,
    rooms: Rooms,
    sides: Sequence[Side],
    cuts: list[list[Cut]],
    lighting: Lighting,
    density: float,
    rng: np.random.Generator,
) -> None:
    """Long thin marks, a little darker than the paint, mostly low; they belong to their wall's instance."""
    length = np.array([side.end - side.start for side in sides])
    count = min(int(rng.poisson(density * length.sum() / WALL_PER_SCUFF)), MAX_SCUFFS)
    for k in rng.choice(len(sides), count, p=length / length.sum()) if count else ():
        side, style = sides[int(k)], rooms.style(sides[int(k)].room)
        draw = rng.uniform(size=6)
        long, tall = 0.04 + 0.2 * draw[0] ** 2, 0.006 + 0.012 * draw[1]
        s = side.start + 0.05 + draw[2] * (side.end - side.start - 0.1 - long)
        z = max(style.skirting_height, 0.03) + 0.03 + 0.9 * draw[3] ** 2
        coat = next(coat for top, coat in style.bands(side.normal, plan.ceiling_height) if z < top)
        open_here = any(c.start < s + long and c.end > s and c.bottom < z + 0.1 for c in cuts[side.segment])
        if coat.name not in _SCUFFED or open_here or side.end - side.start < 0.5:
            continue
        t = np.array([0.0, (0.3 + 0.4 * draw[4]) * long, long, 0.5 * long])
        rise = np.array([0.0, -tall / 2, 0.3 * long * (draw[5] - 0.5), tall / 2])
        rightwards = side.normal @ np.array([side.along[1], -side.along[0]]) > 0
        xy = plan.segments[side.segment, :2] + (s + t)[:, None] * side.along + 0.0015 * side.normal
        uv = np.column_stack([(s + t) * (1.0 if rightwards else -1.0), z + rise])
        faces = np.array([(0, 1, 2), (0, 2, 3)])
        builder.add(
            coat.name,
            np.column_stack([xy, z + rise]),
            uv,
            style.light * lighting.wall(side.normal),
            faces if rightwards else faces[:, ::-1],
            side.segment + 1,
            tint=(0.72 + 0.2 * draw[0]) * coat.tint,
        )
