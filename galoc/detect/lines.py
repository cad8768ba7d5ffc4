"""A detector without weights: line segments, the directions they share, and the best chain of plane walls.

A comparator and a fallback, by textbook means. Segments that point along gravity are wall edges; the others vote for
the one or two right-angled frames of the house, and those of a frame's directions are evidence of ceiling lines (above
the horizon) and floor lines (below). Dynamic programming over azimuth then finds the chain of walls, each with a
direction and a distance, that has the most evidence for ceiling and floor line at once, for each of a few ratios of
floor to ceiling height. Furniture, doors and windows have such lines too, and it falls for them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc.camera import Camera, azimuth, levelling
from galoc.detect.chains import CORNER_JUMP, HIGHEST, STEP, Chain, best_chain
from galoc.detect.columns import Columns
from galoc.detect.pictures import checked_picture, is_blank
from galoc.detect.strip import COLUMN_GROUP, azimuth_of, column_azimuths, columns_for
from galoc.errors import GalocError
from galoc.types import Wireframe

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LinesConfig:
    """What can be set of the line detector."""

    width_px: int = 640
    """Wider images are shrunk to this before segments are sought."""
    least_px: float = 14.0
    """Shorter segments are dropped, px."""
    direction_sd: float = math.radians(2.0)
    """Segments within this of a direction, as seen, may be lines along it, rad."""
    second_frame: float = 0.5
    """A second right-angled frame is used where it has so much of the first one's length."""
    spread: float = math.radians(1.0)
    """Standard deviation by which a segment's evidence is spread over elevation, rad."""
    beyond: float = 8.0
    """Loss per radian of other segments above a ceiling line or below a floor line."""
    sigma: float = math.radians(1.5)
    """Deviation that is stated for a line with evidence, rad."""
    least_evidence: float = 0.12
    """Mean evidence per column below which the frame counts as blind."""

    def __post_init__(self) -> None:
        """Refuse what is no setting."""
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise GalocError(f"{name} = {value!r}", "a finite number above 0", "Fix LinesConfig.")


class LinesDetector:
    """A :class:`galoc.detect.Detector` made of OpenCV's line segments and dynamic programming.

    Args:
        config: what can be set.
    """

    uses_heights = True
    """``detect`` takes what is known of the heights."""

    def __init__(self, config: LinesConfig | None = None) -> None:
        self.config = config or LinesConfig()

    def detect(
        self,
        image: NDArray[np.uint8],
        camera: Camera,
        gravity: tuple[float, float],
        *,
        log_ratio: tuple[float, float] | None = None,
    ) -> Wireframe:
        """Wireframe of one image; empty where there are too few lines.

        Args:
            image: (H, W, 3) uint8 RGB.
            camera: intrinsics of the image.
            gravity: measured (roll, pitch), rad.
            log_ratio: what is known of log(floor / ceiling height) and its standard deviation; None: nothing.

        Raises:
            GalocError: bad image or gravity.
        """
        from galoc.detect.decode import decode

        columns = self.columns(image, camera, gravity, log_ratio=log_ratio)
        if not columns.visible.any():
            return Wireframe.empty()
        return decode(columns, camera, gravity, log_ratio=log_ratio)

    def columns(
        self,
        image: NDArray[np.uint8],
        camera: Camera,
        gravity: tuple[float, float],
        *,
        log_ratio: tuple[float, float] | None = None,
    ) -> Columns:
        """What the segments say column by column; nothing visible where there are too few. Arguments as ``detect``."""
        picture = checked_picture(image, camera)
        levelling(gravity)  # refuses what is no gravity
        width = columns_for(camera)
        azimuths, edges = column_azimuths(width), azimuth_of(np.arange(width), width)
        segments = _segments(picture, camera, gravity, self.config)
        frames = _frames(segments, self.config)
        if is_blank(picture) or len(frames) == 0:
            return _columns(azimuths, edges, None, self.config)
        evidence = _evidence(segments, frames, azimuths, self.config)
        framed = _in_frame(azimuths, camera, gravity)
        chain = best_chain(evidence, framed, _uprights(segments, azimuths), azimuths, _directions(frames), log_ratio)
        return _columns(azimuths, edges, chain, self.config)


@dataclass(frozen=True, slots=True, eq=False)
class Segments:
    """S straight segments in the level frame."""

    normal: Array
    """(S, 3) unit normal of the plane through camera and segment."""
    azimuth: Array
    """(S, 2) rad, of the left and right end."""
    slope: Array
    """(S, 2) tangent of the elevation of both ends."""
    length: Array
    """(S,) rad: angle that it spans."""
    upright: NDArray[np.bool_]
    """(S,) it points along gravity."""


def _segments(
    picture: NDArray[np.uint8], camera: Camera, gravity: tuple[float, float], config: LinesConfig
) -> Segments:
    """Line segments of a picture, those behind a tilted camera's horizon plane left out."""
    import cv2

    grey: Any = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    scale = min(1.0, config.width_px / camera.width)
    if scale < 1.0:
        size = round(camera.width * scale), max(1, round(camera.height * scale))
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(grey)[0]
    ends = np.zeros((0, 2, 2)) if found is None else np.asarray(found, np.float64).reshape(-1, 2, 2)
    ends = ends[np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) >= config.least_px]
    ratio = np.array([camera.width / grey.shape[1], camera.height / grey.shape[0]])
    rays = camera.rays_level((ends + 0.5) * ratio - 0.5, gravity)
    rays = rays[(rays[..., 2] > 1e-3).all(axis=1)]
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    rays = np.take_along_axis(rays, np.argsort(azimuth(rays), axis=1)[..., None], axis=1)
    cross = np.cross(rays[:, 0], rays[:, 1])
    normal = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-12)
    length = np.arccos(np.clip((rays[:, 0] * rays[:, 1]).sum(axis=1), -1.0, 1.0))
    slope = -rays[..., 1] / np.hypot(rays[..., 0], rays[..., 2])
    upright = np.abs(normal[:, 1]) < math.sin(2.0 * config.direction_sd)
    return Segments(normal, azimuth(rays), slope, length, upright)


def _frames(segments: Segments, config: LinesConfig) -> Array:
    """(0 to 2,) azimuth, rad within a right angle, of the right-angled frames that horizontal lines agree on."""
    flat = ~segments.upright
    tilt = np.hypot(segments.normal[flat, 0], segments.normal[flat, 2])
    direction = np.degrees(np.arctan2(segments.normal[flat, 2], -segments.normal[flat, 0])) % 90.0
    # A line near the horizon says little of its direction: tilt is small there.
    votes = np.bincount(direction.astype(int) % 90, segments.length[flat] * tilt, minlength=90)
    smooth = np.sum([np.roll(votes, k) * (3 - abs(k)) for k in (-2, -1, 0, 1, 2)], axis=0)
    first = int(np.argmax(smooth))
    if smooth[first] <= 0.0:
        return np.zeros(0)
    gap = np.abs((np.arange(90) - first + 45) % 90 - 45)
    others = np.where(gap > 10, smooth, 0.0)
    second = int(np.argmax(others))
    chosen = [first, second] if others[second] > config.second_frame * smooth[first] else [first]
    fine = []
    for peak in chosen:  # the mean of the votes around the peak
        off = (direction - peak - 0.5 + 45.0) % 90.0 - 45.0
        near = np.abs(off) < 3.0
        weight = segments.length[flat][near] * tilt[near]
        fine.append(peak + 0.5 + float((off[near] * weight).sum() / max(weight.sum(), 1e-12)))
    return np.radians(fine)


def _evidence(segments: Segments, frames: Array, azimuths: Array, config: LinesConfig) -> Array:
    """(directions, rows, C) evidence of a wall line along each direction (two per frame), rows by elevation upwards."""
    rows, columns = round(2 * HIGHEST / STEP) + 1, len(azimuths)
    half = 0.5 * (azimuths[1] - azimuths[0])
    normal = segments.normal
    inside = (azimuths >= segments.azimuth[:, :1] - half) & (azimuths <= segments.azimuth[:, 1:] + half)
    # The segment's plane holds the ray (sin a, -tan e, cos a).
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (normal[:, :1] * np.sin(azimuths) + normal[:, 2:] * np.cos(azimuths)) / normal[:, 1:2]
    row = np.rint((np.arctan(slope) + HIGHEST) / STEP)
    inside &= np.isfinite(row) & (row >= 0) & (row < rows) & ~segments.upright[:, None]
    weight = np.sqrt(np.minimum(1.0, segments.length / math.radians(12.0)))
    out = np.zeros((2 * len(frames), rows, columns))
    any_line = np.zeros((rows, columns))
    s, c = np.nonzero(inside)
    np.maximum.at(any_line, (row[s, c].astype(int), c), 1.0)
    for k, direction in enumerate(_directions(frames)):
        along = np.abs(normal[:, 0] * math.sin(direction) + normal[:, 2] * math.cos(direction))
        fit = weight * np.exp(-0.5 * (along / math.sin(config.direction_sd)) ** 2)
        np.maximum.at(out[k], (row[s, c].astype(int), c), fit[s])
        out[k] = _spread(out[k], config.spread / STEP)
    _subtract_beyond(out, any_line, config)
    return out


def _spread(evidence: Array, sd_rows: float) -> Array:
    """The largest of the Gaussians that stand on the rows: two lines side by side are not more of one."""
    reach = math.ceil(2.5 * sd_rows)
    padded = np.pad(evidence, ((reach, reach), (0, 0)))
    shifts = range(2 * reach + 1)
    count = len(evidence)
    return np.max([padded[k : k + count] * math.exp(-0.5 * ((k - reach) / sd_rows) ** 2) for k in shifts], axis=0)


def _subtract_beyond(evidence: Array, any_line: Array, config: LinesConfig) -> None:
    """Ceilings are empty, and floors nearly: lines farther from the horizon speak against a boundary."""
    margin = math.ceil(3.0 * config.spread / STEP)
    middle = len(any_line) // 2
    above = np.cumsum(any_line[::-1], axis=0)[::-1]
    below = np.cumsum(any_line, axis=0)
    beyond = np.zeros_like(any_line)
    beyond[middle:-margin] = above[middle + margin :]
    beyond[margin:middle] = below[: middle - margin]
    evidence -= config.beyond * STEP * np.minimum(beyond, 12.0)


def _directions(frames: Array) -> Array:
    """(2F,) azimuths of the wall directions of right-angled frames."""
    return np.stack([frames, frames + 0.5 * math.pi], axis=1).ravel()


def _uprights(segments: Segments, azimuths: Array) -> Array:
    """(C,) 0 to 1: how much of a wall edge's height the upright segments at each column cover."""
    step = azimuths[1] - azimuths[0]
    column = np.rint((segments.azimuth.mean(axis=1) - azimuths[0]) / step).astype(int)
    good = segments.upright & (column >= 0) & (column < len(azimuths))
    covered = np.bincount(column[good], segments.length[good], minlength=len(azimuths))
    wide = np.maximum(covered, np.maximum(np.roll(covered, 1), np.roll(covered, -1)))
    return np.minimum(1.0, wide / math.radians(25.0))


def _in_frame(azimuths: Array, camera: Camera, gravity: tuple[float, float]) -> NDArray[np.bool_]:
    """(rows, C) whether the image shows each place of the evidence."""
    elevation = np.arange(round(2 * HIGHEST / STEP) + 1)[:, None] * STEP - HIGHEST
    parts = np.broadcast_arrays(np.sin(azimuths), -np.tan(elevation), np.cos(azimuths))
    return camera.contains(camera.project_level(np.stack(parts, axis=-1), gravity))


def _columns(azimuths: Array, edges: Array, chain: Chain | None, config: LinesConfig) -> Columns:
    """A chain in the terms of a network; None, or too little evidence: nothing is visible."""
    count, blank = len(azimuths), np.zeros((2, len(azimuths)))
    if chain is None or chain.evidence.max(axis=0).mean() < config.least_evidence:
        wide = np.full((2, count), config.sigma)
        return Columns(azimuths, blank + [[0.5], [-0.5]], wide, blank, blank, blank, edges, np.zeros((2, len(edges))))
    strength = np.clip(chain.evidence, 0.0, 1.0)
    edge = np.full((2, len(edges)), 0.02)
    for column in np.flatnonzero(np.diff(chain.wall)):
        kind = 0 if abs(math.log(chain.range[column + 1] / chain.range[column])) < CORNER_JUMP else 1
        edge[kind, COLUMN_GROUP * column + 1 : COLUMN_GROUP * column + 3] = 0.6
    return Columns(
        azimuths,
        chain.elevation,
        np.full((2, count), config.sigma),
        0.2 + 0.6 * strength,
        (0.1 + 0.8 * strength) * chain.in_frame,
        np.where(chain.in_frame, 0.9, 0.1),
        edges,
        edge,
    )
