"""From wireframes to the wall chain: exact without noise, calibrated with it, silent without structure."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from galoc import Camera, Floorplan, GalocError, Layout, Wireframe
from galoc.detect.oracle import perturb
from galoc.heights import Heights
from galoc.layout import solve_layout
from galoc.rays import cast_rays
from galoc.types import BORDER, Rays
from galoc_env.homes import generate
from galoc_env.truth import Panel, visible_panels, visible_wireframe

CAMERA = Camera.from_hfov(640, 480, 108)
PLAN = Floorplan.load("apartment")
View = tuple[np.ndarray, tuple[float, float], Wireframe]


def views(count: int, tilt: float, seed: int = 0) -> list[View]:
    rng = np.random.default_rng(seed)
    free = PLAN.free_space(0.1).positions(0.4)
    out = []
    for _ in range(count):
        pose = np.array([*free[rng.integers(len(free))], rng.uniform(-np.pi, np.pi)])
        gravity = (float(rng.uniform(-tilt, tilt)), float(rng.uniform(-tilt, tilt)))
        out.append((pose, gravity, visible_wireframe(PLAN, CAMERA, pose, 1.4, gravity)))
    return out


def on_panel(panel: Panel, azimuths: np.ndarray) -> np.ndarray:
    """(K, 2) m: where rays of these azimuths meet the panel's line."""
    a, b = panel.points()
    d, ray = b - a, np.stack([np.sin(azimuths), np.cos(azimuths)], axis=1)
    return ray * ((a[0] * d[1] - a[1] * d[0]) / (ray[:, 0] * d[1] - ray[:, 1] * d[0]))[:, None]


@pytest.mark.parametrize("tilt", [0.0, 0.05, 0.15])
def test_noise_free_layout_is_the_truth_up_to_scale(tilt: float) -> None:
    """Both ends of every known wall lie on the panel seen at the wall's middle azimuth, times one common scale."""
    checked = 0
    for pose, gravity, wireframe in views(40, tilt):
        layout = solve_layout(wireframe, CAMERA, gravity, "paper")
        panels = visible_panels(PLAN, pose, -1.4, 1.4)
        got, true = [], []
        for ends, arc in zip(layout.walls, layout.arcs, strict=True):
            panel = next(p for p in panels if p.azimuth[0] <= arc.mean() <= p.azimuth[1])
            got.append(layout.points[ends])
            true.append(on_panel(panel, arc))
        if not got:
            continue
        chain, plan = np.concatenate(got), np.concatenate(true)
        scale = float(np.sum(chain * plan) / np.sum(chain**2))
        assert scale > 0.0
        np.testing.assert_allclose(chain * scale, plan, atol=1e-5 * (1.0 + np.abs(plan).max()))
        np.testing.assert_allclose(layout.heights * scale, [PLAN.ceiling_height - 1.4, 1.4], rtol=1e-5)
        checked += 1
    assert checked >= 30


def test_theta_and_theta_plus_pi_give_one_birds_eye_view() -> None:
    rng, compared = np.random.default_rng(5), 0
    for _, gravity, wireframe in views(25, 0.05, seed=3):
        noisy = perturb(wireframe, CAMERA, 3.0, rng)
        for theta in np.radians([-70.0, -20.0, 15.0, 55.0]):
            here, there = (solve_layout(noisy, CAMERA, gravity, "paper", theta=t) for t in (theta, theta + math.pi))
            if len(here.walls) == 0:
                continue
            np.testing.assert_allclose(there.points, here.points, rtol=1e-6, atol=1e-8 * np.abs(here.points).max())
            compared += 1
    assert compared >= 60


def test_gauge_and_indices_are_attached() -> None:
    for _, gravity, wireframe in views(10, 0.05, seed=1):
        layout = solve_layout(wireframe, CAMERA, gravity, "paper")
        if len(layout.walls) == 0:
            continue
        assert layout.gauge is not None and layout.method == "paper" and not layout.metric
        assert layout.gauge.flat and layout.gauge.points.shape == layout.points.shape
        assert layout.walls.max() < len(layout.points) and layout.arcs.shape == layout.walls.shape
        assert np.all(layout.heights > 0.0)
        fixed = solve_layout(wireframe, CAMERA, gravity, "paper", theta=0.3)
        assert fixed.gauge is not None and fixed.gauge.theta == 0.3
        still = solve_layout(wireframe, CAMERA, gravity, "paper", inscribed=False)
        assert still.gauge is not None
        np.testing.assert_array_equal(still.points, still.gauge.points)


def test_nothing_seen_is_an_abstaining_layout() -> None:
    blank = Floorplan.from_segments(np.array([[0, 0, 8, 0], [8, 0, 8, 8], [8, 8, 0, 8], [0, 8, 0, 0]], float))
    close_up = visible_wireframe(blank, CAMERA, (4.0, 7.6, math.pi / 2), 1.4)
    assert len(close_up.walls) == 1
    for wireframe in (Wireframe.empty(), close_up):
        layout = solve_layout(wireframe, CAMERA, (0.0, 0.0), "paper")
        assert isinstance(layout, Layout) and len(layout.walls) == len(layout.points) == 0 and layout.gauge is None


def test_unknown_method_and_nan_gravity_are_refused() -> None:
    wireframe = views(1, 0.0)[0][2]
    with pytest.raises(GalocError, match="method"):
        solve_layout(wireframe, CAMERA, (0.0, 0.0), method="best")
    for gravity in ((math.nan, 0.0), (0.0, math.nan)):
        for frame in (wireframe, Wireframe.empty()):
            for method in ("ml", "paper"):
                with pytest.raises(GalocError, match="gravity"):
                    solve_layout(frame, CAMERA, gravity, method)
    for imu in (-0.1, math.nan):
        with pytest.raises(GalocError, match="imu_sigma_rad"):
            solve_layout(wireframe, CAMERA, (0.0, 0.0), imu_sigma_rad=imu)


HomeView = tuple[Floorplan, tuple[float, float], Wireframe, np.ndarray]
AZIMUTHS = -np.radians(np.arange(109) - 54)
"""Of the rays, rad."""


@cache
def home_views(count: int, seed: int, kind: str | None = None) -> list[HomeView]:
    """Three views of each of ``count`` generated homes: plan, true gravity, true wireframe, true range of each ray."""
    rng, out = np.random.default_rng(seed), []
    for home in range(count):
        plan = generate(100 * seed + home, kind=kind, split="test")
        free = plan.free_space(0.1).positions(0.4)
        for _ in range(3):
            pose = np.array([*free[rng.integers(len(free))], rng.uniform(-np.pi, np.pi)])
            gravity = (float(rng.uniform(-0.05, 0.05)), float(rng.uniform(-0.05, 0.05)))
            ranges = np.full(109, np.nan)
            for panel in visible_panels(plan, pose, -1.4, 1.4):
                inside = (AZIMUTHS >= panel.azimuth[0]) & (AZIMUTHS <= panel.azimuth[1])
                ranges[inside] = np.hypot(*on_panel(panel, AZIMUTHS[inside]).T)
            out.append((plan, gravity, visible_wireframe(plan, CAMERA, pose, 1.4, gravity), ranges))
    return out


def measured(view: HomeView, sigma: float, imu_deg: float, rng: np.random.Generator) -> tuple[Wireframe, np.ndarray]:
    """Wireframe and gravity with noise."""
    wireframe = perturb(view[2], CAMERA, sigma, rng)
    return wireframe, np.asarray(view[1]) + np.radians(imu_deg) * rng.standard_normal(2)


def test_ml_is_exact_without_noise() -> None:
    """Rays of which the layout is sure are true to 1e-3; the others, drawn to the prior, to 4 of their deviations."""
    compared, sure = 0, 0
    for _, gravity, wireframe, true in home_views(20, 1):
        exact = perturb(wireframe, CAMERA, 0.0, np.random.default_rng(0))
        rays = cast_rays(solve_layout(exact, CAMERA, gravity, imu_sigma_rad=0.0), CAMERA)
        known = rays.known & np.isfinite(true)
        if not known.any():
            continue
        ratio = (rays.range / true)[known]
        error, sd = np.abs(ratio / np.median(ratio) - 1.0), np.sqrt(rays.variance[known])
        assert np.all(error < 1e-3 + 4.0 * sd)
        assert error[sd < 0.01].max(initial=0.0) < 1e-3
        compared += len(error)
        sure += np.count_nonzero(error < 1e-3)
    assert compared > 4000 and sure > 0.98 * compared


def test_known_heights_make_it_metric() -> None:
    for plan, gravity, wireframe, true in home_views(20, 1)[:20]:
        exact = perturb(wireframe, CAMERA, 0.0, np.random.default_rng(0))
        known = Heights.known(1.4, plan.ceiling_height, sd=1e-3)
        layout = solve_layout(exact, CAMERA, gravity, imu_sigma_rad=0.0, heights=known)
        if len(layout.walls) == 0:
            continue
        rays = cast_rays(layout, CAMERA)
        sure = rays.known & np.isfinite(true) & ~(rays.variance > 0.01**2)
        assert layout.metric
        np.testing.assert_allclose(rays.range[sure], true[sure], rtol=2e-3)
        np.testing.assert_allclose(layout.heights, [plan.ceiling_height - 1.4, 1.4], rtol=2e-3)
        assert not solve_layout(exact, CAMERA, gravity).metric


def test_intervals_cover_the_truth() -> None:
    """2-sigma intervals of log range at 5 px and 1 degree: 95.4 % but for outliers' pull and curvature."""
    rng, inside = np.random.default_rng(5), []
    for view in home_views(20, 1):
        wireframe, gravity = measured(view, 5.0, 1.0, rng)
        heights = Heights.known(1.4, view[0].ceiling_height, sd=1e-3)
        rays = cast_rays(solve_layout(wireframe, CAMERA, gravity, heights=heights), CAMERA)
        known = rays.known & np.isfinite(view[3])
        inside.append(np.abs(np.log(rays.range[known] / view[3][known])) < 2.0 * np.sqrt(rays.variance[known]))
    share = np.mean(np.concatenate(inside))
    assert len(np.concatenate(inside)) > 4000
    assert 0.90 <= share <= 0.98


def test_limit_is_never_below_the_true_range() -> None:
    """A wall with a hidden line is at most as far as the border allows, to 2 %."""
    found = 0
    for plan, gravity, wireframe, true in home_views(20, 1):
        exact = perturb(wireframe, CAMERA, 0.0, np.random.default_rng(0))
        known = Heights.known(1.4, plan.ceiling_height, sd=1e-3)
        rays = cast_rays(solve_layout(exact, CAMERA, gravity, imu_sigma_rad=0.0, heights=known), CAMERA)
        if rays.limit is not None:
            limited = np.isfinite(rays.limit) & np.isfinite(true)
            assert not (limited & rays.known).any()
            assert np.all(rays.limit[limited] > 0.98 * true[limited])
            found += np.count_nonzero(limited)
    assert found > 300


def test_right_angles_help_in_right_angled_homes() -> None:
    """The wall-direction prior lowers the median ray error at 5 px and 1 degree."""
    rng, errors = np.random.default_rng(6), {True: list[float](), False: list[float]()}
    for view in home_views(15, 2, "rectilinear") * 2:
        wireframe, gravity = measured(view, 5.0, 1.0, rng)
        heights = Heights.known(1.4, view[0].ceiling_height)
        rays: dict[bool, Rays] = {
            on_grid: cast_rays(solve_layout(wireframe, CAMERA, gravity, on_grid=on_grid, heights=heights), CAMERA)
            for on_grid in (True, False)
        }
        both = rays[True].known & rays[False].known & np.isfinite(view[3])
        if both.any():
            for on_grid, cast in rays.items():
                errors[on_grid].append(float(np.median(np.abs(cast.range / view[3] - 1.0)[both])))
    assert np.median(errors[True]) < 0.95 * np.median(errors[False])


ROOM = Floorplan.from_segments(np.array([[0, 0, 6, 0], [6, 0, 6, 5], [6, 5, 0, 5], [0, 5, 0, 0]], float))


def test_walls_of_which_only_the_ceiling_line_is_seen_are_recovered() -> None:
    """Looking up by 25 degrees no floor is in the image; with known heights the ceiling lines give every wall."""
    gravity = (0.0, math.radians(25.0))
    wireframe = visible_wireframe(ROOM, CAMERA, (3.0, 2.0, math.pi / 2), 1.4, gravity)
    assert not wireframe.floor_true.any() and BORDER in wireframe.kind and len(wireframe.walls) == 3
    exact = perturb(wireframe, CAMERA, 0.0, np.random.default_rng(0))
    layout = solve_layout(exact, CAMERA, gravity, imu_sigma_rad=0.0, heights=Heights.known(1.4, 2.6, sd=1e-3))
    assert len(layout.walls) == 3
    rays = cast_rays(layout, CAMERA)
    ray = np.stack([np.sin(AZIMUTHS), np.cos(AZIMUTHS)], axis=1)
    with np.errstate(divide="ignore"):
        true = np.minimum(3.0 / np.abs(ray[:, 0]), 3.0 / ray[:, 1])  # 3 m ahead and to both sides
    assert rays.coverage > 0.9
    np.testing.assert_allclose(rays.range[rays.known], true[rays.known], rtol=2e-3)
    assert len(solve_layout(exact, CAMERA, gravity, "paper").walls) == 0


def test_a_border_pair_alone_measures_its_wall() -> None:
    """A wall across the whole image, cut by both edges: its two lines fix it, no corner needed."""
    wide = Floorplan.from_segments(np.array([[0, 0, 20, 0], [20, 0, 20, 9], [20, 9, 0, 9], [0, 9, 0, 0]], float))
    wireframe = visible_wireframe(wide, CAMERA, (10.0, 4.5, math.pi / 2), 1.4)
    assert np.all(wireframe.kind == BORDER) and wireframe.ceiling_true.all()
    layout = solve_layout(perturb(wireframe, CAMERA, 0.0, np.random.default_rng(0)), CAMERA, (0.0, 0.0))
    assert len(layout.walls) == 1
    depth = layout.points[:, 1] / math.sqrt(layout.heights.prod()) * math.sqrt(1.2 * 1.4)
    np.testing.assert_allclose(depth, 4.5, rtol=5e-3)


def test_ml_without_structure_abstains() -> None:
    blank = Wireframe.empty()
    assert len(solve_layout(blank, CAMERA, (0.0, 0.0)).points) == 0
    # A wall so near that neither of its lines is in the image: it is there, how near is not known.
    close = visible_wireframe(ROOM, CAMERA, (3.0, 4.6, math.pi / 2), 1.4)
    assert len(close.walls) == 1 and not (close.ceiling_true | close.floor_true).any()
    layout = solve_layout(close, CAMERA, (0.0, 0.0))
    rays = cast_rays(layout, CAMERA)
    assert len(layout.walls) == 0 and not rays.known.any()
    # Ends that leave the image and nothing else: azimuths, no depth.
    ends = Wireframe([[100, -0.5], [500, -0.5]], [[100, 479.5], [500, 479.5]], [0, 0], [0, 0], [[0, 1]])
    layout = solve_layout(ends, CAMERA, (0.0, 0.0))
    assert layout.method == "ml" and len(layout.walls) == 0 and np.isfinite(layout.points).all()
    np.testing.assert_allclose(
        layout.points[:, 0] / layout.points[:, 1], (np.array([100, 500]) - CAMERA.cx) / CAMERA.fx, atol=1e-6
    )


def test_noise_of_the_detector_is_used_or_estimated() -> None:
    rng, told, guessed = np.random.default_rng(7), [], []
    for view in home_views(20, 1):
        wireframe, gravity = measured(view, 5.0, 1.0, rng)
        if len(wireframe) >= 6:
            told.append(solve_layout(wireframe, CAMERA, gravity).sigma_px)
            guessed.append(solve_layout(replace(wireframe, sigma_px=None), CAMERA, gravity).sigma_px)
    np.testing.assert_allclose(told, 5.0, rtol=1e-12)
    assert np.median(guessed) == pytest.approx(5.0, rel=0.15)


def test_a_displaced_corner_is_flagged() -> None:
    rng, hits, tries = np.random.default_rng(8), 0, 0
    for view in home_views(20, 1):
        wireframe, gravity = measured(view, 2.0, 0.5, rng)
        both = np.flatnonzero(wireframe.ceiling_true & wireframe.floor_true & (wireframe.kind != BORDER))
        if len(both) < 5:
            continue
        wrong = both[len(both) // 2]
        ceiling = wireframe.ceiling.copy()
        ceiling[wrong] += (35.0, -30.0)
        layout = solve_layout(replace(wireframe, ceiling=ceiling), CAMERA, gravity)
        assert layout.flagged is not None
        hits += bool(layout.flagged[wrong])
        tries += 1
    assert tries >= 15 and hits >= 0.8 * tries


def nonsense(rng: np.random.Generator) -> Wireframe:
    """A wireframe of valid shape that no camera ever saw."""
    n, scale = int(rng.integers(1, 8)), rng.choice([1.0, 1.0, 5.0])
    u = np.sort(rng.uniform(0, 640, n))
    ceiling = np.stack([u + rng.normal(0, 5, n), rng.uniform(-0.5, 240, n)], axis=1) * scale
    floor = np.stack([u + rng.normal(0, 5, n), rng.uniform(240, 479.5, n)], axis=1) * scale
    if rng.random() < 0.1:
        ceiling, floor = floor, ceiling
    if rng.random() < 0.1:
        ceiling[:], floor[:] = ceiling[0], floor[0]
    walls = rng.integers(n, size=(int(rng.integers(n)), 2))
    walls = walls[walls[:, 0] != walls[:, 1]]
    shape = (len(walls), 2, 2)
    cuts = [
        np.where(rng.random((*shape[:2], 1)) < 0.5, rng.uniform(0, 640, shape), np.nan) if rng.random() < 0.7 else None
        for _ in range(2)
    ]
    sigma = None if rng.random() < 0.5 else rng.uniform(0, 8, (n, 2))
    return Wireframe(
        ceiling, floor, rng.random(n) < 0.7, rng.random(n) < 0.7, walls, rng.integers(0, 3, n), sigma, *cuts
    )


def test_nonsense_gives_sound_layouts() -> None:
    """Whatever the pixels say: finite numbers or an abstaining layout, known rays with ranges, no error."""
    rng, solved = np.random.default_rng(114), 0
    for trial in range(1500):
        gravity = rng.uniform(-1.2, 1.2, 2) if trial % 5 == 0 else rng.normal(0, 0.05, 2)
        layout = solve_layout(
            nonsense(rng), CAMERA, gravity, on_grid=bool(trial % 2), imu_sigma_rad=(0.0, 0.01, 0.1)[trial % 3],
            heights=(None, Heights.known(1.4, 2.6), Heights.under(2.6))[trial // 3 % 3],
        )  # fmt: skip
        rays = cast_rays(layout, CAMERA)
        assert np.isfinite(layout.points).all() and np.isfinite(layout.heights).all()
        assert np.all(rays.range[rays.known] > 0.0) and np.isfinite(rays.variance[rays.known]).all()
        if layout.covariance is not None:
            assert np.isfinite(layout.covariance).all() and np.diag(layout.covariance).min() >= 0.0
            assert layout.gravity is not None and np.abs(layout.gravity).max() < math.pi / 2
            solved += 1
    assert solved > 1000
