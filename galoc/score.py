"""How well observation rays fit a map profile: the paper's known-only cosine similarity (Sec. III-E)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc._dense_kernel import all_headings, sharpen, some_headings
from galoc._vector import LANES
from galoc.errors import GalocError
from galoc.types import Rays

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

GAMMA = 10.0
"""Sharpening exponent of the similarity (paper Eq. masked-cos)."""
CONFIDENCE_FLOOR = 0.01
"""Least weight of an observation (paper c_min)."""
SCORINGS = ("likelihood", "cosine")
"""Scorings: galoc.likelihood, and the paper's."""
MOST_RAYS = 360
"""A full turn, a degree apart."""
RANGES = (1e-9, 1e9)
"""Ranges of known rays lie between these, in whatever scale: their squares stay in float32 once they are normed."""


def confidence(rays: Rays) -> float:
    """The paper's c = (|K| / N_r)^2, floored at 0.01."""
    return max(CONFIDENCE_FLOOR, rays.coverage**2)


def checked_rays(rays: Rays) -> Rays:
    """Rays that the kernels can take.

    Raises:
        GalocError: shapes that differ, too many rays, or a known one whose range is no positive number.
    """
    known, ranges = np.asarray(rays.known), np.asarray(rays.range)
    if known.ndim != 1 or ranges.shape != known.shape or known.dtype.kind not in "bi" or ranges.dtype.kind not in "fi":
        got = f"rays with range {ranges.dtype} {ranges.shape} and known {known.dtype} {known.shape}"
        raise GalocError(got, "(n,) numbers and (n,) booleans", "Give one of each per ray.")
    if len(known) > MOST_RAYS:
        raise GalocError(f"{len(known)} rays", f"at most {MOST_RAYS}, a degree apart", "Leave out those behind.")
    known = known.astype(bool)
    if known.any() and not (ranges[known].min() >= RANGES[0] and ranges[known].max() <= RANGES[1]):  # NaN: false
        bad = int(np.flatnonzero(known)[~((ranges[known] >= RANGES[0]) & (ranges[known] <= RANGES[1]))][0])
        raise GalocError(f"range {ranges[bad]} of known ray {bad}", "a number above 0", "Set known to False there.")
    return Rays(ranges, known, rays.variance, rays.limit)


@dataclass(frozen=True, slots=True, eq=False)
class UnitRays:
    """Rays from the first known to the last, scaled to unit norm, padded to whole vectors: what kernels take."""

    seen: Array
    """(n,) float64 ranges of unit norm, 0 where unknown: sums of float32 stay well conditioned at any layout scale."""
    known: Float32
    """(n,) 0 or 1."""
    runs: NDArray[np.int64]
    """(R, 2) start and stop of each run of known rays."""
    start: int
    """Bearing of the first relative to the heading, degrees, 0..359."""
    norm: float
    """Of the ranges, in the scale of the layout."""

    @classmethod
    def of(cls, rays: Rays) -> UnitRays:
        """Those of an observation.

        Raises:
            GalocError: no known ray, or as :func:`checked_rays`.
        """
        rays = checked_rays(rays)
        if not rays.known.any():
            raise GalocError("an observation without a known ray", "at least one", "Check rays.known first: abstain.")
        edge = np.diff(np.concatenate([[0], rays.known.astype(np.int8), [0]]))
        runs = np.stack([np.flatnonzero(edge == 1), np.flatnonzero(edge == -1)], axis=1).astype(np.int64)
        first, last = int(runs[0, 0]), int(runs[-1, 1])
        ranges, known = (np.zeros(last - first + (first - last) % LANES) for _ in range(2))
        ranges[: last - first] = np.where(rays.known, rays.range, 0.0)[first:last]
        known[: last - first] = rays.known[first:last]
        norm = float(np.linalg.norm(ranges))
        start = (first - (len(rays.known) - 1) // 2) % 360
        return cls(ranges / norm, known.astype(np.float32), runs - first, start, norm)


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


def score_volume(profiles: Float32, rays: Rays, headings_deg: NDArray[np.int64] | None = None) -> Float32:
    """Similarity of every position and heading (paper Eq. masked-cos).

    Args:
        profiles: (P, 360) float32, m.
        rays: the observation; with no known ray every score is 0.
        headings_deg: (V,) whole degrees; None: 0..359.

    Returns:
        (P, V) float32 in [0, 1].

    Raises:
        GalocError: as :func:`checked_rays`.
    """
    headings = np.arange(360, dtype=np.int64) if headings_deg is None else np.asarray(headings_deg, dtype=np.int64)
    if not np.any(rays.known):
        return np.zeros((len(profiles), len(headings)), np.float32)
    unit = UnitRays.of(rays)
    seen, rows = unit.seen.astype(np.float32), np.arange(len(profiles))
    if len(headings) == 360 and np.all(np.diff(headings) == 1):
        volume = all_headings(profiles, rows, seen, (unit.start + int(headings[0])) % 360, unit.runs)
    else:
        volume = some_headings(profiles, seen, unit.known, unit.start, headings % 360)
    sharpen(volume)
    return volume
