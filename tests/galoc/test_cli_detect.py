"""The `galoc detect` command: pictures read, drawn and refused; models tried on frames with known truth."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from galoc import Camera, GalocError, Wireframe, assets, cli_detect
from galoc.cli import main
from galoc.cli_detect import check_text, read_picture
from galoc.detect.check_frames import CheckFrame, check, check_frames
from galoc.detect.columns import Columns
from galoc.detect.strip import azimuth_of, columns_for
from galoc.overlay import CEILING_RGB, FLOOR_RGB, VERTICAL_RGB
from galoc.plot_detect import draw_detection
from galoc.wireframe import layout_mask, mask_iou

GREY = 100
ROOM = Wireframe(
    [[-0.5, 20.0], [90.0, 60.0], [199.5, 45.0]],
    [[-0.5, 140.0], [90.0, 100.0], [199.5, 115.0]],
    [True] * 3,
    [True] * 3,
    [[0, 1], [1, 2]],
    np.array([2, 0, 2], np.int8),
    np.full((3, 2), 4.0),
)


class Stand:
    """A detector that returns what it is told and remembers what it saw."""

    def __init__(self, wireframe: Wireframe = ROOM) -> None:
        self.wireframe, self.seen = wireframe, []  # type: ignore[var-annotated]

    def detect(self, image: Any, camera: Camera, gravity: tuple[float, float]) -> Wireframe:
        self.seen.append((image, camera, gravity))
        return self.wireframe


@pytest.fixture
def stand(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Stand:
    stand = Stand()
    monkeypatch.setattr(cli_detect, "chosen_detector", lambda name, model: stand)
    monkeypatch.chdir(tmp_path)
    return stand


def picture(height: int = 160, width: int = 200) -> np.ndarray:
    out = np.full((height, width, 3), GREY, np.uint8)
    out[: height // 4, : width // 4] = (200, 0, 0)  # red, upper left
    return out


def save(path: Path, pixels: np.ndarray) -> Path:
    cv2.imwrite(str(path), pixels[..., ::-1] if pixels.ndim == 3 else pixels)
    return path


def near(pixels: np.ndarray, colour: tuple[int, int, int], reach: int = 60) -> np.ndarray:
    return np.abs(pixels.astype(int) - colour).max(axis=-1) <= reach


def test_prints_draws_and_writes_labels(stand: Stand, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save(tmp_path / "room.png", picture())
    assert main(["detect", "room.png", "--hfov", "70", "--roll", "1", "--pitch", "-2", "--json", "w.json"]) == 0
    rows = dict(line.split(None, 1) for line in capsys.readouterr().out.splitlines())
    assert rows["walls"] == "2" and rows["occlusions"] == "0"
    assert "seen  1 at the ceiling, 1 at the floor" in rows["corners"]
    sigma_deg = math.degrees(math.atan(4.0 / Camera.from_hfov(200, 160, 70.0).fx))
    assert f"4.0 px ({sigma_deg:.2f} deg" in rows["boundary"]
    assert 50 <= float(rows["coverage"].split()[0]) <= 100  # the walls fill the picture
    assert sorted(p.name for p in tmp_path.iterdir()) == ["room.png", "room.walls.png", "w.json"]
    image, camera, gravity = stand.seen[0]
    np.testing.assert_array_equal(image, picture())
    assert camera.hfov_deg == pytest.approx(70.0) and gravity == pytest.approx(np.radians([1.0, -2.0]))
    from galoc.detect.labels import load_labels

    again = load_labels(tmp_path / "w.json", "room.png")
    np.testing.assert_allclose(again.ceiling, ROOM.ceiling, atol=1e-9)  # px, written in full
    np.testing.assert_array_equal(again.walls, ROOM.walls)


def test_abstains_in_words(stand: Stand, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stand.wireframe = Wireframe.empty()
    save(tmp_path / "a.png", picture())
    assert main(["detect", "a.png", "--hfov", "70"]) == 0
    assert "abstained" in capsys.readouterr().out and (tmp_path / "a.walls.png").exists()


@pytest.mark.parametrize(("orientation", "turned"), [(1, False), (3, False), (6, True), (8, True)])
def test_exif_turns_the_picture(tmp_path: Path, orientation: int, turned: bool) -> None:
    image = pytest.importorskip("PIL.Image")
    exif = image.Exif()
    exif[0x0112] = orientation
    image.fromarray(picture()).save(tmp_path / "p.jpg", exif=exif, quality=95)
    pixels, said = read_picture(tmp_path / "p.jpg")
    turns = {1: 0, 3: 2, 6: 3, 8: 1}[orientation]  # quarter turns to the left that the entry asks for
    wanted = np.rot90(picture(), turns)
    assert pixels.shape == wanted.shape and said == turned
    assert np.abs(pixels.astype(int) - wanted).mean() < 3.0  # JPEG at quality 95


@pytest.mark.parametrize("kind", ["grey", "16 bit", "alpha"])
def test_other_pictures_become_rgb(tmp_path: Path, kind: str) -> None:
    path, grey = tmp_path / "p.png", np.full((12, 16), GREY, np.uint8)
    given = {"grey": grey, "16 bit": grey.astype(np.uint16) * 257, "alpha": np.dstack([grey] * 3 + [grey * 0])}[kind]
    cv2.imwrite(str(path), given)
    pixels, _ = read_picture(path)
    assert pixels.dtype == np.uint8 and pixels.shape == (12, 16, 3) and np.all(np.abs(pixels.astype(int) - GREY) <= 1)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["no.png", "--hfov", "70"], "no.png"),
        (["text.png", "--hfov", "70"], "no picture"),
        (["empty.png", "--hfov", "70"], "no picture"),
        (["."], "--hfov"),
        ([".", "--hfov", "70"], "cannot be read"),
        (["a.png"], "--hfov"),
        ([], "a picture"),
        (["a.png", "--hfov", "0"], "field of view"),
        (["a.png", "--hfov", "70", "--pitch", "nan"], "gravity"),
        (["a.png", "--hfov", "70", "--out", "no/x.png"], "cannot be written"),
        (["a.png", "--hfov", "70", "--out", "x.pdf"], "png"),
        (["a.png", "--hfov", "70", "--json", "no/x.json"], "cannot be written"),
        (["a.png", "--hfov", "70", "--json", "."], "cannot be written"),
        (["a.png", "--check", "shipped"], "one of the two"),
    ],
)
def test_bad_input_is_one_message_and_writes_nothing(
    tmp_path: Path,
    stand: Stand,
    arguments: list[str],
    words: str,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from galoc.camera import levelling

    save(tmp_path / "a.png", picture())
    (tmp_path / "text.png").write_text("no picture")
    (tmp_path / "empty.png").write_bytes(b"")
    monkeypatch.setattr(stand, "detect", lambda image, camera, gravity: levelling(gravity) is not None and ROOM)
    before = sorted(tmp_path.iterdir())
    assert main(["detect", *arguments]) == 2
    captured = capfd.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1 and words in captured.err
    assert sorted(tmp_path.iterdir()) == before


def test_places_are_refused_before_the_model_is_opened(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save(tmp_path / "a.png", picture())
    arguments = ["detect", str(tmp_path / "a.png"), "--hfov", "70", "--model", "no.onnx", "--out"]
    assert main([*arguments, str(tmp_path / "no" / "x.png")]) == 2
    assert "x.png" in capsys.readouterr().err
    assert main([*arguments, str(tmp_path / "x.png")]) == 2
    assert "no.onnx" in capsys.readouterr().err


def test_lines_take_no_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save(tmp_path / "a.png", picture())
    arguments = ["--hfov", "70", "--detector", "lines", "--model", "m.onnx", "--out", str(tmp_path / "x.png")]
    assert main(["detect", str(tmp_path / "a.png"), *arguments]) == 2
    assert "one of the two" in capsys.readouterr().err


def test_ctrl_c_is_clean(
    stand: Stand, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: Any) -> Wireframe:
        raise KeyboardInterrupt

    monkeypatch.setattr(stand, "detect", interrupted)
    save(tmp_path / "a.png", picture())
    assert main(["detect", "a.png", "--hfov", "70"]) == 130
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]


def test_drawing_shows_lines_walls_and_bars() -> None:
    drawn = draw_detection(np.full((160, 200, 3), GREY, np.uint8), ROOM)
    scale = drawn.shape[1] / 200
    assert max(drawn.shape) == 900

    def at(u: float, v: float) -> np.ndarray:
        col, row = round((u + 0.5) * scale - 0.5), round((v + 0.5) * scale - 0.5)
        return drawn[max(0, row - 1) : row + 2, max(0, col - 1) : col + 2]

    assert near(at(45.0, 40.1), CEILING_RGB).any() and near(at(45.0, 119.9), FLOOR_RGB).any()
    assert near(at(90.0, 80.0), VERTICAL_RGB).any()
    # One standard deviation above the junction, aside of the vertical, is the cap of its bar.
    assert near(at(90.6, 56.0), (255, 255, 255)).any() and not near(at(90.6, 50.0), (255, 255, 255)).any()
    left, right, above = (at(u, v).reshape(-1, 3).mean(axis=0) for u, v in ((45, 80), (150, 80), (45, 5)))
    assert np.all(np.abs(above - GREY) < 2) and np.abs(left - right).max() > 20


def test_occlusions_are_dashed_and_lines_end_where_the_picture_cuts_them() -> None:
    blank = np.full((160, 200, 3), GREY, np.uint8)

    def column(wireframe: Wireframe) -> float:
        drawn = draw_detection(blank, replace(wireframe, sigma_px=None))
        u, rows = round(90.5 * 4.5 - 0.5), slice(round(65 * 4.5), round(95 * 4.5))
        return float(near(drawn[rows, u], VERTICAL_RGB).mean())

    assert column(ROOM) > 0.95
    assert 0.3 < column(replace(ROOM, kind=np.array([2, 1, 2]))) < 0.7
    # The ceiling junction at the left is out of sight at (-0.5, 150); its line leaves the picture at (-0.5, 20).
    moved = replace(
        ROOM,
        ceiling=np.array([[-0.5, 150.0], [90.0, 60.0], [199.5, 45.0]]),
        ceiling_true=np.array([False, True, True]),
        ceiling_cut=np.array([[[-0.5, 20.0], [np.nan] * 2], [[np.nan] * 2] * 2]),
    )
    drawn = draw_detection(blank, moved)
    assert near(drawn[170:190, round(45 * 4.5)], CEILING_RGB).any()
    assert not near(drawn[260:640, round(45 * 4.5)], CEILING_RGB).any()


def test_large_pictures_are_shrunk_and_captioned() -> None:
    plain = draw_detection(np.full((2400, 3200, 3), GREY, np.uint8), Wireframe.empty())
    assert plain.shape == (1200, 1600, 3) and (plain == GREY).all()
    captioned = draw_detection(np.full((2400, 3200, 3), GREY, np.uint8), Wireframe.empty(), "abstained " * 30)
    assert captioned.shape[0] > 1200 and (captioned[:1200] == GREY).all() and captioned[1200:].max() > 150
    assert (captioned[1200:, -8:] < 60).all()  # the words end before the border


FRAMES = check_frames()


class Truth:
    """A detector that knows the answers."""

    def __init__(self, mirror: bool = False, flip: bool = False, constant: bool = False) -> None:
        self.mirror, self.flip, self.constant = mirror, flip, constant

    def _frame(self, image: Any) -> CheckFrame:
        return next(frame for frame in FRAMES if frame.picture is image)

    def detect(self, image: Any, camera: Camera, gravity: Any) -> Wireframe:
        return self._frame(image).wireframe

    def columns(self, image: Any, camera: Camera, gravity: Any) -> Columns:
        frame, width = self._frame(image), columns_for(camera)
        elevation = np.nan_to_num(frame.elevation)
        elevation = elevation[:, ::-1] if self.mirror else elevation
        elevation = elevation[::-1] if self.flip else elevation
        if self.constant:
            elevation = np.broadcast_to([[0.4], [-0.4]], elevation.shape)
        one, sides = np.ones_like(elevation), azimuth_of(np.arange(width), width)
        return Columns(azimuth_of(np.arange(0.5, width, 2), width), elevation, one, one, one, one, sides, one)


def test_shipped_frames_are_small_various_and_true() -> None:
    folder = assets.root() / "check"
    assert sum(path.stat().st_size for path in folder.iterdir()) < 300_000
    assert len(FRAMES) >= 6 and len({(f.camera.width, f.camera.height) for f in FRAMES}) >= 3
    for frame in FRAMES:
        assert frame.elevation.shape == (2, columns_for(frame.camera) // 2) == frame.visible.shape
        assert not np.any(frame.visible & ~frame.in_frame)
        known = np.isfinite(frame.elevation)
        assert np.all(frame.elevation[0][known[0]] > 0) and np.all(frame.elevation[1][known[1]] < 0)
        _check_mask(frame)


def _check_mask(frame: CheckFrame) -> None:
    """Columns and wireframe tell the same wall: the mask drawn from either is the same but for its rim."""
    u, v = np.meshgrid(np.arange(frame.camera.width), np.arange(frame.camera.height))
    rays = frame.camera.rays_level(np.stack([u, v], axis=-1), frame.gravity)
    azimuth, elevation = (
        np.arctan2(rays[..., 0], rays[..., 2]),
        np.arctan2(-rays[..., 1], np.hypot(*rays[..., ::2].T).T),
    )
    centres = azimuth_of(np.arange(0.5, columns_for(frame.camera), 2), columns_for(frame.camera))
    column = np.clip(np.rint((azimuth - centres[0]) / np.radians(1.0)).astype(int), 0, len(centres) - 1)
    low, high = frame.elevation[1][column], frame.elevation[0][column]
    inside = (elevation < high) & (elevation > low)
    # Columns are a degree wide, and doorways end between them.
    assert mask_iou(inside.astype(np.uint8), layout_mask(frame.wireframe, frame.camera)) > 0.95


def test_the_truth_passes_with_full_marks() -> None:
    found = check(Truth(), FRAMES)
    assert found.problems == () and np.all(found.iou == 1.0) and found.error_deg is not None
    assert found.error_deg.max() < 1e-9 and found.guess_deg > 1.0 and np.all(found.milliseconds >= 0.0)
    text = check_text(found, "columns/1")
    assert "passed" in text and "1.000 (mean)" in text and "no better" not in text


@pytest.mark.parametrize(("how", "words"), [({"mirror": True}, "left and right"), ({"flip": True}, "horizon")])
def test_what_is_meant_otherwise_fails(how: dict[str, bool], words: str) -> None:
    found = check(Truth(**how), FRAMES)
    assert len(found.problems) == 1 and words in found.problems[0]
    assert "FAILED" in check_text(found, "columns/1")


def test_a_guess_is_called_one() -> None:
    found = check(Truth(constant=True), FRAMES)
    assert found.problems == () and "no better" in check_text(found, "columns/1")


def test_a_detector_without_columns_and_one_that_abstains() -> None:
    found = check(Stand(Wireframe.empty()), FRAMES)
    assert found.error_deg is None and np.isnan(found.iou).all()
    text = check_text(found, "graph/1")
    assert f"abstained on {len(FRAMES)} of {len(FRAMES)}" in text and "boundary" not in text


def test_damaged_truth_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(assets, "root", lambda: tmp_path)
    with pytest.raises(GalocError, match="check/truth.json"):
        check_frames()
    (tmp_path / "check").mkdir()
    whole = json.loads((assets._HERE.parent / "assets" / "check" / "truth.json").read_text())
    for text in ("", "[]", "{}", '{"format": "galoc.check/2", "frames": []}', json.dumps(whole)):
        (tmp_path / "check" / "truth.json").write_text(text)
        with pytest.raises(GalocError):  # the last: pictures are missing
            check_frames()


def test_the_shipped_model_passes(capsys: pytest.CaptureFixture[str]) -> None:
    if not (assets.root() / "models" / "layout.onnx").is_file():
        pytest.skip("this checkout ships no model")
    assert main(["detect", "--check", "shipped"]) == 0
    out = capsys.readouterr().out
    assert "columns/1: passed" in out and "no better" not in out
