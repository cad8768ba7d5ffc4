"""Free space of a plan: where a camera can be, and how far the nearest wall is.

Walls are drawn on a grid; every cell learns its nearest wall from a distance transform and then measures the exact
distance to that segment. Outside is what a disc can reach from beyond the walls, and what is left once wall cores
and pillars are dropped is inside.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.errors import GalocError

if TYPE_CHECKING:
    from galoc.floorplan import Floorplan

BoolArray = NDArray[np.bool_]

MAX_CELLS = 25_000_000
"""A grid that would hold more cells than this is coarsened until it does not."""
GAP_RADII = (0.0, 0.45, 0.75, 1.25)
"""Radii of the disc that finds the outside, m: a building drawn with open entrances needs a disc that does not fit."""
MIN_HULL_SHARE = 0.5
"""The smallest disc that leaves this share of the walls' convex hull inside is taken."""
SETTLED_SHARE = 0.8
"""Where none does: the smallest disc that leaves this share of the best disc's inside area."""
MIN_ROOM_CLEARANCE = 0.35
"""Half the width of the narrowest room, m."""
MIN_OPEN_SHARE = 0.05
"""A closed region is a room when this share of it is at least ``MIN_ROOM_CLEARANCE`` from any wall; below it is a wall
core (which may be wide where a chimney stands), a pillar or a shaft."""
PAD = 1.5
"""Margin around the walls while looking for the outside, m; must exceed the largest gap radius."""
_SHIFT = 8


@dataclass(frozen=True, slots=True, eq=False)
class FreeSpace:
    """Grid over the plan's bounding box. Cell (row, col) is centred at origin + (col + 0.5, row + 0.5) * resolution."""

    origin: NDArray[np.float64]
    """(2,) m: lower left corner of cell (0, 0)."""
    resolution: float
    """Cell size, m. Coarser than asked for when the grid would exceed 25 million cells."""
    clearance: NDArray[np.float32]
    """(H, W) m: distance from the cell centre to the nearest wall; 0 where not inside."""
    inside: BoolArray
    """(H, W): within the building, not in the core of a wall, and not a cell that a wall is drawn through."""

    @property
    def area(self) -> float:
        """Inside area, m2."""
        return float(np.count_nonzero(self.inside)) * self.resolution**2

    def positions(self, clearance: float) -> NDArray[np.float64]:
        """(P, 2) m: centres of the inside cells with at least this clearance (m), row by row."""
        rows, cols = np.nonzero(self.inside & (self.clearance >= clearance))
        return self.origin + (np.stack([cols, rows], axis=1) + 0.5) * self.resolution

    def index(self, xy: ArrayLike) -> NDArray[np.int64]:
        """(..., 2) row, col of the cells that hold points (..., 2); may lie outside the grid."""
        cells = np.floor((np.asarray(xy, dtype=np.float64) - self.origin) / self.resolution)
        # NaN and far-off points become an index that is surely outside instead of an undefined cast
        return np.clip(np.nan_to_num(cells, nan=-1e9), -1e9, 1e9).astype(np.int64)[..., ::-1]

    def clearance_at(self, xy: ArrayLike) -> NDArray[np.float64]:
        """Clearance (m) of the cells holding points (..., 2); 0 outside the grid or not inside."""
        cells = self.index(xy)
        row, col = cells[..., 0], cells[..., 1]
        height, width = self.clearance.shape
        ok = (row >= 0) & (row < height) & (col >= 0) & (col < width)
        found = self.clearance[np.where(ok, row, 0), np.where(ok, col, 0)].astype(np.float64)
        return np.asarray(np.where(ok, found, 0.0))

    def largest_room(self, clearance: float) -> BoolArray:
        """(H, W) mask: the largest region connected at this clearance: where an agent of that radius can roam."""
        labels, count = _components(self.inside & (self.clearance >= clearance))
        if count == 0:
            return np.zeros(self.inside.shape, dtype=np.bool_)
        sizes = np.bincount(labels.ravel(), minlength=count + 1)
        return np.asarray(labels == 1 + int(np.argmax(sizes[1:])))


def build_free_space(plan: Floorplan, resolution: float) -> FreeSpace:
    """Rasterize a plan into its free space.

    Args:
        plan: the walls; ``plan.outline``, when present, says what is inside the building.
        resolution: wanted cell size, m. Coarsened when the grid would exceed 25 million cells.

    Raises:
        GalocError: resolution not a positive finite number.
    """
    if isinstance(resolution, str | bool) or not math.isfinite(resolution) or resolution <= 0:
        raise GalocError(f"resolution = {resolution!r}", "a cell size above 0 m", "Use about 0.05 m.")
    cell, low, shape = _grid(plan.bounds, float(resolution))
    clearance, wall = _distance(plan.segments, low, cell, shape)
    if plan.outline is not None:
        outside = _outside_of_polygon(plan.outline, low, cell, shape)
    else:
        outside = _outside_by_discs(plan.segments, clearance, wall, cell)
    inside = _rooms(~(outside | wall), clearance)
    return _cropped(low, cell, clearance, inside)


def _grid(bounds: tuple[float, float, float, float], cell: float) -> tuple[float, NDArray[np.float64], tuple[int, int]]:
    """Cell size, lower left corner and (H, W) of the padded grid; corners lie on multiples of the cell size."""
    for _ in range(64):
        pad = max(PAD, 3.0 * cell)
        low = np.floor((np.array(bounds[:2]) - pad) / cell)
        high = np.ceil((np.array(bounds[2:]) + pad) / cell)
        width, height = high - low
        if width * height <= MAX_CELLS:
            break
        cell *= 1.001 * math.sqrt(width * height / MAX_CELLS)
    return cell, low * cell, (int(height), int(width))


def _to_pixels(points: NDArray[np.float64], low: NDArray[np.float64], cell: float) -> NDArray[np.int32]:
    """Points (..., 2) as OpenCV fixed-point pixels, whose centres lie at integers."""
    pixels = np.round(((points - low) / cell - 0.5) * (1 << _SHIFT))
    return np.clip(pixels, -(1 << 29), 1 << 29).astype(np.int32)  # an outline may reach far beyond the walls' grid


def _distance(
    segments: NDArray[np.float64], low: NDArray[np.float64], cell: float, shape: tuple[int, int]
) -> tuple[NDArray[np.float32], BoolArray]:
    """Distance to the nearest wall (m) and the cells that walls are drawn through."""
    import cv2

    owner = np.full(shape, -1, dtype=np.int32)
    ends = _to_pixels(segments.reshape(-1, 2, 2), low, cell)
    for number, (start, end) in enumerate(ends.tolist()):
        cv2.line(owner, start, end, number, 1, cv2.LINE_8, _SHIFT)
    wall = owner >= 0
    free = np.where(wall, 0, 1).astype(np.uint8)
    _, labels = cv2.distanceTransformWithLabels(free, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    owner_of_label = np.zeros(int(labels.max()) + 1, dtype=np.int32)
    owner_of_label[labels[wall]] = owner[wall]
    nearest = owner_of_label[labels]
    clearance = _exact_distance(segments, nearest, low, cell)
    _relax(segments, nearest, clearance, low, cell)
    return clearance, wall


def _relax(
    segments: NDArray[np.float64],
    nearest: NDArray[np.int32],
    clearance: NDArray[np.float32],
    low: NDArray[np.float64],
    cell: float,
) -> None:
    """Let every cell try its neighbours' walls, in place: mends what the raster got wrong at ties and junctions."""
    owner, distance = nearest.ravel(), clearance.ravel()
    for dy, dx in 2 * ((0, 1), (1, 0), (0, -1), (-1, 0)):
        offered = np.roll(nearest, (dy, dx), axis=(0, 1)).ravel()
        where = np.flatnonzero(offered != owner)
        rows, cols = np.divmod(where, nearest.shape[1])
        x, y = low[0] + (cols + 0.5) * cell, low[1] + (rows + 0.5) * cell
        found = _point_segment(segments[offered[where]], x, y).astype(np.float32)
        better = found < distance[where]
        owner[where[better]] = offered[where[better]]
        distance[where[better]] = found[better]


def _exact_distance(
    segments: NDArray[np.float64], nearest: NDArray[np.int32], low: NDArray[np.float64], cell: float
) -> NDArray[np.float32]:
    """Distance from every cell centre to the segment that owns it, in strips to bound memory."""
    height, width = nearest.shape
    out = np.empty((height, width), dtype=np.float32)
    x = low[0] + (np.arange(width) + 0.5) * cell
    strip = max(1, 1_000_000 // width)
    for row in range(0, height, strip):
        rows = slice(row, min(row + strip, height))
        y = low[1] + (np.arange(rows.start, rows.stop) + 0.5) * cell
        out[rows] = _point_segment(segments[nearest[rows]], x[None, :], y[:, None])
    return out


def _point_segment(
    segments: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance from points to their own segments (..., 4)."""
    x1, y1 = segments[..., 0], segments[..., 1]
    ux, uy = segments[..., 2] - x1, segments[..., 3] - y1
    px, py = x - x1, y - y1
    along = np.clip((px * ux + py * uy) / (ux * ux + uy * uy), 0.0, 1.0)
    return np.asarray(np.hypot(px - along * ux, py - along * uy))


def _components(mask: BoolArray) -> tuple[NDArray[np.int32], int]:
    """4-connected components: labels (0 = not in mask) and how many."""
    import cv2

    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=4, ltype=cv2.CV_32S)
    return np.asarray(labels, dtype=np.int32), count - 1


def _outside_of_polygon(
    outline: NDArray[np.float64], low: NDArray[np.float64], cell: float, shape: tuple[int, int]
) -> BoolArray:
    import cv2

    mask = np.zeros(shape, dtype=np.uint8)
    cv2.fillPoly(mask, [_to_pixels(outline, low, cell)], 1, cv2.LINE_8, _SHIFT)
    return mask == 0


def _outside_by_discs(
    segments: NDArray[np.float64], clearance: NDArray[np.float32], wall: BoolArray, cell: float
) -> BoolArray:
    """Cells that the smallest adequate disc can sweep from beyond the walls (see ``GAP_RADII``)."""
    from shapely import MultiPoint

    hull_cells = MultiPoint(segments.reshape(-1, 2)).convex_hull.area / cell**2
    tried: list[tuple[int, BoolArray]] = []
    for radius in GAP_RADII:
        outside = _swept(clearance, wall, radius, cell)
        area = int(np.count_nonzero(_rooms(~(outside | wall), clearance)))
        if area >= MIN_HULL_SHARE * hull_cells:
            return outside
        tried.append((area, outside))
    # a long or angular building never fills half its hull: larger discs only add corners that lie outside
    most = max(area for area, _ in tried)
    return next(outside for area, outside in tried if area >= SETTLED_SHARE * most)


def _swept(clearance: NDArray[np.float32], wall: BoolArray, radius: float, cell: float) -> BoolArray:
    """Cells covered by a disc of this radius that rolls in from the corner of the padded grid."""
    import cv2

    labels, _ = _components(~wall & (clearance > radius))
    swept = (labels == labels[0, 0]).astype(np.uint8)
    if radius == 0.0:
        return swept > 0
    open_cells = (~wall).astype(np.uint8)
    kernels = [cv2.getStructuringElement(shape, (3, 3)) for shape in (cv2.MORPH_CROSS, cv2.MORPH_RECT)]
    # alternating cross and square approximates a round reach (an octagon); never across a wall cell
    for step in range(math.ceil(radius / cell)):
        grown = cv2.dilate(swept, kernels[1 if step % 3 == 2 else 0])
        swept = np.bitwise_and(grown, open_cells, dtype=np.uint8)
    return swept > 0


def _rooms(candidates: BoolArray, clearance: NDArray[np.float32]) -> BoolArray:
    """The candidates without wall cores and pillars: closed regions that are hardly anywhere wide."""
    labels, count = _components(candidates)
    cells = np.bincount(labels.ravel(), minlength=count + 1)
    open_cells = np.bincount(labels[clearance >= MIN_ROOM_CLEARANCE], minlength=count + 1)
    keep = (open_cells > 0) & (open_cells >= MIN_OPEN_SHARE * cells)
    keep[0] = False
    return np.asarray(keep[labels])


def _cropped(low: NDArray[np.float64], cell: float, clearance: NDArray[np.float32], inside: BoolArray) -> FreeSpace:
    """Drop the padding down to one cell around the walls' bounding box, and freeze."""
    trim = max(0, int(max(PAD, 3.0 * cell) / cell) - 1)
    window = (slice(trim, inside.shape[0] - trim), slice(trim, inside.shape[1] - trim))
    kept = np.ascontiguousarray(inside[window])
    distance = np.where(kept, clearance[window], np.float32(0.0))
    origin = low + trim * cell
    for array in (kept, distance, origin):
        array.setflags(write=False)
    return FreeSpace(origin, cell, distance, kept)
