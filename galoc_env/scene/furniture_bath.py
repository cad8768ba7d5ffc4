"""Bathtub, shower, basin, toilet and washing machine."""

from __future__ import annotations

import math

import numpy as np

from galoc_env.furniture import Furniture
from galoc_env.scene.furniture_palette import GREY, Look, skin
from galoc_env.scene.furniture_storage import fronts, handles
from galoc_env.scene.solids import SolidPainter

ENAMEL = np.full(3, 1.0)
"""Tint of lacquer that looks like enamel."""


def _tap(paint: SolidPainter, place: tuple[float, float, float], reach: float, height: float) -> None:
    x, y, z = place
    made = skin("metal", 0.95)
    paint.tube(made[0], (x, y, z), (x, y, z + height), (0.018, 0.015), made[1])
    paint.tube(made[0], (x, y, z + height - 0.01), (x + reach, y, z + height - 0.03), (0.014, 0.012), made[1])


def bathtub(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """A tub with a hollow; boxed in with tiles, or free on its feet."""
    a, b, top = item.length / 2, item.width / 2, item.height
    rim = 0.07
    apron = skin(look.stock.tiles) if look.chance(0.4) else ("lacquer", ENAMEL)
    paint.box(apron[0], (-a, -b, 0), (a, b, top - 0.03), apron[1], hide="Z")
    outer = _oval(a, b, 0.04)
    inner = _oval(a - rim, b - rim, 0.18)
    floor = _oval(a - rim - 0.06, b - rim - 0.15, 0.16)
    rings = [(outer, top - 0.03), (outer, top), (inner, top), (floor, 0.14)]
    paint.loft("lacquer", [np.column_stack([flat, np.full(8, z)]) for flat, z in rings], ENAMEL)
    _tap(paint, (0.0, b - rim / 2, top), 0.0, 0.1)
    _tap(paint.at((0, b - rim / 2, top), turn=-math.pi / 2), (0.0, 0.0, 0.0), 0.12, 0.12)


def _oval(a: float, b: float, cut: float) -> np.ndarray:
    """(8, 2) rectangle of half sides a, b with cut corners, counter-clockwise."""
    c = min(cut, 0.8 * a, 0.8 * b)
    return np.array(
        [(-a + c, -b), (a - c, -b), (a, -b + c), (a, b - c), (a - c, b), (-a + c, b), (-a, b - c), (-a, -b + c)]
    )


def shower(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """A tray, two panes' frames, a riser with its head; the panes themselves are left out."""
    a, b, top = item.length / 2, item.width / 2, item.height
    made = skin("metal", 0.95) if look.chance(0.7) else ("lacquer", np.full(3, 0.12))
    paint.box("lacquer", (-a, -b, 0), (a, b, 0.1), ENAMEL)
    paint.box("lacquer", (-a + 0.06, -b + 0.06, 0.1), (a - 0.06, b - 0.06, 0.102), 0.85, hide="zxXyY")
    posts = [[a - 0.03, -b, 0.1], [a - 0.03, b - 0.03, 0.1], [-a, -b, 0.1], [-a, b - 0.03, 0.1]]
    paint.box(made[0], posts, np.array(posts) + (0.03, 0.03, top - 0.1), made[1], hide="z")
    paint.box(made[0], (a - 0.03, -b + 0.03, top - 0.03), (a, b - 0.03, top), made[1], hide="yY")
    rails = [[-a + 0.03, -b, top - 0.03], [-a + 0.03, b - 0.03, top - 0.03]]
    paint.box(made[0], rails, np.array(rails) + (item.length - 0.06, 0.03, 0.03), made[1], hide="xX")
    paint.tube(made[0], (-a + 0.05, 0, 0.9), (-a + 0.05, 0, top - 0.05), (0.012, 0.012), made[1])
    paint.tube(made[0], (-a + 0.05, 0, top - 0.06), (-0.2 * a, 0, top - 0.06), (0.012, 0.012), made[1])
    paint.prism(made[0], (-0.2 * a, 0, top - 0.1, top - 0.07), (0.11, 0.08), made[1])


def basin(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """A basin on a cabinet or a pillar, with a mirror above it."""
    a, b, top = item.length / 2, item.width / 2, 0.86
    rings = [(_oval(a, b, 0.06), top - 0.12), (_oval(a, b, 0.06), top), (_oval(a - 0.05, b - 0.05, 0.1), top)]
    rings.append((_oval(0.5 * a, 0.55 * b, 0.08), top - 0.09))
    paint.loft("lacquer", [np.column_stack([flat, np.full(8, z)]) for flat, z in rings], ENAMEL, low=True)
    if look.chance(0.65):
        made = look.front(0.3, 0.3)
        low = 0.28 if look.chance(0.5) else 0.0
        paint.box(made[0], (-a, -b + 0.01, low), (a - 0.05, b - 0.01, top - 0.12), 0.93 * made[1], hide="Z")
        columns = 2 if item.width > 0.7 else 1
        spots = fronts(paint, made, (a - 0.05, -b + 0.01, b - 0.01, low + 0.03, top - 0.14), (columns, 1))
        middle = 0.5 * (spots[:, 0] + spots[:, 1])
        handles(paint, look, a - 0.032, np.column_stack([middle, spots[:, 3] - 0.05]), long=0.12, upright=False)
    else:
        paint.lathe("lacquer", (-0.3 * a, 0), ((0.11, 0), (0.08, 0.15), (0.09, top - 0.12)), ENAMEL, high=False)
    _tap(paint, (-a + 0.04, 0.0, top), 0.12, 0.14)
    glass = skin("mirror", look.between(0.9, 1.0))
    high = min(item.height, look.between(1.7, 1.95))
    if look.chance(0.5):
        case = look.front(0.3, 0.4)
        paint.box(case[0], (-a, -0.9 * b, 1.15), (-a + 0.13, 0.9 * b, high), case[1])
        paint.box(glass[0], (-a + 0.13, -0.88 * b, 1.16), (-a + 0.135, 0.88 * b, high - 0.01), glass[1], hide="xyYzZ")
    else:
        paint.box("lacquer", (-a, -0.8 * b, 1.1), (-a + 0.02, 0.8 * b, high), GREY)
        paint.box(glass[0], (-a + 0.02, -0.78 * b, 1.12), (-a + 0.022, 0.78 * b, high - 0.02), glass[1], hide="xyYzZ")


def toilet(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """Cistern, bowl and lid."""
    a, top = item.length / 2, item.height
    w = item.width / 2
    paint.cushion("lacquer", (-a, -w, 0.42), (-a + 0.17, w, top), 0.02, ENAMEL, both=True)
    x = -a + 0.17 + 0.5 * (item.length - 0.17)
    stretch = 0.5 * (item.length - 0.17) / (0.95 * w)
    profile = np.array([(0.55, 0.0), (0.6, 0.15), (0.93, 0.36), (0.93, 0.4)]) * (w, 1.0)
    paint.lathe("lacquer", (x, 0), profile, ENAMEL, sides=12, stretch=stretch)
    lid = np.array([(0.95, 0.4), (0.95, 0.43)]) * (w, 1.0)
    paint.lathe("lacquer", (x, 0), lid, 0.96 if look.chance(0.8) else 0.3, sides=12, stretch=stretch)
    paint.box("lacquer", (-a, -0.5 * w, 0), (x - 0.6 * w, 0.5 * w, 0.4), ENAMEL, hide="Z")


def washer(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """Washing machine: a white box with a round door."""
    a, b, top = item.length / 2, item.width / 2, item.height
    white = np.full(3, look.between(0.9, 1.0))
    paint.box("lacquer", (-a, -b, 0.0), (a - 0.03, b, top), white)
    front = paint.at((a - 0.03, 0.0, 0.45), tilt=-math.pi / 2)
    front.lathe("lacquer", (0, 0), ((0.2, 0.0), (0.19, 0.02), (0.14, 0.028)), 0.75, sides=14, high=False)
    front.lathe("lacquer", (0, 0), ((0.145, 0.02), (0.145, 0.0285)), 0.12, sides=14)
    paint.box("lacquer", (a - 0.03, -b + 0.02, top - 0.13), (a - 0.025, b - 0.02, top - 0.02), 0.85 * white, hide="x")
    paint.box("lacquer", (a - 0.025, -0.05, top - 0.1), (a - 0.022, 0.12, top - 0.05), 0.15, hide="x")
    front.at((0.525 - top, 0.6 * b, 0.005)).lathe("lacquer", (0, 0), ((0.035, 0.0), (0.03, 0.025)), 0.6, sides=8)
