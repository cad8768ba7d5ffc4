"""Wireframes from npz files: how a detector that runs elsewhere, in another language or at another time, is used."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from galoc.camera import Camera
from galoc.detect.columns import Columns, checked_columns
from galoc.detect.playback import Gravity, Playback, check_size
from galoc.errors import GalocError
from galoc.formats.atomic import write_atomic
from galoc.types import Wireframe

FIELDS = tuple(field.name for field in fields(Wireframe) if field.name != "columns")
"""Arrays of a file: the fields of :class:`galoc.Wireframe`."""
REQUIRED = FIELDS[:5]
"""Those that no file can do without: ceiling, floor, ceiling_true, floor_true, walls."""
COLUMN_FIELDS = tuple(f"columns_{field.name}" for field in fields(Columns))
"""Arrays of a file whose wireframe keeps what a network said column by column: all of them or none."""
SIZE = "image_size"
"""Optional array (2,): width and height of the image, px."""
MAX_BYTES = 64 * 2**20
"""Files that unpack to more are refused before they are read."""


def save_wireframe(wireframe: Wireframe, path: str | Path, camera: Camera | None = None) -> Path:
    """Write a wireframe as npz; the file appears whole or not at all.

    Args:
        wireframe: what to write.
        path: the file, named ``.npz``.
        camera: notes the image size in the file, so that reading it for another one is an error.

    Raises:
        GalocError: another extension, or the file cannot be written.
    """
    target = Path(path)
    if target.suffix.lower() != ".npz":
        raise GalocError(f"file name {target.name!r}", "one that ends in .npz", "Rename it.")
    arrays = {name: np.asarray(getattr(wireframe, name)) for name in FIELDS if getattr(wireframe, name) is not None}
    if wireframe.columns is not None:
        arrays |= {name: getattr(wireframe.columns, name.removeprefix("columns_")) for name in COLUMN_FIELDS}
    if camera is not None:
        arrays[SIZE] = np.array([camera.width, camera.height])
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]  # the stub takes a name for allow_pickle
    return write_atomic(target, buffer.getvalue())


def load_wireframe(path: str | Path, camera: Camera | None = None) -> Wireframe:
    """Read a wireframe that :func:`save_wireframe` or anyone else wrote.

    Args:
        path: npz file with the arrays ``REQUIRED`` and any of the other fields of :class:`galoc.Wireframe`.
        camera: of the image; an error when the file says another image size.

    Raises:
        GalocError: not such a file, arrays that make no wireframe, or another image size.
    """
    source = Path(path)
    arrays = _arrays(source)
    wanted = {*REQUIRED, *COLUMN_FIELDS} if set(COLUMN_FIELDS) & set(arrays) else set(REQUIRED)
    missing, unknown = wanted - set(arrays), set(arrays) - {*FIELDS, *COLUMN_FIELDS, SIZE}
    if missing or unknown:
        got = f"{source.name!r} " + (f"without {sorted(missing)}" if missing else f"with {sorted(unknown)}")
        raise GalocError(got, f"the arrays {REQUIRED}, perhaps {(*FIELDS[5:], SIZE)}", "Fix the names.")
    size = arrays.pop(SIZE, None)
    said = {name: arrays.pop(name) for name in COLUMN_FIELDS if name in arrays}
    try:
        columns = _columns(said) if said else None
        if size is not None and camera is not None:
            if size.shape != (2,) or size.dtype.kind not in "iu":
                raise GalocError(f"{SIZE} {size}", "width and height, whole px", "Fix it.")
            check_size("pixels", (int(size[0]), int(size[1])), camera)
        return Wireframe(**arrays, columns=columns)
    except GalocError as error:
        raise GalocError(f"{source.name!r}: {error.got}", error.expected, error.cure) from error


def _columns(said: dict[str, Any]) -> Columns:
    for name, array in said.items():
        if array.dtype.kind not in "biuf" or array.ndim == 0:
            raise GalocError(f"{name} of {array.dtype} {array.shape}", "an array of numbers", "Fix it.")
    parts = {name.removeprefix("columns_"): np.asarray(array, np.float64) for name, array in said.items()}
    return checked_columns(Columns(**parts))


def _arrays(source: Path) -> dict[str, Any]:
    """The arrays of an npz file, refused where they are objects or too large."""
    try:
        with zipfile.ZipFile(source) as archive:
            unpacked = sum(entry.file_size for entry in archive.infolist())
        if unpacked > MAX_BYTES:
            got = f"{source.name!r}, {unpacked} bytes unpacked"
            raise GalocError(got, f"at most {MAX_BYTES}, one frame a file", "Split it.")
        with np.load(source, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except GalocError:
        raise
    except (OSError, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, zipfile.BadZipFile) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "not a plain npz archive"
        got = f"{str(source)!r} which cannot be read ({reason})"
        raise GalocError(got, "an npz file of plain arrays", "Write it with numpy.savez or save_wireframe.") from error


class PrecomputedDetector(Playback):
    """A :class:`galoc.detect.Detector` that reads one npz file per frame; each call moves to the next.

    Args:
        frames: a folder, whose npz files are taken in the order of their names, or the files in order.

    The names of the frames (``keys``) are the file names without extension: ``select("frame_0012")`` goes there.

    Raises:
        GalocError: no folder, no npz file in it, or two files of one name.
    """

    def __init__(self, frames: str | Path | Sequence[str | Path]) -> None:
        if isinstance(frames, str | Path):
            folder = Path(frames)
            if not folder.is_dir():
                raise GalocError(f"{str(folder)!r}", "a folder of npz files, or a list of such files", "Fix the path.")
            files, source = sorted(folder.glob("*.npz")), f"folder {folder.name!r}"
        else:
            files, source = [Path(file) for file in frames], "the list of npz files"
        self._files = {file.stem: file for file in files}
        super().__init__([file.stem for file in files], self._read, source)

    def _read(self, key: str, camera: Camera, gravity: Gravity) -> Wireframe:
        return load_wireframe(self._files[key], camera)
