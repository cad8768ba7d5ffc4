"""The paper's gauge: what is true of it, exactly (docs/geometry.md), and what the solver guarantees."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from galoc import Camera, Floorplan, GalocError
from galoc._gauge_kernel import refine, sigma_min_scan
from galoc.camera import levelling
from galoc.gauge import constraint_matrix, rotated, solve_gauge, solve_points
from galoc.wireframe import complete
from galoc_env.truth import visible_wireframe

CAMERA = Camera.from_hfov(640, 480, 108)


def exact_rays(seed: int, n: int = 6, tilt: float = 0.1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Levelled ceiling and floor rays of n random wall corners, K^-1 [u, v, 1] scaled, and their (x, z)."""
    rng = np.random.default_rng(seed)
    azimuth = np.sort(rng.uniform(-0.9, 0.9, n))
    distance = rng.uniform(1.5, 8.0, n)
    xz = np.stack([distance * np.sin(azimuth), distance * np.cos(azimuth)], axis=1)
    gravity = rng.uniform(-tilt, tilt, 2)
    rays = []
    for height in (-1.2, 1.4):
        level = np.stack([xz[:, 0], np.full(n, height), xz[:, 1]], axis=1)
        pixels = CAMERA.project_level(level, gravity)
        rays.append(CAMERA.rays_level(pixels, gravity))
    return rays[0], rays[1], xz


def noisy_rays(seed: int, sigma_px: float = 5.0) -> tuple[np.ndarray, np.ndarray]:
    """The same with independent pixel noise."""
    p, q, _ = exact_rays(seed)
    rng = np.random.default_rng(seed + 1000)
    noise = rng.normal(0.0, sigma_px / CAMERA.fx, (2, len(p), 2))
    p[:, :2] += noise[0]
    q[:, :2] += noise[1]
    return p, q


@pytest.mark.parametrize("seed", range(8))
def test_noise_free_matrix_is_the_same_at_every_theta(seed: int) -> None:
    """With exact gravity the constraints hold no yaw: A(theta) is constant and has rank N - 1."""
    p, q, _ = exact_rays(seed)
    reference = constraint_matrix(p, q, 0.0)[0]
    scale = np.linalg.norm(reference)
    for theta in np.radians([-170.0, -77.0, -20.0, 11.0, 63.0, 131.0]):
        a = constraint_matrix(p, q, theta)[0]
        # 1e-9: near theta = 90 deg - azimuth lambda is a ratio of two small numbers and loses a few digits.
        assert np.abs(a - reference).max() < 1e-9 * scale
        singular = np.linalg.svd(a, compute_uv=False)
        assert singular[-1] < 1e-9 * singular[0]
        assert singular[-2] > 1e-4 * singular[0]


@pytest.mark.parametrize("seed", range(8))
def test_spectrum_is_pi_periodic_under_noise(seed: int) -> None:
    p, q = noisy_rays(seed)
    for theta in np.radians([-80.0, -33.0, 5.0, 48.0]):
        here = np.linalg.svd(constraint_matrix(p, q, theta)[0], compute_uv=False)
        there = np.linalg.svd(constraint_matrix(p, q, theta + np.pi)[0], compute_uv=False)
        np.testing.assert_allclose(there, here, rtol=1e-9, atol=1e-12 * here[0])


@pytest.mark.parametrize("seed", range(8))
def test_scan_equals_svd(seed: int) -> None:
    """Sturm bisection on A^T A against a dense SVD; its absolute accuracy is about 1e-8 sigma_max."""
    p, q = noisy_rays(seed)
    thetas = np.radians(np.arange(-90.0, 90.0, 7.0))
    got = sigma_min_scan(p, q, thetas)
    for theta, value in zip(thetas, got, strict=True):
        singular = np.linalg.svd(constraint_matrix(p, q, theta)[0], compute_uv=False)
        assert abs(value - singular[-1]) < 1e-7 * singular[0]


def test_scan_skips_poles() -> None:
    p, q = noisy_rays(3)
    pole = np.arctan2(q[2, 2], q[2, 0])  # R_y(theta) turns this floor ray into the image plane
    assert abs(rotated(q, pole)[2, 2]) < 1e-12
    assert np.isinf(sigma_min_scan(p, q, np.array([pole]))[0])


@pytest.mark.parametrize("seed", range(8))
def test_flat_landscape_returns_theta_zero_and_the_true_structure(seed: int) -> None:
    p, q, xz = exact_rays(seed)
    gauge = solve_gauge(p, q)
    assert gauge.flat and gauge.theta == 0.0
    scale = np.linalg.norm(xz) / np.linalg.norm(gauge.points)
    # 1e-7 m on walls up to 8 m away: double precision through one SVD.
    np.testing.assert_allclose(gauge.points * scale, xz, atol=1e-7)


@pytest.mark.parametrize("seed", range(20))
def test_assembly_is_exactly_vertical_and_coplanar_under_noise(seed: int) -> None:
    gauge = solve_gauge(*noisy_rays(seed))
    assert np.array_equal(gauge.ceiling[:, [0, 2]], gauge.floor[:, [0, 2]])  # vertical: shared x and z, bit for bit
    assert np.all(gauge.ceiling[:, 1] == gauge.ceiling[0, 1])
    assert np.all(gauge.floor[:, 1] == gauge.floor[0, 1])
    assert gauge.ceiling[0, 1] < 0 < gauge.floor[0, 1]  # y points down


@pytest.mark.parametrize("seed", range(20))
def test_depths_minimize_the_residual(seed: int) -> None:
    """Z is the unit-norm minimizer of |A Z| (Eckart-Young-Mirsky): no other direction does better."""
    gauge = solve_gauge(*noisy_rays(seed))
    unit = gauge.Z / np.linalg.norm(gauge.Z)
    best = np.linalg.norm(gauge.matrix @ unit)
    assert best == pytest.approx(gauge.singular_values[-1], rel=1e-6)
    rng = np.random.default_rng(seed)
    for _ in range(20):
        other = unit + rng.normal(0.0, 0.05, len(unit))
        assert np.linalg.norm(gauge.matrix @ (other / np.linalg.norm(other))) >= best
    assert gauge.Z[0] == 1.0


@pytest.mark.parametrize("seed", range(20))
def test_theta_and_theta_plus_pi_give_one_structure(seed: int) -> None:
    p, q = noisy_rays(seed)
    theta = solve_gauge(p, q).theta
    here, there = (solve_gauge(p, q, theta=t).points for t in (theta, theta + np.pi))
    np.testing.assert_allclose(there, here, rtol=1e-7, atol=1e-9 * np.abs(here).max())


@pytest.mark.parametrize("seed", range(20))
def test_search_beats_the_scan_and_prefers_points_in_front(seed: int) -> None:
    gauge = solve_gauge(*noisy_rays(seed))
    assert gauge.negative_depths[np.argmin(np.abs(gauge.candidates - gauge.theta))] == gauge.negative_depths.min()
    first = np.linalg.svd(constraint_matrix(*noisy_rays(seed), gauge.candidates[0])[0], compute_uv=False)[-1]
    assert first <= gauge.scan_sigma_min.min() * (1 + 1e-9)


@pytest.mark.parametrize("factor", [1e-3, 40.0])
def test_scale_of_one_ray_scales_one_depth(factor: float) -> None:
    """A ray's length is not observable: scaling all rays leaves the shape of the structure alone."""
    p, q = noisy_rays(5)
    a, b = solve_gauge(p, q).points, solve_gauge(p * factor, q * factor).points
    np.testing.assert_allclose(b / np.linalg.norm(b), a / np.linalg.norm(a), atol=1e-6)


def test_true_views_are_flat_too() -> None:
    """The same on real views of a plan, through completion and tilt, not only on made-up corners."""
    plan = Floorplan.load("apartment")
    rng = np.random.default_rng(0)
    positions = plan.free_space(0.1).positions(0.4)
    seen = 0
    for _ in range(40):
        gravity = tuple(rng.uniform(-0.1, 0.1, 2))
        pose = np.array([*positions[rng.integers(len(positions))], rng.uniform(-np.pi, np.pi)])
        full = complete(visible_wireframe(plan, CAMERA, pose, 1.4, gravity), CAMERA, gravity)
        if len(full.ceiling) < 2:
            continue
        seen += 1
        gauge = solve_gauge(CAMERA.rays_level(full.ceiling, gravity), CAMERA.rays_level(full.floor, gravity))
        # Corners completed far outside the image lose digits in the projection, hence 1e-7 and not FLAT.
        assert gauge.singular_values[-1] < 1e-7 * gauge.singular_values[0]
    assert seen > 20


def test_levelling_keeps_the_optical_axis_at_azimuth_zero() -> None:
    axis = levelling((0.3, -0.2)) @ np.array([0.0, 0.0, 1.0])
    assert axis[0] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("shape", [(1, 3), (3, 2), (0, 3)])
def test_too_little_is_refused(shape: tuple[int, int]) -> None:
    with pytest.raises(GalocError, match="expected"):
        solve_gauge(np.ones(shape), np.ones(shape))


def test_nan_is_refused() -> None:
    p, q, _ = exact_rays(0)
    p[0, 0] = np.nan
    with pytest.raises(GalocError, match="finite"):
        solve_gauge(p, q)


def unit_points(p: np.ndarray, q: np.ndarray, **options: float) -> np.ndarray:
    """Points of solve_gauge in the unit of solve_points."""
    gauge = solve_gauge(p, q, **options)
    return gauge.points / np.sqrt(abs(gauge.ceiling[0, 1] * gauge.floor[0, 1]))


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("sigma_px", [0.0, 3.0, 12.0])
def test_batch_solve_equals_the_full_one(seed: int, sigma_px: float) -> None:
    """The kernel's null vectors against those of a dense SVD, noise-free (flat, theta 0) and noisy."""
    p, q = noisy_rays(seed, sigma_px)
    points, heights, theta = solve_points(p[None], q[None])
    want = unit_points(p, q)
    # 1e-9 of the layout's size: A^T A squares the condition of A, about 1e3 here.
    np.testing.assert_allclose(points[0], want, atol=1e-9 * np.abs(want).max())
    assert theta[0] == pytest.approx(solve_gauge(p, q).theta, abs=1e-9)
    assert heights[0, 0] > 0 and heights[0, 1] > 0 and heights[0].prod() == pytest.approx(1.0)
    fixed, _, angle = solve_points(p[None], q[None], theta=0.3)
    want = unit_points(p, q, theta=0.3)
    np.testing.assert_allclose(fixed[0], want, atol=1e-9 * np.abs(want).max())
    assert angle[0] == 0.3


@pytest.mark.parametrize("seed", range(8))
def test_refinement_equals_scipy(seed: int) -> None:
    p, q = noisy_rays(seed)
    start = solve_gauge(p, q).scan_theta[np.argmin(solve_gauge(p, q).scan_sigma_min)]
    low, high = start - np.radians(1.0), start + np.radians(1.0)

    def sigma(theta: float) -> float:
        return float(np.linalg.svd(constraint_matrix(p, q, theta)[0], compute_uv=False)[-1])

    wanted = minimize_scalar(sigma, bounds=(low, high), method="bounded", options={"xatol": 1e-7})
    # Near its minimum sigma_min changes by less than double precision over about 1e-5 rad.
    assert refine(p, q, low, high, 1e-7) == pytest.approx(wanted.x, abs=1e-4)
    assert sigma(refine(p, q, low, high, 1e-7)) == pytest.approx(wanted.fun, rel=1e-8)


def test_pairs_without_rays_are_left_out_of_a_batch() -> None:
    p, q = noisy_rays(1)
    gappy = np.stack([p, p, p])
    gappy[1, 2] = np.nan
    gappy[2, 1:] = np.nan
    points, heights, theta = solve_points(gappy, np.stack([q, q, q]))
    assert np.isfinite(points[0]).all()
    rest = np.arange(len(p)) != 2
    want = unit_points(p[rest], q[rest])
    np.testing.assert_allclose(points[1, rest], want, atol=1e-9 * np.abs(want).max())
    assert np.isnan(points[1, 2]).all()
    assert np.isnan(points[2]).all() and np.isnan(heights[2]).all() and np.isnan(theta[2])  # one pair is no wall


def test_batch_of_nothing_and_of_wrong_shape() -> None:
    points, heights, theta = solve_points(np.zeros((0, 4, 3)), np.zeros((0, 4, 3)))
    assert points.shape == (0, 4, 2) and heights.shape == (0, 2) and theta.shape == (0,)
    with pytest.raises(GalocError, match="expected"):
        solve_points(np.ones((4, 3)), np.ones((4, 3)))
