"""Images as floorplans: dark pixels are wall."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from galoc.errors import GalocError
from galoc.floorplan import Floorplan
from galoc.formats.image_size import checked_size

DARK_BELOW = 128
"""Grey values below this, of 0..255, are wall."""


def read_image(path: Path, scale: float) -> Floorplan:
    """Plan whose walls are the dark pixels of an image.

    Args:
        path: the image; transparent pixels count as white.
        scale: metres per pixel.

    Raises:
        GalocError: not an image, above 64 million pixels, or no walls in it.
    """
    from galoc.formats.vectorize import walls_from_free

    light = grey_image(path) >= DARK_BELOW
    # beyond the page is free, so that walls cut by the page's edge close and the page itself is no wall
    segments = walls_from_free(np.pad(light[::-1], 1, constant_values=True), scale, path.name)
    shift = np.array([scale, scale, scale, scale])
    return _named(path, segments - shift, f"{scale:g} m per pixel")


def _named(path: Path, segments: NDArray[np.float64], notes: str) -> Floorplan:
    try:
        return Floorplan(segments, name=path.stem, notes=f"Traced from {path.name}, {notes}.")
    except GalocError as error:
        raise GalocError(f"{path.name!r}: {error.got}", error.expected, error.cure) from error


def grey_image(path: Path) -> NDArray[np.uint8]:
    """(H, W) grey values of an image on white, row 0 at the top.

    Raises:
        GalocError: not an image, damaged, or above 64 million pixels.
    """
    import cv2

    width, height = checked_size(path)
    data = path.read_bytes()
    if data.startswith(b"\x89PNG") and b"IEND" not in data[-64:]:
        raise GalocError(f"{path.name!r} that ends too early", "a whole PNG file", "Copy or download it again.")
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error:
        image = None
    if image is None or image.shape[:2] != (height, width):
        raise GalocError(f"{path.name!r} that cannot be decoded", "a whole image", "Export it again as PNG.")
    image = np.asarray(image)
    if image.dtype == np.uint16:
        image = (image // 256).astype(np.uint8)
    if image.dtype != np.uint8:
        raise GalocError(f"{path.name!r} with {image.dtype} pixels", "8 or 16 bits a channel", "Export it as PNG.")
    if image.ndim == 2:
        return image.astype(np.uint8, copy=False)
    if image.shape[2] == 4:
        alpha = image[:, :, 3:].astype(np.uint16)
        image = ((image[:, :, :3] * alpha + 255 * (255 - alpha)) // 255).astype(np.uint8)
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(image[:, :, :3]), cv2.COLOR_BGR2GRAY), dtype=np.uint8)
