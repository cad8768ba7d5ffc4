"""Reading and writing floorplans."""

import json
import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from galoc import Floorplan, GalocError, Opening
from galoc.formats.image_size import image_size
from galoc.formats.vectorize import walls_from_free

cv2 = pytest.importorskip("cv2")

WALLS = [[0, 0, 4, 0], [4, 0, 4, 3], [4, 3, 0, 3], [0, 3, 0, 0]]
METRES = st.floats(-1000, 1000, allow_subnormal=False)


def write_json(path: Path, **fields: object) -> Path:
    path.write_text(json.dumps({"segments": WALLS} | fields))
    return path


# ---- JSON


@given(st.lists(st.tuples(METRES, METRES, METRES, METRES), min_size=1, max_size=6), st.floats(2.1, 20), st.text())
def test_json_round_trip_is_bit_equal(tmp_path_factory, rows, height, text) -> None:  # type: ignore[no-untyped-def]
    segments = np.vstack([np.array(rows), WALLS])
    segments = segments[np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1]) > 1e-9]
    openings = (Opening("door", 0.1, 1 / 3, 1.0, 0.0, 0.1, 0.0, 2.05),)
    plan = Floorplan(segments, height, openings, np.array([[0, 0], [1 / 3, 0], [0.1, 0.7]]), text, text[::-1])
    path = plan.save(tmp_path_factory.getbasetemp() / "round.json")
    again = Floorplan.load(path)
    assert again.segments.tobytes() == plan.segments.tobytes()
    assert again.outline is not None and plan.outline is not None
    assert again.outline.tobytes() == plan.outline.tobytes()
    assert (again.ceiling_height, again.openings) == (plan.ceiling_height, plan.openings)
    assert (again.name, again.notes) == (plan.name, plan.notes)
    assert again.content_hash == plan.content_hash


def test_bare_names_are_shipped_plans_unless_a_file_has_the_name(tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    assert Floorplan.load("apartment").name == "apartment"
    monkeypatch.chdir(tmp_path)
    with pytest.raises(GalocError, match=r"shipped plans.*apartment"):
        Floorplan.load("apartmant")


def test_ceiling_height_is_replaced_and_cuts_openings(tmp_path: Path) -> None:
    opening = {"kind": "door", "x1": 1, "y1": 0, "x2": 2, "y2": 0, "thickness": 0.1, "bottom": 0, "top": 2.4}
    path = write_json(tmp_path / "p.json", ceiling_height=2.5, openings=[opening])
    assert Floorplan.load(path).ceiling_height == 2.5
    lower = Floorplan.load(path, ceiling_height=2.2)
    assert lower.ceiling_height == 2.2
    assert lower.openings[0].top == 2.2


def test_open_doors_are_preferred_and_closed_ones_give_the_outline(tmp_path: Path) -> None:
    gap = [[0, 0, 1, 0], [2, 0, 4, 0], *WALLS[1:]]
    plan = Floorplan.load(write_json(tmp_path / "p.json", segments_doors_open=gap))
    assert len(plan.segments) == 5
    assert plan.free_space(0.05).area == pytest.approx(12.0, abs=0.05 * 14)  # one cell along the 14 m of wall


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "not JSON"),
        ("{", "not JSON"),
        ("[" * 100_000, "not JSON"),
        ("\udcff", "not JSON"),
        ("[1, 2]", "without a list of segments"),
        ('{"walls": []}', "without a list of segments"),
        ('{"segments": {}}', "without a list of segments"),
        ('{"segments": []}', "without walls"),
        ('{"segments": [[0, 0, 1, NaN]]}', "NaN"),
        ('{"segments": [[0, 0, 1e999, 1]]}', "infinite"),
        ('{"segments": [[0, 0, "1", 1]]}', "dtype"),
        ('{"segments": [[0, 0, 4, 3]], "units": "foot"}', "foot"),
        ('{"segments": [[0, 0, 4, 3]], "ceiling_height": "high"}', "ceiling_height"),
        ('{"segments": [[0, 0, 4, 3]], "openings": [{"kind": "door"}]}', "openings"),
        ('{"segments": [[0, 0, 4, 3]], "openings": 4}', "openings"),
        ('{"segments": [[0, 0, 4, 3]], "outline": [[0, 0]]}', "outline"),
    ],
)
def test_bad_json_is_explained_with_the_file_name(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "bad_plan.json"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(GalocError, match=words) as error:
        Floorplan.load(path)
    assert "bad_plan.json" in str(error.value)


def test_missing_files_folders_and_other_suffixes_are_explained(tmp_path: Path) -> None:
    with pytest.raises(GalocError, match="does not exist"):
        Floorplan.load(tmp_path / "none.json")
    with pytest.raises(GalocError, match="folder"):
        Floorplan.load(tmp_path)
    (tmp_path / "plan.dwg").write_bytes(b"AC1015")
    with pytest.raises(GalocError, match=r"\.dwg"):
        Floorplan.load(tmp_path / "plan.dwg")


def test_save_writes_whole_files_or_none(tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    plan = Floorplan.from_segments(WALLS)
    target = tmp_path / "plan.json"
    plan.save(target)
    before = target.read_bytes()

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(GalocError, match="No space"):
        Floorplan.from_segments(np.array(WALLS) * 2.0).save(target)
    assert target.read_bytes() == before
    assert list(tmp_path.iterdir()) == [target]
    with pytest.raises(GalocError, match="written"):
        plan.save(tmp_path / "missing" / "plan.json")
    with pytest.raises(GalocError, match=r"\.json"):
        plan.save(tmp_path / "plan.png")


def test_every_published_plan_loads(shared_plans: Path) -> None:
    files = sorted(shared_plans.glob("*/*.json"))
    assert len(files) > 30
    for file in files:
        plan = Floorplan.load(file)
        width, depth = json.loads(file.read_text())["extent"]
        x_min, y_min, x_max, y_max = plan.bounds
        assert (x_max - x_min, y_max - y_min) == pytest.approx((width, depth), abs=0.02)  # published to the centimetre


# ---- images


def room_image(angle: float, cell: float, size: int = 500) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """A 7 m x 4 m room with walls 0.25 m thick, turned, as an image; and its eight true corners in the plan, m."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    middle = size * cell / 2 + 0.013
    rows, cols = np.mgrid[:size, :size]
    points = np.stack([(cols + 0.5) * cell, (size - rows - 0.5) * cell], axis=-1) - middle
    local = np.abs(points @ turn)
    outer = (local < [3.75, 2.25]).all(axis=-1)
    inner = (local < [3.5, 2.0]).all(axis=-1)
    corners = np.array([[x, y] for x, y in ((1, 1), (1, -1), (-1, -1), (-1, 1))])
    true = np.vstack([corners * [3.75, 2.25], corners * [3.5, 2.0]]) @ turn.T + middle
    return np.where(outer & ~inner, 0, 255).astype(np.uint8), true


@pytest.mark.parametrize("angle_deg", [0.0, 3.0, 11.0, 26.0, 45.0, 71.0])
def test_straight_walls_come_back_as_single_segments(tmp_path: Path, angle_deg: float) -> None:
    cell = 0.02
    image, true = room_image(np.radians(angle_deg), cell)
    path = tmp_path / "room.png"
    cv2.imwrite(str(path), image)
    plan = Floorplan.load(path, scale=cell)
    assert len(plan.segments) == 8
    nearest = np.min(np.linalg.norm(true[:, None] - plan.segments[None, :, :2], axis=2), axis=1)
    assert nearest.max() < cell  # corners to better than a pixel, and no flip of y


def test_all_image_formats_agree(tmp_path: Path) -> None:
    image, _ = room_image(0.0, 0.05, 200)
    plans = []
    for suffix in (".png", ".pgm", ".bmp", ".jpg"):
        path = tmp_path / f"room{suffix}"
        cv2.imwrite(str(path), image, [cv2.IMWRITE_JPEG_QUALITY, 95])
        plans.append(Floorplan.load(path, scale=0.05))
    for plan in plans[1:]:
        np.testing.assert_allclose(plan.segments, plans[0].segments, atol=1e-9)


def test_transparent_pixels_are_white(tmp_path: Path) -> None:
    image, _ = room_image(0.0, 0.05, 200)
    rgba = np.zeros((*image.shape, 4), np.uint8)
    rgba[..., 3] = 255 - image
    cv2.imwrite(str(tmp_path / "alpha.png"), rgba)
    cv2.imwrite(str(tmp_path / "grey.png"), image)
    alpha, grey = (Floorplan.load(tmp_path / name, scale=0.05) for name in ("alpha.png", "grey.png"))
    np.testing.assert_array_equal(alpha.segments, grey.segments)


def test_specks_vanish_and_pillars_stay(tmp_path: Path) -> None:
    image, _ = room_image(0.0, 0.05, 200)
    clean = image.copy()
    image[90:93, 90:93] = 0  # 0.15 m
    cv2.imwrite(str(tmp_path / "speck.png"), image)
    cv2.imwrite(str(tmp_path / "clean.png"), clean)
    image[120:128, 90:98] = 0  # 0.4 m
    cv2.imwrite(str(tmp_path / "pillar.png"), image)
    counts = [len(Floorplan.load(tmp_path / f"{n}.png", scale=0.05).segments) for n in ("clean", "speck", "pillar")]
    assert counts == [8, 8, 12]


@pytest.mark.parametrize("scale", [None, 0.0, -0.05, float("nan"), float("inf"), "0.05", True])
def test_images_need_a_sane_scale(tmp_path: Path, scale: object) -> None:
    path = tmp_path / "room.png"
    cv2.imwrite(str(path), room_image(0.0, 0.05, 200)[0])
    with pytest.raises(GalocError, match=r"scale = .*metres per pixel"):
        Floorplan.load(path, scale=scale)  # type: ignore[arg-type]


def test_scale_is_refused_where_it_has_no_meaning(tmp_path: Path) -> None:
    with pytest.raises(GalocError, match="images only"):
        Floorplan.load(write_json(tmp_path / "p.json"), scale=0.05)


@pytest.mark.parametrize("value", [0, 255])
def test_an_image_without_walls_is_refused(tmp_path: Path, value: int) -> None:
    cv2.imwrite(str(tmp_path / "flat.png"), np.full((100, 100), value, np.uint8))
    with pytest.raises(GalocError, match="no wall"):
        Floorplan.load(tmp_path / "flat.png", scale=0.05)


def test_noise_is_refused_in_good_time(tmp_path: Path, rng: np.random.Generator) -> None:
    noise = rng.integers(0, 256, (1300, 1300)).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "noise.png"), noise)
    with pytest.raises(GalocError, match="cells of boundary"):
        Floorplan.load(tmp_path / "noise.png", scale=0.5)


def bomb(path: Path, side: int) -> Path:
    """A PNG of side x side white pixels that takes a few kilobytes."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", side, side, 1, 0, 0, 0, 0)
    press = zlib.compressobj(9)
    row = b"\0" + b"\xff" * (side // 8)
    body = b"".join(press.compress(row) for _ in range(side)) + press.flush()
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", body) + chunk(b"IEND", b""))
    return path


def test_a_huge_image_is_refused_before_it_is_decoded(tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    path = bomb(tmp_path / "bomb.png", 20_000)
    assert path.stat().st_size < 1e6

    def decoded(*_: object) -> None:
        raise AssertionError("the image was decoded")

    monkeypatch.setattr(cv2, "imdecode", decoded)
    with pytest.raises(GalocError, match="20000 x 20000 px"):
        Floorplan.load(path, scale=0.01)


def test_image_sizes_come_from_headers() -> None:
    image = np.zeros((37, 53, 3), np.uint8)
    for suffix in (".png", ".jpg", ".bmp", ".pgm", ".ppm"):
        given = image[:, :, 0] if suffix == ".pgm" else image
        assert image_size(cv2.imencode(suffix, given)[1].tobytes()) == (53, 37)
    assert image_size(b"P5\n# made by hand\n53 37\n255\n") == (53, 37)
    assert image_size(b"not an image") is None


def test_damaged_images_are_refused(tmp_path: Path) -> None:
    data = cv2.imencode(".png", room_image(0.0, 0.05, 200)[0])[1].tobytes()
    for name, content in {"short.png": data[: len(data) // 2], "text.png": b"hello", "empty.png": b""}.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(GalocError, match=name.replace(".", r"\.")):
            Floorplan.load(tmp_path / name, scale=0.05)


@given(st.integers(0, 2**32 - 1))
def test_traced_area_equals_painted_area(seed: int) -> None:
    """Random rectangles of free space: the signed area within the walls is that of the free cells."""
    rng = np.random.default_rng(seed)
    free = np.zeros((80, 80), bool)
    for _ in range(6):
        x, y, w, h = (*rng.integers(2, 50, 2), *rng.integers(6, 25, 2))
        free[y : y + h, x : x + w] = True
    walls = walls_from_free(free, 0.5, "random")
    x1, y1, x2, y2 = walls.T
    area = 0.5 * float(np.sum(x1 * y2 - x2 * y1))
    # random rectangles are full of jogs of one cell, which count as a straight wall; the mean stray stays below half
    boundary = float(np.hypot(x2 - x1, y2 - y1).sum())
    assert area == pytest.approx(0.25 * np.count_nonzero(free), abs=0.25 * boundary / 2)


# ---- ROS maps


def ros_map(folder: Path, pixels: NDArray[np.uint8], **fields: object) -> Path:
    cv2.imwrite(str(folder / "floor.pgm"), pixels)
    info = {"image": "floor.pgm", "resolution": 0.05, "origin": [0.0, 0.0, 0.0], "negate": 0} | fields
    info |= {"occupied_thresh": 0.65, "free_thresh": 0.196}
    path = folder / "floor.yaml"
    path.write_text("\n".join(f"{key}: {value}" for key, value in info.items()))
    return path


@pytest.fixture
def grid() -> NDArray[np.uint8]:
    """Unknown ground with a 5 m x 3 m room whose east wall was never seen."""
    image = np.full((100, 140), 205, np.uint8)
    image[20:80, 20:120] = 254
    image[18:20, 18:120] = image[80:82, 18:120] = 0
    image[18:82, 18:20] = 0
    return image


def test_unknown_space_ends_free_space(tmp_path: Path, grid: NDArray[np.uint8]) -> None:
    plan = Floorplan.load(ros_map(tmp_path, grid))
    assert len(plan.segments) == 4
    assert plan.bounds == pytest.approx((1.0, 1.0, 6.0, 4.0), abs=1e-9)


def test_origin_turns_and_moves_the_map(tmp_path: Path, grid: NDArray[np.uint8]) -> None:
    plain = Floorplan.load(ros_map(tmp_path, grid))
    moved = Floorplan.load(ros_map(tmp_path, grid, origin=[-3.0, 7.0, np.pi / 2]))
    x1, y1, x2, y2 = plain.segments.T
    np.testing.assert_allclose(moved.segments, np.stack([-y1 - 3, x1 + 7, -y2 - 3, x2 + 7], axis=1), atol=1e-9)


def test_negate_swaps_dark_and_light(tmp_path: Path, grid: NDArray[np.uint8]) -> None:
    plain = Floorplan.load(ros_map(tmp_path, grid))
    swapped = Floorplan.load(ros_map(tmp_path, 255 - grid, negate=1))
    np.testing.assert_array_equal(plain.segments, swapped.segments)


def test_the_edge_of_the_map_is_no_wall(tmp_path: Path, grid: NDArray[np.uint8]) -> None:
    grid[40:60, 0:140] = 254
    plan = Floorplan.load(ros_map(tmp_path, grid))
    x, y = plan.segments[:, [0, 2]], plan.segments[:, [1, 3]]
    assert not np.any((np.ptp(x, axis=1) < 1e-9) & ((x[:, 0] < 0.01) | (x[:, 0] > 6.99)))
    assert np.ptp(y) == pytest.approx(3.0, abs=1e-9)


def test_a_missing_image_is_replaced_by_its_stand_in(tmp_path: Path, grid: NDArray[np.uint8]) -> None:
    path = ros_map(tmp_path, grid, image="/elsewhere/1.pgm")
    assert len(Floorplan.load(path).segments) == 4
    (tmp_path / "floor.pgm").unlink()
    with pytest.raises(GalocError, match=r"missing image '/elsewhere/1\.pgm'"):
        Floorplan.load(path)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("resolution", 0),
        ("resolution", ".nan"),
        ("resolution", "fine"),
        ("origin", "here"),
        ("origin", "[1]"),
        ("negate", "maybe"),
    ],
)
def test_bad_map_values_are_refused(tmp_path: Path, grid: NDArray[np.uint8], field: str, value: object) -> None:
    with pytest.raises(GalocError, match=field):
        Floorplan.load(ros_map(tmp_path, grid, **{field: value}))


@pytest.mark.parametrize("text", ["", "just words", "image: x.png", "a: [", "!!python/object/apply:os.getcwd []"])
def test_other_yaml_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "map.yaml"
    path.write_text(text)
    with pytest.raises(GalocError, match=r"map\.yaml"):
        Floorplan.load(path)


@pytest.mark.parametrize("name", ["utexas_gdc/raw/gdc_1s.yaml", "turtlebot_willow/raw/willow-2010-02-18-0.10.yaml"])
def test_published_maps_load(shared_plans: Path, name: str) -> None:
    plan = Floorplan.load(shared_plans / name)
    assert plan.free_space(0.1).area > 150.0
