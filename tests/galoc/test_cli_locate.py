"""The `galoc locate` command: one photo and one plan to a pose, a drawing and a file; and places told apart."""

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from galoc import Camera, Estimate, Floorplan, Localizer
from galoc.cli import main
from galoc.cli_locate import given_heights
from galoc.detect.labels import save_labels
from galoc.metrics import wrap_angle
from galoc.places import places
from galoc.plot_locate import observed_walls
from galoc_env.truth import visible_wireframe

PLAN = Floorplan.load("apartment")
CAMERA = Camera.from_hfov(320, 240, 108)
POSE = np.array([3.5, 2.2, 0.64])
TRUTH = visible_wireframe(PLAN, CAMERA, POSE, 1.4)
GIVEN = ["--plan", "apartment", "--hfov", "108"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A photo of one tone, and the true walls of a view as its labels."""
    cv2.imwrite(str(tmp_path / "room.png"), np.full((240, 320, 3), 90, np.uint8))
    save_labels({"room.png": TRUTH}, tmp_path / "walls.json", (320, 240))
    (tmp_path / "text.png").write_text("no picture")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_finds_a_labelled_photo_and_draws_it(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--labels", "walls.json", "--camera-height", "1.4", "--ceiling-height", "2.55", "--json", "at.json"]
    assert main(["locate", "room.png", *GIVEN, *arguments]) == 0
    rows = dict(line.split(None, 1) for line in capsys.readouterr().out.splitlines())
    assert rows["camera"].endswith("at 1.4 m, under a ceiling of 2.55 m") and "walls.json" in rows["detector"]
    found = json.loads((folder / "at.json").read_text())
    # True junctions and heights: registration is good to centimetres.
    assert math.dist(found["pose"][:2], POSE[:2]) < 0.05 and abs(wrap_angle(found["pose"][2] - POSE[2])) < 0.02
    assert not found["abstained"] and found["confidence"] > 0.9 and found["places"][0]["share"] > 0.9
    drawn = cv2.imread(str(folder / "room.map.png"))
    assert drawn is not None and np.ptp(drawn) == 255
    assert {p.name for p in folder.iterdir()} == {"room.png", "text.png", "walls.json", "at.json", "room.map.png"}


def test_says_that_it_does_not_know(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["locate", "room.png", *GIVEN, "--detector", "lines", "--out", "m.jpg", "--json", "at.json"]) == 0
    out = capsys.readouterr().out
    assert "pose          abstained" in out and "confidence" not in out
    found = json.loads((folder / "at.json").read_text())
    assert found["abstained"] and found["pose"] is None and found["places"] == [] and found["confidence"] == 0.0
    assert (folder / "m.jpg").read_bytes().startswith(b"\xff\xd8")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["no.png", *GIVEN], "no.png"),
        (["text.png", *GIVEN], "no picture"),
        (["room.png", "--plan", "nowhere", "--hfov", "108"], "nowhere"),
        (["room.png", "--plan", "room.png", "--hfov", "108"], "scale"),
        (["room.png", *GIVEN[:3], "200"], "field of view"),
        (["room.png", *GIVEN, "--roll", "86"], "--roll 86"),
        (["room.png", *GIVEN, "--pitch", "nan"], "--pitch nan"),
        (["room.png", *GIVEN, "--camera-height", "-1"], "--camera-height"),
        (["room.png", *GIVEN, "--ceiling-height", "0"], "ceiling"),
        (["room.png", *GIVEN, "--camera-height", "3", "--ceiling-height", "2.5"], "under a ceiling"),
        (["room.png", *GIVEN, "--labels", "text.png"], "JSON"),
        (["room.png", *GIVEN, "--labels", "other.json"], "room.png"),
        (["room.png", *GIVEN, "--model", "no.onnx"], "no.onnx"),
        (["room.png", *GIVEN, "--detector", "lines", "--labels", "walls.json"], "one of the two"),
        (["room.png", *GIVEN, "--out", "x.pdf"], ".png"),
        (["room.png", *GIVEN, "--out", "no/x.png"], "cannot be written"),
        (["room.png", *GIVEN, "--json", "."], "cannot be written"),
    ],
)
def test_bad_input_is_one_message_and_writes_nothing(
    folder: Path, arguments: list[str], words: str, capfd: pytest.CaptureFixture[str]
) -> None:
    save_labels({"another.png": TRUTH}, folder / "other.json", (320, 240))
    before = sorted(folder.iterdir())
    assert main(["locate", *arguments]) == 2
    captured = capfd.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1 and words in captured.err
    assert sorted(folder.iterdir()) == before


def test_heights_that_are_given_are_known_and_no_others() -> None:
    both, camera, ceiling, none = (given_heights(*g) for g in ((1.4, 2.5), (1.4, None), (None, 2.5), (None, None)))
    assert both.k_sd < 0.1 < camera.k_sd < ceiling.k_sd == none.k_sd
    assert camera.log_floor == pytest.approx(math.log(1.4)) and camera.var_ceiling == none.var_ceiling
    # A ceiling fixes the sum of the two heights whatever their ratio: at a ratio of 1 each is half of it.
    assert ceiling.log_scale(0.0, 0.1)[0] == pytest.approx(math.log(1.25))
    assert ceiling.log_scale(0.0, 0.1)[1] < 0.1 < none.log_scale(0.0, 0.1)[1]


def test_candidates_near_each_other_are_one_place() -> None:
    poses = np.array([[0.0, 0.0, math.pi - 0.1], [0.3, 0.0, 0.1 - math.pi], [0.3, 0.0, 0.0], [3.0, 0.0, 0.0]])
    weight = np.array([0.4, 0.3, 0.1, 0.2])
    estimate = Estimate(poses[0], 0.7, False, np.column_stack([poses, np.log(weight) - 50.0]))
    found = places(estimate)
    assert [round(place.share, 9) for place in found] == [0.7, 0.2, 0.1]  # across the seam at 180 degrees; far; turned
    np.testing.assert_array_equal([place.pose for place in found], poses[[0, 3, 2]])
    assert len(places(estimate, most=2)) == 2 and places(Estimate(poses[0], 0.0, True)) == ()


def test_observed_walls_lie_on_the_walls_of_the_plan() -> None:
    localizer = Localizer(PLAN, CAMERA)
    _, rays = localizer.observe(TRUTH, (0.0, 0.0))
    field = localizer.field
    drawn = observed_walls(rays, POSE, field.positions, field.ranges)
    points = drawn[np.isfinite(drawn).all(axis=1)]
    a, b = PLAN.segments[:, None, :2], PLAN.segments[:, None, 2:]
    along = np.clip(((points - a) * (b - a)).sum(-1) / np.square(b - a).sum(-1), 0.0, 1.0)
    off = np.linalg.norm(points - a - along[..., None] * (b - a), axis=-1).min(axis=0)
    assert len(points) == rays.known.sum() > 50
    # The profile is that of a grid position up to 7 cm away, which shifts the scale by a few percent.
    assert np.median(off) < 0.1
    assert observed_walls(rays, POSE + [0.0, 0.0, 0.6], field.positions, field.ranges).shape == drawn.shape
