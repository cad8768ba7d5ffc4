"""What every detector asks of an image: that it is one, and that it is the camera's."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.camera import Camera
from galoc.errors import GalocError

LEAST_CONTRAST = 5
"""A picture nearly all of whose values are no further apart, of 255, shows nothing (lens covered, lamp out, fog)."""
OUTLIERS = 0.01
"""Share of the brightest and of the darkest values that do not count."""
LOOKED_AT = 4096
"""Pixels that are looked at, at least, where there are so many."""


def checked_picture(image: ArrayLike, camera: Camera) -> NDArray[np.uint8]:
    """The image as (H, W, 3) uint8 RGB of the camera's size; a view of it, not a copy, where it is contiguous.

    Args:
        image: what was given as an image.
        camera: intrinsics of the image.

    Raises:
        GalocError: not 8-bit RGB, or not the camera's size; the message says how to convert it.
    """
    pixels = _array(image)
    wanted = (camera.height, camera.width, 3)
    expected = f"uint8 RGB of shape {wanted}, the camera's"
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 3:
        raise GalocError(f"an image of {pixels.dtype} {pixels.shape}", expected, _conversion(pixels))
    if pixels.shape != wanted:
        raise GalocError(f"an image of shape {pixels.shape}", expected, _resizing(pixels.shape, camera))
    return np.ascontiguousarray(pixels)


def is_blank(picture: NDArray[np.uint8]) -> bool:
    """Whether a picture is of one tone, black or other, or nearly so: no detector can find a wall there."""
    stride = max(1, int((picture.shape[0] * picture.shape[1] / LOOKED_AT) ** 0.5))
    few = picture[::stride, ::stride].reshape(-1, 3)
    low, high = np.quantile(few, (OUTLIERS, 1.0 - OUTLIERS), axis=0, method="nearest").astype(np.int64)
    return bool(np.all(high - low <= LEAST_CONTRAST))


def _array(image: ArrayLike) -> NDArray:
    try:
        return np.asarray(image)
    except ValueError:  # rows of different lengths
        return np.empty(0, object)


def _conversion(pixels: NDArray) -> str:
    """How to make 8-bit RGB of what was given."""
    if pixels.size == 0:
        return "The image is empty: check that the camera or file delivered one."
    if pixels.dtype == np.uint16:
        return "Bring 16 bits down to 8: (image // 256).astype(numpy.uint8)."
    if pixels.dtype.kind == "f":
        return "Pass whole numbers from 0 to 255: (image * 255).round().astype(numpy.uint8) for values from 0 to 1."
    if pixels.dtype.kind not in "iu":
        return "Pass the pixels as an array, such as numpy.asarray(picture)."
    if pixels.dtype != np.uint8:
        return "Convert whole numbers from 0 to 255 by image.astype(numpy.uint8)."
    if pixels.ndim == 2 or (pixels.ndim == 3 and pixels.shape[2] == 1):
        return "Repeat the grey channel three times: cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)."
    if pixels.ndim == 3 and pixels.shape[2] == 4:
        return "Drop the alpha channel: image[..., :3]."
    if pixels.ndim == 3 and pixels.shape[0] == 3:
        return "Move the channels to the end: numpy.moveaxis(image, 0, -1)."
    if pixels.ndim == 4:
        return "Pass one image at a time."
    return "Convert the image to RGB."


def _resizing(shape: tuple[int, ...], camera: Camera) -> str:
    """What may have happened to an image of another size than the camera's."""
    if 0 in shape:
        return "The image is empty: check that the camera or file delivered one."
    if shape[:2] == (camera.width, camera.height):
        return "Is it rotated? Turn the image upright, or swap width and height of the camera with its field of view."
    return "Resize the image, or make the camera for images of its size."
