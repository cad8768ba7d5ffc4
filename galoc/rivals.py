"""Fair play between places that look alike.

The cells of a belief stand for poses half a cell away. Two rooms of one shape do not lie equally on the grid, so a view
that fits both alike scores differently at their nearest cells, by a nat or more; the difference recurs as long as the
camera looks at the same walls, and a filter takes it for evidence. Where a belief has come down to a few places, each
is therefore judged by the best pose within its cell, off the grid.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from galoc.belief import Belief
from galoc.likelihood import Likelihood
from galoc.metrics import wrap_angle
from galoc.observation import Observation

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

MOST_PLACES = 12
"""More places than this are no short list: they are left as they are."""
LEAST_SHARE = 1e-4
"""Places with less than this share of the best one's mass are not looked at."""
OPEN_SHARE = 0.05
"""Nor is anything done where so much of the mass lies elsewhere."""
APART_M, APART_RAD = 0.5, math.radians(30.0)
"""Cells within this of a place's best one are that place."""
FINE_M, FINE_STEPS = 0.035, 2
"""Positions looked at around the best cell: a square of 2 * FINE_STEPS + 1 on a side, this far apart."""
FINE_DEG = 6
"""Whole degrees looked at to either side."""


def levelled(
    likelihood: Likelihood,
    seen: Observation,
    belief: Belief,
    found: Float32,
    rows: NDArray[np.intp] | None,
    temper: float,
) -> Float32:
    """Log-likelihoods of a belief's cells with every place judged by its best pose.

    Args:
        likelihood: of the plan.
        seen: the view.
        belief: before the view.
        found: (R, V) from :func:`galoc.cells.likely_cells`; not changed.
        rows: (R,) its positions; None for all.
        temper: weight of the view.
    """
    which = np.arange(len(belief.positions)) if rows is None else rows
    logs = temper * (found - found.max())
    before = belief.p[which]
    mass = before * np.exp(np.maximum(logs, -60.0))
    places = _places(belief, which, mass)
    if len(places) < 2:
        return found
    exact = _exact(likelihood, seen, np.array([pose for pose, _, _ in places]))
    out = found.copy()
    gap = np.empty(len(places))
    for k, (_, near, columns) in enumerate(places):
        cells = np.ix_(near, columns)
        gap[k] = exact[k] - math.log(float(mass[cells].sum()) / max(float(before[cells].sum()), 1e-300)) / temper
    gap -= gap[0]  # the rest of the map keeps its distance to the best place
    for k, (_, near, columns) in enumerate(places):
        out[np.ix_(near, columns)] += np.float32(gap[k])
    return out


def _places(
    belief: Belief, which: NDArray[np.intp], mass: Float32
) -> list[tuple[Array, NDArray[np.intp], NDArray[np.intp]]]:
    """Pose, positions (of ``which``) and heading cells of each place, the best first; none where there are many."""
    left, total = mass.copy(), float(mass.sum())
    xy, headings = belief.positions[which], belief.headings_rad
    found: list[tuple[Array, NDArray[np.intp], NDArray[np.intp]]] = []
    first = 0.0
    while len(found) <= MOST_PLACES:
        i, v = np.unravel_index(int(np.argmax(left)), left.shape)
        near = np.flatnonzero(np.hypot(*(xy - xy[i]).T) < APART_M)
        columns = np.flatnonzero(np.abs(wrap_angle(headings - headings[v])) <= APART_RAD)
        here = float(left[np.ix_(near, columns)].sum())
        first = first or here
        if here < LEAST_SHARE * first:
            break
        found.append((np.array([*xy[i], headings[v]]), near, columns))
        left[np.ix_(near, columns)] = 0.0
    return found if float(left.sum()) < OPEN_SHARE * total and len(found) <= MOST_PLACES else []


def _exact(likelihood: Likelihood, seen: Observation, poses: Array) -> Array:
    """(K,) log-likelihood of the best pose around each (K, 3)."""
    offset = FINE_M * np.arange(-FINE_STEPS, FINE_STEPS + 1)
    around = np.stack(np.meshgrid(offset, offset), axis=-1).reshape(-1, 2)
    headings = np.round(np.degrees(poses[:, 2])).astype(np.int64)[:, None] + np.arange(-FINE_DEG, FINE_DEG + 1)
    best = np.empty(len(poses))
    for k in range(len(poses)):
        best[k] = float(likelihood.at(seen, poses[k, :2] + around, headings[k] % 360, FINE_M).max())
    return best
