"""The fast similarity against the formula, and what the formula is blind to."""

import numpy as np
import pytest

from galoc import GalocError, Rays
from galoc.bound import CosineBound
from galoc.score import CONFIDENCE_FLOOR, UnitRays, confidence, cosine, score_volume

PROFILES = np.random.default_rng(0).uniform(0.3, 12.0, (7, 360)).astype(np.float32)


def rays(seed: int, n: int = 109, share: float = 0.7) -> Rays:
    """Random ranges, of which about ``share`` are known; unknown ones are NaN."""
    rng = np.random.default_rng(seed)
    known = rng.random(n) < share
    known[n // 2] = True
    return Rays(np.where(known, rng.uniform(0.5, 8.0, n), np.nan), known, np.full(n, np.nan))


@pytest.mark.parametrize("n", [41, 81, 109, 175])
@pytest.mark.parametrize("share", [0.1, 0.7, 1.0])
def test_kernel_equals_the_formula(n: int, share: float) -> None:
    seen = rays(n, n, share)
    volume = score_volume(PROFILES, seen)
    assert volume.shape == (len(PROFILES), 360) and volume.dtype == np.float32
    expected = [[cosine(p, seen, h) for h in range(360)] for p in PROFILES]
    np.testing.assert_allclose(volume, expected, atol=1e-5)  # float32 sums, to the power 10


def test_headings_pick_columns_and_wrap() -> None:
    seen = rays(3)
    headings = np.array([-3, 0, 359, 362, 90])
    # Another order of the float32 sums, to the power 10.
    np.testing.assert_allclose(
        score_volume(PROFILES, seen, headings), score_volume(PROFILES, seen)[:, headings % 360], rtol=1e-5
    )


@pytest.mark.parametrize("factor", [1e-4, 0.3, 5e3])
def test_scale_of_the_layout_does_not_matter(factor: float) -> None:
    seen = rays(1)
    scaled = Rays(seen.range * factor, seen.known, seen.variance)
    np.testing.assert_allclose(score_volume(PROFILES, scaled), score_volume(PROFILES, seen), atol=2e-6)


def test_unknown_rays_are_ignored() -> None:
    """Whatever an unknown ray holds, and whatever the plan shows there, the score stays."""
    seen = rays(2)
    other = Rays(np.where(seen.known, seen.range, 1e6), seen.known, seen.variance)
    np.testing.assert_array_equal(score_volume(PROFILES, other), score_volume(PROFILES, seen))
    bins = (40 + np.arange(109) - 54) % 360
    changed = PROFILES.copy()
    changed[:, bins[~seen.known]] = 99.0
    here = np.array([40])
    np.testing.assert_array_equal(score_volume(changed, seen, here), score_volume(PROFILES, seen, here))


def test_truth_scores_one_and_best() -> None:
    bins = (123 + np.arange(109) - 54) % 360
    known = np.arange(109) > 30
    seen = Rays(np.where(known, 0.2 * PROFILES[4, bins], np.nan), known, np.full(109, np.nan))
    volume = score_volume(PROFILES, seen)
    assert np.unravel_index(np.argmax(volume), volume.shape) == (4, 123)
    assert volume[4, 123] == pytest.approx(1.0, abs=1e-5) and volume.min() >= 0.0


def test_nothing_known_scores_nothing() -> None:
    blind = Rays(np.full(109, np.nan), np.zeros(109, bool), np.full(109, np.nan))
    assert not score_volume(PROFILES, blind).any()
    assert score_volume(PROFILES, blind, np.array([1, 2])).shape == (len(PROFILES), 2)
    assert confidence(blind) == CONFIDENCE_FLOOR


def test_confidence_is_the_squared_share_of_known_rays() -> None:
    known = np.arange(100) < 60
    assert confidence(Rays(np.ones(100), known, np.ones(100))) == pytest.approx(0.36)


def test_unit_rays_hold_the_known_rays_and_no_other() -> None:
    seen = rays(9)
    unit = UnitRays.of(seen)
    first = int(np.argmax(seen.known))
    covered = np.zeros(len(unit.seen), int)
    for start, stop in unit.runs:
        assert start < stop
        covered[start:stop] += 1
    assert covered.tolist() == unit.known.astype(int).tolist()
    at = np.flatnonzero(covered) + first
    assert at.tolist() == np.flatnonzero(seen.known).tolist()
    np.testing.assert_allclose(unit.seen[at - first] * unit.norm, seen.range[at], rtol=1e-12)
    assert np.linalg.norm(unit.seen) == pytest.approx(1.0, abs=1e-12)
    assert unit.start == (first - 54) % 360


@pytest.mark.parametrize(
    "headings", [np.arange(36) * 10 + 4, np.arange(72) * 5, np.arange(360) + 7, np.array([3, 350])]
)
def test_every_choice_of_headings_gives_the_same_scores(headings: np.ndarray) -> None:
    profiles = np.exp(np.random.default_rng(3).normal(0.5, 0.8, (70, 360))).astype(np.float32)
    seen = rays(9)
    full = score_volume(profiles, seen)
    # 1e-5: ten times the rounding of a float32 cosine, since the score is its tenth power.
    np.testing.assert_allclose(score_volume(profiles, seen, headings), full[:, headings % 360], atol=1e-5)


@pytest.mark.parametrize("n", [345, 353, 359, 360])
def test_a_full_turn_of_rays_is_scored(n: int) -> None:
    """A laser looks all around: more rays than a camera has, up to one in every bin."""
    rng = np.random.default_rng(n)
    profiles = np.exp(rng.normal(0.5, 0.8, (5, 360))).astype(np.float32)
    known = rng.random(n) < 0.9
    seen = Rays(np.exp(rng.normal(0.5, 0.8, n)), known, np.full(n, np.nan))
    expected = np.array([[cosine(p, seen, h) for h in range(360)] for p in profiles])
    np.testing.assert_allclose(score_volume(profiles, seen), expected, atol=1e-5)
    for headings in (np.arange(36) * 10 + 4, np.array([3, 350])):
        np.testing.assert_allclose(score_volume(profiles, seen, headings), expected[:, headings], atol=1e-5)
    bound = CosineBound(seen)
    rows, turns = np.repeat(np.arange(5), 360), np.tile(np.arange(360, dtype=np.int16), 5)
    np.testing.assert_allclose(
        bound.leaves(profiles, rows, turns).astype(np.float64) ** 10, expected.ravel(), atol=1e-5
    )


def test_more_rays_than_a_turn_has_are_refused() -> None:
    with pytest.raises(GalocError, match="361 rays"):
        score_volume(np.ones((1, 360), np.float32), Rays(np.ones(361), np.ones(361, bool), np.full(361, np.nan)))
