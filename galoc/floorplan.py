"""The map: wall segments in metres, openings and ceiling height.

Plan frame: x right, y up, right-handed, metres. ``segments`` are what a camera can be localized against: every wall
face, with open doors as gaps. Windows are holes in a wall, so the wall runs through under them; they live in
``openings`` and only matter to whoever draws the world.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from galoc.freespace import FreeSpace

Array = NDArray[np.float64]

DEFAULT_CEILING = 2.6
"""Ceiling height assumed where a plan gives none, m."""


@dataclass(frozen=True, slots=True)
class Opening:
    """A door or window: a hole through a wall, given by its centreline."""

    kind: str
    """"door" (a gap in ``Floorplan.segments``, lintel above) or "window" (the wall's segments run through)."""
    x1: float
    """Centreline start, m."""
    y1: float
    """Centreline start, m."""
    x2: float
    """Centreline end, m."""
    y2: float
    """Centreline end, m."""
    thickness: float
    """Wall thickness across the opening, m (0 for a wall drawn as one line)."""
    bottom: float
    """Sill height above the floor, m (0 for a door)."""
    top: float
    """Head height above the floor, m."""

    @property
    def width(self) -> float:
        """Clear width, m."""
        return math.hypot(self.x2 - self.x1, self.y2 - self.y1)


@dataclass(frozen=True, slots=True, eq=False)
class Floorplan:
    """Walls of one storey. Immutable; build with :meth:`load` or :meth:`from_segments`."""

    segments: Array
    """(S, 4) float64, m: x1, y1, x2, y2 of each wall segment; read-only."""
    ceiling_height: float = DEFAULT_CEILING
    """Floor to ceiling, m."""
    openings: tuple[Opening, ...] = ()
    """Doors and windows."""
    outline: Array | None = None
    """(V, 2) float64, m: boundary polygon of the storey, not closed; None: found from the walls."""
    name: str = ""
    """Short name, for titles."""
    notes: str = ""
    """Free text kept through load and save."""

    def __post_init__(self) -> None:
        """Validate and freeze (see :mod:`galoc.plan_check` for the rules)."""
        from galoc.plan_check import checked_height, checked_openings, checked_outline, checked_segments

        object.__setattr__(self, "segments", checked_segments(self.segments))
        object.__setattr__(self, "ceiling_height", checked_height(self.ceiling_height))
        object.__setattr__(self, "outline", checked_outline(self.outline))
        object.__setattr__(self, "openings", checked_openings(self.openings, self.ceiling_height))

    @classmethod
    def from_segments(
        cls, segments: ArrayLike, ceiling_height: float = DEFAULT_CEILING, *, name: str = ""
    ) -> Floorplan:
        """Plan from an (S, 4) array of wall segments x1, y1, x2, y2 in metres."""
        return cls(segments, ceiling_height, name=name)  # type: ignore[arg-type]  # checked and converted by the class

    @classmethod
    def load(cls, path: str | Path, *, scale: float | None = None, ceiling_height: float | None = None) -> Floorplan:
        """Read a plan from a file; the format follows from the suffix.

        Args:
            path: ``.json`` (segments), ``.yaml``/``.yml`` (ROS map_server) or an image (``.png``, ``.pgm``, ...), or
                the bare name of a plan shipped with galoc (``"apartment"``).
            scale: metres per pixel; needed for images, refused elsewhere.
            ceiling_height: replaces the file's value, m.

        Raises:
            GalocError: missing file, not a plan, bad values, image without scale or too large.
        """
        from galoc.formats import load_plan

        return load_plan(path, scale=scale, ceiling_height=ceiling_height)

    def save(self, path: str | Path) -> Path:
        """Write JSON that :meth:`load` reads back equal; the file appears whole or not at all."""
        from galoc.formats import save_plan

        return save_plan(self, path)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Bounding box of the walls: x_min, y_min, x_max, y_max, m."""
        x, y = self.segments[:, [0, 2]], self.segments[:, [1, 3]]
        return float(x.min()), float(y.min()), float(x.max()), float(y.max())

    @property
    def content_hash(self) -> str:
        """Hex digest of everything that changes the geometry."""
        digest = hashlib.sha256(self.segments.tobytes())
        digest.update(repr((self.ceiling_height, self.openings)).encode())
        if self.outline is not None:
            digest.update(self.outline.tobytes())
        return digest.hexdigest()

    def free_space(self, resolution: float = 0.05) -> FreeSpace:
        """Where a camera can be: a grid of clearance to the nearest wall, with outside and wall cores removed.

        Cached per plan object and resolution.
        """
        return _free_space(self, resolution)


@lru_cache(maxsize=16)
def _free_space(plan: Floorplan, resolution: float) -> FreeSpace:
    from galoc.freespace import build_free_space

    return build_free_space(plan, resolution)
