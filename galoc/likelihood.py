"""The likelihood of an observation: robust log ranges with the scale marginalised, corner evidence, hidden walls.

The cosine weights a ray by the square of its range, and far rays are the noisiest; here every ray counts by the
variance that the layout gives it. Derivation and measurements in docs/geometry.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc._likelihood_kernel import corner_distances, likelihood_volume
from galoc.chain import to_level
from galoc.corners import map_corners
from galoc.profiles import ProfileField
from galoc.types import BORDER, CORNER, Layout, Rays

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

EFFECTIVE_RAYS = 15.0
"""Rays of one frame that are independent: those on one wall share its two unknowns."""
SATURATION = 9.0
"""Squared whitened residual at which a ray's cost saturates (half of it is charged at that residual)."""
CORNER_SATURATION = 5.0
"""The same for an observed corner without a map corner near its bearing."""
LIMIT_SD = 0.1
"""Spread of log range with which the limit of a hidden wall holds."""
MAP_SD_M = 0.02
"""Accuracy of the map's walls, m."""


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """One image as the likelihood sees it: n rays and N chain nodes, in metres at the most likely scale."""

    log_range: Array
    """(n,) log of the range, or of its limit where only that is known; 0 where nothing is."""
    variance: Array
    """(n,) variance of log_range; inf where nothing is known."""
    is_limit: NDArray[np.bool_]
    """(n,) the range is at most this."""
    azimuths: Array
    """(n,) rad, right positive."""
    nodes: Array
    """(N, 2) of (m, s): abscissa and inverse depth (1/m) on the level plane."""
    covariance: Array
    """(2N, 2N) of the nodes."""
    is_corner: NDArray[np.bool_]
    """(N,) real wall ends, not cut by the image and not hidden by another wall."""
    side: NDArray[np.int64]
    """(N,) where a node's wall is: -1 left, 1 right, 0 both or none."""
    scale_sd: float
    """Standard deviation of the log scale."""

    @property
    def share(self) -> float:
        """Weight of one ray: the rays of a frame together count as ``EFFECTIVE_RAYS``."""
        count = np.count_nonzero(np.isfinite(self.variance))
        return min(1.0, EFFECTIVE_RAYS / max(count, 1))

    @property
    def blind(self) -> bool:
        """Whether the image says nothing at all."""
        return not np.isfinite(self.variance).any() and not self.is_corner.any()


def observation(layout: Layout, rays: Rays) -> Observation:
    """What a layout (with covariance, method "ml") and its rays say.

    Args:
        layout: from ``solve_layout(..., method="ml")``.
        rays: from :func:`galoc.rays.cast_rays` of it.
    """
    limited = np.zeros(len(rays.known), dtype=bool) if rays.limit is None else np.isfinite(rays.limit)
    limit = np.ones(len(rays.known)) if rays.limit is None else rays.limit
    log_range = np.where(rays.known, np.log(np.where(rays.known, rays.range, 1.0)), 0.0)
    log_range = np.where(limited, np.log(np.where(limited, limit, 1.0)), log_range)
    variance = np.where(rays.known, rays.variance, np.where(limited, LIMIT_SD**2, np.inf))
    azimuths = -rays.bearings_rad
    if layout.covariance is None or layout.kind is None or layout.flagged is None or len(layout.points) == 0:
        none = np.zeros(0, dtype=bool)
        return Observation(
            log_range, variance, limited, azimuths, np.zeros((0, 2)), np.zeros((0, 0)), none, none.astype(np.int64),
            layout.scale_sd,
        )  # fmt: skip
    m, s, covariance = to_level(layout.points, layout.covariance)
    nodes = np.arange(len(m))
    to_right, to_left = np.isin(nodes, layout.walls[:, 0]), np.isin(nodes, layout.walls[:, 1])
    side = to_right.astype(np.int64) - to_left.astype(np.int64)
    keep = _informative(m, s, covariance, np.asarray(layout.kind), layout.flagged, to_right | to_left)
    pick = np.repeat(2 * keep, 2) + np.tile([0, 1], len(keep))
    return Observation(
        log_range,
        variance,
        limited,
        azimuths,
        np.stack([m, s], axis=1)[keep],
        covariance[np.ix_(pick, pick)],
        (np.asarray(layout.kind) == CORNER)[keep] & ~layout.flagged[keep],
        side[keep],
        layout.scale_sd,
    )


def _informative(
    m: Array, s: Array, covariance: Array, kind: NDArray, flagged: NDArray[np.bool_], on_wall: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Nodes worth registering: their depth is known, or they are corners whose azimuth is."""
    spread = np.sqrt(np.diag(covariance))
    depth = on_wall & (spread[1::2] < 0.3 * s)
    azimuth = (kind == CORNER) & ~flagged & (spread[::2] < 0.1 * (1.0 + m**2))
    return np.flatnonzero(depth | azimuth & (kind != BORDER))


class Likelihood:
    """Scores observations against the profiles of one plan.

    Args:
        field: profiles of the plan.
    """

    def __init__(self, field: ProfileField) -> None:
        self.field = field
        self.log_ranges: Float32 = np.log(np.maximum(field.ranges, np.float32(0.02)))
        """(P, 360) log m."""
        self.corners, self.corner_share = map_corners(field.caster.plan)
        self.corner_deg: Float32 = corner_distances(field.positions, field.ranges, self.corners)
        """(P, 360) degrees to the nearest visible map corner."""

    def volume(self, seen: Observation, headings_deg: NDArray[np.int64] | None = None) -> Float32:
        """(P, V) log-likelihood of every grid position and heading, up to a constant.

        Args:
            seen: the observation.
            headings_deg: (V,) whole degrees; None: 0..359.
        """
        headings = np.arange(360, dtype=np.int64) if headings_deg is None else np.asarray(headings_deg) % 360
        step = 2 if len(seen.azimuths) > 40 else 1  # neighbouring rays say the same; the middle ray stays the middle
        precision = 1.0 / (seen.variance + self._grid_variance(seen))
        weight = np.where(seen.is_limit, 0.0, precision)
        first = ((len(seen.azimuths) - 1) // 2) % step
        keep = np.zeros(len(precision), dtype=bool)
        keep[first::step] = True
        share = seen.share * step
        corner_bin, corner_part, corner_precision = self._corner_terms(seen)
        as32 = np.float32
        return likelihood_volume(
            self.log_ranges,
            self.corner_deg if len(corner_bin) else self.corner_deg[:0],
            headings,
            seen.log_range.astype(as32),
            np.where(keep, precision / SATURATION, 0.0).astype(as32),
            np.where(seen.is_limit, 0.0, -1e6).astype(as32),
            np.where(keep, weight * share, 0.0).astype(as32),
            as32(SATURATION * share),
            corner_bin,
            corner_part.astype(as32),
            corner_precision.astype(as32),
            np.full(len(corner_bin), CORNER_SATURATION * self.corner_share, as32),
            as32(1.0 / max(seen.scale_sd, 0.01) ** 2),
        )

    def _grid_variance(self, seen: Observation) -> Array:
        """(n,) log-range variance because a cell's centre and a whole degree stand for the pose: larger where it grazes."""
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
