"""The candidates of an estimate as distinct places, each with its share of the probability."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc.posterior import NEAR_M
from galoc.types import Estimate

APART_RAD = math.radians(20.0)
"""Headings further apart are different poses at one place."""


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Where the camera may be."""

    pose: NDArray[np.float64]
    """(3,) x, y in metres and heading in rad of the best candidate there."""
    share: float
    """0..1: probability of the candidates there among all candidates."""


def places(estimate: Estimate, most: int = 5) -> tuple[Place, ...]:
    """Candidates within 0.5 m and 20 degrees of a better one are one place with it.

    The best candidate's place comes first, the others by their share.

    Args:
        estimate: from :meth:`galoc.Localizer.locate` with scoring "likelihood", whose scores are log probabilities.
        most: places to return.
    """
    poses, score = estimate.candidates[:, :3], estimate.candidates[:, 3]
    if len(poses) == 0:
        return ()
    weight = np.exp(score - score.max())
    weight /= weight.sum()
    left, found = np.ones(len(poses), bool), []
    for k in range(len(poses)):
        if not left[k]:
            continue
        turned = np.abs(np.remainder(poses[:, 2] - poses[k, 2] + math.pi, math.tau) - math.pi)
        here = left & (np.hypot(*(poses[:, :2] - poses[k, :2]).T) <= NEAR_M) & (turned <= APART_RAD)
        here[k] = True
        found.append(Place(poses[k].copy(), float(weight[here].sum())))
        left &= ~here
    return tuple([*found[:1], *sorted(found[1:], key=lambda place: -place.share)][:most])
