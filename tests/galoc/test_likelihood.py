"""The dense likelihood against a plain restatement, and what it must and must not depend on."""

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from galoc import Camera, Floorplan, Wireframe
from galoc._likelihood_kernel import FAR_DEG, corner_distances, likelihood_volume
from galoc.detect.oracle import perturb
from galoc.layout import solve_layout
from galoc.likelihood import MANY_RAYS, Likelihood
from galoc.observation import EFFECTIVE_RAYS, LIMIT_SD, PLAIN_SD, Observation, observation
from galoc.profiles import profile_field
from galoc.rays import cast_rays
from galoc.types import Rays
from galoc_env.truth import visible_wireframe

CAMERA = Camera.from_hfov(640, 480, 108)
PLAN = Floorplan.load("apartment")
FIELD = profile_field(PLAN, 0.1)
GRAVITY = (0.02, -0.03)


@cache
def likelihood() -> Likelihood:
    return Likelihood(FIELD)


def seen_by(wireframe: Wireframe, gravity: Any = GRAVITY) -> Observation:
    layout = solve_layout(wireframe, CAMERA, gravity)
    return observation(layout, cast_rays(layout, CAMERA))


@cache
def views(count: int = 40) -> list[tuple[np.ndarray, int, int, Observation]]:
    """Noise-free views from grid positions at whole degrees: pose, row, heading in degrees, observation."""
    rng, out = np.random.default_rng(0), []
    for row in rng.integers(len(FIELD.positions), size=10 * count):
        if FIELD.ranges[row].min() < 0.35:
            continue
        degree = int(rng.integers(360))
        pose = np.array([*FIELD.positions[row], math.radians(degree)])
        exact = perturb(visible_wireframe(PLAN, CAMERA, pose, 1.4, GRAVITY), CAMERA, 0.0, rng)
        out.append((pose, int(row), degree, seen_by(exact)))
        if len(out) == count:
            break
    return out


def plain_volume(
    log_ranges: np.ndarray, corner_deg: np.ndarray, headings: np.ndarray, offset: int, stride: int, seen: np.ndarray,
    precision: np.ndarray, least: np.ndarray, weight: np.ndarray, saturation: float, corner_bin: np.ndarray,
    corner_part: np.ndarray, corner_precision: np.ndarray, corner_saturation: np.ndarray, scale_precision: float,
) -> np.ndarray:  # fmt: skip
    """The kernel's docstring in numpy and double precision."""
    at = (headings[:, None] + offset + stride * np.arange(len(seen))) % 360  # (V, n)
    d = log_ranges.astype(float)[:, at] - seen  # (P, V, n)
    scale = (weight * np.clip(d, -1.0, 1.0)).sum(axis=-1) / (scale_precision + weight.sum())
    ease = (saturation / (saturation + weight * (d - scale[..., None]) ** 2)) ** 2
    scale = (weight * ease * d).sum(axis=-1) / (scale_precision + (weight * ease).sum(axis=-1))
    q = precision * np.maximum(d - scale[..., None], least) ** 2
    cost = saturation * (q / (1.0 + q)).sum(axis=-1) + scale_precision * scale**2
    for bin_, part, own, most in zip(corner_bin, corner_part, corner_precision, corner_saturation, strict=True):
        near, far = corner_deg[:, (headings + bin_) % 360], corner_deg[:, (headings + bin_ + 1) % 360]
        q = own * ((1.0 - part) * near + part * far) ** 2
        cost = cost + q * most / (q + most)
    return -0.5 * cost


@pytest.mark.parametrize("stride", [1, 3])
@pytest.mark.parametrize("corners", [0, 3])
def test_kernel_equals_a_plain_restatement(stride: int, corners: int) -> None:
    rng = np.random.default_rng(stride + corners)
    n, as32 = 31, np.float32
    precision = rng.uniform(0.0, 300.0, n) * (rng.random(n) < 0.8)
    limited = rng.random(n) < 0.2
    args = (
        rng.uniform(-1.0, 2.5, (9, 360)).astype(as32),
        rng.uniform(0.0, 12.0, (9, 360)).astype(as32),
        np.concatenate([np.arange(0, 360, 7), [359]]),
        -54,
        stride,
        rng.uniform(-1.0, 2.5, n).astype(as32),
        (precision / 9.0).astype(as32),
        np.where(limited, 0.0, -1e6).astype(as32),
        (np.where(limited, 0.0, precision) * 0.3).astype(as32),
        as32(2.7),
        rng.integers(0, 360, corners),
        rng.random(corners).astype(as32),
        rng.uniform(0.1, 5.0, corners).astype(as32),
        np.full(corners, 4.0, as32),
        as32(30.0),
    )
    plain = plain_volume(*args)
    used = list(args)
    used[1] = args[1] if corners else args[1][:0]
    np.testing.assert_allclose(likelihood_volume(*used), plain, rtol=2e-5, atol=2e-4)  # float32 sums


def test_volume_of_rows_and_headings_is_part_of_the_whole() -> None:
    seen = views()[0][3]
    whole = likelihood().volume(seen)
    assert whole.shape == (len(FIELD.positions), 360) and whole.dtype == np.float32 and np.isfinite(whole).all()
    rows, headings = np.array([5, 400, 17]), np.array([-3, 0, 90, 362])
    part = likelihood().volume(seen, headings, rows=rows)
    np.testing.assert_allclose(part, whole[rows][:, headings % 360], atol=1e-4)


def test_peak_is_at_the_true_cell() -> None:
    """Noise-free views of unknown scale: the true cell is within 2 nats of the best, and mostly the best itself."""
    hits, told = 0, 0
    for _, row, degree, seen in views():
        if np.count_nonzero(np.isfinite(seen.variance)) < MANY_RAYS:
            continue
        volume = likelihood().volume(seen)
        p, v = np.unravel_index(int(np.argmax(volume)), volume.shape)
        told += 1
        near = np.hypot(*(FIELD.positions[p] - FIELD.positions[row])) < 0.15
        hits += near and abs((v - degree + 180) % 360 - 180) <= 1
        assert volume[row, degree] > volume.max() - 2.0
    assert told >= 30 and hits >= 0.75 * told


def test_a_wide_scale_prior_leaves_the_peak() -> None:
    """Ranges 20 % longer, heights unknown: the scale takes it up. With known heights it costs."""
    for _, row, degree, seen in views()[:8]:
        alone = replace(seen, is_corner=np.zeros_like(seen.is_corner), is_limit=np.zeros_like(seen.is_limit))
        alone = replace(alone, variance=np.where(seen.is_limit, np.inf, seen.variance), scale_sd=1.0)
        longer = replace(alone, log_range=alone.log_range + math.log(1.2))
        if np.count_nonzero(np.isfinite(alone.variance)) < MANY_RAYS:
            continue
        a, b = likelihood().volume(alone), likelihood().volume(longer)
        # The grid's error counts a little less at longer range, so neighbouring cells may swap.
        peak = np.unravel_index(int(np.argmax(b)), b.shape)
        assert a[peak] > a.max() - 0.5
        assert b[row, degree] > a[row, degree] - 0.5
        here = np.array([row])
        c, d = (likelihood().volume(replace(o, scale_sd=0.01), rows=here)[0, degree] for o in (alone, longer))
        assert d < c - 1.0


def test_corner_distances_equal_brute_force() -> None:
    rng = np.random.default_rng(1)
    positions = rng.uniform(0.0, 5.0, (20, 2))
    corners = rng.uniform(0.0, 5.0, (30, 2))
    ranges = rng.uniform(0.5, 6.0, (20, 360)).astype(np.float32)
    got = corner_distances(positions, ranges, corners)
    for p, here in enumerate(positions):
        best = np.full(360, FAR_DEG)
        for d in corners - here:
            bearing = math.degrees(math.atan2(d[1], d[0])) % 360.0
            both = ranges[p, [int(bearing) % 360, (int(bearing) + 1) % 360]]
            if np.hypot(*d) >= 0.05 and np.hypot(*d) <= 1.02 * both.max() + 0.05:
                best = np.minimum(best, np.abs((np.arange(360) - bearing + 180.0) % 360.0 - 180.0))
        np.testing.assert_allclose(got[p], best, atol=1e-4)


def test_corners_raise_the_true_pose() -> None:
    """Corner evidence at the true cell costs less than half of what it costs on average."""
    for _, row, degree, seen in views()[:5]:
        if not seen.is_corner.any():
            continue
        bare = replace(seen, is_corner=np.zeros_like(seen.is_corner))
        evidence = likelihood().volume(seen) - likelihood().volume(bare)
        assert evidence[row, degree] > 0.5 * evidence.mean()


def test_blind_and_plain_observations() -> None:
    blind = seen_by(Wireframe.empty())
    assert blind.blind and np.isinf(blind.variance).all() and blind.share == 1.0
    volume = likelihood().volume(blind)
    np.testing.assert_array_equal(volume, 0.0)
    known = np.arange(109) % 2 == 0
    rays = Rays(np.where(known, 2.0, np.nan), known, np.full(109, np.nan))
    pose = views()[0][0]
    paper = solve_layout(visible_wireframe(PLAN, CAMERA, pose, 1.4, GRAVITY), CAMERA, GRAVITY, "paper")
    seen = observation(paper, rays)
    np.testing.assert_allclose(seen.variance[known], PLAIN_SD**2)
    assert len(seen.nodes) == 0 and not seen.blind and seen.share == pytest.approx(EFFECTIVE_RAYS / 55)
    assert np.isfinite(likelihood().volume(seen)).all()


def test_limits_charge_only_walls_that_are_farther() -> None:
    """A hidden wall at most 2 m away: cells with a nearer wall there are not charged, others are."""
    none = np.zeros(0, bool)
    variance, limited = np.full(109, np.inf), np.zeros(109, bool)
    variance[54], limited[54] = LIMIT_SD**2, True
    seen = Observation(
        np.where(limited, math.log(2.0), 0.0), variance, limited, -np.radians(np.arange(109) - 54), np.zeros((0, 2)),
        np.zeros((0, 0)), none, none.astype(np.int64), 0.1,
    )  # fmt: skip
    volume = likelihood().volume(seen)
    np.testing.assert_allclose(volume[FIELD.ranges < 2.0], 0.0, atol=1e-6)
    assert volume[FIELD.ranges > 3.0].max() < -1.0
