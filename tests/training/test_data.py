"""The data stream: labels say what the renderer shows, frames survive disk, shuffling and flips."""

import math

import numpy as np
import pytest

from galoc import Camera, Floorplan
from galoc.detect.strip import ROWS, azimuth_of, elevation_of, upright_strip
from galoc_env.render import make_renderer
from galoc_env.scene import build_scene
from galoc_env.scene.mesh import CEILING, FLOOR, WALL
from galoc_env.truth_columns import true_columns
from training.augment import augmented
from training.labels import label
from training.stream import SHARD, Frames, Shuffler, photograph, stretched
from training.views import WIDTHS, View, Viewpoints, random_camera, strip_columns

BOX = np.array([[0, 0, 5, 0], [5, 0, 5, 4], [5, 4, 0, 4], [0, 4, 0, 0]], float)
CAMERA = Camera.from_hfov(320, 240, 100.0)


@pytest.fixture(scope="module")
def scene():
    return build_scene(Floorplan.from_segments(BOX, 2.6), furniture=0.0, seed=3)


@pytest.fixture(scope="module")
def frames():
    rng = np.random.default_rng(5)
    plan = Floorplan.from_segments(BOX, 2.6)
    home = build_scene(plan, furniture=0.4, seed=1)
    return [frame for _, frame in photograph(home, rng, 2, 6)]


def view(heading=0.3, gravity=(0.0, 0.0), measured=(0.0, 0.0)):
    return View(np.array([2.0, 1.8, heading]), 1.3, gravity, measured)


def labels_of(scene, v):
    frame = make_renderer("raster", scene, CAMERA).render(v.pose, v.height_m, v.gravity)
    return label(scene, CAMERA, v, frame, 240)


@pytest.mark.parametrize("gravity", [(0.0, 0.0), (0.12, -0.1), (-0.2, 0.15)])
def test_boundary_parts_wall_from_ceiling_and_floor_in_the_picture(scene, gravity):
    v = view(gravity=gravity, measured=(gravity[0] + 0.01, gravity[1] - 0.012))
    found = labels_of(scene, v)
    columns = np.arange(found.row.shape[1])
    for row, flat in ((0, CEILING), (1, FLOOR)):
        use = found.visible[row] & (found.row[row] > 4) & (found.row[row] < ROWS - 4)
        assert use.sum() > 20  # the room is empty: its lines are seen
        out = -1 if row == 0 else 1
        # The semantic picture has every second row; classes change within 1.5 of its rows of the line.
        at = found.row[row, use] / 2.0 - 0.25
        beyond = found.semantic[np.rint(at + 1.5 * out).astype(int), columns[use]]
        before = found.semantic[np.rint(at - 1.5 * out).astype(int), columns[use]]
        assert np.mean(beyond[beyond > 0] == flat) > 0.95  # 0: the image ends there
        assert np.mean(before != flat) > 0.97


def test_labels_equal_the_perfect_networks_columns(scene):
    v = view()
    found = labels_of(scene, v)
    exact = true_columns(scene.plan, CAMERA, v.pose, v.height_m, v.gravity)
    width = 2 * len(exact.azimuths)
    offset = (found.row.shape[1] - len(exact.azimuths)) // 2
    mine = elevation_of(found.row[:, offset : offset + width // 2].astype(float))
    near = np.abs(exact.azimuths) < math.radians(45)
    assert np.degrees(np.nanmax(np.abs(mine - exact.elevation)[:, near])) < 0.02  # float32 rows


def test_imu_error_moves_the_labels_with_the_picture(scene):
    straight, off = labels_of(scene, view()), labels_of(scene, view(measured=(0.0, math.radians(2.0))))
    middle = straight.row.shape[1] // 2
    a, b = (elevation_of(found.row[:, middle].astype(float)) for found in (straight, off))
    assert np.allclose(np.degrees(b - a), 2.0, atol=0.1)  # a camera believed to look up shows everything higher


def test_corners_of_a_box_are_where_its_corners_are(scene):
    v = view()
    found = labels_of(scene, v)
    bearing = np.arctan2(BOX[:, 1] - v.pose[1], BOX[:, 0] - v.pose[0])
    azimuth = (v.pose[2] - bearing + np.pi) % (2 * np.pi) - np.pi
    wanted = np.sort(azimuth[np.abs(azimuth) < math.radians(49)])
    seen = azimuth_of(found.edges[:, 0].astype(float), 240)
    assert len(seen) == len(wanted)
    assert np.degrees(np.abs(seen - wanted)).max() < 0.05
    assert np.all(found.edges[:, 1] == 0) and np.all(found.edges[:, 2] > 0.8)


def test_blank_wall_is_blind(scene):
    v = View(np.array([4.75, 2.0, 0.0]), 1.3, (0.0, 0.0), (0.0, 0.0))
    frame = make_renderer("raster", scene, Camera.from_hfov(160, 120, 50.0)).render(v.pose, v.height_m, v.gravity)
    found = label(scene, Camera.from_hfov(160, 120, 50.0), v, frame, 128)
    assert not found.visible.any() and not found.in_frame.any()
    assert np.mean(found.semantic[found.semantic > 0] == WALL) > 0.5


def test_strip_puts_verticals_into_columns(scene):
    v = view(gravity=(0.2, 0.1), measured=(0.2, 0.1))
    frame = make_renderer("raster", scene, CAMERA).render(v.pose, v.height_m, v.gravity)
    level = view()
    plain = make_renderer("raster", scene, CAMERA).render(level.pose, level.height_m, level.gravity)
    tilted, upright = upright_strip(frame.rgb, CAMERA, v.measured, 240), upright_strip(plain.rgb, CAMERA, (0, 0), 240)
    both = tilted.mask & upright.mask
    gap = np.abs(tilted.rgb.astype(int) - upright.rgb.astype(int)).max(axis=2)[both]
    assert both.mean() > 0.2 and np.median(gap) <= 3  # of 255; resampling alone


def test_cameras_fit_their_strips():
    rng = np.random.default_rng(0)
    cameras = [random_camera(rng) for _ in range(200)]
    assert {strip_columns(c) for c in cameras} == set(WIDTHS)
    assert all(40 < c.hfov_deg < 113 and max(c.width, c.height) <= 448 for c in cameras)


def test_views_keep_off_walls(scene):
    rng, viewpoints = np.random.default_rng(0), Viewpoints(scene)
    poses = np.array([viewpoints.draw(rng).pose for _ in range(100)])
    assert poses[:, 0].min() > 0.1 and poses[:, 0].max() < 4.9 and poses[:, 1].min() > 0.1


def test_stretched_plans_stay_plans():
    plan = stretched(Floorplan.from_segments(BOX, 2.6), np.random.default_rng(1))
    assert plan.bounds[2] > 4.4 and plan.ceiling_height >= 2.6


def test_frames_survive_the_disk(frames, tmp_path):
    frames[0].save(tmp_path / "a.npz")
    again = Frames.load(tmp_path / "a.npz")
    for name in ("rgb", "mask", "row", "seen", "edges", "semantic"):
        assert np.array_equal(getattr(again, name), getattr(frames[0], name), equal_nan=name in ("row", "edges"))


def test_augmentation_keeps_labels_with_their_picture(frames):
    frame = frames[0]
    columns = frame.rgb.shape[2]
    for seed in range(8):
        changed = augmented(frame, np.random.default_rng(seed))
        same, turned = changed.row, changed.row[:, :, ::-1]
        flipped = not np.array_equal(same, frame.row, equal_nan=True)
        assert np.array_equal(turned if flipped else same, frame.row, equal_nan=True)
        mask = np.unpackbits(changed.mask, axis=2)[0, :, :columns].astype(bool)
        before = np.unpackbits(frame.mask, axis=2)[0, :, :columns].astype(bool)
        assert np.array_equal(mask, before[:, ::-1] if flipped else before)
        assert not changed.rgb[0][~mask].any()
        count = np.isfinite(frame.edges[0, :, 0]).sum()
        moved = changed.edges[0, :count, 0].astype(float)
        wanted = frame.edges[0, :count, 0].astype(float)
        assert np.allclose(moved, columns - 1 - wanted if flipped else wanted, atol=0.15)  # float16


def test_shuffler_draws_batches_of_one_width(frames, tmp_path):
    for width in {f.rgb.shape[2] for f in frames}:
        own = [f for f in frames if f.rgb.shape[2] == width]
        Frames.joined((own * SHARD)[:SHARD]).save(tmp_path / f"w{width}-00-1.npz")
    stream = Shuffler(tmp_path, 8, np.random.default_rng(0))
    for _ in range(6):
        batch = stream.next()
        assert len(batch) == 8 and batch.rgb.shape[2] in WIDTHS
