"""Where walls end: what the edge columns say of a break between two boundary columns."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc.detect.columns import Columns
from galoc.detect.strip import COLUMN_GROUP, STEP_RAD

Array = NDArray[np.float64]

BREAK_COST = 0.0
"""Cost of one more wall where the edges say even odds, nats. The two unknowns of its plane should cost something; but a
peak of 0.55 is right three times in four, and that pays for them."""
MOST_COST, LEAST_COST = 6.0, 0.02
"""A break costs at most and at least this, nats: however sure the edges are, the lines must ask for a wall too."""
PEAK_LEAST = 0.15
"""An edge less probable than this gives no azimuth."""
PEAK_SD = math.radians(0.2)
"""How well a sure edge gives its azimuth, rad."""
VAGUE_SD = math.radians(0.4)
"""How well the gap between two boundary columns does, rad."""
KIND_EPS = 0.02
"""Added to both probabilities of an edge's kind, so that neither is ever nothing."""


@dataclass(frozen=True, slots=True)
class Break:
    """One break between two walls."""

    azimuth: float
    """rad."""
    sd: float
    """Its standard deviation, rad."""
    corner_logit: float
    """Log odds of a corner against an occlusion, as the edges say."""


def break_costs(columns: Columns) -> Array:
    """(C,) cost of a break before each column, nats; the first is never asked for."""
    any_edge = 1.0 - (1.0 - columns.edge[0]) * (1.0 - columns.edge[1])
    pairs = np.maximum(any_edge[0::COLUMN_GROUP], any_edge[1::COLUMN_GROUP])
    near = np.concatenate([pairs[:1], np.maximum(pairs[:-1], pairs[1:])])
    p = np.clip(near, 1e-4, 1.0 - 1e-4)
    return np.clip(BREAK_COST + np.log((1.0 - p) / p), LEAST_COST, MOST_COST)


def break_at(columns: Columns, column: int) -> Break:
    """The break before a column: at the edge's peak beside it, to a fraction of a column, else half-way."""
    azimuths, edge = columns.edge_azimuths, columns.edge
    lo, hi = COLUMN_GROUP * (column - 1), COLUMN_GROUP * (column + 1)
    corner, hidden = edge[0], edge[1]
    both = (corner[max(lo - 2, 0) : hi + 2] + hidden[max(lo - 2, 0) : hi + 2]).tolist()
    shift = lo - max(lo - 2, 0)
    top = max(range(shift, shift + hi - lo), key=lambda i: both[i])
    while 0 < top < len(both) - 1 and max(both[top - 1], both[top + 1]) > both[top]:
        top += 1 if both[top + 1] > both[top - 1] else -1
    index = max(lo - 2, 0) + top
    a, b = float(corner[max(index - 1, 0) : index + 2].max()), float(hidden[max(index - 1, 0) : index + 2].max())
    logit = math.log((a + KIND_EPS) / (b + KIND_EPS))
    if both[top] < PEAK_LEAST:
        return Break(0.5 * float(columns.azimuths[column - 1] + columns.azimuths[column]), VAGUE_SD, logit)
    offset = 0.0
    if 0 < top < len(both) - 1:
        left, middle, right = (math.log(max(p, 1e-6)) for p in both[top - 1 : top + 2])
        bend = left - 2.0 * middle + right
        offset = min(max(0.5 * (left - right) / bend, -0.5), 0.5) if bend < -1e-9 else 0.0
    share = min(both[top], 1.0)
    return Break(float(azimuths[index]) + offset * STEP_RAD, PEAK_SD + (VAGUE_SD - PEAK_SD) * (1.0 - share) ** 2, logit)
