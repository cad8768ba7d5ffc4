"""Hypotheses: a belief in a few weighted poses that still mean the same."""

import math

import numpy as np
import pytest
from galoc_agents.hypotheses import BLOCK_M, LEAST_SHARE, NEAR_M, NEAR_RAD, SECTORS, Hypotheses

from galoc_env.policy import BeliefView

V = 36


def belief(p, spacing=0.1, columns=40, headings=V, turned=0.0):
    """A belief on a grid of so many columns; p (P, V)."""
    index = np.arange(len(p))
    positions = np.column_stack([1.0 + spacing * (index % columns), -2.0 + spacing * (index // columns)])
    centres = (np.arange(headings) + 0.5) * math.tau / headings + turned
    return BeliefView(positions, centres, np.asarray(p, np.float32), spacing)


@pytest.fixture
def spread(rng):
    """A belief of the kind that a few frames leave: a few peaks over much that is nearly out."""
    p = rng.random((1200, V)) ** 40
    return belief(p / p.sum())


def keys(view, poses):
    """Block and sector of each pose."""
    col, row = np.floor((poses[:, :2] - view.positions.min(axis=0)) / BLOCK_M + 1e-9).astype(int).T
    width = math.tau / SECTORS
    return list(zip(row, col, ((poses[:, 2] - view.headings_rad[0]) / width + 1e-6).astype(int), strict=True))


def test_blocks_keep_the_mass_and_their_likeliest_cell(spread):
    made = Hypotheses.of(spread)
    place, heading = (i.ravel() for i in np.indices(spread.p.shape))
    cells = np.column_stack([spread.positions[place], spread.headings_rad[heading]])
    mass, best = {}, {}
    for key, p, pose in zip(keys(spread, cells), spread.p.ravel(), cells, strict=True):
        mass[key] = mass.get(key, 0.0) + float(p)
        best[key] = max(best.get(key, (0.0, ())), (float(p), tuple(pose)))
    found = keys(spread, made.poses)
    assert len(set(found)) == len(found) == len(mass)
    for key, weight, pose in zip(found, made.weights, made.poses, strict=True):
        assert weight == pytest.approx(mass[key], rel=1e-5)
        assert pose == pytest.approx(best[key][1])
    assert made.weights.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("headings", [4, 10, 36, 72, 360])
def test_any_number_of_heading_cells_will_do(headings, rng):
    p = rng.random((200, headings))
    made = Hypotheses.of(belief(p / p.sum(), headings=headings))
    assert made.weights.sum() == pytest.approx(1.0)
    centres = (np.arange(headings) + 0.5) * math.tau / headings
    assert np.abs(made.poses[:, 2, None] - centres).min(axis=1).max() < 1e-9
    assert len(made.weights) == 8 * math.gcd(SECTORS, headings)  # 40 by 5 cells of 0.1 m are 8 blocks


def test_a_sure_belief_is_one_hypothesis():
    p = np.full((1200, V), 1e-14)
    p[415, 7] = 1.0
    view = belief(p)
    made = Hypotheses.of(view)
    assert made.weights.tolist() == [1.0]
    assert made.poses[0] == pytest.approx([*view.positions[415], view.headings_rad[7]])
    p[30, 20] = 1e3 * LEAST_SHARE  # little, yet to speak of
    assert len(Hypotheses.of(belief(p)).weights) == 2


def test_an_empty_corner_of_the_grid_shifts_no_block():
    """Positions in any order, and anywhere: blocks are those of the plane."""
    rng = np.random.default_rng(1)
    p = rng.random((400, V))
    view = belief(p / p.sum())
    order = rng.permutation(400)
    mixed = BeliefView(view.positions[order], view.headings_rad, view.p[order], view.resolution)
    a, b = Hypotheses.of(view), Hypotheses.of(mixed)
    assert {tuple(pose) for pose in a.poses} == {tuple(pose) for pose in b.poses}
    assert np.sort(a.weights) == pytest.approx(np.sort(b.weights))


# ---- thinned


def some(rng, count, power=6):
    weights = rng.random(count) ** power
    poses = np.column_stack([rng.uniform(0, 10, (count, 2)), rng.uniform(-3, 3, count)])
    return Hypotheses(poses, weights / weights.sum())


@pytest.mark.parametrize("most", [1, 2, 8, 32, 200])
@pytest.mark.parametrize("power", [0, 1, 6, 60])
def test_thinned_is_a_distribution_over_some_of_them(most, power, rng):
    every = some(rng, 200, power)
    few = every.thinned(most)
    assert len(few.weights) == len(few.poses) == min(most, 200)
    assert few.weights.sum() == pytest.approx(1.0)
    assert np.all(few.weights > 0.0) and np.all(np.diff(few.weights) <= 0.0)
    assert {tuple(pose) for pose in few.poses} <= {tuple(pose) for pose in every.poses}
    assert len({tuple(pose) for pose in few.poses}) == len(few.poses)


def test_the_heavy_ones_stay_as_they_are(rng):
    every = some(rng, 300, 40)
    few = every.thinned(32)
    order = np.argsort(-every.weights)
    even = few.weights[-1]  # what those that stand for others weigh
    heavy = order[every.weights[order] > even * (1 + 1e-9)]
    assert 3 < len(heavy) < 32
    assert few.weights[: len(heavy)] == pytest.approx(every.weights[heavy])
    assert np.array_equal(few.poses[: len(heavy)], every.poses[heavy])
    assert few.weights[len(heavy) :] == pytest.approx(even)
    assert even * (32 - len(heavy)) == pytest.approx(every.weights[order[len(heavy) :]].sum())


def test_expectations_are_about_kept(rng):
    """The mean over beliefs of the error is none to speak of, and no single one is far off."""
    off = []
    for _ in range(60):
        every = some(rng, 400, 3)
        few = every.thinned(64)
        values = [np.cos(made.poses[:, 0]) + 0.1 * made.poses[:, 1] for made in (every, few)]
        off.append(few.weights @ values[1] - every.weights @ values[0])
    assert abs(np.mean(off)) < 0.04
    assert np.max(np.abs(off)) < 0.4


def test_thinning_is_the_same_each_time_and_does_nothing_to_few(rng):
    every = some(rng, 300)
    a, b = every.thinned(20), every.thinned(20)
    assert np.array_equal(a.poses, b.poses) and np.array_equal(a.weights, b.weights)
    same = some(rng, 20)
    kept = same.thinned(20)
    order = np.argsort(-same.weights)
    assert np.array_equal(kept.poses, same.poses[order]) and kept.weights == pytest.approx(same.weights[order])


# ---- weights and places


def test_weighed_is_bayes_rule_whatever_the_size(rng):
    made, evidence = some(rng, 10), rng.normal(size=10)
    expected = made.weights * np.exp(evidence)
    assert made.weighed(evidence).weights == pytest.approx(expected / expected.sum())
    assert made.weighed(evidence - 5000.0).weights == pytest.approx(expected / expected.sum())
    assert np.array_equal(made.weighed(evidence).poses, made.poses)


def test_tempered_takes_the_odds_to_a_power():
    made = Hypotheses(np.zeros((2, 3)), np.array([0.9, 0.1])).tempered(0.5)
    assert made.weights.sum() == pytest.approx(1.0)
    assert made.weights[0] / made.weights[1] == pytest.approx(3.0)


def test_near_is_the_same_place_and_direction():
    m, rad = 0.95 * NEAR_M, 0.95 * NEAR_RAD
    poses = [[0, 0, 3.1], [m, 0, 3.1], [0, 0, 3.1 + rad], [0, 0, 3.1 - math.tau], [1.1 * NEAR_M, 0, 3.1], [0, 0, 0]]
    near = Hypotheses(np.array(poses, float), np.full(6, 1 / 6)).near()
    assert near[0].tolist() == [True, True, True, True, False, False]
    assert np.array_equal(near, near.T) and near.diagonal().all()


def test_with_pose_is_one_more_in_front(rng):
    made = some(rng, 5)
    more = made.with_pose(np.array([7.0, 8.0, 0.5]), 0.25)
    assert more.poses[0].tolist() == [7.0, 8.0, 0.5]
    assert np.array_equal(more.poses[1:], made.poses)
    assert more.weights == pytest.approx(np.array([0.25, *made.weights]) / 1.25)
