"""The pixel size of an image from its header alone, so that a decompression bomb is refused unread."""

from __future__ import annotations

import re
import struct
from pathlib import Path

from galoc.errors import GalocError

MAX_PIXELS = 64_000_000
"""Larger images are refused before they are decoded."""
HEADER_BYTES = 1 << 20
_PNM = re.compile(rb"P[1-6](?:\s+|#[^\n]*\n)+(\d+)(?:\s+|#[^\n]*\n)+(\d+)\s")


def checked_size(path: Path) -> tuple[int, int]:
    """Width and height in px of a PNG, PGM, JPEG or BMP file, from its header.

    Raises:
        GalocError: unreadable, not one of these formats, or above 64 million pixels.
    """
    try:
        with path.open("rb") as file:
            size = image_size(file.read(HEADER_BYTES))
    except OSError as error:
        raise GalocError(f"{str(path)!r} ({error.strerror})", "a readable image", "Check the path.") from error
    if size is None or min(size) < 1:
        raise GalocError(
            f"{path.name!r} that is no image", "a PNG, PGM, JPEG or BMP image", "Check or convert the file."
        )
    width, height = size
    if width * height > MAX_PIXELS:
        raise GalocError(
            f"{path.name!r} of {width} x {height} px",
            f"an image of at most {MAX_PIXELS / 1e6:.0f} million pixels",
            "Shrink the image; 0.02 to 0.05 m per pixel is enough.",
        )
    return width, height


def image_size(head: bytes) -> tuple[int, int] | None:
    """(width, height) in px from the first bytes of an image, or None when the format is not known."""
    if head.startswith(b"\x89PNG\r\n\x1a\n") and head[12:16] == b"IHDR" and len(head) >= 24:
        return struct.unpack(">II", head[16:24])
    if head.startswith(b"BM") and len(head) >= 26:
        width, height = struct.unpack("<ii", head[18:26])
        return abs(width), abs(height)
    if match := _PNM.match(head):
        return int(match[1][:9]), int(match[2][:9])
    if head.startswith(b"\xff\xd8"):
        return _jpeg_size(head)
    return None


def _jpeg_size(head: bytes) -> tuple[int, int] | None:
    """Walk the JPEG markers to the frame header."""
    at = 2
    while at + 9 <= len(head) and head[at] == 0xFF:
        marker, length = head[at + 1], int.from_bytes(head[at + 2 : at + 4], "big")
        if marker == 0xFF:  # fill byte
            at += 1
        elif 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">HH", head[at + 5 : at + 9])
            return width, height
        else:
            at += 2 + max(length, 2)
    return None
