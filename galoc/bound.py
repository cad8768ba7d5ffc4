"""What branch and bound needs to know of a scoring: exact scores of poses, and which boxes cannot hold a better one."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from galoc._cosine_bound_kernel import cosine_limits, keep_nodes, leaf_cosines
from galoc._dense_kernel import all_headings, best_headings
from galoc.errors import GalocError
from galoc.planes import PlaneView
from galoc.pyramid import Float32, Headings, Int, Level, Nodes
from galoc.score import UnitRays
from galoc.types import Rays

COSINE_SLACK = 2e-6
"""Added to 1 - cos^2 before a box is dropped: float32 sums of 109 products err by less."""


class Bound(Protocol):
    """One observation under one scoring. Scores are larger the better."""

    log: bool
    """Whether profiles and boxes are of log ranges."""
    node_ns: float
    """Rough cost of testing a node, ns."""
    leaf_ns: float
    """Rough cost of scoring a pose alone, ns."""
    last_ns: float
    """Rough cost of what remains of a node of the lowest level, ns."""
    most: float
    """A score that no pose exceeds."""
    dense_ns: float
    """Rough cost of scoring a pose where all headings are, ns."""
    least: float
    """A score that every pose reaches."""
    tie: float
    """Scores closer than this are equal up to the rounding of float32; less than the slack of the bounds."""

    def dense(self, profiles: Float32, rows: Int) -> tuple[Float32, Headings]:
        """Best score over whole degrees of each of these rows of profiles (R, 360), and that heading in degrees."""

    def volume(self, profiles: Float32, rows: Int) -> Float32:
        """(P, 360) score of each of these rows at every whole degree."""

    def leaves(self, profiles: Float32, rows: Int, headings: Headings) -> Float32:
        """(N,) scores of single poses: rows of the profiles, whole degrees."""

    def exact(self, profiles: Float32, headings: Headings) -> NDArray[np.float64]:
        """(N,) scores of single poses in float64: profiles (N, 360), whole degrees."""

    def roots(self, level: Level, score: float) -> Nodes:
        """The nodes of the top level that may hold a pose of at least this score."""

    def nodes(self, level: Level, nodes: Nodes, score: float) -> Nodes:
        """Those of the nodes that may."""

    def limits(self, level: Level, nodes: Nodes) -> Float32:
        """(N,) a score that no pose of each node exceeds."""

    def planes(self, score: float) -> PlaneView | None:
        """What the plane test needs; None where it does not apply."""


class CosineBound:
    """The masked cosine (paper Eq. masked-cos, before the power of 10).

    Args:
        rays: the observation.
        scale: least and greatest length of the observation's unit in metres, where heights are known: the cosine is
            then that of the best scale within.

    Raises:
        GalocError: no known ray, too many rays, a known one without a range; bad scale.
    """

    log = False
    node_ns, leaf_ns, dense_ns, last_ns = 90.0, 80.0, 2.5, 1000.0
    least, most, tie = 0.0, 1.0, 1e-6

    def __init__(self, rays: Rays, scale: tuple[float, float] | None = None) -> None:
        if scale is not None:
            low, high = scale if isinstance(scale, tuple | list) and len(scale) == 2 else (np.nan, np.nan)
            if not (isinstance(low, float | int) and isinstance(high, float | int) and 0.0 < low <= high < np.inf):
                raise GalocError(f"scale = {scale!r}", "(least, greatest), both above 0 and finite", "Fix scale.")
        unit = UnitRays.of(rays)
        n = len(unit.seen)
        self._unit, self._known, self._runs, self._start = unit.seen, unit.known, unit.runs, unit.start
        self._seen = unit.seen.astype(np.float32)
        # The same by vectors of every eighth ray, and which of them to try first.
        ordered = np.zeros((2, -(-n // 128), 16, 8), np.float32)
        ordered.reshape(2, -1)[:, :n] = self._seen, self._known
        self._seen_by_8, self._known_by_8 = (np.ascontiguousarray(o.transpose(0, 2, 1)).ravel() for o in ordered)
        energies = np.sum(self._seen_by_8.reshape(-1, 16) ** 2, axis=1)
        self._probe = int(np.argmax(energies))
        self._probe_energy = energies[self._probe]
        # The unit observation is t times the map: t = 1 / (norm * metres per unit).
        limits = (0.0, np.inf) if scale is None else (1.0 / (unit.norm * scale[1]), 1.0 / (unit.norm * scale[0]))
        self._scale = np.array(limits, np.float32)
        self._free_scale = scale is None

    def dense(self, profiles: Float32, rows: Int) -> tuple[Float32, Headings]:
        """See :class:`Bound`."""
        if self._free_scale:
            return best_headings(profiles, rows, self._seen, self._start, self._runs)
        volume = self.volume(profiles, rows)
        heading = np.argmax(volume, axis=1)
        return volume[np.arange(len(rows)), heading], heading.astype(np.int16)

    def volume(self, profiles: Float32, rows: Int) -> Float32:
        """See :class:`Bound`."""
        if self._free_scale:
            return all_headings(profiles, rows, self._seen, self._start, self._runs)
        turns = np.arange(360, dtype=np.int16)
        flat = self.leaves(profiles, np.repeat(rows, 360), np.tile(turns, len(rows)))
        return np.asarray(flat.reshape(-1, 360))

    def leaves(self, profiles: Float32, rows: Int, headings: Headings) -> Float32:
        """See :class:`Bound`."""
        return leaf_cosines(profiles, rows, headings, self._start, self._seen, self._known, self._scale)

    def exact(self, profiles: Float32, headings: Headings) -> NDArray[np.float64]:
        """See :class:`Bound`."""
        n = len(self._seen)
        bins = (self._start + headings.astype(np.int64)[:, None] + np.arange(n)) % 360
        wall = np.take_along_axis(profiles.astype(np.float64), bins, axis=1) * self._known
        dot, energy = wall @ self._unit, np.sum(wall**2, axis=1)
        if self._free_scale:
            return np.asarray(dot / (np.sqrt(energy) + 1e-6))
        t = np.clip(dot / energy, *self._scale.astype(np.float64))
        return np.sqrt(np.maximum(0.0, 2.0 * t * dot - t * t * energy))

    def _residual(self, score: float) -> np.float32:
        # With bounds on the scale the residual can exceed 1, where the score stays 0.
        return np.float32(1.0 - score**2 + COSINE_SLACK if score > 0.0 else np.inf)

    def roots(self, level: Level, score: float) -> Nodes:
        """See :class:`Bound`."""
        return self.nodes(level, level.every_node(), score)

    def nodes(self, level: Level, nodes: Nodes, score: float) -> Nodes:
        """See :class:`Bound`."""
        keep = keep_nodes(
            level.boxes, nodes.cells, nodes.headings, self._start, self._probe, self._probe_energy,
            self._seen_by_8, self._known_by_8, self._residual(score), self._scale,
        )  # fmt: skip
        return nodes.chosen(keep)

    def limits(self, level: Level, nodes: Nodes) -> Float32:
        """See :class:`Bound`."""
        return cosine_limits(
            level.boxes, nodes.cells, nodes.headings, self._start, self._seen_by_8, self._known_by_8,
            np.float32(COSINE_SLACK),
        )  # fmt: skip

    def planes(self, score: float) -> PlaneView:
        """See :class:`Bound`."""
        known = self._known.astype(np.float64)
        return PlaneView(self._unit, known, self._start, self._scale.astype(np.float64), float(self._residual(score)))
