"""The dense cosine kernel against the formula in float64, on this machine's registers and on narrower ones."""

import os
import subprocess
import sys

import numpy as np
import pytest

from galoc import Rays
from galoc.bound import CosineBound

TOLERANCE = 2e-6
"""Of a cosine: float32 sums of up to 176 products, relative error of each sum below 1e-6, and the 1e-6 in the formula's
denominator, which counts where a wall is near (the kernel shares it)."""


def formula(profiles: np.ndarray, rays: Rays) -> np.ndarray:
    """(P, 360) masked cosine of every position and heading, float64 (paper Eq. masked-cos before the power)."""
    n = len(rays.known)
    bins = (np.arange(360)[:, None] + np.arange(n) - (n - 1) // 2) % 360
    obs = np.where(rays.known, rays.range, 0.0)
    obs = obs / np.linalg.norm(obs)
    out = np.empty((len(profiles), 360))
    for p, profile in enumerate(profiles.astype(np.float64)):
        w = profile[bins] * rays.known
        out[p] = w @ obs / (np.linalg.norm(w, axis=1) + 1e-6)
    return out


def draw(rng: np.random.Generator, n: int, unknown: float) -> Rays:
    known = np.ones(n, bool)
    while unknown and (known.all() or not known.any()):
        known = np.repeat(rng.random(n) >= unknown, rng.integers(1, 9, n))[:n]
    scale = 10.0 ** rng.uniform(-3, 3)  # scale-free layouts come in any unit
    values = scale * np.exp(rng.uniform(np.log(0.05), np.log(500.0), n))
    return Rays(np.where(known, values, np.nan), known, np.full(n, np.nan))


def draw_profiles(rng: np.random.Generator, count: int) -> np.ndarray:
    """Profiles with jumps from 0.05 m to 500 m: differences of running sums would be lost in them."""
    steps = np.exp(rng.uniform(np.log(0.05), np.log(500.0), (count, 60)))
    return np.repeat(steps, 6, axis=1).astype(np.float32)


@pytest.mark.parametrize("unknown", [0.0, 0.2, 0.7])
@pytest.mark.parametrize("n", [1, 3, 8, 15, 16, 17, 61, 81, 109, 127, 128, 129, 151, 171, 175])
def test_cosines_are_those_of_the_formula(n: int, unknown: float, rng: np.random.Generator) -> None:
    rays = draw(rng, n, unknown if n > 1 else 0.0)
    profiles = draw_profiles(rng, 40)
    bound, rows = CosineBound(rays), rng.permutation(40)[:30]
    expected = formula(profiles[rows], rays)
    np.testing.assert_allclose(bound.volume(profiles, rows), expected, atol=TOLERANCE, rtol=0)
    best, heading = bound.dense(profiles, rows)
    np.testing.assert_allclose(best, expected.max(axis=1), atol=TOLERANCE, rtol=0)
    np.testing.assert_allclose(expected[np.arange(30), heading], best, atol=TOLERANCE, rtol=0)


@pytest.mark.parametrize("n", [1, 61, 109, 171])
def test_single_poses_score_as_all_headings_do(n: int, rng: np.random.Generator) -> None:
    rays = draw(rng, n, 0.3 if n > 1 else 0.0)
    profiles = draw_profiles(rng, 20)
    rows, headings = rng.integers(0, 20, 700), rng.integers(0, 360, 700).astype(np.int16)
    found = CosineBound(rays).leaves(profiles, rows, headings)
    np.testing.assert_allclose(found, formula(profiles, rays)[rows, headings], atol=TOLERANCE, rtol=0)


def test_every_other_ray_unknown(rng: np.random.Generator) -> None:
    known = np.arange(171) % 2 == 1  # as many runs as can be
    rays = Rays(np.where(known, rng.uniform(0.5, 8.0, 171), np.nan), known, np.full(171, np.nan))
    profiles = draw_profiles(rng, 10)
    found = CosineBound(rays).volume(profiles, np.arange(10))
    np.testing.assert_allclose(found, formula(profiles, rays), atol=TOLERANCE, rtol=0)


def test_bounded_scale_is_the_least_residual_within(rng: np.random.Generator) -> None:
    """1 - cos^2 is the residual at the best scale: searched here on a fine grid of scales."""
    rays = draw(rng, 61, 0.3)
    unit = 1.0 / np.linalg.norm(rays.range[rays.known])
    profiles = draw_profiles(rng, 6)
    free = CosineBound(rays).volume(profiles, np.arange(6))
    n = len(rays.known)
    bins = (np.arange(360)[:, None] + np.arange(n) - (n - 1) // 2) % 360
    obs = np.where(rays.known, rays.range, 0.0) * unit
    metres = np.median(profiles) / np.median(rays.range[rays.known])
    least, greatest = 0.5 * metres, 2.0 * metres
    found = CosineBound(rays, (least, greatest)).volume(profiles, np.arange(6))
    t = unit / np.exp(np.linspace(np.log(least), np.log(greatest), 400))  # unit observation = t times the map
    for p, profile in enumerate(profiles.astype(np.float64)):
        w = profile[bins] * rays.known
        rest = 1.0 - 2.0 * t * (w @ obs)[:, None] + t**2 * np.sum(w**2, axis=1)[:, None]
        expected = np.sqrt(np.maximum(0.0, 1.0 - rest.min(axis=1)))
        # The grid misses the best scale by at most 0.2 %, which is second order in the residual: 3e-6 of its square.
        assert np.all(found[p] ** 2 >= expected**2 - 1e-5) and np.all(found[p] ** 2 <= expected**2 + 2e-5)
    assert np.all(found <= free + 1e-5) and np.any(found < free - 0.01)


def test_avx2_registers_give_the_same(tmp_path) -> None:  # type: ignore[no-untyped-def]
    script = """
import numpy as np
import test_dense
from galoc import _correlation
assert _correlation.LANES == 8, _correlation.LANES
rng = np.random.default_rng(1)
for n in (17, 109, 171):
    test_dense.test_cosines_are_those_of_the_formula(n, 0.2, rng)
test_dense.test_single_poses_score_as_all_headings_do(109, rng)
print("same")
"""
    narrow = {
        "NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx2,+fma,+avx,+sse4.2", "NUMBA_NUM_THREADS": "1",
        "NUMBA_CACHE_DIR": str(tmp_path), "PYTHONPATH": os.path.dirname(__file__),
    }  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-c", script], env={**os.environ, **narrow}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0 and done.stdout.strip() == "same", done.stderr
