"""Procedural surface textures: seamless, made from a seed, with a physical size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

SIZE = 256
"""Edge of every texture, px (a power of two, for mipmaps)."""

Array = NDArray[np.float64]
Grid = tuple[Array, Array]


@dataclass(frozen=True, slots=True, eq=False)
class Material:
    """One tileable surface."""

    name: str
    """Unique name, such as "planks"."""
    image: NDArray[np.uint8]
    """(256, 256, 3) sRGB; row 0 is the top; left/right and top/bottom edges match."""
    size_m: float
    """Edge length that the image covers, m."""


def _noise(rng: np.random.Generator, power: float, stretch: float = 1.0) -> Array:
    """Periodic noise of unit variance with spectrum ``1 / f^power``; ``stretch`` > 1 draws it out along rows (up)."""
    fy = np.fft.fftfreq(SIZE)[:, None] * stretch
    fx = np.fft.fftfreq(SIZE)[None, :]
    f2 = fx**2 + fy**2
    f2[0, 0] = 1.0
    spectrum = np.fft.fft2(rng.normal(size=(SIZE, SIZE))) / f2 ** (power / 2.0)
    spectrum[0, 0] = 0.0
    field = np.fft.ifft2(spectrum).real
    return np.asarray(field / field.std())


def _colour(base: tuple[float, float, float], field: Array, gain: tuple[float, float, float]) -> Array:
    """Base colour plus a scalar field times a colour gain, (256, 256, 3) in 0..255."""
    return np.asarray(base) + field[..., None] * np.asarray(gain)


def _plaster(rng: np.random.Generator, _: Grid) -> Array:
    return _colour((236, 232, 224), 1.6 * _noise(rng, 0.6) + 2.0 * _noise(rng, 1.8), (1, 1, 1))


def _ceiling(rng: np.random.Generator, _: Grid) -> Array:
    return _colour((246, 246, 243), 1.5 * _noise(rng, 0.5), (1, 1, 1))


def _stripes(rng: np.random.Generator, grid: Grid) -> Array:
    x, _ = grid
    wave = np.tanh(6.0 * np.sin(2 * np.pi * 8 * x)) + 0.4 * np.sin(2 * np.pi * 16 * x)
    return _colour((222, 214, 198), 8.0 * wave + 2.0 * _noise(rng, 1.0), (1.0, 0.98, 0.9))


def _damask(rng: np.random.Generator, grid: Grid) -> Array:
    x, y = 4 * grid[0], 4 * grid[1]
    diagonals = np.cos(4 * np.pi * (x + y)) * np.cos(4 * np.pi * (x - y))
    petal = np.cos(2 * np.pi * x) * np.cos(2 * np.pi * y) + 0.5 * diagonals
    return _colour((206, 212, 206), 12.0 * np.tanh(4.0 * petal) + 2.0 * _noise(rng, 0.8), (1.0, 0.95, 0.9))


def _brick(rng: np.random.Generator, grid: Grid) -> Array:
    x, y = grid
    row = np.floor(y * 16).astype(int)
    column = (x * 6 + 0.5 * (row % 2)) % 6.0
    in_row, in_brick = (y * 16) % 1.0, column % 1.0
    tone = rng.normal(size=(16, 6))[row, np.floor(column).astype(int)]
    image = _colour((168, 96, 76), 11.0 * tone + 7.0 * _noise(rng, 0.9), (1.0, 0.8, 0.7))
    joint = (in_brick < 0.05) | (in_row < 0.13)
    image[joint] = _colour((196, 190, 180), 4.0 * _noise(rng, 0.5), (1, 1, 1))[joint]
    return image


def _boards(rng: np.random.Generator, grid: Grid, base: tuple[float, float, float], count: int) -> Array:
    """Boards that run along the rows (up), each with its own tone and end joint."""
    x, y = grid
    board = np.floor(x * count).astype(int)
    tone, shift = rng.normal(size=count)[board], rng.uniform(size=count)[board]
    grain = 5.0 * _noise(rng, 1.1, stretch=14.0) + 3.0 * _noise(rng, 1.8, stretch=6.0)
    image = _colour(base, grain + 9.0 * tone, (1.0, 0.85, 0.65))
    seam = ((x * count) % 1.0 < 0.025 * count / 6) | ((y + shift) % 1.0 < 0.006)
    image[seam] *= 0.62
    return image


def _planks(rng: np.random.Generator, grid: Grid) -> Array:
    return _boards(rng, grid, (186, 142, 98), 6)


def _dark_planks(rng: np.random.Generator, grid: Grid) -> Array:
    return _boards(rng, grid, (136, 98, 68), 10)


def _tiles(rng: np.random.Generator, grid: Grid) -> Array:
    x, y = 4 * grid[0], 4 * grid[1]
    tone = rng.normal(size=(4, 4))[np.floor(y).astype(int), np.floor(x).astype(int)]
    image = _colour((214, 214, 208), 4.0 * tone + 3.0 * _noise(rng, 1.6), (1, 1, 1))
    image[(x % 1.0 < 0.025) | (y % 1.0 < 0.025)] = (158, 156, 150)
    return image


def _carpet(rng: np.random.Generator, _: Grid) -> Array:
    return _colour((158, 156, 154), 9.0 * rng.normal(size=(SIZE, SIZE)) + 4.0 * _noise(rng, 1.2), (1, 1, 1))


def _concrete(rng: np.random.Generator, _: Grid) -> Array:
    return _colour((176, 174, 170), 3.0 * _noise(rng, 0.4) + 5.0 * _noise(rng, 1.6), (1, 1, 1))


def _wood(rng: np.random.Generator, _: Grid) -> Array:
    return _colour((176, 128, 84), 6.0 * _noise(rng, 1.2, stretch=12.0) + 3.0 * _noise(rng, 1.8), (1.0, 0.85, 0.65))


def _fabric(rng: np.random.Generator, grid: Grid) -> Array:
    x, y = grid
    weave = np.sin(2 * np.pi * 64 * x) * np.sin(2 * np.pi * 64 * y)
    return _colour((206, 206, 206), 9.0 * weave + 6.0 * _noise(rng, 0.9), (1, 1, 1))


def _lacquer(rng: np.random.Generator, _: Grid) -> Array:
    return _colour((244, 243, 240), 1.2 * _noise(rng, 1.0), (1, 1, 1))


def _leaves(rng: np.random.Generator, _: Grid) -> Array:
    return _colour((78, 122, 62), 24.0 * np.tanh(1.5 * _noise(rng, 1.3)) + 8.0 * _noise(rng, 0.6), (0.9, 1.0, 0.6))


def _books(rng: np.random.Generator, grid: Grid) -> Array:
    """Spines side by side in random colours."""
    x, y = grid
    spine = np.floor(x * 20).astype(int)
    image = rng.uniform(70, 225, size=(20, 3))[spine]
    image[(x * 20) % 1.0 < 0.1] *= 0.55
    title = (np.abs(y - rng.uniform(0.3, 0.7, size=20)[spine]) < 0.06) & ((x * 20) % 1.0 > 0.25)
    image[title] = 0.4 * image[title] + 140.0
    return image


def _outdoors(rng: np.random.Generator, grid: Grid) -> Array:
    """Bright hazy sky over trees and a lawn. Image row 0 is the top; 5.2 m high, so that it wraps above any window."""
    x, up = grid[0], 2.0 * (1.0 - grid[1])
    high = np.minimum(up, 1.0)
    sky = np.stack([236 - 30 * high, 243 - 14 * high, 252 + 2 * high], axis=-1) + (5.0 * _noise(rng, 2.2))[..., None]
    crown = 0.52 + 0.03 * np.sin(2 * np.pi * 3 * x) + 0.015 * _noise(rng, 1.8)
    hedge = np.clip((crown - up) * SIZE / 4 + 0.5, 0.0, 1.0)[..., None]
    leaf = _colour((172, 194, 152), 12.0 * _noise(rng, 1.3), (0.9, 1.0, 0.8))
    lawn = _colour((204, 222, 172), 5.0 * _noise(rng, 0.9), (0.9, 1.0, 0.7))
    image = hedge * leaf + (1 - hedge) * sky
    return np.asarray(np.where((up < 0.40)[..., None], lawn, image))


_RECIPES: dict[str, tuple[Callable[[np.random.Generator, Grid], Array], float]] = {
    "books": (_books, 0.8),
    "brick": (_brick, 1.25),
    "carpet": (_carpet, 1.0),
    "ceiling": (_ceiling, 2.0),
    "concrete": (_concrete, 2.4),
    "damask": (_damask, 1.6),
    "dark_planks": (_dark_planks, 1.2),
    "fabric": (_fabric, 0.5),
    "lacquer": (_lacquer, 1.0),
    "leaves": (_leaves, 0.5),
    "outdoors": (_outdoors, 5.2),
    "planks": (_planks, 1.1),
    "plaster": (_plaster, 2.0),
    "stripes": (_stripes, 1.6),
    "tiles": (_tiles, 1.6),
    "wood": (_wood, 0.9),
}
"""Name -> recipe and physical size (m)."""

NAMES = tuple(sorted(_RECIPES))
"""Names of all materials."""


@lru_cache(maxsize=128)
def material(name: str, seed: int) -> Material:
    """The named texture for a seed: the same bytes for the same arguments.

    Args:
        name: one of :data:`NAMES`.
        seed: variant.

    Raises:
        KeyError: unknown name (a programming error: names never come from users).
    """
    recipe, size_m = _RECIPES[name]
    rng = np.random.default_rng([seed, NAMES.index(name)])
    ticks = (np.arange(SIZE) + 0.5) / SIZE
    x, y = np.meshgrid(ticks, ticks)
    image = np.clip(np.rint(recipe(rng, (x, y))), 0, 255).astype(np.uint8)
    image.setflags(write=False)
    return Material(name, image, size_m)
