"""Labels typed by hand: what the short form means, exact round trips, and what is refused."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from galoc import Camera, Floorplan, GalocError, Wireframe
from galoc.camera import azimuth
from galoc.detect.labels import LabelsDetector, load_labels, save_labels
from galoc.detect.oracle import perturb
from galoc.detect.plumb import plumb_exit
from galoc.types import BORDER, CORNER, OCCLUSION
from galoc_env.truth import visible_wireframe

CAMERA = Camera.from_hfov(640, 480, 108)
PLAN = Floorplan.load("apartment")
LEVEL = (0.0, 0.0)
PARTS = (
    "ceiling floor ceiling_true floor_true walls kind sigma_px ceiling_cut floor_cut".split()  # every field
)


def views(count: int) -> list[tuple[Wireframe, tuple[float, float]]]:
    rng = np.random.default_rng(0)
    free = PLAN.free_space(0.25).positions(0.4)
    found = []
    for _ in range(count):
        pose = np.array([*free[rng.integers(len(free))], rng.uniform(-np.pi, np.pi)])
        tilt = rng.uniform(-0.1, 0.1, 2)
        gravity = (float(tilt[0]), float(tilt[1]))
        found.append((visible_wireframe(PLAN, CAMERA, pose, 1.4, gravity), gravity))
    return found


VIEWS = views(20)


def written(path: Path, frame: Any, name: str = "a.jpg") -> Path:
    path.write_text(json.dumps({"galoc": "labels/1", "images": {name: frame}}))
    return path


def test_a_round_trip_changes_no_byte(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    wireframes = [w for w, _ in VIEWS[:6]] + [perturb(w, CAMERA, 2.0, rng) for w, _ in VIEWS[:2]] + [Wireframe.empty()]
    for w in wireframes:
        found = load_labels(save_labels(w, tmp_path / "a.json", (640, 480)))
        for name in PARTS:
            x, y = getattr(w, name), getattr(found, name)
            assert (x is None) == (y is None), name
            if x is not None:
                assert x.shape == y.shape and x.dtype == y.dtype, name
                np.testing.assert_array_equal(x, y)


def test_the_example_of_the_module_is_read(tmp_path: Path) -> None:
    from galoc.detect import labels

    text = labels.__doc__ or ""
    example = json.loads(text[text.index("{") : text.index("\n\n``pairs``")])
    (tmp_path / "a.json").write_text(json.dumps(example))
    w = LabelsDetector(tmp_path / "a.json").detect(None, CAMERA, LEVEL)
    np.testing.assert_array_equal(w.ceiling, [[-0.5, 92], [201.5, 143], [470, 61]])
    np.testing.assert_array_equal(w.kind, [BORDER, CORNER, CORNER])
    np.testing.assert_array_equal(w.walls, [[0, 1], [1, 2]])
    np.testing.assert_array_equal(w.ceiling_true, [True, True, True])
    np.testing.assert_array_equal(w.floor_true, [True, True, False])
    # Level camera: its plumb lines are image columns, and the lower image edge is at 479.5 px.
    np.testing.assert_allclose(w.floor[2], [470.0, 479.5], atol=1e-9)


def test_unseen_junctions_are_put_where_the_truth_has_them(tmp_path: Path) -> None:
    """Labels with null for what is out of the image, against true wireframes of tilted views."""
    count = 0
    for w, gravity in VIEWS:
        one = w.ceiling_true ^ w.floor_true
        keep = np.flatnonzero((w.kind != BORDER) & (one | (w.ceiling_true & w.floor_true)))
        pairs = [
            {
                "ceiling": w.ceiling[i].tolist() if w.ceiling_true[i] else None,
                "floor": w.floor[i].tolist() if w.floor_true[i] else None,
            }
            for i in keep
        ]
        path = written(tmp_path / "a.json", {"size": [640, 480], "pairs": pairs, "walls": []})
        found = load_labels(path, camera=CAMERA, gravity=gravity)
        # Both are the same line cut by the same border, by other formulas: rounding only.
        np.testing.assert_allclose(found.ceiling, w.ceiling[keep], atol=1e-6)
        np.testing.assert_allclose(found.floor, w.floor[keep], atol=1e-6)
        count += np.count_nonzero(one[keep])
    assert count > 10


@given(st.floats(0, 639), st.floats(0, 479), st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.booleans())
def test_a_plumb_line_keeps_its_azimuth_to_the_border(
    u: float, v: float, roll: float, pitch: float, upwards: bool
) -> None:
    end = plumb_exit((u, v), CAMERA, (roll, pitch), upwards=upwards)
    border = min(np.abs(end + 0.5).min(), np.abs(end - [639.5, 479.5]).min())
    assert border < 1e-6 and CAMERA.contains(np.clip(end, -0.5, [639.5, 479.5]))
    both = azimuth(CAMERA.rays_level([[u, v], end], (roll, pitch)))
    assert abs(both[0] - both[1]) < 1e-6  # rad: rounding
    level = CAMERA.rays_level([[u, v], end], (roll, pitch))
    slope = -level[:, 1] / np.hypot(level[:, 0], level[:, 2])
    assert (slope[1] >= slope[0] - 1e-6) if upwards else (slope[1] <= slope[0] + 1e-6)


def test_walls_left_out_join_neighbours_but_not_an_occlusion(tmp_path: Path) -> None:
    pairs = [
        {"ceiling": [100, 100], "floor": [100, 400]},
        {"ceiling": [200, 80], "floor": [200, 420]},
        {"ceiling": [200, 150], "floor": [200, 300], "kind": "occlusion"},
        {"ceiling": [400, 150], "floor": [400, 300]},
    ]
    path = written(tmp_path / "a.json", {"size": [640, 480], "pairs": pairs})
    w = load_labels(path, camera=CAMERA)
    np.testing.assert_array_equal(w.walls, [[0, 1], [2, 3]])
    np.testing.assert_array_equal(w.kind, [CORNER, CORNER, OCCLUSION, CORNER])
    with pytest.raises(GalocError, match="walls"):
        load_labels(path)


def test_images_come_in_order_and_by_name(tmp_path: Path) -> None:
    frames = {f"{name}.jpg": w for name, (w, _) in zip("zax", VIEWS, strict=False)}
    detector = LabelsDetector(save_labels(frames, tmp_path / "a.json", (640, 480)))
    assert detector.keys == ("z.jpg", "a.jpg", "x.jpg")
    for i in range(3):
        np.testing.assert_array_equal(detector.detect(None, CAMERA, LEVEL).ceiling, VIEWS[i][0].ceiling)
    with pytest.raises(GalocError, match="after the last"):
        detector.detect(None, CAMERA, LEVEL)
    detector.select("a.jpg")
    np.testing.assert_array_equal(detector.detect(None, CAMERA, LEVEL).floor, VIEWS[1][0].floor)
    named = load_labels(tmp_path / "a.json", "x.jpg")
    np.testing.assert_array_equal(named.floor, VIEWS[2][0].floor)
    with pytest.raises(GalocError, match="y.jpg"):
        load_labels(tmp_path / "a.json", "y.jpg")


PAIR = {"ceiling": [10, 20], "floor": [10, 400]}
FRAME = {"size": [640, 480], "pairs": [PAIR, {"ceiling": [300, 20], "floor": [300, 400]}], "walls": [[0, 1]]}


@pytest.mark.parametrize(
    ("frame", "part"),
    [
        (FRAME | {"size": [320, 240]}, "320 x 240"),
        (FRAME | {"size": [640.0, 480.0]}, "size"),
        (FRAME | {"size": 640}, "size"),
        (FRAME | {"wall": []}, "wall"),
        ({"pairs": []}, "pairs"),
        ([], "list"),
        (FRAME | {"pairs": {}}, "pairs"),
        (FRAME | {"pairs": [PAIR | {"floor": [10]}]}, "pair 0: floor"),
        (FRAME | {"pairs": [PAIR | {"floor": [10, "400"]}]}, "pair 0: floor"),
        (FRAME | {"pairs": [PAIR | {"floor": [10, float("nan")]}]}, "pair 0: floor"),
        (FRAME | {"pairs": [{"ceiling": None, "floor": None}]}, "neither"),
        (FRAME | {"pairs": [{"ceiling": [1, 2]}]}, "pair 0"),
        (FRAME | {"pairs": [PAIR | {"kind": "door"}]}, "door"),
        (FRAME | {"pairs": [PAIR | {"kind": ["corner"]}]}, "kind"),
        (FRAME | {"pairs": [PAIR | {"seen": [1, 0]}]}, "seen"),
        (FRAME | {"pairs": [PAIR | {"colour": "red"}]}, "colour"),
        (FRAME | {"walls": [[0, 2]]}, "wall"),
        (FRAME | {"walls": [[0, 0]]}, "wall"),
        (FRAME | {"walls": "01"}, "walls"),
        (FRAME | {"sigma_px": [[1, 1]]}, "sigma_px"),
        (FRAME | {"ceiling_cut": 3}, "ceiling_cut"),
    ],
)
def test_bad_labels_are_refused_by_name(tmp_path: Path, frame: Any, part: str) -> None:
    load_labels(written(tmp_path / "good.json", FRAME), camera=CAMERA)
    with pytest.raises(GalocError, match=part) as caught:
        load_labels(written(tmp_path / "a.json", frame), camera=CAMERA)
    assert "a.jpg" in caught.value.got


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "{}", '{"galoc": "labels/2", "images": {}}', '{"galoc": "labels/1", "images": []}']
)
def test_other_files_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(GalocError, match="a.json"):
        LabelsDetector(tmp_path / "a.json")
    with pytest.raises(GalocError, match="nowhere"):
        LabelsDetector(tmp_path / "nowhere.json")


def test_a_file_without_images_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{"galoc": "labels/1", "images": {}}')
    with pytest.raises(GalocError, match="without a frame"):
        LabelsDetector(tmp_path / "a.json")
    with pytest.raises(GalocError, match="without a frame"):
        load_labels(tmp_path / "a.json")


def test_a_null_needs_the_camera(tmp_path: Path) -> None:
    frame = FRAME | {"pairs": [PAIR | {"ceiling": None}, PAIR]}
    with pytest.raises(GalocError, match="no camera"):
        load_labels(written(tmp_path / "a.json", frame))
