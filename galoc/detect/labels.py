"""Wireframes labelled by hand: a JSON file that a person can type.

::

    {"galoc": "labels/1",
     "images": {
       "hall_01.jpg": {
         "size": [640, 480],
         "pairs": [
           {"ceiling": [-0.5, 92], "floor": [-0.5, 371], "kind": "border"},
           {"ceiling": [201.5, 143], "floor": [200, 330]},
           {"ceiling": [470, 61], "floor": null, "kind": "corner"}],
         "walls": [[0, 1], [1, 2]]}}}

``pairs`` go from left to right. A junction that is not seen is ``null``: it is put where the pair's plumb line leaves
the image. ``kind`` is "corner" (where it is left out), "occlusion" or "border". ``walls`` names the left and right pair
of each wall; left out, every two neighbours have a wall between them, but for two pairs on one plumb line, where a
wall ends before a farther one. Beside ``null`` a place may be given with ``"seen": [true, false]`` (ceiling, floor).
Optional for programs: ``sigma_px`` (N, 2), ``ceiling_cut`` and ``floor_cut`` (M, 2, 2; null where not cut).
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc.camera import Camera, azimuth
from galoc.detect.playback import Gravity, Playback, check_size
from galoc.detect.plumb import plumb_exit
from galoc.errors import GalocError
from galoc.formats.atomic import write_atomic
from galoc.types import Wireframe

FORMAT = "labels/1"
KINDS = ("corner", "occlusion", "border")
"""Names of the values of ``Wireframe.kind``."""
MAX_BYTES = 64 * 2**20
"""Larger files are refused before they are read."""
SAME_PLUMB = math.radians(0.5)
"""Neighbouring pairs nearer than this stand on one plumb line, rad."""
_PAIR = {"ceiling", "floor", "seen", "kind"}
_FRAME = {"size", "pairs", "walls", "sigma_px", "ceiling_cut", "floor_cut"}


class LabelsDetector(Playback):
    """A :class:`galoc.detect.Detector` that reads labels made by hand; each call moves to the next image of the file.

    Args:
        path: the JSON file.

    The names of the frames (``keys``) are the image names of the file, in its order: ``select("hall_01.jpg")`` goes
    to one.

    Raises:
        GalocError: not such a file, or labels that make no wireframe.
    """

    def __init__(self, path: str | Path) -> None:
        self._name = Path(path).name
        self._frames = _read(Path(path))
        super().__init__(list(self._frames), self._wireframe, repr(self._name))

    def _wireframe(self, key: str, camera: Camera, gravity: Gravity) -> Wireframe:
        return _frame_wireframe(self._frames[key], f"{self._name!r}, image {key!r}", camera, gravity)


def load_labels(
    path: str | Path, image: str | None = None, camera: Camera | None = None, gravity: Gravity = (0.0, 0.0)
) -> Wireframe:
    """Read one image's labels.

    Args:
        path: the JSON file.
        image: name of the image; None: the first.
        camera: intrinsics; needed where a junction is ``null`` or ``walls`` is left out.
        gravity: measured (roll, pitch), rad, for the same.

    Raises:
        GalocError: not such a file or image, labels that make no wireframe, or another image size.
    """
    frames = _read(Path(path))
    key = next(iter(frames)) if image is None else image
    if key not in frames:
        raise GalocError(f"image {key!r} of {Path(path).name!r}", f"one of {list(frames)[:5]}", "Fix the name.")
    return _frame_wireframe(frames[key], f"{Path(path).name!r}, image {key!r}", camera, gravity)


def save_labels(wireframes: Wireframe | Mapping[str, Wireframe], path: str | Path, size: tuple[int, int]) -> Path:
    """Write labels; :func:`load_labels` gives the same numbers back.

    Args:
        wireframes: of one image, or of several by their names.
        path: the file.
        size: (width, height) of the images, px.

    Raises:
        GalocError: the file cannot be written.
    """
    named = {"image": wireframes} if isinstance(wireframes, Wireframe) else dict(wireframes)
    data = {"galoc": FORMAT, "images": {name: _frame_data(w, size) for name, w in named.items()}}
    return write_atomic(path, (json.dumps(data, indent=1, allow_nan=False) + "\n").encode())


def _frame_data(w: Wireframe, size: tuple[int, int]) -> dict[str, Any]:
    rows = zip(w.ceiling.tolist(), w.floor.tolist(), w.ceiling_true, w.floor_true, w.kind, strict=True)
    pairs = [
        {"ceiling": top, "floor": bottom, "seen": [bool(a), bool(b)], "kind": KINDS[k]} for top, bottom, a, b, k in rows
    ]
    data: dict[str, Any] = {"size": [int(v) for v in size], "pairs": pairs, "walls": w.walls.tolist()}
    if w.sigma_px is not None:
        data["sigma_px"] = w.sigma_px.tolist()
    for name in ("ceiling_cut", "floor_cut"):
        cut = getattr(w, name)
        if cut is not None:
            data[name] = [[p if math.isfinite(p[0]) else None for p in ends] for ends in cut.tolist()]
    return data


def _read(path: Path) -> dict[str, Any]:
    """The frames of a file, checked as far as that goes without a camera."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise GalocError(f"{path.name!r}, larger than {MAX_BYTES} bytes", "a file of labels", "Split it.")
        data = json.loads(path.read_bytes())
    except GalocError:
        raise
    except OSError as error:
        raise GalocError(f"{str(path)!r} ({error.strerror})", "a file of labels", "Fix the path.") from error
    except (ValueError, RecursionError) as error:
        raise GalocError(f"{path.name!r} which is not JSON ({error})", "a file of labels", "Fix the JSON.") from error
    if not isinstance(data, dict) or data.get("galoc") != FORMAT or not isinstance(data.get("images"), dict):
        expected = f'{{"galoc": "{FORMAT}", "images": {{name: labels}}}}'
        raise GalocError(f"{path.name!r} of another form", expected, "See docs/detectors.md.")
    if not data["images"]:
        raise GalocError(f"{path.name!r} without a frame", "at least one image", "Label one.")
    for name, frame in data["images"].items():
        _check_frame(frame, f"{path.name!r}, image {name!r}")
    return data["images"]


def _check_frame(frame: Any, where: str) -> None:
    if not isinstance(frame, dict) or set(frame) - _FRAME or not {"size", "pairs"} <= set(frame):
        keys = sorted(frame) if isinstance(frame, dict) else type(frame).__name__
        raise GalocError(f"{where}: {keys}", f"size and pairs, perhaps {sorted(_FRAME)}", "Fix the keys.")
    size = frame["size"]
    whole = isinstance(size, list) and len(size) == 2 and all(type(v) is int and v > 0 for v in size)
    if not whole:
        raise GalocError(f"{where}: size {size!r}", "[width, height] in whole px", "Fix it.")
    if not isinstance(frame["pairs"], list):
        raise GalocError(f"{where}: pairs {frame['pairs']!r}", "a list of junction pairs", "Fix it.")
    for i, pair in enumerate(frame["pairs"]):
        _check_pair(pair, f"{where}, pair {i}")


def _check_pair(pair: Any, where: str) -> None:
    if not isinstance(pair, dict) or set(pair) - _PAIR or not {"ceiling", "floor"} <= set(pair):
        got = f"{where}: {sorted(pair) if isinstance(pair, dict) else pair!r}"
        raise GalocError(got, "ceiling and floor, perhaps seen and kind", "Fix the keys.")
    for name in ("ceiling", "floor"):
        if pair[name] is not None and not _is_point(pair[name]):
            raise GalocError(f"{where}: {name} {pair[name]!r}", "[column, row] in px, or null", "Fix it.")
    if pair["ceiling"] is None and pair["floor"] is None:
        raise GalocError(f"{where}: neither junction", "at least one", "Drop the pair, or give one of them.")
    if pair.get("kind", "corner") not in KINDS:
        raise GalocError(f"{where}: kind {pair['kind']!r}", f"one of {KINDS}", "Fix it.")
    seen = pair.get("seen", [True, True])
    if not isinstance(seen, list) or len(seen) != 2 or not all(isinstance(v, bool) for v in seen):
        raise GalocError(f"{where}: seen {seen!r}", "two of true and false: ceiling, floor", "Fix it.")


def _is_point(value: Any) -> bool:
    numbers = isinstance(value, list) and len(value) == 2 and all(type(v) in (int, float) for v in value)
    return numbers and all(abs(v) < 1e6 for v in value)  # false for NaN too


def _frame_wireframe(frame: Mapping[str, Any], where: str, camera: Camera | None, gravity: Gravity) -> Wireframe:
    try:
        if camera is not None:
            check_size("labels", tuple(frame["size"]), camera)
        ends = _ends(frame["pairs"], camera, gravity)
        seen = [[p[r] is not None and p.get("seen", [True, True])[i] for p in frame["pairs"]] for i, r in _ROWS]
        walls: Any = frame["walls"] if "walls" in frame else _neighbours(ends, camera, gravity)
        kind = [KINDS.index(pair.get("kind", "corner")) for pair in frame["pairs"]]
        cuts = {name: _cut(frame[name]) for name in ("ceiling_cut", "floor_cut") if name in frame}
        ceiling_true, floor_true = (np.array(flags, bool) for flags in seen)
        return Wireframe(
            ends[0], ends[1], ceiling_true, floor_true, walls, np.array(kind, np.int8), frame.get("sigma_px"), **cuts
        )
    except GalocError as error:
        raise GalocError(f"{where}: {error.got}", error.expected, error.cure) from error


_ROWS = ((0, "ceiling"), (1, "floor"))


def _ends(pairs: list[dict[str, Any]], camera: Camera | None, gravity: Gravity) -> NDArray[np.float64]:
    """(2, N, 2) px: junctions, those left out put where the plumb line leaves the image."""
    ends = np.zeros((2, len(pairs), 2))
    for i, pair in enumerate(pairs):
        for row, name in _ROWS:
            if pair[name] is not None:
                ends[row, i] = pair[name]
                continue
            if camera is None:
                got = f"pair {i} with {name} null and no camera"
                raise GalocError(got, "the camera that its plumb line needs", "Pass camera and gravity.")
            ends[row, i] = plumb_exit(pair[_ROWS[1 - row][1]], camera, gravity, upwards=row == 0)
    return ends


def _neighbours(ends: NDArray[np.float64], camera: Camera | None, gravity: Gravity) -> list[tuple[int, int]]:
    """A wall between every two neighbours that do not stand on one plumb line."""
    if camera is None:
        got = "labels without walls and no camera"
        raise GalocError(got, "walls, or the camera that tells plumb lines", "Pass camera and gravity.")
    stands = azimuth(camera.rays_level(ends, gravity)).mean(axis=0)
    return [(i, i + 1) for i in range(len(stands) - 1) if stands[i + 1] - stands[i] > SAME_PLUMB]


def _cut(rows: Any) -> Any:
    """Nulls as NaN; anything else is left to Wireframe to refuse."""
    if not isinstance(rows, list) or not all(isinstance(ends, list) for ends in rows):
        return rows
    return [[[math.nan, math.nan] if p is None else p for p in ends] for ends in rows]
