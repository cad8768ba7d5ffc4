"""Textures of wood: solid wood, boards and parquet."""

from __future__ import annotations

import numpy as np

from galoc_env.materials.noise import SIZE, Canvas, Field, paint, worn

_WARM = (1.0, 0.85, 0.65)
OAK, WALNUT, PINE = (190, 150, 104), (112, 78, 54), (218, 178, 124)
BEECH, GREY, CHERRY, WENGE = (206, 160, 118), (166, 156, 144), (158, 94, 62), (74, 58, 48)


def _grain(c: Canvas, strength: float) -> Field:
    """Fibres along the rows (up), some of them drawn to rings."""
    rings = np.sin(c.uniform(3.0, 7.0) * c.noise("figure") + 1.5 * c.noise("grain"))
    return np.asarray(strength * (4.0 * c.noise("grain") + 2.5 * c.noise("figure") + c.uniform(1.0, 5.0) * rings))


def _solid(c: Canvas, *bases: tuple[int, int, int]) -> Field:
    return worn(c, paint(c.pick(*bases), _grain(c, c.uniform(0.7, 1.4)), _WARM), 0.04)


def wood(c: Canvas) -> Field:
    """Wood of a middle tone."""
    return _solid(c, (176, 128, 84), OAK, BEECH)


def oak(c: Canvas) -> Field:
    """Pale to middle brown."""
    return _solid(c, OAK, (204, 168, 122))


def walnut(c: Canvas) -> Field:
    """Dark wood, cherry to wenge."""
    return _solid(c, WALNUT, CHERRY, WENGE)


def pine(c: Canvas) -> Field:
    """Pale, with a few knots."""
    image = _solid(c, PINE, (226, 190, 142))
    for x, y in c.rng.uniform(size=(4, 2)).astype(np.float32):
        dx, dy = (c.x[0] - x + 0.5) % 1.0 - 0.5, (c.y[:, 0] - y + 0.5) % 1.0 - 0.5
        knot = np.ix_(np.abs(dy) < 0.09, np.abs(dx) < 0.06)
        spot = np.exp(-((dx / 0.018) ** 2)) * np.exp(-((dy / 0.03) ** 2))[:, None]
        image[knot] *= 1.0 - 0.5 * spot[knot][..., None]
    return image


def painted_wood(c: Canvas) -> Field:
    """Paint that shows brush strokes, in white or a muted colour."""
    base = c.pick((240, 238, 230)) if c.rng.uniform() < 0.6 else c.colour((0.05, 0.35), (0.55, 0.95))
    return worn(c, paint(base, 1.6 * c.noise("grain") + 1.2 * c.noise("soft")), 0.015)


def _boards(c: Canvas, bases: tuple[tuple[int, int, int], ...], count: int) -> Field:
    """Boards that run along the rows (up), each with its own tone, grain and end joint."""
    board, within = c.steps(count)
    tone, shift = c.rng.normal(size=count).astype(np.float32), c.rng.uniform(size=count).astype(np.float32)
    rows = (np.arange(SIZE)[:, None] + (shift * SIZE).astype(np.int64)[board][None, :]) % SIZE
    grain = _grain(c, c.uniform(0.7, 1.3))[rows, np.arange(SIZE)]  # grain breaks off at the joints
    image = paint(c.pick(*bases), grain + c.uniform(4.0, 14.0) * tone[board], _WARM)
    seam = (np.minimum(within, 1 - within) < 0.012 * count / 6) | ((c.y + shift[board]) % 1.0 < 0.006)
    image[seam] *= c.uniform(0.55, 0.8)
    return worn(c, image, c.uniform(0.0, 0.12))


def planks(c: Canvas) -> Field:
    """Floorboards of a middle tone."""
    return _boards(c, (OAK, (186, 142, 98), BEECH), int(c.rng.integers(5, 9)))


def dark_planks(c: Canvas) -> Field:
    """Dark floorboards."""
    return _boards(c, (WALNUT, CHERRY, (136, 98, 68), WENGE), int(c.rng.integers(6, 11)))


def pale_planks(c: Canvas) -> Field:
    """Pale or grey floorboards."""
    return _boards(c, (PINE, (214, 196, 170), GREY, (222, 210, 192)), int(c.rng.integers(5, 9)))


def herringbone(c: Canvas) -> Field:
    """Short boards at right angles to each other: cell (i, j) is in a level one where (i - j) mod 8 < 4."""
    cells, ratio = 16, 4
    i, j = np.floor(c.x * cells).astype(np.int64), np.floor(c.y * cells).astype(np.int64)
    fx, fy = (c.x * cells) % 1.0, (c.y * cells) % 1.0
    m = (i - j) % (2 * ratio)
    level = m < ratio
    tones = c.rng.normal(size=(2, cells, cells)).astype(np.float32)
    tone = np.where(level, tones[0][j, (i - m) % cells], tones[1][i, (j + m - ratio) % cells])
    grain = _grain(c, c.uniform(0.7, 1.2))
    image = paint(c.pick(OAK, (176, 128, 84), WALNUT, BEECH), np.where(level, grain.T, grain) + 9.0 * tone, _WARM)
    across, along = np.where(level, fy, fx), np.where(level, (m + fx) / ratio, (m - ratio + 1 - fy) / ratio)
    seam = (across < 0.05) | (across > 0.95) | (along < 0.0125) | (along > 1 - 0.0125)
    image[seam] *= 0.7
    return worn(c, image, c.uniform(0.0, 0.12))


def wood_panelling(c: Canvas) -> Field:
    """Tongue-and-groove boards for walls, painted or plain."""
    image = painted_wood(c) if c.rng.uniform() < 0.6 else _solid(c, PINE, OAK)
    _, within = c.steps(int(c.rng.integers(8, 14)))
    image *= (1.0 - 0.28 * np.exp(-((np.minimum(within, 1 - within) / 0.045) ** 2)))[None, :, None]
    return image
