"""The line detector: finds plain rooms, says nothing of blank ones, and never fails on a picture."""

import math
import time

import cv2
import numpy as np
import pytest

from galoc import Camera, Floorplan, GalocError, Wireframe
from galoc.detect.chains import HIGHEST, STEP, best_chain
from galoc.detect.lines import LinesConfig, LinesDetector
from galoc.wireframe import layout_mask, mask_iou
from galoc_env.homes import generate
from galoc_env.render import make_renderer
from galoc_env.scene import build_scene
from galoc_env.truth import visible_wireframe

CAMERA = Camera.from_hfov(640, 480, 108)
BOX = Floorplan.from_segments(
    np.array([[0, 0, 6, 0], [6, 0, 6, 4], [6, 4, 0, 4], [0, 4, 0, 0]], float), ceiling_height=2.6
)
Gravity = tuple[float, float]


def drawn(w: Wireframe, camera: Camera = CAMERA) -> np.ndarray:
    """A picture of flat tones: light ceiling, dark floor, each wall its own grey."""
    image = np.full((camera.height, camera.width, 3), 235, np.uint8)
    image[camera.height // 2 :] = 60
    for m, (i, j) in enumerate(w.walls):
        one = Wireframe(
            w.ceiling,
            w.floor,
            w.ceiling_true,
            w.floor_true,
            [[i, j]],  # type: ignore[arg-type]
            w.kind,
            ceiling_cut=None if w.ceiling_cut is None else w.ceiling_cut[m : m + 1],
            floor_cut=None if w.floor_cut is None else w.floor_cut[m : m + 1],
        )
        image[layout_mask(one, camera) > 0] = 110 + 35 * (m % 3)
    return cv2.GaussianBlur(image, (3, 3), 0)


def box_views(count: int, camera: Camera = CAMERA) -> list[tuple[np.ndarray, Gravity, Wireframe]]:
    rng = np.random.default_rng(3)
    found = []
    for _ in range(count):
        pose = np.array([rng.uniform(1.2, 4.8), rng.uniform(1.2, 2.8), rng.uniform(-np.pi, np.pi)])
        tilt = rng.uniform(-0.06, 0.06, 2)
        gravity = (float(tilt[0]), float(tilt[1]))
        w = visible_wireframe(BOX, camera, pose, 1.4, gravity)
        found.append((drawn(w, camera), gravity, w))
    return found


def test_plain_rooms_are_found() -> None:
    detector = LinesDetector()
    views = box_views(12)
    scores = [
        mask_iou(layout_mask(detector.detect(image, CAMERA, gravity), CAMERA), layout_mask(w, CAMERA))
        for image, gravity, w in views
    ]
    # Mask IoU; where a wall's line is out of the image its place is guessed, hence not all of them.
    assert np.median(scores) > 0.93 and np.mean(scores) > 0.85


def test_boundaries_are_right_to_a_degree() -> None:
    errors = []
    for image, gravity, w in box_views(12):
        columns = LinesDetector().columns(image, CAMERA, gravity)
        for row, (pixels, seen) in enumerate(((w.ceiling, w.ceiling_true), (w.floor, w.floor_true))):
            rays = CAMERA.rays_level(pixels[seen & (w.kind == 0)], gravity)
            elevation = np.arctan2(-rays[:, 1], np.hypot(rays[:, 0], rays[:, 2]))
            at = np.interp(np.arctan2(rays[:, 0], rays[:, 2]), columns.azimuths, columns.elevation[row])
            errors.extend(np.degrees(at - elevation))
    assert len(errors) > 15
    # Distances are 7 % apart, which at 45 degrees is 2 degrees of elevation: half of that to either side.
    assert np.median(np.abs(errors)) < 1.0


def test_rendered_rooms_are_better_than_chance() -> None:
    plan = generate(15, split="test")
    camera = Camera.from_hfov(320, 240, 108)
    renderer = make_renderer("raster", build_scene(plan, furniture=0.0), camera)
    free, rng = plan.free_space(0.8).positions(0.4), np.random.default_rng(5)
    found: list[list[float]] = []
    for _ in range(10):
        pose = np.array([*free[rng.integers(len(free))], rng.uniform(-np.pi, np.pi)])
        truth = layout_mask(visible_wireframe(plan, camera, pose, 1.4), camera)
        w = LinesDetector().detect(renderer.render(pose, 1.4, (0.0, 0.0), rgb_only=True).rgb, camera, (0.0, 0.0))
        turned = np.array([pose[0], pose[1], pose[2] + 2.0])
        other = layout_mask(visible_wireframe(plan, camera, turned, 1.4), camera)
        found.append([mask_iou(layout_mask(w, camera), truth), mask_iou(other, truth)])
    renderer.close()
    scores = np.array(found)
    # Mask IoU, against that of the true walls in another direction.
    assert np.median(scores[:, 0]) > 0.6 and np.mean(scores[:, 0]) > np.mean(scores[:, 1])


@pytest.mark.parametrize("value", [0, 128, 255])
def test_blank_pictures_give_nothing(value: int) -> None:
    image = np.full((480, 640, 3), value, np.uint8)
    assert len(LinesDetector().detect(image, CAMERA, (0.0, 0.0))) == 0
    columns = LinesDetector().columns(image, CAMERA, (0.0, 0.0))
    assert not columns.visible.any() and np.all(np.isfinite(columns.elevation))


def test_smooth_shading_gives_nothing() -> None:
    ramp = np.linspace(90, 160, 640)[None, :, None] + np.linspace(0, 20, 480)[:, None, None]
    image = np.repeat(ramp, 3, axis=2).astype(np.uint8)
    assert len(LinesDetector().detect(image, CAMERA, (0.0, 0.0))) == 0


def test_noise_and_odd_sizes_give_a_wireframe_or_nothing() -> None:
    rng = np.random.default_rng(0)
    for width, height, hfov in ((640, 480, 108), (97, 61, 60), (1280, 720, 80), (16, 16, 90), (400, 30, 100)):
        camera = Camera.from_hfov(width, height, hfov)
        image = rng.integers(0, 256, (height, width, 3)).astype(np.uint8)
        for tilt in ((0.0, 0.0), (0.3, -0.9), (-1.2, 1.2)):
            w = LinesDetector().detect(image, camera, tilt)
            assert np.all(np.isfinite(w.ceiling))


def test_the_same_picture_gives_the_same_bytes() -> None:
    image, gravity, _ = box_views(1)[0]
    a, b = (LinesDetector().columns(image, CAMERA, gravity) for _ in range(2))
    for name in ("elevation", "sure", "visible", "in_frame", "edge"):
        assert getattr(a, name).tobytes() == getattr(b, name).tobytes()


def test_columns_are_sound() -> None:
    for image, gravity, _ in box_views(4):
        columns = LinesDetector().columns(image, CAMERA, gravity)
        count = len(columns)
        assert columns.edge.shape == (2, 2 * count) and columns.edge_azimuths.shape == (2 * count,)
        np.testing.assert_allclose(np.diff(columns.azimuths), math.radians(1.0), atol=1e-12)
        assert np.all(columns.elevation[0] > 0) and np.all(columns.elevation[1] < 0) and np.all(columns.sigma > 0)
        for name in ("sure", "visible", "in_frame", "edge"):
            values = getattr(columns, name)
            assert values.min() >= 0.0 and values.max() <= 1.0
        assert np.all(columns.visible <= columns.in_frame + 1e-9)


def test_a_known_ratio_is_kept() -> None:
    image, gravity, _ = box_views(1)[0]
    for ratio in (-0.3, 0.0, 0.4):
        columns = LinesDetector().columns(image, CAMERA, gravity, log_ratio=(ratio, 0.01))
        got = np.log(np.tan(-columns.elevation[1]) / np.tan(columns.elevation[0]))
        np.testing.assert_allclose(got, ratio, atol=1e-6)


def test_a_large_picture_costs_little_more_than_a_small_one() -> None:
    """Segments are sought in a picture of 640 px, so nine times the pixels are not nine times the work."""
    small, gravity, _ = box_views(1)[0]
    large = cv2.resize(small, None, fx=3.0, fy=3.0, interpolation=cv2.INTER_LINEAR)
    wide = Camera.from_hfov(large.shape[1], large.shape[0], 108)
    detector = LinesDetector()
    times: dict[str, list[float]] = {"small": [], "large": []}
    for _ in range(6):  # in turns, so that a slow spell of the machine falls on both
        for name, image, camera in (("small", small, CAMERA), ("large", large, wide)):
            start = time.process_time()
            detector.columns(image, camera, gravity)
            times[name].append(time.process_time() - start)
    assert min(times["large"]) < 4.0 * min(times["small"])  # 1.1 in measurements


def test_bad_input_is_refused() -> None:
    image = np.zeros((480, 640, 3), np.uint8)
    with pytest.raises(GalocError, match="image"):
        LinesDetector().detect(image[:10], CAMERA, (0.0, 0.0))
    with pytest.raises(GalocError, match="image"):
        LinesDetector().detect(image.astype(np.float32), CAMERA, (0.0, 0.0))  # type: ignore[arg-type]
    with pytest.raises(GalocError, match="gravity"):
        LinesDetector().detect(image, CAMERA, (0.0, float("nan")))
    with pytest.raises(GalocError, match="least_px"):
        LinesConfig(least_px=-1.0)


def test_the_chain_follows_evidence_of_two_walls() -> None:
    """Evidence drawn for a corner of two walls at 45 degrees to the view comes back as those two."""
    azimuths = np.radians(np.arange(-50, 51))
    directions = np.radians([45.0, 135.0])
    facing = np.array([np.cos(azimuths - np.radians(a)) for a in (-45.0, 45.0)])  # normals of the left and right wall
    reach = np.where(azimuths < 0, 2.0 / facing[0], 2.0 / facing[1])
    rows = round(2 * HIGHEST / STEP) + 1
    evidence = np.zeros((2, rows, len(azimuths)))
    for sign in (1.0, -1.0):
        row = np.rint((sign * np.arctan(1.0 / reach) + HIGHEST) / STEP).astype(int)
        along = np.where(azimuths < 0, 0, 1)  # a wall's direction is at right angles to its normal
        for spread in (-1, 0, 1):
            evidence[along, row + spread, np.arange(len(azimuths))] = 1.0
    chain = best_chain(
        evidence, np.ones((rows, len(azimuths)), bool), np.zeros(len(azimuths)), azimuths, directions, (0.0, 0.3)
    )
    assert len(np.unique(chain.wall)) == 2
    # The distances tried are 7 % apart.
    assert np.abs(np.log(chain.range / reach)).max() < 0.08
    assert chain.evidence.mean() > 0.95
