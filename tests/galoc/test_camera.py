"""The camera's formulas against geometry worked out by hand, and what it refuses."""

import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from galoc import Camera, GalocError
from galoc.camera import MAX_TILT, azimuth, levelling

ROUNDING = 1e-12
"""Relative error of a few float64 operations, with room for a dozen of them."""
PIXEL_ROUNDING = 1e-7
"""px. Float64 rounding (1e-16 relative) of pixel numbers near 1e3, times at most 1e4 by the steepest ray tested."""

HFOV_90 = Camera.from_hfov(640, 480, 90.0)
"""fx = fy = 320 px, principal point (319.5, 239.5)."""

TILT = st.floats(-math.radians(40), math.radians(40))
CAMERAS = st.builds(
    Camera,
    width=st.integers(16, 4000),
    height=st.integers(16, 4000),
    fx=st.floats(50, 4000),
    fy=st.floats(50, 4000),
    cx=st.floats(-100, 4100),
    cy=st.floats(-100, 4100),
)


# --- intrinsics -------------------------------------------------------------------------------------------------


def test_from_hfov_centres_the_principal_point_between_integer_pixel_centres() -> None:
    assert (HFOV_90.cx, HFOV_90.cy) == (319.5, 239.5)
    assert HFOV_90.fx == HFOV_90.fy == pytest.approx(320.0, rel=ROUNDING)
    odd = Camera.from_hfov(641, 481, 90.0)
    assert (odd.cx, odd.cy) == (320.0, 240.0)


@given(width=st.integers(1, 16384), hfov_deg=st.floats(1.0, 175.0))
def test_field_of_view_spans_the_pixel_edges(width: int, hfov_deg: float) -> None:
    camera = Camera.from_hfov(width, 100, hfov_deg)
    edges = azimuth(camera.rays_camera([[-0.5, camera.cy], [width - 0.5, camera.cy]]))
    # At 175 degrees d(angle)/d(tan) is small but tan is near 23: rounding of tan grows by about 25 on the way back.
    assert np.degrees(edges) == pytest.approx([-hfov_deg / 2, hfov_deg / 2], abs=1e-10)
    assert camera.hfov_deg == pytest.approx(hfov_deg, abs=1e-10)


def test_field_of_view_of_an_off_centre_camera_adds_both_sides() -> None:
    camera = Camera(640, 480, 320.0, 320.0, -0.5, 239.5)  # the optical axis passes through the left edge
    assert camera.hfov_deg == pytest.approx(math.degrees(math.atan(640 / 320)), abs=1e-10)


@given(camera=CAMERAS, u=st.floats(-1e4, 1e4), v=st.floats(-1e4, 1e4))
def test_matrix_and_rays_are_inverse(camera: Camera, u: float, v: float) -> None:
    ray = camera.rays_camera([u, v])
    assert ray[2] == 1.0
    assert camera.matrix @ ray == pytest.approx([u, v, 1.0], abs=PIXEL_ROUNDING)


def test_camera_is_hashable_comparable_and_pickles() -> None:
    again = pickle.loads(pickle.dumps(HFOV_90))
    assert again == HFOV_90
    assert hash(again) == hash(HFOV_90)


# --- levelling ------------------------------------------------------------------------------------------------


@given(roll=TILT, pitch=TILT)
def test_levelling_is_a_rotation_that_keeps_the_optical_axis_at_azimuth_0(roll: float, pitch: float) -> None:
    r_level_camera = levelling((roll, pitch))
    assert r_level_camera @ r_level_camera.T == pytest.approx(np.eye(3), abs=ROUNDING)
    assert np.linalg.det(r_level_camera) == pytest.approx(1.0, abs=ROUNDING)
    axis = r_level_camera @ [0.0, 0.0, 1.0]
    assert azimuth(axis) == 0.0
    # Elevation of the optical axis is the pitch itself, whatever the roll; y is down.
    assert math.asin(-axis[1]) == pytest.approx(pitch, abs=1e-9)


def test_level_camera_changes_nothing() -> None:
    assert np.array_equal(levelling((0.0, 0.0)), np.eye(3))


def test_positive_pitch_looks_up() -> None:
    centre = HFOV_90.rays_level([HFOV_90.cx, HFOV_90.cy], (0.0, 0.2))
    assert centre[1] < 0  # y is down
    horizon = HFOV_90.project_level([0.0, 0.0, 1.0], (0.0, 0.2))
    assert horizon[1] > HFOV_90.cy  # so the horizon sinks in the image


def test_positive_roll_lowers_the_right_side() -> None:
    right_of_camera = levelling((0.1, 0.0)) @ [1.0, 0.0, 0.0]
    assert right_of_camera[1] == pytest.approx(math.sin(0.1), abs=ROUNDING)  # y is down
    left, right = HFOV_90.project_level([[-1.0, 0.0, 1.0], [1.0, 0.0, 1.0]], (0.1, 0.0))
    assert right[1] < left[1]  # so the horizon rises to the right


@given(roll=TILT, pitch=TILT)
def test_gravity_in_the_camera_frame_reads_roll_and_pitch(roll: float, pitch: float) -> None:
    down = levelling((roll, pitch)).T @ [0.0, 1.0, 0.0]
    assert math.atan2(down[0], down[1]) == pytest.approx(roll, abs=1e-9)
    assert math.asin(-down[2]) == pytest.approx(pitch, abs=1e-9)


# --- projection -----------------------------------------------------------------------------------------------


@given(roll=TILT, pitch=TILT, u=st.floats(-0.5, 639.5), v=st.floats(-0.5, 479.5), depth=st.floats(0.1, 100))
def test_project_undoes_rays_at_any_depth_and_tilt(roll: float, pitch: float, u: float, v: float, depth: float) -> None:
    camera, gravity = Camera.from_hfov(640, 480, 108.0), (roll, pitch)
    points = camera.rays_level([u, v], gravity) * depth
    assert camera.project_level(points, gravity) == pytest.approx([u, v], abs=PIXEL_ROUNDING)


def test_rays_and_projection_take_any_batch_shape(rng: np.random.Generator) -> None:
    pixels = rng.uniform(0, 400, (3, 4, 2))
    rays = HFOV_90.rays_level(pixels, (0.1, -0.2))
    assert rays.shape == (3, 4, 3)
    assert azimuth(rays).shape == (3, 4)
    assert HFOV_90.project_level(rays, (0.1, -0.2)) == pytest.approx(pixels, abs=PIXEL_ROUNDING)
    assert rays[1, 2] == pytest.approx(HFOV_90.rays_level(pixels[1, 2], (0.1, -0.2)), abs=ROUNDING)


def test_points_at_or_behind_the_camera_have_no_pixel() -> None:
    pixels = HFOV_90.project_level([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]], (0.0, 0.0))
    assert np.isfinite(pixels[0]).all()
    assert np.isnan(pixels[1:]).all()
    # Level and ahead, yet behind the plane of a camera that looks 60 degrees up.
    steep = HFOV_90.project_level([0.0, 2.0, 1.0], (0.0, math.radians(60)))
    assert np.isnan(steep).all()


def test_azimuth_is_positive_to_the_right_and_covers_the_circle() -> None:
    rays = [[0.0, 0.0, 1.0], [1.0, 0.3, 1.0], [-1.0, -2.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]
    assert np.degrees(azimuth(rays)) == pytest.approx([0.0, 45.0, -45.0, 90.0, 180.0], abs=1e-9)


@given(v=st.floats(0, 479), roll=TILT, pitch=TILT, x=st.floats(-1, 1))
def test_azimuth_of_a_vertical_line_is_one_number_under_any_tilt(v: float, roll: float, pitch: float, x: float) -> None:
    gravity = (roll, pitch)
    vertical = np.array([[x, -1.0, 3.0], [x, 0.0, 3.0], [x, 1.0, 3.0]])
    pixels = HFOV_90.project_level(vertical, gravity)
    angles = azimuth(HFOV_90.rays_level(pixels, gravity))
    assert angles == pytest.approx([math.atan2(x, 3.0)] * 3, abs=1e-9)


def test_contains_takes_pixels_to_their_edges_and_no_nan() -> None:
    corners = [[-0.5, -0.5], [639.5, 479.5], [-0.51, 0.0], [639.51, 0.0], [0.0, -0.51], [0.0, 479.51]]
    assert HFOV_90.contains(corners).tolist() == [True, True, False, False, False, False]
    assert HFOV_90.contains([[np.nan, 1.0], [1.0, np.nan], [np.inf, 1.0]]).tolist() == [False] * 3


# --- refusals -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hfov_deg", [0, 180, -90, 360, 0.999, 175.001, math.nan, math.inf, "90", None, True, [90]])
def test_from_hfov_refuses_impossible_fields_of_view(hfov_deg: object) -> None:
    with pytest.raises(GalocError, match="hfov_deg") as caught:
        Camera.from_hfov(640, 480, hfov_deg)  # type: ignore[arg-type]
    assert "175" in caught.value.expected


@pytest.mark.parametrize("size", [0, -640, 640.0, "640", None, True, 16385, math.nan])
@pytest.mark.parametrize("which", ["width", "height"])
def test_image_size_is_a_whole_positive_number(size: object, which: str) -> None:
    good = {"width": 640, "height": 480}
    with pytest.raises(GalocError, match=which):
        Camera.from_hfov(**{**good, which: size}, hfov_deg=90.0)  # type: ignore[arg-type]
    with pytest.raises(GalocError, match=which):
        Camera(**{**good, which: size}, fx=320.0, fy=320.0, cx=319.5, cy=239.5)  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [math.nan, math.inf, "320", None, [320], 1j])
@pytest.mark.parametrize("which", ["fx", "fy", "cx", "cy"])
def test_intrinsics_are_finite_numbers(which: str, value: object) -> None:
    good: dict[str, object] = {"width": 640, "height": 480, "fx": 320.0, "fy": 320.0, "cx": 319.5, "cy": 239.5}
    with pytest.raises(GalocError, match=which):
        Camera(**{**good, which: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("focal", [0.0, -320.0])
@pytest.mark.parametrize("which", ["fx", "fy"])
def test_focal_lengths_are_positive(which: str, focal: float) -> None:
    good: dict[str, float] = {"fx": 320.0, "fy": 320.0, "cx": 319.5, "cy": 239.5}
    with pytest.raises(GalocError, match="focal length above 0"):
        Camera(640, 480, **{**good, which: focal})


def test_numpy_scalars_are_numbers() -> None:
    camera = Camera.from_hfov(np.int64(640), np.int32(480), np.float32(90.0))  # type: ignore[arg-type]
    assert camera.hfov_deg == pytest.approx(90.0, abs=1e-4)  # float32 holds 90 exactly; tan does not gain from it


BEYOND = MAX_TILT + 1e-6


@pytest.mark.parametrize(
    "gravity",
    [
        (math.nan, 0.0),
        (0.0, math.inf),
        (0.0,),
        (0.0, 0.0, 9.81),
        [[0.0, 0.0]],
        0.0,
        (BEYOND, 0.0),
        (0.0, -BEYOND),
        "level",
        ("0", "up"),
        None,
        (None, 0.0),
        (0.0, (1.0, 2.0)),
        (0.1j, 0.0),
    ],
)
def test_levelling_refuses_what_is_no_tilt(gravity: object) -> None:
    with pytest.raises(GalocError, match="gravity") as caught:
        levelling(gravity)  # type: ignore[arg-type]
    assert "radians" in caught.value.expected


def test_tilt_up_to_the_limit_is_taken() -> None:
    assert np.linalg.det(levelling((MAX_TILT, -MAX_TILT))) == pytest.approx(1.0, abs=ROUNDING)
