"""Textures of walls, ceilings, and floors of stone, tiles or carpet."""

from __future__ import annotations

import numpy as np

from galoc_env.materials.noise import SIZE, Canvas, Field, blend, paint, ramp, worn

_TAU = 2 * np.pi


def plaster(c: Canvas) -> Field:
    """Smooth plaster."""
    field = c.uniform(0.8, 2.0) * c.noise("fine") + c.uniform(0.7, 1.6) * c.noise("soft")
    return worn(c, paint((236, 232, 224), field), c.uniform(0.0, 0.015))


def rough_plaster(c: Canvas) -> Field:
    """Thrown plaster, lit from above: the slope of a bumpy field."""
    bumps = c.noise("mid") + 0.5 * c.noise("fine")
    slope = bumps - np.roll(bumps, 1, axis=0)
    return worn(c, paint((230, 226, 217), c.uniform(5.0, 11.0) * slope + 1.5 * c.noise("soft")), 0.015)


def ceiling(c: Canvas) -> Field:
    """Painted ceiling."""
    return paint((246, 246, 243), 1.3 * c.noise("fine") + 0.8 * c.noise("cloud"))


def stripes(c: Canvas) -> Field:
    """Wallpaper in stripes, broad or narrow, some with a pinstripe."""
    base = c.colour((0.02, 0.30), (0.72, 0.94))
    other = base * c.uniform(0.78, 1.02) * c.rng.uniform(0.93, 1.07, 3)
    number = int(c.rng.integers(4, 14))
    wave = ramp(np.sin(_TAU * number * c.x) - c.uniform(-0.4, 0.4), 0.25)
    image = blend(paint(base, 2.0 * c.noise("mid")), other, wave)
    if c.rng.uniform() < 0.5:
        pin = ramp(np.cos(_TAU * number * c.x) - 0.93, 0.05)
        image = blend(image, c.colour((0.1, 0.5), (0.4, 0.9)), 0.7 * pin)
    return image


def damask(c: Canvas) -> Field:
    """Wallpaper with one large ornament."""
    count = int(c.rng.integers(2, 6))
    x, y = count * c.x, count * c.y
    diagonals = np.cos(2 * _TAU * (x + y)) * np.cos(2 * _TAU * (x - y))
    petal = np.cos(_TAU * x) * np.cos(_TAU * y) + c.uniform(0.3, 0.7) * diagonals - c.uniform(-0.2, 0.3)
    base = c.colour((0.02, 0.35), (0.62, 0.92))
    other = base * c.uniform(0.82, 1.12)
    return blend(paint(base, 2.0 * c.noise("fine")), other, ramp(petal, 0.25))


def floral(c: Canvas) -> Field:
    """Wallpaper with flowers, in a tile that is repeated two or four times."""
    repeat = int(c.rng.choice((2, 4)))
    n = SIZE // repeat
    x, y = c.x[:n, :n], c.y[:n, :n]
    base = c.colour((0.02, 0.25), (0.78, 0.96)) if c.rng.uniform() < 0.7 else c.colour((0.2, 0.5), (0.25, 0.5))
    tile = np.broadcast_to(base, (n, n, 3)).astype(np.float32)
    leaf = c.colour((0.15, 0.5), (0.4, 0.75))
    for k in range(int(c.rng.integers(3, 7))):
        cx, cy = c.rng.uniform(0, 1 / repeat, 2)
        dx = ((x - cx) * repeat + 0.5) % 1.0 - 0.5
        dy = ((y - cy) * repeat + 0.5) % 1.0 - 0.5
        radius, angle = np.hypot(dx, dy), np.arctan2(dy, dx)
        petals, size = int(c.rng.integers(2, 7)), c.uniform(0.07, 0.2)
        edge = size * (1.0 + 0.45 * np.cos(petals * angle + c.uniform(0, _TAU))) - radius
        colour = leaf if k % 2 == 0 else c.colour((0.15, 0.6), (0.5, 0.95))
        tile = blend(tile, colour, ramp(edge, 0.02))
        if k % 2:
            tile = blend(tile, 0.6 * colour + 90.0, ramp(0.3 * size - radius, 0.02))
    return np.asarray(np.tile(tile, (repeat, repeat, 1)) + (2.0 * c.noise("fine"))[..., None], np.float32)


def geometric(c: Canvas) -> Field:
    """Wallpaper of chevrons, trellis, scales, dots or triangles."""
    count = int(c.rng.integers(3, 9))
    x, y = (count * c.x) % 1.0 - 0.5, (count * c.y) % 1.0 - 0.5
    line = c.uniform(0.05, 0.12)
    field = (
        np.abs((2.0 * (count * c.y) + 2.0 * np.abs(x)) % 1.0 - 0.5) - 0.25,
        line - np.abs(np.abs(x) + np.abs(y) - 0.5),
        line - np.abs(np.hypot(x, (count * c.y) % 1.0 - 1.0) - 0.5),
        0.25 - np.hypot(x, y),
        (np.abs(x) - 0.5 * (y + 0.5)),
        np.maximum(line - np.abs(x), line - np.abs(y)) - 0.5 * line,
    )[int(c.rng.integers(6))]
    base = c.colour((0.02, 0.30), (0.6, 0.95))
    over = base * c.uniform(0.7, 1.25) if c.rng.uniform() < 0.7 else c.colour((0.1, 0.5), (0.4, 0.9))
    return blend(paint(base, 1.5 * c.noise("fine")), over, ramp(field, 0.03))


def _masonry(c: Canvas, rows: int, columns: int, joint: float, bond: float) -> tuple[Field, Field]:
    """Tone of each brick (256, 256), and 1 in the joints, 0 on the bricks."""
    row = np.floor(c.y * rows).astype(np.int64)
    column = (c.x * columns + bond * (row % 2)) % columns
    tone = c.rng.normal(size=(rows, columns)).astype(np.float32)[row, np.floor(column).astype(np.int64)]
    down, along = (c.y * rows) % 1.0 / rows, column % 1.0 / columns
    return tone, np.maximum(ramp(joint - down, 0.002), ramp(joint - along, 0.002))


def _bricks(c: Canvas, base: Field, mortar: Field, spread: float) -> Field:
    tone, joint = _masonry(c, 16, 6, 0.009, 0.5)
    image = paint(base, spread * tone + 0.7 * spread * c.noise("mid"), (1.0, 0.8, 0.7))
    return blend(image, mortar, 0.9 * joint)


def brick(c: Canvas) -> Field:
    """Bare bricks, red to yellow."""
    base = c.pick((168, 96, 76), (150, 82, 66), (186, 128, 92), (196, 160, 120))
    return worn(c, _bricks(c, base, c.pick((196, 190, 180), (150, 145, 138)), c.uniform(7.0, 13.0)), 0.12)


def white_brick(c: Canvas) -> Field:
    """Bricks under white paint."""
    return _bricks(c, c.pick((234, 231, 225), (220, 216, 206)), c.pick((198, 195, 188)), c.uniform(2.0, 5.0))


def _ceramic(c: Canvas, base: Field, rows: int, columns: int, joint: float, bond: float, spread: float) -> Field:
    tone, gap = _masonry(c, rows, columns, joint, bond)
    image = paint(base, spread * tone + c.uniform(1.0, 4.0) * c.noise("soft"))
    grout = c.pick((176, 174, 168), (226, 224, 218), (112, 110, 106))
    return blend(image, grout, gap)


def metro(c: Canvas) -> Field:
    """Glazed wall tiles in bond, mostly white."""
    base = c.pick((244, 244, 240)) if c.rng.uniform() < 0.6 else c.colour((0.1, 0.45), (0.3, 0.75))
    return _ceramic(c, base, 12, 6, 0.005, float(c.rng.choice((0.0, 0.5))), c.uniform(1.0, 5.0))


def mosaic(c: Canvas) -> Field:
    """Small square tiles."""
    base = c.colour((0.05, 0.5), (0.45, 0.9))
    return _ceramic(c, base, 24, 24, 0.006, 0.0, c.uniform(6.0, 18.0))


def wall_tiles(c: Canvas) -> Field:
    """Large plain wall tiles."""
    base = c.pick((238, 238, 234), (224, 216, 202), (206, 208, 208))
    return _ceramic(c, base, 8, 5, 0.004, 0.0, c.uniform(0.5, 3.0))


def tiles(c: Canvas) -> Field:
    """Large square floor tiles."""
    base = c.pick((214, 214, 208), (196, 184, 166), (150, 148, 146), (178, 118, 86), (96, 96, 98))
    return worn(c, _ceramic(c, base, 4, 4, 0.006, 0.0, c.uniform(1.5, 6.0)), 0.05)


def checker_tiles(c: Canvas) -> Field:
    """Floor tiles in two colours."""
    image = _ceramic(c, c.pick((226, 224, 216)), 4, 4, 0.004, 0.0, 2.0)
    odd = (np.floor(4 * c.x) + np.floor(4 * c.y)) % 2 > 0.5
    image[odd] *= c.pick((60, 60, 62), (140, 60, 50), (90, 110, 120), (150, 150, 146)) / 226.0
    return worn(c, image, 0.06)


def slabs(c: Canvas) -> Field:
    """Stone floor, two large slabs high."""
    image = _ceramic(c, c.pick((190, 184, 172), (160, 156, 150), (206, 196, 178)), 3, 2, 0.004, 0.5, 4.0)
    image += (6.0 * c.noise("mid") + 2.0 * c.noise("fine"))[..., None]
    return worn(c, image, 0.1)


def terrazzo(c: Canvas) -> Field:
    """Floor of stone chips in a pale binder."""
    image = paint(c.pick((206, 202, 194), (184, 182, 178)), 1.5 * c.noise("fine"))
    for _ in range(3):
        chips = (c.noise("speck")[::4, ::4] > 1.6).astype(np.float32).repeat(4, axis=0).repeat(4, axis=1)
        image = blend(image, c.colour((0.05, 0.4), (0.3, 0.95)), 0.7 * chips)
    return image


def carpet(c: Canvas) -> Field:
    """Cut pile in muted tones."""
    pile = c.uniform(6.0, 11.0) * c.noise("speck") + 4.0 * c.noise("mid") + c.uniform(0.5, 3.0) * c.noise("cloud")
    return worn(c, paint(c.pick((158, 156, 154), (176, 166, 150), (150, 140, 138)), pile), c.uniform(0.0, 0.06))


def loop_carpet(c: Canvas) -> Field:
    """Ribbed carpet, flecked."""
    ribs = np.sin(_TAU * 48 * c.y)[:, :1] * np.ones((1, SIZE))
    field = c.uniform(5.0, 11.0) * ribs + 6.0 * c.noise("speck") + 3.0 * c.noise("soft")
    return worn(c, paint(c.pick((150, 150, 152), (164, 152, 134), (130, 136, 144)), field), c.uniform(0.0, 0.06))


def concrete(c: Canvas) -> Field:
    """Bare concrete."""
    field = 2.5 * c.noise("fine") + c.uniform(4.0, 8.0) * c.noise("soft")
    return worn(c, paint(c.pick((176, 174, 170), (196, 192, 186)), field), 0.08)


def marble(c: Canvas) -> Field:
    """Pale or dark stone with veins along the zero lines of a warped field."""
    dark = c.rng.uniform() < 0.3
    base = c.pick((62, 64, 66), (50, 60, 56)) if dark else c.pick((236, 234, 229), (224, 216, 204))
    veins = np.exp(-np.abs(c.noise("soft") + 0.25 * c.noise("mid")) * c.uniform(9.0, 20.0))
    image = paint(base, 3.0 * c.noise("soft") + 1.0 * c.noise("fine"))
    return blend(image, c.pick((190, 188, 184)) if dark else c.pick((150, 148, 146)), 0.6 * veins)


def granite(c: Canvas) -> Field:
    """Speckled worktop stone."""
    base = c.pick((110, 108, 106), (170, 164, 156), (64, 62, 62), (196, 190, 182))
    return paint(base, 11.0 * c.noise("fine") + 7.0 * c.noise("speck"))
