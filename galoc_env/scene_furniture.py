"""What each kind of furniture looks like: boxes and prisms inside the piece's own box."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from galoc_env.furniture import Furniture
from galoc_env.scene_light import Lighting
from galoc_env.scene_mesh import FURNITURE, MeshBuilder
from galoc_env.scene_rooms import Rooms
from galoc_env.scene_solids import SolidPainter

Array = NDArray[np.float64]
Draw = Callable[[SolidPainter, Furniture, np.random.Generator], None]


def add_furniture(
    builder: MeshBuilder, items: Sequence[Furniture], rooms: Rooms, lighting: Lighting, rng: np.random.Generator
) -> None:
    """All pieces, one instance each."""
    chair_seed = int(rng.integers(1 << 31))  # all chairs of a home match
    found = rooms.at(np.array([(item.x, item.y) for item in items]).reshape(-1, 2))
    for item, room in zip(items, found, strict=True):
        light = rooms.style(int(room)).light
        paint = SolidPainter(builder, lighting, item.x, item.y, item.heading, light, builder.new_instance(FURNITURE))
        _DRAW[item.kind](paint, item, np.random.default_rng(chair_seed) if item.kind == "chair" else rng)


def _cloth(rng: np.random.Generator) -> Array:
    """A muted random colour, as a factor on light grey cloth."""
    hue, depth = rng.uniform(0, 2 * math.pi), rng.uniform(0.15, 0.5)
    return rng.uniform(0.55, 1.0) * (1.0 - depth * (0.5 + 0.5 * np.cos(hue + np.array([0.0, 2.1, 4.2]))))


def _timber(rng: np.random.Generator) -> tuple[str, Array]:
    """Wood in some tone, or white lacquer."""
    if rng.uniform() < 0.35:
        return "lacquer", np.full(3, rng.uniform(0.85, 1.0))
    return "wood", rng.uniform(0.65, 1.0) * np.array([1.0, rng.uniform(0.9, 1.0), rng.uniform(0.85, 1.0)])


def _legs(paint: SolidPainter, name: str, tint: Array, half: tuple[float, float], top: float, thick: float) -> None:
    """Four square legs at the corners of a rectangle (half length, half width)."""
    a, b = half
    for x in (-a, a - thick):
        for y in (-b, b - thick):
            paint.box(name, (x, y, 0.0), (x + thick, y + thick, top), tint)


def _table(paint: SolidPainter, item: Furniture, rng: np.random.Generator) -> None:
    name, tint = _timber(rng)
    a, b, top = item.length / 2, item.width / 2, item.height
    paint.box(name, (-a, -b, top - 0.04), (a, b, top), tint)
    _legs(paint, name, 0.9 * tint, (a - 0.03, b - 0.03), top - 0.04, 0.06)


def _desk(paint: SolidPainter, item: Furniture, rng: np.random.Generator) -> None:
    name, tint = _timber(rng)
    a, b, top = item.length / 2, item.width / 2, item.height
    paint.box(name, (-a, -b, top - 0.03), (a, b, top), tint)
    paint.box(name, (-a, -b, 0.0), (a - 0.05, -b + 0.03, top - 0.03), tint)
    paint.box(name, (-a, b - 0.42, 0.05), (a - 0.05, b, top - 0.03), 0.93 * tint)
    screen = np.full(3, 0.16)
    y = rng.uniform(-0.3, 0.0) * b
    paint.box("lacquer", (-a + 0.15, y - 0.10, top), (-a + 0.32, y + 0.10, top + 0.015), screen)
    paint.box("lacquer", (-a + 0.20, y - 0.02, top + 0.015), (-a + 0.23, y + 0.02, top + 0.15), screen)
    paint.box("lacquer", (-a + 0.21, y - 0.28, top + 0.12), (-a + 0.24, y + 0.28, top + 0.45), screen)


def _chair(paint: SolidPainter, item: Furniture, rng: np.random.Generator) -> None:
    name, tint = _timber(rng)
    a, b, seat = item.length / 2, item.width / 2, 0.46
    _legs(paint, name, tint, (a, b), seat - 0.04, 0.04)
    paint.box("fabric" if rng.uniform() < 0.5 else name, (-a, -b, seat - 0.04), (a, b, seat), tint)
    for y in (-b, b - 0.04):
        paint.box(name, (-a, y, seat), (-a + 0.035, y + 0.04, item.height), tint)
    paint.box(name, (-a, -b + 0.04, item.height - 0.22), (-a + 0.03, b - 0.04, item.height - 0.02), tint)


def _sofa(paint: SolidPainter, item: Furniture, rng: np.random.Generator) -> None:
    tint = _cloth(rng)
    a, b, arm = item.length / 2, item.width / 2, 0.17
    _legs(paint, "wood", np.full(3, 0.5), (a - 0.05, b - 0.05), 0.1, 0.05)
    paint.box("fabric", (-a, -b, 0.1), (a - 0.02, b, 0.30), 0.85 * tint)
    paint.box("fabric", (-a, -b, 0.30), (-a + 0.22, b, item.height), tint)
    for y in (-b, b - arm):
        paint.box("fabric", (-a + 0.22, y, 0.30), (a, y + arm, 0.60), tint)
    seats = max(1, round((item.width - 2 * arm) / 0.65))
    each = (item.width - 2 * arm) / seats
    for k in range(seats):
        y = -b + arm + k * each
        paint.box("fabric", (-a + 0.22, y + 0.01, 0.30), (a, y + each - 0.01, 0.45), 0.96 * tint)
        paint.box("fabric", (-a + 0.22, y + 0.02, 0.45), (-a + 0.36, y + each - 0.02, item.height - 0.06), 0.93 * tint)


def _bed(paint: SolidPainter, item: Furniture, rng: np.random.Generator) -> None:
    name, tint = _timber(rng)
    cover = _cloth(rng)
    a, b = item.length / 2, item.width / 2
    paint.box(name, (-a, -b, 0.0), (-a + 0.06, b, item.height), tint)
    paint.box(name, (-a + 0.06, -b, 0.08), (a, b, 0.30), tint)
    _legs(paint, name, 0.8 * tint, (a - 0.06, b - 0.02), 0.08, 0.06)
    paint.box("fabric", (-a + 0.06, -b + 0.03, 0.30), (a - 0.03, b - 0.03, 0.48), np.ones(3))
    paint.box("fabric", (-a + 0.65, -b + 0.01, 0.32), (a - 0.02, b - 0.01, 0.52), cover)
    pillows = 2 if item.width > 1.35 else 1
    each = (item.width - 0.1) / pillows
    for k in range(pillows):
        y = -b + 0.05 + k * each
        paint.box("fabric", (-a + 0.10, y + 0.05, 0.48), (-a + 0.52, y + each - 0.05, 0.60), np.full(3, 1.15))


def _shelf(paint: SolidPainter, item: Furniture, rng: np.random.Generator) -> None:
    name, tint = _timber(rng)
    a, b, top = item.length / 2, item.width / 2, item.height
    for y in (-b, b - 0.025):
        paint.box(name, (-a, y, 0.0), (a, y + 0.025, top), tint)
    paint.box(name, (-a, -b + 0.025, 0.0), (-a + 0.015, b - 0.025, top), 0.8 * tint)
    boards = int(top // 0.38)
    pitch = (top - 0.03) / boards
    for k in range(boards + 1):
        z = k * pitch
        paint.box(name, (-a + 0.015, -b + 0.025, z), (a, b - 0.025, z + 0.03), tint)
        if k < boards and rng.uniform() < 0.85:
            start = -b + 0.03 + rng.uniform(0.0, 0.3) * item.width
            end = min(start + rng.uniform(0.25, 0.7) * item.width, b - 0.03)
            tall = z + 0.03 + rng.uniform(0.6, 0.85) * (pitch - 0.03)
            paint.box("books", (-a + 0.02, start, z + 0.03), (a - 0.06, end, tall), rng.uniform(0.7, 1.0))


def _wardrobe(paint: SolidPainter, item: Furniture, rng: np.random.Generator) -> None:
    name, tint = _timber(rng)
    a, b, top = item.length / 2, item.width / 2, item.height
    paint.box(name, (-a, -b, 0.0), (a - 0.02, b, top), 0.85 * tint)
    doors = max(2, round(item.width / 0.5))
    each = item.width / doors
    for k in range(doors):
        y = -b + k * each
        paint.box(name, (a - 0.02, y + 0.005, 0.07), (a - 0.005, y + each - 0.005, top - 0.01), tint)
        knob = y + each - 0.06 if k % 2 == 0 else y + 0.04
        paint.box("lacquer", (a - 0.005, knob, 0.95), (a, knob + 0.02, 1.15), np.full(3, 0.45))


def _cabinet(paint: SolidPainter, item: Furniture, rng: np.random.Generator) -> None:
    name, tint = _timber(rng)
    a, b, top = item.length / 2, item.width / 2, item.height
    paint.box(name, (-a, -b, 0.0), (a - 0.02, b, top - 0.03), 0.85 * tint)
    paint.box(name, (-a, -b, top - 0.03), (a, b, top), tint)
    columns, rows = max(1, round(item.width / 0.55)), int(rng.integers(1, 4))
    wide, tall = item.width / columns, (top - 0.13) / rows
    for i in range(columns):
        for k in range(rows):
            y, z = -b + i * wide, 0.08 + k * tall
            paint.box(name, (a - 0.02, y + 0.008, z + 0.008), (a - 0.006, y + wide - 0.008, z + tall - 0.008), tint)
            middle = (y + wide / 2, z + tall - 0.06)
            paint.box(
                "lacquer", (a - 0.006, middle[0] - 0.05, middle[1]), (a, middle[0] + 0.05, middle[1] + 0.015), 0.45
            )


def _plant(paint: SolidPainter, item: Furniture, rng: np.random.Generator) -> None:
    radius = min(item.length, item.width) / 2
    pot, top = 0.25 * item.height, item.height
    paint.prism("lacquer", (0, 0, 0, pot), (0.45 * radius, 0.65 * radius), _cloth(rng))
    paint.prism("wood", (0, 0, pot, 0.45 * top), (0.06 * radius, 0.05 * radius), 0.6)
    edges = np.linspace(0.38 * top, top, 5)
    spread = np.array([0.35, 0.95, 1.0, 0.75, 0.15]) * radius * 0.98
    tint = rng.uniform(0.7, 1.1)
    for k in range(4):
        shift = rng.uniform(-0.02, 0.02, 2) if k else np.zeros(2)
        radii = (float(spread[k] - 0.03 * (k > 0)), float(spread[k + 1] - 0.03))
        paint.prism("leaves", (*shift, edges[k], edges[k + 1]), radii, tint * (0.8 + 0.07 * k))


def _lamp(paint: SolidPainter, item: Furniture, rng: np.random.Generator) -> None:
    radius, top = item.length / 2, item.height
    paint.prism("lacquer", (0, 0, 0, 0.03), (0.75 * radius, 0.7 * radius), 0.35, sides=14)
    paint.prism("lacquer", (0, 0, 0.03, top - 0.26), (0.015, 0.015), 0.35, sides=6)
    warm = np.array([1.25, 1.2, 1.02])
    paint.prism("fabric", (0, 0, top - 0.28, top), (radius, 0.65 * radius), 1.1 * warm, sides=14)


_DRAW: dict[str, Draw] = {
    "armchair": _sofa,
    "bed": _bed,
    "cabinet": _cabinet,
    "chair": _chair,
    "desk": _desk,
    "lamp": _lamp,
    "plant": _plant,
    "shelf": _shelf,
    "sofa": _sofa,
    "table": _table,
    "wardrobe": _wardrobe,
}
