"""From wireframes to the wall chain: exact without noise, periodic in the gauge angle, silent without structure."""

import math

import numpy as np
import pytest

from galoc import Camera, Floorplan, GalocError, Layout, Wireframe
from galoc.detect.oracle import perturb
from galoc.layout import solve_layout
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
        layout = solve_layout(wireframe, CAMERA, gravity)
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
            here, there = (solve_layout(noisy, CAMERA, gravity, theta=t) for t in (theta, theta + math.pi))
            if len(here.walls) == 0:
                continue
            np.testing.assert_allclose(there.points, here.points, rtol=1e-6, atol=1e-8 * np.abs(here.points).max())
            compared += 1
    assert compared >= 60


def test_gauge_and_indices_are_attached() -> None:
    for _, gravity, wireframe in views(10, 0.05, seed=1):
        layout = solve_layout(wireframe, CAMERA, gravity)
        if len(layout.walls) == 0:
            continue
        assert layout.gauge is not None and layout.method == "paper" and not layout.metric
        assert layout.gauge.flat and layout.gauge.points.shape == layout.points.shape
        assert layout.walls.max() < len(layout.points) and layout.arcs.shape == layout.walls.shape
        assert np.all(layout.heights > 0.0)
        fixed = solve_layout(wireframe, CAMERA, gravity, theta=0.3)
        assert fixed.gauge is not None and fixed.gauge.theta == 0.3
        still = solve_layout(wireframe, CAMERA, gravity, inscribed=False)
        assert still.gauge is not None
        np.testing.assert_array_equal(still.points, still.gauge.points)


def test_nothing_seen_is_an_abstaining_layout() -> None:
    blank = Floorplan.from_segments(np.array([[0, 0, 8, 0], [8, 0, 8, 8], [8, 8, 0, 8], [0, 8, 0, 0]], float))
    close_up = visible_wireframe(blank, CAMERA, (4.0, 7.6, math.pi / 2), 1.4)
    assert len(close_up.walls) == 1
    for wireframe in (Wireframe.empty(), close_up):
        layout = solve_layout(wireframe, CAMERA, (0.0, 0.0))
        assert isinstance(layout, Layout) and len(layout.walls) == len(layout.points) == 0 and layout.gauge is None


def test_unknown_method_and_nan_gravity_are_refused() -> None:
    wireframe = views(1, 0.0)[0][2]
    with pytest.raises(GalocError, match="method"):
        solve_layout(wireframe, CAMERA, (0.0, 0.0), method="best")
    for gravity in ((math.nan, 0.0), (0.0, math.nan)):
        with pytest.raises(GalocError, match="gravity"):
            solve_layout(wireframe, CAMERA, gravity)
