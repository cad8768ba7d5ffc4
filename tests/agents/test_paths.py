"""Ways over a plan: as long as geometry says, walkable, and around what was run into."""

import math

import numpy as np
import pytest
from galoc_agents.moves import FORWARD, LEFT, RIGHT, STEP_M, TURN_RAD
from galoc_agents.paths import ARRIVED_M, Paths
from small_world import small_plan

from galoc import Floorplan, GalocError
from galoc_env import homes, motion

BOX = [[0, 0, 6, 0], [6, 0, 6, 5], [6, 5, 0, 5], [0, 5, 0, 0]]


@pytest.fixture(scope="module")
def box() -> Paths:
    return Paths(Floorplan.from_segments(BOX, 2.6, name="box"))


@pytest.fixture(scope="module")
def small() -> Paths:
    return Paths(small_plan())


def walked(plan: Floorplan, pose: np.ndarray, moves: list[int]) -> np.ndarray:
    """(M + 1, 3) poses of a body that makes these moves; none may end at a wall."""
    poses = [np.array(pose, dtype=np.float64)]
    for move in moves:
        done = motion.move(poses[-1], motion.commanded_motion(move, "discrete"), plan.segments)
        assert not done.collided
        poses.append(done.pose)
    return np.array(poses)


def test_distances_are_those_of_the_way(box: Paths) -> None:
    distance = box.distance((1.0, 2.5))
    straight = np.linalg.norm(box.positions - box.positions[box.node((1.0, 2.5))], axis=1)
    assert distance[box.node((1.0, 2.5))] == 0.0 and np.all(np.isfinite(distance))
    assert np.all(distance >= straight - 1e-9)
    inner = np.all((box.positions > 0.7) & (box.positions < [5.3, 4.3]), axis=1)
    assert np.all(distance[inner] <= 1.09 * straight[inner] + 0.3)  # eight directions, and walls cost more


def test_ways_lead_through_doors(small: Paths) -> None:
    across = small.distance((1.0, 0.6))[small.node((5.0, 0.6))]
    # There is one door, at (3.5, 1.9): no way is shorter than by its nearer jamb.
    shortest = math.hypot(2.5, 0.8 + 0.25) + math.hypot(1.5, 0.8 + 0.25)
    assert shortest - 0.3 < across < 2.0 * shortest


def test_cells_keep_the_body_off_walls(small: Paths) -> None:
    gaps = [motion.distances(xy, small.plan.segments).min() for xy in small.positions[::7]]
    assert min(gaps) >= motion.BODY_RADIUS


def test_moves_arrive_without_touching_a_wall(small: Paths) -> None:
    rng = np.random.default_rng(1)
    for _ in range(12):
        start, goal = small.positions[rng.integers(len(small.positions), size=2)]
        pose = np.array([*start, rng.uniform(-3, 3)])
        moves = small.moves_to(pose, goal)
        assert set(moves) <= {FORWARD, LEFT, RIGHT}
        assert np.hypot(*(walked(small.plan, pose, moves)[-1, :2] - goal)) < ARRIVED_M + 0.1


def test_moves_arrive_in_homes() -> None:
    rng = np.random.default_rng(2)
    for seed in range(4):
        plan = homes.generate(seed)
        paths = Paths(plan)
        for _ in range(4):
            start, goal = paths.positions[rng.integers(len(paths.positions), size=2)]
            pose = np.array([*start, rng.uniform(-3, 3)])
            end = walked(plan, pose, paths.moves_to(pose, goal))[-1, :2]
            assert np.hypot(*(end - goal)) < ARRIVED_M + 0.1


def test_moves_are_hardly_longer_than_needed(box: Paths) -> None:
    moves = box.moves_to((1.0, 2.5, 0.0), (4.6, 2.5))
    assert moves.count(FORWARD) <= 13 and len(moves) <= 14
    assert moves.count(FORWARD) * STEP_M > 3.6 - ARRIVED_M - 0.1
    assert box.moves_to((1.0, 2.5, 0.0), (1.0, 2.5)) == []
    behind = box.moves_to((4.6, 2.5, 0.0), (1.0, 2.5))
    assert 5 <= len(behind) - behind.count(FORWARD) <= 9 and TURN_RAD * 6 == pytest.approx(math.pi)


def test_first_moves_are_those_of_the_whole_way(small: Paths) -> None:
    pose, goal = np.array([1.0, 0.6, 0.0]), np.array([5.0, 0.6])
    moves = small.moves_to(pose, goal)
    distance = small.distance(goal)
    assert small.moves_down(pose, distance, 4) == moves[:4]
    assert small.next_move(pose, distance) == moves[0]


def test_obstacles_are_gone_around_and_forgotten(box: Paths) -> None:
    pose, goal, middle = np.array([1.0, 2.5, 0.0]), np.array([5.0, 2.5]), np.array([3.0, 2.5])
    free = box.distance(goal)[box.node(pose[:2])]

    def nearest() -> float:
        way = walked(box.plan, pose, box.moves_to(pose, goal))
        assert np.hypot(*(way[-1, :2] - goal)) < ARRIVED_M + 0.1
        return float(np.linalg.norm(way[:, :2] - middle, axis=1).min())

    assert nearest() < 0.2
    box.obstruct([middle])
    assert nearest() > 0.3
    box.obstruct([middle], walked=np.linspace((1.0, 2.5), (5.0, 2.5), 40))  # been there: free after all
    assert nearest() < 0.2
    box.obstruct([])
    assert box.distance(goal)[box.node(pose[:2])] == free


def test_no_obstacle_shuts_a_door_for_good(small: Paths) -> None:
    small.obstruct([(3.5, 1.9)] * 5)
    assert np.all(np.isfinite(small.distance((1.0, 0.6))))
    small.obstruct([])


def test_places_off_the_grid_count_as_the_nearest_on_it(box: Paths) -> None:
    assert np.linalg.norm(box.positions[box.node((-3.0, 2.5))] - (0.3, 2.5)) < 0.15
    assert np.linalg.norm(box.positions[box.node((3.0, 0.05))] - (3.0, 0.3)) < 0.15


def test_a_plan_without_room_is_refused() -> None:
    narrow = [[0, 0, 9, 0], [9, 0, 9, 0.52], [9, 0.52, 0, 0.52], [0, 0.52, 0, 0]]
    with pytest.raises(GalocError, match="body"):
        Paths(Floorplan.from_segments(narrow, 2.6, name="narrow"))
