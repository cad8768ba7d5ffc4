import math

import numpy as np
import pytest
from small_world import small_plan

from galoc import Estimate
from galoc.types import Rays
from galoc_env import topdown
from galoc_env.topdown import TopDown

SIZE = (400, 300)
NO_FURNITURE = np.zeros((0, 4))


@pytest.fixture(scope="module")
def painter():
    return TopDown(small_plan(), NO_FURNITURE, *SIZE)


def near(image, xy_px, reach=4):
    x, y = (round(float(v)) for v in xy_px)
    return image[y - reach : y + reach + 1, x - reach : x + reach + 1].reshape(-1, 3).astype(int)


def has_colour(image, xy_px, colour, reach=4):
    return (np.abs(near(image, xy_px, reach) - colour).max(axis=1) <= 6).any()


def test_plan_is_upright_to_scale_and_inside(painter):
    corners = painter.pixels(np.array([[0.0, 0.0], [6.0, 4.0]]))
    assert corners[0, 0] < corners[1, 0] and corners[0, 1] > corners[1, 1]  # x right, y up
    assert abs(corners[1, 0] - corners[0, 0]) / 6 == pytest.approx(abs(corners[1, 1] - corners[0, 1]) / 4)
    assert corners.min() >= 0 and (corners <= SIZE).all()
    for a, b in small_plan().segments.reshape(-1, 2, 2):
        assert has_colour(painter.background, painter.pixels((a + b) / 2), topdown.WALL, reach=2)
    assert (near(painter.background, painter.pixels(np.array([1.0, 1.0]))) == topdown.FLOOR).all()
    assert (near(painter.background, (5, 5)) == topdown.PAPER).all()


def test_truth_is_green_and_estimate_orange_where_they_are(painter):
    truth, guess = np.array([[1.0, 1.0, 0.0]]), np.array([[5.0, 3.0, 1.0]])
    image = painter.draw(trail=truth, estimates=guess)
    assert has_colour(image, painter.pixels(truth[0, :2]), topdown.TRUTH, reach=16)
    assert has_colour(image, painter.pixels(guess[0, :2]), topdown.ESTIMATE)
    assert not has_colour(image, painter.pixels(guess[0, :2]), topdown.TRUTH, reach=16)


def test_drawing_leaves_the_background_alone(painter):
    before = painter.background.copy()
    painter.draw(trail=np.array([[1.0, 1.0, 0.0], [1.3, 1.0, 0.0]]))
    assert np.array_equal(painter.background, before)


def test_heat_darkens_where_the_belief_is(painter):
    positions = np.array([[x, y] for y in np.arange(0.5, 3, 0.1) for x in np.arange(0.5, 3, 0.1)])
    marginal = np.full(len(positions), 1e-9)
    marginal[0] = 1.0
    image = painter.draw(positions=positions, marginal=marginal / marginal.sum(), resolution=0.1)
    hot, cold = painter.pixels(positions[0]), painter.pixels(np.array([2.5, 2.5]))
    assert near(image, hot, 1).mean() < 120  # certain: darker than any mixture with the floor
    assert near(image, cold, 1).mean() > 250  # no mass: paper stays white


def test_missing_estimates_are_no_obstacle(painter):
    image = painter.draw(trail=np.zeros((1, 3)), estimates=np.full((3, 3), np.nan), estimate=nothing())
    assert image.shape == (SIZE[1], SIZE[0], 3)


def nothing():
    rays = Rays(np.full(91, np.nan), np.zeros(91, bool), np.full(91, np.nan))
    return Estimate(np.full(3, np.nan), 0.0, True, rays=rays)


def test_fan_ends_on_the_walls_when_the_estimate_is_right(painter):
    pose = np.array([1.0, 1.5, 0.0])
    bearings = np.radians(np.arange(91) - 45.0)
    exact = topdown.ranges(small_plan().segments, pose[:2], bearings)
    seen = Rays(exact * 0.37, np.ones(91, bool), np.zeros(91))  # the scale of the layout is arbitrary
    image = painter.draw(estimate=Estimate(pose, 1.0, False, rays=seen))
    for i in (5, 20, 70, 85):
        end = pose[:2] + exact[i] * np.array([math.cos(bearings[i]), math.sin(bearings[i])])
        assert has_colour(image, painter.pixels(end), topdown.ESTIMATE, reach=3)


def test_ranges_hit_the_nearest_wall():
    segments = small_plan().segments
    out = topdown.ranges(segments, np.array([1.0, 1.0]), np.radians([0.0, 90.0, 180.0, 270.0]))
    assert out == pytest.approx([2.5, 2.2, 1.0, 1.0])
    assert topdown.ranges(segments[:1], np.array([1.0, 1.0]), np.array([math.pi / 2])) == [1000.0]


def test_huge_and_tiny_plans_are_drawn():
    from galoc import Floorplan

    for side in (1.0, 800.0):
        square = [[0, 0, side, 0], [side, 0, side, side], [side, side, 0, side], [0, side, 0, 0]]
        plan = Floorplan.from_segments(square)
        painter = TopDown(plan, NO_FURNITURE, *SIZE)
        middle = painter.pixels(np.array([side / 2, side / 2]))
        assert (near(painter.background, middle) == topdown.FLOOR).all()


def test_text_at_every_border_is_cut_not_refused():
    image = np.full((20, 30, 3), 255, np.uint8)
    for xy in ((-5, -5), (0, 0), (29, 19), (100, 100), (15, 10)):
        topdown.write(image, xy, "text", 14)
    assert (image < 128).any()
