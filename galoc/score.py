"""How well observation rays fit a map profile: the paper's known-only cosine similarity (Sec. III-E)."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from galoc.types import Rays

Array = NDArray[np.float64]

GAMMA = 10.0
"""Sharpening exponent of the similarity (paper Eq. masked-cos)."""
CONFIDENCE_FLOOR = 0.01
"""Least weight of an observation (paper c_min)."""
SCORINGS = ("likelihood", "cosine")
"""Scorings: galoc.likelihood, and the paper's."""


def confidence(rays: Rays) -> float:
    """The paper's c = (|K| / N_r)^2, floored at 0.01."""
    return max(CONFIDENCE_FLOOR, rays.coverage**2)


def known_runs(rays: Rays) -> NDArray[np.int64]:
    """(R, 2) start and stop of each run of consecutive known rays."""
    edge = np.diff(np.concatenate([[0], rays.known.astype(np.int8), [0]]))
    return np.stack([np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)], axis=1).astype(np.int64)


def cosine(profile: Array, rays: Rays, heading_deg: int) -> float:
    """Masked cosine similarity to the power 10 of one pose: the formula as it reads (paper Eq. masked-cos).

    Args:
        profile: (360,) ranges of the position, m.
        rays: the observation.
        heading_deg: heading in whole degrees; ray i falls into bin heading + i - (N_r - 1) / 2.
    """
    n = len(rays.known)
    bins = (heading_deg + np.arange(n) - (n - 1) // 2) % 360
    w = np.asarray(profile, dtype=np.float64)[bins[rays.known]]
    obs = rays.range[rays.known]
    similarity = (obs @ w) / (np.sqrt(obs @ obs) * np.sqrt(w @ w) + 1e-6)
    return max(0.0, float(similarity)) ** GAMMA


def score_volume(profiles: NDArray[np.float32], rays: Rays, headings_deg: NDArray[np.int64] | None = None) -> NDArray:
    """Similarity of every position and heading (paper Eq. masked-cos).

    Args:
        profiles: (P, 360) float32, m.
        rays: the observation; with no known ray every score is 0.
        headings_deg: (V,) whole degrees; None: 0..359.

    Returns:
        (P, V) float32 in [0, 1].
    """
    headings = np.arange(360, dtype=np.int64) if headings_deg is None else np.asarray(headings_deg, dtype=np.int64)
    if not rays.known.any():
        return np.zeros((len(profiles), len(headings)), np.float32)
    obs = np.where(rays.known, rays.range, 0.0)
    obs /= np.linalg.norm(obs)  # scale-free: keeps float32 sums well conditioned at any layout scale
    return _volume(profiles, obs.astype(np.float32), known_runs(rays), headings % 360)


@njit(cache=True, parallel=True, fastmath=True)
def _volume(profiles, obs, runs, headings):  # type: ignore[no-untyped-def]
    count, n = profiles.shape[0], obs.shape[0]
    out = np.empty((count, headings.shape[0]), np.float32)
    first = (n - 1) // 2
    for p in prange(count):
        # Unrolled so that the bins of one heading are contiguous: w[v + i] = profile[(v + i - first) mod 360].
        w = np.empty(360 + n, np.float32)
        for j in range(360 + n):
            w[j] = profiles[p, (j - first + 360) % 360]
        for h in range(headings.shape[0]):
            v = headings[h]
            dot = np.float32(0.0)
            energy = np.float32(0.0)
            for r in range(runs.shape[0]):
                # Slices start at 0, which frees the inner loop of index checks: 10x by vectorization.
                seen = obs[runs[r, 0] : runs[r, 1]]
                wall = w[v + runs[r, 0] : v + runs[r, 1]]
                for i in range(seen.shape[0]):
                    dot += seen[i] * wall[i]
                    energy += wall[i] * wall[i]
            s = max(np.float32(0.0), dot / (np.sqrt(energy) + np.float32(1e-6)))
            s2 = s * s
            s4 = s2 * s2
            out[p, h] = s4 * s4 * s2
    return out
