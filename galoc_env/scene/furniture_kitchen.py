"""Fitted kitchens: counters with doors, drawers, oven, hob and sink, wall cabinets above, a fridge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from galoc_env.furniture import Furniture
from galoc_env.furniture.kitchen import COUNTER, UPPER
from galoc_env.scene.furniture_palette import BLACK, Look, Skin, muted, skin
from galoc_env.scene.furniture_storage import bars, free_edges, fronts, handles, trinket
from galoc_env.scene.solids import SolidPainter

PLINTH, TOP = 0.1, 0.04
"""Height of the plinth and thickness of the worktop, m."""
UPPER_DEPTH = 0.35
"""Depth of wall cabinets, m."""
JOIN = 0.001
"""Neighbouring pieces of a run reach this much over their own ends, so that no light falls between, m."""


@dataclass(frozen=True, slots=True, eq=False)
class Fittings:
    """What all pieces of one kitchen share."""

    low: Skin
    """Fronts below the worktop."""
    high: Skin
    """Fronts of the wall cabinets."""
    top: Skin
    """Worktop."""
    splash: Skin
    """What the wall between them wears."""
    grip: float
    """Length of the handles, m; 0 for none."""


def fittings(look: Look) -> Fittings:
    """Draw a kitchen's materials: its fronts often have the wall's own tone."""
    low = look.front(0.45, 0.25)
    high = low if look.chance(0.7) else look.front(0.6, 0.4)
    draw = look.rng.uniform()
    if draw < 0.4:
        top = look.timber()
    elif draw < 0.65:
        top = skin(look.stock.top, look.between(0.7, 1.05))
    elif draw < 0.8:
        top = ("lacquer", look.tone())
    else:
        top = ("lacquer", np.full(3, look.between(0.12, 0.9)))
    splash = skin(look.stock.tiles, look.between(0.92, 1.1))
    if look.chance(0.3):
        splash = top
    elif look.chance(0.3):
        splash = ("lacquer", look.tone())
    return Fittings(low, high, top, splash, look.between(0.1, 0.3) if look.chance(0.8) else 0.0)


def kitchen(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """A stretch of counter; kind "kitchen" has wall cabinets above, kind "counter" nothing."""
    fit = fittings(look)
    a, b = item.length / 2, item.width / 2
    units = item.detail or "D" * max(1, round(item.width / 0.6))
    edges = np.linspace(-b - JOIN, b + JOIN, len(units) + 1)
    face = a - 0.04
    paint.box("lacquer", (-a, -b - JOIN, 0), (a - 0.1, b + JOIN, PLINTH), 0.75 * fit.low[1], hide="xZ")
    paint.box(fit.low[0], (-a, -b - JOIN, PLINTH), (face, b + JOIN, COUNTER - TOP), 0.72 * fit.low[1], hide="xZ")
    paint.box(fit.top[0], (-a, -b - JOIN, COUNTER - TOP), (a, b + JOIN, COUNTER), fit.top[1], hide="x")
    for unit, y0, y1 in zip(units, edges[:-1], edges[1:], strict=True):
        _unit(paint, look, fit, unit, (face, float(y0), float(y1)))
        _on_top(paint, look, unit, (a, float(y0), float(y1)))
    if item.kind == "kitchen":
        low, high = (-a, -b - JOIN, COUNTER), (-a + 0.01, b + JOIN, UPPER)
        paint.box(fit.splash[0], low, high, fit.splash[1], hide="xzZ")
        _uppers(paint, look, fit, item, (units, edges))


def _unit(paint: SolidPainter, look: Look, fit: Fittings, unit: str, face: tuple[float, float, float]) -> None:
    """Front of one unit: D door, R drawers, S sink (doors), H oven, W dishwasher, N none (in a corner)."""
    x, y0, y1 = face
    z0, z1 = PLINTH + 0.005, COUNTER - TOP - 0.01
    if unit == "N":
        return
    if unit == "H":
        _oven(paint, look, (x, y0, y1, z0, z1))
        return
    rows = int(look.rng.integers(2, 5)) if unit == "R" else 1
    columns = 2 if unit == "S" and y1 - y0 > 0.55 else 1
    spots = fronts(paint, fit.low, (x, y0, y1, z0, z1), (columns, rows))
    if fit.grip:
        middle = 0.5 * (spots[:, 0] + spots[:, 1])
        upright = unit in "DS"
        y = free_edges(spots, 0.04) if upright else middle
        z = spots[:, 3] - (0.06 + fit.grip / 2 if upright else 0.035)
        _grips(paint, fit, x + 0.018, np.column_stack([y, z]), upright)
    else:
        low = np.column_stack([np.full(len(spots), x + 0.0181), spots[:, 0], spots[:, 3] - 0.025])
        high = np.column_stack([np.full(len(spots), x + 0.0185), spots[:, 1], spots[:, 3]])
        paint.box("lacquer", low, high, 0.35 * fit.low[1], hide="xyYzZ")


def _grips(paint: SolidPainter, fit: Fittings, x: float, places: np.ndarray, upright: bool) -> None:
    size = np.array([0.022, 0.012, fit.grip] if upright else [0.022, fit.grip, 0.012])
    bars(paint, skin("metal", 0.95), x, places, size)


def _oven(paint: SolidPainter, look: Look, face: tuple[float, float, float, float, float]) -> None:
    x, y0, y1, z0, z1 = face
    steel = skin("metal", look.between(0.7, 1.0)) if look.chance(0.6) else ("lacquer", BLACK)
    fronts(paint, steel, (x, y0, y1, z0 + 0.1, z1), (1, 1))
    glass = (x + 0.0185, y0 + 0.05, z0 + 0.16), (x + 0.019, y1 - 0.05, z1 - 0.18)
    paint.box("lacquer", *glass, 0.08, hide="xyYzZ")
    paint.box("lacquer", (x + 0.018, y0 + 0.06, z1 - 0.14), (x + 0.04, y1 - 0.06, z1 - 0.12), 0.7, hide="x")
    y = np.linspace(y0 + 0.1, y1 - 0.12, 4)
    low = np.column_stack([np.full(4, x + 0.018), y, np.full(4, z1 - 0.07)])
    paint.box("lacquer", low, low + (0.015, 0.025, 0.025), 0.25, hide="x")


def _on_top(paint: SolidPainter, look: Look, unit: str, face: tuple[float, float, float]) -> None:
    """Hob, sink with its tap, or things left on the worktop."""
    a, y0, y1 = face
    y, z = 0.5 * (y0 + y1), COUNTER
    half = 0.5 * (y1 - y0) - 0.02
    if unit == "H":
        paint.box("lacquer", (-a + 0.09, y - half, z), (a - 0.05, y + half, z + 0.006), 0.08, hide="z")
        for dx, dy, r in ((-0.1, -0.5, 0.09), (-0.1, 0.5, 0.07), (0.12, -0.5, 0.07), (0.12, 0.5, 0.09)):
            paint.lathe("lacquer", (dx, y + dy * half), ((r, z + 0.006), (r, z + 0.009)), 0.2, sides=8)
        if look.chance(0.4):
            profile = ((0.09, z + 0.01), (0.1, z + 0.14), (0.085, z + 0.14), (0.08, z + 0.05))
            steel = skin("metal", 0.9)
            paint.lathe(steel[0], (-0.1, y - 0.5 * half), profile, steel[1], sides=8)
    elif unit == "S":
        steel = skin("metal", look.between(0.85, 1.0)) if look.chance(0.7) else ("lacquer", np.full(3, 0.95))
        x0, x1, dy = -0.5 * a, 0.6 * a, min(half, 0.27)
        paint.box(steel[0], (x0 - 0.02, y - dy, z), (x1 + 0.02, y + dy, z + 0.004), steel[1], hide="z")
        basin = [[(x1, y - dy + 0.03, z + 0.005), (x1, y + dy - 0.03, z + 0.005),
                  (x0, y + dy - 0.03, z + 0.005), (x0, y - dy + 0.03, z + 0.005)]]  # fmt: skip
        paint.polygons(steel[0], basin, 0.55 * steel[1])
        tap = skin("metal", 0.95) if look.chance(0.8) else ("lacquer", BLACK)
        paint.tube(tap[0], (x0 - 0.05, y, z), (x0 - 0.05, y, z + 0.28), (0.016, 0.013), tap[1], sides=6)
        paint.tube(tap[0], (x0 - 0.05, y, z + 0.27), (x0 + 0.12, y, z + 0.25), (0.013, 0.012), tap[1], sides=5)
    elif unit != "N" and look.chance(0.45):
        _appliance(paint, look, (-0.35 * a, y, z), half)


def _appliance(paint: SolidPainter, look: Look, place: tuple[float, float, float], half: float) -> None:
    x, y, z = place
    draw = int(look.rng.integers(5))
    if draw == 0:  # microwave oven or toaster
        w, d, h = min(half, 0.24), 0.13, look.between(0.18, 0.27)
        paint.box("lacquer", (x - d, y - w, z), (x + d, y + w, z + h), look.between(0.2, 0.95), hide="z")
        paint.box(
            "lacquer", (x + d, y - 0.9 * w, z + 0.03), (x + d + 0.002, y + 0.4 * w, z + h - 0.03), 0.07, hide="xyYzZ"
        )
    elif draw == 1:  # kettle
        profile = ((0.08, z), (0.09, z + 0.06), (0.06, z + 0.2), (0.02, z + 0.23))
        paint.lathe("lacquer", (x, y), profile, muted(look.rng), sides=8)
    elif draw == 2:  # chopping board and jars
        board = paint.at((x - 0.13, y, z), tilt=0.15)
        timber = look.timber()
        board.box(timber[0], (0, -0.13, 0), (0.02, 0.13, 0.36), timber[1])
        for k in range(2):
            paint.prism("lacquer", (x + 0.1, y - 0.1 + 0.14 * k, z, z + 0.16), (0.05, 0.05), muted(look.rng), sides=8)
    else:
        trinket(paint, look, place, 0.35, min(half, 0.12))


def _uppers(paint: SolidPainter, look: Look, fit: Fittings, item: Furniture, run: tuple[str, np.ndarray]) -> None:
    """Wall cabinets; over the hob an extractor hood, here and there an open board."""
    units, edges = run
    a, top = item.length / 2, item.height
    x = -a + UPPER_DEPTH - 0.02
    for k, (unit, y0, y1) in enumerate(zip(units, edges[:-1], edges[1:], strict=True)):
        if unit == "N" and len(units) > 1:
            y0, y1 = _corner_upper(paint, fit, (a, top), (float(y0), float(y1)), right=k == 0)
        if unit == "H":
            _hood(paint, look, (-a, float(y0), float(y1), top))
            continue
        if unit != "N" and look.chance(0.12):
            paint.box(fit.high[0], (-a, y0, UPPER), (-a + 0.24, y1, UPPER + 0.03), fit.high[1])
            trinket(paint, look, (-a + 0.12, 0.5 * float(y0 + y1), UPPER + 0.03), 0.3, 0.1)
            continue
        paint.box(fit.high[0], (-a, y0, UPPER), (x, y1, top), 0.8 * fit.high[1], hide="x")
        spots = fronts(paint, fit.high, (x, float(y0), float(y1), UPPER, top), (1, 1 if top < 2.25 else 2))
        if fit.grip:
            z = np.where(spots[:, 5] == 0, spots[:, 2] + 0.04 + fit.grip / 2, spots[:, 2] + 0.03 + fit.grip / 2)
            side = spots[:, 1] - 0.04 if look.chance(0.5) else spots[:, 0] + 0.04
            _grips(paint, fit, x + 0.018, np.column_stack([side, z]), upright=True)


def _corner_upper(
    paint: SolidPainter, fit: Fittings, size: tuple[float, float], y: tuple[float, float], *, right: bool
) -> tuple[float, float]:
    """A deep cabinet over the end of a blind corner, which meets those around it; what is left of the unit's y."""
    a, top = size
    low, high = (y[0], y[0] + UPPER_DEPTH - 0.02) if right else (y[1] - UPPER_DEPTH + 0.02, y[1])
    paint.box(fit.high[0], (-a, low, UPPER), (a, high, top), 0.96 * fit.high[1], hide="xy" if right else "xY")
    # The wall at the corner is tiled too.
    near, far = (y[0], y[0] + 0.01) if right else (y[1] - 0.01, y[1])
    paint.box(
        fit.splash[0], (-a + 0.01, near, COUNTER), (a, far, UPPER), fit.splash[1], hide="xyzZ" if right else "xYzZ"
    )
    return (high, y[1]) if right else (y[0], low)


def _hood(paint: SolidPainter, look: Look, face: tuple[float, float, float, float]) -> None:
    x, y0, y1, top = face
    made = skin("metal", look.between(0.8, 1.0)) if look.chance(0.75) else ("lacquer", BLACK)
    low = UPPER + 0.08
    paint.box(made[0], (x, y0 + 0.005, low), (x + 0.48, y1 - 0.005, low + 0.05), made[1], hide="xZ")
    inset = (0.5 * (y1 - y0) - 0.12) if y1 - y0 > 0.4 else 0.08
    paint.hexahedra(
        made[0],
        [[(x, y0 + 0.005, low + 0.05), (x + 0.48, y0 + 0.005, low + 0.05), (x, y1 - 0.005, low + 0.05),
          (x + 0.48, y1 - 0.005, low + 0.05), (x, y0 + inset, low + 0.22), (x + 0.25, y0 + inset, low + 0.22),
          (x, y1 - inset, low + 0.22), (x + 0.25, y1 - inset, low + 0.22)]],
        made[1],
        hide="xz",
    )  # fmt: skip
    paint.box(
        made[0], (x, y0 + inset, low + 0.22), (x + 0.25, y1 - inset, max(top, low + 0.25)), 0.97 * made[1], hide="xz"
    )


def fridge(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """A fridge with a freezer: free-standing, or behind fronts as high as the wall cabinets."""
    fit = fittings(look)
    a, b, top = item.length / 2, item.width / 2, item.height
    draw = look.rng.uniform()
    made = fit.low if draw < 0.45 else ("lacquer", np.full(3, 0.97)) if draw < 0.75 else skin("metal", 0.9)
    if look.chance(0.08):
        made = "lacquer", BLACK
    split = look.between(0.3, 0.4) * top if look.chance(0.7) else 0.7 * top
    paint.box(made[0], (-a, -b, 0.05), (a - 0.06, b, top), 0.92 * made[1])
    paint.box("lacquer", (-a, -b, 0.0), (a - 0.08, b, 0.05), 0.2, hide="Z")
    fronts(paint, made, (a - 0.06, -b, b, 0.06, split), (1, 1))
    fronts(paint, made, (a - 0.06, -b, b, split, top), (1, 1))
    y = b - 0.05 if look.chance(0.5) else -b + 0.05
    handles(paint, look, a - 0.042, np.array([[y, split - 0.22], [y, split + 0.25]]), long=0.35, upright=True)
    if top < 2.0 and look.chance(0.3):
        paint.box("lacquer", (-0.15, -0.15, top), (0.15, 0.15, top + 0.14), muted(look.rng), hide="z")
