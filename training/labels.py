"""What the network is to say of a view: one label convention, the plan's (:mod:`galoc_env.truth`)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc import Camera
from galoc.camera import level_angles, level_directions, levelling
from galoc.detect.strip import STEP_RAD, column_azimuths, row_of, strip_pixels
from galoc_env.render import Frame
from galoc_env.scene import Scene
from galoc_env.truth import JOIN_RANGE, visible_panels
from galoc_env.truth_columns import WallChain, wall_lines
from training.views import View

Array = NDArray[np.float64]

MOST_EDGES = 32
"""Edges of a view that are kept."""
ASIDE_RAD = math.radians(0.7)
"""A boundary is looked for so far to both of its sides, rad."""
NEAR_WALL_M, NEAR_WALL_SHARE = 0.15, 0.05
"""What is within this of the wall (m, share of its distance) counts as the wall: skirtings, radiators, pictures."""
EDGE_ROWS = 9
"""Places at which an edge is looked for between ceiling and floor."""


@dataclass(frozen=True, slots=True, eq=False)
class Labels:
    """Truth for one strip with C columns of boundary angles; row 0 of pairs is the ceiling, row 1 the floor."""

    row: NDArray[np.float32]
    """(2, C) row coordinate of the boundary in the strip, also outside the image; NaN where there is no wall."""
    in_frame: NDArray[np.bool_]
    """(2, C) the boundary is inside the image."""
    visible: NDArray[np.bool_]
    """(2, C) and nothing hides it."""
    edges: NDArray[np.float32]
    """(E, 3) wall edges: column coordinate in the strip, kind (0 corner, 1 occlusion), share of it that is seen."""
    semantic: NDArray[np.uint8]
    """(ROWS // 2, C) semantic class in the image; 0 where the image does not reach."""


def label(scene: Scene, camera: Camera, view: View, frame: Frame, columns: int) -> Labels | None:
    """Labels of a view.

    Args:
        scene: the home, with shut doors as walls.
        camera: intrinsics.
        view: where the frame was taken, and what the IMU read: the strip is levelled by that.
        frame: the picture with depth and semantic.
        columns: of the strip.

    Returns:
        The labels; None when no wall is there.
    """
    reach = columns * STEP_RAD / 2.0 + math.radians(3.0)
    assert scene.sight_plan is not None
    panels = visible_panels(scene.sight_plan, view.pose, -reach, reach)
    if not panels:
        return None
    chain = WallChain(panels)
    heights = np.array([scene.plan.ceiling_height - view.height_m, -view.height_m])
    turn = levelling(view.measured) @ levelling(view.gravity).T
    azimuth, elevation, seen = wall_lines(chain, heights, column_azimuths(columns), turn)
    pixels = camera.project_level(level_directions(azimuth, elevation), view.gravity)
    there = chain.covers(azimuth)
    in_frame = camera.contains(pixels) & there
    visible = in_frame & _boundary_seen(chain, camera, view, frame, azimuth, elevation, heights[:, None])
    edges = _edges(chain, camera, view, frame, heights, turn, columns)
    row = np.where(there, row_of(seen), np.nan).astype(np.float32)
    return Labels(row, in_frame, visible, edges, _semantic(camera, view, frame, columns))


def _boundary_seen(
    chain: WallChain, camera: Camera, view: View, frame: Frame, azimuth: Array, elevation: Array, heights: Array
) -> NDArray[np.bool_]:
    """Whether wall and ceiling (floor) are both seen beside the boundary: their depths are what they should be."""
    distance = chain.range(azimuth)
    towards = np.sign(heights)
    on_wall = elevation - towards * ASIDE_RAD
    beyond = elevation + towards * ASIDE_RAD
    wall_ok = _depth_is(camera, view, frame, azimuth, on_wall, distance)
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = heights / np.tan(beyond)
    flat_ok = _depth_is(camera, view, frame, azimuth, beyond, np.where(flat > 0.0, flat, np.nan))
    return wall_ok & flat_ok


def _depth_is(
    camera: Camera, view: View, frame: Frame, azimuth: Array, elevation: Array, distance: Array
) -> NDArray[np.bool_]:
    """Whether the frame shows something at a horizontal distance (m) in a direction; False outside the image."""
    assert frame.depth is not None
    points = level_directions(azimuth, elevation) / np.cos(elevation)[..., None] * distance[..., None]
    in_camera = points @ levelling(view.gravity)
    pixels = camera.project_level(points, view.gravity)
    inside = camera.contains(pixels)
    col, row = np.rint(np.where(inside[..., None], pixels, 0.0)).astype(np.int64).reshape(-1, 2).T
    found = frame.depth[np.minimum(row, camera.height - 1), np.minimum(col, camera.width - 1)].reshape(inside.shape)
    wanted = in_camera[..., 2]
    return inside & (np.abs(found - wanted) < np.maximum(NEAR_WALL_M, NEAR_WALL_SHARE * wanted))


def _edges(
    chain: WallChain, camera: Camera, view: View, frame: Frame, heights: Array, turn: Array, columns: int
) -> NDArray[np.float32]:
    """Vertical wall edges of which some part is inside the image."""
    rows = []
    for before, after in zip(chain.panels[:-1], chain.panels[1:], strict=True):
        azimuth = float(after.azimuth[0])
        if azimuth - before.azimuth[1] > STEP_RAD:
            continue
        near = min(before.range[1], after.range[0])
        corner = abs(before.range[1] - after.range[0]) < max(JOIN_RANGE, 1e-6) * near * 5.0
        top, bottom = np.arctan2(heights, near)
        at = bottom + (top - bottom) * (np.arange(EDGE_ROWS) + 0.5) / EDGE_ROWS
        line = np.full(EDGE_ROWS, azimuth)
        inside = camera.contains(camera.project_level(level_directions(line, at), view.gravity))
        if not inside.any():
            continue
        seen = np.zeros(EDGE_ROWS, bool)
        for side, gap in ((before, -1.0), (after, 1.0)):
            where = line + gap * 0.5 * STEP_RAD
            seen |= _depth_is(camera, view, frame, where, at, np.full(EDGE_ROWS, side.range[1 if gap < 0 else 0]))
        middle = float(np.mean(at[inside]))
        az, _ = level_angles(level_directions(azimuth, middle) @ turn.T)
        column = float(az) / STEP_RAD + columns / 2.0 - 0.5
        rows.append((column, 0.0 if corner else 1.0, float(np.mean(seen[inside]))))
    rows.sort(key=lambda r: -r[2])
    kept = sorted(rows[:MOST_EDGES])
    return np.array(kept, np.float32).reshape(-1, 3)


def _semantic(camera: Camera, view: View, frame: Frame, columns: int) -> NDArray[np.uint8]:
    """The frame's classes at every second place of the strip."""
    assert frame.semantic is not None
    x, y = strip_pixels(camera, view.measured, columns)
    x, y = x[1::2, 1::2], y[1::2, 1::2]
    inside = (x >= -0.5) & (x <= camera.width - 0.5) & (y >= -0.5) & (y <= camera.height - 0.5)
    col = np.clip(np.rint(x), 0, camera.width - 1).astype(np.int64)
    row = np.clip(np.rint(y), 0, camera.height - 1).astype(np.int64)
    return np.where(inside, frame.semantic[row, col], 0).astype(np.uint8)
