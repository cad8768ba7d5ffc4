"""What is known of the two heights: constructors, the scale they fix, and how they are learned."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from galoc import GalocError
from galoc.heights import Heights

SD = st.floats(0.01, 0.5)


def covariance(heights: Heights) -> np.ndarray:
    """(2, 2) of (log ceiling, log floor)."""
    c = heights.covariance
    return np.array([[heights.var_ceiling, c], [c, heights.var_floor]])


@given(st.floats(0.3, 2.0), st.floats(0.3, 3.0), SD)
def test_known_heights_come_back(camera: float, above: float, sd: float) -> None:
    heights = Heights.known(camera, camera + above, sd)
    assert math.exp(heights.log_floor) == pytest.approx(camera) and math.exp(heights.log_ceiling) == pytest.approx(
        above
    )
    assert heights.k == pytest.approx(math.log(camera / above))
    scale, scale_sd = heights.log_scale(heights.k, heights.k_sd)
    assert scale == pytest.approx(0.5 * math.log(camera * above), abs=1e-9)
    # Both given heights are above the floor; the ceiling's above the camera has the errors of both.
    by_camera, by_ceiling = np.array([-camera / above, 1.0]), np.array([(camera + above) / above, 0.0])
    spread = sd**2 * (np.outer(by_camera, by_camera) + np.outer(by_ceiling, by_ceiling))
    np.testing.assert_allclose(covariance(heights), spread, rtol=1e-9)
    assert scale_sd == pytest.approx(math.sqrt(spread.sum()) / 2.0, rel=1e-3, abs=2e-4)


@given(st.floats(-1.0, 1.0), SD, SD, st.floats(-0.9, 0.9), st.floats(-1.0, 1.0), st.floats(0.01, 0.3))
def test_scale_given_the_ratio_is_the_conditional_gaussian(
    mean: float, sd_c: float, sd_f: float, correlation: float, k: float, k_sd: float
) -> None:
    """E[scale | k] and its variance from the joint Gaussian of (k, scale), k known to ``k_sd``."""
    heights = Heights(mean, 0.3, sd_c**2, sd_f**2, correlation * sd_c * sd_f)
    turn = np.array([[-1.0, 1.0], [0.5, 0.5]])
    joint = turn @ covariance(heights) @ turn.T
    slope = joint[0, 1] / joint[0, 0]
    left = joint[1, 1] - slope * joint[0, 1]
    got, sd = heights.log_scale(k, k_sd)
    assert got == pytest.approx(0.5 * (mean + 0.3) + slope * (k - heights.k), abs=1e-6)
    assert sd**2 == pytest.approx(left + slope**2 * k_sd**2, rel=1e-5, abs=2e-8)


@given(st.floats(2.0, 4.0), st.floats(0.2, 0.8))
def test_ceiling_height_and_ratio_fix_the_scale(ceiling: float, share: float) -> None:
    floor, above = share * ceiling, (1.0 - share) * ceiling
    heights = Heights.under(ceiling, 0.02)
    k = math.log(floor / above)
    scale, sd = heights.log_scale(k, 0.1)
    assert scale == pytest.approx(0.5 * math.log(floor * above), abs=1e-9)
    step = 1e-5
    slope = (heights.log_scale(k + step, 0.1)[0] - heights.log_scale(k - step, 0.1)[0]) / (2.0 * step)
    assert sd == pytest.approx(math.hypot(0.02, slope * 0.1), rel=1e-5)


@given(st.lists(st.tuples(st.floats(-0.5, 0.5), st.floats(-0.3, 0.6), SD, SD), min_size=1, max_size=6))
def test_updates_equal_one_least_squares(rows: list[tuple[float, float, float, float]]) -> None:
    heights = Heights()
    information = np.linalg.inv(covariance(heights))
    vector = information @ [heights.log_ceiling, heights.log_floor]
    turn = np.array([[-1.0, 1.0], [0.5, 0.5]])
    for k, scale, sd_k, sd_scale in rows:
        heights = heights.updated(k, sd_k**2, scale, sd_scale**2, 0.0)
        weight = np.diag([1.0 / sd_k**2, 1.0 / sd_scale**2])
        information += turn.T @ weight @ turn
        vector += turn.T @ weight @ [k, scale]
    mean = np.linalg.solve(information, vector)
    np.testing.assert_allclose([heights.log_ceiling, heights.log_floor], mean, atol=1e-8)
    np.testing.assert_allclose(covariance(heights), np.linalg.inv(information), rtol=1e-6, atol=1e-10)


def test_no_height_is_trusted_beyond_the_floor() -> None:
    heights = Heights()
    for _ in range(200):
        heights = heights.updated(0.1, 1e-4, 0.2, 1e-4, 0.01)
    assert heights.var_ceiling >= 0.01**2 - 1e-12 and heights.var_floor >= 0.01**2 - 1e-12
    assert np.linalg.eigvalsh(covariance(heights)).min() > 0.0
    assert heights.log_ceiling == pytest.approx(0.15, abs=1e-3) and heights.log_floor == pytest.approx(0.25, abs=1e-3)


@pytest.mark.parametrize(
    "values",
    [(0.0, 2.6), (-1.0, 2.6), (2.6, 2.6), (3.0, 2.6), (math.nan, 2.6), (1.4, math.inf), ("1.4", 2.6), (1.4, 2.6, 0.0),
     (1.4, 2.6, 3.0), (1.4, 2.6, math.nan)],
)  # fmt: skip
def test_bad_heights_are_refused(values: tuple[Any, ...]) -> None:
    with pytest.raises(GalocError):
        Heights.known(*values)


@pytest.mark.parametrize("values", [(0.0,), (-2.6,), (math.nan,), (2.6, 0.0), (2.6, math.inf)])
def test_bad_ceilings_are_refused(values: tuple[float, ...]) -> None:
    with pytest.raises(GalocError):
        Heights.under(*values)
