"""DiskCache: arrays that take seconds to compute, kept on disk by content and mapped into memory when needed again."""

from __future__ import annotations

import hashlib
import mmap
import os
import re
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc.cache_file import (
    Arrays,
    BrokenFile,
    Specs,
    checksum,
    map_arrays,
    new_file,
    pack_header,
    read_header,
    read_note,
    writer_alive,
)
from galoc.cache_lock import key_lock
from galoc.cache_place import cache_folder, cache_limit
from galoc.errors import CacheWarning, GalocError

FORMAT = 1
"""Part of every key; counted up when the meaning of keys changes."""
STALE_S = 3600.0
"""Temporary files of dead processes are removed after this, s."""
SUFFIX = ".galoc"

_checked: set[tuple[str, int, int, int]] = set()
"""Files whose data this process has checked: path, inode, size, checksum."""
_warned: set[str] = set()
"""Folders about which this process has warned."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One file of the cache."""

    key: str
    """Key it was saved under."""
    note: str
    """What it holds, for people."""
    size: int
    """Bytes."""
    last_used: float
    """Unix time of the last load or save, s."""


def content_key(kind: str, *parts: NDArray[Any] | float | int | str) -> str:
    """Key of whatever is computed from these parts: 32 hex digits.

    Args:
        kind: what is computed.
        parts: all that it depends on: arrays (by dtype, shape and bytes), numbers, strings; their order counts.
    """
    digest = hashlib.sha256()
    for part in (FORMAT, kind, *parts):
        if isinstance(part, np.ndarray):
            words, data = f"array {part.dtype.str} {part.shape}", part.tobytes()
        elif isinstance(part, str | bool | int | float | np.generic):
            plain = part.item() if isinstance(part, np.generic) else part
            words, data = type(plain).__name__, repr(plain).encode()
        else:
            raise TypeError(f"a key cannot be made of {type(part).__name__}")
        digest.update(f"{words} {len(data)}\n".encode() + data)
    return digest.hexdigest()[:32]


class DiskCache:
    """Named arrays under a key. Whatever goes wrong on disk, results are right: at worst they are computed again.

    Safe with several processes: files appear whole, readers keep what they have mapped when it is removed.

    Args:
        folder: where the files lie; made on the first save. None: by environment, see :mod:`galoc.cache_place`.
        limit_bytes: least recently used entries are removed beyond this. None: by environment.
    """

    def __init__(self, folder: Path | None = None, limit_bytes: int | None = None) -> None:
        self.folder = folder if folder is not None else cache_folder()
        """None: the cache is off."""
        self.limit_bytes = limit_bytes if limit_bytes is not None else cache_limit()

    def load(self, key: str, *, writable: bool = False) -> Arrays | None:
        """The arrays saved under a key, or None. A damaged file is removed with a CacheWarning.

        Args:
            key: from :func:`content_key`.
            writable: the arrays can be changed in memory, which does not change the file. numba compiles kernels a
                second time for read-only arrays; these spare that.
        """
        path = self._path(key)
        if path is None:
            return None
        try:
            handle = os.open(path, os.O_RDONLY)
        except OSError:
            return None
        try:
            arrays = _read(path, handle, key, mmap.ACCESS_COPY if writable else mmap.ACCESS_READ)
        except BrokenFile as error:
            with suppress(OSError):
                path.unlink()
            warnings.warn(f"{str(path)!r} is damaged ({error}); it is computed anew.", CacheWarning, stacklevel=2)
            return None
        except OSError:
            return None
        finally:
            os.close(handle)
        now = time.time_ns()
        with suppress(OSError):
            os.utime(path, ns=(now, now))
        return arrays

    def save(self, key: str, arrays: Mapping[str, NDArray[Any]], note: str = "") -> bool:
        """Keep arrays under a key; True if they are kept."""
        path, specs = self._path(key), {name: (array.shape, array.dtype) for name, array in arrays.items()}
        if path is None or self._too_large(specs):
            return False
        with new_file(path, key, note, specs, self._warn) as mapped:
            if mapped is not None:
                for name, array in arrays.items():
                    mapped[name][...] = array
        self._tidy()
        return mapped is not None

    def fetch(self, key: str, build: Callable[[], Arrays], note: str = "", *, writable: bool = False) -> Arrays:
        """The arrays of a key: loaded (see :meth:`load`), or built and saved.

        A second process that wants the same key waits for the first one's build. ``build`` must not fetch this key.
        """

        def make() -> Arrays:
            built = _frozen(build(), writable)
            self.save(key, built, note)
            return built

        return self._once(key, make, writable)

    def fetch_filled(self, key: str, specs: Specs, fill: Callable[[Arrays], None], note: str = "") -> Arrays:
        """As :meth:`fetch` for arrays too large to be held twice: ``fill`` writes them in place; read-only."""

        def make() -> Arrays:
            with self.writer(key, specs, note) as arrays:
                fill(arrays)
            return arrays

        return self._once(key, make)

    def _once(self, key: str, make: Callable[[], Arrays], writable: bool = False) -> Arrays:
        """What is kept under a key, or what is made and kept now; of several processes one makes it."""
        found = self.load(key, writable=writable)
        if found is not None or self.folder is None:
            return make() if found is None else found
        with key_lock(self.folder / f"{key}.lock"):
            found = self.load(key, writable=writable)
            return make() if found is None else found

    @contextmanager
    def writer(self, key: str, specs: Specs, note: str = "") -> Iterator[Arrays]:
        """Writable arrays of zeros, mapped to a temporary file that becomes the key's when the block ends.

        After the block they are read-only and stay usable. Where they cannot be kept (cache off or unwritable, disk
        full, more than the limit) they lie in memory. An exception in the block leaves nothing behind.

        Args:
            key: from :func:`content_key`.
            specs: shape and dtype by name.
            note: what it holds, for people.
        """
        path = self._path(key)
        with ExitStack() as stack:
            arrays = None
            if path is not None and not self._too_large(specs):
                arrays = stack.enter_context(new_file(path, key, note, specs, self._warn))
            if arrays is None:
                arrays = {name: np.zeros(shape, dtype) for name, (shape, dtype) in specs.items()}
            yield arrays
        for array in arrays.values():
            array.flags.writeable = False
        self._tidy()

    def entries(self) -> list[Entry]:
        """What is kept, the last used first."""
        found = []
        for path, stat in self._files("*" + SUFFIX):
            found.append(Entry(path.name.removesuffix(SUFFIX), read_note(path), stat.st_size, stat.st_mtime))
        return sorted(found, key=lambda entry: -entry.last_used)

    @property
    def size(self) -> int:
        """Bytes of all entries."""
        return sum(stat.st_size for _, stat in self._files("*" + SUFFIX))

    def clear(self) -> int:
        """Remove all entries; gives the bytes freed. What others have mapped stays readable to them.

        Raises:
            GalocError: a file cannot be removed.
        """
        freed = 0
        leftovers = [f for f in self._files(".*.tmp") if not writer_alive(f[0])] + self._files("*.lock")
        for path, stat in self._files("*" + SUFFIX) + leftovers:
            try:
                path.unlink(missing_ok=True)
            except OSError as error:
                raise GalocError(
                    f"cache file {str(path)!r} which cannot be removed ({error.strerror})",
                    "a folder of one's own",
                    "Mend its permissions, or set GALOC_CACHE to another folder.",
                ) from error
            freed += stat.st_size
        return freed

    def _path(self, key: str) -> Path | None:
        if not re.fullmatch(r"[A-Za-z0-9_-]{1,100}", key):
            raise ValueError(f"cache key {key!r}: letters, digits, _ and - only")
        return None if self.folder is None else self.folder / (key + SUFFIX)

    def _files(self, pattern: str) -> list[tuple[Path, os.stat_result]]:
        found = []
        with suppress(OSError):
            for path in [] if self.folder is None else self.folder.glob(pattern):
                with suppress(OSError):  # removed by another process
                    found.append((path, path.stat()))
        return found

    def _too_large(self, specs: Specs) -> bool:
        return pack_header("", "", specs)[1].file_bytes > self.limit_bytes

    def _tidy(self) -> None:
        """Remove what is beyond the limit, least recently used first, and what crashed processes have left."""
        files = sorted(self._files("*" + SUFFIX), key=lambda file: file[1].st_mtime_ns)
        total = sum(stat.st_size for _, stat in files)
        for path, stat in files:
            if total <= self.limit_bytes:
                break
            with suppress(OSError):
                path.unlink()
                total -= stat.st_size
        for path, stat in self._files(".*.tmp"):
            if stat.st_mtime < time.time() - STALE_S and not writer_alive(path):
                with suppress(OSError):
                    path.unlink()

    def _warn(self, error: OSError) -> None:
        if str(self.folder) not in _warned:
            _warned.add(str(self.folder))
            warnings.warn(
                f"cannot write the cache folder {str(self.folder)!r} ({error.strerror}): results are computed each "
                'time. Set GALOC_CACHE to a writable folder, or to "off".',
                CacheWarning,
                stacklevel=3,
            )


def _frozen(arrays: Arrays, writable: bool) -> Arrays:
    """Built arrays as :meth:`DiskCache.load` would give them."""
    views = {name: array.view() for name, array in arrays.items()}
    for view in views.values():
        view.flags.writeable = writable
    return views


def _read(path: Path, handle: int, key: str, mode: int) -> Arrays:
    """Arrays of an open file; its data is checked once per process."""
    header = read_header(handle)
    if header.key != key:
        raise BrokenFile("it belongs to another key")
    arrays, data = map_arrays(handle, header, mode)
    mark = (str(path), os.fstat(handle).st_ino, header.file_bytes, header.data_crc)
    if mark not in _checked:
        if checksum(data) != header.data_crc:
            raise BrokenFile("its data is garbled")
        _checked.add(mark)
    return arrays
