"""The dense likelihood against a plain restatement, and what it must and must not depend on."""

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from galoc import Camera, Floorplan, GalocError, Wireframe
from galoc._corner_kernel import CODE_DEG, FAR_DEG, corner_distances
from galoc._likelihood_kernel import likelihood_volume
from galoc.detect.oracle import perturb
from galoc.layout import solve_layout
from galoc.likelihood import MANY_RAYS, MOST_PRECISION, SATURATION, Likelihood
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
    ranges: np.ndarray, corner_code: np.ndarray, rows: np.ndarray, headings: np.ndarray, group: int,
    ray_bin: np.ndarray, rays: np.ndarray, limit_bin: np.ndarray, limits: np.ndarray, corner_bin: np.ndarray,
    corners: np.ndarray, saturation: float, scale_precision: float,
) -> np.ndarray:  # fmt: skip
    """The kernel's docstring in numpy and double precision."""
    wall, angle = np.log(ranges[rows].astype(float)), corner_code[rows].astype(float)

    def robust(q: np.ndarray) -> np.ndarray:
        return q / (1.0 + q)

    p = rays[1].astype(float)
    d = wall[:, (headings[:, None] + ray_bin) % 360] - rays[0]  # (R, V, n)
    s = (p * np.clip(d, -1.0, 1.0)).sum(axis=-1) / (p.sum() + scale_precision)
    ease = 1.0 / (1.0 + p * (d - s[..., None]) ** 2) ** 2
    s = (p * ease * d).sum(axis=-1) / ((p * ease).sum(axis=-1) + scale_precision)
    cost = robust(p * (d - s[..., None]) ** 2).sum(axis=-1) + scale_precision * s**2
    over = np.maximum(wall[:, (headings[:, None] + limit_bin) % 360] - limits[0] - s[..., None], 0.0)
    cost = saturation * (cost + robust(limits[1] * over**2).sum(axis=-1))
    for bin_, (part, own, most) in zip(corner_bin, corners.T.astype(float), strict=True):
        near = (1.0 - part) * angle[:, (headings + bin_) % 360] + part * angle[:, (headings + bin_ + 1) % 360]
        cost = cost + most * robust(own * near**2)
    mean: np.ndarray = np.log(np.exp(-0.5 * cost).reshape(len(rows), -1, group).mean(axis=-1))
    return mean


def random_case(seed: int, headings: np.ndarray, group: int, limits: int, corners: int) -> tuple[Any, ...]:
    """Arguments of the kernel: 9 positions, 32 rays of which the last three are there to fill up."""
    rng, as32 = np.random.default_rng(seed), np.float32
    told = np.arange(32) < 29
    return (
        rng.uniform(0.2, 12.0, (9, 360)).astype(as32),
        rng.integers(0, 241, (9, 360)).astype(np.uint8),
        np.array([8, 0, 3, 3, 5]),
        headings,
        group,
        rng.integers(0, 360, 32) * told,
        (np.stack([rng.uniform(-1.0, 2.5, 32), rng.uniform(0.0, 300.0, 32)]) * told).astype(as32),
        rng.integers(0, 360, limits),
        np.stack([rng.uniform(-1.0, 2.5, limits), rng.uniform(0.0, 30.0, limits)]).astype(as32),
        rng.integers(0, 360, corners),
        np.stack([rng.random(corners), rng.uniform(1e-4, 1e-2, corners), rng.uniform(1.0, 4.0, corners)]).astype(as32),
        as32(2.7),
        as32(30.0),
    )


ALL = np.arange(360)


@pytest.mark.parametrize("headings", [ALL, np.concatenate([ALL[::7], [359]]), ALL[:1]], ids=["all", "some", "one"])
@pytest.mark.parametrize(("limits", "corners"), [(0, 0), (7, 3)])
def test_kernel_equals_a_plain_restatement(headings: np.ndarray, limits: int, corners: int) -> None:
    """Single against double precision: costs of up to 100 are sums of float32 (largest of 500 000 scores: 8e-5)."""
    args = random_case(limits, headings, 1, limits, corners)
    np.testing.assert_allclose(likelihood_volume(*args), plain_volume(*args), rtol=0.0, atol=3e-4)


@pytest.mark.parametrize("group", [2, 5, 9, 360])
def test_cells_are_logs_of_mean_likelihoods(group: int) -> None:
    args = random_case(group, ALL, group, 3, 3)
    got = likelihood_volume(*args)
    assert got.shape == (5, 360 // group)
    np.testing.assert_allclose(got, plain_volume(*args), rtol=0.0, atol=3e-4)  # as above


def test_far_walls_and_sharp_rays_stay_finite() -> None:
    """Rays of the greatest precision that is used, before walls from 0.02 m to 1 km: nothing overflows."""
    args = list(random_case(0, ALL, 1, 4, 2))
    args[0] = np.geomspace(0.02, 1000.0, 9 * 360, dtype=np.float32).reshape(9, 360)
    args[6][1, :29] = MOST_PRECISION / SATURATION
    # Float32 rounds a log range to 3e-7, a thousandth of the standard deviation of such a ray, and there are 29.
    np.testing.assert_allclose(likelihood_volume(*args), plain_volume(*args), rtol=0.0, atol=0.03)


def test_volume_of_rows_and_headings_is_part_of_the_whole() -> None:
    seen = views()[0][3]
    whole = likelihood().volume(seen)
    assert whole.shape == (len(FIELD.positions), 360) and whole.dtype == np.float32 and np.isfinite(whole).all()
    rows, headings = np.array([5, 400, 17]), np.array([-3, 0, 90, 362])
    part = likelihood().volume(seen, headings, rows=rows)
    np.testing.assert_allclose(part, whole[rows][:, headings % 360], atol=1e-4)


@pytest.mark.parametrize("first", [0, 2, -1])
def test_cell_volume_is_the_mean_of_the_volume(first: int) -> None:
    seen = views()[0][3]
    rows = np.array([5, 400, 17])
    whole = np.roll(likelihood().volume(seen, rows=rows).astype(float), -first, axis=1).reshape(3, 72, 5)
    cells = likelihood().cell_volume(seen, 5, first_deg=first, rows=rows)
    np.testing.assert_allclose(cells, np.log(np.exp(whole).mean(axis=-1)), atol=1e-4)  # float32
    np.testing.assert_array_equal(likelihood().cell_volume(seen, 1, rows=rows), likelihood().volume(seen, rows=rows))


@pytest.mark.parametrize("group", [0, 7, -5, 2.5, True, "5"])
def test_bad_group_is_refused(group: Any) -> None:
    with pytest.raises(GalocError, match="group"):
        likelihood().cell_volume(views()[0][3], group)


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
        np.testing.assert_allclose(CODE_DEG * got[p], best, atol=0.5 * CODE_DEG + 1e-4)  # rounded to whole steps


def test_corners_raise_the_true_pose() -> None:
    """Corner evidence at the true cell costs less than half of what it costs on average."""
    for _, row, degree, seen in views()[:5]:
        if not seen.is_corner.any():
            continue
        bare = replace(seen, is_corner=np.zeros_like(seen.is_corner))
        evidence = likelihood().volume(seen) - likelihood().volume(bare)
        assert evidence[row, degree] > 0.5 * evidence.mean()


@pytest.mark.parametrize("far", [1.0, 4.0])
def test_a_corner_counts_by_its_range_wherever_it_is_in_the_image(far: float) -> None:
    """An exact corner is off by as much as a cell is wide at its range, whatever its azimuth."""
    azimuth = np.radians([-50.0, -20.0, 0.0, 35.0, 52.0])
    count, blank = len(azimuth), np.zeros(109)
    nodes = np.stack([np.tan(azimuth), 1.0 / (far * np.cos(azimuth))], axis=1)
    corner = np.ones(count, bool)
    seen = Observation(
        blank, blank + np.inf, blank > 0.0, -np.radians(np.arange(109) - 54), nodes, np.zeros((2 * count, 2 * count)),
        corner, corner.astype(np.int64), 0.1,
    )  # fmt: skip
    _, precision, most = likelihood()._corner_terms(seen)[1].astype(float)
    off = FIELD.resolution / math.sqrt(12.0) / far
    # Besides the cell, a tenth of a square degree for the whole degrees of headings and bearings. Float32.
    np.testing.assert_allclose(precision * most, CODE_DEG**2 / (math.degrees(off) ** 2 + 0.1), rtol=1e-5)


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
