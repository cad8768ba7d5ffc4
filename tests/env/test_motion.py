import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_world import WALLS, small_plan

from galoc import GalocError
from galoc_env import motion

SEGMENTS = np.array(WALLS, float)
TOLERANCE_M = 1e-9  # rounding of a few additions of numbers around 10


def test_discrete_actions_move_as_documented():
    pose = np.array([1.0, 1.0, math.pi / 2])
    nothing = np.zeros((0, 4))
    forward = motion.move(pose, motion.commanded_motion(0, "discrete"), nothing)
    assert forward.pose == pytest.approx([1.0, 1.3, math.pi / 2])
    assert motion.move(pose, motion.commanded_motion(1, "discrete"), nothing).pose == pytest.approx(
        [1.0, 0.7, math.pi / 2]
    )
    assert motion.move(pose, motion.commanded_motion(2, "discrete"), nothing).pose[2] == pytest.approx(
        math.radians(120)
    )
    assert motion.move(pose, motion.commanded_motion(3, "discrete"), nothing).pose[2] == pytest.approx(math.radians(60))


def test_continuous_action_scales_and_left_is_left():
    wanted = motion.commanded_motion(np.array([0.0, 1.0, -0.5], np.float32), "continuous")
    assert wanted == pytest.approx([0.0, 0.3, -math.radians(15)])
    moved = motion.move(np.zeros(3), wanted, np.zeros((0, 4)))
    assert moved.pose[:2] == pytest.approx([0.0, 0.3])  # facing +x, left is +y


@pytest.mark.parametrize("action", [4, -1, 1.5, "forward", None, [0, 1], math.nan, True])
def test_discrete_refusals(action):
    with pytest.raises(GalocError, match="action"):
        motion.commanded_motion(action, "discrete")


@pytest.mark.parametrize("action", [[0, 0, math.nan], [0, 1.2, 0], [0, 0], 0, "left", None, [math.inf, 0, 0]])
def test_continuous_refusals(action):
    with pytest.raises(GalocError, match="action"):
        motion.commanded_motion(action, "continuous")


def dense_free_fraction(start, shift, segments, radius):
    """The same by brute force: 4000 positions along the way."""
    for t in np.linspace(0.0, 1.0, 4001):
        if motion.distances(start + t * shift, segments).min() < radius:
            return t
    return 1.0


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_contact_agrees_with_brute_force(seed):
    rng = np.random.default_rng(seed)
    segments = rng.uniform(-2, 2, (4, 4))
    start, shift = rng.uniform(-2, 2, 2), rng.uniform(-2, 2, 2)
    if motion.distances(start, segments).min() < 0.26:
        return
    # Two sample steps (a grazing touch may fall between samples), plus the skin.
    tolerance = 2 / 4000 + motion.SKIN_M / float(np.hypot(*shift))
    exact = motion.free_fraction(start, shift, segments, 0.25)
    brute = dense_free_fraction(start, shift, segments, 0.25)
    if exact < 1.0 and brute == 1.0:  # touched between two samples only: then the way really grazes
        graze = motion.distances(start + (exact + motion.SKIN_M) * shift, segments).min()
        assert graze == pytest.approx(0.25, abs=2e-3)
    else:
        assert exact == pytest.approx(brute, abs=tolerance)


def test_no_tunnelling_through_a_thin_wall():
    wall = np.array([[0.0, -5.0, 0.0, 5.0]])
    moved = motion.move(np.array([-1.0, 0.0, 0.0]), np.array([50.0, 0.0, 0.0]), wall)
    assert moved.collided
    assert moved.pose[0] == pytest.approx(-motion.BODY_RADIUS, abs=2 * motion.SKIN_M)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_random_walk_never_enters_a_wall_and_odometry_adds_up(seed):
    rng = np.random.default_rng(seed)
    pose = np.array([1.5, 1.5, rng.uniform(-3, 3)])
    reckoned = pose.copy()
    for _ in range(100):
        moved = motion.move(pose, rng.uniform(-1, 1, 3) * [0.3, 0.3, 0.5], SEGMENTS)
        pose = moved.pose
        c, s = math.cos(reckoned[2]), math.sin(reckoned[2])
        dx, dy, turn = moved.odometry
        reckoned = reckoned + [c * dx - s * dy, s * dx + c * dy, turn]
        assert motion.distances(pose[:2], SEGMENTS).min() >= motion.BODY_RADIUS - TOLERANCE_M
        assert -math.pi <= pose[2] < math.pi
    assert pose[:2] == pytest.approx(reckoned[:2], abs=1e-9)
    assert math.cos(pose[2] - reckoned[2]) == pytest.approx(1.0)


def test_an_overlapping_body_may_leave_but_not_press_on():
    wall = np.array([[0.0, -5.0, 0.0, 5.0]])
    start = np.array([-0.1, 0.0])
    assert motion.free_fraction(start, np.array([-1.0, 0.0]), wall) == 1.0
    assert motion.free_fraction(start, np.array([1.0, 0.0]), wall) == 0.0


def test_walkable_is_clear_and_connected():
    plan = small_plan()
    furniture = np.array([[1.0, 1.0, 2.0, 1.0], [2.0, 1.0, 2.0, 2.0], [2.0, 2.0, 1.0, 2.0], [1.0, 2.0, 1.0, 1.0]])
    walk = motion.walkable(plan, furniture)
    obstacles = np.concatenate([plan.segments, furniture])
    least = min(motion.distances(xy, obstacles).min() for xy in walk.positions)
    assert least >= motion.BODY_RADIUS  # centres, with the 5 cm of reserve eating up the rasterization
    inside_box = np.all((walk.positions > 1.0) & (walk.positions < 2.0), axis=1)
    assert not inside_box.any()  # a closed piece of furniture is not part of the region
    assert (walk.positions[:, 0] > 4.0).any() and (walk.positions[:, 0] < 1.0).any()  # through the doorway
    assert walk.mask[walk.cell(walk.positions[0])]


def test_walkable_refuses_a_cupboard():
    from galoc import Floorplan

    closet = Floorplan.from_segments([[0, 0, 0.5, 0], [0.5, 0, 0.5, 5], [0.5, 5, 0, 5], [0, 5, 0, 0]])
    with pytest.raises(GalocError, match="unit"):
        motion.walkable(closet, np.zeros((0, 4)))


@pytest.mark.parametrize(
    "pose", [(0.1, 1, 0), (-5, 1, 0), (3.5, 0.7, 0), (1, 1), (1, math.nan, 0), "here", (1e9, 1e9, 0), None]
)
def test_start_refusals(pose):
    with pytest.raises(GalocError, match="start"):
        motion.checked_start(pose, small_plan(), SEGMENTS)


def test_start_accepted_and_wrapped():
    assert motion.checked_start([1, 1, 7.0], small_plan(), SEGMENTS) == pytest.approx([1, 1, 7.0 - 2 * math.pi])
