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
"""So many places are judged, the likeliest ones."""
LEAST_SHARE = 1e-7
"""Places with less than this share of the best one's chance are not looked at."""
DOUBT = 1e-3
"""Chance that what the cells say of a view is off the mark: so far a place counts as it did before the view."""
OPEN_SHARE = 0.05
"""Nothing is done where so much of the mass lies elsewhere."""
APART_M, APART_RAD = 0.5, math.radians(30.0)
"""Cells within this of a place's best one are that place."""
FINE_M, FINE_STEPS = (0.05, 0.025, 0.0125, 0.006), (3, 1, 1, 1)
"""A place's best pose is sought on positions so far apart, so many steps to each side of the last grid's best, ..."""
FINE_DEG = (6, 2, 2, 2)
"""... and this many whole degrees to either side. A belief's cell may be 0.2 m beside the pose that it stands for."""


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
    places = _places(belief, which, mass, mass / mass.sum() + DOUBT * before / before.sum())
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
    belief: Belief, which: NDArray[np.intp], mass: Float32, chance: Float32
) -> list[tuple[Array, NDArray[np.intp], NDArray[np.intp]]]:
    """Pose, positions (of ``which``) and heading cells of each place, the best first; none where they leave much out.

    They are found by their ``chance``, in which they keep a share of what they had: a belief that has come down to a
    cell or two per place may be so far off the grid that the true place is the one whose cells fit worst.
    """
    left, rest = chance.copy(), mass.copy()
    xy, headings = belief.positions[which], belief.headings_rad
    found: list[tuple[Array, NDArray[np.intp], NDArray[np.intp]]] = []
    first = 0.0
    while len(found) < MOST_PLACES:
        i, v = np.unravel_index(int(np.argmax(left)), left.shape)
        near = np.flatnonzero(np.hypot(*(xy - xy[i]).T) < APART_M)
        columns = np.flatnonzero(np.abs(wrap_angle(headings - headings[v])) <= APART_RAD)
        cells = np.ix_(near, columns)
        here = float(left[cells].sum())
        first = first or here
        if here < LEAST_SHARE * first:
            break
        found.append((np.array([*xy[i], headings[v]]), near, columns))
        left[cells] = rest[cells] = 0.0
    return found if float(rest.sum()) < OPEN_SHARE * float(mass.sum()) else []


def _exact(likelihood: Likelihood, seen: Observation, poses: Array) -> Array:
    """(K,) log-likelihood of the best pose around each (K, 3)."""
    middle, degree = poses[:, :2], np.round(np.degrees(poses[:, 2])).astype(np.int64)
    places = np.arange(len(poses))
    for step, count, reach in zip(FINE_M, FINE_STEPS, FINE_DEG, strict=True):
        side = step * np.arange(-count, count + 1)
        around = middle[:, None] + np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
        # All places in one go: each needs its own few headings, and is scored at those of the others as well.
        windows = (degree[:, None] + np.arange(-reach, reach + 1)) % 360
        headings, column = np.unique(windows, return_inverse=True)
        scores = likelihood.at(seen, around.reshape(-1, 2), headings, step).reshape(len(poses), around.shape[1], -1)
        own = np.take_along_axis(scores, column.reshape(windows.shape)[:, None], axis=2).reshape(len(poses), -1)
        best = own.argmax(axis=1)
        middle = around[places, best // windows.shape[1]]
        degree = windows[places, best % windows.shape[1]]
    return np.asarray(own[places, best], dtype=np.float64)
