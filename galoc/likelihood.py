"""The likelihood of an observation: robust log ranges with the scale marginalised, corner evidence, hidden walls.

The cosine weights a ray by the square of its range, and far rays are the noisiest; here every ray counts by the
variance that the layout gives it. Derivation and measurements in docs/geometry.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc._corner_kernel import CODE_DEG, corner_distances
from galoc._likelihood_kernel import TOGETHER, likelihood_volume
from galoc.corners import map_corners
from galoc.errors import GalocError
from galoc.observation import Observation, pose_variance
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
MOST_PRECISION = 1e7
"""No log range is trusted further than this, 1/variance."""


@dataclass(frozen=True, slots=True, eq=False)
class RayTerms:
    """The rays of an observation as the kernels of the likelihood take them."""

    told: NDArray[np.int64]
    """(k,) numbers of the rays scored: those that tell something, some of them passed over."""
    terms: Float32
    """(2, k) log range or its limit; precision over ``SATURATION``."""
    limited: NDArray[np.bool_]
    """(k,) the range is at most this."""
    ray_bin: NDArray[np.int64]
    """(n,) bin at heading 0 of each range, filled up to a multiple of ``TOGETHER``."""
    rays: Float32
    """(2, n) their terms, 0 where filled up."""
    limit_bin: NDArray[np.int64]
    """(m,) bin of each limit."""
    limits: Float32
    """(2, m) their terms."""
    saturation: float
    """Cost of a ray that is far off."""
    prior: float
    """Precision of the log scale."""

    @classmethod
    def of(cls, seen: Observation, step_m: float, stride: int) -> RayTerms:
        """Those of an observation.

        Args:
            seen: the observation.
            step_m: distance of the positions that it is scored at, m.
            stride: each so-many-th ray is scored where more than ``MANY_RAYS`` are told.
        """
        precision = 1.0 / (seen.variance + pose_variance(seen, step_m))
        told = np.flatnonzero(precision > 0.0)
        if len(told) <= MANY_RAYS:
            stride = 1
        elif stride > 1:  # neighbouring rays on one wall say the same
            told = told[(told - told[0]) % stride == 0]
        # Above MOST_PRECISION products of four rays would leave float32.
        pairs = [seen.log_range[told], np.minimum(precision[told], MOST_PRECISION) / SATURATION]
        terms = np.stack(pairs).astype(np.float32)
        limited = seen.is_limit[told]
        bins = (told - (len(seen.log_range) - 1) // 2) % 360
        fill = -int(np.count_nonzero(~limited)) % TOGETHER
        return cls(
            told,
            terms,
            limited,
            np.pad(bins[~limited], (0, fill)),
            np.pad(np.ascontiguousarray(terms[:, ~limited]), ((0, 0), (0, fill))),
            bins[limited],
            np.ascontiguousarray(terms[:, limited]),
            SATURATION * seen.share * stride,
            1.0 / max(seen.scale_sd, 0.01) ** 2,
        )


class Likelihood:
    """Scores observations against the profiles of one plan.

    Args:
        field: profiles of the plan.
    """

    def __init__(self, field: ProfileField) -> None:
        self.field = field
        self.corners, self._drawn_share = map_corners(field.caster.plan)
        self.forget_corners()
        self._free = field.caster.plan.free_space(0.05)
        self.corner_code: NDArray[np.uint8] = corner_distances(field.positions, field.ranges, self.corners)
        """(P, 360) angle to the nearest visible map corner, in steps of 0.05 degrees."""

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
        headings = np.arange(360, dtype=np.int64) if headings_deg is None else np.asarray(headings_deg) % 360
        return self._volume(seen, headings, 1, 0, rows)

    def cell_volume(
        self, seen: Observation, group: int, *, first_deg: int = 0, rows: NDArray[np.int64] | None = None
    ) -> Float32:
        """(P, 360 // group) log of the mean likelihood over each heading cell, up to the same constant as ``volume``.

        Args:
            seen: the observation.
            group: whole degrees per heading cell, a divisor of 360.
            first_deg: first heading of cell 0; cell v holds first_deg + v * group .. first_deg + (v + 1) * group - 1.
            rows: (R,) positions to score instead of all P.
        """
        if isinstance(group, bool) or not isinstance(group, int | np.integer) or group < 1 or 360 % group:
            raise GalocError(f"group = {group!r}", "a divisor of 360", "Use 1, 2, 3, 4, 5 or 6.")
        return self._volume(seen, np.arange(360, dtype=np.int64), int(group), int(first_deg), rows)

    def _volume(
        self, seen: Observation, headings: NDArray[np.int64], group: int, turn: int, rows: NDArray[np.int64] | None
    ) -> Float32:
        where = np.arange(len(self.field.positions)) if rows is None else np.asarray(rows, dtype=np.int64)
        return self._scores(
            seen, self.field.ranges, self.corner_code, where, headings, group, turn, self.field.resolution
        )

    def at(self, seen: Observation, positions: Array, headings_deg: NDArray[np.int64], step_m: float) -> Float32:
        """(N, V) log-likelihood at any positions and whole degrees, up to the same constant as ``volume``.

        Args:
            seen: the observation.
            positions: (N, 2) m.
            headings_deg: (V,) 0..359.
            step_m: distance of neighbouring positions, m: a pose in between is that much off.
        """
        ranges = self.field.caster(positions)
        code = corner_distances(positions, ranges, self.corners)
        headings = np.asarray(headings_deg, dtype=np.int64)
        return self._scores(seen, ranges, code, np.arange(len(positions)), headings, 1, 0, step_m)

    def _scores(
        self,
        seen: Observation,
        ranges: Float32,
        corner_code: NDArray[np.uint8],
        rows: NDArray[np.int64],
        headings: NDArray[np.int64],
        group: int,
        turn: int,
        step_m: float,
    ) -> Float32:
        rays = RayTerms.of(seen, step_m, STRIDE)
        corner_bin, corners = self._corner_terms(seen)
        return likelihood_volume(
            ranges,
            corner_code,
            rows,
            headings,
            group,
            (rays.ray_bin + turn) % 360,
            rays.rays,
            (rays.limit_bin + turn) % 360,
            rays.limits,
            (corner_bin + turn) % 360,
            corners,
            np.float32(rays.saturation),
            np.float32(rays.prior / rays.saturation),
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

    def _corner_terms(self, seen: Observation) -> tuple[NDArray[np.int64], Float32]:
        """Bins of the observed corners, and what the kernel wants of each."""
        m = seen.nodes[seen.is_corner, 0]
        bearing = np.degrees(-np.arctan(m))
        variance = np.diag(seen.covariance)[::2][seen.is_corner] / (1.0 + m**2) ** 2
        # A node (m, s) is at x = m / s, z = 1 / s.
        reach = np.sqrt(1.0 + m**2) / np.maximum(seen.nodes[seen.is_corner, 1], 1e-3)
        cell = self.field.resolution**2 / 12.0 / np.maximum(reach, 0.3) ** 2
        low = np.floor(bearing)
        most = np.full(len(m), CORNER_SATURATION * self.corner_share)
        precision = CODE_DEG**2 / (np.degrees(1.0) ** 2 * (variance + cell) + 0.1) / most
        return low.astype(np.int64), np.stack([bearing - low, precision, most]).astype(np.float32)
