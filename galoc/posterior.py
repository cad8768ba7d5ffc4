"""The posterior of a single image: the modes that survive registration, and the probability that the best is right."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from galoc.likelihood import Likelihood
from galoc.observation import Observation
from galoc.peaks import distinct_peaks
from galoc.register import LOCAL_SD, Modes

Array = NDArray[np.float64]

NEAR_M = 0.5
"""A pose within this of the truth is right, m."""


def locate_modes(likelihood: Likelihood, seen: Observation, count: int) -> Modes:
    """Dense search, then registration of the best distinct cells.

    Where the image shows only walls (no node to register), the cells themselves are the modes.

    Args:
        likelihood: of the plan.
        seen: the observation.
        count: cells to register.
    """
    cells = distinct_peaks(likelihood.field, likelihood.volume(seen), count)
    if len(seen.nodes):
        modes = likelihood.register(cells, seen)
        if len(modes):
            return modes
    still = np.diag(np.square([*LOCAL_SD, max(seen.scale_sd, 0.01)]))
    return Modes(
        np.concatenate([cells[:, :3], np.zeros((len(cells), 1))], axis=1),
        np.repeat(still[None], len(cells), axis=0),
        cells[:, 3],
        np.zeros((len(cells), 2), np.int64),
    )


def probability_near(modes: Modes, xy: Array, radius_m: float = NEAR_M) -> float:
    """Posterior probability of the positions within a radius of ``xy``, each mode a Gaussian."""
    weight = np.exp(modes.log_mass - modes.log_mass.max())
    pairs = zip(modes.poses, modes.covariances, strict=True)
    inside = [_gaussian_in_disc(xy - p[:2], c[:2, :2], radius_m) for p, c in pairs]
    return float(np.clip(weight @ np.array(inside) / weight.sum(), 0.0, 1.0))


_RING = np.stack([np.cos(np.arange(16) * math.pi / 8), np.sin(np.arange(16) * math.pi / 8)], axis=1)
_RADII = np.sqrt(-2.0 * np.log1p(-(np.arange(8) + 0.5) / 8.0))
_SAMPLES = (_RADII[:, None, None] * _RING[None]).reshape(-1, 2)
"""128 equally probable points of a standard Gaussian in the plane."""


def _gaussian_in_disc(offset: Array, covariance: Array, radius: float) -> float:
    """Share of a Gaussian, centred ``offset`` away from the disc's centre, that lies in the disc."""
    value, vector = np.linalg.eigh(covariance)
    points = _SAMPLES * np.sqrt(np.maximum(value, 0.0)) @ vector.T - offset
    return float(np.mean(np.sum(points**2, axis=1) < radius**2))
