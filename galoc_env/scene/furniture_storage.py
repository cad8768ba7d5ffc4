"""Shelves, wardrobes, cabinets, television stands and a piano."""

from __future__ import annotations

import numpy as np

from galoc_env.furniture import Furniture
from galoc_env.scene.furniture_decor import leaf_sheets, table_lamp
from galoc_env.scene.furniture_palette import BLACK, GREY, Look, Skin, muted, skin
from galoc_env.scene.furniture_seats import legs
from galoc_env.scene.furniture_tables import panel
from galoc_env.scene.solids import SolidPainter

GAP = 0.004
"""Half the gap between two fronts, m."""


def fronts(
    paint: SolidPainter, made: Skin, face: tuple[float, float, float, float, float], cells: tuple[int, int]
) -> np.ndarray:
    """A grid of doors or drawers, 1.8 cm thick.

    Args:
        paint: where to.
        made: material and tint.
        face: x of what they lie on, y from and to, z from and to, m.
        cells: columns and rows.

    Returns:
        (columns * rows, 6): y and z from and to, and column and row, of each front.
    """
    x, y0, y1, z0, z1 = face
    columns, rows = cells
    i, k = (v.ravel() for v in np.meshgrid(np.arange(columns), np.arange(rows)))
    wide, tall = (y1 - y0) / columns, (z1 - z0) / rows
    low = np.column_stack([np.full(len(i), x), y0 + i * wide + GAP, z0 + k * tall + GAP])
    high = low + (0.018, wide - 2 * GAP, tall - 2 * GAP)
    paint.box(made[0], low, high, made[1], hide="x")
    return np.column_stack([low[:, 1], high[:, 1], low[:, 2], high[:, 2], i, k])


def handles(paint: SolidPainter, look: Look, x: float, places: np.ndarray, *, long: float, upright: bool) -> None:
    """Bars or knobs, centred on (y, z) places (N, 2) of the plane x, m."""
    made = look.metal()
    size = np.array([0.02, 0.012, long]) if upright else np.array([0.02, long, 0.012])
    if look.chance(0.25):
        size = np.array([0.022, 0.026, 0.026])
    bars(paint, made, x, places, size)


def bars(paint: SolidPainter, made: Skin, x: float, places: np.ndarray, size: np.ndarray) -> None:
    """Boxes of one size (3,), centred on (y, z) places (N, 2) of the plane x, m."""
    low = np.column_stack([np.full(len(places), x), places]) - (0.0, size[1] / 2, size[2] / 2)
    paint.box(made[0], low, low + size, made[1], hide="x")


def free_edges(spots: np.ndarray, inset: float) -> np.ndarray:
    """(N,) y where doors have their handles, ``inset`` m from an edge: neighbours open away from each other.

    Args:
        spots: (N, 6) what :func:`fronts` gives.
        inset: m.
    """
    return np.where(spots[:, 4] % 2 == 0, spots[:, 1] - inset, spots[:, 0] + inset)


def wardrobe(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """Swing doors, some panelled, or sliding doors of which some are mirrors."""
    made = look.front(0.4, 0.25)
    a, b, top = item.length / 2, item.width / 2, item.height
    paint.box(made[0], (-a, -b, 0.0), (a - 0.04, b, top), 0.9 * made[1])
    if look.chance(0.4):
        _sliding(paint, item, look, made)
        return
    doors = max(2, round(item.width / look.between(0.42, 0.55)))
    foot = 0.4 if look.chance(0.2) else 0.07
    spots = fronts(paint, made, (a - 0.04, -b, b, foot, top - 0.01), (doors, 1))
    if foot > 0.1:
        low = fronts(paint, made, (a - 0.04, -b, b, 0.06, foot), (max(1, doors // 2), 1))
        handles(
            paint, look, a - 0.022, low[:, [0, 2]] + 0.5 * (low[:, [1, 3]] - low[:, [0, 2]]), long=0.14, upright=False
        )
    if look.chance(0.35):
        frame = 0.075
        low = np.column_stack([np.full(doors, a - 0.022), spots[:, 0] + frame, spots[:, 2] + frame])
        high = np.column_stack([np.full(doors, a - 0.016), spots[:, 1] - frame, spots[:, 3] - frame])
        paint.box(made[0], low, high, 0.93 * made[1], hide="x")
    places = np.column_stack([free_edges(spots, 0.045), np.full(doors, 1.05)])
    handles(paint, look, a - 0.022, places, long=look.between(0.14, 0.4), upright=True)


def _sliding(paint: SolidPainter, item: Furniture, look: Look, made: Skin) -> None:
    a, b, top = item.length / 2, item.width / 2, item.height
    doors = 3 if item.width > 1.7 else 2
    glass = skin("mirror", look.between(0.9, 1.0))
    rail = look.metal()
    mirrored = look.rng.uniform(size=doors) < 0.45
    for k in range(doors):
        x = a - (0.02 if k % 2 else 0.038)
        y0, y1 = -b + k * item.width / doors, -b + (k + 1) * item.width / doors
        y0, y1 = max(-b, y0 - 0.02), min(b, y1 + 0.02)
        face = glass if mirrored[k] else made
        paint.box(face[0], (x, y0, 0.05), (x + 0.018, y1, top - 0.04), face[1], hide="x")
        ends = [[x + 0.018, y0, 0.05], [x + 0.018, y1 - 0.025, 0.05]]
        paint.box(rail[0], ends, np.array(ends) + (0.006, 0.025, top - 0.09), rail[1], hide="xzZ")
    paint.box(rail[0], (a - 0.04, -b, 0.0), (a, b, 0.05), 0.9 * rail[1], hide="x")
    paint.box(rail[0], (a - 0.04, -b, top - 0.04), (a, b, top), 0.9 * rail[1], hide="x")


def shelf(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """Boards with books, boxes and plants; some with doors below, some without a back."""
    made = look.front(0.15, 0.3)
    a, b, top = item.length / 2, item.width / 2, item.height
    sides = [[-a, -b, 0.0], [-a, b - 0.022, 0.0]]
    paint.box(made[0], sides, np.array(sides) + (item.length, 0.022, top), made[1])
    if look.chance(0.75):
        paint.box(made[0], (-a, -b + 0.022, 0.0), (-a + 0.01, b - 0.022, top), 0.85 * made[1], hide="yYzZ")
    boards = max(2, int(top // look.between(0.3, 0.42)))
    pitch = (top - 0.025) / boards
    z = pitch * np.arange(boards + 1)
    low = np.column_stack([np.full(boards + 1, -a + 0.01), np.full(boards + 1, -b + 0.022), z])
    paint.box(made[0], low, low + (item.length - 0.012, item.width - 0.044, 0.025), made[1], hide="xyY")
    first = 0
    if look.chance(0.35):
        first = 2 if boards > 4 else 1
        columns = max(1, round(item.width / 0.5))
        spots = fronts(paint, made, (a - 0.018, -b + 0.02, b - 0.02, 0.03, z[first]), (columns, 1))
        places = np.column_stack([free_edges(spots, 0.04), spots[:, 3] - 0.1])
        handles(paint, look, a, places, long=0.12, upright=True)
    for k in range(first, boards):
        _row(paint, look, (-a + 0.02, a - 0.03, -b + 0.03, b - 0.03), (float(z[k]) + 0.025, pitch - 0.03))


def _row(paint: SolidPainter, look: Look, field: tuple[float, float, float, float], room: tuple[float, float]) -> None:
    """What stands on one board: two or three groups with gaps between."""
    x0, x1, y, y1 = field
    z, free = room
    y += look.between(0.0, 0.1)
    while y < y1 - 0.15:
        wide = min(look.between(0.15, 0.5), y1 - y)
        draw = look.rng.uniform()
        if draw < 0.6:
            rows = max(1, round(wide / 0.18))
            for k in range(rows):
                tall = free * look.between(0.62, 0.9)
                start = y + k * wide / rows
                deep = x1 - look.between(0.02, 0.08)
                paint.box(
                    "books", (x0, start, z), (deep, start + wide / rows, z + tall), look.between(0.7, 1.0), hide="xz"
                )
        elif draw < 0.78:
            woven = look.chance(0.5)
            made = skin(look.wicker(), np.array([0.9, 0.75, 0.55])) if woven else ("lacquer", muted(look.rng))
            paint.box(made[0], (x0, y + 0.01, z), (x1, y + wide - 0.01, z + 0.7 * free), made[1], hide="xz")
        elif draw < 0.9:
            trinket(paint, look, ((x0 + x1) / 2, y + wide / 2, z), min(free, 0.3), min(wide, x1 - x0) / 2)
        y += wide + look.between(0.0, 0.2)


def trinket(paint: SolidPainter, look: Look, place: tuple[float, float, float], height: float, reach: float) -> None:
    """A vase, a small plant, a picture frame or a bowl."""
    x, y, z = place
    draw, made = int(look.rng.integers(4)), ("lacquer", muted(look.rng))
    r = min(0.09, reach)
    if draw == 0:
        tall = min(0.28, 0.8 * height)
        profile = ((0.5 * r, z), (0.9 * r, z + 0.35 * tall), (0.3 * r, z + 0.75 * tall), (0.45 * r, z + tall))
        paint.lathe(made[0], (x, y), profile, made[1], sides=7)
    elif draw == 1:
        pot = min(0.12, 0.4 * height)
        paint.lathe(made[0], (x, y), ((0.5 * r, z), (0.7 * r, z + pot)), made[1], sides=7)
        n = 7
        bearing, rise = 2.4 * np.arange(n), look.rng.uniform(0.3, 1.3, n)
        ways = np.stack([np.cos(bearing) * np.cos(rise), np.sin(bearing) * np.cos(rise), np.sin(rise)], axis=1)
        length = np.minimum(reach, 0.5 * height) * look.rng.uniform(0.6, 1.0, n)
        base = np.tile([x, y, z + pot], (n, 1))
        paint.sheets("leaves", leaf_sheets(base, ways, length, 0.4 * length, np.full(n, 0.3)), look.between(0.8, 1.1))
    elif draw == 2:
        tall = min(0.25, 0.8 * height)
        leaning = paint.at((x, y, z), tilt=0.15)
        leaning.box("lacquer", (-0.01, -0.8 * r, 0), (0.01, 0.8 * r, tall), BLACK, hide="z")
        leaning.box(
            "fabric", (0.01, -0.8 * r + 0.015, 0.015), (0.012, 0.8 * r - 0.015, tall - 0.015), made[1], hide="xyYzZ"
        )
    else:
        paint.lathe(
            made[0], (x, y), ((0.4 * r, z), (r, z + 0.06), (0.85 * r, z + 0.06), (0.3 * r, z + 0.02)), made[1], sides=7
        )


def cabinet(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """Chest of drawers or sideboard, with some things on top."""
    made = look.front(0.25, 0.25)
    a, b, top = item.length / 2, item.width / 2, item.height
    low = look.between(0.05, 0.18)
    _carcass(paint, look, made, (a, b, top), low)
    rows = int(look.rng.integers(1, 5))
    columns = max(1, round(item.width / (0.8 if rows > 2 else 0.5)))
    spots = fronts(paint, made, (a - 0.02, -b + 0.01, b - 0.01, low + 0.01, top - 0.03), (columns, rows))
    middle = 0.5 * (spots[:, 0] + spots[:, 1])
    if rows > 1:
        handles(paint, look, a - 0.002, np.column_stack([middle, spots[:, 3] - 0.05]), long=0.14, upright=False)
    else:
        places = np.column_stack([free_edges(spots, 0.04), spots[:, 3] - 0.12])
        handles(paint, look, a - 0.002, places, long=0.12, upright=True)
    for y in np.linspace(-0.7 * b, 0.7 * b, 3):
        draw = look.rng.uniform()
        if draw < 0.2:
            table_lamp(paint.at((0, float(y), top)), look, 0.42, min(0.14, a))
        elif draw < 0.6:
            trinket(paint, look, (0.0, float(y), top), 0.35, a)


def _carcass(paint: SolidPainter, look: Look, made: Skin, size: tuple[float, float, float], low: float) -> None:
    """Body behind the fronts, its top board, and feet or a plinth below ``low``."""
    a, b, top = size
    paint.box(made[0], (-a, -b, low), (a - 0.02, b, top - 0.025), 0.9 * made[1], hide="Z")
    paint.box(made[0], (-a, -b, top - 0.025), (a, b, top), made[1])
    if low > 0.1:
        legs(paint, look.metal() if look.chance(0.4) else look.timber(), (a - 0.03, b - 0.04), low, 0.04)
    else:
        paint.box(made[0], (-a, -b + 0.02, 0), (a - 0.05, b - 0.02, low), 0.7 * made[1], hide="Z")


def tv_stand(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """A low cabinet with a television on it."""
    made = look.front(0.2, 0.3)
    a, b = item.length / 2, item.width / 2
    top = look.between(0.36, 0.5)
    low = look.between(0.04, 0.16)
    _carcass(paint, look, made, (a, b, top), low)
    columns = max(2, round(item.width / 0.55))
    fronts(paint, made, (a - 0.02, -b + 0.01, b - 0.01, low + 0.01, top - 0.03), (columns, 1))
    wide = min(item.width - 0.1, look.between(0.95, 1.35))
    y = look.between(-1, 1) * max(0.0, 0.3 * (item.width - wide))
    tall = min(0.57 * wide, item.height - top - 0.06)
    feet = [[-0.1, y - 0.3 * wide, top], [-0.1, y + 0.3 * wide - 0.03, top]]
    paint.box("lacquer", feet, np.array(feet) + (0.18, 0.03, 0.05), BLACK, hide="z")
    panel(paint.at((0, y, top + 0.05)), look, (wide, tall), on=0.3)
    if look.chance(0.5):
        paint.box(
            "lacquer", (-0.12, y + 0.2, top), (0.1, y + 0.5, top + 0.046), GREY * look.between(0.3, 1.2), hide="z"
        )


def piano(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """An upright piano with its keys."""
    tint = BLACK if look.chance(0.6) else np.array([0.42, 0.24, 0.15])
    a, b, top = item.length / 2, item.width / 2, item.height
    body = -a + 0.36
    paint.box("lacquer", (-a, -b, 0.0), (body, b, top - 0.03), tint, hide="Z")
    paint.box("lacquer", (-a, -b, top - 0.03), (body + 0.02, b, top), tint)
    paint.box("lacquer", (body, -b, 0.62), (a, b, 0.72), tint, hide="x")
    paint.box("lacquer", (body + 0.02, -b + 0.06, 0.72), (a - 0.02, b - 0.06, 0.74), 1.0, hide="zxyY")
    keys = np.linspace(-b + 0.1, b - 0.12, 30)[np.arange(30) % 7 != 2]
    low = np.column_stack([np.full(len(keys), body + 0.02), keys, np.full(len(keys), 0.74)])
    paint.box("lacquer", low, low + (0.1, 0.018, 0.012), 0.08, hide="zxyY")
    for y in (-b, b - 0.06):
        paint.box("lacquer", (body, y, 0.72), (a, y + 0.06, 0.8), tint, hide="xz")
        paint.box("lacquer", (a - 0.1, y, 0.0), (a - 0.02, y + 0.06, 0.62), tint, hide="Z")
    desk = paint.at((body + 0.01, 0, 0.85), tilt=0.2)
    desk.box("lacquer", (0, -0.35, 0), (0.015, 0.35, 0.25), tint + 0.03)
