"""CacheFile format: named arrays in one file that is mapped into memory, with checksums of header and data.

Layout: magic, version, length and checksum of the header, checksum of the data (24 bytes, little endian); the header
(JSON: key, note, and name, dtype, shape and offset of each array); the arrays, each at a multiple of 64 bytes.
"""

from __future__ import annotations

import json
import math
import mmap
import os
import secrets
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

MAGIC, VERSION = b"\x93GALOC\r\n", 1
"""The magic bytes hold a line end, which a transfer as text would change."""
ALIGN = 64
"""Arrays start at multiples of this many bytes: a cache line, and any dtype."""
HEAD = struct.Struct("<8sIIII")
CRC_AT = 20
"""Where the checksum of the data lies in the file."""
MAX_HEADER = 1 << 24
"""A header is never longer than this, bytes."""

Arrays = dict[str, NDArray[Any]]
Specs = Mapping[str, tuple[tuple[int, ...], DTypeLike]]
"""Shape and dtype of arrays by name."""


class BrokenFile(Exception):
    """The file is not what was written: says why."""


@dataclass(frozen=True, slots=True)
class Header:
    """What a cache file says of itself."""

    key: str
    """Key it was saved under."""
    note: str
    """What it holds, for people."""
    arrays: tuple[tuple[str, np.dtype[Any], tuple[int, ...], int], ...]
    """Name, dtype, shape and offset from the start of the data, bytes."""
    start: int
    """Where the data starts in the file, bytes."""
    data_crc: int
    """CRC-32 of the data, gaps included."""

    @property
    def file_bytes(self) -> int:
        """Size of the whole file."""
        return self.start + max((at + _bytes(dtype, shape) for _, dtype, shape, at in self.arrays), default=0)


def pack_header(key: str, note: str, specs: Specs) -> tuple[bytes, Header]:
    """The first bytes of a file, the data's checksum still 0, and what they say.

    Raises:
        TypeError: a dtype that is not plain numbers.
    """
    rows, arrays, at = [], [], 0
    for name, (shape, given) in specs.items():
        dtype = np.dtype(given)
        if dtype.kind not in "biufc":
            raise TypeError(f"array {name!r} of dtype {dtype}: only plain numbers can be kept")
        at = _aligned(at)
        whole = tuple(int(n) for n in shape)
        rows.append({"name": name, "dtype": dtype.str, "shape": whole, "offset": at})
        arrays.append((name, dtype, whole, at))
        at += _bytes(dtype, whole)
    text = json.dumps({"key": key, "note": note, "arrays": rows}).encode()
    start = _aligned(HEAD.size + len(text))
    first = HEAD.pack(MAGIC, VERSION, len(text), zlib.crc32(text), 0) + text
    return first.ljust(start, b"\0"), Header(key, note, tuple(arrays), start, 0)


def read_header(handle: int) -> Header:
    """Header of an open file.

    Raises:
        BrokenFile: not a file of this format and version, or not as it was written (the data is not looked at).
        OSError: reading failed.
    """
    size = os.fstat(handle).st_size
    first = os.pread(handle, HEAD.size, 0)
    if len(first) < HEAD.size:
        raise BrokenFile("it is cut off")
    magic, version, length, header_crc, data_crc = HEAD.unpack(first)
    if magic != MAGIC or version != VERSION:
        raise BrokenFile("it is of another kind or version")
    text = os.pread(handle, min(length, MAX_HEADER), HEAD.size)
    if len(text) != length or zlib.crc32(text) != header_crc:
        raise BrokenFile("its header is garbled")
    try:
        content = json.loads(text)
        arrays = tuple(
            (str(row["name"]), np.dtype(row["dtype"]), tuple(int(n) for n in row["shape"]), int(row["offset"]))
            for row in content["arrays"]
        )
        header = Header(str(content["key"]), str(content["note"]), arrays, _aligned(HEAD.size + length), data_crc)
    except (ValueError, KeyError, TypeError) as error:  # written by something else that computes checksums
        raise BrokenFile("its header is unreadable") from error
    if header.file_bytes != size:
        raise BrokenFile(f"it has {size} bytes instead of {header.file_bytes}")
    return header


def map_arrays(handle: int, header: Header, mode: int) -> tuple[Arrays, memoryview]:
    """The arrays of an open file, and all of its data as bytes.

    Args:
        handle: file descriptor; may be closed afterwards.
        header: of the file.
        mode: ``mmap.ACCESS_READ``; ``mmap.ACCESS_COPY``, writable in memory only; or ``mmap.ACCESS_WRITE``.
    """
    whole = mmap.mmap(handle, header.file_bytes, access=mode)
    arrays: Arrays = {
        name: np.ndarray(shape, dtype, whole, header.start + at) for name, dtype, shape, at in header.arrays
    }
    return arrays, memoryview(whole)[header.start :]


def checksum(data: memoryview) -> int:
    """CRC-32, in pieces: Ctrl-C is heard between them."""
    crc = 0
    for start in range(0, len(data), 1 << 26):
        crc = zlib.crc32(data[start : start + (1 << 26)], crc)
    return crc


@contextmanager
def new_file(
    path: Path, key: str, note: str, specs: Specs, failed: Callable[[OSError], None]
) -> Iterator[Arrays | None]:
    """Arrays of zeros, mapped for writing to a temporary file that becomes ``path`` when the block ends well.

    Args:
        path: the file.
        key: for the header.
        note: for the header.
        specs: what it holds.
        failed: hears of what goes wrong on disk. If that is at the start, the block gets None.
    """
    temporary = path.with_name(f".{path.stem}.{os.getpid()}-{secrets.token_hex(4)}.tmp")
    handle: int | None = None
    opened = None
    first, header = pack_header(key, note, specs)
    try:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_CLOEXEC", 0), 0o600)
            _take_room(handle, header.file_bytes)
            os.pwrite(handle, first, 0)
            opened = map_arrays(handle, header, mmap.ACCESS_WRITE)
        except OSError as error:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
            failed(error)
        yield None if opened is None else opened[0]
        if handle is not None and opened is not None:
            try:
                os.pwrite(handle, struct.pack("<I", checksum(opened[1])), CRC_AT)
                os.replace(temporary, path)
            except OSError as error:
                failed(error)
    finally:  # also when interrupted
        if handle is not None:
            os.close(handle)
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def writer_alive(temporary: Path) -> bool:
    """Whether the process that writes a temporary file still runs."""
    number = temporary.name.rpartition(".tmp")[0].rpartition(".")[2].partition("-")[0]
    try:
        os.kill(int(number), 0)
    except (ValueError, ProcessLookupError):
        return False
    except OSError:
        pass  # somebody else's process
    return True


def read_note(path: Path) -> str:
    """Note of a file; "unreadable" where there is none."""
    try:
        handle = os.open(path, os.O_RDONLY)
        try:
            return read_header(handle).note
        finally:
            os.close(handle)
    except (OSError, BrokenFile):
        return "unreadable"


def _take_room(handle: int, size: int) -> None:
    """Make the file this long, its blocks taken: writing to a mapped file on a full disk would kill the process."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(handle, 0, size)
    else:
        os.ftruncate(handle, size)


def _aligned(at: int) -> int:
    return -(-at // ALIGN) * ALIGN


def _bytes(dtype: np.dtype[Any], shape: tuple[int, ...]) -> int:
    return dtype.itemsize * math.prod(shape)
