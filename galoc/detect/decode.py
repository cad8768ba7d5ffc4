"""From a network's columns to a wireframe: exact segmentation into plane walls, shared corners, honest deviations."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.camera import Camera
from galoc.detect._segment_kernel import cut_walls
from galoc.detect._wall_fit_kernel import fit_walls
from galoc.detect.breaks import break_costs
from galoc.detect.columns import Columns, checked_columns
from galoc.detect.ends import End, joint_factor, line_at
from galoc.detect.evidence import evidence_of
from galoc.detect.frame import settle_frame
from galoc.detect.junctions import Joiner
from galoc.heights import Heights
from galoc.types import BORDER, Wireframe
from galoc.wall_pixels import Face, azimuth_limits, wireframe_of

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class DecodeConfig:
    """What can be set of the decoder."""

    least_seen: float = 2.0
    """Columns with a visible line below which a frame counts as blind (sum of sure times visible)."""
    temper: float = 4.0
    """Neighbouring columns that count as one when walls are cut."""
    cross_sd: float = 0.3
    """Relative standard deviation of a line that is foretold from the other one alone."""
    slope_sd: float = 0.3
    """Standard deviation of such a line's slope over the abscissa, as a share of the slope where that is above 1."""
    least_support: float = 0.2
    """Mean weight of a column below which a wall is dropped."""
    least_width_rad: float = math.radians(0.8)
    """Narrower walls are dropped, rad."""
    most_sigma: float = 0.15
    """Largest deviation of a junction that is stated, as a share of the image width."""


def decode(
    columns: Columns,
    camera: Camera,
    gravity: ArrayLike,
    *,
    log_ratio: tuple[float, float] | None = None,
    config: DecodeConfig | None = None,
) -> Wireframe:
    """Wireframe of the walls that columns tell of.

    Ceiling junctions come from the ceiling's columns alone and floor junctions from the floor's, so that their errors
    are independent; ``sigma_px`` is theirs, errors shared along a wall included. Which columns are one wall is decided
    by both together.

    Args:
        columns: C columns and 2 C edge columns.
        camera: intrinsics of the image.
        gravity: (roll, pitch) that levelled the columns, rad.
        log_ratio: mean and standard deviation of log(camera's height above the floor / ceiling's above the camera);
            None: nothing is known.
        config: what can be set.

    Returns:
        The wireframe; empty where no line is seen.

    Raises:
        GalocError: columns whose parts do not fit together.
    """
    config = config or DecodeConfig()
    checked_columns(columns)
    if float((columns.sure * columns.visible).sum()) < config.least_seen:
        return replace(Wireframe.empty(), columns=columns)
    ends, lines = _walls(columns, camera, gravity, log_ratio or (Heights().k, Heights().k_sd), config)
    wireframe, owner = wireframe_of([_face(a, b) for a, b in ends], camera, gravity)
    if len(wireframe) == 0:
        return wireframe
    sigma = _sigma_px(wireframe, owner, ends, lines, camera, gravity)
    return replace(wireframe, sigma_px=np.minimum(sigma, config.most_sigma * camera.width), columns=columns)


def _walls(
    columns: Columns, camera: Camera, gravity: ArrayLike, log_ratio: tuple[float, float], config: DecodeConfig
) -> tuple[list[tuple[End, End]], Array]:
    """Both ends of each of S walls, left to right, and (S, 2, 6) their ceiling and floor lines."""
    found = evidence_of(columns, camera, gravity, log_ratio)
    bounds, belongs = cut_walls(found.m, *found.depths(), found.odds, break_costs(columns), config.temper)
    planes, lines = np.empty((len(bounds) - 1, 6)), np.empty((len(bounds) - 1, 2, 6))
    fit_walls(
        found.m, found.y, found.sd, belongs, bounds, found.heights, found.keep, config.cross_sd, config.slope_sd,
        planes, lines,
    )  # fmt: skip
    ends = Joiner(columns, bounds, planes, lines, azimuth_limits(camera, gravity)).ends()
    settle_frame(ends, columns, found.border, bounds, camera, gravity)
    sure = np.where(np.isnan(found.bound), belongs, 1.0) / (1.0 + found.odds)  # a bound tells of a wall, too
    support = np.add.reduceat(sure.max(axis=0), bounds[:-1]) / np.diff(bounds)
    kept = [
        w
        for w, (a, b) in enumerate(ends)
        if support[w] >= config.least_support and math.atan(b.m) - math.atan(a.m) >= config.least_width_rad
    ]
    return [ends[w] for w in kept], lines[kept]


def _face(left: End, right: End) -> Face:
    corners = [[[end.m, sign * end.y[row], 1.0] for end in (left, right)] for row, sign in ((0, -1.0), (1, 1.0))]
    return Face(np.array(corners), (left.kind, right.kind))


def _sigma_px(
    wireframe: Wireframe,
    owner: NDArray[np.int64],
    ends: list[tuple[End, End]],
    lines: Array,
    camera: Camera,
    gravity: ArrayLike,
) -> Array:
    """(N, 2) px: what the variances of the ends are in the image.

    A seen junction: its line's error across the line and the break's error along it. An unseen one: the break's error,
    or the line's where it leaves the image, whichever is larger, for such a pair stands for both.
    """
    pixels = np.stack([wireframe.ceiling, wireframe.floor], axis=1)
    flags = np.stack([wireframe.ceiling_true, wireframe.floor_true], axis=1)
    view = _Pixels(camera, gravity)
    deviation = np.empty((*pixels.shape[:2], 3))  # of y, of m, and the line's slope
    abscissa = view.level(pixels)[..., 0]
    for n, (face, side) in enumerate(owner.tolist()):
        end, (left, right) = ends[face][side], ends[face]
        for row in (0, 1):
            line = lines[face, row].tolist()
            variance = end.y_var[row]
            if wireframe.kind[n] == BORDER:  # it stands where the image ends, not where the wall was extended to
                variance = line_at(line, float(abscissa[n, row]))[1] * joint_factor(line, left.m, right.m)
            deviation[n, row] = math.sqrt(variance), end.m_sd, line[2]
    along_y, along_m = view.steps(pixels)
    signed = deviation[..., 2:] * np.array([[-1.0], [1.0]])
    across = np.linalg.norm(along_y, axis=2) * deviation[..., 0]
    along = np.linalg.norm(along_m + signed * along_y, axis=2) * deviation[..., 1]
    seen = np.hypot(across, along * math.sqrt(0.5))  # P and Q measure the same break
    unseen = np.linalg.norm(along_m, axis=2) * deviation[..., 1]
    return np.where(flags, seen, np.maximum(unseen, _at_cuts(wireframe, owner, ends, lines, view)))


class _Pixels:
    """Pixels of one image and places on the level plane."""

    def __init__(self, camera: Camera, gravity: ArrayLike) -> None:
        self.camera, self.gravity = camera, gravity

    def level(self, pixels: Array) -> Array:
        """(..., 2) level-plane (m, y down) of pixels."""
        rays = self.camera.rays_level(pixels, self.gravity)
        return np.asarray(rays[..., :2] / np.maximum(rays[..., 2:], 1e-3))

    def steps(self, pixels: Array) -> tuple[Array, Array]:
        """(..., 2) px per unit of y and per unit of m at pixels."""
        step = 1e-4
        level = self.level(pixels)
        base = np.concatenate([level, np.ones((*level.shape[:-1], 1))], axis=-1)
        moved = [self.camera.project_level(base + np.array(d), self.gravity) for d in ([0, step, 0], [step, 0, 0])]
        return (moved[0] - pixels) / step, (moved[1] - pixels) / step


def _at_cuts(
    wireframe: Wireframe, owner: NDArray[np.int64], ends: list[tuple[End, End]], lines: Array, view: _Pixels
) -> Array:
    """(N, 2) px: error along the image border of the wall lines that it cuts on their way to a pair; 0 where none."""
    out = np.zeros((len(wireframe), 2))
    assert wireframe.ceiling_cut is not None and wireframe.floor_cut is not None
    cuts = np.stack([wireframe.ceiling_cut, wireframe.floor_cut], axis=2)  # wall, side, row
    which = np.argwhere(np.isfinite(cuts[..., 0]))
    if len(which) == 0:
        return out
    pixels = cuts[tuple(which.T)]
    abscissa: list[float] = view.level(pixels)[:, 0].tolist()
    steps = np.stack(view.steps(pixels), axis=1).tolist()
    for n, (wall, side, row) in enumerate(which.tolist()):
        face = int(owner[int(wireframe.walls[wall, 1]), 0])
        line = lines[face, row].tolist()
        spread = math.sqrt(line_at(line, abscissa[n])[1] * joint_factor(line, ends[face][0].m, ends[face][1].m))
        (yu, yv), (mu, mv) = steps[n]
        slope = (-1.0, 1.0)[row] * line[2]
        tangent = mu + slope * yu, mv + slope * yv
        upright = -0.5 + 0.75 < pixels[n, 1] < view.camera.height - 0.5 - 0.75  # on the left or right border
        component = abs(tangent[0] if upright else tangent[1])
        area = abs(yu * tangent[1] - yv * tangent[0])
        pair = int(wireframe.walls[wall, side])
        out[pair, row] = max(out[pair, row], spread * area / max(component, 1e-6))
    return out
