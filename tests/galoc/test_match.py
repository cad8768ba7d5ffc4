"""The exact SE(2) search against every pose of the lattice, scored in float64."""

import copy
import dataclasses
import itertools
import math
import pickle
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest
from numba import njit

from galoc import Floorplan, GalocError, Layout, Rays
from galoc.bound import CosineBound
from galoc.likelihood import MANY_RAYS, MOST_PRECISION, SATURATION
from galoc.likelihood_bound import STRIDE, LikelihoodBound
from galoc.match import APART_M, APART_RAD, Found, Matcher
from galoc.metrics import wrap_angle
from galoc.observation import Observation, observation, pose_variance
from galoc.planes import plane_leaves
from galoc.profiles import Caster
from galoc.pyramid import Nodes, build_pyramid

COSINE_TIE = 1e-6
"""Cosines closer than this are equal: float32 sums of some hundred products."""
LIKELIHOOD_TIE = 1e-5
"""Log-likelihoods near the best one (0 to -5) are sums of some 40 float32 costs."""
STEPS = {"cosine": 0.03, "likelihood": 0.05}
"""Steps of the lattices, m: coarse, so that every pose can be scored in float64."""


def walls_of(corners: list[tuple[float, float]]) -> list[list[float]]:
    return [[*a, *b] for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]


PLANS = {
    "L": Floorplan.from_segments(walls_of([(0, 0), (4, 0), (4, 2.4), (2.3, 2.4), (2.3, 4.6), (0, 4.6)]), name="L"),
    "two rooms": Floorplan.from_segments(
        [
            *walls_of([(0, 0), (5.2, 0), (5.2, 3.4), (0, 3.7)]),
            [2.51, 0.0, 2.51, 1.3], [2.51, 2.2, 2.51, 3.55], [3.6, 1.6, 4.1, 2.0],
        ],
        name="two rooms",
    ),
}  # fmt: skip


class Dense:
    """All poses of the matcher's lattice, scored by the formulas in float64."""

    def __init__(self, name: str, step: float) -> None:
        self.plan, self.step = PLANS[name], step
        self.matcher = Matcher(self.plan, step)
        pyramid = self.matcher.pyramid()
        self.leaves = pyramid.leaves()
        self.places = pyramid.grid.positions(self.leaves)
        self.profiles = Caster(self.plan)(self.places).astype(np.float64)

    def cosines(self, rays: Rays, scale: tuple[float, float] | None = None) -> np.ndarray:
        """(P, 360), as correlations over the circle (paper Eq. masked-cos without the power)."""
        n = len(rays.known)
        bins = (np.arange(n) - (n - 1) // 2) % 360
        norm = np.linalg.norm(rays.range[rays.known])
        seen, mask = np.zeros(360), np.zeros(360)
        seen[bins[rays.known]], mask[bins[rays.known]] = rays.range[rays.known] / norm, 1.0

        def correlated(a: np.ndarray, b: np.ndarray) -> np.ndarray:
            return np.fft.irfft(np.fft.rfft(a, axis=1) * np.conj(np.fft.rfft(b)), 360, axis=1)

        dot, energy = correlated(self.profiles, seen), correlated(self.profiles**2, mask)
        free = dot / (np.sqrt(energy) + 1e-6)
        if scale is None:
            return free
        t = np.clip(dot / energy, 1.0 / (norm * scale[1]), 1.0 / (norm * scale[0]))
        bounded = np.sqrt(np.maximum(0.0, 2.0 * t * dot - t * t * energy))
        return np.where(t == dot / energy, free, bounded)

    def likelihoods(self, seen: Observation) -> np.ndarray:
        """(P, 360), as galoc._likelihood_kernel.likelihood_volume states it, without corners."""
        precision = 1.0 / (seen.variance + pose_variance(seen, self.step))
        told = np.flatnonzero(precision > 0.0)
        stride = STRIDE if len(told) > MANY_RAYS else 1
        told = told[(told - told[0]) % stride == 0]
        saturation = SATURATION * seen.share * stride
        p = np.minimum(precision[told], MOST_PRECISION) / SATURATION
        prior = 1.0 / max(seen.scale_sd, 0.01) ** 2 / saturation
        bins = (told - (len(seen.variance) - 1) // 2) % 360
        out = likelihood_reference(np.log(self.profiles), bins, seen.log_range[told], p, seen.is_limit[told], prior)
        return saturation * out

    def best(self, volume: np.ndarray) -> tuple[np.ndarray, float]:
        p, v = np.unravel_index(int(np.argmax(volume)), volume.shape)
        return self.pose(p, v), float(volume[p, v])

    def pose(self, p: int, v: int) -> np.ndarray:
        return np.array([*self.places[p], wrap_angle(math.radians(v))])

    def index(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows and headings of poses in the volume; fails where one is not of the lattice."""
        grid = self.matcher.pyramid().grid
        leaves = grid.find(np.floor(poses[:, :2] / self.step).astype(np.int64))
        rows = np.searchsorted(self.leaves, leaves)
        np.testing.assert_array_equal(self.leaves[rows], leaves)
        np.testing.assert_allclose(self.places[rows], poses[:, :2], atol=1e-9)
        headings = np.round(np.degrees(poses[:, 2])).astype(int)
        np.testing.assert_allclose(np.degrees(poses[:, 2]), headings, atol=1e-9)
        return rows, headings % 360


@njit
def likelihood_reference(walls, bins, seen, p, limited, prior):  # type: ignore[no-untyped-def]
    out = np.empty(walls.shape)
    n = len(bins)
    for r in range(walls.shape[0]):
        for v in range(360):
            d = np.empty(n)
            top, low = 0.0, prior
            for i in range(n):
                d[i] = walls[r, (v + bins[i]) % 360] - seen[i]
                if not limited[i]:
                    top += p[i] * min(1.0, max(-1.0, d[i]))
                    low += p[i]
            s = top / low
            top, low = 0.0, prior
            for i in range(n):
                if not limited[i]:
                    ease = p[i] / (1.0 + p[i] * (d[i] - s) ** 2) ** 2
                    top += ease * d[i]
                    low += ease
            s = top / low
            cost = prior * s * s
            for i in range(n):
                e = max(d[i] - s, 0.0) if limited[i] else d[i] - s
                cost += p[i] * e * e / (1.0 + p[i] * e * e)
            out[r, v] = -0.5 * cost
    return out


def look(dense: Dense, seed: int, hfov: int, *, arcs: bool, noise: float, limits: bool = False) -> tuple[Rays, list]:
    """What a camera at a random place sees, in a unit of its own, and where it stands."""
    rng = np.random.default_rng([seed, hfov])
    n = 2 * (hfov // 2) + 1
    inside = dense.places[rng.integers(len(dense.places))] + rng.uniform(-0.5, 0.5, 2) * dense.step
    heading = int(rng.integers(360))
    truth = dense.matcher._caster(inside)[0][(heading + np.arange(n) - (n - 1) // 2) % 360].astype(np.float64)
    known = np.ones(n, bool)
    if arcs:
        for _ in range(2):
            start = rng.integers(0, n - 8)
            known[start : start + rng.integers(4, n // 4)] = False
    unit = 1.0 if limits else math.exp(rng.normal())
    seen = unit * truth * np.exp(noise * rng.standard_normal(n))
    limit = np.where(~known & limits, seen * 1.05, np.nan)
    variance = np.where(known, max(noise, 0.01) ** 2, np.nan)
    return Rays(np.where(known, seen, np.nan), known, variance, limit), [*inside, math.radians(heading), unit]


def told(rays: Rays, scale_sd: float = 1.0) -> Observation:
    return dataclasses.replace(observation(Layout.unknown("ml"), rays), scale_sd=scale_sd)


@pytest.fixture(scope="module")
def rooms() -> dict[tuple[str, str], Dense]:
    return {(name, scoring): Dense(name, STEPS[scoring]) for name in PLANS for scoring in STEPS}


def check_best(dense: Dense, found: Found, volume: np.ndarray, tie: float) -> None:
    assert found.certified and found.gap == 0.0 and len(found.poses) == 1
    pose, score = dense.best(volume)
    (row,), (heading,) = dense.index(found.poses)
    assert np.array_equal(found.poses[0], pose) or volume[row, heading] >= score - tie
    assert abs(found.scores[0] - volume[row, heading]) <= 2 * tie


VIEWS = list(itertools.product(PLANS, (80, 108, 170), (False, True), (0.0, 0.05)))
"""Plan, horizontal field of view (170 degrees: more than 128 rays), unknown arcs, noise of log range."""


@pytest.mark.parametrize(("plan", "hfov", "arcs", "noise"), VIEWS)
def test_argmax_is_the_best_of_all_poses(plan: str, hfov: int, arcs: bool, noise: float, rooms: dict) -> None:
    dense = rooms[plan, "cosine"]
    rays, _ = look(dense, 1, hfov, arcs=arcs, noise=noise)
    check_best(dense, dense.matcher.argmax(rays), dense.cosines(rays), COSINE_TIE)


@pytest.mark.parametrize(("width", "off"), [(0.0, 0.0), (0.05, 0.0), (0.3, 0.2), (0.02, 0.6)])
@pytest.mark.parametrize("plan", list(PLANS))
def test_argmax_with_bounds_on_the_scale(plan: str, width: float, off: float, rooms: dict) -> None:
    dense = rooms[plan, "cosine"]
    rays, (_, _, _, unit) = look(dense, 2, 80, arcs=True, noise=0.03)
    scale = (math.exp(off - width) / unit, math.exp(off + width) / unit)
    volume = dense.cosines(rays, scale)
    check_best(dense, dense.matcher.argmax(CosineBound(rays, scale)), volume, COSINE_TIE)
    assert np.all(volume <= dense.cosines(rays) + 1e-5)


@pytest.mark.parametrize(
    ("hfov", "arcs", "noise", "scale_sd"),
    [
        (80, False, 0.0, 1.0),
        (108, True, 0.05, 1.0),
        (170, True, 0.02, 1.0),
        (108, True, 0.05, 0.03),
        (24, False, 0.1, 0.3),
    ],
)
@pytest.mark.parametrize("plan", list(PLANS))
def test_argmax_of_the_likelihood(plan: str, hfov: int, arcs: bool, noise: float, scale_sd: float, rooms: dict) -> None:
    dense = rooms[plan, "likelihood"]
    seen = told(look(dense, 3, hfov, arcs=arcs, noise=noise, limits=arcs)[0], scale_sd)
    assert seen.is_limit.any() == arcs
    volume = dense.likelihoods(seen)
    check_best(dense, dense.matcher.argmax(seen), volume, LIKELIHOOD_TIE)
    rows = np.arange(0, len(dense.leaves), 97)
    single = LikelihoodBound(seen, dense.step).volume(dense.profiles[rows].astype(np.float32), np.arange(len(rows)))
    # Far from the best the costs add up to 50, of which float32 keeps 1e-5.
    np.testing.assert_allclose(single, volume[rows], atol=1e-3)


@pytest.mark.parametrize("count", [1, 300, 60_000])
@pytest.mark.parametrize("scoring", list(STEPS))
def test_above_is_the_set_of_poses_that_reach_the_score(scoring: str, count: int, rooms: dict) -> None:
    dense = rooms["two rooms", scoring]
    rays, _ = look(dense, 4, 108, arcs=True, noise=0.04)
    seen, tie = (rays, COSINE_TIE) if scoring == "cosine" else (told(rays), 5 * LIKELIHOOD_TIE)
    volume = dense.cosines(rays) if scoring == "cosine" else dense.likelihoods(told(rays))
    score = float(np.partition(volume.ravel(), -count)[-count]) - 3 * tie
    found = dense.matcher.above(seen, score)
    assert found.certified and np.all(found.scores >= score) and np.all(np.diff(found.scores) <= 0)
    listed = np.zeros(volume.shape, int)
    np.add.at(listed, dense.index(found.poses), 1)
    assert listed.max() == 1
    assert np.all(volume[listed == 1] >= score - tie)
    assert np.count_nonzero((volume >= score + tie) & (listed == 0)) == 0
    assert abs(len(found.poses) - count) <= max(10, 0.01 * count)
    np.testing.assert_allclose(volume[dense.index(found.poses)], found.scores, atol=2 * tie)


def test_above_the_least_score_lists_all_poses(rooms: dict) -> None:
    dense = Dense("L", 0.1)
    rays, _ = look(dense, 4, 80, arcs=True, noise=0.1)
    for seen in (CosineBound(rays), CosineBound(rays, (20.0, 21.0)), LikelihoodBound(told(rays), 0.1)):
        assert len(dense.matcher.above(seen, seen.least).poses) == 360 * len(dense.leaves)


def test_above_says_when_it_lists_only_the_best(rooms: dict) -> None:
    dense = rooms["L", "cosine"]
    rays, _ = look(dense, 5, 80, arcs=False, noise=0.05)
    every = dense.matcher.above(rays, 0.98)
    some = dense.matcher.above(rays, 0.98, most=50)
    assert len(every.poses) > 50 and every.certified and not some.certified
    assert np.array_equal(some.poses, every.poses[:50]) and np.array_equal(some.scores, every.scores[:50])
    assert len(dense.matcher.above(rays, 2.0).poses) == 0


@pytest.mark.parametrize("scoring", list(STEPS))
@pytest.mark.parametrize("count", [1, 5, 40])
def test_topk_is_the_greedy_choice_from_all_poses(scoring: str, count: int, rooms: dict) -> None:
    dense = rooms["L", scoring]
    rays, _ = look(dense, 6, 108, arcs=True, noise=0.05)
    volume = dense.cosines(rays) if scoring == "cosine" else dense.likelihoods(told(rays))
    found = dense.matcher.topk(rays if scoring == "cosine" else told(rays), count)
    assert found.certified and len(found.poses) == count
    # Poses along a line to a corner can look the same at another scale, so ties are common: each pose must be one of
    # the best among those apart from the ones before it.
    rows, headings = dense.index(found.poses)
    left, tie = volume.copy(), 2e-6 if scoring == "cosine" else 1e-4
    for row, heading, pose, score in zip(rows, headings, found.poses, found.scores, strict=True):
        assert abs(volume[row, heading] - score) <= tie
        assert left[row, heading] >= left.max() - tie  # -inf where it is near one before
        near = np.hypot(*(dense.places - pose[:2]).T) < APART_M
        turned = np.abs(wrap_angle(np.radians(np.arange(360)) - pose[2])) < APART_RAD
        left[np.ix_(near, turned)] = -np.inf


@pytest.mark.parametrize(("hfov", "arcs", "noise", "bounded"), [
    (80, True, 0.05, False), (108, False, 0.0, False), (170, True, 0.03, False), (80, True, 0.02, True),
])  # fmt: skip
@pytest.mark.parametrize("plan", list(PLANS))
def test_planes_leave_every_pose_that_reaches_the_score(
    plan: str, hfov: int, arcs: bool, noise: float, bounded: bool, rooms: dict
) -> None:
    dense = rooms[plan, "cosine"]
    rays, (_, _, _, unit) = look(dense, 30, hfov, arcs=arcs, noise=noise)
    scale = (0.8 / unit, 1.1 / unit) if bounded else None
    pyramid, profiles = dense.matcher._part(False)
    level, volume = pyramid.levels[-1], dense.cosines(rays, scale)
    blocks, turns = np.divmod(np.arange(len(pyramid.mask) * 360 // level.width), 360 // level.width)
    nodes = Nodes(blocks.astype(np.int32), (turns * level.width).astype(np.int16))
    for count in (1, 1000, 200_000):
        score = float(np.partition(volume.ravel(), -count)[-count])
        view = CosineBound(rays, scale).planes(score)
        leaves, headings, parents, crowded = plane_leaves(view, pyramid, profiles, level, nodes, math.inf)
        left = np.zeros(volume.shape, bool)
        assert len(crowded) == 0 and np.all(pyramid.is_clear(leaves))
        left[np.searchsorted(dense.leaves, leaves), headings] = True
        assert np.count_nonzero(left) == len(leaves)
        assert not np.any((volume >= score) & ~left)
        assert np.array_equal(nodes.cells[parents], leaves // 64)
        assert np.array_equal(nodes.headings[parents], headings // level.width * level.width)
    assert len(leaves) < 0.8 * volume.size  # it is of use
    some = plane_leaves(view, pyramid, profiles, level, nodes, 1000.0)
    assert len(some[3]) and set(leaves // 64) - set(some[3]) == set(some[0] // 64)


def test_topk_of_more_places_than_there_are(rooms: dict) -> None:
    dense = Dense("L", 0.1)
    rays, _ = look(dense, 6, 108, arcs=True, noise=0.05)
    found = dense.matcher.topk(rays, 30, apart_m=1.5, apart_rad=4.0)  # any heading is the same place
    assert found.certified and 2 <= len(found.poses) < 30
    far = np.hypot(*(dense.places[:, None] - found.poses[:, :2]).transpose(2, 0, 1))
    assert np.all(far.min(axis=1) < 1.5)  # no place is left


@pytest.mark.parametrize("scoring", list(STEPS))
def test_rank_counts_the_positions_that_score_above_the_truth(scoring: str, rooms: dict) -> None:
    dense = rooms["two rooms", scoring]
    for seed, xy in ((7, None), (8, (1.0, 1.0)), (9, (4.5, 0.8))):
        rays, (x, y, *_) = look(dense, seed, 80, arcs=True, noise=0.05)
        place = np.array([x, y] if xy is None else xy)
        seen, tie = (rays, COSINE_TIE) if scoring == "cosine" else (told(rays), 1e-4)
        volume = dense.cosines(rays) if scoring == "cosine" else dense.likelihoods(told(rays))
        there = SimpleNamespace(profiles=dense.matcher._caster(place).astype(np.float64), step=dense.step)
        alone = Dense.cosines(there, rays) if scoring == "cosine" else Dense.likelihoods(there, told(rays))  # type: ignore[arg-type]
        best, truth = volume.max(axis=1), alone.max()
        found = dense.matcher.rank(seen, place) * len(best)
        assert np.count_nonzero(best > truth + tie) <= found + 1e-6
        assert found - 1e-6 <= np.count_nonzero(best > truth - tie)
        assert found < len(best)


@pytest.mark.parametrize("scoring", list(STEPS))
def test_heat_map_is_the_best_heading_of_each_position(scoring: str, rooms: dict) -> None:
    dense = rooms["two rooms", scoring]
    rays, _ = look(dense, 10, 108, arcs=True, noise=0.05)
    volume = dense.cosines(rays) if scoring == "cosine" else dense.likelihoods(told(rays))
    seen = rays if scoring == "cosine" else told(rays)
    for stride in (1, 7):
        places, scores, headings = dense.matcher.heat_map(seen, stride)
        rows, degrees = dense.index(np.column_stack([places, headings]))
        np.testing.assert_allclose(scores, volume[rows].max(axis=1), atol=COSINE_TIE if scoring == "cosine" else 1e-3)
        np.testing.assert_allclose(volume[rows, degrees], scores, atol=COSINE_TIE if scoring == "cosine" else 1e-3)
        assert len(np.unique(rows)) == len(rows)
        if stride == 1:
            assert len(rows) == len(dense.leaves)
        else:
            assert abs(len(rows) * stride**2 / len(dense.leaves) - 1.0) < 0.1


@pytest.mark.parametrize("stride", [0, -3])
def test_bad_strides_are_named(stride: int, rooms: dict) -> None:
    rays, _ = look(rooms["L", "cosine"], 1, 80, arcs=False, noise=0.0)
    with pytest.raises(GalocError, match="stride"):
        rooms["L", "cosine"].matcher.heat_map(rays, stride)


def answers(matcher: Matcher, seen: Rays | Observation, score: float) -> list[np.ndarray]:
    top, above = matcher.topk(seen, 6), matcher.above(seen, score)
    best = matcher.argmax(seen)
    return [
        best.poses, best.scores, top.poses, top.scores, above.poses, above.scores, *matcher.heat_map(seen, 3),
        np.array(matcher.rank(seen, (1.0, 1.0))),
    ]  # fmt: skip


@pytest.mark.parametrize("change", ["eviction", "no lowest level", "threads", "again"])
@pytest.mark.parametrize("scoring", list(STEPS))
def test_answers_do_not_depend_on_memory_levels_or_threads(
    scoring: str, change: str, rooms: dict, monkeypatch: pytest.MonkeyPatch
) -> None:
    dense = rooms["two rooms", scoring]
    rays, _ = look(dense, 11, 108, arcs=True, noise=0.05)
    seen, score = (rays, 0.98) if scoring == "cosine" else (told(rays), -12.0)
    expected = answers(dense.matcher, seen, score)
    matcher = dense.matcher
    if change == "eviction":
        matcher = Matcher(dense.plan, dense.step, leaf_memory=0)
        assert matcher._part(scoring != "cosine")[1].capacity < len(matcher.pyramid(scoring != "cosine").mask)
    elif change == "no lowest level":
        monkeypatch.setattr(
            "galoc.match.build_pyramid", lambda plan, step, log: build_pyramid(plan, step, log=log, limit=0)
        )
        matcher = Matcher(dense.plan, dense.step)
        assert [level.width for level in matcher.pyramid(scoring != "cosine").levels] == [8, 4, 2]
    elif change == "threads":
        before = numba.get_num_threads()
        numba.set_num_threads(1 if before > 1 else numba.config.NUMBA_NUM_THREADS)
    try:
        found = answers(matcher, seen, score)
    finally:
        if change == "threads":
            numba.set_num_threads(before)
    assert len(expected[4]) > 50
    for k, (a, b) in enumerate(zip(found, expected, strict=True)):
        if change in ("threads", "again"):
            assert np.array_equal(a, b)
        elif k in (1, 7):  # other poses are scored together then, and float32 sums end differently
            np.testing.assert_allclose(a, b, atol=1e-5)
        elif k == 9:
            np.testing.assert_allclose(a, b, atol=10 / len(dense.leaves))  # places that tie with the truth
    assert abs(len(found[4]) - len(expected[4])) <= 2


@pytest.fixture(scope="module")
def fine() -> Dense:
    """At this step the boxes tell poses apart well enough that single ones are left to score."""
    return Dense("two rooms", 0.02)


@pytest.mark.parametrize("parts", [0, 1, 5])
@pytest.mark.parametrize("scoring", list(STEPS))
def test_what_time_did_not_allow_is_bounded(
    scoring: str, parts: int, fine: Dense, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("galoc.descent.PART", 2)  # blocks between two looks at the clock, which here counts the looks
    gaps = []
    for seed in range(5):
        rays, _ = look(fine, 20 + seed, 170, arcs=False, noise=0.05)
        seen = rays if scoring == "cosine" else told(rays)
        clock = itertools.count()
        monkeypatch.setattr("galoc.match.time", SimpleNamespace(monotonic=lambda clock=clock: float(next(clock))))
        found = fine.matcher.argmax(seen, seconds=parts + 0.5)
        whole = fine.matcher.argmax(seen)
        assert whole.certified and found.certified == (found.gap == 0.0)
        assert found.scores[0] <= whole.scores[0] + 1e-6
        assert whole.scores[0] <= found.scores[0] + found.gap + 1e-6
        gaps.append(found.gap)
    assert max(gaps) > 0.0 or parts == 5
    assert np.any(np.isfinite(gaps))


def test_no_time_is_no_certificate(rooms: dict) -> None:
    dense = rooms["two rooms", "cosine"]
    rays, _ = look(dense, 21, 80, arcs=True, noise=0.1)
    hurried = dense.matcher.argmax(rays, seconds=0.0)
    assert not hurried.certified and hurried.gap > 0.0
    assert dense.cosines(rays).max() <= hurried.scores[0] + hurried.gap + COSINE_TIE


def test_what_cannot_be_searched_is_named(monkeypatch: pytest.MonkeyPatch, rooms: dict) -> None:
    nothing = Rays(np.full(61, np.nan), np.zeros(61, bool), np.full(61, np.nan))
    matcher = rooms["L", "cosine"].matcher
    for ask in (matcher.argmax, lambda s: matcher.topk(s, 3), lambda s: matcher.above(s, 0.9), matcher.heat_map):
        with pytest.raises(GalocError, match="known ray"):
            ask(nothing)
    with pytest.raises(GalocError, match="without ranges"):
        matcher.argmax(observation(Layout.unknown("ml"), nothing))
    shaft = Floorplan.from_segments(walls_of([(0, 0), (0.6, 0), (0.6, 0.6), (0, 0.6)]))
    with pytest.raises(GalocError, match="without free space"):
        Matcher(shaft, 0.02).argmax(look(rooms["L", "cosine"], 1, 80, arcs=False, noise=0.0)[0])
    monkeypatch.setattr("galoc.freespace.MAX_CELLS", 2_000)
    with pytest.raises(GalocError, match="exact search over a plan"):
        Matcher(Floorplan.from_segments(PLANS["L"].segments)).pyramid()


@pytest.mark.parametrize("resolution", [0, -0.01, math.nan, math.inf, 1e-9, 3.0, "x", None, True, [0.01]])
def test_bad_resolutions_are_named(resolution: Any) -> None:
    with pytest.raises(GalocError, match="resolution"):
        Matcher(PLANS["L"], resolution)


def test_what_is_no_plan_and_no_observation_is_named(rooms: dict) -> None:
    with pytest.raises(GalocError, match="plan of type str"):
        Matcher("office")  # type: ignore[arg-type]
    with pytest.raises(GalocError, match="leaf_memory"):
        Matcher(PLANS["L"], leaf_memory=math.nan)  # type: ignore[arg-type]
    for seen in (None, np.ones(5)):
        with pytest.raises(GalocError, match="observation of type"):
            rooms["L", "cosine"].matcher.argmax(seen)


def test_single_precision_resolutions_are_the_same_number() -> None:
    assert Matcher(PLANS["L"], np.float32(0.125)).pyramid().positions == Matcher(PLANS["L"], 0.125).pyramid().positions  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("method", "arguments", "name"),
    [
        ("argmax", {"seconds": -1.0}, "seconds"), ("argmax", {"seconds": math.nan}, "seconds"),
        ("above", {"score": math.nan}, "score"), ("above", {"score": "x"}, "score"),
        ("above", {"score": 0.9, "most": 0}, "most"), ("above", {"score": 0.9, "most": -1}, "most"),
        ("topk", {"count": 0}, "count"), ("topk", {"count": 1.5}, "count"),
        ("topk", {"count": 2, "apart_m": -1}, "apart_m"), ("topk", {"count": 2, "apart_rad": math.nan}, "apart_rad"),
        ("heat_map", {"stride": 1.5}, "stride"), ("heat_map", {"stride": 10**30}, "stride"),
        ("rank", {"xy": (99.0, 99.0)}, "position"), ("rank", {"xy": (1.0, math.nan)}, "position"),
        ("rank", {"xy": (1.0, 1.0, 1.0)}, "position"), ("rank", {"xy": "x"}, "position"),
    ],
)  # fmt: skip
def test_bad_questions_are_named(method: str, arguments: dict, name: str, rooms: dict) -> None:
    rays, _ = look(rooms["L", "cosine"], 1, 80, arcs=False, noise=0.0)
    with pytest.raises(GalocError, match=name):
        getattr(rooms["L", "cosine"].matcher, method)(rays, **arguments)


def test_a_perfect_score_needs_no_time(rooms: dict) -> None:
    """No pose beats a cosine of 1: whatever the time, the answer is certified and nothing can be better."""
    dense = rooms["L", "cosine"]
    rays = Rays(np.ones(1), np.ones(1, bool), np.full(1, np.nan))
    found = dense.matcher.argmax(rays, seconds=0.0)
    assert found.certified and found.gap == 0.0 and found.scores[0] == pytest.approx(1.0, abs=1e-5)


def test_copies_share_boxes_and_keep_their_own_profiles(rooms: dict) -> None:
    """What a thread needs; and a pickle is not swollen by profiles, 92 kB a block."""
    dense = rooms["L", "cosine"]
    rays, _ = look(dense, 3, 80, arcs=False, noise=0.05)
    best = dense.matcher.argmax(rays)
    other = copy.copy(dense.matcher)
    assert other.pyramid() is dense.matcher.pyramid()
    np.testing.assert_array_equal(other.argmax(rays).poses, best.poses)
    assert other._leaves is not dense.matcher._leaves
    far = pickle.loads(pickle.dumps(dense.matcher))
    assert far._leaves is None
    np.testing.assert_array_equal(far.argmax(rays).poses, best.poses)
