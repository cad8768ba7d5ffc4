"""The likelihood of an observation: robust log ranges with the scale marginalised, corner evidence, hidden walls.

The cosine weights a ray by the square of its range, and far rays are the noisiest; here every ray counts by the
variance that the layout gives it. Derivation and measurements in docs/geometry.md.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from galoc._likelihood_kernel import corner_distances, likelihood_volume
from galoc.corners import map_corners
from galoc.observation import MAP_SD_M, Observation
from galoc.profiles import ProfileField
from galoc.register import Modes, register_poses

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

SATURATION = 9.0
"""Squared whitened residual at which a ray's cost saturates (half of it is charged at that residual)."""
CORNER_SATURATION = 5.0
"""The same for an observed corner without a map corner near its bearing."""
DRAWN_WEIGHT = 20.0
"""Seen corners that outweigh what the drawing alone says of the map's corners."""
STRIDE = 3
"""Every third ray is scored where more than ``MANY_RAYS`` are told."""
MANY_RAYS = 30
"""See STRIDE."""


class Likelihood:
    """Scores observations against the profiles of one plan.

    Args:
        field: profiles of the plan.
    """

    def __init__(self, field: ProfileField) -> None:
        self.field = field
        self.log_ranges: Float32 = np.log(np.maximum(field.ranges, np.float32(0.02)))
        """(P, 360) log m."""
        self.corners, self._drawn_share = map_corners(field.caster.plan)
        self.forget_corners()
        self._free = field.caster.plan.free_space(0.05)
        self.corner_deg: Float32 = corner_distances(field.positions, field.ranges, self.corners)
        """(P, 360) degrees to the nearest visible map corner."""

    def volume(
        self,
        seen: Observation,
        headings_deg: NDArray[np.int64] | None = None,
        *,
        rows: NDArray[np.int64] | None = None,
    ) -> Float32:
        """(P, V) log-likelihood of every grid position and heading, up to a constant.

        Args:
            seen: the observation.
            headings_deg: (V,) whole degrees; None: 0..359.
            rows: (R,) positions to score instead of all P.
        """
        ranges, corner_deg = self.log_ranges, self.corner_deg
        if rows is not None:
            ranges, corner_deg = ranges[rows], corner_deg[rows]
        headings = np.arange(360, dtype=np.int64) if headings_deg is None else np.asarray(headings_deg) % 360
        precision = 1.0 / (seen.variance + self._grid_variance(seen))
        told = np.flatnonzero(precision > 0.0)
        first = int(told[0]) if len(told) else 0
        stride = STRIDE if len(told) > MANY_RAYS else 1  # neighbouring rays on one wall say the same
        keep = np.arange(first, int(told[-1]) + 1 if len(told) else 0, stride)
        precision, limited = precision[keep], seen.is_limit[keep]
        share = seen.share * stride
        corner_bin, corner_part, corner_precision = self._corner_terms(seen)
        as32 = np.float32
        return likelihood_volume(
            ranges,
            corner_deg if len(corner_bin) else corner_deg[:0],
            headings,
            first - (len(seen.log_range) - 1) // 2,
            stride,
            seen.log_range[keep].astype(as32),
            (precision / SATURATION).astype(as32),
            np.where(limited, 0.0, -1e6).astype(as32),
            (np.where(limited, 0.0, precision) * share).astype(as32),
            as32(SATURATION * share),
            corner_bin,
            corner_part.astype(as32),
            corner_precision.astype(as32),
            np.full(len(corner_bin), CORNER_SATURATION * self.corner_share, as32),
            as32(1.0 / max(seen.scale_sd, 0.01) ** 2),
        )

    def forget_corners(self) -> None:
        """Back to what the drawing alone says of how often a seen corner is one of the map."""
        self._explained = np.array([self._drawn_share * DRAWN_WEIGHT, DRAWN_WEIGHT])

    def learn_corners(self, explained: int, seen: int) -> None:
        """Count the corners of a view whose pose is sure: how many of those seen are corners of the map."""
        self._explained += (explained, seen)

    @property
    def corner_share(self) -> float:
        """How often a corner that is seen is one of the map: weighs the corner evidence."""
        share = float(self._explained[0] / self._explained[1])
        return min(max(share, 0.05), 0.95)

    def register(
        self, starts: Array, seen: Observation, *, prior_precision: Array | None = None, slack: float = 1.0
    ) -> Modes:
        """Fit (x, y, heading, scale) from start poses (C, 3+), see :func:`galoc.register.register_poses`."""
        return register_poses(
            starts, seen, self.field.caster.plan.segments, self.corners, self.corner_share,
            prior_precision=prior_precision, slack=slack, free=self._free,
        )  # fmt: skip

    def _grid_variance(self, seen: Observation) -> Array:
        """(n,) log-range variance as a cell's centre and a whole degree stand for the pose: larger where it grazes."""
        slope = np.zeros(len(seen.log_range))
        known = np.isfinite(seen.variance) & ~seen.is_limit
        if np.count_nonzero(known) > 1:
            at = np.flatnonzero(known)
            slope[at] = np.clip(np.gradient(seen.log_range[at], seen.azimuths[at]), -3.0, 3.0)
        cell = self.field.resolution**2 / 12.0
        turn = math.radians(1.0) ** 2 / 12.0
        return (cell + MAP_SD_M**2) * (1.0 + slope**2) / np.exp(2.0 * seen.log_range) + turn * slope**2

    def _corner_terms(self, seen: Observation) -> tuple[NDArray[np.int64], Array, Array]:
        m = seen.nodes[seen.is_corner, 0]
        bearing = np.degrees(-np.arctan(m))
        variance = np.diag(seen.covariance)[::2][seen.is_corner] / (1.0 + m**2) ** 2
        depth = 1.0 / np.maximum(seen.nodes[seen.is_corner, 1] * np.sqrt(1.0 + m**2), 1e-3)  # range, m
        cell = self.field.resolution**2 / 12.0 / np.maximum(depth, 0.3) ** 2
        low = np.floor(bearing)
        return (low.astype(np.int64) % 360, bearing - low, 1.0 / (np.degrees(1.0) ** 2 * (variance + cell) + 0.1))
