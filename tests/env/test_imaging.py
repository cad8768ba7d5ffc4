"""The imaging stage: exact zeros, each knob's documented size, exact turns, streams, and the kernels' reference."""

import json
import math

import cv2
import numpy as np
import pytest

from galoc import Camera, GalocError
from galoc.camera import levelling
from galoc_env import _imaging_kernel as kernel
from galoc_env import imaging
from galoc_env.imaging import LIMITS, PRESETS, Imaging

CAMERA = Camera.from_hfov(160, 120, 108.0)
GRAVITY = (math.radians(6.0), math.radians(-9.0))
STRONG = Imaging.preset("poor").knobs()


def rng(seed: int = 5) -> np.random.Generator:
    return np.random.default_rng(seed)


def decoded(rgb: np.ndarray) -> np.ndarray:
    return imaging._linear()[rgb].astype(np.float64)


def flat(code: int, camera: Camera = CAMERA) -> np.ndarray:
    return np.full((camera.height, camera.width, 3), code, np.uint8)


def busy() -> np.ndarray:
    """All codes, with edges."""
    picture = rng(0).integers(0, 256, (12, 16, 3), dtype=np.uint8)
    return np.ascontiguousarray(np.kron(picture, np.ones((10, 10, 1), np.uint8)))


def dot(at: np.ndarray, camera: Camera) -> np.ndarray:
    """A white spot on black with a soft rim, sd 2 px of light."""
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    light = np.exp(-0.5 * ((u - at[0]) ** 2 + (v - at[1]) ** 2) / 4.0)
    codes = np.rint(255.0 * imaging._encoded()[np.rint(light * (imaging.STEPS - 1)).astype(int)]).astype(np.uint8)
    return np.repeat(codes[..., None], 3, axis=2)


def moments(rgb: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre (2,) and variance (2,) of the light, px."""
    light = decoded(rgb).sum(axis=2)
    v, u = np.indices(light.shape)
    centre = np.array([(u * light).sum(), (v * light).sum()]) / light.sum()
    spread = np.array([((u - centre[0]) ** 2 * light).sum(), ((v - centre[1]) ** 2 * light).sum()]) / light.sum()
    return centre, spread


def test_the_default_changes_nothing() -> None:
    picture = busy()
    kept = picture.copy()
    assert Imaging().apply(picture, CAMERA, rng(), turn_rad=0.3, gravity=GRAVITY) is picture
    assert Imaging.preset("none") == Imaging()
    still = Imaging(shutter=1.0, readout=1.0)
    assert still.apply(picture, CAMERA, rng()) is picture  # a shutter shows nothing while the camera rests
    Imaging.preset("poor").apply(picture, CAMERA, rng(), turn_rad=0.1)
    assert np.array_equal(picture, kept)


def test_light_goes_to_codes_and_back_without_loss() -> None:
    picture = np.resize(np.arange(256, dtype=np.uint8), (120, 160, 3))
    assert np.array_equal(Imaging(vignette=1e-12).apply(picture, CAMERA, rng()), picture)


@pytest.mark.parametrize("knob", list(LIMITS))
def test_each_knob_alone_changes_the_picture_and_its_zero_does_not(knob: str) -> None:
    picture = busy()
    strong = Imaging(**{knob: STRONG[knob]})
    assert not np.array_equal(strong.apply(picture, CAMERA, rng(), turn_rad=0.2), picture)
    assert Imaging(**{knob: type(STRONG[knob])(0)}).apply(picture, CAMERA, rng(), turn_rad=0.2) is picture


@pytest.mark.parametrize("knob", list(LIMITS))
def test_a_knob_leaves_the_draws_of_the_others(knob: str) -> None:
    """All others are at "poor"; what they draw shows in the generator's state after."""
    with_knob, without = rng(), rng()
    Imaging.of({**STRONG, knob: type(STRONG[knob])(0)}).apply(busy(), CAMERA, without, turn_rad=0.1)
    Imaging.of(STRONG).apply(busy(), CAMERA, with_knob, turn_rad=0.1)
    assert with_knob.bit_generator.state == without.bit_generator.state


def test_no_exposure_is_further_off_than_two_standard_deviations() -> None:
    """Of 400 draws some would be; the light then differs by 2 sd = 1 stop, half or twice, to the rounding of a code."""
    got = np.array([decoded(Imaging(exposure=0.5).apply(flat(120), CAMERA, rng(s)))[0, 0, 0] for s in range(400)])
    right = decoded(flat(120))[0, 0, 0]
    assert got.min() == pytest.approx(right / 2, rel=0.02) and got.max() == pytest.approx(2 * right, rel=0.02)
    assert np.mean(got > 1.98 * right) > 0.005


def test_noise_does_not_move_the_exposure_nor_the_exposure_the_noise() -> None:
    exposed = decoded(Imaging(exposure=0.4).apply(flat(120), CAMERA, rng()))[0, 0, 0]
    both = decoded(Imaging(exposure=0.4, read_noise=0.01).apply(flat(120), CAMERA, rng()))
    noise = decoded(Imaging(read_noise=0.01).apply(flat(120), CAMERA, rng()))
    assert abs(both.mean() - exposed) < 1.7e-3  # light: half a code here, and 4e-5 for the mean of the noise
    assert np.corrcoef(both.ravel(), noise.ravel())[0, 1] > 0.98  # the same noise field, rounded to codes


def test_the_same_generator_gives_the_same_bytes_whatever_the_threads() -> None:
    poor, threads = Imaging.preset("poor"), cv2.getNumThreads()
    try:
        cv2.setNumThreads(1)
        one = poor.apply(busy(), CAMERA, rng(), turn_rad=0.1, gravity=GRAVITY)
        cv2.setNumThreads(4)
        four = poor.apply(busy(), CAMERA, rng(), turn_rad=0.1, gravity=GRAVITY)
    finally:
        cv2.setNumThreads(threads)
    assert np.array_equal(one, four)
    assert not np.array_equal(one, poor.apply(busy(), CAMERA, rng(8), turn_rad=0.1, gravity=GRAVITY))


def test_exposure_and_white_balance_have_their_standard_deviations() -> None:
    base = decoded(flat(90))[0, 0, 0]
    camera = Camera.from_hfov(16, 16, 90.0)
    seeds = 500  # the relative error of a standard deviation is then 3.2 %, sd: 15 % is beyond 4 of them
    exposed = [decoded(Imaging(exposure=0.5).apply(flat(90, camera), camera, rng(s)))[0, 0] for s in range(seeds)]
    assert np.std(np.log2(np.array(exposed)[:, 0] / base)) == pytest.approx(0.5, rel=0.15)
    assert np.ptp(exposed, axis=1).max() == 0.0  # grey stays grey
    tinted = [decoded(Imaging(white_balance=0.2).apply(flat(90, camera), camera, rng(s)))[0, 0] for s in range(seeds)]
    red, green, blue = np.log(np.array(tinted) / base).T
    assert np.std(red) == pytest.approx(0.2, rel=0.15)
    assert np.std(green) == pytest.approx(0.2 * imaging.MIXED_LIGHT, rel=0.15)
    assert np.abs(red + blue).max() < 0.04  # nats: one code at this grey is 0.02


def test_noise_has_its_standard_deviation_in_linear_light() -> None:
    for code in (60, 150, 220):
        light = decoded(flat(code))[0, 0, 0]
        shot = decoded(Imaging(shot_noise=0.04).apply(flat(code), CAMERA, rng()))
        read = decoded(Imaging(read_noise=0.02).apply(flat(code), CAMERA, rng()))
        # 57 600 samples: 0.3 %; rounding to codes up to 0.01 of light adds up to 2 %; the dark end is clipped at 0.
        assert shot.std() == pytest.approx(0.04 * math.sqrt(light), rel=0.05)
        if light > 0.08:
            assert read.std() == pytest.approx(0.02, rel=0.05)
        across = [np.corrcoef(shot[:, :-1, c].ravel(), shot[:, 1:, c].ravel())[0, 1] for c in range(3)]
        assert np.abs(across).max() < 0.035  # white: 5 sd of the correlation of 19 000 pairs
        assert abs(np.corrcoef(shot[..., 0].ravel(), shot[..., 1].ravel())[0, 1]) < 0.035


def test_the_vignette_takes_its_share_from_the_corners() -> None:
    out = decoded(Imaging(vignette=0.5).apply(flat(200), CAMERA, rng()))
    light = decoded(flat(200))[0, 0, 0]
    assert out[60, 80, 0] == pytest.approx(light, abs=0.01)  # one code here is 0.007
    assert out[0, 0, 0] == pytest.approx(0.5 * light, abs=0.02)  # 1.2 % of the radius is beyond the last pixel
    assert np.all(np.diff(out[60, 80:, 0]) <= 0.0)


@pytest.mark.parametrize("bend", [-0.1, 0.08])
def test_distortion_moves_a_point_as_documented(bend: float) -> None:
    centre, corner = np.array([CAMERA.cx, CAMERA.cy]), math.hypot(80.0, 60.0)
    at = np.array([130.0, 85.0])
    out, _ = moments(Imaging(distortion=bend).apply(dot(at, CAMERA), CAMERA, rng()))
    r = np.linalg.norm(out - centre)
    assert r * (1.0 - bend * (r / corner) ** 2) == pytest.approx(np.linalg.norm(at - centre), abs=0.2)  # px
    assert (r < np.linalg.norm(at - centre)) == (bend < 0.0)  # barrel pulls in


@pytest.mark.parametrize("gravity", [(0.0, 0.0), GRAVITY])
@pytest.mark.parametrize("at", [(40.0, 20.0), (110.0, 95.0)])
def test_the_rolling_shutter_turns_each_row_by_its_time(gravity: tuple[float, float], at: tuple[float, float]) -> None:
    turn, readout = 0.25, 0.8
    out, _ = moments(
        Imaging(readout=readout).apply(dot(np.array(at), CAMERA), CAMERA, rng(), turn_rad=turn, gravity=gravity)
    )
    time = readout * (out[1] - CAMERA.cy) / CAMERA.height
    ray = CAMERA.rays_level(np.array(at), gravity)
    a = turn * time  # the camera turned left by it: what stands still moved to the right, to a larger azimuth
    moved = np.array([ray[0] * math.cos(a) + ray[2] * math.sin(a), ray[1], ray[2] * math.cos(a) - ray[0] * math.sin(a)])
    # px; rows that pass one after the other shear the spot of 2 px a little
    assert out == pytest.approx(CAMERA.project_level(moved, gravity), abs=0.25)
    assert abs(out[0] - at[0]) > 1.0  # px: it did move


def test_motion_blur_is_a_box_about_the_time_of_the_frame() -> None:
    at, turn, shutter = np.array([79.5, 59.5]), 0.4, 0.5
    sharp, rest = moments(dot(at, CAMERA))
    picture = dot(at, CAMERA)
    blurred = Imaging(shutter=shutter).apply(picture, CAMERA, rng(), turn_rad=turn)
    centre, spread = moments(blurred)
    assert centre == pytest.approx(sharp, abs=0.1)  # px
    path = turn * shutter * CAMERA.fx
    assert spread[0] - rest[0] == pytest.approx(path**2 / 12.0, rel=0.05)  # px^2: a box's; 16 samples, and the tangent
    assert spread[1] == pytest.approx(rest[1], abs=0.2)  # px^2: interpolation blurs by up to 1/4 px^2 at half pixels
    assert decoded(blurred).sum() == pytest.approx(decoded(picture).sum(), rel=0.02)  # codes; light is kept


def test_glare_surrounds_bright_things_and_leaves_flat_walls() -> None:
    glare = Imaging(glare=0.2)
    assert np.abs(glare.apply(flat(128), CAMERA, rng()).astype(int) - 128).max() <= 1
    window = flat(20)
    window[40:80, 60:100] = 255
    out = glare.apply(window, CAMERA, rng())
    assert out[60, 80, 0] == 255
    along = out[60, 104:, 0].astype(int)
    assert along[0] > 60 and along[-1] < along[0] and np.diff(along).max() <= 1  # fades with the distance


def test_tone_curves_keep_black_and_white_and_never_turn_back() -> None:
    ramp = np.resize(np.repeat(np.arange(256, dtype=np.uint8), 3), (120, 160, 3))
    for curve in (Imaging(gamma=0.3), Imaging(contrast=1.0), Imaging(gamma=0.3, contrast=0.5)):
        out = curve.apply(ramp, CAMERA, rng())
        codes = np.array([out[ramp == c][0] for c in range(256)]).astype(int)
        assert codes[0] == 0 and codes[255] == 255 and np.diff(codes).min() >= 0
    out = Imaging(contrast=1.0).apply(ramp, CAMERA, rng())
    assert out[ramp == 64].max() < 64 - 20 and out[ramp == 192].min() > 192 + 20


def test_jpeg_loses_more_at_lower_quality() -> None:
    picture = cv2.GaussianBlur(busy(), (0, 0), 2.0)
    errors = [
        np.abs(Imaging(jpeg=q).apply(picture, CAMERA, rng()).astype(int) - picture).mean() for q in (100, 80, 40, 5)
    ]
    assert errors == sorted(errors) and errors[0] < 3.0 and errors[3] > 2 * errors[0]  # codes


def test_a_view_of_an_array_will_do() -> None:
    for camera in (Imaging(vignette=0.3), Imaging(jpeg=50)):
        upside_down = camera.apply(busy()[::-1], CAMERA, rng())
        assert np.array_equal(upside_down, camera.apply(busy()[::-1].copy(), CAMERA, rng()))


@pytest.mark.parametrize("name", list(PRESETS))
def test_presets_and_json_round_trip(name: str) -> None:
    camera = Imaging.preset(name)
    assert Imaging.of(name) == camera == Imaging.of(camera)
    assert Imaging.of(json.loads(json.dumps(camera.knobs()))) == camera
    assert Imaging.of(None) == Imaging.of({}) == Imaging()
    assert Imaging.of({"jpeg": 50}) == Imaging(jpeg=50)


def test_random_cameras_grow_with_strength() -> None:
    assert Imaging.random(rng(), 0.0) == Imaging()
    weak, strong = rng(), rng()
    small, large = Imaging.random(weak, 0.5), Imaging.random(strong, 1.0)
    assert weak.bit_generator.state == strong.bit_generator.state
    assert small.exposure == pytest.approx(0.5 * large.exposure) and small.jpeg > large.jpeg
    signs = {np.sign(Imaging.random(rng(s)).distortion) for s in range(20)}
    assert signs == {-1.0, 1.0}


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ("dslr", "dslr"),
        ({"grain": 1.0}, "grain"),
        ({"exposure": -0.1}, "exposure"),
        ({"exposure": "much"}, "exposure"),
        ({"vignette": True}, "vignette"),
        ({"distortion": 0.5}, "distortion"),
        ({"shutter": math.nan}, "shutter"),
        ({"jpeg": 50.5}, "jpeg"),
        ({"jpeg": 101}, "jpeg"),
        (3, "3"),
    ],
)
def test_bad_knobs_are_named(value: object, told: str) -> None:
    with pytest.raises(GalocError, match=told):
        Imaging.of(value)


def test_bad_pictures_turns_and_strengths_are_named() -> None:
    for picture in (flat(3)[:50], flat(3).astype(np.float32), None):
        with pytest.raises(GalocError, match="picture"):
            Imaging().apply(picture, CAMERA, rng())  # type: ignore[arg-type]
    with pytest.raises(GalocError, match="turn_rad"):
        Imaging().apply(flat(3), CAMERA, rng(), turn_rad=math.inf)
    with pytest.raises(GalocError, match="gravity"):
        Imaging(readout=0.5).apply(flat(3), CAMERA, rng(), turn_rad=0.1, gravity=(math.nan, 0.0))
    with pytest.raises(GalocError, match="strength"):
        Imaging.random(rng(), 1.5)


def test_source_maps_follow_the_camera_model() -> None:
    turn, bend = np.linspace(-0.2, 0.3, CAMERA.height), -0.07
    maps = np.empty((2, CAMERA.height, CAMERA.width), np.float32)
    vertical = levelling(GRAVITY)[1]
    focal, centre = np.array([CAMERA.fx, CAMERA.fy]), np.array([CAMERA.cx, CAMERA.cy])
    kernel.source_maps(focal, centre, vertical, turn, bend, maps[0], maps[1])
    v, u = np.indices((CAMERA.height, CAMERA.width))
    offset = np.stack([u - CAMERA.cx, v - CAMERA.cy], axis=-1)
    square = (offset**2).sum(axis=-1, keepdims=True) / (80.0**2 + 60.0**2)
    x, y, z = np.moveaxis(CAMERA.rays_level(centre + offset * (1.0 - bend * square), GRAVITY), -1, 0)
    c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
    expected = CAMERA.project_level(np.stack([c * x - s * z, y, c * z + s * x], axis=-1), GRAVITY)
    # px: float32 at coordinates of a few hundred, through a division
    assert np.abs(np.moveaxis(maps, 0, -1) - expected).max() < 2e-3


def test_developing_follows_its_formula() -> None:
    light = rng(1).random((9, 7, 3)).astype(np.float32)
    gains = np.array([1.1, 0.9, 0.7], np.float32)
    codes = imaging._codes(1.0, 0.3)
    normal = imaging._normal()
    out = np.empty(light.shape, np.uint8)
    kernel.develop(light, gains, 0.4, 0.03, 0.01, np.uint64(5), normal, codes, out)
    mask, expected = (1 << 64) - 1, np.empty(light.shape)
    for i, (row, col) in enumerate(np.ndindex(9, 7)):
        bits = (5 + (i + 1) * 0x9E3779B97F4A7C15) & mask
        bits = ((bits ^ bits >> 30) * 0xBF58476D1CE4E5B9) & mask
        bits = ((bits ^ bits >> 27) * 0x94D049BB133111EB) & mask
        bits ^= bits >> 31
        for k in range(3):
            value = light[row, col, k] * gains[k] * (1.0 - 0.4 * ((col - 3) ** 2 + (row - 4) ** 2) / (3.5**2 + 4.5**2))
            value += math.sqrt(0.03**2 * value + 0.01**2) * normal[bits >> 12 * k & 4095]
            expected[row, col, k] = codes[round(min(max(value, 0.0), 1.0) * (len(codes) - 1))]
    assert np.abs(out - expected).max() <= 1  # codes: float32 may fall on the other side of a step
    assert (out == expected).mean() > 0.98


def test_the_normal_table_is_standard() -> None:
    z = imaging._normal().astype(float)
    assert abs(z.mean()) < 1e-6 and z.std() == pytest.approx(1.0, abs=1e-6)
    assert (np.abs(z) < 1.0).mean() == pytest.approx(0.6827, abs=1e-3)  # 4096 quantiles
