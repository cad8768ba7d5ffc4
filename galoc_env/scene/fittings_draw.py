"""What fittings look like. Each is drawn on a wall: x off it, y along it, z up from its lower edge, all in m."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from galoc_env.scene.solids import SolidPainter
from galoc_env.scene.styles import tinge

Array = NDArray[np.float64]
Draw = Callable[[SolidPainter, float, float, np.random.Generator], None]


def _frame_look(rng: np.random.Generator) -> tuple[str, Array]:
    """Black, white, wooden or gilded."""
    k = int(rng.integers(6))
    if k < 2:
        return "lacquer", np.full(3, rng.uniform(0.08, 0.25))
    if k == 2:
        return "lacquer", tinge(rng, 0.1, (0.85, 1.0))
    if k == 3:
        return "metal", np.array([1.15, 0.95, 0.6]) * rng.uniform(0.6, 1.0)
    return ("walnut", "oak")[k - 4], tinge(rng, 0.1, (0.8, 1.0))


def _sheet(paint: SolidPainter, name: str, x: float, y: tuple[float, float], z: tuple[float, float], tint: object,
           crop: tuple[float, float] = (0.0, 0.0), glow: float = 0.0) -> None:  # fmt: skip
    """An upright rectangle seen from the room that shows its texture from the coordinates ``crop`` on, m."""
    wide, high = y[1] - y[0], z[1] - z[0]
    u, v = crop
    # Looking at the wall, y runs to the right; the texture's frame is shifted so that the crop lies at its origin.
    corners = np.array([[(0.0, u, v), (0.0, u + wide, v), (0.0, u + wide, v + high), (0.0, u, v + high)]])
    paint.at((x, y[0] - u, z[0] - v)).polygons(name, corners, tint, glow=glow)  # type: ignore[arg-type]


def _picture(
    paint: SolidPainter,
    y: tuple[float, float],
    z: tuple[float, float],
    look: tuple[str, Array],
    rims: tuple[float, float],
    rng: np.random.Generator,
) -> None:
    """A picture in a frame and a mount of these widths, m."""
    rim, mount = rims
    depth = 0.025
    paint.box(look[0], (0.0, y[0], z[0]), (depth, y[1], z[1]), look[1], hide="x")
    inner_y, inner_z = (y[0] + rim, y[1] - rim), (z[0] + rim, z[1] - rim)
    if mount > 0.0:
        _sheet(paint, "lacquer", depth + 0.002, inner_y, inner_z, 0.97)
        inner_y, inner_z = (inner_y[0] + mount, inner_y[1] - mount), (inner_z[0] + mount, inner_z[1] - mount)
    if min(inner_y[1] - inner_y[0], inner_z[1] - inner_z[0]) > 0.04:
        crop = tuple(float(v) for v in rng.uniform(0.0, 1.2, 2))
        _sheet(paint, f"art.{int(rng.integers(4))}", depth + 0.004, inner_y, inner_z, tinge(rng, 0.15), crop)  # type: ignore[arg-type]


def pictures(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """One framed picture, or a row of up to four."""
    count = 1 if width < 0.7 else int(rng.integers(1, 1 + int(width // 0.32)))
    look, rim = _frame_look(rng), rng.uniform(0.012, 0.05)
    mount = rng.uniform(0.03, 0.09) if rng.uniform() < 0.5 else 0.0
    gap = 0.06 if count > 1 else 0.0
    each = (width - gap * (count - 1)) / count
    for k in range(count):
        left = -width / 2 + k * (each + gap)
        _picture(paint, (left, left + each), (0.0, height), look, (rim, min(mount, 0.2 * min(each, height))), rng)


def poster(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """A sheet without a frame, not quite upright."""
    crop = tuple(float(v) for v in rng.uniform(0.0, 1.2, 2))
    sheet, half = paint.at((0.0, 0.0, 0.0), roll=rng.normal(0.0, 0.012)), width / 2
    _sheet(sheet, "lacquer", 0.002, (-half, half), (0.0, height), 0.97)
    rim = rng.choice((0.0, 0.02, 0.04))
    low = rim if rng.uniform() < 0.6 else 0.2 * height
    name = f"art.{int(rng.integers(4))}"
    _sheet(sheet, name, 0.004, (rim - half, half - rim), (low, height - rim), tinge(rng, 0.2), crop)  # type: ignore[arg-type]


def calendar(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """A picture above, the month below."""
    half = width / 2
    _sheet(paint, "lacquer", 0.003, (-half, half), (0.0, height), 0.99)
    crop = (float(rng.uniform()), float(rng.uniform()))
    _sheet(paint, f"art.{int(rng.integers(4))}", 0.005, (0.01 - half, half - 0.01), (0.5 * height, height), 1.0, crop)
    for k in range(5):
        z = (0.06 + 0.08 * k) * height
        end = half - 0.02 if k else rng.uniform(-0.3, 0.8) * half
        _sheet(paint, "lacquer", 0.005, (0.02 - half, end), (z, z + 0.03 * height), 0.45)


def notes(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """Bits of paper, here and there."""
    for y in np.arange(0.06 - width / 2, width / 2 - 0.05, 0.13):
        if rng.uniform() < 0.75:
            a, b, z = rng.uniform(0.03, 0.055), rng.uniform(0.04, 0.075), rng.uniform(0.08, height - 0.08)
            one = paint.at((0.0, float(y), z), roll=rng.normal(0.0, 0.08))
            _sheet(one, "lacquer", 0.003, (-a, a), (-b, b), tinge(rng, 0.5, (0.85, 1.0)))


def mirror(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """A mirror with or without a frame."""
    look, rim = _frame_look(rng), rng.uniform(0.004, 0.06)
    half = width / 2
    paint.box(look[0], (0.0, -half, 0.0), (0.03, half, height), look[1], hide="x")
    crop = (float(rng.uniform(0.0, 1.5)), float(rng.uniform(0.1, 0.5)))
    _sheet(paint, "mirror", 0.032, (-half + rim, half - rim), (rim, height - rim), 1.0, crop)


def tv(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """A screen; now and then it is on."""
    half = width / 2
    paint.box("lacquer", (0.02, -half, 0.0), (0.06, half, height), 0.1, hide="x")
    paint.box("lacquer", (0.0, -0.15, height / 2 - 0.1), (0.02, 0.15, height / 2 + 0.1), 0.2, hide="xX")
    on = rng.uniform() < 0.25
    name, glow = ("art.1", 0.9) if on else ("screen", 0.0)
    crop = (float(rng.uniform()), float(rng.uniform()))
    _sheet(paint, name, 0.062, (-half + 0.012, half - 0.012), (0.018, height - 0.012), 1.0, crop, glow)


def clock(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """A round clock with hands."""
    r = width / 2
    face = paint.at((0.0, 0.0, r), tilt=-math.pi / 2)  # its upright axis points off the wall
    dark = rng.uniform() < 0.3
    rim = tinge(rng, 0.5, (0.15, 0.9))
    face.prism("lacquer", (0, 0, 0.0, 0.035), (r, 0.97 * r), rim, sides=16)
    face.prism("lacquer", (0, 0, 0.035, 0.037), (0.88 * r, 0.88 * r), 0.15 if dark else 0.98, sides=16)
    for length, angle, wide in ((0.5, rng.uniform(0, 2 * math.pi), 0.012), (0.78, rng.uniform(0, 2 * math.pi), 0.008)):
        c, s = math.cos(angle), math.sin(angle)
        along, side = np.array([0.0, c, s]), wide * np.array([0.0, -s, c])
        hand = np.array([-side, length * r * along - side, length * r * along + side, side]) + (0.039, 0.0, r)
        paint.polygons("lacquer", hand[None], 0.9 if dark else 0.1)


def shelf(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """One or two boards with books and pots on them."""
    name = str(rng.choice(("oak", "lacquer", "walnut", "painted_wood", "pine")))
    tint, half, deep = tinge(rng, 0.1, (0.75, 1.0)), width / 2, rng.uniform(0.16, 0.22)
    for z in (0.0,) if height < 0.5 else (0.0, height - 0.25):
        paint.box(name, (0.0, -half, z), (deep, half, z + 0.025), tint, hide="x")
        left = -half + rng.uniform(0.02, 0.2) * width
        right = min(left + rng.uniform(0.2, 0.6) * width, half - 0.02)
        tall = rng.uniform(0.14, 0.22)
        paint.box("books", (0.01, left, z + 0.025), (deep - 0.03, right, z + 0.025 + tall), 1.0, hide="xz")
        if right + 0.16 < half:
            r, top = rng.uniform(0.035, 0.06), z + 0.025 + rng.uniform(0.08, 0.14)
            y = (right + half) / 2
            paint.prism("lacquer", (deep / 2, y, z + 0.025, top), (0.8 * r, r), tinge(rng, 0.7, (0.5, 1.0)), sides=8)
            if rng.uniform() < 0.6:
                paint.prism("leaves", (deep / 2, y, top, top + 0.1), (0.9 * r, 0.5 * r), 1.0, sides=7)


def sconce(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """A lamp on the wall, lit or not."""
    glow = 1.1 if rng.uniform() < 0.5 else 0.0
    r = width / 2
    paint.box("metal", (0.0, -0.03, 0.3 * height), (0.05, 0.03, 0.6 * height), 0.7, hide="x")
    paint.lathe("shade", (0.03 + r, 0.0), [(r, 0.0), (rng.uniform(0.5, 1.0) * r, height)], (1.0, 0.93, 0.8), sides=10,
                low=True, glow=glow)  # fmt: skip


def hooks(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """A board of hooks with a coat or two on it."""
    half = width / 2
    paint.box("oak", (0.0, -half, height - 0.1), (0.02, half, height - 0.02), tinge(rng, 0.1, (0.7, 1.0)), hide="x")
    count = max(2, round(width / 0.2))
    for k in range(count):
        y = -half + (k + 0.5) * width / count
        paint.box("metal", (0.02, y - 0.01, height - 0.07), (0.07, y + 0.01, height - 0.05), 0.6, hide="x")
        if rng.uniform() < 0.45:
            w, drop = 0.4 * width / count, height * rng.uniform(0.5, 1.0) - 0.08
            low, high = (0.02, y - 1.2 * w, height - 0.06 - drop), (0.14, y + 1.2 * w, height - 0.06)
            cloth = str(rng.choice(("fabric", "weave", "check", "velvet")))
            paint.frustum(cloth, low, high, (0.03, 0.7 * w), tinge(rng, 0.7, (0.25, 1.0)), hide="x")


def towels(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """A heated rail of bars with a towel over it."""
    half = width / 2
    tint = np.full(3, rng.uniform(0.7, 1.1))
    posts = np.array([[0.03, -half, 0.0], [0.03, half - 0.03, 0.0]])
    paint.box("metal", posts, posts + (0.03, 0.03, height), tint)
    bars = max(3, round(height / 0.12))
    z = (np.arange(bars) + 0.5) * height / bars
    low = np.column_stack([np.full(bars, 0.04), np.full(bars, -half + 0.03), z - 0.01])
    high = np.column_stack([np.full(bars, 0.065), np.full(bars, half - 0.03), z + 0.01])
    paint.box("metal", low, high, tint, hide="yY")
    wide = width * rng.uniform(0.5, 0.8)
    name = str(rng.choice(("fabric", "weave", "ticking")))
    cloth = tinge(rng, 0.5, (0.6, 1.1))
    paint.box(name, (0.025, -wide / 2, 0.3 * height), (0.085, wide / 2, 0.9 * height), cloth, hide="x")


def board(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """A white, black or cork board in a thin frame."""
    half = width / 2
    paint.box("metal", (0.0, -half, 0.0), (0.02, half, height), 0.9, hide="x")
    name, tint = (("lacquer", 1.0), ("lacquer", 0.15), ("carpet", np.array([1.1, 0.85, 0.6])))[int(rng.integers(3))]
    _sheet(paint, name, 0.022, (-half + 0.02, half - 0.02), (0.02, height - 0.02), tint)


def switch(paint: SolidPainter, width: float, height: float, rng: np.random.Generator) -> None:
    """A plate with a rocker."""
    half = width / 2
    tint = 0.97 if rng.uniform() < 0.8 else float(rng.uniform(0.2, 0.7))
    paint.box("lacquer", (0.0, -half, 0.0), (0.01, half, height), tint, hide="x")
    _sheet(paint, "lacquer", 0.012, (-0.6 * half, 0.6 * half), (0.2 * height, 0.8 * height), 0.9 * tint)


DRAW: dict[str, Draw] = {
    "board": board,
    "calendar": calendar,
    "clock": clock,
    "hooks": hooks,
    "mirror": mirror,
    "notes": notes,
    "pictures": pictures,
    "poster": poster,
    "sconce": sconce,
    "shelf": shelf,
    "switch": switch,
    "towels": towels,
    "tv": tv,
}
"""How each kind is drawn."""
