"""Exploration: sees what there is to see, gets around what is not on the map, and moves its memories along."""

import math

import numpy as np
import pytest
from galoc_agents.coverage import REACH_M, Coverage
from galoc_agents.explore import Explore
from galoc_agents.moves import FORWARD, LEFT
from galoc_agents.paths import Paths
from galoc_agents.trail import Trail, apart, moved
from small_world import small_plan

from galoc import Camera, Floorplan
from galoc_env.env import FloorplanEnv
from galoc_env.motion import BODY_RADIUS
from galoc_env.policy import Robot, told

CAMERA = Camera.from_hfov(64, 48, 60.0)
BLIND = {"localizer": "none", "renderer": "none", "detector": "oracle", "width": 64, "height": 48, "hfov_deg": 60.0}


@pytest.fixture
def small_file(tmp_path):
    return str(small_plan().save(tmp_path / "small.json"))


def guided(env, policy, seed, steps, lie=None):
    """Poses (steps + 1, 3) and moves of a robot that is told its pose, or what ``lie(step, pose)`` makes of it."""
    observation, info = env.reset(seed=seed)
    policy.reset(Robot.of(env, seed, steps))
    poses, moves = [info["pose"]], []
    for step in range(steps):
        pose = info["pose"] if lie is None else lie(step, info["pose"])
        moves.append(policy.act({**observation, "estimate": np.array([*pose, 1.0], np.float32)}, told(policy, info)))
        observation, _, _, _, info = env.step(moves[-1])
        poses.append(info["pose"])
    return np.array(poses), moves


def rests(poses):
    """The longest number of acts within 5 cm of one place."""
    longest = begin = 0
    for index, pose in enumerate(poses):
        if np.hypot(*(pose[:2] - poses[begin, :2])) > 0.05:
            begin = index
        longest = max(longest, index - begin)
    return longest


# ---- coverage


@pytest.fixture(scope="module")
def coverage():
    plan = small_plan()
    return Coverage(plan, CAMERA, Paths(plan).positions)


def test_seen_is_what_lies_in_view_and_line_of_sight(coverage):
    seen = coverage.seen(np.array([[1.0, 1.9, 0.0]]))
    assert 0 < np.count_nonzero(seen) < len(seen)
    offset = coverage.cells[seen] - (1.0, 1.9)
    assert np.all(np.abs(np.arctan2(offset[:, 1], offset[:, 0])) <= math.radians(30.0) + 1e-9)
    assert np.all(np.hypot(*offset.T) <= REACH_M)
    beyond = coverage.cells[seen & (coverage.cells[:, 0] > 3.5)]
    assert len(beyond)  # through the door, but not behind the wall beside it
    at_door = 1.9 + (beyond[:, 1] - 1.9) * 2.5 / (beyond[:, 0] - 1.0)
    assert np.all((at_door > 1.4 - 0.06) & (at_door < 2.4 + 0.06))


def test_all_views_together_see_all(coverage):
    poses = [(*stand, heading) for stand in coverage.stands for heading in np.arange(0.0, 6.28, 1.0)]
    assert coverage.seen(np.array(poses)).mean() > 0.99
    assert not coverage.seen(np.zeros((0, 3))).any()


def test_gains_are_about_what_is_then_seen(coverage):
    rng = np.random.default_rng(0)
    unseen = rng.random(len(coverage.cells)) < 0.5
    headings = np.array([0.3, 2.0, -2.5])
    gains = coverage.gains(unseen, headings)
    assert gains.shape == (len(coverage.stands), 3)
    for stand in rng.integers(len(coverage.stands), size=10):
        for column, heading in enumerate(headings):
            view = coverage.seen(np.array([*coverage.stands[stand], heading])) & unseen
            assert gains[stand, column] == pytest.approx(view.mean(), abs=0.05)
    assert not coverage.gains(np.zeros(len(coverage.cells), bool), headings).any()


# ---- trail


def test_a_trail_moves_with_the_estimate():
    trail = Trail()
    for step in ([0.3, 0.0, 0.0], [0.3, 0.0, math.pi / 2], [0.3, 0.0, 0.0]):
        trail.move(np.array(step))
    trail.bump(0.3)
    here = np.array([5.0, 5.0, math.pi / 2])
    assert trail.poses(here)[:, :2] == pytest.approx(np.array([[4.4, 4.7], [4.7, 4.7], [5.0, 4.7], [5.0, 5.0]]))
    assert trail.obstacles(here) == pytest.approx(np.array([[5.0, 5.3]]))
    turned = np.array([5.0, 5.0, -math.pi / 2])
    assert trail.poses(turned)[0, :2] == pytest.approx([5.6, 5.3])
    assert trail.obstacles(turned) == pytest.approx(np.array([[5.0, 4.7]]))
    assert trail.way_back(0.6) == pytest.approx(math.atan2(0.6, -0.3))
    assert trail.way_back(5.0) is None
    trail.grant(here, np.array([1.0, 2.0, 0.5]))
    assert trail.views(here)[-1] == pytest.approx([1.0, 2.0, 0.5])
    assert trail.walked(here).min(axis=0) == pytest.approx([4.4, 4.7])


def test_motions_compose_and_differ():
    assert moved(np.array([1.0, 1.0, math.pi / 2]), np.array([0.3, 0.1, 0.2])) == pytest.approx(
        [0.9, 1.3, 1.7708], abs=1e-4
    )
    metres, turn = apart(np.array([0.0, 0.0, 3.1]), np.array([3.0, 4.0, -3.1]))
    assert (metres, turn) == pytest.approx((5.0, 2 * math.pi - 6.2))


# ---- the policy


def test_it_sees_a_furnished_home_and_never_rests():
    env, policy = FloorplanEnv(split="test", **BLIND), Explore()
    for seed in (3, 4, 5):
        poses, _ = guided(env, policy, seed, 200)
        coverage = Coverage(env.world.plan, env.camera, Paths(env.world.plan).positions)
        assert coverage.seen(poses).mean() > 0.8
        assert rests(poses) < 25
        assert np.hypot(*np.diff(poses[:, :2], axis=0).T).sum() > 10.0


def test_it_enters_the_other_room(small_file):
    env = FloorplanEnv(plan=small_file, furniture=0.0, **BLIND)
    for seed in range(3):
        poses, _ = guided(env, Explore(), seed, 60)
        coverage = Coverage(env.world.plan, env.camera, Paths(env.world.plan).positions)
        assert coverage.seen(poses[:40]).mean() > 0.85


@pytest.mark.parametrize("side", [1.5, 2.5])
def test_it_steps_around_in_a_room_that_it_sees_from_one_place(side, tmp_path):
    square = np.array([[0, 0, side, 0], [side, 0, side, side], [side, side, 0, side], [0, side, 0, 0]])
    file = Floorplan.from_segments(square).save(tmp_path / "room.json")
    env = FloorplanEnv(plan=str(file), furniture=0.0, **BLIND)
    for seed in range(3):
        poses, moves = guided(env, Explore(), seed, 100)
        assert rests(poses) < 40
        assert np.ptp(poses[30:, :2], axis=0).max() > 0.5 * (side - 2.0 * BODY_RADIUS)
        assert moves.count(FORWARD) < 60  # nor does it only run about


def test_it_sees_more_than_a_blind_walk():
    from galoc_agents.random_walk import RandomWalk

    env = FloorplanEnv(split="test", **BLIND)
    shares = []
    for policy in (Explore(), RandomWalk()):
        seen = []
        for seed in (3, 5):
            poses, _ = guided(env, policy, seed, 80)
            seen.append(Coverage(env.world.plan, env.camera, Paths(env.world.plan).positions).seen(poses).mean())
        shares.append(np.mean(seen))
    assert shares[0] > 1.5 * shares[1]


def test_shut_doors_do_not_hold_it_forever():
    env = FloorplanEnv(split="test", shut_doors=1.0, **BLIND)
    poses, moves = guided(env, Explore(), 4, 150)
    assert rests(poses) < 30
    assert 20 < moves.count(FORWARD) < 140


def test_a_lying_estimate_does_not_hold_it_either():
    env = FloorplanEnv(split="test", **BLIND)
    env.reset(seed=3)
    places = env.world.walkable.positions
    rng = np.random.default_rng(0)
    lies = [np.array([*places[rng.integers(len(places))], rng.uniform(-3, 3)]) for _ in range(20)]
    poses, _ = guided(env, Explore(), 3, 150, lie=lambda step, pose: lies[step // 8])
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).sum() > 5.0
    assert rests(poses) < 40


def test_what_it_has_seen_moves_along_when_the_estimate_jumps(small_file):
    env = FloorplanEnv(plan=small_file, furniture=0.0, **BLIND)
    observation, _ = env.reset(seed=0)
    policy = Explore()
    policy.reset(Robot.of(env, 0, 50))
    still = {**observation, "odometry": np.zeros(3, np.float32)}
    policy.act({**still, "estimate": np.array([1.0, 1.0, 0.0, 1.0])}, {})
    assert np.array_equal(policy._seen, policy._coverage.seen(np.array([1.0, 1.0, 0.0])))
    policy.act({**still, "estimate": np.array([5.0, 3.0, 3.0, 1.0])}, {})
    assert np.array_equal(policy._seen, policy._coverage.seen(np.array([5.0, 3.0, 3.0])))


def test_same_robot_same_moves():
    env = FloorplanEnv(split="test", **BLIND)
    policy = Explore()
    first, again = guided(env, policy, 4, 40)[1], guided(env, policy, 4, 40)[1]
    assert first == again == guided(env, Explore(), 4, 40)[1]
    assert guided(env, policy, 5, 40)[1] != first


def test_without_an_estimate_it_follows_the_belief_and_without_both_it_spins(small_file):
    from galoc_agents.spin import Spin

    env = FloorplanEnv(plan=small_file, **{**BLIND, "localizer": "galoc"})
    observation, info = env.reset(seed=1)
    policy = Explore()
    policy.reset(Robot.of(env, 1, 30))
    policy.act({**observation, "estimate": np.zeros(4, np.float32)}, told(policy, info))
    belief = policy._robot.belief
    place, heading = np.unravel_index(int(np.argmax(belief.p)), belief.p.shape)
    assert policy._here == pytest.approx([*belief.positions[place], belief.headings_rad[heading]])

    env = FloorplanEnv(plan=small_file, **BLIND)
    observation, info = env.reset(seed=1)
    spin = Spin()
    for made in (policy, spin):
        made.reset(Robot.of(env, 1, 30))
    assert (
        [policy.act(observation, {}) for _ in range(8)] == [spin.act(observation, {}) for _ in range(8)] == [LEFT] * 8
    )


def test_continuous_actions(small_file):
    env = FloorplanEnv(plan=small_file, actions="continuous", **BLIND)
    poses, moves = guided(env, Explore(), 0, 30)
    assert all(env.action_space.contains(move) for move in moves)
    assert np.ptp(poses[:, :2], axis=0).max() > 0.5
