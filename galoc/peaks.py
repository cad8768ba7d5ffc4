"""The SE(2) search on the 0.1 m grid: its best distinct cells, then 0.01 m x 1 degree around each."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc._peaks_kernel import first_apart, heading_peaks
from galoc.metrics import wrap_angle
from galoc.profiles import ProfileField
from galoc.score import score_volume
from galoc.types import Rays

Array = NDArray[np.float64]

FINE = 0.01
"""Final position step, m (the paper's grid)."""
APART_M = 0.45
"""Candidates closer than this in position and APART_RAD in heading are one, m."""
APART_RAD = math.radians(12.0)
"""See APART_M."""
MOST_CELLS = 20_000
"""Cells among which distinct ones are chosen."""
MIN_RANGE = 0.1
"""A refined pose keeps at least this distance to every wall, m."""


@dataclass(frozen=True, slots=True, eq=False)
class Peaks:
    """Result of a search over one observation."""

    candidates: Array
    """(C, 4): x, y (m), heading (rad), score of the best distinct poses, best first."""
    volume: NDArray[np.float32]
    """(P, 360): coarse scores at every grid position and whole degree of heading."""


def search(field: ProfileField, rays: Rays, *, count: int = 32, volume: NDArray[np.float32] | None = None) -> Peaks:
    """Best distinct poses of an observation.

    The coarse volume covers every grid position at 1 degree; each of its best distinct cells is then searched
    exhaustively within one cell at 2 cm and within 2 cm at 1 cm, over headings within +-3 degrees.

    Args:
        field: profiles of the plan.
        rays: the observation (at least one known ray).
        count: number of cells to refine.
        volume: (P, 360) scores if already computed.
    """
    volume = score_volume(field.ranges, rays) if volume is None else volume
    cells = distinct_peaks(field, volume, count)
    refined = refine(field, rays, cells)
    return Peaks(refined[np.argsort(-refined[:, 3], kind="stable")], volume)


def distinct_peaks(field: ProfileField, volume: NDArray[np.float32], count: int) -> Array:
    """(C, 4) best cells of a (P, V) volume, greedily kept apart; V headings evenly over the circle.

    Only cells that are peaks over heading are looked at: a shoulder of a peak is no place of its own.
    """
    score, heading = heading_peaks(volume)
    flat = score.ravel()
    keep = min(int(np.count_nonzero(np.isfinite(flat))), MOST_CELLS)
    best = np.argpartition(-flat, keep - 1)[:keep]
    best = best[np.lexsort((best, -flat[best]))]
    angle = wrap_angle(heading.ravel()[best] * (2 * math.pi / volume.shape[1]))
    cells = np.column_stack([field.positions[best // score.shape[1]], angle, flat[best]])
    return cells[apart(cells, count)]


def apart(poses: Array, count: int, apart_m: float = APART_M, apart_rad: float = APART_RAD) -> NDArray[np.int64]:
    """(C,) which of the poses (N, 3+), best first, are apart from every better one chosen; at most ``count``.

    Poses nearer than ``apart_m`` (m) and turned by less than ``apart_rad`` (rad) are one.
    """
    x, y, heading = np.ascontiguousarray(poses[:, :3].T)
    return np.asarray(first_apart(x, y, heading, count, apart_m, apart_rad))


def refine(field: ProfileField, rays: Rays, cells: ArrayLike) -> Array:
    """Best pose at 0.01 m x 1 degree near each coarse cell.

    Args:
        field: profiles of the plan.
        rays: the observation.
        cells: (C, 4) x, y (m), heading (rad), score.

    Returns:
        (C, 4) refined x, y, heading, score.
    """
    best = np.array(cells, dtype=np.float64).reshape(-1, 4)
    coarse = max(2 * FINE, round(field.resolution / 5.0, 3))
    for step, reach in ((coarse, field.resolution), (FINE, coarse)):
        offsets = np.arange(-round(reach / step), round(reach / step) + 1) * step
        grid = np.stack(np.meshgrid(offsets, offsets, indexing="ij"), axis=-1).reshape(-1, 2)
        positions = np.round((best[:, None, :2] + grid) / FINE) * FINE
        profiles = field.caster(positions).reshape(len(best), len(grid), -1)
        for c, near in enumerate(profiles):
            headings = round(math.degrees(best[c, 2])) + np.arange(-3, 4)
            scores = score_volume(near, rays, headings)
            scores[near.min(axis=1) < MIN_RANGE] = 0.0
            i, h = np.unravel_index(int(np.argmax(scores)), scores.shape)
            if scores[i, h] > 0.0:
                best[c] = (*positions[c, i], wrap_angle(math.radians(headings[h])), scores[i, h])
    return best
