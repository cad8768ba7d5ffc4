"""Registration: the best cells of a search, fitted to the map's corners and walls with the chain's own covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc._register_kernel import register_all
from galoc.freespace import FreeSpace
from galoc.metrics import wrap_angle
from galoc.observation import MAP_SD_M, Observation

Array = NDArray[np.float64]

EFFECTIVE_RAYS = 8.0
"""Weight of all rays together once the nodes have been fitted: they say little that the nodes do not."""
RAY_SATURATION = 9.0
"""Squared whitened residual at which a ray's cost saturates."""
UNSEEN_COST = 1.5
"""What a map corner costs that should be seen and is not, nats, on a map of clean corners."""
LOCAL_SD = (0.5, 0.5, 0.25)
"""Width of the cell of pose space (m, m, rad) that one start stands for: keeps the mass of a mode finite where the view
does not fix the pose."""
LEAST_CLEARANCE = 0.08
"""No camera is nearer to a wall than this, m (half the clearance of the search grid)."""
SAME_M, SAME_RAD = 0.05, math.radians(2.0)
"""Registrations that end closer than this are one, m and rad."""


@dataclass(frozen=True, slots=True, eq=False)
class Modes:
    """Local maxima of the posterior, best first."""

    poses: Array
    """(C, 4): x, y (m), heading (rad), log scale relative to the observation's."""
    covariances: Array
    """(C, 4, 4)."""
    log_mass: Array
    """(C,) log probability mass of each mode, up to a constant."""
    matched: Array
    """(C, 2): nodes on map corners, nodes that nothing in the map explains."""

    def __len__(self) -> int:
        """Number of modes."""
        return len(self.log_mass)


def register_poses(
    starts: Array,
    seen: Observation,
    segments: Array,
    corners: Array,
    corner_share: float,
    *,
    prior_precision: Array | None = None,
    slack: float = 1.0,
    map_sd: float = MAP_SD_M,
    free: FreeSpace | None = None,
) -> Modes:
    """Fit (x, y, heading, scale) from every start.

    Args:
        starts: (C, 3) x, y, heading.
        seen: the observation.
        segments: (S, 4) map walls, m.
        corners: (K, 2) map corners, m.
        corner_share: how often a seen corner is one of the map.
        prior_precision: (3, 3) information of each start as a prior on its pose; None: that of ``LOCAL_SD``.
        slack: how far a start may be off, in multiples of a 0.1 m cell.
        map_sd: accuracy of the map, m.
        free: where a camera can be; modes outside are dropped. None: anywhere.
    """
    starts = np.concatenate([starts[:, :3], np.zeros((len(starts), 1))], axis=1)
    precision = np.zeros((4, 4))
    precision[3, 3] = seen.scale_precision
    precision[:3, :3] = np.diag(1.0 / np.square(LOCAL_SD)) if prior_precision is None else prior_precision
    known = np.isfinite(seen.variance)
    reach = 30.0
    if known.any():
        reach = min(reach, 1.5 * math.exp(float(seen.log_range[known].max()) + 2.0 * min(seen.scale_sd, 0.3)) + 2.0)
    sd = np.where(known, np.sqrt(seen.variance + 0.05**2), 0.0)
    sd[1::2] = 0.0  # every second ray is enough to see what stands between nodes
    ray_weight = min(1.0, EFFECTIVE_RAYS / max(int(np.count_nonzero(sd)), 1))
    poses, covs, mass, counts = register_all(
        np.ascontiguousarray(starts), segments, corners, seen.nodes, seen.covariance, seen.is_corner, seen.side,
        precision, map_sd, corner_share, slack, reach, seen.azimuths, seen.log_range, sd,
        np.where(seen.is_limit, 0.0, -1e9), ray_weight, RAY_SATURATION, UNSEEN_COST * (corner_share - 0.4) / 0.5,
    )  # fmt: skip
    poses[:, 2] = wrap_angle(poses[:, 2])
    if free is not None:
        mass[free.clearance_at(poses[:, :2]) < LEAST_CLEARANCE] = -np.inf
    order = np.argsort(-mass, kind="stable")
    kept: list[int] = []
    for i in order:
        if not mass[i] > max(mass[order[0]] - 60.0, -1e17):
            break
        apart = np.hypot(*(poses[kept, :2] - poses[i, :2]).T) > SAME_M
        if np.all(apart | (np.abs(wrap_angle(poses[kept, 2] - poses[i, 2])) > SAME_RAD)):
            kept.append(int(i))
    return Modes(poses[kept], covs[kept], mass[kept], counts[kept])
