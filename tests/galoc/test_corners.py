"""The corners of a map: what counts as one, and how far they are trusted."""

import math

import numpy as np
import pytest

from galoc import Floorplan
from galoc.corners import CLEAN_M, SAME_M, SHARE_CLEAN, SHARE_ROUGH, STRAIGHT, map_corners


def plan_of(*walls: tuple[float, float, float, float]) -> Floorplan:
    return Floorplan.from_segments(np.array(walls, float))


def corners_of(*walls: tuple[float, float, float, float]) -> set[tuple[float, float]]:
    """Corners of some walls near y = 0; a far one makes them a plan."""
    found = map_corners(plan_of(*walls, (0.0, 9.0, 9.0, 9.0)))[0]
    return {(round(float(x), 6), round(float(y), 6)) for x, y in found if y < 8.0}


def plain_corners(plan: Floorplan) -> np.ndarray:
    """(C, 2) by comparing every end with every other."""
    a, b = plan.segments[:, :2], plan.segments[:, 2:]
    key = np.round(np.concatenate([a, b]) / SAME_M)
    outward = np.concatenate([b - a, a - b])
    outward /= np.hypot(*outward.T)[:, None]
    found = {}
    for k in key:
        here = (key == k).all(axis=1)
        arms = outward[here]
        straight = len(arms) == 2 and np.hypot(*arms.sum(axis=0)) < 2.0 * math.sin(STRAIGHT / 2.0)
        if not straight:
            found[tuple(k)] = np.concatenate([a, b])[here][0]
    return np.array(list(found.values()))


def test_turns_and_ends_are_corners_and_straight_joints_are_not() -> None:
    assert corners_of((0, 0, 3, 0), (3, 0, 6, 0), (6, 0, 6, 4)) == {(0, 0), (6, 0), (6, 4)}
    assert corners_of((0, 0, 3, 0), (6, 0, 3, 0)) == {(0, 0), (6, 0)}  # whichever way the segments run
    bend = 6.0 * math.tan(math.radians(5.0))
    assert (3.0, 0.0) in corners_of((0, 0, 3, 0), (3, 0, 9, bend))
    assert (3.0, 0.0) in corners_of((0, 0, 3, 0), (3, 0, 6, 0), (3, 0, 3, 4))  # a third wall joins
    assert (3.0, 0.0) in corners_of((0, 0, 3, 0), (3, 0, 1, 0))  # folded back on itself


@pytest.mark.parametrize("name", ["apartment", "gallery", "house", "corridor"])
def test_shipped_plans_equal_a_plain_search(name: str) -> None:
    plan = Floorplan.load(name)
    found, share = map_corners(plan)
    want = plain_corners(plan)
    assert len(found) == len(want)
    np.testing.assert_allclose(found[np.lexsort(found.T)], want[np.lexsort(want.T)], atol=SAME_M)
    assert SHARE_ROUGH <= share <= SHARE_CLEAN


def test_steps_of_a_raster_are_trusted_less() -> None:
    clean = plan_of((0, 0, 5, 0), (5, 0, 5, 4), (5, 4, 0, 4), (0, 4, 0, 0))
    assert map_corners(clean)[1] == pytest.approx(SHARE_CLEAN)
    step = 0.5 * CLEAN_M
    stairs = [(i * step, i * step, (i + 1) * step, i * step) for i in range(20)]
    stairs += [((i + 1) * step, i * step, (i + 1) * step, (i + 1) * step) for i in range(20)]
    assert map_corners(plan_of(*stairs))[1] == pytest.approx(SHARE_ROUGH)
