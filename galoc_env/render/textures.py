"""Textures as the kernels read them: mip levels in tiles, each texel beside its right neighbour."""

from __future__ import annotations

from collections import OrderedDict
from hashlib import blake2b

import numpy as np
from numpy.typing import NDArray

from galoc_env.render._shading_kernel import LEVELS, SIZE

TEXELS = sum((SIZE >> level) ** 2 for level in range(LEVELS))
"""Length of a packed texture."""
KEPT = 256
"""Packed textures that a process keeps, 0.7 MB each."""

_packed: OrderedDict[str, NDArray[np.int64]] = OrderedDict()


def digest(image: NDArray[np.uint8]) -> str:
    """Name of a texture by its content."""
    return blake2b(np.ascontiguousarray(image), digest_size=16).hexdigest()


def packed(image: NDArray[np.uint8], name: str) -> NDArray[np.int64]:
    """(TEXELS,) all mip levels of an image, largest first.

    A level's texels lie in tiles of 4 x 4, so that neighbours share a cache line. Each holds 0xBBGGRR, and its right
    neighbour's in the upper half, so that one load serves two columns. Row 0 is the lower edge (v = 0).

    Args:
        image: (H, W, 3) sRGB, row 0 at the top; resized to 256 x 256 where it is not.
        name: its :func:`digest`.
    """
    if name in _packed:
        _packed.move_to_end(name)
        return _packed[name]
    if image.shape[:2] != (SIZE, SIZE):
        import cv2

        image = cv2.resize(image, (SIZE, SIZE), interpolation=cv2.INTER_AREA)
    level, parts = image[::-1, :, :3].astype(np.float64), []
    for _ in range(LEVELS):
        size = len(level)
        byte = np.floor(level + 0.5).astype(np.int64)
        colour = byte[..., 0] | byte[..., 1] << 8 | byte[..., 2] << 16
        pair = colour | np.roll(colour, -1, axis=1) << 32
        parts.append(pair.reshape(size // 4, 4, size // 4, 4).transpose(0, 2, 1, 3).ravel())
        square = level * level  # close to linear light, and exact on every machine
        mean = (square[::2, ::2] + square[1::2, ::2] + square[::2, 1::2] + square[1::2, 1::2]) / 4.0
        level = np.sqrt(mean)
    texels = np.concatenate(parts)
    _packed[name] = texels
    while len(_packed) > KEPT:
        _packed.popitem(last=False)
    return texels
