"""Beds and what stands beside them."""

from __future__ import annotations

import math

import numpy as np

from galoc_env.furniture import Furniture
from galoc_env.scene.furniture_decor import table_lamp
from galoc_env.scene.furniture_palette import Look, Skin
from galoc_env.scene.furniture_seats import legs, pillow
from galoc_env.scene.solids import SolidPainter


def bed(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """Frame, headboard, mattress, a duvet with its edge turned down, pillows."""
    frame, sheet, cover = look.front(0.1, 0.2), look.linen(), look.linen()
    a, b = item.length / 2, item.width / 2
    head = look.between(0.05, 0.1)
    _headboard(paint, item, look, frame, head)
    top = look.between(0.24, 0.34)
    if look.chance(0.5):
        paint.box(frame[0], (-a + head, -b, 0.04), (a, b, top), frame[1], hide="x")
    else:
        paint.box(frame[0], (-a + head, -b, top - 0.14), (a, b, top), frame[1], hide="x")
        legs(paint, frame, (a - 0.02, b - 0.02), top - 0.14, 0.07)
    soft = top + look.between(0.16, 0.24)
    paint.cushion(sheet[0], (-a + head, -b + 0.03, top), (a - 0.03, b - 0.03, soft), 0.03, sheet[1])
    _duvet(paint, item, look, cover, (head, top, soft))
    pillows = 2 if item.width > 1.35 else 1
    each = (item.width - 0.1) / pillows
    for k in range(pillows):
        y, wide = -b + 0.05 + (k + 0.5) * each, min(each - 0.06, 0.75)
        lean = 1.35 if look.chance(0.6) else 0.5
        lying = paint.at(
            (-a + head + (0.52 if lean > 1 else 0.3), y, soft + 0.05), tilt=lean, turn=look.between(-0.08, 0.08)
        )
        pillow(lying, sheet, (wide, 0.46), 0.16)
    if look.chance(0.4):
        y = look.between(-0.3, 0.3) * b
        loose = paint.at((-a + head + 0.62, y, soft + 0.05), tilt=0.9, turn=look.between(-0.3, 0.3))
        pillow(loose, look.cloth(), (0.42, 0.36), 0.12)


def _headboard(paint: SolidPainter, item: Furniture, look: Look, frame: Skin, head: float) -> None:
    a, b, top = item.length / 2, item.width / 2, item.height
    design = int(look.rng.integers(4))
    if design == 0:
        paint.box(frame[0], (-a, -b, 0), (-a + head, b, top), frame[1])
    elif design == 1:
        cloth = look.cloth()
        columns = max(2, round(item.width / 0.4))
        paint.box(cloth[0], (-a, -b, 0), (-a + 0.03, b, top), cloth[1])
        for k in range(columns):
            y, wide = -b + k * item.width / columns, item.width / columns
            panel = paint.at((-a + 0.03, y + wide / 2, 0.3), tilt=-math.pi / 2)
            panel.cushion(cloth[0], (-(top - 0.3), -wide / 2, 0), (0, wide / 2, head - 0.02), 0.02, cloth[1])
    elif design == 2:
        for y in (-b, b - 0.05):
            paint.box(frame[0], (-a, y, 0), (-a + 0.05, y + 0.05, top), frame[1])
        count = max(3, round(item.width / 0.16))
        at = np.linspace(-b + 0.12, b - 0.12, count)
        low = np.column_stack([np.full(count, -a + 0.012), at - 0.02, np.full(count, 0.3)])
        paint.box(frame[0], low, low + (0.025, 0.04, top - 0.38), frame[1], hide="zZ")
        paint.box(frame[0], (-a, -b + 0.05, top - 0.08), (-a + 0.05, b - 0.05, top), frame[1], hide="yY")
    else:
        cloth = look.cloth()
        paint.cushion(cloth[0], (-a, -b, 0.02), (-a + head, b, top), 0.04, cloth[1])


def _duvet(paint: SolidPainter, item: Furniture, look: Look, cover: Skin, levels: tuple[float, float, float]) -> None:
    head, top, soft = levels
    a, b = item.length / 2, item.width / 2
    start, thick = -a + head + look.between(0.55, 0.8), look.between(0.055, 0.1)
    hang = look.between(0.05, 0.14)
    if look.chance(0.15):  # turned back: half the bed shows its sheet
        start = -a + head + 1.15
    fold = 1.06 * cover[1] if look.chance(0.5) else np.full(3, 1.12)
    wide = look.between(0.2, 0.3)
    low, high = (start + wide - 0.004, -b + 0.01, soft - hang), (a - 0.01, b - 0.01, soft + thick)
    _rumpled(paint, cover, low, high, thick - 0.015, look.rng)
    paint.cushion(
        cover[0],
        (start - 0.03, -b + 0.005, soft - 0.6 * hang),
        (start + wide, b - 0.005, soft + thick + 0.03),
        0.02,
        fold,
    )
    if look.chance(0.35):
        throw = look.cloth()
        x, top = a - look.between(0.5, 0.8), soft + thick + 0.02
        paint.cushion(throw[0], (x, -b, soft - hang + 0.02), (x + 0.42, b, top), 0.02, throw[1])


def _rumpled(
    paint: SolidPainter,
    cover: Skin,
    low: tuple[float, float, float],
    high: tuple[float, float, float],
    deep: float,
    rng: np.random.Generator,
) -> None:
    """A cover with hills and hollows up to ``deep`` m; its rim hangs lower here than there."""
    columns, rows = 6, 5
    x, y = np.linspace(low[0], high[0], columns), np.linspace(low[1], high[1], rows)
    x[1:-1] += rng.uniform(-0.25, 0.25, columns - 2) * (x[1] - x[0])
    y[1:-1] += rng.uniform(-0.25, 0.25, rows - 2) * (y[1] - y[0])
    top = np.empty((columns, rows, 3))
    top[..., 0], top[..., 1] = np.meshgrid(x, y, indexing="ij")
    top[..., 2] = high[2] - deep * rng.uniform(0.0, 0.7, (columns, rows))
    rim = np.ones((columns, rows), bool)
    rim[1:-1, 1:-1] = False
    top[rim, 2] = high[2] - deep * rng.uniform(0.6, 1.0, int(rim.sum()))
    a, b, c, d = top[:-1, :-1], top[1:, :-1], top[1:, 1:], top[:-1, 1:]
    paint.polygons(
        cover[0], np.concatenate([np.stack(t, 2).reshape(-1, 3, 3) for t in ((a, b, c), (a, c, d))]), cover[1]
    )
    ring = np.concatenate([top[:-1, 0], top[-1, :-1], top[:0:-1, -1], top[0, :0:-1]])
    foot = ring.copy()
    foot[:, 2] = low[2] + rng.uniform(0.0, 0.35, len(ring)) * (high[2] - low[2])
    corners = [np.roll(foot, -1, axis=0), np.roll(ring, -1, axis=0)]
    paint.polygons(cover[0], np.stack([foot, corners[0], corners[1], ring], axis=1), 0.97 * cover[1])


def nightstand(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """A small chest with drawers, or a small table; often with a lamp or a book."""
    made = look.front(0.15, 0.25)
    a, b, top = item.length / 2, item.width / 2, 0.9 * item.height
    if look.chance(0.65):
        paint.box(made[0], (-a, -b, 0.06), (a - 0.018, b, top), 0.95 * made[1])
        drawers = int(look.rng.integers(1, 4))
        tall = (top - 0.08) / drawers
        z = 0.07 + tall * np.arange(drawers)
        low = np.column_stack([np.full(drawers, a - 0.018), np.full(drawers, -b + 0.004), z])
        paint.box(made[0], low, low + (0.018, item.width - 0.008, tall - 0.008), made[1], hide="x")
        grip = look.metal()
        low = np.column_stack([np.full(drawers, a), np.full(drawers, -0.05), z + 0.6 * tall])
        paint.box(grip[0], low, low + (0.015, 0.1, 0.012), grip[1], hide="x")
        legs(paint, made, (a - 0.03, b - 0.02), 0.06, 0.04)
    else:
        paint.box(made[0], (-a, -b, top - 0.03), (a, b, top), made[1])
        paint.box(made[0], (-a, -b, 0.15), (a, b, 0.17), made[1])
        legs(paint, made, (a - 0.005, b - 0.005), top - 0.03, 0.035)
    if look.chance(0.6):
        table_lamp(
            paint.at((-0.2 * a, look.between(-0.3, 0.3) * b, top)), look, look.between(0.3, 0.42), 0.65 * min(a, b)
        )
    elif look.chance(0.6):
        paint.at((0, 0, top), turn=look.between(0, 3)).box(
            "lacquer", (-0.07, -0.1, 0), (0.07, 0.1, 0.03), look.cloth()[1], hide="z"
        )
