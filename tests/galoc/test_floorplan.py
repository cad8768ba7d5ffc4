"""What a floorplan accepts, refuses and promises."""

import pickle

import numpy as np
import pytest
from numpy.typing import NDArray

from galoc import Floorplan, GalocError, Opening
from galoc.assets import plan_names
from galoc.plan_facts import manhattan

SQUARE = np.array([[0, 0, 4, 0], [4, 0, 4, 3], [4, 3, 0, 3], [0, 3, 0, 0]], dtype=float)
DOOR = Opening("door", 1.0, 0.0, 1.9, 0.0, 0.1, 0.0, 2.0)


def rotated(segments: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return (segments.reshape(-1, 2) @ turn.T).reshape(-1, 4)


def test_segments_are_a_private_read_only_copy() -> None:
    given = SQUARE.copy()
    plan = Floorplan.from_segments(given)
    given[:] = 7.0
    np.testing.assert_array_equal(plan.segments, SQUARE)
    assert plan.segments.dtype == np.float64
    assert plan.segments.flags.c_contiguous
    with pytest.raises(ValueError, match="read-only"):
        plan.segments[0, 0] = 1.0


@pytest.mark.parametrize("kind", [list, np.float32, np.int64, np.asfortranarray])
def test_any_real_numbers_are_accepted(kind: object) -> None:
    given = SQUARE.tolist() if kind is list else kind(SQUARE)  # type: ignore[operator]
    np.testing.assert_array_equal(Floorplan.from_segments(given).segments, SQUARE)


@pytest.mark.parametrize(
    ("segments", "words"),
    [
        ([], "without walls"),
        (np.zeros((0, 4)), "without walls"),
        ([[0, 0, 1]], "shape"),
        ([[0, 0, 1, 1], [0, 0]], "no array"),
        (np.zeros((2, 2, 4)), "shape"),
        ([["0", "0", "1", "1"]], "dtype"),
        (SQUARE + 1j, "dtype"),
        (SQUARE.astype(object), "dtype"),
        (SQUARE > 1, "dtype"),
        ([[10**400, 0, 1, 1]], "dtype"),
        (None, "dtype"),
        ([[0, 0, np.nan, 1], [0, 0, 1, 1]], "index 0"),
        ([[0, 0, 1, 1], [0, 0, np.inf, 1]], "index 1"),
        (SQUARE * 1e6, "coordinate"),
        (SQUARE * 0.1, "0.4 m x 0.3 m"),
        ([[0, 0, 5, 0]], "5 m x 0 m"),
    ],
)
def test_bad_segments_are_refused(segments: object, words: str) -> None:
    with pytest.raises(GalocError, match=words):
        Floorplan.from_segments(segments)  # type: ignore[arg-type]


def test_zero_length_segments_are_counted_and_located() -> None:
    bad = np.vstack([SQUARE, [[1, 1, 1, 1]], [[2, 2, 2, 2]]])
    with pytest.raises(GalocError, match=r"2 zero-length segments \(first at index 4\)"):
        Floorplan.from_segments(bad)


@pytest.mark.parametrize("height", [0, 1.4, 21, -2.5, np.nan, np.inf, "2.5", None, True, [2.5]])
def test_bad_ceilings_are_refused(height: object) -> None:
    with pytest.raises(GalocError, match="ceiling_height"):
        Floorplan.from_segments(SQUARE, height)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("outline", "words"),
    [
        ([[0, 0], [1, 1]], "2 vertices"),
        ([[0, 0], [1, 1], [0, 0]], "2 vertices"),
        ([[0, 0], [4, 3], [4, 0], [0, 3]], "simple"),  # crosses itself
        ([[0, 0], [2, 0], [4, 0]], "simple"),  # no area
        ([[0, 0], [2, np.nan], [4, 0]], "NaN"),
        ("everywhere", "outline"),
    ],
)
def test_bad_outlines_are_refused(outline: object, words: str) -> None:
    with pytest.raises(GalocError, match=words):
        Floorplan(SQUARE, outline=outline)  # type: ignore[arg-type]


def test_outline_drops_the_repeated_last_vertex() -> None:
    plan = Floorplan(SQUARE, outline=np.array([[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]))
    assert plan.outline is not None
    assert plan.outline.shape == (4, 2)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"kind": "hatch"}, "kind"),
        ({"x2": 1.0}, "width"),
        ({"thickness": -0.1}, "thickness"),
        ({"bottom": -0.1}, "bottom"),
        ({"top": 0.0}, "bottom < top"),
        ({"top": 2.7}, "ceiling"),
        ({"y1": np.nan}, "y1"),
        ({"y1": "0"}, "y1"),
    ],
)
def test_bad_openings_are_refused(change: dict[str, object], words: str) -> None:
    fields = {name: getattr(DOOR, name) for name in Opening.__slots__} | change  # type: ignore[attr-defined]
    with pytest.raises(GalocError, match=words):
        Floorplan(SQUARE, openings=(Opening(**fields),))


def test_openings_must_be_openings() -> None:
    with pytest.raises(GalocError, match=r"openings\[0\]"):
        Floorplan(SQUARE, openings=((0, 0, 1, 1),))  # type: ignore[arg-type]
    with pytest.raises(GalocError, match="openings"):
        Floorplan(SQUARE, openings=3)  # type: ignore[arg-type]


def test_hash_follows_geometry_and_nothing_else() -> None:
    plan = Floorplan(SQUARE, 2.6, (DOOR,), name="one", notes="a")
    same = Floorplan(SQUARE.tolist(), np.float64(2.6), [DOOR], name="two")  # type: ignore[arg-type]
    assert plan.content_hash == same.content_hash
    others = [
        Floorplan(SQUARE + 0.001, 2.6, (DOOR,)),
        Floorplan(SQUARE, 2.61, (DOOR,)),
        Floorplan(SQUARE, 2.6),
        Floorplan(SQUARE, 2.6, (DOOR,), outline=[[0, 0], [4, 0], [4, 3]]),  # type: ignore[arg-type]
    ]
    assert len({plan.content_hash, *(other.content_hash for other in others)}) == 5


def test_minus_zero_is_zero() -> None:
    assert Floorplan.from_segments(SQUARE * -1 * -1).content_hash == Floorplan.from_segments(SQUARE).content_hash
    assert Floorplan.from_segments(np.where(SQUARE == 0, -0.0, SQUARE)).segments.tobytes() == SQUARE.tobytes()


def test_plans_survive_pickling() -> None:
    plan = Floorplan(SQUARE, 2.6, (DOOR,), outline=SQUARE[:, :2], name="p")
    again = pickle.loads(pickle.dumps(plan))
    assert again.content_hash == plan.content_hash
    assert again.openings == plan.openings


def test_bounds() -> None:
    assert Floorplan.from_segments(SQUARE + [1, -2, 1, -2]).bounds == (1.0, -2.0, 5.0, 1.0)


@pytest.mark.parametrize("angle_deg", [0.0, 7.0, 44.0, 89.0])
def test_manhattan_share_turns_with_the_plan(angle_deg: float) -> None:
    diagonal = np.array([[0.0, 0.0, 4.0, 3.0]])  # 36.87 degrees off: 5 m of 19 m
    share, angle = manhattan(rotated(np.vstack([SQUARE, diagonal]), np.radians(angle_deg)))
    assert share == pytest.approx(14 / 19, abs=1e-9)  # exact but for rounding of lengths
    off = (np.degrees(angle) - angle_deg + 45) % 90 - 45
    assert off == pytest.approx(0.0, abs=1e-6)  # all its walls agree exactly


def test_five_plans_ship() -> None:
    assert plan_names() == ["apartment", "corridor", "gallery", "house", "office"]


@pytest.mark.parametrize("name", ["apartment", "corridor", "gallery", "house", "office"])
class TestShippedPlan:
    def test_doors_are_gaps_and_windows_are_wall(self, name: str) -> None:
        plan = Floorplan.load(name)
        free = plan.free_space(0.02)
        assert {opening.kind for opening in plan.openings} == {"door", "window"}
        for opening in plan.openings:
            middle = np.array([opening.x1 + opening.x2, opening.y1 + opening.y2]) / 2
            clearance = float(free.clearance_at(middle))
            if opening.kind == "door":
                # half the door to each jamb, within a cell's diagonal
                assert clearance == pytest.approx(opening.width / 2, abs=0.03)
            else:
                assert clearance == 0.0

    def test_all_rooms_connect(self, name: str) -> None:
        free = Floorplan.load(name).free_space(0.05)
        everywhere = free.inside & (free.clearance >= 0.3)
        # a corner behind a pilaster may pinch off; rooms may not
        assert np.count_nonzero(free.largest_room(0.3)) > 0.99 * np.count_nonzero(everywhere)

    def test_outline_is_the_outer_face(self, name: str) -> None:
        from shapely import Polygon

        plan = Floorplan.load(name)
        polygon = Polygon(plan.outline)
        x_min, y_min, x_max, y_max = plan.bounds
        assert polygon.bounds == pytest.approx((x_min, y_min, x_max, y_max), abs=1e-9)
        assert plan.free_space(0.05).area < polygon.area

    def test_looks_different_from_every_symmetry(self, name: str) -> None:
        """No half turn or mirror image maps the walls onto themselves, so a pose can be unique."""
        plan = Floorplan.load(name)
        free = plan.free_space(0.05).inside
        area = np.count_nonzero(free)
        for mirrored in (free[::-1], free[:, ::-1], free[::-1, ::-1]):
            assert np.count_nonzero(mirrored ^ free) > 0.02 * area


def test_shipped_plans_are_what_the_script_draws(repo, tmp_path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    import importlib.util

    spec = importlib.util.spec_from_file_location("make_plans", repo / "assets" / "make_plans.py")
    assert spec is not None and spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    monkeypatch.setattr(script, "PLANS", tmp_path)
    script.main()
    for written in sorted(tmp_path.glob("*.json")):
        redrawn, shipped = Floorplan.load(written), Floorplan.load(written.stem)
        # coordinates are rounded to 0.1 mm; another libm may round one the other way
        np.testing.assert_allclose(redrawn.segments, shipped.segments, atol=2e-4)
        assert redrawn.ceiling_height == shipped.ceiling_height
