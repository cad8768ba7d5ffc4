"""What textures are drawn with: periodic noise that all of them share, colours, and a canvas that holds both."""

from __future__ import annotations

import colorsys
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

SIZE = 256
"""Edge of every texture, px (a power of two, for mipmaps)."""

Field = NDArray[np.float32]

_SPECTRA = {
    "speck": (0.0, 1.0),
    "fine": (0.6, 1.0),
    "mid": (1.2, 1.0),
    "soft": (1.8, 1.0),
    "cloud": (2.6, 1.0),
    "grain": (1.1, 14.0),
    "figure": (1.8, 6.0),
}
"""Noise by name: exponent of 1 / frequency, and how far it is drawn out along rows (up)."""


@lru_cache(maxsize=1)
def _bank() -> dict[str, Field]:
    """Each noise of unit variance, tiled twice in both directions so that any shift of it is a view.

    One bank serves all textures, each with its own shift and mirroring: noise costs more than all else in a texture.
    """
    rng = np.random.default_rng(20)
    bank = {}
    for name, (power, stretch) in _SPECTRA.items():
        fy = np.fft.fftfreq(SIZE)[:, None] * stretch
        f2 = np.fft.rfftfreq(SIZE)[None, :] ** 2 + fy**2
        f2[0, 0] = 1.0
        spectrum = np.fft.rfft2(rng.normal(size=(SIZE, SIZE))) / f2 ** (power / 2.0)
        spectrum[0, 0] = 0.0
        field = np.fft.irfft2(spectrum, (SIZE, SIZE))
        bank[name] = np.tile((field / field.std()).astype(np.float32), (2, 2))
        bank[name].setflags(write=False)
    return bank


@lru_cache(maxsize=1)
def _grid() -> tuple[Field, Field]:
    ticks = ((np.arange(SIZE) + 0.5) / SIZE).astype(np.float32)
    x, y = np.meshgrid(ticks, ticks)
    x.setflags(write=False)
    y.setflags(write=False)
    return x, y


class Canvas:
    """One texture while it is drawn."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.x, self.y = _grid()
        """(256, 256) each, 0..1: to the right, and down."""

    def noise(self, name: str) -> Field:
        """(256, 256) periodic noise of unit variance, never twice the same; for names see ``_SPECTRA``."""
        row, column, flips = (int(v) for v in self.rng.integers((SIZE, SIZE, 4)))
        field = _bank()[name][row : row + SIZE, column : column + SIZE]
        return field[:: 1 - 2 * (flips & 1), :: 1 - 2 * (flips >> 1)]

    def steps(self, count: int) -> tuple[NDArray[np.int64], Field]:
        """Number (256,) of ``count`` equal stripes that each pixel of a row lies in, and where in it (0..1)."""
        at = self.x[0] * count
        return np.floor(at).astype(np.int64), at % 1.0

    def uniform(self, low: float, high: float) -> float:
        """A random number."""
        return float(self.rng.uniform(low, high))

    def pick(self, *choices: tuple[int, int, int]) -> Field:
        """One of some colours, a little off it."""
        base = np.array(choices[int(self.rng.integers(len(choices)))], np.float32)
        return np.asarray(base * self.rng.uniform(0.93, 1.05) * self.rng.uniform(0.97, 1.03, 3), np.float32)

    def colour(self, saturation: tuple[float, float], value: tuple[float, float]) -> Field:
        """(3,) 0..255: a random hue; homes have more warm ones, and strong green and violet are rare."""
        hue = self.rng.uniform()
        if self.rng.uniform() < 0.65:
            hue = self.rng.choice((0.06, 0.09, 0.11, 0.30, 0.55, 0.60)) + self.rng.normal(0.0, 0.03)
        rgb = colorsys.hsv_to_rgb(hue % 1.0, self.rng.uniform(*saturation), self.rng.uniform(*value))
        return np.array(rgb, np.float32) * 255.0


def paint(base: ArrayLike, field: NDArray, gain: ArrayLike = 1.0) -> Field:
    """Base colour (3,) plus a scalar field (256, 256) times a colour gain, (256, 256, 3) in 0..255."""
    image = np.asarray(field, np.float32)[..., None] * np.broadcast_to(np.asarray(gain, np.float32), (3,))
    image += np.asarray(base, np.float32)
    return image


def blend(under: NDArray, over: ArrayLike, share: NDArray) -> Field:
    """``over`` on ``under`` where ``share`` (256, 256) is 1."""
    weight = np.asarray(share, np.float32)[..., None]
    return np.asarray(under + weight * (np.asarray(over, np.float32) - under), np.float32)


def ramp(field: NDArray, width: float) -> Field:
    """0 where the field is below 0, 1 above ``width``, linear between: a soft edge."""
    return np.asarray(np.clip(field / width, 0.0, 1.0), np.float32)


def worn(canvas: Canvas, image: Field, strength: float) -> Field:
    """Stains and scuffs: broad blotches that darken by up to ``strength``, with a ragged border."""
    stain = ramp(canvas.noise("soft") + 0.25 * canvas.noise("fine") - canvas.uniform(0.6, 1.8), 0.8)
    image *= (1.0 - strength * stain)[..., None]
    return image
