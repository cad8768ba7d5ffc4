"""Textures as the kernels read them: mip levels in tiles."""

from __future__ import annotations

import math
from collections import OrderedDict
from hashlib import blake2b
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from galoc_env.render._shading_kernel import LEVELS, SIZE

if TYPE_CHECKING:
    from galoc_env.scene.mesh import SceneMesh

KEPT = 512
"""Packed textures that a process keeps for the next home; 0.35 MB each at most."""
FULL_FOCAL_PX = 120.0
"""Cameras of half this focal length do without the finest level, of a quarter without two: they would only see it on
surfaces closer than half a metre, and an arena of many homes is mostly textures."""

_packed: OrderedDict[tuple[str, int], NDArray[np.int32]] = OrderedDict()


def digest(image: NDArray[np.uint8]) -> str:
    """Name of a texture by its content."""
    return blake2b(np.ascontiguousarray(image).data, digest_size=16).hexdigest()


def texture_of(mesh: SceneMesh) -> NDArray[np.uint8] | None:
    """(H, W, 3) sRGB texture of a mesh, row 0 at the top; None where it has none."""
    material = getattr(mesh.mesh.visual, "material", None)
    image = getattr(material, "baseColorTexture", None)
    image = getattr(material, "image", None) if image is None else image
    return None if image is None else np.asarray(image.convert("RGB"))


def finest_level(focal_px: float) -> int:
    """Largest mip level that a camera of this focal length needs, 0 (256 texels wide) to 3."""
    return min(3, max(0, math.floor(math.log2(FULL_FOCAL_PX / focal_px))))


def length(finest: int) -> int:
    """Texels of a packed texture."""
    return sum((SIZE >> level) ** 2 for level in range(finest, LEVELS))


def packed(image: NDArray[np.uint8], name: str, finest: int) -> NDArray[np.int32]:
    """(length(finest),) the mip levels of an image from the finest on, each texel as 0xBBGGRR.

    A level's texels lie in tiles of 4 x 4, so that neighbours share a cache line. Row 0 is the lower edge (v = 0).

    Args:
        image: (H, W, 3) sRGB, row 0 at the top; resized to 256 x 256 where it is not.
        name: its :func:`digest`.
        finest: first level.
    """
    key = (name, finest)
    if key in _packed:
        _packed.move_to_end(key)
        return _packed[key]
    if image.shape[:2] != (SIZE, SIZE):
        import cv2

        image = np.asarray(cv2.resize(image, (SIZE, SIZE), interpolation=cv2.INTER_AREA), np.uint8)
    level, parts = image[::-1, :, :3].astype(np.float64), []
    for number in range(LEVELS):
        if number >= finest:
            size = len(level)
            byte = np.floor(level + 0.5).astype(np.int32)
            colour = byte[..., 0] | byte[..., 1] << 8 | byte[..., 2] << 16
            parts.append(colour.reshape(size // 4, 4, size // 4, 4).transpose(0, 2, 1, 3).ravel())
        square = level * level  # close to linear light, and exact on every machine
        mean = (square[::2, ::2] + square[1::2, ::2] + square[::2, 1::2] + square[1::2, 1::2]) / 4.0
        level = np.sqrt(mean)
    _packed[key] = np.concatenate(parts)
    while len(_packed) > KEPT:
        _packed.popitem(last=False)
    return _packed[key]
