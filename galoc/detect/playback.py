"""Playing back wireframes that were made elsewhere, one frame after another."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from galoc.camera import Camera
from galoc.errors import GalocError
from galoc.types import Wireframe

Gravity = tuple[float, float]


class Playback:
    """A :class:`galoc.detect.Detector` that returns the wireframes of named frames in order.

    Args:
        keys: names of the frames, in order.
        load: called with a frame's name, the camera and the gravity when that frame's turn comes.
        source: what the frames come from, for error messages.

    Raises:
        GalocError: no frame, or two of one name.
    """

    def __init__(self, keys: Sequence[str], load: Callable[[str, Camera, Gravity], Wireframe], source: str) -> None:
        self.keys: tuple[str, ...] = tuple(keys)
        self._load, self._source, self._next = load, source, 0
        if not self.keys:
            raise GalocError(f"{source} without a frame", "at least one", "Check the folder or file.")
        if len(set(self.keys)) < len(self.keys):
            twice = next(key for key in self.keys if self.keys.count(key) > 1)
            raise GalocError(f"{source} with two frames named {twice!r}", "distinct names", "Rename one of them.")

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.keys)

    def reset(self) -> None:
        """Make the first frame the next one."""
        self._next = 0

    def select(self, key: str | int) -> None:
        """Make another frame the next one.

        Args:
            key: its name, or its number from 0.

        Raises:
            GalocError: there is no such frame.
        """
        if isinstance(key, str):
            if key not in self.keys:
                got = f"frame {key!r} of {self._source}"
                raise GalocError(got, f"one of its {len(self)} names, {self.keys[0]!r} for one", "Fix the name.")
            self._next = self.keys.index(key)
            return
        if isinstance(key, bool) or not isinstance(key, int | np.integer) or not 0 <= key < len(self):
            raise GalocError(f"frame {key!r} of {self._source}", f"0 to {len(self) - 1}", "Fix the number.")
        self._next = int(key)

    def detect(self, image: NDArray[np.uint8] | None, camera: Camera, gravity: Gravity) -> Wireframe:
        """The next frame's wireframe; the image itself is not looked at.

        Raises:
            GalocError: all frames were played, or this one cannot be read or is for images of another size.
        """
        if self._next >= len(self):
            got = f"a call of detect() after the last of the {len(self)} frames of {self._source}"
            raise GalocError(got, "one call per frame", "Call reset() to start again, or add frames.")
        wireframe = self._load(self.keys[self._next], camera, gravity)
        self._next += 1  # only now: a frame that could not be read is not skipped
        return wireframe


def check_size(what: str, size: tuple[int, int], camera: Camera) -> None:
    """Refuse pixels of an image of another size.

    Raises:
        GalocError: (width, height) differs from the camera's.
    """
    if tuple(size) != (camera.width, camera.height):
        got = f"{what} for images of {size[0]} x {size[1]} px with a camera of {camera.width} x {camera.height} px"
        raise GalocError(got, "one image size", "Use the camera of those images.")
