"""Tables, desks and what stands on them."""

from __future__ import annotations

import math

import numpy as np

from galoc_env.furniture import Furniture
from galoc_env.scene.furniture_decor import table_lamp
from galoc_env.scene.furniture_palette import BLACK, GREY, Look, Skin, muted, skin
from galoc_env.scene.furniture_seats import legs
from galoc_env.scene.solids import SolidPainter


def _top(look: Look) -> Skin:
    return skin(look.stock.top, look.between(0.85, 1.0)) if look.chance(0.12) else look.front(0.05, 0.2)


def table(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """Dining table: four legs, trestles or two slabs."""
    plate = _top(look)
    a, b, top = item.length / 2, item.width / 2, item.height
    thick = look.between(0.025, 0.05)
    paint.box(plate[0], (-a, -b, top - thick), (a, b, top), plate[1])
    frame = plate if look.chance(0.6) else look.metal()
    design = int(look.rng.integers(3))
    if design == 0:
        legs(paint, frame, (a - 0.03, b - 0.03), top - thick, look.between(0.05, 0.08))
        low = top - thick - 0.08
        paint.box(frame[0], (-a + 0.07, -b + 0.07, low), (a - 0.07, b - 0.07, top - thick), 0.9 * frame[1], hide="zZ")
    elif design == 1:
        for y in (-b + 0.25, b - 0.25):
            for x in (-1, 1):
                paint.tube(
                    frame[0],
                    (x * (a - 0.08), y, 0),
                    (x * 0.35 * a, y, top - thick),
                    (0.022, 0.022),
                    frame[1],
                    sides=4,
                    ends=False,
                )
        paint.box(frame[0], (-0.03, -b + 0.25, 0.35), (0.03, b - 0.25, 0.4), frame[1], hide="yY")
    else:
        for y in (-b + 0.15, b - 0.21):
            paint.box(frame[0], (-0.8 * a, y, 0), (0.8 * a, y + 0.06, top - thick), 0.95 * frame[1], hide="Z")
    _on_table(paint, look, (a, b, top))


def _on_table(paint: SolidPainter, look: Look, size: tuple[float, float, float]) -> None:
    """A bowl, a vase or plates, sometimes."""
    a, b, top = size
    draw = look.rng.uniform()
    made = "lacquer", muted(look.rng)
    spot = (look.between(-0.2, 0.2) * a, look.between(-0.3, 0.3) * b)
    if draw < 0.3:
        profile = ((0.05, top), (0.14, top + 0.07), (0.125, top + 0.07), (0.04, top + 0.02))
        paint.lathe(made[0], spot, profile, made[1])
    elif draw < 0.5:
        profile = ((0.04, top), (0.07, top + 0.08), (0.03, top + 0.2), (0.045, top + 0.25))
        paint.lathe(made[0], spot, profile, made[1], sides=8)
    elif draw < 0.65:
        for x, y in ((-0.55, -0.4), (0.55, -0.4), (-0.55, 0.4), (0.55, 0.4)):
            paint.lathe("lacquer", (x * a, y * b), ((0.08, top), (0.13, top + 0.02)), 1.0, sides=8)


def round_table(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """A round top on one foot or on four legs."""
    plate, frame = _top(look), look.metal() if look.chance(0.4) else look.timber()
    r, top = min(item.length, item.width) / 2, item.height
    paint.lathe(plate[0], (0, 0), ((r, top - 0.03), (r, top)), plate[1], sides=16, low=True)
    if look.chance(0.5):
        profile = ((0.55 * r, 0), (0.52 * r, 0.03), (0.08 * r, 0.12), (0.08 * r, top - 0.03))
        paint.lathe(frame[0], (0, 0), profile, frame[1], sides=10, high=False)
    else:
        for x, y in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
            paint.tube(
                frame[0],
                (0.62 * r * x, 0.62 * r * y, 0),
                (0.45 * r * x, 0.45 * r * y, top - 0.03),
                (0.015, 0.025),
                frame[1],
                ends=False,
            )
    _on_table(paint, look, (0.6 * r, 0.6 * r, top))


def coffee_table(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """A low table: with a shelf, round, or a block."""
    plate, frame = _top(look), look.metal()
    a, b, top = item.length / 2, item.width / 2, item.height
    design = int(look.rng.integers(3))
    if design == 0:
        paint.box(plate[0], (-a, -b, top - 0.03), (a, b, top), plate[1])
        paint.box(plate[0], (-a + 0.04, -b + 0.04, 0.14), (a - 0.04, b - 0.04, 0.16), plate[1])
        legs(paint, frame if look.chance(0.5) else plate, (a - 0.005, b - 0.005), top - 0.03, 0.045)
    elif design == 1:
        for y, r, z in ((-b + min(a, b), min(a, b), top), (b - 0.7 * min(a, b), 0.7 * min(a, b), top - 0.08)):
            paint.lathe(plate[0], (0, y), ((r, z - 0.02), (r, z)), plate[1], sides=14, low=True)
            for k in range(3):
                c, s = 0.8 * r * math.cos(2.1 * k), y + 0.8 * r * math.sin(2.1 * k)
                paint.tube(frame[0], (c, s, 0), (c, s, z - 0.02), (0.012, 0.012), frame[1], sides=4, ends=False)
    else:
        paint.box(plate[0], (-a, -b, 0.03), (a, b, top), plate[1])
    if look.chance(0.6):
        stack = paint.at(
            (0, look.between(-0.4, 0.4) * b, top - (0.08 if design == 1 else 0.0)), turn=look.between(0, 3)
        )
        for k in range(int(look.rng.integers(1, 4))):
            stack.box(
                "lacquer",
                (-0.1 + 0.01 * k, -0.14, 0.025 * k),
                (0.1, 0.14 - 0.02 * k, 0.025 * k + 0.025),
                muted(look.rng),
                hide="z",
            )


def desk(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """Desk with drawers or plain legs, monitor or laptop, keyboard, lamp and paper."""
    plate = look.front(0.1, 0.3)
    a, b, top = item.length / 2, item.width / 2, item.height
    paint.box(plate[0], (-a, -b, top - 0.028), (a, b, top), plate[1])
    if look.chance(0.5):
        paint.box(plate[0], (-a, -b, 0.0), (a - 0.05, -b + 0.028, top - 0.028), 0.96 * plate[1], hide="Z")
        paint.box(plate[0], (-a + 0.05, b - 0.42, 0.05), (a - 0.07, b - 0.01, top - 0.028), 0.93 * plate[1], hide="Z")
        z = 0.06 + np.arange(3) * (top - 0.1) / 3
        low = np.column_stack([np.full(3, a - 0.07), np.full(3, b - 0.415), z])
        paint.box(plate[0], low, low + (0.018, 0.4, (top - 0.1) / 3 - 0.008), plate[1], hide="x")
        grip = look.metal()
        paint.box(grip[0], low + (0.018, 0.13, 0.13), low + (0.03, 0.27, 0.142), grip[1], hide="x")
    else:
        legs(paint, look.metal() if look.chance(0.6) else plate, (a - 0.02, b - 0.02), top - 0.028, 0.05)
    two = look.chance(0.25) and b > 0.65
    y = -0.3 if two else look.between(-0.35, 0.1) * b
    for k in range(2 if two else 1):
        monitor(paint.at((-a + 0.2, y + 0.58 * k, top), turn=look.between(-0.15, 0.15)), look, (0.54, 0.32))
    paint.box("lacquer", (0.05, y - 0.21, top), (0.18, y + 0.21, top + 0.018), look.between(0.15, 0.9), hide="z")
    paint.box("lacquer", (0.08, y + 0.27, top), (0.17, y + 0.33, top + 0.03), 0.2, hide="z")
    if look.chance(0.6):
        table_lamp(paint.at((-a + 0.16, 0.82 * b, top)), look, 0.42, 0.12)
    if look.chance(0.7):
        paper = paint.at((0.05, 0.55 * b, top), turn=look.between(-0.4, 0.4))
        paper.box("lacquer", (-0.12, -0.09, 0), (0.12, 0.09, look.between(0.005, 0.05)), 1.0, hide="z")


def monitor(paint: SolidPainter, look: Look, size: tuple[float, float]) -> None:
    """A screen on a foot at the frame's origin, facing +x: width and height of the panel, m."""
    case = BLACK if look.chance(0.7) else GREY
    paint.box("lacquer", (-0.09, -0.12, 0), (0.09, 0.12, 0.012), case, hide="z")
    paint.box("lacquer", (-0.035, -0.025, 0.012), (-0.02, 0.025, 0.2), case, hide="zZ")
    panel(paint.at((0, 0, 0.12)), look, size)


def panel(paint: SolidPainter, look: Look, size: tuple[float, float], on: float = 0.4) -> None:
    """A flat screen that stands on the frame's origin and faces +x; shines with probability ``on``."""
    w, h = size
    paint.box("lacquer", (-0.02, -w / 2, 0), (0.02, w / 2, h), BLACK)
    face = [[(0.021, -w / 2 + 0.01, 0.012), (0.021, w / 2 - 0.01, 0.012),
             (0.021, w / 2 - 0.01, h - 0.01), (0.021, -w / 2 + 0.01, h - 0.01)]]  # fmt: skip
    if look.chance(on):
        paint.polygons("fabric", face, 0.8 * muted(look.rng) + 0.1, glow=look.between(0.6, 1.0))
    else:
        dark = skin("screen", look.between(0.8, 1.1))
        paint.polygons(dark[0], face, dark[1])
