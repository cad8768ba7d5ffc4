"""The data that crosses modules: what a Wireframe takes, coerces and refuses; the small derived numbers."""

import copy
import dataclasses
import math
import pickle

import numpy as np
import pytest

from galoc import Estimate, GalocError, Layout, Rays, Wireframe
from galoc.types import BORDER, CORNER, OCCLUSION


def parts(**changes: object) -> dict[str, object]:
    """Arguments of a sound wireframe of three pairs and two walls, given as plain lists."""
    sound: dict[str, object] = {
        "ceiling": [[10, 20], [100, 40], [200, 30]],
        "floor": [[10, 220], [100, 200], [200, 210]],
        "ceiling_true": [1, 1, 0],
        "floor_true": [True, True, True],
        "walls": [[0, 1], [1, 2]],
    }
    return {**sound, **changes}


def test_plain_lists_become_the_documented_dtypes_and_shapes() -> None:
    wireframe = Wireframe(**parts(sigma_px=[[1, 2]] * 3, kind=[CORNER, OCCLUSION, BORDER]))  # type: ignore[arg-type]
    expected = {
        "ceiling": ((3, 2), np.float64),
        "floor": ((3, 2), np.float64),
        "ceiling_true": ((3,), np.bool_),
        "floor_true": ((3,), np.bool_),
        "walls": ((2, 2), np.int64),
        "kind": ((3,), np.int8),
        "sigma_px": ((3, 2), np.float64),
    }
    for name, (shape, dtype) in expected.items():
        array = getattr(wireframe, name)
        assert (array.shape, array.dtype) == (shape, dtype), name
    assert wireframe.ceiling_true.tolist() == [True, True, False]
    assert len(wireframe) == 3


def test_kind_defaults_to_corners() -> None:
    assert Wireframe(**parts()).kind.tolist() == [CORNER] * 3  # type: ignore[arg-type, union-attr]


def test_arrays_are_read_only_copies() -> None:
    mine = np.array([[10.0, 20.0], [100.0, 40.0], [200.0, 30.0]])
    wireframe = Wireframe(**parts(ceiling=mine))  # type: ignore[arg-type]
    mine[0, 0] = -1.0
    assert wireframe.ceiling[0, 0] == 10.0
    for field in ("ceiling", "floor", "ceiling_true", "floor_true", "walls", "kind"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(wireframe, field)[0] = 0
    with pytest.raises(dataclasses.FrozenInstanceError):
        wireframe.ceiling = mine  # type: ignore[misc]


def test_a_wireframe_survives_pickle_copy_and_replace() -> None:
    wireframe = Wireframe(**parts(floor_cut=np.full((2, 2, 2), np.nan)))  # type: ignore[arg-type]
    for again in (pickle.loads(pickle.dumps(wireframe)), copy.deepcopy(wireframe), dataclasses.replace(wireframe)):
        for field in dataclasses.fields(Wireframe):
            left, right = getattr(wireframe, field.name), getattr(again, field.name)
            if left is None:
                assert right is None
            else:
                assert np.array_equal(left, right, equal_nan=left.dtype.kind == "f"), field.name


def test_empty_wireframes() -> None:
    for empty in (Wireframe.empty(), Wireframe([], [], [], [], [])):  # type: ignore[arg-type]
        assert len(empty) == 0
        assert empty.ceiling.shape == empty.floor.shape == empty.walls.shape == (0, 2)
        assert empty.kind is not None
        assert empty.kind.shape == (0,)


def test_pairs_without_walls_are_sound() -> None:
    assert Wireframe(**parts(walls=[])).walls.shape == (0, 2)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({"floor": [[10, 220], [100, 200]]}, "floor with shape"),
        ({"ceiling": [10, 20, 30]}, "ceiling with shape"),
        ({"ceiling": [[10, 20, 1]] * 3}, "ceiling with shape"),
        ({"ceiling": [[10, 20], [30]]}, "ceiling"),
        ({"ceiling": "corners"}, "ceiling"),
        ({"ceiling": [["10", "20"]] * 3}, "ceiling"),
        ({"ceiling": None}, "ceiling"),
        ({"ceiling": [[1j, 0]] * 3}, "ceiling"),
        ({"ceiling": [[math.nan, 0]] * 3}, "NaN"),
        ({"floor": [[math.inf, 0]] * 3}, "NaN or infinite"),
        ({"ceiling_true": [True, True]}, "ceiling_true with shape"),
        ({"floor_true": [0.5, 1, 1]}, "floor_true"),
        ({"floor_true": [math.nan, 1, 1]}, "floor_true"),
        ({"walls": [[0, 3]]}, "wall indices from 0 to 3"),
        ({"walls": [[-1, 0]]}, "wall indices from -1"),
        ({"walls": [[0.5, 1]]}, "walls"),
        ({"walls": [[0, math.nan]]}, "walls"),
        ({"walls": [[1, 1]]}, "to itself"),
        ({"walls": [0, 1]}, "walls with shape"),
        ({"kind": [0, 1]}, "kind with shape"),
        ({"kind": [0, 1, 3]}, "kind"),
        ({"kind": [0, 1, 256]}, "kind"),
        ({"kind": [0, 1, -1]}, "kind"),
        ({"sigma_px": [1.0, 1.0, 1.0]}, "sigma_px with shape"),
        ({"sigma_px": [[1.0, -1.0]] * 3}, "sigma_px"),
        ({"ceiling_cut": np.zeros((3, 2, 2))}, "ceiling_cut with shape"),
        ({"floor_cut": np.zeros((2, 2))}, "floor_cut with shape"),
    ],
)
def test_wireframe_refuses_what_does_not_fit(changes: dict[str, object], names: str) -> None:
    with pytest.raises(GalocError, match=names) as caught:
        Wireframe(**parts(**changes))  # type: ignore[arg-type]
    assert caught.value.expected
    assert caught.value.cure


def test_walls_of_a_wireframe_without_pairs_are_refused() -> None:
    with pytest.raises(GalocError, match="wall indices"):
        Wireframe([], [], [], [], [[0, 1]])  # type: ignore[arg-type]


def test_the_abstaining_layout_is_empty_but_has_all_its_parts() -> None:
    layout = Layout.unknown("paper")
    assert layout.points.shape == layout.walls.shape == layout.arcs.shape == (0, 2)
    assert np.all(layout.heights > 0)
    assert layout.method == "paper"
    assert not layout.metric


def rays(known: list[bool]) -> Rays:
    ranges = np.where(known, 2.0, np.nan)
    return Rays(ranges, np.array(known, dtype=bool), np.full(len(known), np.nan))


def test_coverage_is_the_known_share() -> None:
    assert rays([True, False, False, True, True]).coverage == pytest.approx(0.6)
    assert rays([]).coverage == 0.0


@pytest.mark.parametrize("n", [1, 5, 91, 109])
def test_bearings_step_one_degree_counter_clockwise_around_the_heading(n: int) -> None:
    bearings = np.degrees(rays([True] * n).bearings_rad)
    assert bearings[(n - 1) // 2] == 0.0
    assert np.diff(bearings) == pytest.approx(np.ones(n - 1), abs=1e-9)
    assert bearings == pytest.approx(-bearings[::-1], abs=1e-9)


def test_estimates_do_not_share_their_default_candidates() -> None:
    first, second = (Estimate(np.full(3, np.nan), 0.0, True) for _ in range(2))
    assert first.candidates.shape == (0, 4)
    assert first.candidates is not second.candidates


def test_error_says_what_it_got_what_it_expected_and_the_cure_and_pickles() -> None:
    error = GalocError("width = 0", "a whole number of pixels", "Resize the image.")
    assert str(error) == "got width = 0; expected a whole number of pixels. Resize the image."
    assert isinstance(error, ValueError)
    again = pickle.loads(pickle.dumps(error))
    assert (again.got, again.expected, again.cure) == (error.got, error.expected, error.cure)


def test_resizing_moves_every_pixel_and_back_again() -> None:
    cut = np.array([[[np.nan, np.nan], [40.0, -0.5]]])
    wireframe = Wireframe(
        [[10, 5], [60, -0.5]], [[10, 50], [60, 47]], [True, False], [True, True], [[0, 1]],
        sigma_px=np.ones((2, 2)), ceiling_cut=cut, floor_cut=np.full((1, 2, 2), np.nan),
    )  # fmt: skip
    larger = wireframe.resized(2.0, 3.0)
    assert larger.ceiling[0].tolist() == [20.5, 16.0] and larger.ceiling_cut[0, 1, 1] == -0.5 * 1.0 - 0.0
    back = larger.resized(0.5, 1.0 / 3.0)
    for name in ("ceiling", "floor", "sigma_px", "ceiling_cut"):
        assert np.allclose(getattr(back, name), getattr(wireframe, name), equal_nan=True)


def test_shown_lines_end_where_the_border_cuts_them() -> None:
    cut = np.array([[[np.nan, np.nan], [40.0, -0.5]]])
    wireframe = Wireframe(
        [[10, 5], [60, -0.5]], [[10, 50], [60, 47]], [True, False], [True, True], [[0, 1]], ceiling_cut=cut,
        floor_cut=np.full((1, 2, 2), np.nan),
    )  # fmt: skip
    ((wall, a, b),) = wireframe.shown_lines(0)
    assert wall == 0 and a.tolist() == [10, 5] and b.tolist() == [40.0, -0.5]
    assert len(list(wireframe.shown_lines(1))) == 1
