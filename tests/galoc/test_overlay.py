import numpy as np
import pytest

from galoc import GalocError, Wireframe
from galoc.overlay import CEILING_RGB, FLOOR_RGB, VERTICAL_RGB, draw_wireframe

GREY = 100


def image():
    return np.full((240, 320, 3), GREY, np.uint8)


def wireframe(kind=(0, 0), true=(True, True)):
    return Wireframe([[80, 40], [240, 60]], [[80, 200], [240, 180]], true, true, [[0, 1]], np.array(kind, np.int8))


def same(pixels, colour, reach=40):
    """Anti-aliasing mixes a thin line with the grey: it keeps most of its colour."""
    return np.abs(pixels.astype(int) - colour).max(axis=-1) <= reach


def test_lines_lie_where_the_wireframe_says():
    out = draw_wireframe(image(), wireframe())
    assert same(out[50, 160], CEILING_RGB) and same(out[190, 160], FLOOR_RGB)
    assert same(out[120, 80], VERTICAL_RGB) and same(out[120, 240], VERTICAL_RGB)
    assert (out[120, 160] == GREY).all()


def test_the_input_is_left_alone():
    source = image()
    draw_wireframe(source, wireframe())
    assert (source == GREY).all()


def test_occlusion_is_dashed_and_border_has_no_vertical():
    solid = same(draw_wireframe(image(), wireframe())[60:180, 80], VERTICAL_RGB).mean()
    dashed = same(draw_wireframe(image(), wireframe(kind=(1, 0)))[60:180, 80], VERTICAL_RGB).mean()
    border = same(draw_wireframe(image(), wireframe(kind=(2, 0)))[60:180, 80], VERTICAL_RGB).mean()
    assert solid > 0.95 and 0.3 < dashed < 0.7 and border == 0.0


def test_unseen_junctions_are_hollow():
    filled = draw_wireframe(image(), wireframe())[200, 80]
    hollow = draw_wireframe(image(), wireframe(true=(False, False)))[200, 80]
    assert same(filled, FLOOR_RGB) and not same(hollow, FLOOR_RGB)


def test_unknown_walls_are_faded():
    bold = draw_wireframe(image(), wireframe(), [True])[50, 160].astype(int)
    faint = draw_wireframe(image(), wireframe(), [False])[50, 160].astype(int)
    assert 0 < np.abs(faint - GREY).max() < 0.5 * np.abs(bold - GREY).max()


def test_pixels_far_outside_do_no_harm():
    far = Wireframe([[-1e7, 40], [1e9, 60]], [[-1e7, 200], [1e9, 180]], [False] * 2, [False] * 2, [[0, 1]])
    out = draw_wireframe(image(), far)
    assert same(out[:, 160], CEILING_RGB, 40).any() and same(out[:, 160], FLOOR_RGB, 40).any()


def test_nothing_to_draw():
    assert (draw_wireframe(image(), Wireframe.empty()) == GREY).all()
    assert draw_wireframe(np.zeros((1, 1, 3), np.uint8), wireframe()).shape == (1, 1, 3)


@pytest.mark.parametrize(
    "picture", [np.zeros((4, 4), np.uint8), np.zeros((4, 4, 4), np.uint8), np.zeros((4, 4, 3), np.float32)]
)
def test_refuses_other_images(picture):
    with pytest.raises(GalocError, match="RGB"):
        draw_wireframe(picture, wireframe())


def test_refuses_a_mask_of_another_length():
    with pytest.raises(GalocError, match="known_walls"):
        draw_wireframe(image(), wireframe(), [True, False])
