"""Observation rays: their number, order, ranges and known sector."""

import math

import numpy as np
import pytest

from galoc import Camera, Floorplan, Layout
from galoc.layout import solve_layout
from galoc.profiles import Caster
from galoc.rays import cast_rays, chain_rays, ray_count
from galoc_env.truth import visible_wireframe


@pytest.mark.parametrize(
    ("hfov_deg", "count"), [(108.0, 109), (80.0, 81), (106.26, 107), (91.0, 91), (90.0, 91), (1.0, 1)]
)
def test_ray_count_is_odd(hfov_deg: float, count: int) -> None:
    assert ray_count(hfov_deg) == count
    assert len(cast_rays(Layout.unknown("paper"), Camera.from_hfov(640, 480, max(hfov_deg, 1.0))).known) == count


def layout_of(points: list[list[float]], walls: list[list[int]]) -> Layout:
    """A chain whose arcs are those of its points."""
    xz = np.array(points, float)
    arcs = np.arctan2(xz[:, 0], xz[:, 1])[np.array(walls)]
    return Layout(xz, np.array(walls), arcs, np.ones(2), "paper")


def test_rays_run_from_right_to_left() -> None:
    """One wall on the right: only the first rays, of negative bearing, are known, and their ranges are its own."""
    rays = cast_rays(layout_of([[0.5, 3.0], [3.0, 3.0]], [[0, 1]]), Camera.from_hfov(640, 480, 90))
    bearing = np.arange(91) - 45
    np.testing.assert_allclose(np.degrees(rays.bearings_rad), bearing, atol=1e-12)
    start = -math.degrees(math.atan2(0.5, 3.0))
    assert rays.known.tolist() == (bearing <= start).tolist()
    np.testing.assert_allclose(rays.range[rays.known], 3.0 / np.cos(rays.bearings_rad[rays.known]), rtol=1e-12)
    assert np.isnan(rays.range[~rays.known]).all() and np.isnan(rays.variance).all()
    assert rays.coverage == pytest.approx(np.mean(bearing <= start))


def test_nearer_wall_hides_the_farther() -> None:
    rays = cast_rays(
        layout_of([[-4.0, 4.0], [4.0, 4.0], [-0.5, 2.0], [0.5, 2.0]], [[0, 1], [2, 3]]), Camera.from_hfov(640, 480, 80)
    )
    depth = rays.range * np.cos(rays.bearings_rad)
    near = np.abs(np.degrees(rays.bearings_rad)) < math.degrees(math.atan2(0.5, 2.0))
    np.testing.assert_allclose(depth, np.where(near, 2.0, 4.0), rtol=1e-12)


def test_a_gap_inside_the_arc_is_filled_from_its_own_wall() -> None:
    """The arc as measured reaches 2 degrees beyond the chain's points: those rays are known, on the wall's line."""
    chain = layout_of([[-1.0, 2.0], [1.0, 2.0]], [[0, 1]])
    wider = Layout(chain.points, chain.walls, chain.arcs + np.radians([[-2.0, 2.0]]), chain.heights, "paper")
    camera = Camera.from_hfov(640, 480, 80)
    few, many = cast_rays(chain, camera), cast_rays(wider, camera)
    assert np.count_nonzero(many.known) == np.count_nonzero(few.known) + 4
    np.testing.assert_allclose(many.range[many.known] * np.cos(many.bearings_rad[many.known]), 2.0, rtol=1e-12)


def test_no_wall_no_known_ray() -> None:
    rays = cast_rays(Layout.unknown("paper"), Camera.from_hfov(640, 480, 108))
    assert not rays.known.any() and rays.coverage == 0.0 and np.isnan(rays.range).all()


@pytest.mark.parametrize("name", ["apartment", "house"])
@pytest.mark.parametrize("hfov_deg", [80.0, 108.0])
def test_true_views_are_proportional_to_the_plan(name: str, hfov_deg: float) -> None:
    """At whole-degree headings, ray i is the plan's bin heading + i - (n - 1) / 2, times one scale."""
    plan, camera = Floorplan.load(name), Camera.from_hfov(640, 480, hfov_deg)
    rng = np.random.default_rng(4)
    free = plan.free_space(0.1).positions(0.4)
    caster, compared, outliers = Caster(plan), 0, 0
    for _ in range(40):
        xy, heading_deg = free[rng.integers(len(free))] + rng.uniform(-0.05, 0.05, 2), int(rng.integers(360))
        gravity = tuple(rng.uniform(-0.08, 0.08, 2))
        wireframe = visible_wireframe(plan, camera, np.array([*xy, math.radians(heading_deg)]), 1.4, gravity)
        rays = cast_rays(solve_layout(wireframe, camera, gravity, "paper"), camera)
        if not rays.known.any():
            continue
        n = len(rays.known)
        bins = (heading_deg + np.arange(n) - (n - 1) // 2) % 360
        ratio = (rays.range / caster(xy)[0][bins])[rays.known]
        outliers += np.count_nonzero(np.abs(ratio / np.median(ratio) - 1.0) > 1e-4)
        compared += len(ratio)
    assert compared > 1000
    # A pier or a niche narrower than 0.3 degrees is no panel of the wireframe, and a ray may happen to hit it.
    assert outliers <= compared * 1e-3


def test_chain_rays_equal_a_plain_cast_and_its_derivatives() -> None:
    """Nearest wall by solving for each crossing; variance from finite differences over the points."""
    rng = np.random.default_rng(5)
    azimuths = np.radians(np.arange(-50.0, 51.0, 2.5))
    for _ in range(10):
        own = np.sort(rng.uniform(-0.8, 0.8, 6))
        distance = rng.uniform(2.0, 6.0, 6)
        points = np.stack([distance * np.sin(own), distance * np.cos(own)], axis=1)
        walls = np.array([[0, 1], [1, 3], [2, 4], [4, 5]])
        root = 0.02 * rng.standard_normal((12, 12))

        def plain(xz: np.ndarray, walls: np.ndarray = walls) -> np.ndarray:
            out = np.full(len(azimuths), np.nan)
            for k, azimuth in enumerate(azimuths):
                ray, hits = np.array([math.sin(azimuth), math.cos(azimuth)]), []
                for a, b in xz[walls]:
                    t, u = np.linalg.solve(np.stack([ray, a - b], axis=1), a)
                    hits += [t] if 0.0 <= u <= 1.0 and t > 0.0 else []
                out[k] = math.log(min(hits)) if hits else math.nan
            return out

        log_range, variance = chain_rays(points, walls, azimuths, root @ root.T)
        want = plain(points)
        np.testing.assert_allclose(log_range, want, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(chain_rays(points, walls, azimuths)[0], want, rtol=1e-9, atol=1e-9)
        step = 1e-7
        jacobian = np.stack(
            [(plain((points.ravel() + step * row).reshape(-1, 2)) - want) / step for row in np.eye(12)], axis=1
        )
        smooth = np.abs(jacobian).max(axis=1) < 50.0  # a ray through a node goes either way
        known = np.isfinite(want) & smooth
        spread = np.einsum("ki,ij,kj->k", jacobian, root @ root.T, jacobian)
        np.testing.assert_allclose(variance[known], spread[known], rtol=1e-3, atol=1e-9)


def test_a_ray_along_a_walls_own_line_is_unknown() -> None:
    """The wall runs beside the middle ray, and its arc in the image is given too wide: they meet after 1e9 units."""
    beside = np.array([[1.0, 2.0], [1.0 - 2e-9, 4.0]])
    layout = Layout(beside, np.array([[0, 1]]), np.radians([[-20.0, 40.0]]), np.ones(2), "paper")
    rays = cast_rays(layout, Camera.from_hfov(640, 480, 90))
    middle = len(rays.known) // 2
    assert rays.known[middle - 10] and not rays.known[middle]
