"""docs/conventions.md, example by example: each computes the page's numbers with galoc and finds them on the page."""

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from galoc import Camera, GalocError, Layout, Rays, Wireframe
from galoc.camera import azimuth
from galoc.detect.strip import ROWS, columns_for, elevation_of, row_of
from galoc.rays import ray_count

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "conventions.md").read_text(encoding="utf-8")
EXAMPLES = {
    int(number): " ".join(text.replace("\n>", " ").split())
    for number, text in re.findall(r"^> \*\*Example (\d+)\.\*\* (.+?)$(?!\n> \S)", PAGE, re.MULTILINE | re.DOTALL)
}
TESTS: dict[int, Callable[[], list[str]]] = {}

CAMERA = Camera.from_hfov(640, 480, 90.0)
CORNER_PLAN = np.array([5.0, 3.0])
CAMERA_HEIGHT_M, CEILING_M = 1.4, 2.6


def example(number: int) -> Callable[[Callable[[], list[str]]], Callable[[], list[str]]]:
    """Register the computation of an example; it returns the phrases that its sentence must hold."""

    def register(compute: Callable[[], list[str]]) -> Callable[[], list[str]]:
        TESTS[number] = compute
        return compute

    return register


def level_from_plan(pose: tuple[float, float, float], points: np.ndarray, heights_m: np.ndarray) -> np.ndarray:
    """Plan points (N, 2) at heights (N,) in the level frame (x right, y down, z forward) of a camera at the pose."""
    x, y, heading = pose
    forward = np.array([math.cos(heading), math.sin(heading)])
    right = np.array([math.sin(heading), -math.cos(heading)])
    offset = points - [x, y]
    return np.stack([offset @ right, CAMERA_HEIGHT_M - heights_m, offset @ forward], axis=-1)


def see_corner(pose: tuple[float, float, float], roll_deg: float = 0.0, pitch_deg: float = 0.0) -> np.ndarray:
    """Pixels (2, 2) of the ceiling and floor end of the corner at (5, 3)."""
    ends = level_from_plan(pose, np.stack([CORNER_PLAN, CORNER_PLAN]), np.array([CEILING_M, 0.0]))
    return CAMERA.project_level(ends, np.radians([roll_deg, pitch_deg]))


def horizon_row(u: float, roll_deg: float, pitch_deg: float) -> float:
    """Row at which the level plane through the camera crosses column u."""
    rows = np.array([0.0, 1.0])
    heights = CAMERA.rays_level([[u, 0.0], [u, 1.0]], np.radians([roll_deg, pitch_deg]))[:, 1]
    return float(rows[0] - heights[0] / (heights[1] - heights[0]))  # a levelled ray's y is linear in v


@example(1)
def radians_inside() -> list[str]:
    return [f"`hfov_rad` = {CAMERA.hfov_rad:.4f}"]


@example(2)
def plan_point_from_a_pose() -> list[str]:
    right, _, forward = level_from_plan((1.0, 1.0, 0.0), CORNER_PLAN[None], np.zeros(1))[0]
    return [f"{forward:g} m ahead", f"{-right:g} m to the left"]


@example(3)
def intrinsics_and_edges() -> list[str]:
    left, right = np.degrees(azimuth(CAMERA.rays_camera([[-0.5, CAMERA.cy], [639.5, CAMERA.cy]])))
    assert CAMERA.fx == pytest.approx(CAMERA.fy, rel=0, abs=0)
    return [f"fx = fy = {CAMERA.fx:g}", f"({CAMERA.cx}, {CAMERA.cy})", f"azimuth {left:g} deg", f"has +{right:g} deg"]


@example(4)
def corner_at_its_pixels() -> list[str]:
    (cu, cv), (fu, fv) = see_corner((1.0, 1.0, 0.0))
    # The same view, from the other side of the conventions: turned by 90 degrees about the camera.
    turned = level_from_plan((1.0, 1.0, math.pi / 2), np.array([[-1.0, 5.0]]), np.array([CEILING_M]))
    assert CAMERA.project_level(turned, (0.0, 0.0))[0] == pytest.approx([cu, cv], abs=1e-9)  # px, rounding
    return [f"ceiling end at pixel ({cu:.1f}, {cv:.1f})", f"floor end at pixel ({fu:.1f}, {fv:.1f})"]


@example(5)
def pitch_sinks_the_horizon() -> list[str]:
    return [f"v = {horizon_row(319.5, 0, 0):.1f};", f"at v = {horizon_row(319.5, 0, 10):.1f}"]


@example(6)
def roll_raises_the_horizon_on_the_right() -> list[str]:
    return [
        f"v = {horizon_row(639.5, 5, 0):.1f} at the right image edge",
        f"v = {horizon_row(-0.5, 5, 0):.1f} at the left",
    ]


@example(7)
def azimuth_and_bearing() -> list[str]:
    angle = math.degrees(float(azimuth(CAMERA.rays_level([479.5, 239.5], (0.0, 0.0)))))
    # The bearing again without azimuths: rotate the ray into the plan and read its direction there.
    right, _, forward = CAMERA.rays_level([479.5, 239.5], (0.0, 0.0))
    direction = forward * np.array([0.0, 1.0]) + right * np.array([1.0, 0.0])  # heading 90: forward +y, right +x
    bearing = math.degrees(math.atan2(direction[1], direction[0]))
    assert bearing == pytest.approx(90.0 - angle, abs=1e-9)  # deg, rounding
    return [f"azimuth {angle:.2f} deg", f"plan bearing {bearing:.2f} deg"]


@example(8)
def rays_run_counter_clockwise() -> list[str]:
    nothing = np.full(109, np.nan)
    bearings = np.degrees(Rays(nothing, np.zeros(109, bool), nothing).bearings_rad)
    assert bearings[54] == 0.0
    # Through the camera, whose field of view comes back with rounding: 90 deg as 89.99999999999999.
    counts = {deg: ray_count(Camera.from_hfov(640, 480, deg).hfov_deg) for deg in (108, 90, 107)}
    return [
        *(f"{deg} deg gives {count}" for deg, count in counts.items()),
        f"ray 0 points {-bearings[0]:g} deg to the right",
        f"ray 108 points {bearings[108]:g} deg to the left",
    ]


@example(9)
def odometry_in_the_previous_body_frame() -> list[str]:
    from galoc_env.motion import move

    far_away = np.array([[100.0, 100.0, 101.0, 100.0]])
    moved = move(np.array([1.0, 1.0, math.pi / 2]), np.array([0.5, 0.2, math.radians(30)]), far_away)
    assert moved.odometry == pytest.approx([0.5, 0.2, math.radians(30)], abs=1e-12)
    x, y, heading = moved.pose
    return [f"to the pose ({x:g}, {y:g}, {math.degrees(heading):.0f} deg)"]


@example(10)
def pairs_are_plumb_after_levelling() -> list[str]:
    pixels = see_corner((1.0, 1.0, 0.0), roll_deg=-5, pitch_deg=10)
    angles = np.degrees(azimuth(CAMERA.rays_level(pixels, np.radians([-5.0, 10.0]))))
    assert angles[0] == pytest.approx(angles[1], abs=1e-9)  # deg, rounding
    return [f"u = {pixels[0, 0]:.1f} and", f"u = {pixels[1, 0]:.1f};", f"azimuth {angles[0]:.2f} deg"]


@example(11)
def junction_below_the_image() -> list[str]:
    ceiling, floor = see_corner((4.0, 2.5, 0.0))
    assert not CAMERA.contains(floor)
    edge = np.array([ceiling[0], CAMERA.height - 0.5])
    assert CAMERA.contains(edge)
    assert azimuth(CAMERA.rays_camera(edge)) == pytest.approx(float(azimuth(CAMERA.rays_camera(floor))), abs=1e-12)
    return [f"v = {floor[1]:.1f},", f"({edge[0]:.1f}, {edge[1]:.1f})"]


@example(12)
def strip_of_a_wide_camera() -> list[str]:
    assert ROWS == 128 and elevation_of(0) > 0 > elevation_of(ROWS - 1)
    rows = np.linspace(0, ROWS - 1, 50)
    assert row_of(elevation_of(rows)) == pytest.approx(rows, abs=1e-9)
    return [f"strip of {columns_for(Camera.from_hfov(640, 480, 108))} columns"]


@example(13)
def not_knowing_is_a_value() -> list[str]:
    return [f"has {len(Wireframe.empty())} pairs", f"has {len(Layout.unknown('paper').walls)} walls"]


@example(14)
def bad_input_is_explained() -> list[str]:
    with pytest.raises(GalocError) as caught:
        Camera.from_hfov(640, 480, hfov_deg=180)
    return [f'"{caught.value}"']


def test_every_example_on_the_page_is_computed_here() -> None:
    assert sorted(EXAMPLES) == sorted(TESTS) == list(range(1, len(TESTS) + 1))


@pytest.mark.parametrize("number", sorted(TESTS))
def test_example_holds(number: int) -> None:
    phrases = TESTS[number]()
    assert phrases
    for phrase in phrases:
        assert phrase in EXAMPLES[number], f"galoc computes: {phrase}"


def test_corner_seen_from_anywhere_points_back_at_itself(rng: np.random.Generator) -> None:
    """Pose, pixel, azimuth and bearing agree: heading - azimuth is the direction from the camera to the corner."""
    for _ in range(50):
        bearing, distance, offset = rng.uniform(-math.pi, math.pi), rng.uniform(0.5, 8), rng.uniform(-0.7, 0.7)
        place = CORNER_PLAN - distance * np.array([math.cos(bearing), math.sin(bearing)])
        pose = (float(place[0]), float(place[1]), bearing + offset)
        tilt_deg = rng.uniform(-8, 8, 2)
        pixels = see_corner(pose, *tilt_deg)
        rays = CAMERA.rays_level(pixels, np.radians(tilt_deg))
        # Both angles carry only rounding of numbers near 1.
        assert pose[2] - azimuth(rays) == pytest.approx([bearing, bearing], abs=1e-9)
        horizontal = np.hypot(rays[:, 0], rays[:, 2])
        assert rays[:, 1] / horizontal * distance == pytest.approx([CAMERA_HEIGHT_M - CEILING_M, CAMERA_HEIGHT_M])
