"""The expected entropy, the shares of rays seen and the freshness of views: against plain numpy, and as laws."""

import math
from dataclasses import replace

import numpy as np
import pytest
from galoc_agents._gain_kernel import expected_entropy, freshness, shares_seen
from galoc_agents.infogain import EDGE_DEG
from galoc_agents.sight import BINS, LOW, PER_UNIT, Sight
from small_world import small_plan

from galoc import Camera, Floorplan
from galoc.profiles import profile_field

SCALE_PRECISION, FLOOR, BUMP, DEAD = 1.0 / (9.0 * 0.15**2), -10.0, 3.0, 1.0
LEFT, UP = math.radians(30.0), math.pi / 2
# Rooms that are the same from inside, side by side under a passage that goes on beyond the second one.
TWINS = [
    [0, 0, 6, 0], [6, 0, 6, 3], [6, 3, 9, 3], [9, 3, 9, 4.5], [9, 4.5, 0, 4.5], [0, 4.5, 0, 0],
    [3, 0, 3, 3], [0, 3, 1, 3], [2, 3, 4, 3], [5, 3, 6, 3],
]  # fmt: skip


class World:
    """A map and a camera, as the kernels want them."""

    def __init__(self, plan, hfov_deg=75.0):
        sight = Sight.of(Camera.from_hfov(64, 48, hfov_deg))
        # A few rays less on one side: left and right must not be mixed up.
        rays, measured, precision = sight.rays[3:], sight.measured[3:], sight.precision[3:]
        self.sight = replace(sight, rays=rays, measured=measured, precision=precision)
        self.field = profile_field(plan)
        self.log_ranges = np.log(np.maximum(self.field.ranges, 1e-3))
        around = np.stack([np.roll(self.log_ranges, degrees, axis=1) for degrees in range(-EDGE_DEG, EDGE_DEG + 1)])
        self.bounds = np.ascontiguousarray(around.min(axis=0)), np.ascontiguousarray(around.max(axis=0))
        self.grid = self.log_ranges, self.field.index, self.field.origin, self.field.resolution, self.sight.rays

    def entropy(
        self, tree, parent, hypotheses, *, prior=None, outer=None, near=None, fresh=None, dead=DEAD, plain=False
    ):
        k, s = len(hypotheses), self.sight
        prior = np.full(k, 1.0 / k) if prior is None else np.array(prior, float)
        outer = prior if outer is None else np.array(outer, float)
        near = np.eye(k, dtype=bool) if near is None else near
        fresh = np.ones(len(tree)) if fresh is None else fresh
        call = self.plain_entropy if plain else expected_entropy
        sight = s.measured, s.precision, s.limit_precision, s.weight
        numbers = [np.float32(number) for number in (SCALE_PRECISION, FLOOR, BUMP, dead)]
        ranges = self.log_ranges, *self.bounds, *self.grid[1:]
        return call(tree, parent, fresh, hypotheses, outer, prior, near, *ranges, *sight, *numbers)

    def view(self, pose):
        """(3, R) log ranges, the least and the greatest around each, or None where there is no free space."""
        row, col = np.floor((pose[:2] - self.field.origin)[::-1] / self.field.resolution).astype(int)
        height, width = self.field.index.shape
        if not (0 <= row < height and 0 <= col < width) or self.field.index[row, col] < 0:
            return None
        profile = self.log_ranges[self.field.index[row, col]].astype(float)
        bearing = round(math.degrees(pose[2])) + self.sight.rays
        around = profile[(bearing + np.arange(-EDGE_DEG, EDGE_DEG + 1)[:, None]) % 360]
        return np.stack([profile[bearing % 360], around.min(axis=0), around.max(axis=0)])

    def log_likelihood(self, mine, other, dead):
        """What a view that is ``mine`` says of a hypothesis that would see ``other``."""
        s, (mine, _, _), (_, low, high) = self.sight, mine, other
        at = np.clip(np.floor((mine - LOW) * PER_UNIT).astype(int), 0, BINS - 1)
        inside = mine >= s.measured
        p = np.where(inside, s.precision[np.arange(len(mine)), at].astype(float), 0.0)
        d = np.where(mine < low, low - mine, np.where(mine > high, high - mine, 0.0))
        shift = np.sum(p * np.clip(d, -1, 1)) / (p.sum() + SCALE_PRECISION)
        q = p * (d - shift) ** 2
        q = np.where(inside, q, s.limit_precision * np.maximum(low - s.measured - shift, 0.0) ** 2)
        cost = np.sum(q / (1.0 + q)) + SCALE_PRECISION * shift**2
        return min(max(dead - s.weight * cost / 2.0, FLOOR), 0.0)

    def plain_entropy(self, tree, parent, fresh, hypotheses, outer, prior, near, *rest):
        dead = float(rest[-1])
        k = len(hypotheses)
        total, stopped, entropy = np.zeros((len(tree), k, k)), np.zeros((len(tree), k), bool), np.zeros(len(tree))
        for node in range(len(tree)):
            if node:
                total[node] = total[parent[node]]
                views = [self.view(composed(pose, tree[node])) for pose in hypotheses]
                was = stopped[parent[node]]
                stopped[node] = was | np.array([view is None for view in views])
                for i, j in np.ndindex(k, k):
                    if i == j or was[i] or was[j]:
                        continue
                    if stopped[node, i] != stopped[node, j]:
                        total[node, i, j] -= BUMP
                    elif not stopped[node, i]:
                        total[node, i, j] += fresh[node] * self.log_likelihood(views[i], views[j], dead)
            mass = prior * np.exp(total[node])
            entropy[node] = -np.sum(outer * np.log((mass * near).sum(axis=1) / mass.sum(axis=1)))
        return entropy


def composed(pose, motion):
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.array(
        [pose[0] + c * motion[0] - s * motion[1], pose[1] + s * motion[0] + c * motion[1], pose[2] + motion[2]]
    )


def random_tree(rng, nodes):
    """A tree of steps and turns that branches at random, whether there are walls or not."""
    tree, parent = np.zeros((nodes, 3)), np.full(nodes, -1, np.int32)
    for node in range(1, nodes):
        parent[node] = rng.integers(node)
        motion = [(0.3, 0, 0), (-0.3, 0, 0), (0, 0, LEFT), (0, 0, -LEFT)][rng.integers(4)]
        tree[node] = composed(tree[parent[node]], motion)
    return tree, parent


def a_way(*motions):
    tree = [np.zeros(3)]
    for motion in motions:
        tree.append(composed(tree[-1], motion))
    return np.array(tree), np.arange(-1, len(motions), dtype=np.int32)


def some_poses(world, rng, count):
    places = world.field.positions[rng.integers(len(world.field.positions), size=count)]
    return np.column_stack([places + rng.uniform(-0.04, 0.04, (count, 2)), rng.uniform(-9, 9, count)])


@pytest.fixture(scope="module")
def small():
    return World(small_plan())


@pytest.fixture(scope="module")
def twins():
    return World(Floorplan.from_segments(TWINS, 2.6, name="twins"))


# ---- expected entropy


@pytest.mark.parametrize("seed", range(4))
def test_entropy_is_that_of_the_plain_formula(small, seed):
    rng = np.random.default_rng(seed)
    tree, parent = random_tree(rng, 40)
    hypotheses = some_poses(small, rng, 6)
    prior, outer, fresh = rng.dirichlet(np.ones(6)), rng.dirichlet(np.ones(6)), rng.uniform(size=40)
    near = np.eye(6, dtype=bool)
    near[0, 1] = near[1, 0] = seed % 2 == 0
    terms = {"prior": prior, "outer": outer, "near": near, "fresh": fresh, "dead": float(seed % 2)}
    found = small.entropy(tree, parent, hypotheses, **terms)
    expected = small.entropy(tree, parent, hypotheses, **terms, plain=True)
    assert found == pytest.approx(expected, rel=1e-3, abs=1e-4)
    assert np.ptp(expected) > 0.1  # the views did tell something


def test_a_camera_that_sees_no_near_wall_line_compares_what_it_knows_of_them(small):
    """With a narrow view from close by, walls fill the image: only that they are near is known."""
    narrow = World(small_plan(), 40.0)
    rng = np.random.default_rng(1)
    tree, parent = random_tree(rng, 30)
    hypotheses = some_poses(narrow, rng, 5)
    shares = shares_seen(hypotheses, tree, *narrow.grid, narrow.sight.measured)
    assert np.nanmin(shares) == 0.0 < np.nanmax(shares)
    found = narrow.entropy(tree, parent, hypotheses)
    assert found == pytest.approx(narrow.entropy(tree, parent, hypotheses, plain=True), rel=1e-3, abs=1e-4)


@pytest.mark.parametrize("seed", range(3))
def test_entropy_is_never_negative_and_never_grows_along_a_way(small, seed):
    rng = np.random.default_rng(seed)
    tree, parent = random_tree(rng, 60)
    prior = rng.dirichlet(np.ones(8))
    entropy = small.entropy(tree, parent, some_poses(small, rng, 8), prior=prior, fresh=rng.uniform(size=60))
    assert entropy[0] == pytest.approx(-np.sum(prior * np.log(prior)), abs=1e-6)
    assert np.all(entropy >= -1e-9)
    assert np.all(entropy[1:] <= entropy[parent[1:]] + 1e-6)
    assert entropy.min() < entropy[0] - 0.5


def test_the_expectation_is_over_outer_and_the_odds_are_the_priors(small):
    rng = np.random.default_rng(5)
    tree, parent = random_tree(rng, 20)
    hypotheses, prior = some_poses(small, rng, 3), np.array([0.5, 0.3, 0.2])
    each = [small.entropy(tree, parent, hypotheses, prior=prior, outer=one) for one in np.eye(3)]
    assert [one[0] for one in each] == pytest.approx(-np.log(prior))
    assert small.entropy(tree, parent, hypotheses, prior=prior) == pytest.approx(prior @ each)


def test_hypotheses_that_are_the_same_place_leave_nothing_to_tell(small):
    pose = np.array([1.3, 1.2, 0.4])
    tree, parent = random_tree(np.random.default_rng(0), 30)
    assert small.entropy(tree, parent, np.array([pose, pose]), near=np.ones((2, 2), bool)) == pytest.approx(0.0)
    apart = small.entropy(tree, parent, np.array([pose, pose]))  # no view could tell them apart either
    assert apart == pytest.approx(math.log(2.0))


def test_views_that_are_the_same_leave_the_priors_entropy(twins):
    tree, parent = a_way((0, 0, LEFT), (0, 0, LEFT), (0.3, 0, 0), (0, 0, -LEFT), (-0.3, 0, 0))
    hypotheses = np.array([[1.55, 1.25, 3.5], [4.55, 1.25, 3.5]])
    prior = np.array([0.7, 0.3])
    entropy = twins.entropy(tree, parent, hypotheses, prior=prior)
    assert entropy == pytest.approx(-np.sum(prior * np.log(prior)), abs=1e-5)


def test_stale_views_tell_nothing(small):
    tree, parent = random_tree(np.random.default_rng(1), 30)
    hypotheses = np.array([[1.25, 1.25, 0.4], [4.75, 2.55, 1.0]])
    free = small.entropy(tree[:1], parent[:1], hypotheses)[0]
    turns, before = a_way(*[(0, 0, LEFT)] * 11)  # nothing stops a turn
    assert small.entropy(turns, before, hypotheses, fresh=np.zeros(12)) == pytest.approx(free)
    assert small.entropy(turns, before, hypotheses)[-1] < free - 0.1


def test_what_is_seen_from_one_place_alone_makes_the_ways_there_win(twins):
    """Two equal rooms: turning tells nothing, and the passage before the door tells all."""
    hypotheses = np.array([[1.55, 1.25, UP], [4.55, 1.25, UP]])
    turns, turned = a_way(*[(0, 0, LEFT)] * 11)
    assert twins.entropy(turns, turned, hypotheses) == pytest.approx(math.log(2.0), abs=1e-3)
    out, walked = a_way(*[(0.3, 0, 0)] * 8, *[(0, 0, LEFT)] * 3)
    entropy = twins.entropy(out, walked, hypotheses)
    assert entropy[:4] == pytest.approx(math.log(2.0), abs=1e-3)
    assert entropy[-1] < 0.1
    # Both in one tree: the best node is one that looks along the passage.
    tree, parent = np.concatenate([turns, out[1:]]), np.concatenate([turned, walked[1:] + 11]).astype(np.int32)
    parent[12] = 0
    assert int(np.argmin(twins.entropy(tree, parent, hypotheses))) > 12 + 7


def test_where_a_wall_stops_one_of_two_odometry_tells(small):
    """One faces a wall 0.2 m on, the other has room; both learn no more from there on."""
    hypotheses = np.array([[0.45, 1.25, math.pi], [1.55, 1.25, math.pi]])
    tree, parent = a_way((-1e-6, 0, 0), (0.4, 0, 0), (0.3, 0, 0), (0, 0, LEFT))
    still = np.zeros(len(tree))  # no view counts: the bump alone tells
    entropy = small.entropy(tree, parent, hypotheses, fresh=still)
    assert entropy[:2] == pytest.approx(math.log(2.0), abs=1e-6)
    assert entropy[2:] == pytest.approx(math.log1p(math.exp(-BUMP)), abs=1e-5)
    both = np.array([[0.45, 1.25, math.pi], [0.45, 2.25, math.pi]])
    assert small.entropy(tree, parent, both, fresh=still) == pytest.approx(math.log(2.0), abs=1e-6)


def test_one_view_never_tells_more_than_the_floor(small):
    hypotheses = np.array([[0.35, 1.25, math.pi], [1.05, 1.25, 0.0]])  # a wall before the eyes, and a room
    tree, parent = a_way((0, 0, 1e-6))
    after = small.entropy(tree, parent, hypotheses, dead=0.0)[1]
    most = math.log1p(math.exp(FLOOR))
    assert most - 1e-6 <= after < 0.5


# ---- shares seen


@pytest.mark.parametrize("hfov_deg", [40.0, 75.0])
def test_shares_are_those_of_the_plain_formula(hfov_deg):
    world, rng = World(small_plan(), hfov_deg), np.random.default_rng(0)
    hypotheses, (views, _) = some_poses(world, rng, 12), random_tree(rng, 12)
    found = shares_seen(hypotheses, views, *world.grid, world.sight.measured)
    for i, w in np.ndindex(found.shape):
        seen = world.view(composed(hypotheses[i], views[w]))
        if seen is None:
            assert math.isnan(found[i, w])
        else:
            assert found[i, w] == pytest.approx(np.mean(seen[0] >= world.sight.measured))
    assert np.isnan(found).any() and (found == 0.0).any() and len(np.unique(found[found > 0.0])) >= 2


# ---- freshness


def test_freshness_is_that_of_the_plain_formula():
    rng = np.random.default_rng(0)
    tree, parent = random_tree(rng, 50)
    views = rng.uniform(-1.5, 1.5, (7, 3))
    found = freshness(tree, parent, views, 0.6, 0.4)
    for node in range(50):
        before, at = list(views), parent[node]
        while at >= 0:
            before.append(tree[at])
            at = parent[at]
        apart = tree[node] - np.array(before)
        apart[:, 2] = np.angle(np.exp(1j * apart[:, 2]))
        shared = np.exp(-np.sum((apart / [0.6, 0.6, 0.4]) ** 2, axis=1))
        assert found[node] == pytest.approx(1.0 - shared.max(), abs=1e-9)
    assert np.ptp(found) > 0.5


def test_a_view_is_news_once():
    tree, parent = a_way((0, 0, math.pi), (0, 0, math.pi), (2.0, 0, 0), (-2.0, 0, 0))
    fresh = freshness(tree, parent, np.zeros((0, 3)), 0.6, 0.4)
    assert fresh == pytest.approx([1.0, 1.0, 0.0, 1.0, 0.0], abs=1e-4)  # alone, behind, once more, away, back
    assert freshness(tree, parent, tree[3:4].copy(), 0.6, 0.4)[3] == 0.0
    near = freshness(*a_way((0.6, 0, 0)), np.zeros((1, 3)), 0.6, 0.4)
    assert near == pytest.approx([0.0, 1.0 - math.exp(-1.0)])
