"""KeyLock: one process at a time builds what belongs to a key; the others wait and read it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def key_lock(path: Path) -> Iterator[bool]:
    """Hold an advisory lock on a file that is made for it and removed afterwards.

    Args:
        path: the lock file; its folder is made.

    Yields:
        True; False at once where locking is impossible (read-only folder, file system or platform without locks).
    """
    handle = _acquire(path)
    try:
        yield handle is not None
    finally:
        if handle is not None:
            _release(path, handle)


def _acquire(path: Path) -> int | None:
    try:
        import fcntl

        path.parent.mkdir(parents=True, exist_ok=True)
        while True:
            handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX)
                # Whoever held it removed the file: then this lock is on a file that nobody else will find.
                if _same_file(handle, path):
                    return handle
            except BaseException:
                os.close(handle)
                raise
            os.close(handle)
    except (ImportError, OSError):
        return None


def _release(path: Path, handle: int) -> None:
    import fcntl

    try:
        if _same_file(handle, path):
            path.unlink(missing_ok=True)
        fcntl.flock(handle, fcntl.LOCK_UN)  # explicitly: a forked child may hold the same descriptor
    except OSError:
        pass  # closing releases it as well
    finally:
        os.close(handle)


def _same_file(handle: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path))
    except FileNotFoundError:
        return False
