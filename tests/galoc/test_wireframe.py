"""Corner completion, K/U arcs and the layout mask."""

from dataclasses import replace

import numpy as np
import pytest

from galoc import Camera, Floorplan, Wireframe
from galoc.types import BORDER
from galoc.wireframe import complete, layout_mask, mask_iou, true_corners
from galoc_env.truth import visible_panels, visible_wireframe

CAMERA = Camera.from_hfov(640, 480, 108)
PLAN = Floorplan.load("apartment")


def views(count: int, seed: int = 0, tilt: float = 0.08) -> list[tuple[np.ndarray, tuple[float, float], Wireframe]]:
    rng = np.random.default_rng(seed)
    positions = PLAN.free_space(0.1).positions(0.4)
    out = []
    for _ in range(count):
        pose = np.array([*positions[rng.integers(len(positions))], rng.uniform(-np.pi, np.pi)])
        gravity = (float(rng.uniform(-tilt, tilt)), float(rng.uniform(-tilt, tilt)))
        out.append((pose, gravity, visible_wireframe(PLAN, CAMERA, pose, 1.4, gravity)))
    return out


@pytest.mark.parametrize("tilt", [0.0, 0.08])
def test_noise_free_completion_lies_on_the_walls(tilt: float) -> None:
    """Every completed pair is a point of the true wall, ceiling straight above floor, whatever was cut off."""
    kinds = set()
    for pose, gravity, wireframe in views(60, tilt=tilt):
        full = complete(wireframe, CAMERA, gravity)
        kinds.update(full.j_true[full.known].tolist())
        panels = visible_panels(PLAN, pose, -1.2, 1.2)
        for ends in full.walls:
            ceiling = CAMERA.rays_level(full.ceiling[ends], gravity)
            floor = CAMERA.rays_level(full.floor[ends], gravity)
            top = ceiling[:, [0, 2]] * ((1.4 - PLAN.ceiling_height) / ceiling[:, [1]])
            bottom = floor[:, [0, 2]] * (1.4 / floor[:, [1]])
            scale = 1e-5 * (1.0 + np.abs(bottom).max())
            np.testing.assert_allclose(top, bottom, atol=scale)
            distance = min(_distance_to_line(p.points(), bottom) for p in panels)
            assert distance < scale
    assert {2, 4} <= kinds and (3 in kinds or tilt == 0.0)


def _distance_to_line(wall: np.ndarray, points: np.ndarray) -> float:
    d = (wall[1] - wall[0]) / np.hypot(*(wall[1] - wall[0]))
    r = points - wall[0]
    return float(np.abs(r[:, 0] * d[1] - r[:, 1] * d[0]).max())


def test_known_means_two_or_more_true_corners() -> None:
    for _, gravity, wireframe in views(60):
        full = complete(wireframe, CAMERA, gravity)
        assert np.all(full.j_true[full.known] >= 2)
        assert np.all(full.known[full.j_true == 4])
        assert len(full.walls) == full.known.sum()


def test_under_constrained_panels_are_left_alone() -> None:
    """Hide one whole side of every panel's ceiling and floor but one corner: j_true <= 1 everywhere, nothing known."""
    for _, gravity, wireframe in views(10):
        blind = replace(wireframe, floor_true=np.zeros(len(wireframe), bool), kind=np.full(len(wireframe), BORDER))
        full = complete(blind, CAMERA, gravity)
        assert full.j_true.max(initial=0) <= 1
        assert not full.known.any() and len(full.ceiling) == 0


def test_without_cuts_three_corners_still_complete() -> None:
    """j_true = 3 needs no line fragment: the wall's vanishing point gives the fourth corner."""
    pairs = np.array([[200.0, 150.0], [420.0, 120.0]])
    floor = np.array([[200.0, 350.0], [420.0, 470.0]])
    w = Wireframe(pairs, floor, [True, True], [True, False], [[0, 1]])
    full = complete(w, CAMERA, (0.0, 0.0))
    assert full.known.tolist() == [True] and true_corners(w).tolist() == [3]
    expected = CAMERA.cy + (350.0 - CAMERA.cy) * (120.0 - CAMERA.cy) / (150.0 - CAMERA.cy)
    np.testing.assert_allclose(full.floor[1], [420.0, expected], atol=1e-9)


def test_two_corners_without_a_line_stay_unknown() -> None:
    pairs, floor = np.array([[200.0, 150.0], [420.0, 120.0]]), np.array([[200.0, 479.5], [420.0, 479.5]])
    w = Wireframe(pairs, floor, [True, True], [False, False], [[0, 1]])
    assert not complete(w, CAMERA, (0.0, 0.0)).known.any()


def test_empty_wireframe_completes_to_nothing() -> None:
    full = complete(Wireframe.empty(), CAMERA, (0.0, 0.0))
    assert len(full.walls) == 0 and len(full.known) == 0


def test_mask_of_truth_covers_the_walls_only() -> None:
    """A pixel is in the mask exactly when its ray meets a wall between floor and ceiling."""
    pose, gravity, wireframe = views(1, seed=4)[0]
    mask = layout_mask(wireframe, CAMERA)
    rng = np.random.default_rng(0)
    pixels = rng.integers([5, 5], [635, 475], (400, 2))
    rays = CAMERA.rays_level(pixels.astype(float), gravity)
    panels = visible_panels(PLAN, pose, -1.2, 1.2)
    wrong = 0
    for (u, v), ray in zip(pixels, rays, strict=True):
        azimuth = np.arctan2(ray[0], ray[2])
        panel = next(p for p in panels if p.azimuth[0] <= azimuth <= p.azimuth[1])
        a, b = panel.points()
        t = (a[0] * (b - a)[1] - a[1] * (b - a)[0]) / (ray[0] * (b - a)[1] - ray[2] * (b - a)[0])
        y = ray[1] * t
        wrong += int(mask[v, u]) != int(-(PLAN.ceiling_height - 1.4) <= y <= 1.4)
    assert wrong <= 4  # pixels on a boundary line, 1 % of the sample


def test_iou() -> None:
    a, b = np.zeros((4, 4), np.uint8), np.zeros((4, 4), np.uint8)
    assert mask_iou(a, b) == 1.0
    a[:2], b[1:3] = 1, 1
    assert mask_iou(a, b) == pytest.approx(4 / 12)
