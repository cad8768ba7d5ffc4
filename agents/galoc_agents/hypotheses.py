"""The places that a belief still considers, as a few weighted poses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc.metrics import wrap_angle
from galoc_env.policy import BeliefView

Array = NDArray[np.float64]

BLOCK_M = 0.5
"""Cells of the belief within a block of this size ..."""
SECTORS = 12
"""... and one of so many sectors of heading make one hypothesis."""
LEAST_SHARE = 1e-8
"""Blocks with less than this share of the best one's mass are out."""
NEAR_M, NEAR_RAD = 0.7, math.radians(35.0)
"""Hypotheses closer than this are the same place: telling them apart is not worth a step."""


@dataclass(frozen=True, slots=True, eq=False)
class Hypotheses:
    """K weighted poses."""

    poses: Array
    """(K, 3) x, y m, heading rad; the likeliest first."""
    weights: Array
    """(K,) probabilities, summing to 1."""

    @classmethod
    def of(cls, belief: BeliefView) -> Hypotheses:
        """The blocks of a belief that hold any mass to speak of, each at its likeliest cell.

        Args:
            belief: (P, V) probabilities.
        """
        positions, p = belief.positions, belief.p
        count, v = p.shape
        sectors = math.gcd(SECTORS, v)
        by_sector = p.reshape(count, sectors, v // sectors)
        col, row = np.floor((positions - positions.min(axis=0)) / BLOCK_M).astype(np.int64).T
        block = row * (int(col.max()) + 1) + col
        key = (block[:, None] * sectors + np.arange(sectors)).ravel()
        mass = np.bincount(key, by_sector.sum(axis=2, dtype=np.float64).ravel())
        best = by_sector.max(axis=2).ravel()
        order = np.lexsort((-best, key))  # the likeliest cell of each block comes first
        first = order[np.flatnonzero(np.diff(key[order], prepend=-1))]
        first = first[mass[key[first]] > LEAST_SHARE * mass.max()]
        at, sector = np.divmod(first, sectors)
        heading = sector * (v // sectors) + by_sector[at, sector].argmax(axis=1)
        weights = mass[key[first]]
        poses = np.column_stack([positions[at], belief.headings_rad[heading]])
        return cls(poses, weights / weights.sum())

    def weighed(self, log_likelihood: Array) -> Hypotheses:
        """The same after more evidence (K,), nats."""
        weights = self.weights * np.exp(log_likelihood - log_likelihood.max())
        return Hypotheses(self.poses, weights / weights.sum())

    def tempered(self, exponent: float) -> Hypotheses:
        """The same with weights to a power."""
        weights = self.weights**exponent
        return Hypotheses(self.poses, weights / weights.sum())

    def thinned(self, most: int) -> Hypotheses:
        """At most so many of them, the likeliest first, that stand for all.

        The likely ones are kept as they are; of the others every so-many-th, in an order without system, takes over the
        weight of those in between. (Optimal in the sense of Fearnhead and Clifford, with the draws spread evenly.)
        """
        if len(self.weights) > most:
            order = np.argsort(-self.weights, kind="stable")
            tail = np.cumsum(self.weights[order][::-1])[::-1]
            # The n likeliest stay as they are where each outweighs an even share of what is left for the others.
            even = tail / np.maximum(most - np.arange(len(order)), 1)
            kept = int(np.argmax(self.weights[order] <= even))
            rest = np.random.default_rng(0).permutation(order[kept:])
            places = np.cumsum(self.weights[rest]) / even[kept]
            drawn = np.searchsorted(places, np.arange(most - kept) + 0.5).clip(max=len(rest) - 1)
            taken = np.concatenate([order[:kept], rest[drawn]])
            weights = np.concatenate([self.weights[order[:kept]], np.full(most - kept, even[kept])])
        else:
            taken, weights = np.arange(len(self.weights)), self.weights
        best = np.lexsort((-self.weights[taken], -weights))  # of equal ones that which was likeliest
        return Hypotheses(self.poses[taken[best]], weights[best] / weights.sum())

    def near(self) -> NDArray[np.bool_]:
        """(K, K) which of them are the same place."""
        apart = self.poses[:, None] - self.poses[None]
        turned = np.abs(wrap_angle(apart[..., 2]))
        return np.asarray((np.hypot(apart[..., 0], apart[..., 1]) < NEAR_M) & (turned < NEAR_RAD))

    def with_pose(self, pose: Array, weight: float) -> Hypotheses:
        """The same with one more, the first of them, of this weight beside their 1."""
        weights = np.concatenate([[weight], self.weights]) / (1.0 + weight)
        return Hypotheses(np.concatenate([pose[None], self.poses]), weights)
