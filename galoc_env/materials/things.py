"""Textures of things: cloth, metal, books, leaves, pictures, mirrors and screens."""

from __future__ import annotations

import numpy as np

from galoc_env.materials.noise import SIZE, Canvas, Field, blend, paint, ramp

_TAU = 2 * np.pi
_CLOTH = (206, 206, 206)  # light grey: the tint gives cloth its colour


def _threads(c: Canvas) -> Field:
    """(256, 256) over and under of a plain weave, -1..1."""
    return np.asarray(np.sin(_TAU * 64 * c.x[:1]) * np.sin(_TAU * 64 * c.y[:, :1]))


def fabric(c: Canvas) -> Field:
    """Plain cloth."""
    return paint(_CLOTH, c.uniform(5.0, 11.0) * _threads(c) + 6.0 * c.noise("fine") + 3.0 * c.noise("soft"))


def weave(c: Canvas) -> Field:
    """Coarse cloth of mixed threads."""
    warp, weft = c.rng.normal(size=(2, 64)).astype(np.float32).repeat(4, axis=1)
    over = _threads(c) > 0
    return paint(_CLOTH, 9.0 * np.where(over, warp[None, :], weft[:, None]) + 6.0 * c.noise("speck"))


def velvet(c: Canvas) -> Field:
    """Cloth with a soft pile."""
    return paint((200, 200, 200), c.uniform(4.0, 9.0) * c.noise("soft") + 2.0 * c.noise("fine"))


def check(c: Canvas) -> Field:
    """Cloth in checks of two tones, with a coloured line."""
    count, bands = int(c.rng.integers(3, 8)), c.uniform(-0.3, 0.3)
    across, down = ramp(np.sin(_TAU * count * c.x) - bands, 0.1), ramp(np.sin(_TAU * count * c.y) - bands, 0.1)
    image = paint((224, 222, 216), 4.0 * _threads(c) + 3.0 * c.noise("fine"))
    colour = c.colour((0.1, 0.7), (0.3, 0.8))
    return blend(image, colour, c.uniform(0.35, 0.5) * (across + down))


def ticking(c: Canvas) -> Field:
    """Striped cloth."""
    count = int(c.rng.integers(5, 14))
    image = paint((222, 219, 212), 4.0 * _threads(c) + 3.0 * c.noise("fine"))
    return blend(image, c.colour((0.1, 0.7), (0.25, 0.8)), ramp(np.sin(_TAU * count * c.x) - c.uniform(-0.3, 0.7), 0.1))


def rug(c: Canvas) -> Field:
    """Woven pattern of diamonds in a few colours."""
    colours = [c.colour((0.1, 0.55), (0.25, 0.85)) for _ in range(3)]
    x, y = np.abs((2 * c.x) % 1.0 - 0.5), np.abs((2 * c.y) % 1.0 - 0.5)
    rings = np.floor((x + y) * int(c.rng.integers(5, 11))).astype(np.int64) % 3
    image = np.asarray(colours, np.float32)[rings]
    return np.asarray(image + (7.0 * c.noise("speck") + 5.0 * c.noise("mid"))[..., None], np.float32)


def lacquer(c: Canvas) -> Field:
    """Smooth white paint."""
    return paint((244, 243, 240), 1.0 * c.noise("mid"))


def metal(c: Canvas) -> Field:
    """Brushed steel."""
    return paint((186, 188, 190), c.uniform(2.0, 5.0) * c.noise("grain") + c.uniform(1.0, 6.0) * c.noise("cloud"))


def shade(c: Canvas) -> Field:
    """Lampshade: pale cloth or paper, ribbed or plain."""
    ribs = c.uniform(0.0, 8.0) * np.sin(_TAU * int(c.rng.integers(8, 32)) * c.x)
    return paint(c.pick((248, 242, 228), (244, 232, 206), (250, 249, 246)), ribs + 2.0 * c.noise("fine"))


def leaves(c: Canvas) -> Field:
    """Foliage."""
    field = c.uniform(18.0, 30.0) * np.tanh(1.5 * c.noise("mid")) + 8.0 * c.noise("fine")
    return paint(c.pick((78, 122, 62), (96, 128, 74), (64, 104, 70)), field, (0.9, 1.0, 0.6))


def books(c: Canvas) -> Field:
    """Spines side by side in random colours."""
    count = int(c.rng.integers(16, 25))
    spine, within = c.steps(count)
    colours = np.array([c.colour((0.05, 0.7), (0.25, 0.9)) for _ in range(count)])
    image = np.broadcast_to(colours[spine], (SIZE, SIZE, 3)).astype(np.float32)
    image[:, within < 0.1] *= 0.55
    title = (np.abs(c.y - c.rng.uniform(0.3, 0.7, size=count)[spine]) < 0.06) & (within > 0.25)
    image[title] = 0.4 * image[title] + 140.0
    return image


def screen(c: Canvas) -> Field:
    """A screen that is off: nearly black, with a dim reflection."""
    return paint((26, 27, 30), c.uniform(2.0, 9.0) * ramp(np.sin(_TAU * (c.x + c.y)) - 0.2, 0.5) + c.noise("cloud"))


def mirror(c: Canvas) -> Field:
    """A mirrored room: pale ceiling, walls that meet in a corner, a floor, a bright window."""
    wall = c.colour((0.02, 0.2), (0.6, 0.85))
    corner = np.abs(c.x - 0.5)
    image = blend(np.broadcast_to(wall, (SIZE, SIZE, 3)), 0.85 * wall, ramp(c.x - 0.5, 0.003))
    image = blend(image, c.pick((232, 231, 227)), ramp(0.16 + 0.2 * corner - c.y, 0.01))
    image = blend(image, c.pick((160, 128, 94), (150, 148, 144)), ramp(c.y - 0.82 + 0.25 * corner, 0.01))
    left, top = c.uniform(0.05, 0.7), c.uniform(0.3, 0.4)
    pane = np.minimum(np.minimum(c.x - left, left + 0.2 - c.x), np.minimum(c.y - top, top + 0.25 - c.y))
    image = blend(image, (250, 252, 255), ramp(pane, 0.01))
    return np.asarray(image + (2.0 * c.noise("cloud"))[..., None], np.float32)


def _abstract(c: Canvas) -> Field:
    """Fields of colour with ragged borders."""
    colours = [c.colour((0.05, 0.7), (0.2, 0.95)) for _ in range(4)]
    image = paint(colours[0], 5.0 * c.noise("mid"))
    for colour in colours[1:]:
        image = blend(image, colour, ramp(c.noise("cloud") + 0.1 * c.noise("fine") - c.uniform(0.0, 0.9), 0.12))
    return image


def _blocks(c: Canvas) -> Field:
    """Rectangles in a few colours between dark lines."""
    colours = np.array([c.colour((0.0, 0.9), (0.4, 1.0)) for _ in range(6)])
    number = c.rng.integers(6, size=(5, 5))
    columns, rows = (np.sort(c.rng.uniform(size=5)).astype(np.float32) for _ in range(2))
    i, j = np.searchsorted(columns, c.x[0]) % 5, np.searchsorted(rows, c.y[:, 0]) % 5
    image = colours[number[j][:, i]].astype(np.float32)
    near = np.abs(c.x[0][:, None] - columns).min(axis=1), np.abs(c.y[:, 0][:, None] - rows).min(axis=1)
    image[:, near[0] < 0.006] *= 0.25
    image[near[1] < 0.006] *= 0.25
    return image


def _landscape(c: Canvas) -> Field:
    """Hills or sea under a sky, with a pale mount above and below."""
    sky, ground = c.colour((0.1, 0.5), (0.7, 1.0)), c.colour((0.2, 0.6), (0.2, 0.6))
    image = np.asarray(sky + (70.0 * c.y)[..., None] + (5.0 * c.noise("cloud"))[..., None], np.float32)
    for depth in range(3):
        line = 0.45 + 0.14 * depth + c.uniform(0.02, 0.06) * c.noise("cloud")[:1]
        colour = ground * (1.5 - 0.35 * depth) + 30 * (2 - depth)
        image = blend(image, paint(colour, 5.0 * c.noise("mid")), ramp(c.y - line, 0.008))
    return blend(image, (240, 238, 230), ramp(np.abs(c.y - 0.5) - 0.46, 0.004))


def _photo(c: Canvas) -> Field:
    """Blurred light and dark in all colours."""
    image = np.stack([128 + 45 * (0.7 * c.noise("cloud") + 0.5 * c.noise("soft")) for _ in range(3)], axis=-1)
    grey = image.mean(axis=2, keepdims=True)
    return np.asarray(grey + c.uniform(0.0, 0.6) * (image - grey), np.float32)


def art(c: Canvas) -> Field:
    """A picture for a frame."""
    return (_abstract, _blocks, _landscape, _photo)[int(c.rng.integers(4))](c)
