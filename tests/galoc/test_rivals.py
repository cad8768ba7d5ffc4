"""Places that look alike are judged alike, wherever they lie on the grid."""

import math

import numpy as np
import pytest

from galoc import Camera, Floorplan, Localizer
from galoc.belief import Belief
from galoc.heights import Heights
from galoc.likelihood import Likelihood
from galoc.localizer import FRAME_TEMPER
from galoc.metrics import wrap_angle
from galoc.observation import observation
from galoc.profiles import profile_field
from galoc.rivals import APART_M, MOST_PLACES, levelled
from galoc_env.truth import visible_wireframe

CAMERA = Camera.from_hfov(640, 480, hfov_deg=80)
SHIFT = 7.37  # no multiple of the grid's step


def rectangle(x0, y0, x1, y1):
    return [[x0, y0, x1, y0], [x1, y0, x1, y1], [x1, y1, x0, y1], [x0, y1, x0, y0]]


@pytest.fixture(scope="module")
def twins():
    """Two rooms of one shape, apart by a shift that the grid does not know."""
    room = np.array([*rectangle(0, 0, 4.2, 3.3), [4.2, 1.0, 3.6, 1.0], [3.6, 1.0, 3.6, 0.0]])
    return Floorplan.from_segments(np.concatenate([room, room + [SHIFT, 0, SHIFT, 0]]), ceiling_height=2.5)


@pytest.fixture(scope="module")
def likelihood(twins):
    return Likelihood(profile_field(twins))


def look(plan, pose):
    """Layout and rays of the true junctions."""
    wireframe = visible_wireframe(plan, CAMERA, pose, 1.4)
    return Localizer(plan, CAMERA).observe(wireframe, (0.0, 0.0), Heights())


def seen_from(plan, pose):
    return observation(*look(plan, pose))


POSE = np.array([1.33, 1.58, 0.3])


def masses(belief):
    return [belief.mass_near(POSE + [x, 0, 0], APART_M) for x in (0.0, SHIFT)]


def fused(likelihood, seen, times, fair):
    belief = Belief(likelihood.field, headings=72)
    for _ in range(times):
        found = likelihood.cell_volume(seen, belief.group)
        if fair:
            found = levelled(likelihood, seen, belief, found, None, FRAME_TEMPER)
        belief.add(found, -40.0, temper=FRAME_TEMPER, frame_floor=-12.0)
    return belief


def test_rooms_of_one_shape_stay_even_however_often_one_looks(twins, likelihood):
    seen = seen_from(twins, POSE)
    here, there = masses(fused(likelihood, seen, 25, fair=True))
    assert here + there > 0.9
    assert abs(math.log(here / there)) < 1.0
    drifted = np.array(masses(fused(likelihood, seen, 25, fair=False)))
    assert abs(math.log(max(drifted.min(), 1e-12) / drifted.max())) > 3.0  # what the grid makes of it


def test_a_place_that_fits_better_still_wins(twins, likelihood):
    """One of the rooms has lost its niche."""
    other = Floorplan.from_segments(
        np.concatenate([twins.segments[:6], np.array(rectangle(SHIFT, 0, SHIFT + 4.2, 3.3))]), ceiling_height=2.5
    )
    different = Likelihood(profile_field(other))
    belief = fused(different, seen_from(twins, np.array([1.33, 1.58, -0.6])), 3, fair=True)
    here, there = masses(belief)
    assert here > 20.0 * there


def test_off_the_grid_it_is_the_same_likelihood(likelihood, twins):
    seen = seen_from(twins, POSE)
    rows = np.arange(0, len(likelihood.field.positions), 97)
    headings = np.arange(0, 360, 15)
    grid = likelihood.volume(seen, headings, rows=rows)
    free = likelihood.at(seen, likelihood.field.positions[rows], headings, likelihood.field.resolution)
    assert free == pytest.approx(grid, abs=1e-3)


def test_a_belief_that_is_open_or_settled_is_left_alone(likelihood, twins):
    seen = seen_from(twins, POSE)
    belief = Belief(likelihood.field, headings=72)
    flat = np.zeros((len(belief.positions), 72), np.float32)
    assert levelled(likelihood, seen, belief, flat, None, 1.0) is flat  # far more than MOST_PLACES
    assert MOST_PLACES < 100
    one = np.full_like(belief.p, 0.0)
    one[likelihood.field.nearest(POSE[:2]), 3] = 1.0
    belief.set(one)
    found = likelihood.cell_volume(seen, belief.group)
    assert levelled(likelihood, seen, belief, found, None, 1.0) is found


@pytest.mark.parametrize("beside", [[0.1, -0.1, 0.0], [-0.1, 0.1, 0.09], [0.15, 0.1, -0.09]])
def test_a_place_whose_only_cell_lies_beside_the_pose_is_not_lost(twins, likelihood, beside):
    """A filter that has come down to one cell per place drags it along; this one has dragged one of them off."""
    belief = Belief(likelihood.field, headings=72)
    p = np.zeros_like(belief.p)
    for pose in (POSE + beside, POSE + [SHIFT, 0, 0]):
        heading = int(np.abs(wrap_angle(belief.headings_rad - pose[2])).argmin())
        p[likelihood.field.nearest(pose[:2]), heading] = 0.5
    seen = seen_from(twins, POSE)
    odds = []
    for fair in (False, True):
        belief.set(p)
        rows = belief.best_rows(-20.0)
        found = likelihood.cell_volume(seen, belief.group, rows=rows)
        if fair:
            found = levelled(likelihood, seen, belief, found, rows, FRAME_TEMPER)
        belief.add(found, -40.0, rows=rows, temper=FRAME_TEMPER, frame_floor=-12.0)
        here, there = masses(belief)
        odds.append(math.log(here / there))
    assert odds[0] < -8.0  # what its cell says
    assert abs(odds[1]) < 0.5


def test_what_is_given_is_not_changed(likelihood, twins):
    seen = seen_from(twins, POSE)
    belief = fused(likelihood, seen, 1, fair=False)
    found = likelihood.cell_volume(seen, belief.group)
    before = found.copy()
    fair = levelled(likelihood, seen, belief, found, None, FRAME_TEMPER)
    assert fair is not found and np.array_equal(found, before)
    rows = belief.best_rows(-20.0)
    part = levelled(likelihood, seen, belief, found[rows], rows, FRAME_TEMPER)
    assert part.shape == (len(rows), 72) and np.isfinite(part).all()


def test_a_localizer_in_one_of_the_rooms_is_not_sure_of_it(twins):
    localizer = Localizer(twins, CAMERA)
    layout, rays = look(twins, POSE)
    for _ in range(15):
        estimate = localizer.fuse(rays, (0.0, 0.0, 0.0), layout)
    assert 0.25 < estimate.confidence < 0.75
