"""The true wireframe of a view against brute force."""

import math

import numpy as np
import pytest

from galoc import Camera, Floorplan, GalocError
from galoc.camera import azimuth
from galoc.types import BORDER, CORNER, OCCLUSION
from galoc_env.truth import visible_panels, visible_wireframe
from galoc_env.truth_kernel import nearest_hit

CAMERA = Camera.from_hfov(640, 480, 108)
PLANS = ("apartment", "gallery")


def poses(plan: Floorplan, count: int, seed: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    positions = plan.free_space(0.1).positions(0.3)
    return [np.array([*positions[rng.integers(len(positions))], rng.uniform(-np.pi, np.pi)]) for _ in range(count)]


@pytest.mark.parametrize("name", PLANS)
def test_panels_tell_the_range_of_every_ray(name: str) -> None:
    """At random azimuths the panel's straight line is the nearest wall, to 1 mm or a joint of a curved wall."""
    plan = Floorplan.load(name)
    rng = np.random.default_rng(1)
    checked = 0
    for pose in poses(plan, 30, 0):
        panels = visible_panels(plan, pose, -1.2, 1.2)
        assert all(a.azimuth[1] <= b.azimuth[0] + 1e-9 for a, b in zip(panels[:-1], panels[1:], strict=True))
        for a in rng.uniform(-1.19, 1.19, 50):
            inside = [p for p in panels if p.azimuth[0] <= a <= p.azimuth[1]]
            if not inside:  # in a sliver too narrow to be a panel
                continue
            checked += 1
            true, _ = nearest_hit(plan.segments, pose[0], pose[1], math.cos(pose[2] - a), math.sin(pose[2] - a))
            (x0, z0), (x1, z1) = inside[0].points()
            s, c = math.sin(a), math.cos(a)
            got = (x0 * (z1 - z0) - z0 * (x1 - x0)) / (s * (z1 - z0) - c * (x1 - x0))
            assert got == pytest.approx(true, rel=2e-3, abs=1e-3)
    assert checked > 1000


def test_hand_made_view() -> None:
    """A 6 x 4 m room with a 1 m deep screen on the right: every kind of end, at known azimuths."""
    room = [[0, 0, 6, 0], [6, 0, 6, 4], [6, 4, 0, 4], [0, 4, 0, 0], [4, 0, 4, 1]]
    plan = Floorplan.from_segments(np.array(room, float), ceiling_height=2.5)
    w = visible_wireframe(plan, CAMERA, (1.0, 2.0, 0.0), 1.5)
    bearing = -azimuth(CAMERA.rays_level(w.floor, (0.0, 0.0)))
    # Left to right: border, far left corner, far wall's end behind the screen, screen's end and foot, border.
    expected = [
        math.radians(54),
        math.atan2(2, 5),
        math.atan2(-1, 3),
        math.atan2(-1, 3),
        math.atan2(-2, 3),
        -0.942477796,
    ]
    np.testing.assert_allclose(bearing, expected, atol=1e-6)
    assert w.kind.tolist() == [BORDER, CORNER, OCCLUSION, CORNER, CORNER, BORDER]
    assert w.walls.tolist() == [[0, 1], [1, 2], [3, 4], [4, 5]]
    # The far left corner is 5 m ahead: floor 1.5 m below the eye, ceiling 1 m above.
    np.testing.assert_allclose(w.floor[1, 1] - CAMERA.cy, CAMERA.fx * 1.5 / 5.0, atol=1e-9)
    np.testing.assert_allclose(CAMERA.cy - w.ceiling[1, 1], CAMERA.fx * 1.0 / 5.0, atol=1e-9)


def test_occlusion_beside_its_occluder() -> None:
    """Every occluded end shares its azimuth with a nearer real end, or sits on a sliver too narrow to be a panel."""
    plan = Floorplan.load("apartment")
    for pose in poses(plan, 40, 3):
        panels = visible_panels(plan, pose, -1.2, 1.2)
        for left, right in zip(panels[:-1], panels[1:], strict=True):
            if abs(left.azimuth[1] - right.azimuth[0]) > 1e-9:
                continue
            kinds = {left.kind[1], right.kind[0]}
            assert kinds in ({CORNER}, {CORNER, OCCLUSION})
            if OCCLUSION in kinds:
                nearer = left if left.range[1] < right.range[0] else right
                assert (nearer.kind[1] if nearer is left else nearer.kind[0]) == CORNER


@pytest.mark.parametrize("tilt", [0.0, 0.05, 0.2])
@pytest.mark.parametrize("name", PLANS)
def test_flags_pixels_and_order(name: str, tilt: float) -> None:
    plan = Floorplan.load(name)
    rng = np.random.default_rng(2)
    for pose in poses(plan, 40, 5):
        gravity = (float(rng.uniform(-tilt, tilt)), float(rng.uniform(-tilt, tilt)))
        w = visible_wireframe(plan, CAMERA, pose, 1.4, gravity)
        inside = (-0.5 - 1e-6, -0.5 - 1e-6), (CAMERA.width - 0.5 + 1e-6, CAMERA.height - 0.5 + 1e-6)
        for pixels in (w.ceiling, w.floor):
            assert np.all((pixels >= inside[0]) & (pixels <= inside[1]))
        hidden = ~w.ceiling_true & (w.kind != BORDER)
        on_edge = (np.abs(w.ceiling - inside[0]) < 1e-3) | (np.abs(w.ceiling - inside[1]) < 1e-3)
        assert np.all(on_edge[hidden].any(axis=1))
        border = w.kind == BORDER
        assert np.all(np.isin(np.round(w.ceiling[border, 0], 6), (-0.5, CAMERA.width - 0.5)))
        assert w.ceiling_cut is not None and w.floor_cut is not None
        for cut, true, pixels in ((w.ceiling_cut, w.ceiling_true, w.ceiling), (w.floor_cut, w.floor_true, w.floor)):
            real = true[w.walls] & ~border[w.walls]
            assert np.all(np.isnan(cut[real]))  # a line whose corner is seen is not cut there
            seen_border = true[w.walls] & border[w.walls]
            if tilt == 0.0:
                np.testing.assert_allclose(cut[seen_border], pixels[w.walls][seen_border], atol=1e-6)
        if tilt == 0.0 and len(w):
            assert np.all(np.diff(w.floor[:, 0]) >= -1e-6)  # left to right


def test_junctions_project_plan_corners_under_tilt() -> None:
    """Un-tilting the true junctions puts ceiling above floor at the plan's own corner."""
    plan = Floorplan.load("apartment")
    gravity = (0.06, -0.04)
    corners = plan.segments.reshape(-1, 2)
    count = 0
    for pose in poses(plan, 40, 7):
        w = visible_wireframe(plan, CAMERA, pose, 1.4, gravity)
        for i in np.flatnonzero((w.kind == CORNER) & w.floor_true):
            ray = CAMERA.rays_level(w.floor[i], gravity)
            x, z = ray[[0, 2]] * (1.4 / ray[1])
            c, s = math.cos(pose[2]), math.sin(pose[2])
            seen = pose[:2] + z * np.array([c, s]) + x * np.array([s, -c])
            assert np.hypot(*(corners - seen).T).min() < 0.02  # m; crossing or straightened walls have no own corner
            count += 1
    assert count > 30


def test_blank_wall_close_up_has_no_junction() -> None:
    plan = Floorplan.from_segments(np.array([[0, 0, 8, 0], [8, 0, 8, 8], [8, 8, 0, 8], [0, 8, 0, 0]], float))
    w = visible_wireframe(plan, CAMERA, (4.0, 7.6, math.pi / 2), 1.4)
    assert w.kind.tolist() == [BORDER, BORDER] and not w.ceiling_true.any() and not w.floor_true.any()


def test_open_plan_sees_nothing_where_there_is_no_wall() -> None:
    plan = Floorplan.from_segments(np.array([[0, 0, 8, 0], [8, 0, 8, 1.0]], float))
    assert len(visible_wireframe(plan, CAMERA, (4.0, 4.0, math.pi / 2), 1.4)) == 0


@pytest.mark.parametrize("height", [0.0, -1.0, 2.6, math.nan])
def test_camera_must_be_inside_the_storey(height: float) -> None:
    with pytest.raises(GalocError, match="camera_height"):
        visible_wireframe(Floorplan.load("apartment"), CAMERA, (2.0, 2.0, 0.0), height)


def test_pose_must_be_finite() -> None:
    with pytest.raises(GalocError, match="pose"):
        visible_wireframe(Floorplan.load("apartment"), CAMERA, (2.0, math.nan, 0.0), 1.4)
