"""SE(2) search, exact: the best poses of the 0.01 m x 1 degree lattice by branch and bound over a pyramid of boxes."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc._pyramid_kernel import LEAVES
from galoc.bound import Bound, CosineBound
from galoc.checked import number, place_inside, whole
from galoc.climb import Scored, climb
from galoc.descent import Remainder, descend
from galoc.errors import GalocError
from galoc.fine import LeafProfiles
from galoc.floorplan import Floorplan
from galoc.likelihood_bound import LikelihoodBound
from galoc.metrics import wrap_angle
from galoc.observation import Observation
from galoc.peaks import APART_M, APART_RAD, apart
from galoc.profiles import Caster
from galoc.pyramid import Pyramid, build_pyramid
from galoc.score import GAMMA
from galoc.types import Rays

Array = NDArray[np.float64]
Int = NDArray[np.int64]
Headings = NDArray[np.int16]
Float32 = NDArray[np.float32]

STEPS = (0.001, 1.0)
"""Smallest and largest step of the positions, m."""
SEEDS = 16
"""Local searches that find a good score to beat."""
LEAF_MEMORY = 1 << 30
"""Memory for profiles of leaves, bytes."""
MOST_POSES = 5_000_000
"""Most poses that are listed."""
TIES = 64
"""Poses compared in float64 to find the best one."""
DENSE_PART = 20_000
"""Positions whose headings are all listed at once."""


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Result of a search."""

    poses: Array
    """(K, 3): x, y (m), heading (rad), best first."""
    scores: Float32
    """(K,) their scores (see galoc.bound)."""
    certified: bool
    """No pose of the lattice that belongs here is missing, up to the rounding of float32."""
    gap: float
    """How much better than ``scores[0]`` a pose that was not looked at can be; 0 when certified."""
    boxes: int
    """Boxes tested."""
    scored: int
    """Poses scored."""

    def before(self, candidates: Array) -> Array:
        """(C + 1 or less, 4) x, y, heading, similarity (cosine to the power 10): this pose, then what is apart from it.

        Args:
            candidates: (C, 4) of :func:`galoc.peaks.search`.
        """
        own = np.array([[*self.poses[0], float(self.scores[0]) ** GAMMA]])
        far = np.hypot(*(candidates[:, :2] - own[0, :2]).T) >= APART_M
        far |= np.abs(wrap_angle(candidates[:, 2] - own[0, 2])) >= APART_RAD
        return np.concatenate([own, candidates[far]])


class Matcher:
    """Exact search over one plan.

    Profiles are kept between searches, so that one matcher serves one thread at a time. Give each thread its own
    ``copy.copy``: copies share the pyramids, not the profiles.

    Args:
        plan: the map.
        resolution: step of the positions, m, from 0.001 to 1.
        leaf_memory: bytes for single profiles.

    Raises:
        GalocError: no floorplan, or a number out of range.
    """

    def __init__(self, plan: Floorplan, resolution: float = 0.01, *, leaf_memory: int = LEAF_MEMORY) -> None:
        if not isinstance(plan, Floorplan):
            raise GalocError(f"a plan of type {type(plan).__name__}", "a galoc.Floorplan", "Use Floorplan.load.")
        self.plan = plan
        self.resolution = number("resolution", resolution, *STEPS, "m", "Use 0.01.")
        self._caster = Caster(plan)
        self._memory = int(number("leaf_memory", leaf_memory, 0, 1 << 50, "bytes", "Leave it out."))
        self._pyramids: dict[bool, Pyramid] = {}
        self._leaves: LeafProfiles | None = None

    def __getstate__(self) -> dict[str, Any]:
        """For copies and other processes: without the profiles, which are cast again where they are needed."""
        return self.__dict__ | {"_leaves": None}

    def pyramid(self, log: bool = False) -> Pyramid:
        """The boxes of ranges or log ranges; built, or loaded from the disk cache, when first needed."""
        if log not in self._pyramids:
            self._pyramids[log] = build_pyramid(self.plan, self.resolution, log=log)
        return self._pyramids[log]

    def _part(self, log: bool) -> tuple[Pyramid, LeafProfiles]:
        pyramid = self.pyramid(log)
        if self._leaves is None:
            self._leaves = LeafProfiles(pyramid.grid, self._caster, self._memory)
        return pyramid, self._leaves

    def _bound(self, seen: Rays | Observation | Bound) -> Bound:
        if isinstance(seen, Rays):
            return CosineBound(seen)
        if isinstance(seen, Observation):
            return LikelihoodBound(seen, self.resolution)
        if not hasattr(seen, "planes"):
            got = f"an observation of type {type(seen).__name__}"
            raise GalocError(got, "Rays, an Observation or a bound of one", "Pass the rays of Localizer.observe.")
        return seen

    def argmax(self, seen: Rays | Observation | Bound, *, seconds: float = math.inf) -> Found:
        """The best pose of the lattice.

        Args:
            seen: the observation; rays are scored by the cosine (paper), an observation by the likelihood.
            seconds: stop after about this time: what was found by then is not certified, and says how far off it can
                be. For large plans whose profiles have not been cast yet; building the pyramid does not count.
        """
        number("seconds", seconds, 0.0, math.inf, "s", "Leave it out to search to the end.")
        bound = self._bound(seen)
        pyramid, profiles = self._part(bound.log)
        end = time.monotonic() + seconds
        best = _best(climb(bound, pyramid, profiles, SEEDS), bound.tie)
        scored, gap = 0, 0.0
        left = Remainder.nothing()
        if best[2].max() < bound.most - bound.tie:  # otherwise no pose can be better
            left = descend(bound, pyramid, profiles, float(best[2].max()), limits=math.isfinite(seconds))
        for part in left.in_order():
            if time.monotonic() > end:
                gap = max(gap, part.limit - float(best[2].max()))
            elif part.limit >= best[2].max():
                for found in self._score(bound, pyramid, profiles, part, every=False):
                    best, scored = _best(_joined([best, found]), bound.tie), scored + len(found[0])
        exact = bound.exact(profiles.rows[profiles.fetch(best[0])], best[1])
        first = int(np.lexsort((best[1], best[0], -exact))[0])
        one = (best[0][first : first + 1], best[1][first : first + 1], exact[first : first + 1].astype(np.float32))
        return self._found(pyramid, one, left.boxes, scored, gap)

    def above(self, seen: Rays | Observation | Bound, score: float, *, most: int = MOST_POSES) -> Found:
        """All poses of at least this score, best first.

        Args:
            seen: the observation.
            score: threshold.
            most: poses to list at most. Where there are more, the best of them are listed, which is not certified.
        """
        score = number("score", score, -math.inf, math.inf, cure="Give the score that the poses are to reach.")
        most = whole("most", most, 1, "Ask for at least one pose.")
        bound = self._bound(seen)
        pyramid, profiles = self._part(bound.log)
        left = descend(bound, pyramid, profiles, score)
        kept, scored, cut = _joined([]), 0, False
        for found in self._score(bound, pyramid, profiles, left, every=True):
            good = found[2] >= score
            kept, scored = _joined([kept, (found[0][good], found[1][good], found[2][good])]), scored + len(found[0])
            if len(kept[0]) > most:
                kept, cut = _sorted(kept, most), True
        return self._found(pyramid, _sorted(kept, most), left.boxes, scored, math.inf if cut else 0.0)

    def topk(
        self, seen: Rays | Observation | Bound, count: int, *, apart_m: float = APART_M, apart_rad: float = APART_RAD
    ) -> Found:
        """The best distinct poses: the best one, then the best one that is apart from it, and so on.

        Args:
            seen: the observation.
            count: how many; fewer where the plan does not hold as many.
            apart_m: poses nearer than this ...
            apart_rad: ... and turned by less than this from a better one do not count.
        """
        count = whole("count", count, 1, "Ask for at least one pose.")
        apart_m = number("apart_m", apart_m, 0.0, math.inf, "m", "Leave it out.")
        apart_rad = number("apart_rad", apart_rad, 0.0, math.inf, "rad", "Leave it out.")
        bound = self._bound(seen)
        pyramid, profiles = self._part(bound.log)
        rough = _sorted(climb(bound, pyramid, profiles, max(SEEDS, 4 * count)))
        places = apart(_poses(pyramid, rough), count, apart_m, apart_rad)
        # The same pose may score a rounding less when all of its block is scored at once.
        score = float(rough[2][places].min()) - 2.0 * bound.tie
        boxes, scored = 0, 0
        while True:
            found = self.above(bound, score)
            boxes, scored = boxes + found.boxes, scored + found.scored
            chosen = apart(found.poses, count, apart_m, apart_rad)
            if len(chosen) == count or not found.certified or score <= bound.least:
                break
            # The seeds' places were apart from each other, but not all from the better ones: look lower.
            score = max(bound.least, score - max(0.5 * (float(rough[2].max()) - score), 1e-3))
        return Found(found.poses[chosen], found.scores[chosen], found.certified, found.gap, boxes, scored)

    def rank(self, seen: Rays | Observation | Bound, xy: ArrayLike) -> float:
        """Share of the positions whose best heading scores above that of (x, y), 0 (best) to 1 (paper, Sec. IV).

        Args:
            seen: the observation.
            xy: (2,) m, the truth.

        Raises:
            GalocError: no position inside the building.
        """
        place, bound = place_inside(self.plan, xy), self._bound(seen)
        pyramid, profiles = self._part(bound.log)
        truth = float(bound.dense(self._caster(place), np.zeros(1, np.int64))[0][0])
        left = descend(bound, pyramid, profiles, truth)
        better = np.zeros(len(pyramid.mask) * LEAVES, bool)
        for leaf, _, score in self._score(bound, pyramid, profiles, left, every=False):
            better[leaf[score > truth]] = True
        return float(np.count_nonzero(better)) / max(pyramid.positions, 1)

    def heat_map(self, seen: Rays | Observation | Bound, stride: int = 10) -> tuple[Array, Float32, Array]:
        """Best score over all headings on every ``stride``-th row and column of the lattice.

        Args:
            seen: the observation.
            stride: lattice steps.

        Returns:
            (P, 2) positions, m; (P,) scores; (P,) headings they are at, rad.
        """
        stride = min(whole("stride", stride, 1, "Use 10 for a map in steps of 0.1 m."), 1 << 40)
        bound = self._bound(seen)
        pyramid, profiles = self._part(bound.log)
        leaf = pyramid.leaves()
        leaf = leaf[np.all(pyramid.grid.cells(leaf) % stride == stride // 2, axis=1)]
        if len(leaf) == 0:
            raise GalocError(f"stride = {stride}", "a stride that meets a position of the plan", "Use a smaller one.")
        score, heading = np.empty(len(leaf), np.float32), np.empty(len(leaf), np.int16)
        for which, rows in profiles.batches(leaf):
            score[which], heading[which] = bound.dense(profiles.rows, rows)
        return pyramid.grid.positions(leaf), score, wrap_angle(np.radians(heading, dtype=np.float64))

    def _score(
        self, bound: Bound, pyramid: Pyramid, profiles: LeafProfiles, left: Remainder, *, every: bool
    ) -> Iterator[Scored]:
        """Scores of what the boxes left; of densely scored positions the best heading, or ``every`` one."""
        for which, rows in profiles.batches(left.leaves):
            yield left.leaves[which], left.headings[which], bound.leaves(profiles.rows, rows, left.headings[which])
        leaves = (left.blocks[:, None] * LEAVES + np.arange(LEAVES)).ravel()
        leaves = leaves[pyramid.is_clear(leaves)]
        for which, rows in profiles.batches(leaves):
            if not every:
                score, heading = bound.dense(profiles.rows, rows)
                yield leaves[which], heading, score
                continue
            for part in range(0, len(rows), DENSE_PART):
                volume = bound.volume(profiles.rows, rows[part : part + DENSE_PART])
                heading = np.tile(np.arange(360, dtype=np.int16), len(volume))
                yield np.repeat(leaves[which[part : part + DENSE_PART]], 360), heading, volume.ravel()

    def _found(self, pyramid: Pyramid, poses: Scored, boxes: int, scored: int, gap: float) -> Found:
        return Found(_poses(pyramid, poses), poses[2], gap == 0.0, gap, boxes, scored)


def _poses(pyramid: Pyramid, poses: Scored) -> Array:
    return np.column_stack([pyramid.grid.positions(poses[0]), wrap_angle(np.radians(poses[1], dtype=np.float64))])


def _joined(parts: list[Scored]) -> Scored:
    none: Scored = (np.zeros(0, np.int64), np.zeros(0, np.int16), np.zeros(0, np.float32))
    leaf, heading, score = (np.concatenate(p) for p in zip(none, *parts, strict=True))
    return leaf, heading, score


def _best(poses: Scored, tie: float) -> Scored:
    """The best pose, and those that may be it: equal up to rounding, the first ``TIES`` of them."""
    near = np.flatnonzero(poses[2] >= poses[2].max() - np.float32(tie))
    near = near[np.argsort(-poses[2][near], kind="stable")[:TIES]]
    return poses[0][near], poses[1][near], poses[2][near]


def _sorted(poses: Scored, most: int | None = None) -> Scored:
    """Best first; equal ones by place, so that the order does not depend on how they were found."""
    order = np.lexsort((poses[1], poses[0], -poses[2]))[:most]
    return poses[0][order], poses[1][order], poses[2][order]
