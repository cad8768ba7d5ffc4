"""The true wireframe of a view: exactly visible corners, occlusion ends, truncation at the image border.

Label convention, equal to the plan's: rays pass open doorways (gaps in the plan), a lintel above one is clutter like
furniture and hides nothing; windows belong to their wall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.camera import Camera
from galoc.errors import GalocError
from galoc.floorplan import Floorplan
from galoc.types import BORDER, CORNER, OCCLUSION, Wireframe
from galoc.wall_pixels import JOIN_RANGE, Face, azimuth_limits, wireframe_of
from galoc_env.truth_kernel import line_range, visible_pieces

Array = NDArray[np.float64]

MIN_WIDTH = math.radians(0.3)
"""Panels narrower than this are no panels to any detector (about 1 px of 640 at 108 degrees), rad."""
JOIN_ANGLE = math.radians(0.3)
"""Neighbouring pieces that meet and turn by less than this are one straight wall, rad."""


@dataclass(slots=True)
class Panel:
    """One visible stretch of straight wall, left to right."""

    azimuth: Array
    """(2,) rad: left and right end."""
    range: Array
    """(2,) m: distance from the camera (in plan) at both ends."""
    segment: int
    """Index of the plan segment (of the leftmost one when several are collinear)."""
    kind: list[int]
    """Left and right end: CORNER, OCCLUSION or BORDER."""

    def points(self) -> Array:
        """(2, 2): both ends as (x right, z forward) in the level frame, m."""
        return np.stack([self.range * np.sin(self.azimuth), self.range * np.cos(self.azimuth)], axis=1)

    def face(self, heights: tuple[float, float]) -> Face:
        """The stretch between ceiling and floor; heights below the camera (ceiling, floor), m."""
        xz = self.points()
        corners = np.stack([np.stack([xz[:, 0], np.full(2, y), xz[:, 1]], axis=1) for y in heights])
        return Face(corners, (self.kind[0], self.kind[1]))


def visible_panels(plan: Floorplan, pose: ArrayLike, azimuth_min: float, azimuth_max: float) -> list[Panel]:
    """Walls seen from a pose between two azimuths, left to right, with occlusions resolved exactly.

    Args:
        plan: the walls.
        pose: (x, y, heading), m and rad.
        azimuth_min: leftmost azimuth, rad (right positive), above -pi.
        azimuth_max: rightmost azimuth, rad, below pi.
    """
    x, y, heading = (float(v) for v in np.asarray(pose, dtype=np.float64))
    segments = plan.segments
    ends = segments.reshape(-1, 2)
    bearing = np.arctan2(ends[:, 1] - y, ends[:, 0] - x)
    events = (heading - bearing + np.pi) % (2 * np.pi) - np.pi
    events = events[(events > azimuth_min) & (events < azimuth_max)]
    events = np.unique(np.concatenate([[azimuth_min], events, [azimuth_max]]))
    pieces = visible_pieces(segments, x, y, heading, events)
    panels: list[Panel] = []
    for a0, a1, k in pieces:
        if k < 0:
            continue
        ranges = [line_range(segments, int(k), x, y, math.cos(heading - a), math.sin(heading - a)) for a in (a0, a1)]
        panel = Panel(np.array([a0, a1]), np.array(ranges), int(k), [BORDER, BORDER])
        if not (panels and _joined(panels[-1], panel)):
            panels.append(panel)
    return _classified(panels, azimuth_min, azimuth_max)


def _joined(left: Panel, right: Panel) -> bool:
    """Extend ``left`` by ``right`` when the two are one straight wall."""
    if right.azimuth[0] - left.azimuth[1] > 1e-9 or abs(right.range[0] - left.range[1]) > JOIN_RANGE * left.range[1]:
        return False
    if left.segment != right.segment:
        d = np.diff(left.points(), axis=0)[0], np.diff(right.points(), axis=0)[0]
        turn = abs(math.atan2(d[0][0] * d[1][1] - d[0][1] * d[1][0], float(d[0] @ d[1])))
        if turn > JOIN_ANGLE:
            return False
    left.azimuth[1], left.range[1] = right.azimuth[1], right.range[1]
    return True


def _classified(panels: list[Panel], azimuth_min: float, azimuth_max: float) -> list[Panel]:
    """Set the kind of every end: the nearer of two unequal neighbours ends there, the farther is occluded."""
    for i, panel in enumerate(panels):
        for side, step in ((0, -1), (1, 1)):
            limit = azimuth_min if side == 0 else azimuth_max
            if abs(panel.azimuth[side] - limit) < 1e-9:
                continue
            j = i + step
            touching = 0 <= j < len(panels) and abs(panels[j].azimuth[1 - side] - panel.azimuth[side]) < 1e-9
            other = panels[j].range[1 - side] if touching else math.inf
            behind = panel.range[side] > other * (1.0 + JOIN_RANGE)
            panel.kind[side] = OCCLUSION if behind else CORNER
    return [p for p in panels if p.azimuth[1] - p.azimuth[0] > MIN_WIDTH]


def visible_wireframe(
    plan: Floorplan,
    camera: Camera,
    pose: ArrayLike,
    camera_height: float,
    gravity: tuple[float, float] = (0.0, 0.0),
) -> Wireframe:
    """The wireframe a perfect detector would return.

    Args:
        plan: walls and ceiling height.
        camera: intrinsics.
        pose: (x, y, heading), m and rad.
        camera_height: above the floor, m, between 0 and the ceiling.
        gravity: TRUE (roll, pitch) of the camera, rad.

    Raises:
        GalocError: camera not between floor and ceiling, or pose not finite.
    """
    if not 0.0 < camera_height < plan.ceiling_height:
        raise GalocError(
            f"camera_height = {camera_height!r} m",
            f"a height above the floor and below the ceiling ({plan.ceiling_height:g} m)",
            "Lower the camera or raise the plan's ceiling.",
        )
    if np.shape(pose) != (3,) or not np.all(np.isfinite(pose)):
        raise GalocError(f"pose {pose!r}", "three finite numbers x, y, heading (m, m, rad)", "Fix the pose.")
    left, right = azimuth_limits(camera, gravity)
    panels = visible_panels(plan, pose, left, right)
    heights = (-(plan.ceiling_height - camera_height), camera_height)
    return wireframe_of([panel.face(heights) for panel in panels], camera, gravity)[0]
