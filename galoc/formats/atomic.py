"""Writing a file whole or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from galoc.errors import GalocError


def write_atomic(path: str | Path, data: bytes) -> Path:
    """Write bytes to a temporary file beside the target, then rename it into place.

    Raises:
        GalocError: the folder is missing or not writable, or the disk is full; nothing is left behind.
    """
    target = Path(path)
    temporary: str | None = None
    try:
        handle, temporary = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".tmp", dir=target.parent)
        with os.fdopen(handle, "wb") as file:
            file.write(data)
        os.chmod(temporary, 0o666 & ~_umask())  # mkstemp makes 0600; a saved plan is an ordinary file
        os.replace(temporary, target)
        temporary = None
    except OSError as error:
        raise GalocError(
            f"{str(target)!r} which cannot be written ({error.strerror})",
            "a file name in an existing, writable folder",
            "Make the folder or choose another place.",
        ) from error
    finally:  # also when interrupted
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
    return target


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
