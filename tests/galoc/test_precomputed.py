"""Wireframes in npz files: exact round trips, frames in order, and files that are refused."""

import re
import zipfile
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from galoc import Camera, Floorplan, GalocError, Localizer, Wireframe
from galoc.detect.columns import Columns
from galoc.detect.precomputed import FIELDS, PrecomputedDetector, load_wireframe, save_wireframe
from galoc.detect.strip import azimuth_of
from galoc_env.truth import visible_wireframe

CAMERA = Camera.from_hfov(640, 480, 108)
PLAN = Floorplan.load("apartment")
LEVEL = (0.0, 0.0)


def views(count: int) -> list[Wireframe]:
    rng = np.random.default_rng(0)
    free = PLAN.free_space(0.25).positions(0.4)
    poses = [np.array([*free[rng.integers(len(free))], rng.uniform(-np.pi, np.pi)]) for _ in range(count)]
    return [visible_wireframe(PLAN, CAMERA, pose, 1.4) for pose in poses]


VIEWS = views(12)


def assert_same(a: Wireframe, b: Wireframe) -> None:
    for name in FIELDS:
        x, y = getattr(a, name), getattr(b, name)
        assert (x is None) == (y is None), name
        if x is not None:
            assert x.dtype == y.dtype and x.shape == y.shape and x.tobytes() == y.tobytes(), name


@pytest.mark.parametrize("w", [*VIEWS[:4], Wireframe.empty()])
def test_a_round_trip_changes_no_byte(tmp_path: Path, w: Wireframe) -> None:
    assert_same(w, load_wireframe(save_wireframe(w, tmp_path / "a.npz")))
    assert_same(w, load_wireframe(save_wireframe(w, tmp_path / "b.npz", CAMERA), CAMERA))


def test_the_same_wireframe_gives_the_same_file(tmp_path: Path) -> None:
    files = [save_wireframe(VIEWS[0], tmp_path / name).read_bytes() for name in ("a.npz", "b.npz")]
    assert files[0] == files[1]


def test_numpy_alone_writes_such_files(tmp_path: Path) -> None:
    w = VIEWS[0]
    np.savez(tmp_path / "a.npz", **{name: getattr(w, name) for name in FIELDS[:5]})
    found = load_wireframe(tmp_path / "a.npz")
    np.testing.assert_array_equal(found.ceiling, w.ceiling)
    assert found.sigma_px is None and not found.kind.any()


def columns(count: int = 48) -> Columns:
    rng = np.random.default_rng(1)
    sides = azimuth_of(np.arange(0.5, 2 * count, 2), 2 * count), azimuth_of(np.arange(2 * count), 2 * count)
    rows = [rng.uniform(0.1, 0.9, (2, count)) for _ in range(5)]
    return Columns(sides[0], *rows, sides[1], rng.uniform(0.0, 1.0, (2, 2 * count)))


def test_what_a_network_said_is_kept(tmp_path: Path) -> None:
    w = replace(VIEWS[0], columns=columns())
    found = load_wireframe(save_wireframe(w, tmp_path / "a.npz"))
    assert_same(w, found)
    assert found.columns is not None and w.columns is not None
    for field in fields(Columns):
        np.testing.assert_array_equal(getattr(found.columns, field.name), getattr(w.columns, field.name))


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"columns_sigma": None}, "without"),
        ({"columns_sigma": np.zeros((2, 5))}, "shapes"),
        ({"columns_edge": np.full((2, 96), np.nan)}, "finite"),
        ({"columns_azimuths": columns().azimuths[::-1]}, "left to right"),
        ({"columns_azimuths": np.array(1.0)}, "columns_azimuths"),
        ({"columns_sure": np.full((2, 48), "x")}, "columns_sure"),
    ],
)
def test_columns_that_mean_nothing_are_refused(tmp_path: Path, changes: dict[str, Any], part: str) -> None:
    said = {f"columns_{field.name}": getattr(columns(), field.name) for field in fields(Columns)}
    load_wireframe(write(tmp_path / "good.npz", **said))
    with pytest.raises(GalocError, match=part):
        load_wireframe(write(tmp_path / "bad.npz", **(said | changes)))


def test_frames_come_in_order_and_end(tmp_path: Path) -> None:
    for i, w in enumerate(VIEWS):
        save_wireframe(w, tmp_path / f"frame_{i:03d}.npz")
    detector = PrecomputedDetector(tmp_path)
    assert len(detector) == len(VIEWS) and detector.keys[2] == "frame_002"
    for _ in range(2):
        for w in VIEWS:
            assert_same(detector.detect(None, CAMERA, LEVEL), w)
        with pytest.raises(GalocError, match="after the last of the 12 frames"):
            detector.detect(None, CAMERA, LEVEL)
        detector.reset()
    detector.select("frame_007")
    assert_same(detector.detect(None, CAMERA, LEVEL), VIEWS[7])
    assert_same(detector.detect(None, CAMERA, LEVEL), VIEWS[8])
    detector.select(3)
    assert_same(detector.detect(None, CAMERA, LEVEL), VIEWS[3])
    for wrong in ("frame_7", 12, -1, True, 1.5):
        with pytest.raises(GalocError, match="frame"):
            detector.select(wrong)  # type: ignore[arg-type]


def test_a_list_keeps_its_order(tmp_path: Path) -> None:
    files = [save_wireframe(VIEWS[i], tmp_path / f"{name}.npz") for i, name in enumerate("cab")]
    detector = PrecomputedDetector(files)
    for i in range(3):
        assert_same(detector.detect(None, CAMERA, LEVEL), VIEWS[i])
    with pytest.raises(GalocError, match="two frames named 'c'"):
        PrecomputedDetector([files[0], files[0]])


def test_a_frame_that_cannot_be_read_is_not_skipped(tmp_path: Path) -> None:
    path = save_wireframe(VIEWS[0], tmp_path / "a.npz")
    good = path.read_bytes()
    path.write_bytes(good[:-40])
    detector = PrecomputedDetector(tmp_path)
    with pytest.raises(GalocError, match=r"a\.npz"):
        detector.detect(None, CAMERA, LEVEL)
    path.write_bytes(good)
    assert_same(detector.detect(None, CAMERA, LEVEL), VIEWS[0])


def test_it_feeds_a_localizer(tmp_path: Path) -> None:
    box = Floorplan.from_segments(np.array([[0, 0, 4, 0], [4, 0, 4, 3], [4, 3, 0, 3], [0, 3, 0, 0]], float))
    w = visible_wireframe(box, CAMERA, (1.2, 1.3, 0.4), 1.4)
    save_wireframe(w, tmp_path / "a.npz")
    image = np.zeros((480, 640, 3), np.uint8)
    estimates = [
        Localizer(box, CAMERA, detector=PrecomputedDetector(tmp_path)).locate(image, gravity=LEVEL),
        Localizer(box, CAMERA).locate(w, gravity=LEVEL),
    ]
    assert np.all(np.isfinite(estimates[0].pose))
    np.testing.assert_array_equal(estimates[0].pose, estimates[1].pose)


def write(path: Path, **changes: Any) -> Path:
    arrays: dict[str, Any] = {name: getattr(VIEWS[0], name) for name in FIELDS[:5]} | changes
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    return path


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"floor": None}, "without"),
        ({"floors": np.zeros(3)}, "floors"),
        ({"floor": np.zeros((1, 2))}, "floor"),
        ({"ceiling": np.full((len(VIEWS[0]), 2), np.nan)}, "NaN"),
        ({"walls": np.array([[0, 99]])}, "wall"),
        ({"image_size": np.array([320, 240])}, "320 x 240"),
        ({"image_size": np.array([1.5])}, "image_size"),
        ({"ceiling": np.array([{"a": 1}] * len(VIEWS[0]), dtype=object)}, "cannot be read"),
    ],
)
def test_bad_files_are_refused(tmp_path: Path, changes: dict[str, Any], part: str) -> None:
    assert len(VIEWS[0]) > 1
    load_wireframe(write(tmp_path / "good.npz"), CAMERA)
    with pytest.raises(GalocError, match=part):
        load_wireframe(write(tmp_path / "bad.npz", **changes), CAMERA)


def test_what_is_no_npz_is_refused(tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("no archive")
    (tmp_path / "empty.npz").write_bytes(b"")
    with zipfile.ZipFile(tmp_path / "zip.npz", "w") as archive:
        for name in FIELDS[:5]:
            archive.writestr(f"{name}.npy", b"no array")
    for name in ("text.npz", "empty.npz", "zip.npz", "missing.npz"):
        with pytest.raises(GalocError, match=name):
            load_wireframe(tmp_path / name)
    with pytest.raises(GalocError, match="npz"):
        save_wireframe(VIEWS[0], tmp_path / "a.json")
    with pytest.raises(GalocError, match="folder"):
        PrecomputedDetector(tmp_path / "nowhere")
    (tmp_path / "bare").mkdir()
    with pytest.raises(GalocError, match="without a frame"):
        PrecomputedDetector(tmp_path / "bare")


def test_files_that_unpack_to_too_much_are_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("ceiling.npy", bytes(65 * 2**20))
    assert (tmp_path / "bomb.npz").stat().st_size < 2**20
    with pytest.raises(GalocError, match="unpacked"):
        load_wireframe(tmp_path / "bomb.npz")


def test_the_page_on_detectors_runs_and_prints_what_it_says(
    repo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (repo / "docs" / "detectors.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```(\w+)\n(.*?)^```", page, flags=re.DOTALL | re.MULTILINE)
    monkeypatch.chdir(tmp_path)
    ran = 0
    for number, (language, text) in enumerate(blocks):
        if language != "python":
            continue
        exec(compile(text, f"detectors.md, block {number}", "exec"), {})
        printed = capsys.readouterr().out
        assert ("text", printed) == blocks[number + 1]
        ran += 1
    assert ran >= 4
