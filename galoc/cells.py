"""Scores of one frame at the cells of a belief, whose headings may lie some whole degrees beside the plan's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from galoc.belief import Belief
from galoc.likelihood import Likelihood
from galoc.observation import Observation
from galoc.profiles import ProfileField
from galoc.score import score_volume
from galoc.types import Rays

Float32 = NDArray[np.float32]

HOPELESS = -20.0
"""A position whose best heading is this much below the best pose, nats, is not scored, ..."""
LISTED_SHARE = 0.3
"""... unless more than this share of them is left, ..."""
POOR_FIT = -25.0
"""... or none of those left has this log-likelihood: then the belief is probably wrong."""


def cosine_cells(field: ProfileField, rays: Rays, belief: Belief) -> Float32:
    """(P, V) similarity at the whole degree in the middle of every cell."""
    centres = np.arange(belief.headings, dtype=np.int64) * belief.group + (belief.group - 1) // 2
    scores: Float32 = score_volume(field.ranges, rays, centres + belief.turned_deg)
    return scores


def likely_cells(
    likelihood: Likelihood, seen: Observation, belief: Belief, *, everywhere: bool = False
) -> tuple[Float32, NDArray[np.intp] | None]:
    """Log of the mean likelihood over the whole degrees of every cell, where the belief gives it a chance.

    Args:
        likelihood: of the plan.
        seen: the view.
        belief: before the view.
        everywhere: score all positions in any case.

    Returns:
        (R, V) scores and (R,) positions scored; None for all of them.
    """
    rows = None if everywhere else belief.best_rows(HOPELESS)
    if rows is not None and len(rows) > LISTED_SHARE * len(belief.positions):
        rows = None
    found = likelihood.cell_volume(seen, belief.group, first_deg=belief.turned_deg, rows=rows)
    if rows is not None and float(found.max()) < POOR_FIT:
        return likelihood.cell_volume(seen, belief.group, first_deg=belief.turned_deg), None
    return found, rows
