"""The chain of plane walls that has the most evidence, by dynamic programming over azimuth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc.heights import Heights

Array = NDArray[np.float64]

STEP = math.radians(0.5)
"""Height of a row of evidence, rad of elevation."""
HIGHEST = math.radians(75.0)
"""Rows reach from this below the horizon to this above, rad."""
DISTANCES = np.geomspace(0.4, 14.0, 56)
"""Distances of walls that are tried, in units of the mean of both heights."""
GRAZING = math.cos(math.radians(82.0))
"""Walls seen at a smaller angle than this are not tried: cosine to their normal."""
RATIOS = np.linspace(-0.5, 0.5, 9)
"""log(floor / ceiling height) that are tried, beside what is known of it."""
CORNER_JUMP = 0.12
"""Walls whose log ranges differ by less than this at a shared azimuth meet in a corner."""
CORNER_COST, OCCLUSION_COST = 2.5, 4.5
"""Loss for a new wall where it meets the last one, and where it does not; half of that at an upright edge."""
OUTSIDE = 0.15
"""Evidence counted for a line that the image does not show."""


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """The best walls, column by column."""

    elevation: Array
    """(2, C) rad: of ceiling and floor line."""
    evidence: Array
    """(2, C): found for them; 0 for none or where the image ends."""
    in_frame: NDArray[np.bool_]
    """(2, C): the image shows that place."""
    wall: NDArray[np.int64]
    """(C,): number of the wall, equal for neighbours on one wall."""
    range: Array
    """(C,): its distance, in units of the mean of both heights."""


def best_chain(
    evidence: Array,
    framed: NDArray[np.bool_],
    uprights: Array,
    azimuths: Array,
    directions: Array,
    log_ratio: tuple[float, float] | None,
) -> Chain:
    """The chain of walls with the most evidence.

    Args:
        evidence: (K, R, C) of lines along each direction, rows from ``-HIGHEST`` upwards by ``STEP``.
        framed: (R, C) whether the image shows each place.
        uprights: (C,) evidence of an upright edge, 0 to 1.
        azimuths: (C,) rad.
        directions: (K,) azimuth of the walls' directions, rad.
        log_ratio: mean and standard deviation of log(floor / ceiling height); None: nothing is known.
    """
    mean, sd = log_ratio if log_ratio is not None else (Heights().k, Heights().k_sd)
    ratios = RATIOS if sd > 0.1 else np.array([mean])
    prior = -0.5 * ((ratios - mean) / max(sd, 1e-3)) ** 2
    walls = _Walls(azimuths, directions)
    counted = np.where(framed, evidence, OUTSIDE)
    best: tuple[float, float, NDArray[np.int64]] | None = None
    for ratio, log_prior in zip(ratios, prior, strict=True):
        score = walls.score(counted, float(ratio))
        total, path = walls.best_path(score, uprights)
        if best is None or total + log_prior > best[0]:
            best = total + float(log_prior), float(ratio), path
    assert best is not None
    return walls.chain(np.where(framed, evidence, 0.0), framed, best[1], best[2])


class _Walls:
    """The walls that are tried: K directions, both sides of each, and all distances; S in all."""

    def __init__(self, azimuths: Array, directions: Array) -> None:
        normals = np.concatenate([directions + 0.5 * math.pi, directions - 0.5 * math.pi])
        facing = np.cos(azimuths[None, :] - normals[:, None])
        count = len(normals)
        self._direction = np.repeat(np.tile(np.arange(len(directions)), 2), len(DISTANCES))
        distance = np.tile(DISTANCES, count)[:, None]
        facing = np.repeat(facing, len(DISTANCES), axis=0)
        self._possible = facing > GRAZING
        self._range = distance / np.where(self._possible, facing, 1.0)  # (S, C)
        self._bin = np.rint(np.log(self._range) / (0.5 * CORNER_JUMP)).astype(int)
        self._bin -= self._bin.min()
        self._columns = np.arange(len(azimuths))

    def _rows(self, ratio: float) -> tuple[Array, NDArray[np.int64]]:
        """(2, S, C) elevation of ceiling and floor line, and its row."""
        ceiling, floor = math.exp(-0.5 * ratio), math.exp(0.5 * ratio)
        elevation = np.stack([np.arctan(ceiling / self._range), -np.arctan(floor / self._range)])
        return elevation, np.rint((np.clip(elevation, -HIGHEST, HIGHEST) + HIGHEST) / STEP).astype(int)

    def score(self, counted: Array, ratio: float) -> Array:
        """(S, C) evidence of each wall at each column."""
        _, rows = self._rows(ratio)
        found = counted[self._direction[:, None], rows[0], self._columns]
        found = found + counted[self._direction[:, None], rows[1], self._columns]
        return np.where(self._possible, found, -10.0)

    def best_path(self, score: Array, uprights: Array) -> tuple[float, NDArray[np.int64]]:
        """Total and (C,) wall of the best chain (Viterbi)."""
        count, columns = score.shape
        back = np.empty((columns, count), np.int64)
        value = score[:, 0].copy()
        stay = np.arange(count)
        size = int(self._bin.max()) + 3
        for c in range(1, columns):
            ease = 1.0 - 0.5 * uprights[c]
            order = np.argsort(value, kind="stable")
            near = np.full(size, -1)
            near[self._bin[order, c - 1] + 1] = order  # the best wall of each range comes last and stays
            met = _widest(near, value)[self._bin[:, c] + 1]
            jump = value[order[-1]] - OCCLUSION_COST * ease
            corner = np.where(met >= 0, value[met], -np.inf) - CORNER_COST * ease
            back[c] = np.where(corner > jump, met, order[-1])
            change = np.maximum(corner, jump)
            back[c] = np.where(value >= change, stay, back[c])
            value = np.maximum(value, change) + score[:, c]
        path = np.empty(columns, np.int64)
        path[-1] = int(np.argmax(value))
        for c in range(columns - 1, 0, -1):
            path[c - 1] = back[c, path[c]]
        return float(value.max()), path

    def chain(self, found: Array, framed: NDArray[np.bool_], ratio: float, path: NDArray[np.int64]) -> Chain:
        """What a path of walls looks like."""
        elevation, rows = self._rows(ratio)
        here = path, self._columns
        at = [rows[row][here] for row in (0, 1)]
        evidence = np.stack([found[self._direction[path], at[row], self._columns] for row in (0, 1)])
        in_frame = np.stack([framed[at[row], self._columns] for row in (0, 1)])
        return Chain(elevation[:, path, self._columns], evidence, in_frame, path, self._range[here])


def _widest(near: NDArray[np.int64], value: Array) -> NDArray[np.int64]:
    """Best wall in each bin of range and in both beside it; -1 for none."""
    worth = np.where(near >= 0, value[near], -np.inf)
    around = np.stack([np.roll(worth, 1), worth, np.roll(worth, -1)])
    who = np.stack([np.roll(near, 1), near, np.roll(near, -1)])
    return who[around.argmax(axis=0), np.arange(len(near))]
