"""What a robot remembers: dead reckoning, contacts with what is on no map, and its views where it now is."""

import math

import numpy as np
import pytest
from galoc_agents.frames import compose, relative
from galoc_agents.memory import BLIND_SHARE, REACH_M, SHORT_M, TOUCH_M, WALL_M, Memory
from galoc_agents.moves import BACKWARD, FORWARD, LEFT, STEP_M, TURN_RAD
from small_world import small_plan

FREE = np.array([1.5, 1.6, 0.0])  # in the open: no wall within 1.2 m
STILL = np.zeros(3)


@pytest.fixture
def memory():
    made = Memory(small_plan())
    made.take(STILL, 0.5)
    return made


def motion(*values):
    return np.array(values, np.float32)


# ---- frames


@pytest.mark.parametrize("seed", range(5))
def test_compose_and_relative_are_inverses(seed):
    rng = np.random.default_rng(seed)
    pose, others = rng.uniform(-4, 4, 3), rng.uniform(-4, 4, (6, 3))
    assert compose(pose, relative(pose, others)) == pytest.approx(others)
    assert relative(pose, compose(pose, others)) == pytest.approx(others)
    assert relative(pose, pose[None])[0] == pytest.approx(STILL)
    assert compose(pose, STILL)[0] == pytest.approx(pose)
    steps = rng.uniform(-1, 1, (2, 3))  # one after the other is one motion
    assert compose(compose(pose, steps[0])[0], steps[1])[0] == pytest.approx(
        compose(pose, compose(steps[0], steps[1])[0])[0]
    )


def test_motions_are_forward_left_and_counter_clockwise():
    facing_up = np.array([1.0, 2.0, math.pi / 2])
    assert compose(facing_up, np.array([0.3, 0.1, 0.2]))[0] == pytest.approx([0.9, 2.3, math.pi / 2 + 0.2])


# ---- views


def test_views_are_in_the_present_frame(memory):
    """Around a quarter circle: three steps and a turn, and two steps."""
    for odometry, share in [((1.0, 0, 0), 0.1), ((0, 0, math.pi / 2), 0.2), ((2.0, 0, 0), 0.3)]:
        memory.take(motion(*odometry), share)
    poses, shares = memory.views(len(memory))
    assert len(memory) == 4 and shares.tolist() == [0.5, 0.1, 0.2, 0.3]
    expected = [[-2.0, 1.0, -math.pi / 2], [-2.0, 0.0, -math.pi / 2], [-2.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    assert poses == pytest.approx(np.array(expected), abs=1e-6)
    last, told = memory.views(2)
    assert last == pytest.approx(poses[2:]) and told.tolist() == [0.2, 0.3]
    assert memory.views(9)[0] == pytest.approx(poses)


def test_dead_reckoning_adds_up_what_is_measured():
    rng = np.random.default_rng(0)
    memory, pose, truth = Memory(small_plan()), np.array([2.0, 1.0, 0.7]), []
    for _ in range(30):
        odometry = rng.uniform(-0.3, 0.3, 3)
        pose = compose(pose, odometry)[0]
        memory.take(odometry, 0.5)
        truth.append(pose)
    assert compose(pose, memory.views(30)[0]) == pytest.approx(np.array(truth))


def test_blind_is_as_long_as_no_view_told_anything():
    memory = Memory(small_plan())
    for _ in range(3):
        memory.take(STILL, BLIND_SHARE / 2.0)
        assert memory.blind
    memory.take(STILL, 2.0 * BLIND_SHARE)
    assert not memory.blind
    memory.take(STILL, 0.0)
    assert not memory.blind


# ---- places that are taken


def test_nothing_is_remembered_at_first(memory):
    assert memory.taken(FREE).shape == (0, 2)


@pytest.mark.parametrize(("move", "sign"), [(FORWARD, 1.0), (BACKWARD, -1.0)])
def test_a_step_that_falls_short_ended_at_something(memory, move, sign):
    memory.intend(move, FREE)
    memory.take(motion(sign * 0.1, 0, 0), 0.5)
    here = compose(FREE, np.array([sign * 0.1, 0, 0]))[0]
    assert memory.taken(here) == pytest.approx(np.array([[here[0] + sign * REACH_M, here[1]]]))


def test_contacts_stay_where_they_are_as_the_body_goes_on(memory):
    memory.intend(FORWARD, FREE)
    memory.take(motion(0.1, 0, 0), 0.5)
    thing = memory.taken(here := compose(FREE, np.array([0.1, 0, 0]))[0])
    for odometry in ((0, 0, TURN_RAD), (-STEP_M, 0, 0), (0, 0, -2 * TURN_RAD), (STEP_M, 0, 0)):
        memory.intend(LEFT, here)
        memory.take(motion(*odometry), 0.5)
        here = compose(here, np.array(odometry))[0]
        assert memory.taken(here) == pytest.approx(thing, abs=1e-6)
    # Believed elsewhere, it lies elsewhere: beside where the body then is.
    there = np.array([5.0, 2.0, 1.0])
    local = relative(here, np.column_stack([thing, [0.0]]))
    assert memory.taken(there) == pytest.approx(compose(there, local)[:, :2], abs=1e-6)


def test_whole_steps_and_turns_touch_nothing(memory):
    for move, odometry in [
        (FORWARD, (STEP_M, 0, 0)),
        (FORWARD, (STEP_M - 0.9 * SHORT_M, 0, 0)),
        (BACKWARD, (-STEP_M, 0, 0)),
        (LEFT, (0, 0, TURN_RAD)),
    ]:
        memory.intend(move, FREE)
        memory.take(motion(*odometry), 0.5)
    assert len(memory.taken(FREE)) == 0
    memory.intend(FORWARD, FREE)
    memory.take(motion(STEP_M - 1.1 * SHORT_M, 0, 0), 0.5)
    assert len(memory.taken(FREE)) == 1


def test_without_an_intention_a_short_motion_is_no_contact(memory):
    memory.take(motion(0.05, 0, 0), 0.5)
    assert len(memory.taken(FREE)) == 0


def test_walls_of_the_map_are_not_remembered(memory):
    """The wall at x = 6 stops the body; a little before it, something else does."""
    gap = 6.0 - TOUCH_M
    for short_of_it, things in [(0.02, 0), (0.5 * WALL_M, 0), (2.0 * WALL_M, 1)]:
        before = np.array([gap - short_of_it - 0.1, 1.0, 0.0])
        memory.intend(FORWARD, before)
        memory.take(motion(0.1, 0, 0), 0.5)
        assert len(memory.taken(FREE)) == things
    memory.intend(FORWARD, np.array([-3.0, 1.0, 0.0]))  # off the map
    memory.take(motion(0.1, 0, 0), 0.5)
    assert len(memory.taken(FREE)) == 1
