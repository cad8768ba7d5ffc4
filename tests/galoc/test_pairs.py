"""Bare pixel pairs to wall chains: exact without noise, calibrated with it, and never a raw error."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as example_settings
from hypothesis import strategies as st

from galoc import Camera, GalocError
from galoc._chain_kernel import (
    LINE,
    POINT,
    TIE,
    VERTICAL,
    grid_weights,
    levelling_matrix,
    measurement_rows,
    normal_equations,
)
from galoc._chain_solve import tls
from galoc.camera import levelling
from galoc.chain import SIGMA_PX, intrinsics, to_level, to_points
from galoc.heights import Heights
from galoc.pairs import PAIR_METHODS, PairSolution, solve_pairs

CAMERA = Camera.from_hfov(640, 480, 108)
UP, DOWN = 1.2, 1.4
"""Ceiling above and floor below the camera, m."""
UNIT = math.sqrt(UP * DOWN)
"""Metres per unit of a solution."""
View = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def project(points: np.ndarray, gravity: np.ndarray, camera: Camera = CAMERA, up: float = UP) -> list[np.ndarray]:
    """Ceiling and floor pixels (B, N, 2) of points (B, N, 2) under true gravity (B, 2)."""
    return [
        np.stack(
            [
                camera.project_level(np.stack([p[:, 0], np.full(len(p), y), p[:, 1]], axis=1), g)
                for p, g in zip(points, gravity, strict=True)
            ]
        )
        for y in (-up, DOWN)
    ]


def views(frames: int, n: int, seed: int, tilt_deg: float = 3.0) -> View:
    """Points (B, N, 2) in m, left to right, true gravity, and exact pixels; walls 2.6 to 6 m away."""
    rng = np.random.default_rng(seed)
    azimuth = np.sort(rng.uniform(-0.8, 0.8, (frames, n)), axis=1)
    distance = rng.uniform(2.6, 6.0, (frames, n))
    points = np.stack([distance * np.sin(azimuth), distance * np.cos(azimuth)], axis=-1)
    gravity = np.radians(rng.uniform(-tilt_deg, tilt_deg, (frames, 2)))
    return points, gravity, *project(points, gravity)


def noisy(view: View, sigma: float, imu_deg: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ceiling, floor and gravity as measured."""
    rng = np.random.default_rng(seed)
    _, gravity, ceiling, floor = view
    noise = sigma * rng.standard_normal((2, *ceiling.shape))
    return ceiling + noise[0], floor + noise[1], gravity + np.radians(imu_deg) * rng.standard_normal(gravity.shape)


def assert_sound(solution: PairSolution, n: int) -> None:
    """What the docstring promises of every solution."""
    frames = len(solution.points)
    assert solution.points.shape == (frames, n, 2) and solution.flagged.shape == (frames, n)
    assert np.isfinite(solution.heights).all() and np.all(solution.heights > 0.0)
    assert np.isfinite(solution.gravity).all() and not np.isnan(solution.sigma_px).any()
    np.testing.assert_allclose(solution.heights.prod(axis=1), 1.0, rtol=1e-12)
    assert not np.isinf(solution.points).any()
    if solution.covariance is not None:
        assert solution.covariance.shape == (frames, 2 * n, 2 * n) and np.isfinite(solution.covariance).all()


@pytest.mark.parametrize("method", ["ml", "tls"])
@pytest.mark.parametrize("n", [2, 3, 8])
def test_exact_pixels_and_gravity_give_the_exact_structure(method: str, n: int) -> None:
    points, gravity, ceiling, floor = views(40, n, n)
    found = solve_pairs(ceiling, floor, CAMERA, gravity, method=method, sigma_px=0.0, imu_sigma_rad=0.0)
    assert_sound(found, n)
    # 0 px counts as 0.25 px, and the weak priors of depth and height ratio draw in proportion to it.
    tolerance = 1e-3
    np.testing.assert_allclose(found.points * UNIT, points, rtol=tolerance, atol=tolerance)
    np.testing.assert_allclose(found.heights * UNIT, np.tile([UP, DOWN], (40, 1)), rtol=tolerance)
    np.testing.assert_allclose(found.gravity, gravity, atol=1e-5)
    assert not found.flagged.any()


def test_tilt_of_the_imu_is_recovered_from_exact_pixels() -> None:
    """IMU up to 3 degrees wrong, pixels exact: verticals and heights of eight pairs fix roll and pitch."""
    points, gravity, ceiling, floor = views(100, 8, 1)
    off = np.radians(np.random.default_rng(2).uniform(-3.0, 3.0, gravity.shape))
    found = solve_pairs(ceiling, floor, CAMERA, gravity + off, sigma_px=0.0, imu_sigma_rad=math.radians(3.0))
    assert np.abs(found.gravity - gravity).max() < math.radians(0.02)
    np.testing.assert_allclose(found.points * UNIT, points, rtol=3e-3, atol=3e-3)
    fixed = solve_pairs(ceiling, floor, CAMERA, gravity + off, sigma_px=0.0, imu_sigma_rad=0.0)
    assert np.abs(fixed.gravity - gravity).max() > math.radians(1.0)


def test_covariance_is_calibrated() -> None:
    """Over 600 frames with 2 px and 0.5 degrees: NEES per freedom near 1, 2-sigma coverage near 95.4 %.

    The bands allow for curvature (ranges are not linear in pixels), some 20 standard errors of NEES.
    """
    view = views(600, 8, 3)
    ceiling, floor, gravity = noisy(view, 2.0, 0.5, 4)
    found = solve_pairs(
        ceiling, floor, CAMERA, gravity, sigma_px=2.0, imu_sigma_rad=math.radians(0.5), heights=Heights(0.0, 0.0, 1, 1)
    )
    assert found.covariance is not None
    sound = ~found.flagged.any(axis=1)
    assert sound.mean() > 0.97
    # In (m, s) the errors are nearly Gaussian, in (x, z) not.
    m, s, covariance = to_level(found.points[sound], found.covariance[sound])
    true = view[0][sound] / UNIT
    error = np.stack([m - true[..., 0] / true[..., 1], s - 1.0 / true[..., 1]], axis=-1).reshape(len(m), -1)
    nees = np.einsum("bi,bij,bj->b", error, np.linalg.inv(covariance), error) / error.shape[1]
    assert 0.85 <= nees.mean() <= 1.2
    within = np.abs(error) < 2.0 * np.sqrt(np.einsum("bii->bi", covariance))
    assert 0.93 <= within.mean() <= 0.97


def test_gate_finds_a_displaced_junction_and_spares_the_others() -> None:
    view = views(400, 8, 5)
    ceiling, floor, gravity = noisy(view, 5.0, 1.0, 6)
    clean = solve_pairs(ceiling, floor, CAMERA, gravity, sigma_px=5.0)
    assert clean.flagged.mean() < 0.01  # 0.1 % per test, tested eight times
    rng = np.random.default_rng(7)
    wrong, angle, size = rng.integers(8, size=400), rng.uniform(0.0, 2.0 * np.pi, 400), rng.uniform(40.0, 80.0, 400)
    ceiling[np.arange(400), wrong] += (size * np.stack([np.cos(angle), np.sin(angle)])).T
    found = solve_pairs(ceiling, floor, CAMERA, gravity, sigma_px=5.0)
    hit = found.flagged[np.arange(400), wrong]
    spared = np.delete(found.flagged.ravel(), np.arange(400) * 8 + wrong)
    assert hit.mean() >= 0.8
    assert spared.mean() < 0.03
    np.testing.assert_array_equal(np.isnan(found.points).all(axis=-1), found.flagged)


@pytest.mark.parametrize("sigma", [1.0, 5.0, 12.0])
def test_noise_is_estimated_from_the_residuals(sigma: float) -> None:
    """The first guess of 5 px counts as four residuals beside the frame's own 4 N - 2 N - 1; within 10 % of that."""
    view = views(300, 10, 8)
    ceiling, floor, gravity = noisy(view, sigma, 0.5, 9)
    found = solve_pairs(ceiling, floor, CAMERA, gravity, imu_sigma_rad=math.radians(0.5))
    shrunk = math.sqrt((19.0 * sigma**2 + 4.0 * 5.0**2) / 23.0)
    assert np.median(found.sigma_px) == pytest.approx(shrunk, rel=0.1)
    told = solve_pairs(ceiling, floor, CAMERA, gravity, sigma_px=sigma)
    np.testing.assert_array_equal(told.sigma_px, sigma)


@pytest.mark.parametrize("method", ["ml", "tls"])
def test_one_sided_pairs_are_recovered_once_two_fix_the_ratio(method: str) -> None:
    points, gravity, ceiling, floor = views(60, 6, 10)
    rng = np.random.default_rng(11)
    seen = np.ones((2, 60, 6), dtype=bool)
    for f in range(60):
        half = rng.permutation(6)[:4]
        seen[rng.integers(2, size=4), f, half] = False
    ceiling[~seen[0]], floor[~seen[1]] = (0.0, 0.0), (639.0, 479.0)  # whatever an unseen junction says
    found = solve_pairs(
        ceiling, floor, CAMERA, gravity, method=method, sigma_px=0.0, imu_sigma_rad=0.0,
        ceiling_seen=seen[0], floor_seen=seen[1],
    )  # fmt: skip
    np.testing.assert_allclose(found.points * UNIT, points, rtol=2e-3, atol=2e-3)
    seen[:, :, 2] = False  # and a pair of which nothing is seen is not recovered
    blind = solve_pairs(
        ceiling, floor, CAMERA, gravity, method=method, sigma_px=0.0, ceiling_seen=seen[0], floor_seen=seen[1]
    )
    assert np.isnan(blind.points[:, 2]).all()
    assert_sound(blind, 6)


@pytest.mark.parametrize("method", ["ml", "tls", "paper"])
def test_metres_do_not_matter(method: str) -> None:
    """A world twice as large projects to the same pixels: the solution knows no metres."""
    points, gravity, ceiling, floor = views(5, 6, 12)
    twice = [
        np.stack(
            [
                CAMERA.project_level(np.stack([2.0 * p[:, 0], np.full(6, y), 2.0 * p[:, 1]], axis=1), g)
                for p, g in zip(points, gravity, strict=True)
            ]
        )
        for y in (-2.0 * UP, 2.0 * DOWN)
    ]
    a = solve_pairs(ceiling, floor, CAMERA, gravity, method=method)
    b = solve_pairs(*twice, CAMERA, gravity, method=method)
    np.testing.assert_allclose(b.points, a.points, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("method", ["ml", "tls"])
@pytest.mark.parametrize("known", [True, False])
def test_image_resolution_does_not_matter(method: str, known: bool) -> None:
    """The same view at twice the resolution, with twice the noise in px, gives the same layout."""
    view = views(50, 7, 13)
    ceiling, floor, gravity = noisy(view, 4.0, 1.0, 14)
    fine = Camera.from_hfov(1280, 960, 108)
    scale = lambda pixels: (pixels + 0.5) * 2.0 - 0.5  # noqa: E731  # pixel centres are at integers
    a = solve_pairs(ceiling, floor, CAMERA, gravity, method=method, sigma_px=4.0 if known else None)
    b = solve_pairs(scale(ceiling), scale(floor), fine, gravity, method=method, sigma_px=8.0 if known else None)
    np.testing.assert_allclose(b.points, a.points, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(b.gravity, a.gravity, atol=1e-9)
    np.testing.assert_allclose(b.sigma_px, 2.0 * a.sigma_px, rtol=1e-6)
    if a.covariance is not None and b.covariance is not None:
        np.testing.assert_allclose(b.covariance, a.covariance, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("method", PAIR_METHODS)
def test_batch_equals_one_by_one(method: str) -> None:
    ceiling, floor, gravity = noisy(views(12, 5, 15), 5.0, 1.0, 16)
    whole = solve_pairs(ceiling, floor, CAMERA, gravity, method=method)
    for f in range(12):
        one = solve_pairs(ceiling[f : f + 1], floor[f : f + 1], CAMERA, gravity[f], method=method)
        for name in ("points", "heights", "gravity", "flagged", "sigma_px", "covariance"):
            a, b = getattr(one, name), getattr(whole, name)
            if b is not None:
                np.testing.assert_allclose(a[0], b[f], rtol=1e-12, atol=1e-12, err_msg=name)


def test_closed_form_equals_the_svd() -> None:
    """Weighted by a wide prior only, total least squares is the first right singular vector."""
    rng = np.random.default_rng(17)
    for _ in range(20):
        s, k = rng.uniform(0.2, 0.5, 6), rng.uniform(-0.7, 0.7)
        y = s[:, None] * np.exp([-0.5 * k, 0.5 * k]) + 0.01 * rng.standard_normal((6, 2))
        first = np.linalg.svd(y)[2][0]
        found, depth = tls(y[:, 0], y[:, 1], 0.0, 1e4, 0.01)
        assert found == pytest.approx(math.log(first[1] / first[0]), abs=1e-7)
        unit = np.exp([-0.5 * found, 0.5 * found])
        np.testing.assert_allclose(depth, y @ unit / (unit @ unit), rtol=1e-12)


def plain_closed_form(ceiling: np.ndarray, floor: np.ndarray, gravity: np.ndarray, sigma: float) -> np.ndarray:
    """(N, 2) points of one frame, from rays and an SVD, with the default prior of the height ratio."""
    rays = [CAMERA.rays_level(x, gravity) for x in (ceiling, floor)]
    y = np.stack([-rays[0][:, 1] / rays[0][:, 2], rays[1][:, 1] / rays[1][:, 2]], axis=1)
    m = 0.5 * (rays[0][:, 0] / rays[0][:, 2] + rays[1][:, 0] / rays[1][:, 2])
    k, s = tls(y[:, 0], y[:, 1], Heights().k, Heights().k_sd, sigma / CAMERA.fx)
    return np.stack([m / s, 1.0 / s], axis=1)


def test_batch_of_closed_forms_equals_a_plain_one() -> None:
    ceiling, floor, gravity = noisy(views(30, 6, 18), 5.0, 1.0, 19)
    found = solve_pairs(ceiling, floor, CAMERA, gravity, method="tls", sigma_px=5.0)
    for f in range(30):
        want = plain_closed_form(ceiling[f], floor[f], gravity[f], 5.0)
        np.testing.assert_allclose(found.points[f], want, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("n", [1, 2])
@pytest.mark.parametrize("method", ["ml", "tls"])
def test_one_or_two_pairs(n: int, method: str) -> None:
    ceiling, floor, gravity = noisy(views(50, n, 20), 5.0, 1.0, 21)
    found = solve_pairs(ceiling, floor, CAMERA, gravity, method=method)
    assert_sound(found, n)
    assert np.isfinite(found.points).all()  # a third of two pairs is none: the gate refuses nothing


def odd_views() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Ceiling and floor pixels of frames that are degenerate or wrong, N = 4."""
    x = np.linspace(-2.0, 2.0, 4)
    wall = np.stack([x, np.full(4, 3.0)], axis=1)[None]
    level = np.zeros((1, 2))
    p, q = project(wall, level)
    twin = project(wall[:, [0, 1, 1, 3]], level)
    edge = (p.copy(), q.copy())
    edge[0][0, 0, 0] = edge[1][0, 0, 0] = -0.5
    edge[0][0, 3, 0] = edge[1][0, 3, 0] = 639.5
    below = project(wall, level, up=-0.3)
    horizon = np.full((1, 4, 2), 239.5)
    horizon[..., 0] = np.linspace(50.0, 600.0, 4)
    return {
        "one wall": (p, q),
        "duplicates": (twin[0], twin[1]),
        "image edge": edge,
        "ceiling below the camera": (below[0], below[1]),
        "swapped": (q, p),
        "on the horizon": (horizon, horizon),
        "all at one pixel": (np.full((1, 4, 2), 100.0), np.full((1, 4, 2), 400.0)),
        "far outside": (p * 50.0 - 4e3, q * 50.0),
        "crossed": (p[:, ::-1], q),
    }


@pytest.mark.parametrize("name", odd_views())
@pytest.mark.parametrize("method", ["ml", "tls"])
@pytest.mark.parametrize("sigma", [None, 5.0])
def test_odd_frames_give_sound_solutions(name: str, method: str, sigma: float | None) -> None:
    ceiling, floor = odd_views()[name]
    found = solve_pairs(ceiling, floor, CAMERA, np.zeros((1, 2)), method=method, sigma_px=sigma)
    assert_sound(found, 4)
    if name in ("one wall", "image edge"):
        np.testing.assert_allclose(found.points[0, :, 1] * UNIT, 3.0, rtol=0.02)


@given(
    pixels=st.lists(st.tuples(*[st.floats(-2e3, 3e3)] * 4), min_size=1, max_size=6),
    gravity=st.tuples(st.floats(-1.4, 1.4), st.floats(-1.4, 1.4)),
    sigma=st.sampled_from([None, 0.0, 5.0]),
    method=st.sampled_from(["ml", "tls"]),
    seen=st.integers(0, 4095),
)
@example_settings(max_examples=150)
def test_any_pixels_give_a_sound_solution(
    pixels: list[Any], gravity: Any, sigma: float | None, method: str, seen: int
) -> None:
    table = np.array(pixels)[None]
    n = table.shape[1]
    bits = np.array([seen >> i & 1 for i in range(12)], dtype=bool)
    found = solve_pairs(
        table[..., :2], table[..., 2:], CAMERA, np.array([gravity]), method=method, sigma_px=sigma,
        ceiling_seen=bits[None, :n], floor_seen=bits[None, 6 : 6 + n],
    )  # fmt: skip
    assert_sound(found, n)


def test_wrong_input_is_refused() -> None:
    _, gravity, ceiling, floor = views(3, 4, 22)
    nan = ceiling.copy()
    nan[0, 0, 0] = np.nan
    bad: list[tuple[tuple[Any, Any, Any], dict[str, Any], str]] = [
        ((ceiling[0], floor, gravity), {}, "ceiling"),
        ((ceiling, floor[:, :3], gravity), {}, "floor"),
        ((ceiling[:, :0], floor[:, :0], gravity), {}, "ceiling"),
        ((nan, floor, gravity), {}, "ceiling"),
        ((ceiling, "floor", gravity), {}, "floor"),
        ((ceiling, floor, gravity[:2]), {}, "gravity"),
        ((ceiling, floor, gravity * np.nan), {}, "gravity"),
        ((ceiling, floor, gravity + 2.0), {}, "gravity"),
        ((ceiling, floor, gravity), {"method": "best"}, "method"),
        ((ceiling, floor, gravity), {"sigma_px": -1.0}, "sigma_px"),
        ((ceiling, floor, gravity), {"sigma_px": math.inf}, "sigma_px"),
        ((ceiling, floor, gravity), {"imu_sigma_rad": math.nan}, "imu_sigma_rad"),
        ((ceiling, floor, gravity), {"ceiling_seen": np.ones((3, 3), bool)}, "ceiling_seen"),
    ]
    for args, options, name in bad:
        with pytest.raises(GalocError, match=name):
            solve_pairs(args[0], args[1], CAMERA, args[2], **options)


def test_no_frames_at_all() -> None:
    none = np.zeros((0, 4, 2))
    for method in PAIR_METHODS:
        assert solve_pairs(none, none, CAMERA, np.zeros((0, 2)), method=method).points.shape == (0, 4, 2)


def test_covariance_of_points_is_that_of_the_level_plane() -> None:
    rng = np.random.default_rng(23)
    m, s = rng.uniform(-1.0, 1.0, 3), rng.uniform(0.2, 1.0, 3)
    root = rng.standard_normal((6, 6))
    points, spread = to_points(m, s, root @ root.T)
    step, jacobian = 1e-6, np.empty((6, 6))
    for q in range(6):
        moved = np.stack([m, s], axis=1).ravel()
        moved[q] += step
        jacobian[:, q] = (to_points(moved[::2], moved[1::2], np.eye(6))[0] - points).ravel() / step
    np.testing.assert_allclose(spread, jacobian @ root @ root.T @ jacobian.T, rtol=1e-3, atol=1e-3)
    back = to_level(points, spread)
    for got, want in zip(back, (m, s, root @ root.T), strict=True):
        np.testing.assert_allclose(got, want, rtol=1e-9, atol=1e-9)


def test_levelling_matrix_is_the_cameras() -> None:
    for gravity in np.random.default_rng(24).uniform(-1.0, 1.0, (10, 2)):
        np.testing.assert_allclose(levelling_matrix(*gravity), levelling(gravity), atol=1e-15)


def residual(
    kind: int, row: int, along_v: float, pixel: np.ndarray, theta: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (R,) and Jacobian (R, 2N+4) of one measurement of node 0 or of the wall from node 0 to 1, N = 3."""
    res, jac, at = np.zeros(2), np.zeros((2, 7)), np.zeros(7, np.int64)
    rows, count = measurement_rows(
        0, np.array([kind]), np.array([0]), np.array([1]), np.array([row]), np.array([[*pixel, along_v]]), theta, 3,
        levelling_matrix(theta[7], theta[8]), intrinsics(CAMERA), res, jac, at,
    )  # fmt: skip
    full = np.zeros((rows, 10))
    for q in range(count):
        full[:, at[q]] += jac[:rows, q]
    return res[:rows].copy(), full


@pytest.mark.parametrize("kind", [POINT, VERTICAL, LINE, TIE])
@pytest.mark.parametrize("row", [0, 1])
def test_jacobians_equal_finite_differences(kind: int, row: int) -> None:
    """Central differences of the prediction at true pixels; a residual is observed minus predicted."""
    rng = np.random.default_rng(25)
    for _ in range(20):
        m, s = np.sort(rng.uniform(-1.0, 1.0, 3)), rng.uniform(0.2, 0.6, 3)
        theta = np.array([m[0], s[0], m[1], s[1], m[2], s[2], rng.uniform(-0.5, 0.5), *rng.uniform(-0.2, 0.2, 2), 0.0])
        height = (-1.0, 1.0)[row] * math.exp((-0.5, 0.5)[row] * theta[6])
        share = rng.uniform(0.2, 0.8) if kind == LINE else 0.0
        mu, depth = m[0] + share * (m[1] - m[0]), s[0] + share * (s[1] - s[0])
        pixel = CAMERA.project_level(np.array([[mu, height * depth, 1.0]]), theta[7:9])[0]
        along_v = float(rng.integers(2))
        value, jacobian = residual(kind, row, along_v, pixel, theta)
        if kind != TIE:
            np.testing.assert_allclose(value, 0.0, atol=1e-6)
        numeric, step = np.empty_like(jacobian), 1e-6
        for q in range(10):
            up, down = theta.copy(), theta.copy()
            up[q] += step
            down[q] -= step
            difference = residual(kind, row, along_v, pixel, up)[0] - residual(kind, row, along_v, pixel, down)[0]
            numeric[:, q] = -difference / (2.0 * step)
        np.testing.assert_allclose(jacobian, numeric, rtol=1e-5, atol=1e-4 * max(1.0, np.abs(numeric).max()))


def test_first_guess_of_the_noise_scales_with_the_image() -> None:
    _, gravity, ceiling, floor = views(1, 2, 26)
    found = solve_pairs(ceiling, floor, CAMERA, gravity, method="tls")
    assert found.sigma_px[0] == pytest.approx(SIGMA_PX * 640)


def test_normal_equations_equal_plain_sums() -> None:
    """Cost, gradient (minus half its derivative) and information of junctions, priors and wall directions."""
    rng = np.random.default_rng(27)
    n, size = 3, 10
    kind, row = np.full(6, POINT), np.arange(6) % 2
    node, uv = np.repeat(np.arange(3), 2), np.zeros((6, 3))
    uv[:, :2] = rng.uniform(100.0, 400.0, (6, 2))
    sd, use = rng.uniform(2.0, 6.0, 6), np.array([True] * 5 + [False])
    prior, prior_sd = rng.uniform(-0.1, 0.1, size), rng.uniform(0.3, 2.0, size)
    walls, weight = np.array([[0, 1], [1, 2]]), np.array([0.9, 0.4])
    theta = np.array([-0.5, 0.4, 0.1, 0.5, 0.6, 0.3, 0.1, 0.05, -0.04, 0.02])

    def at(t: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        hess, grad = np.empty((size, size)), np.empty(size)
        cost = normal_equations(
            t,
            n,
            kind,
            node,
            node,
            row,
            uv,
            sd,
            use,
            intrinsics(CAMERA),
            prior,
            prior_sd,
            walls,
            weight,
            0.2,
            hess,
            grad,
        )
        return cost, grad, hess

    cost, grad, hess = at(theta)
    want, information = float(np.sum(((prior - theta) / prior_sd) ** 2)), np.diag(1.0 / prior_sd**2)
    rotation = levelling_matrix(theta[7], theta[8])
    for t in np.flatnonzero(use):
        res, jac, index = np.zeros(2), np.zeros((2, 7)), np.zeros(7, np.int64)
        rows, count = measurement_rows(
            t, kind, node, node, row, uv, theta, n, rotation, intrinsics(CAMERA), res, jac, index
        )
        full = np.zeros((2, size))
        full[:, index[:count]] = jac[:, :count]
        want += float(res @ res) / sd[t] ** 2
        information += full.T @ full / sd[t] ** 2
    points = np.stack([theta[:6:2], np.ones(3)], axis=1) / theta[1:6:2, None]
    for (i, j), own in zip(walls, weight, strict=True):
        turn = math.atan2(*(points[j] - points[i])[::-1]) - theta[9]
        want += own * ((turn + math.pi / 4) % (math.pi / 2) - math.pi / 4) ** 2 / 0.2**2
    assert cost == pytest.approx(want, rel=1e-9)
    numeric = np.array([(at(theta + 1e-6 * e)[0] - at(theta - 1e-6 * e)[0]) / 2e-6 for e in np.eye(size)])
    np.testing.assert_allclose(grad, -0.5 * numeric, rtol=1e-4, atol=1e-3 * np.abs(numeric).max() * 1e-2)
    np.testing.assert_allclose(hess, hess.T, rtol=1e-12)
    added = hess - information  # what the two walls add has their rank
    assert np.linalg.matrix_rank(added, tol=1e-6 * np.abs(added).max()) == 2 and np.linalg.eigvalsh(added).min() > -1e-6


def test_grid_weights_find_the_walls_at_right_angles() -> None:
    """Four walls of a right-angled room at 20 degrees and one that is oblique by 20 more."""
    c, s = math.cos(math.radians(20.0)), math.sin(math.radians(20.0))
    steps = np.array([[1.5, 0.0], [0.0, 1.0], [1.0, 0.0], [0.0, -1.5], [c, s]])
    chain = np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)]) @ np.array([[c, s], [-s, c]]) + [-2.0, 4.0]
    theta = np.zeros(16)
    theta[:12:2], theta[1:12:2] = chain[:, 0] / chain[:, 1], 1.0 / chain[:, 1]
    walls = np.stack([np.arange(5), np.arange(1, 6)], axis=1)
    weight, direction = grid_weights(theta, 6, walls, 1e-8 * np.eye(16), math.radians(0.5), 0.8)
    np.testing.assert_allclose(weight[:4], 1.0, atol=0.05)
    assert weight[4] == 0.0
    assert (direction - math.radians(20.0) + 0.5) % (math.pi / 2) - 0.5 == pytest.approx(0.0, abs=1e-6)
    alone = grid_weights(theta, 6, walls[:1], 1e-8 * np.eye(16), math.radians(0.5), 0.8)[0]
    np.testing.assert_array_equal(alone, 0.0)  # one wall agrees with nobody
