"""Where the verticals of a levelled view leave the image, and which side of that border a wall line is on."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.camera import Camera, levelling
from galoc.detect.columns import Columns
from galoc.detect.ends import LEAST_Y, End
from galoc.types import CORNER

Array = NDArray[np.float64]

FRAME_LOGIT = 4.0
"""The network's in_frame is believed to this log odds at most."""
LEAST_SHARE = 0.2
"""An outer end is not moved by what is known of a place nearer than this share to the other end."""
PUSH = 0.01
"""A junction that turns out to be inside (outside) the image is put so far inside (outside) its border, share of y."""
NUDGE = 1e-3
"""The same for a line in the columns of a wall, of which the next may be on the other side."""


def frame_borders(m: ArrayLike, camera: Camera, gravity: ArrayLike) -> Array:
    """(2, K) height over depth at which verticals leave the image above and below the horizon.

    Args:
        m: (K,) their abscissas on the level plane.
        camera: intrinsics.
        gravity: (roll, pitch) of the level frame, rad.

    Returns:
        Heights, positive; inf where the horizon itself is not on the image or no border is met.
    """
    to_camera = levelling(gravity)
    abscissa = np.asarray(m, np.float64)
    sides = np.array([
        [0.0, camera.fy, camera.cy + 0.5], [0.0, -camera.fy, camera.height - 0.5 - camera.cy],
        [camera.fx, 0.0, camera.cx + 0.5], [-camera.fx, 0.0, camera.width - 0.5 - camera.cx],
    ])  # fmt: skip
    inward = sides @ to_camera.T  # (4, xyz of the level frame): positive on the image's side of each border
    at_horizon = inward[:, 0, None] * abscissa + inward[:, 2, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        leaves = -at_horizon / inward[:, 1, None]
    out = np.stack([np.where(leaves < 0.0, -leaves, np.inf), np.where(leaves > 0.0, leaves, np.inf)]).min(axis=1)
    return np.where((at_horizon > 0.0).all(axis=0), out, np.inf)


def settle_frame(
    ends: list[tuple[End, End]],
    columns: Columns,
    borders: Array,
    bounds: NDArray[np.int64],
    camera: Camera,
    gravity: ArrayLike,
) -> None:
    """Let the network's ``in_frame`` and the fitted lines agree on which junctions are inside the image.

    Args:
        ends: of the S walls; moved across the image border where the two together say so.
        columns: behind the walls.
        borders: (2, C) :func:`frame_borders` of the columns.
        bounds: (S + 1,) first columns.
        camera: intrinsics.
        gravity: (roll, pitch) of the columns' level frame, rad.
    """
    first: list[int] = bounds.tolist()
    if len(ends) > 1:
        _settle_breaks(ends, columns.in_frame, bounds[1:-1], camera, gravity)
    _settle_outer(ends[0][0], ends[0][1], slice(first[0], first[1]), columns, borders)
    _settle_outer(ends[-1][1], ends[-1][0], slice(first[-2], first[-1]), columns, borders)


def _settle_breaks(
    ends: list[tuple[End, End]], in_frame: Array, after: NDArray[np.int64], camera: Camera, gravity: ArrayLike
) -> None:
    """Ends at the K breaks between walls, each asked in its wall's last column; shared corners in both walls'."""
    here, there = [pair[1] for pair in ends[:-1]], [pair[0] for pair in ends[1:]]
    shared = np.array([a.kind == b.kind == CORNER for a, b in zip(here, there, strict=True)])
    border = frame_borders([end.m for end in here], camera, gravity)
    before, behind = in_frame[:, after - 1], in_frame[:, after]
    both = 0.5 * (before + behind)
    for side, own in ((here, before), (there, behind)):
        y = np.array([end.y for end in side]).T
        variance = np.array([end.y_var for end in side]).T
        settled = np.where(np.isfinite(border), _settled(y, variance, np.where(shared, both, own), border, PUSH), y)
        for end, moved in zip(side, settled.T.tolist(), strict=True):
            end.y = moved


def _settle_outer(end: End, other: End, wall: slice, columns: Columns, borders: Array) -> None:
    """The same for an outer end of the first or last wall: its line is asked in all columns of the wall."""
    share = (np.tan(columns.azimuths[wall]) - other.m) / (end.m - other.m)
    for row in (0, 1):
        border = borders[row, wall]
        asked = np.isfinite(border) & (share > LEAST_SHARE)
        if not asked.any():
            continue
        y = other.y[row] + share[asked] * (end.y[row] - other.y[row])
        settled = _settled(y, np.array(end.y_var[row]), columns.in_frame[row, wall][asked], border[asked], NUDGE)
        moves = (settled - y) / share[asked]
        move = float(moves.max()) if moves.max() > 0.0 else float(moves.min())
        end.y[row] = max(end.y[row] + move, LEAST_Y)


def _settled(y: Array, variance: Array, seen: Array, border: Array, push: float) -> Array:
    """Heights over depth of lines, moved across the image border where what is known says so."""
    p = np.clip(seen, 1e-6, 1.0 - 1e-6)
    said = np.clip(np.log(p / (1.0 - p)), -FRAME_LOGIT, FRAME_LOGIT)
    inside = said + 1.7 * (border - y) / (np.sqrt(variance) + 1e-6) > 0.0  # 1.7: the normal as a logistic curve
    return np.where(inside, np.minimum(y, border * (1.0 - push)), np.maximum(y, border * (1.0 + push)))
