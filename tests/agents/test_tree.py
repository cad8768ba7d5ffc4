"""Ways on a map: where the body gets to, which of the ways are considered, and what they cost."""

import math
from collections import deque

import numpy as np
import pytest
from galoc_agents._reach_kernel import CHECKS, choose, reach
from galoc_agents.frames import compose, relative
from galoc_agents.moves import BACKWARD, FORWARD, LEFT, RIGHT, STEP_M, TURN_RAD, TURNS_AROUND
from galoc_agents.tree import BLOCKS_M, BUMP_M, CELL_M, CLEARANCE_M, MAP_M, MOST_STATES, NEAR_ACTIONS, SECTORS, Tree
from small_world import small_plan

from galoc_env.motion import distances

MOTIONS = {FORWARD: (STEP_M, 0, 0), BACKWARD: (-STEP_M, 0, 0), LEFT: (0, 0, TURN_RAD), RIGHT: (0, 0, -TURN_RAD)}
START = np.array([1.02, 1.23, 0.35])
BUMPS = np.array([[3.5, y] for y in (1.6, 1.75, 1.9, 2.05, 2.2, 2.35)])  # in the doorway
NONE = np.zeros((0, 2))


@pytest.fixture(scope="module")
def plan():
    return small_plan()


def reached(plan, start=START, bumps=NONE, deepest=12, most=MOST_STATES):
    free = plan.free_space(MAP_M)
    return reach(
        start,
        free.clearance,
        free.origin,
        free.resolution,
        CLEARANCE_M,
        bumps,
        BUMP_M,
        CELL_M,
        TURNS_AROUND,
        STEP_M,
        deepest,
        most,
    )


def chosen(plan, states, most):
    blocks, sectors, origin = np.array(BLOCKS_M), np.array(SECTORS), plan.free_space(MAP_M).origin
    return choose(states[0], states[1], states[3], origin, TURNS_AROUND, NEAR_ACTIONS, blocks, sectors, most)


def clearance(plan, xy, bumps):
    walls = float(plan.free_space(MAP_M).clearance_at(xy))
    return min([walls, *(float(np.hypot(*(xy - bump))) + CLEARANCE_M - BUMP_M for bump in bumps)])


def free_way(plan, before, after, bumps):
    """Whether a step keeps the body off walls and bumps, or at least leads away from them."""
    gaps = [clearance(plan, before + share * (after - before), bumps) for share in np.linspace(0, 1, CHECKS + 1)]
    return all(now >= CLEARANCE_M or now > was for was, now in zip(gaps, gaps[1:], strict=False))


def plain_reach(plan, start, bumps, deepest):
    """{(row, col, turns): (depth, pose)} of the first state of each cell and direction."""
    origin = plan.free_space(MAP_M).origin
    found, queue = {}, deque([(start, 0, 0)])
    while queue:
        pose, turns, depth = queue.popleft()
        for move, motion in MOTIONS.items():
            after = compose(pose, np.array(motion, float))[0]
            if move in (FORWARD, BACKWARD) and not free_way(plan, pose[:2], after[:2], bumps):
                continue
            now = (turns + {LEFT: 1, RIGHT: -1}.get(move, 0)) % TURNS_AROUND
            key = (*(int(v) for v in ((after[:2] - origin) / CELL_M)[::-1]), now)
            if key not in found and depth < deepest:
                found[key] = depth + 1, after
                queue.append((after, now, depth + 1))
    return found


def turns_of(poses):
    return np.round((poses[:, 2] - poses[0, 2]) / TURN_RAD).astype(int) % TURNS_AROUND


@pytest.mark.parametrize("bumps", [NONE, BUMPS], ids=["free", "bumps"])
def test_it_finds_what_a_plain_search_finds(plan, bumps):
    poses, parent, move, depth = reached(plan, bumps=bumps, deepest=10)
    expected = plain_reach(plan, START, bumps, 10)
    origin = plan.free_space(MAP_M).origin
    cells = ((poses[:, :2] - origin) / CELL_M).astype(int)
    keys = [(int(row), int(col), int(turns)) for (col, row), turns in zip(cells, turns_of(poses), strict=True)]
    assert len(set(keys[1:])) == len(keys) - 1 == len(expected)  # one state of each cell and direction
    for key, pose, actions in zip(keys[1:], poses[1:], depth[1:], strict=True):
        assert expected[key][0] == actions
        assert pose[:2] == pytest.approx(expected[key][1][:2])
    assert (parent[0], move[0], depth[0]) == (-1, -1, 0) and np.array_equal(poses[0], START)


@pytest.mark.parametrize("bumps", [NONE, BUMPS], ids=["free", "bumps"])
def test_states_follow_from_their_parents_and_are_free_of_collision(plan, bumps):
    poses, parent, move, depth = reached(plan, bumps=bumps, deepest=14)
    numbers = np.arange(1, len(poses))
    assert np.all(parent[1:] < numbers) and np.all(np.diff(depth) >= 0) and depth.max() == 14
    assert np.array_equal(depth[1:], depth[parent[1:]] + 1)
    for node in numbers:
        after = compose(poses[parent[node]], np.array(MOTIONS[int(move[node])], float))[0]
        assert poses[node, :2] == pytest.approx(after[:2])
        assert math.cos(poses[node, 2] - after[2]) == pytest.approx(1.0)
    walls = [distances(pose[:2], plan.segments).min() for pose in poses]
    assert min(walls) >= CLEARANCE_M - MAP_M
    if len(bumps):
        assert np.linalg.norm(poses[:, None, :2] - bumps, axis=2).min() >= BUMP_M - 1e-9


def test_bumps_shut_the_door(plan):
    assert reached(plan, deepest=25)[0][:, 0].max() > 5.0
    assert reached(plan, bumps=BUMPS, deepest=25)[0][:, 0].max() < 3.5


def test_it_can_only_leave_where_it_is_too_close(plan):
    """Against a wall, the step away is there, the one into it and those along it are not."""
    poses, parent, move, _ = reached(plan, start=np.array([0.13, 1.6, 0.0]), deepest=1)
    assert move[1:].tolist() == [FORWARD, LEFT, RIGHT]
    assert poses[1, :2] == pytest.approx([0.43, 1.6])
    assert reached(plan, start=np.array([0.13, 1.6, math.pi / 2]), deepest=1)[2][1:].tolist() == [LEFT, RIGHT]


def test_it_ends_at_the_most_states(plan):
    every, some = reached(plan), reached(plan, most=100)
    assert len(some[0]) == 100 < len(every[0])
    for a, b in zip(every, some, strict=True):
        np.testing.assert_array_equal(a[:100], b)


# ---- the part of them that is considered


@pytest.mark.parametrize("most", [1, 2, 3, 30, 200, 10_000])
def test_whole_ways_are_kept(plan, most):
    states = reached(plan, deepest=20)
    taken = chosen(plan, states, most)
    assert taken[0] == 0 and np.all(np.diff(taken) > 0)
    assert np.isin(states[1][taken[1:]], taken).all()
    assert len(taken) <= most + states[3][taken].max()  # the last way is whole
    if most <= 200:
        assert len(taken) >= most
        assert np.isin(taken, chosen(plan, states, 10_000)).all()


def test_every_place_and_direction_is_considered_once(plan):
    """Each state has one taken no later in its block and sector, near and far; no way ends where another has been."""
    states = reached(plan, deepest=20)
    taken = chosen(plan, states, 10_000)
    assert len(taken) < len(states[0]) / 3
    far = (states[3] > NEAR_ACTIONS).astype(int)
    place = (states[0][:, :2] - plan.free_space(MAP_M).origin) // np.array(BLOCKS_M)[far][:, None]
    sector = turns_of(states[0]) * np.array(SECTORS)[far] // TURNS_AROUND
    keys = list(zip(far.tolist(), *place.T.tolist(), sector.tolist(), strict=True))
    first = {}
    for node, key in enumerate(keys):
        first.setdefault(key, node)
    assert set(first.values()) <= set(taken.tolist())
    leaves = set(taken.tolist()) - set(states[1][taken].tolist())
    assert leaves <= set(first.values())


# ---- the tree


@pytest.fixture(scope="module")
def tree(plan):
    return Tree.grow(plan, START, NONE, 20, 300)


def test_motions_compose_to_the_poses_of_the_ways(plan, tree):
    assert len(tree.parent) == len(tree.motion) == len(tree.move) == len(tree.depth) >= 300
    assert (tree.parent[0], tree.move[0], tree.depth[0]) == (-1, -1, 0) and not tree.motion[0].any()
    assert np.all(tree.parent[1:] < np.arange(1, len(tree.parent)))
    assert np.array_equal(tree.depth[1:], tree.depth[tree.parent[1:]] + 1)
    for node in range(1, len(tree.parent)):
        step = relative(tree.motion[tree.parent[node]], tree.motion[node : node + 1])[0]
        assert step[:2] == pytest.approx(MOTIONS[int(tree.move[node])][:2])
        assert math.cos(step[2] - MOTIONS[int(tree.move[node])][2]) == pytest.approx(1.0)
    states = reached(plan, deepest=20)
    taken = chosen(plan, states, 300)
    assert compose(START, tree.motion) == pytest.approx(states[0][taken])


def test_the_first_move_starts_the_way(tree):
    for node in range(1, len(tree.parent)):
        way = [node]
        while tree.parent[way[-1]] > 0:
            way.append(int(tree.parent[way[-1]]))
        assert len(way) == tree.depth[node]
        assert tree.first_move(node) == tree.move[way[-1]]
    assert {tree.first_move(node) for node in range(1, len(tree.parent))} == {FORWARD, BACKWARD, LEFT, RIGHT}


def test_bumps_and_the_deepest_and_the_most_bound_a_tree(plan):
    assert Tree.grow(plan, START, NONE, 45, 1000).motion[:, 0].max() > 3.5
    shut = Tree.grow(plan, START, BUMPS, 45, 1000)
    assert compose(START, shut.motion)[:, 0].max() < 3.5
    assert Tree.grow(plan, START, NONE, 3, 1000).depth.max() == 3
    assert len(Tree.grow(plan, START, NONE, 45, 1).parent) == 1


def test_the_cost_is_the_sum_of_what_is_left(plan):
    """0 - 1 - 2 and 0 - 3: two actions to the second node, one to the last."""
    parent, depth = np.array([-1, 0, 1, 0], np.int32), np.array([0, 1, 2, 1], np.int32)
    tree = Tree(np.zeros((4, 3)), parent, np.array([-1, 0, 0, 2], np.int32), depth)
    cost = tree.cost(np.array([2.0, 1.5, 0.25, 1.0]), 5)
    assert cost == pytest.approx([5 * 2.0, 1.5 + 4 * 1.5, 1.5 + 0.25 + 3 * 0.25, 1.0 + 4 * 1.0])
    assert tree.cost(np.array([2.0, 1.5, 0.25, 1.0]), 2) == pytest.approx([4.0, 3.0, 1.75, 2.0])


def test_far_away_is_worth_it_only_where_there_is_time():
    """A way of three actions to certainty, and one action that halves what is open."""
    tree = Tree(
        np.zeros((5, 3)),
        np.array([-1, 0, 1, 2, 0], np.int32),
        np.array([-1, 0, 0, 0, 2], np.int32),
        np.array([0, 1, 2, 3, 1], np.int32),
    )
    entropy = np.array([1.0, 1.0, 1.0, 0.0, 0.5])
    best = [tree.first_move(1 + int(np.argmin(tree.cost(entropy, horizon)[1:]))) for horizon in (3, 10)]
    assert best == [LEFT, FORWARD]
