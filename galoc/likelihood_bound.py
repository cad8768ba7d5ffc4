"""The log-range likelihood, as branch and bound needs it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from galoc._likelihood_bound_kernel import keep_nodes, leaf_likelihoods, scale_costs
from galoc._likelihood_kernel import likelihood_volume
from galoc.errors import GalocError
from galoc.likelihood import RayTerms
from galoc.observation import Observation
from galoc.pyramid import Float32, Headings, Int, Level, Nodes

STRIDE = 4
"""Every fourth ray is scored where more than ``MANY_RAYS`` are told: of those 8 degrees apart, two vectors."""
COST_SLACK = 2e-3
"""Added to a cost before a box is dropped: float32 sums of some 40 costs of up to 20 err by less."""
MOST_LOG = math.log(1e5)
"""No wall is seen further away than this, nor nearer than its inverse: log m."""
DENSE_PART = 20_000
"""Positions whose headings are all held at once."""


class LikelihoodBound:
    """Robust log ranges at the best scale, without corner evidence: that is for registration to judge.

    The score is that of :func:`galoc._likelihood_kernel.likelihood_volume`, a log-likelihood up to a constant. Known
    heights bound the scale through ``seen.scale_sd``.

    Args:
        seen: the observation.
        resolution: step of the positions, m.

    Raises:
        GalocError: the observation has no range and no limit, more than 360 rays, or ranges that are no lengths.
    """

    log, tie = True, 2e-4
    node_ns, leaf_ns, dense_ns, last_ns = 150.0, 120.0, 10.0, 1900.0
    most = 0.0

    def __init__(self, seen: Observation, resolution: float) -> None:
        if len(seen.log_range) > 360:
            raise GalocError(
                f"{len(seen.log_range)} rays", "at most 360, a degree apart", "Leave out those seen twice."
            )
        given = np.isfinite(seen.variance)
        if not (seen.variance >= 0.0).all() or not (np.abs(seen.log_range[given]) < MOST_LOG).all():  # NaN: false
            raise GalocError(
                "an observation with NaN or absurd ranges", "ranges in m, variances of 0 or more", "Check its rays."
            )
        rays = RayTerms.of(seen, resolution, STRIDE)
        if len(rays.told) == 0:
            raise GalocError("an observation without ranges", "at least one ray or limit", "Check seen.blind first.")
        self._ray_bin, self._rays, self._limit_bin, self._limits = rays.ray_bin, rays.rays, rays.limit_bin, rays.limits
        self._saturation, self._prior = np.float32(rays.saturation), np.float32(rays.prior)
        self._scale_precision = np.float32(rays.prior / rays.saturation)
        self._start = int(rays.told[0] - (len(seen.log_range) - 1) // 2) % 360
        self._by_8(rays.told - rays.told[0], rays.terms, rays.limited)
        self.least = -0.5 * (rays.saturation * len(rays.told) + rays.prior)

    def _by_8(self, ray: Int, terms: Float32, limited: NDArray[np.bool_]) -> None:
        """The rays by vectors of every eighth, those that tell most first."""
        vector, lane = ray % 8 + 8 * (ray // 128), ray % 128 // 8
        told = np.zeros(int(vector.max()) + 1)
        np.add.at(told, vector, terms[1])
        order = np.argsort(-told, kind="stable")
        self._which = order[: int(np.count_nonzero(told))]
        place = np.argsort(order)[vector] * 16 + lane
        parts = np.zeros((3, 16 * len(self._which)), np.float32)
        parts[0, place], parts[1, place], parts[2, place] = terms[0], terms[1], ~limited
        self._seen, self._precision, self._both = parts

    def leaves(self, profiles: Float32, rows: Int, headings: Headings) -> Float32:
        """See :class:`galoc.bound.Bound`."""
        used, place = np.unique(rows, return_inverse=True)
        return leaf_likelihoods(
            np.log(profiles[used]), place, headings, self._ray_bin, self._rays, self._limit_bin, self._limits,
            self._saturation, self._scale_precision,
        )  # fmt: skip

    def dense(self, profiles: Float32, rows: Int) -> tuple[Float32, Headings]:
        """See :class:`galoc.bound.Bound`."""
        best, heading = np.empty(len(rows), np.float32), np.empty(len(rows), np.int16)
        for part in range(0, len(rows), DENSE_PART):
            volume = self.volume(profiles, rows[part : part + DENSE_PART])
            heading[part : part + DENSE_PART] = np.argmax(volume, axis=1)
            best[part : part + DENSE_PART] = volume.max(axis=1)
        return best, heading

    def volume(self, profiles: Float32, rows: Int) -> Float32:
        """See :class:`galoc.bound.Bound`."""
        return likelihood_volume(
            profiles, _NO_CORNERS[0], rows, _HEADINGS, 1, self._ray_bin, self._rays, self._limit_bin, self._limits,
            _NO_CORNERS[1], _NO_CORNERS[2], self._saturation, self._scale_precision,
        )  # fmt: skip

    def exact(self, profiles: Float32, headings: Headings) -> NDArray[np.float64]:
        """See :class:`galoc.bound.Bound`."""
        wall, turn = np.log(profiles.astype(np.float64)), headings.astype(np.int64)[:, None]
        seen, p = self._rays.astype(np.float64)
        d = np.take_along_axis(wall, (self._ray_bin + turn) % 360, axis=1) - seen
        prior = float(self._scale_precision)
        scale = (np.clip(d, -1.0, 1.0) @ p / (p.sum() + prior))[:, None]
        ease = p / (1.0 + p * (d - scale) ** 2) ** 2
        scale = np.sum(ease * d, axis=1, keepdims=True) / (np.sum(ease, axis=1, keepdims=True) + prior)
        limit, q = self._limits.astype(np.float64)
        far = np.maximum(np.take_along_axis(wall, (self._limit_bin + turn) % 360, axis=1) - limit - scale, 0.0)
        rest, over = p * (d - scale) ** 2, q * far**2
        cost = np.sum(rest / (1.0 + rest), axis=1) + np.sum(over / (1.0 + over), axis=1) + prior * scale[:, 0] ** 2
        return np.asarray(-0.5 * float(self._saturation) * cost)

    def _limit(self, score: float) -> np.float32:
        return np.float32(max(0.0, -2.0 * score) + COST_SLACK)

    def roots(self, level: Level, score: float) -> Nodes:
        """See :class:`galoc.bound.Bound`."""
        reach = math.sqrt(float(self._limit(score)) / float(self._prior))
        nodes = level.every_node()
        scales = np.tile(np.array([[-reach, reach]], np.float32), (len(nodes), 1))
        return self.nodes(level, Nodes(nodes.cells, nodes.headings, scales), score)

    def nodes(self, level: Level, nodes: Nodes, score: float) -> Nodes:
        """See :class:`galoc.bound.Bound`."""
        keep, scales = keep_nodes(
            level.boxes, nodes.cells, nodes.headings, self._start, nodes.scales, self._which, self._seen,
            self._precision, self._both, self._saturation, self._prior, self._limit(score),
        )  # fmt: skip
        return Nodes(nodes.cells[keep], nodes.headings[keep], scales[keep])

    def limits(self, level: Level, nodes: Nodes) -> Float32:
        """See :class:`galoc.bound.Bound`."""
        costs = scale_costs(
            level.boxes, nodes.cells, nodes.headings, self._start, nodes.scales, self._which, self._seen,
            self._precision, self._both, self._saturation, self._prior,
        )  # fmt: skip
        return np.asarray(np.float32(-0.5) * (costs - np.float32(COST_SLACK)))

    def planes(self, score: float) -> None:
        """See :class:`galoc.bound.Bound`: saturating costs are no quadratic form."""
        return None


_HEADINGS = np.arange(360, dtype=np.int64)
_NO_CORNERS = (np.zeros((0, 360), np.uint8), np.zeros(0, np.int64), np.zeros((3, 0), np.float32))
