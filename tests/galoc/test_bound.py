"""What branch and bound drops must not hold a better pose: random boxes around random profiles."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from galoc import GalocError, Layout, Rays
from galoc._pyramid_kernel import PHASES, ROW, _encode
from galoc.bound import Bound, CosineBound
from galoc.likelihood_bound import LikelihoodBound
from galoc.observation import Observation, observation
from galoc.pyramid import Level, Nodes

BOXES = 600


def boxed(profiles: np.ndarray, spread: np.ndarray, rng: np.random.Generator, log: bool) -> Level:
    """One box around each profile; ``spread`` (B,) is how far its ends lie off on average, in log range."""
    off = rng.exponential(spread[:, None, None], (len(profiles), 2, 360)) * (rng.random((len(profiles), 2, 360)) < 0.7)
    low = (profiles * np.exp(-off[:, 0])).astype(np.float32)
    high = (profiles * np.exp(off[:, 1])).astype(np.float32)
    low, high = np.minimum(low, profiles), np.maximum(high, profiles)
    codes = np.zeros((len(profiles), 2, PHASES, ROW), np.uint16)
    for p in range(len(profiles)):
        _encode(low[p], high[p], 1, log, codes[p])
    return Level(codes, 1, np.arange(len(profiles) + 1), 1, None)


def views_of(rng: np.random.Generator, n: int, noise: float, limits: bool) -> tuple[np.ndarray, Rays]:
    """Profiles that resemble a room, and what a camera sees of the first of them, turned by 0 degrees."""
    base = np.interp(np.arange(360), np.arange(0, 361, 12), np.exp(rng.uniform(-1.5, 2.5, 31)))
    shape = np.exp(rng.normal(0.0, 1.0, (BOXES, 1)) + rng.exponential(0.1, (BOXES, 1)) * rng.normal(0, 1, (BOXES, 360)))
    profiles = np.clip(base * shape, 0.15, 900.0).astype(np.float32)
    known = np.ones(n, bool)
    known[rng.integers(0, n, n // 5)] = False
    seen = profiles[0][(np.arange(n) - (n - 1) // 2) % 360] * np.exp(noise * rng.standard_normal(n)) * 3.7
    limit = np.where(~known & (rng.random(n) < 0.6) & limits, 1.1 * seen, np.nan)
    variance = np.where(known, rng.uniform(1e-5, 0.05, n), np.nan)
    return profiles, Rays(np.where(known, seen, np.nan), known, variance, limit)


def check(bound: Bound, level: Level, profiles: np.ndarray, rng: np.random.Generator) -> float:
    """Share of boxes that are dropped for the score of another pose."""
    cells, headings = np.arange(BOXES, dtype=np.int32), rng.integers(-4, 5, BOXES).astype(np.int16) % 360
    score = bound.leaves(profiles, np.arange(BOXES), headings)
    for k in range(BOXES):
        node = Nodes(cells[k : k + 1], headings[k : k + 1])
        if bound.log:  # the roots' interval, as the descent hands it down
            reach = math.sqrt(float(bound._limit(float(score[k])) / bound._prior))  # type: ignore[attr-defined]
            node = Nodes(node.cells, node.headings, np.array([[-reach, reach]], np.float32))
        left = bound.nodes(level, node, float(score[k]))
        assert len(left) == 1, (k, score[k])
        assert bound.limits(level, left)[0] >= score[k] - 1e-6
        again = bound.nodes(level, left, float(score[k]))  # with the scales that were left
        assert len(again) == 1
    best = float(score.max())
    start = None
    if bound.log:
        reach = math.sqrt(float(bound._limit(best) / bound._prior))  # type: ignore[attr-defined]
        start = np.tile(np.array([[-reach, reach]], np.float32), (BOXES, 1))
    kept = bound.nodes(level, Nodes(cells, headings, start), best)
    assert np.all(np.isin(cells[score >= best], kept.cells))
    return 1.0 - len(kept) / BOXES


@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("n", [5, 61, 109, 171])
def test_no_box_that_holds_the_score_is_dropped(n: int, noise: float, rng: np.random.Generator) -> None:
    profiles, rays = views_of(rng, n, noise, limits=False)
    bound = CosineBound(rays)
    spread = np.exp(rng.uniform(math.log(1e-5), 0.0, BOXES))
    dropped = check(bound, boxed(profiles, spread, rng, log=False), profiles, rng)
    assert dropped > 0.3  # the bounds are of use
    rows, headings = np.arange(BOXES), np.zeros(BOXES, np.int16)
    walls = profiles[:, (np.arange(n) - (n - 1) // 2) % 360][:, rays.known].astype(np.float64)
    obs = rays.range[rays.known] / np.linalg.norm(rays.range[rays.known])
    exact = (walls @ obs / np.linalg.norm(walls, axis=1))[:50]
    np.testing.assert_allclose(
        bound.leaves(profiles, rows, headings)[:50], exact, atol=8e-6
    )  # 1e-6 / 0.15 m, and float32


@pytest.mark.parametrize("width", [0.0, 0.1, 1.0])
def test_bounded_scale_drops_no_box_that_holds_the_score(width: float, rng: np.random.Generator) -> None:
    profiles, rays = views_of(rng, 109, 0.03, limits=False)
    bound = CosineBound(rays, (math.exp(-width) / 3.7, math.exp(width) / 3.7))
    spread = np.exp(rng.uniform(math.log(1e-5), 0.0, BOXES))
    assert check(bound, boxed(profiles, spread, rng, log=False), profiles, rng) > 0.3


@pytest.mark.parametrize("scale_sd", [1.0, 0.05])
@pytest.mark.parametrize("n", [5, 81, 171])
def test_no_box_that_holds_the_likelihood_is_dropped(n: int, scale_sd: float, rng: np.random.Generator) -> None:
    profiles, rays = views_of(rng, n, 0.03, limits=True)
    seen = dataclasses.replace(observation(Layout.unknown("ml"), rays), scale_sd=scale_sd)
    assert seen.is_limit.any() or n == 5
    spread = np.exp(rng.uniform(math.log(1e-4), 0.0, BOXES))
    dropped = check(LikelihoodBound(seen, 0.01), boxed(profiles, spread, rng, log=True), profiles, rng)
    assert dropped > 0.1  # the bound is of use


def test_roots_are_the_nodes_of_the_top_level(rng: np.random.Generator) -> None:
    profiles, rays = views_of(rng, 109, 0.05, limits=True)
    seen = observation(Layout.unknown("ml"), rays)
    for bound in (CosineBound(rays), CosineBound(rays, (0.2, 0.4)), LikelihoodBound(seen, 0.01)):
        level = boxed(profiles[:40], np.full(40, 1e-3), rng, bound.log)
        score = float(bound.leaves(profiles, np.zeros(1, np.int64), np.zeros(1, np.int16))[0])
        found = bound.roots(level, score)
        cells, headings = np.divmod(np.arange(40 * 360), 360)
        scales = None
        if bound.log:
            reach = math.sqrt(float(bound._limit(score) / bound._prior))  # type: ignore[attr-defined]
            scales = np.tile(np.array([[-reach, reach]], np.float32), (len(cells), 1))
        kept = bound.nodes(level, Nodes(cells.astype(np.int32), headings.astype(np.int16), scales), score)
        assert 0 < len(kept) < len(cells)
        assert np.array_equal(found.cells, kept.cells) and np.array_equal(found.headings, kept.headings)


def test_least_is_reached_by_every_pose(rng: np.random.Generator) -> None:
    profiles, rays = views_of(rng, 109, 0.5, limits=True)
    seen = observation(Layout.unknown("ml"), rays)
    for bound in (CosineBound(rays), CosineBound(rays, (50.0, 60.0)), LikelihoodBound(seen, 0.01)):
        assert bound.volume(profiles[:50], np.arange(50)).min() >= bound.least


def test_bad_observations_are_named() -> None:
    nothing = Rays(np.full(61, np.nan), np.zeros(61, bool), np.full(61, np.nan))
    with pytest.raises(GalocError, match="known ray"):
        CosineBound(nothing)
    blind: Observation = observation(Layout.unknown("ml"), nothing)
    with pytest.raises(GalocError, match="without ranges"):
        LikelihoodBound(blind, 0.01)
    some = Rays(np.ones(61), np.ones(61, bool), np.full(61, np.nan))
    for scale in ((0.0, 1.0), (2.0, 1.0), (1.0, math.inf), (math.nan, 1.0)):
        with pytest.raises(GalocError, match="scale"):
            CosineBound(some, scale)


def some_rays(count: int = 61, **parts: Any) -> Rays:
    given = {"range": np.linspace(1.0, 2.0, count), "known": np.ones(count, bool), "variance": np.full(count, 0.01)}
    return Rays(**(given | parts))


@pytest.mark.parametrize(
    ("rays", "cure"),
    [
        (some_rays(361), "at most 360"), (some_rays(721), "at most 360"), (some_rays(range=np.zeros(61)), "above 0"),
        (some_rays(range=np.full(61, np.nan)), "above 0"), (some_rays(range=np.full(61, np.inf)), "above 0"),
        (some_rays(range=np.full(61, -1.0)), "above 0"), (some_rays(range=np.ones(30)), "booleans"),
        (some_rays(range=np.full(61, "1")), "numbers"), (some_rays(known=np.full(61, 0.5)), "booleans"),
    ],
)  # fmt: skip
def test_rays_that_the_kernels_cannot_take_are_refused(rays: Rays, cure: str) -> None:
    """Too many rays would be read from beyond the profile, NaN would spread to every score."""
    with pytest.raises(GalocError, match=cure):
        CosineBound(rays)


def test_unknown_rays_may_hold_anything() -> None:
    known = np.arange(61) > 30
    clean, dirty = (
        some_rays(known=known),
        some_rays(known=known, range=np.where(known, np.linspace(1.0, 2.0, 61), np.nan)),
    )
    profiles = np.random.default_rng(0).uniform(1.0, 5.0, (1, 360)).astype(np.float32)
    scores = [CosineBound(rays).volume(profiles, np.zeros(1, np.int64)) for rays in (clean, dirty)]
    np.testing.assert_array_equal(*scores)


@pytest.mark.parametrize("scale", [(0.0, 1.0), (2.0, 1.0), (np.nan, 1.0), (1.0, np.inf), (1.0,), 1.0, "ab", (1, 2, 3)])
def test_bad_scales_are_named(scale: Any) -> None:
    with pytest.raises(GalocError, match="scale"):
        CosineBound(some_rays(), scale)


@pytest.mark.parametrize("log_range", [np.nan, np.inf, 100.0, -100.0])
def test_observations_without_lengths_are_refused(log_range: float) -> None:
    seen = observation(Layout.unknown("ml"), some_rays())
    seen.log_range[7] = log_range
    with pytest.raises(GalocError, match="absurd ranges"):
        LikelihoodBound(seen, 0.01)
    with pytest.raises(GalocError, match="361 rays"):
        LikelihoodBound(observation(Layout.unknown("ml"), some_rays(361)), 0.01)
