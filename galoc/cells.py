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


def cosine_cells(field: ProfileField, rays: Rays, belief: Belief) -> Float32:
    """(P, V) similarity at the whole degree in the middle of every cell."""
    centres = np.arange(belief.headings, dtype=np.int64) * belief.group + (belief.group - 1) // 2
    scores: Float32 = score_volume(field.ranges, rays, centres + belief.turned_deg)
    return scores


def likelihood_cells(
    likelihood: Likelihood, seen: Observation, belief: Belief, rows: NDArray[np.intp] | None = None
) -> Float32:
    """(P, V) log of the mean likelihood over the whole degrees of every cell, or (R, V) of the positions ``rows``."""
    return likelihood.cell_volume(seen, belief.group, first_deg=belief.turned_deg, rows=rows)
