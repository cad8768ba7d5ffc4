"""Infogain and oracle: they go where views tell hypotheses apart, and act whatever they are given."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from galoc_agents import make_policy
from galoc_agents.explore import Explore
from galoc_agents.hypotheses import Hypotheses
from galoc_agents.infogain import SEEN_SHARE, TEMPER, InfoGain
from galoc_agents.moves import FORWARD, LEFT, RIGHT, TURN_RAD, TURNS_AROUND
from galoc_agents.oracle import Oracle
from gymnasium import spaces
from small_world import small_plan

from galoc import Camera, Floorplan
from galoc_env import motion
from galoc_env.env import FloorplanEnv
from galoc_env.policy import TOLD, Robot, sees_truth, told

CAMERA = Camera.from_hfov(64, 48, 75.0)
HEADINGS = 36
DOWN, UP = -math.pi / 2, math.pi / 2
# Rooms that are the same from inside, side by side under a passage that goes on beyond the second one.
TWINS = [
    [0, 0, 6, 0], [6, 0, 6, 3], [6, 3, 9, 3], [9, 3, 9, 4.5], [9, 4.5, 0, 4.5], [0, 4.5, 0, 0],
    [3, 0, 3, 3], [0, 3, 1, 3], [2, 3, 4, 3], [5, 3, 6, 3],
]  # fmt: skip
NEXT_ROOM = np.array([3.0, 0.0, 0.0])
# A room, and a closet without a door in which the body can only turn.
CLOSET = [[0, 0, 4, 0], [4, 0, 4, 3], [4, 3, 0, 3], [0, 3, 0, 0], [3, 3, 3, 2], [3, 2, 4, 2]]


class OnlyTold(dict):
    """Raises on everything that a robot does not have."""

    def __getitem__(self, key):
        assert key in TOLD, f"a policy read {key}, which only the environment knows"
        return super().__getitem__(key)

    def get(self, key, default=None):
        assert key in TOLD, f"a policy read {key}, which only the environment knows"
        return super().get(key, default)

    def _all(self):
        raise AssertionError("a policy went through all that there is")

    __iter__ = keys = values = items = _all


class Guess:
    """A belief that holds the poses it is told to, exactly, with the surface of galoc's."""

    resolution = 0.1

    def hold(self, weighted):
        self.positions = np.array([pose[:2] for pose, _ in weighted])
        self.headings_rad = weighted[0][0][2] + np.arange(HEADINGS) * math.tau / HEADINGS
        self.p = np.zeros((len(weighted), HEADINGS), np.float32)
        for row, (pose, weight) in enumerate(weighted):
            turn = np.abs(np.angle(np.exp(1j * (self.headings_rad - pose[2]))))
            self.p[row, np.argmin(turn)] = weight


@pytest.fixture(scope="module")
def twins():
    return Floorplan.from_segments(TWINS, 2.6, name="twins")


@pytest.fixture(scope="module")
def closet():
    return Floorplan.from_segments(CLOSET, 2.6, name="closet")


@pytest.fixture(scope="module")
def infogain():
    """One for many episodes: what it has worked out of a map is kept."""
    return InfoGain()


@pytest.fixture(scope="module")
def explore():
    return Explore()


def wander(policy, plan, start, steps, beliefs, *, walls=None, coverage=0.5, limit=100):
    """Poses (steps + 1, 3) and moves of a robot that believes ``beliefs(pose)``, [(pose, weight)], whatever it sees."""
    guess = Guess()
    robot = Robot(plan, CAMERA, "discrete", spaces.Discrete(4), 0, limit, SimpleNamespace(belief=guess))
    walls = plan.segments if walls is None else walls
    poses, moves, odometry = [np.array(start, float)], [], np.zeros(3)
    policy.reset(robot)
    for _ in range(steps):
        guess.hold(beliefs(poses[-1]))
        info = {"coverage": coverage, "pose": poses[-1]} if sees_truth(policy) else OnlyTold(coverage=coverage)
        moves.append(policy.act({"odometry": odometry.astype(np.float32)}, info))
        moved = motion.move(poses[-1], motion.commanded_motion(moves[-1], "discrete"), walls)
        odometry = moved.odometry
        poses.append(moved.pose)
    return np.array(poses), moves


def either_room(pose):
    """The two rooms are all the same to it: each is as likely, wherever it is."""
    other = pose + NEXT_ROOM if pose[0] < 3.0 else pose - NEXT_ROOM
    return [(pose, 0.5), (other, 0.5)]


def small_env(tmp_path, **arguments):
    file = str(small_plan().save(tmp_path / "small.json"))
    blind = {"renderer": "none", "detector": "oracle", "width": 64, "height": 48, "hfov_deg": 75.0}
    return FloorplanEnv(plan=file, **{**blind, "localizer": "galoc", **arguments})


def actions(env, policy, seed, steps, hide=True):
    """What a policy does in an episode; all of it lies in the action space."""
    observation, info = env.reset(seed=seed)
    policy.reset(Robot.of(env, seed, steps))
    taken = []
    for _ in range(steps):
        taken.append(policy.act(observation, OnlyTold(info) if hide else told(policy, info)))
        assert env.action_space.contains(taken[-1])
        observation, _, _, _, info = env.step(taken[-1])
    return np.array(taken)


# ---- where it goes


@pytest.mark.parametrize("start", [(1.55, 1.25, DOWN), (4.55, 1.25, DOWN), (4.45, 0.95, 0.0)])
def test_it_leaves_the_room_of_which_there_are_two(twins, infogain, start):
    poses, _ = wander(infogain, twins, start, 10, either_room)
    at_door = poses[:, 1] > 2.2  # from there on the passage shows
    assert at_door.any()
    assert np.all(np.diff(poses[: np.argmax(at_door) + 1, 1]) >= -1e-6)  # by no detour


def test_what_it_knows_it_does_not_ask(twins, infogain, explore):
    """A sure belief leaves nothing to tell: then it does what exploration does."""
    start = (1.55, 1.25, DOWN)
    sure = wander(infogain, twins, start, 20, lambda pose: [(pose, 1.0)])
    explored = wander(explore, twins, start, 20, lambda pose: [(pose, 1.0)])
    assert sure[1] == explored[1]
    assert wander(infogain, twins, start, 20, either_room)[1] != sure[1]


def test_it_turns_around_as_long_as_it_sees_nothing(twins, infogain):
    moves = wander(infogain, twins, (1.55, 1.25, DOWN), 24, either_room, coverage=0.0)[1]
    assert set(moves[:TURNS_AROUND]) <= {LEFT, RIGHT}
    assert FORWARD in moves[TURNS_AROUND:]
    assert FORWARD in wander(infogain, twins, (1.55, 1.25, DOWN), 12, either_room)[1]


def test_blind_it_turns_the_short_way_to_where_a_wall_would_show(twins):
    """As far as it can tell it is at one pose, and sees nothing there."""
    ways = set()
    for heading in np.radians(np.arange(0, 360, 30)):
        policy = InfoGain()
        first = wander(policy, twins, (1.55, 2.0, heading), 1, lambda pose: [(pose, 1.0)], coverage=0.0)[1][0]
        around = np.zeros((TURNS_AROUND, 3))
        around[:, 2] = heading + TURN_RAD * np.arange(1, TURNS_AROUND + 1)
        around[:, :2] = policy._robot.belief.positions[np.argmax(policy._robot.belief.p.max(axis=1))]
        here = Hypotheses(around, np.ones(TURNS_AROUND))
        seen = np.flatnonzero(policy._shares(here, np.zeros((1, 3)))[:-1, 0] >= SEEN_SHARE) + 1
        assert len(seen) and first == (LEFT if seen.min() <= TURNS_AROUND - seen.max() else RIGHT)
        ways.add(first)
    assert ways == {LEFT, RIGHT}


def test_a_shut_door_is_not_run_against_for_long(twins, infogain):
    """The map has a door where there is none; after a bump or two it is taken for shut."""
    walls = np.vstack([twins.segments, [[1.0, 2.6, 2.0, 2.6]]])
    poses, moves = wander(infogain, twins, (1.55, 1.25, UP), 30, either_room, walls=walls)
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    stuck = (np.array(moves) == FORWARD) & (steps < 0.2)
    assert poses[:, 1].max() > 2.2
    assert 1 <= np.count_nonzero(stuck) <= 12


def test_a_view_that_was_too_near_to_measure_weighs_against_those_who_would_have_measured(twins):
    """One of two stands before a wall that fills the image."""
    open_view, wall = np.array([1.5, 0.45, UP]), np.array([1.5, 0.45, DOWN])
    policy, weights = InfoGain(), []
    for coverage in (0.0, 1.0):
        wander(policy, twins, open_view, 1, lambda pose: [(open_view, 0.5), (wall, 0.5)], coverage=coverage)
        made = policy._weighed(policy._robot.belief).tempered(TEMPER)
        facing_up = np.abs(np.angle(np.exp(1j * (made.poses[:, 2] - UP)))) < 0.5
        weights.append(float(made.weights[facing_up].sum()))
    assert weights[0] < 0.2 < 0.8 < weights[1]


# ---- what it acts on


@pytest.mark.parametrize("kind", ["discrete", "continuous"])
def test_same_seed_same_actions_in_the_space_from_what_it_is_told(tmp_path, kind):
    env, policy = small_env(tmp_path, actions=kind), InfoGain()
    first = actions(env, policy, 3, 15)
    actions(env, policy, 4, 5)
    np.testing.assert_array_equal(first, actions(env, policy, 3, 15))
    np.testing.assert_array_equal(first, actions(env, InfoGain(), 3, 15))
    assert len(np.unique(first, axis=0)) > 1


@pytest.mark.parametrize(("policy", "kind"), [(InfoGain, "continuous"), (Oracle, "discrete")])
def test_without_a_belief_it_acts_too(tmp_path, policy, kind):
    env = small_env(tmp_path, localizer="small_world:DeadReckoner", reward="error", actions=kind)
    taken = actions(env, policy(), 1, 15)
    np.testing.assert_array_equal(taken, actions(env, Explore(), 1, 15))


def test_the_least_budget_gives_an_action(tmp_path, twins):
    actions(small_env(tmp_path), InfoGain(nodes=2, hypotheses=2), 3, 12)
    for nodes, hypotheses in ((1, 1), (2, 2), (5, 1)):
        moves = wander(InfoGain(nodes, hypotheses), twins, (1.55, 1.25, DOWN), 8, either_room)[1]
        assert set(moves) <= {0, 1, 2, 3}


def test_one_node_looks_nowhere_and_explores(twins, explore):
    start = (1.55, 1.25, DOWN)
    moves = [wander(made, twins, start, 12, either_room)[1] for made in (InfoGain(nodes=1), explore)]
    assert moves[0] == moves[1]


def test_it_goes_on_after_the_last_step(twins, infogain):
    assert len(wander(infogain, twins, (1.55, 1.25, DOWN), 8, either_room, limit=3)[1]) == 8


def test_another_map_is_another_world(twins, closet):
    policy = InfoGain()
    first = wander(policy, twins, (1.55, 1.25, DOWN), 12, either_room)[1]
    wander(policy, closet, (1.55, 1.25, DOWN), 5, lambda pose: [(pose, 0.5), (pose + [0, 0, math.pi], 0.5)])
    assert wander(policy, twins, (1.55, 1.25, DOWN), 12, either_room)[1] == first


@pytest.mark.parametrize("policy", [InfoGain, Oracle])
def test_shut_in_it_turns_and_does_not_fail(closet, policy):
    """A closet of 1 m: no step is possible, and the room beside it is another hypothesis."""
    start = (3.5, 2.5, 0.0)
    poses, moves = wander(policy(), closet, start, 15, lambda pose: [(pose, 0.4), (np.array([1.0, 1.0, 0.0]), 0.6)])
    assert np.all(np.hypot(*(poses[:, :2] - start[:2]).T) < 0.4)
    assert len(set(moves)) > 1
    twin = wander(policy(), closet, start, 15, lambda pose: [(pose, 0.5), (pose + [0, 0, UP], 0.5)])[1]
    assert set(twin) <= {0, 1, 2, 3}


# ---- the bound


def test_the_oracle_declares_that_it_sees_the_truth_and_needs_it(tmp_path):
    assert sees_truth(Oracle()) and not sees_truth(InfoGain())
    env = small_env(tmp_path)
    first = actions(env, Oracle(), 3, 10, hide=False)
    np.testing.assert_array_equal(first, actions(env, Oracle(), 3, 10, hide=False))
    with pytest.raises(AssertionError, match="pose"):
        actions(env, Oracle(), 3, 10)


@pytest.mark.parametrize("start", [(1.55, 1.25, DOWN), (4.55, 1.25, DOWN)])
def test_the_oracle_corrects_a_belief_that_is_sure_of_the_wrong_room(twins, infogain, explore, start):
    def wrong(pose):
        return either_room(pose)[1:]

    poses, moves = wander(Oracle(), twins, start, 12, wrong)
    assert poses[:, 1].max() > 2.2
    explored = wander(explore, twins, start, 12, wrong)[1]
    assert moves != explored == wander(infogain, twins, start, 12, wrong)[1]


def test_they_have_names():
    assert type(make_policy("infogain")) is InfoGain
    assert type(make_policy("oracle")) is Oracle
