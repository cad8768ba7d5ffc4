"""One image as the likelihood sees it: rays with variances, limits of hidden walls, and the chain's nodes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc.chain import to_level
from galoc.score import checked_rays
from galoc.types import BORDER, CORNER, Layout, Rays

Array = NDArray[np.float64]

EFFECTIVE_RAYS = 15.0
"""Rays of one frame that are independent: those on one wall share its two unknowns."""
LIMIT_SD = 0.1
"""Spread of log range with which the limit of a hidden wall holds."""
MAP_SD_M = 0.02
"""Accuracy of the map's walls, m."""
UNKNOWN_SCALE_SD = 1.0
"""Spread of the log scale of a scale-free layout."""
PLAIN_SD = 0.05
"""Standard deviation of log range assumed for rays that come without one (the paper's layout, a laser)."""


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
    def scale_precision(self) -> float:
        """Precision with which the log scale is known beforehand, at most that of 0.3 %."""
        return 1.0 / max(self.scale_sd, 0.003) ** 2

    @property
    def share(self) -> float:
        """Weight of one ray: the rays of a frame together count as ``EFFECTIVE_RAYS``."""
        count = int(np.count_nonzero(np.isfinite(self.variance)))
        return min(1.0, EFFECTIVE_RAYS / max(count, 1))

    @property
    def blind(self) -> bool:
        """Whether the image says nothing at all."""
        return not np.isfinite(self.variance).any() and not self.is_corner.any()


def observation(layout: Layout, rays: Rays) -> Observation:
    """What a layout and its rays say; without covariance (method "paper") the rays alone.

    Args:
        layout: from :func:`galoc.solve_layout`.
        rays: from :func:`galoc.rays.cast_rays` of it.

    Raises:
        GalocError: as :func:`galoc.score.checked_rays`.
    """
    rays = checked_rays(rays)
    limited = np.zeros(len(rays.known), dtype=bool) if rays.limit is None else np.isfinite(rays.limit)
    limit = np.ones(len(rays.known)) if rays.limit is None else rays.limit
    log_range = np.where(rays.known, np.log(np.where(rays.known, rays.range, 1.0)), 0.0)
    log_range = np.where(limited, np.log(np.where(limited, limit, 1.0)), log_range)
    given = np.where(np.isnan(rays.variance), PLAIN_SD**2, rays.variance)
    variance = np.where(rays.known, given, np.where(limited, LIMIT_SD**2, np.inf))
    azimuths = -rays.bearings_rad
    if layout.covariance is None or layout.kind is None or layout.flagged is None or len(layout.points) == 0:
        none = np.zeros(0, dtype=bool)
        return Observation(
            log_range, variance, limited, azimuths, np.zeros((0, 2)), np.zeros((0, 0)), none, none.astype(np.int64),
            min(layout.scale_sd, UNKNOWN_SCALE_SD),
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


def pose_variance(seen: Observation, step_m: float) -> Array:
    """(n,) log-range variance as a cell's centre and a whole degree stand for the pose: larger where it grazes.

    Args:
        seen: the observation.
        step_m: distance of neighbouring positions, m.
    """
    slope = np.zeros(len(seen.log_range))
    at = np.flatnonzero(np.isfinite(seen.variance) & ~seen.is_limit)
    if len(at) > 1:
        slope[at] = np.clip(np.gradient(seen.log_range[at], seen.azimuths[at]), -3.0, 3.0)
    turn = math.radians(1.0) ** 2 / 12.0
    cell = step_m**2 / 12.0 + MAP_SD_M**2
    return np.asarray(cell * (1.0 + slope**2) / np.exp(2.0 * seen.log_range) + turn * slope**2)


def _informative(
    m: Array, s: Array, covariance: Array, kind: NDArray, flagged: NDArray[np.bool_], on_wall: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Nodes worth registering: their depth is known, or they are corners whose azimuth is."""
    spread = np.sqrt(np.diag(covariance))
    depth = on_wall & (spread[1::2] < 0.3 * s)
    azimuth = (kind == CORNER) & ~flagged & (spread[::2] < 0.1 * (1.0 + m**2))
    return np.flatnonzero(depth | azimuth & (kind != BORDER))
