"""Recall, success, rank and convergence at their edges."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from galoc import GalocError
from galoc.metrics import (
    HOLD,
    aurc,
    calibration_error,
    first_held,
    pose_error,
    rank,
    recall,
    reliability,
    risk_coverage,
    roc_auc,
    steps_to_converge,
    success,
    summarize_sequence,
    wrap_angle,
)

FLAGS = st.lists(st.booleans(), max_size=40)
ERRORS = st.lists(st.floats(0.0, 3.0) | st.just(math.inf), max_size=40)


@given(st.floats(-1e3, 1e3))
def test_wrapped_angle_is_the_same_direction(angle: float) -> None:
    wrapped = float(wrap_angle(angle))
    assert -math.pi <= wrapped < math.pi
    assert math.cos(wrapped - angle) == pytest.approx(1.0)


def test_pose_error_takes_the_short_way_round() -> None:
    distance, angle = pose_error((3.0, 4.0, math.radians(179)), (0.0, 0.0, math.radians(-179)))
    assert distance == pytest.approx(5.0) and angle == pytest.approx(math.radians(2))


@pytest.mark.parametrize("hole", range(3))
def test_nan_estimate_misses(hole: int) -> None:
    estimate = np.zeros(3)
    estimate[hole] = np.nan
    error = pose_error(estimate, np.zeros(3))
    assert error == (math.inf, math.pi)
    assert set(recall([error[0]], [error[1]]).values()) == {0.0}


@pytest.mark.parametrize("threshold", [0.1, 0.3, 0.5, 0.7, 1.0])
def test_recall_is_strict(threshold: float) -> None:
    at, below = recall([threshold], [0.0]), recall([math.nextafter(threshold, 0.0)], [0.0])
    assert at[f"{threshold:g}m"] == 0.0 and below[f"{threshold:g}m"] == 1.0


def test_recall_with_heading() -> None:
    got = recall([0.2, 0.2, 0.2, 2.0], np.radians([29.9, 30.0, 170.0, 0.0]))
    assert got["1m30deg"] == 0.25 and got["1m"] == 0.75
    assert all(math.isnan(v) for v in recall([], []).values())


@given(ERRORS.filter(len))
def test_recall_grows_with_the_threshold(errors: list[float]) -> None:
    got = recall(errors, np.zeros(len(errors)))
    values = [got[k] for k in ("0.1m", "0.3m", "0.5m", "0.7m", "1m")]
    assert values == sorted(values) and got["1m30deg"] == got["1m"]


@given(FLAGS, st.integers(1, 12))
def test_first_held_is_the_first_window(near: list[bool], hold: int) -> None:
    windows = [t for t in range(len(near) - hold + 1) if all(near[t : t + hold])]
    assert first_held(near, hold) == (windows[0] if windows else None)


@given(ERRORS, st.sampled_from([0.1, 0.5, 1.0]))
def test_both_protocols_by_definition(errors: list[float], threshold: float) -> None:
    near = [e < threshold for e in errors]
    windows = [all(near[t : t + HOLD]) for t in range(len(near) - HOLD + 1)]
    assert success(errors, threshold, "paper") == any(windows)
    assert success(errors, threshold, "f3loc") == (bool(windows) and windows[-1])


@given(st.integers(0, 15), st.integers(0, 15))
def test_convergence_is_the_start_of_the_last_run(far: int, near: int) -> None:
    errors = [0.1] * 3 + [2.0] * far + [0.1] * near
    expected = far + 3 if far else 0
    got = steps_to_converge(errors)
    assert got == (expected if len(errors) - expected >= HOLD else None)
    if got is not None:
        assert success(errors, 0.5, "f3loc")


def test_the_last_frames_decide_f3loc_only() -> None:
    lost = [0.1] * 10 + [2.0]
    assert success(lost, 0.5, "paper") and not success(lost, 0.5, "f3loc")
    assert not success([0.1] * 9, 0.5, "paper") and not success([], 0.5, "f3loc")
    assert steps_to_converge(lost) is None
    assert not success([0.5] * 10, 0.5, "paper")  # strict


def test_unknown_protocol_is_refused() -> None:
    with pytest.raises(GalocError, match="protocol"):
        success([0.1] * 10, 0.5, "best")


def test_rank_counts_what_is_strictly_better() -> None:
    scores = np.array([[0.1, 0.5], [0.9, 0.5]])
    assert rank(scores, 0.5) == 0.25 and rank(scores, 0.9) == 0.0 and rank(scores, 0.0) == 1.0
    assert rank([], 0.5) == 0.0


def test_summary_holds_every_metric() -> None:
    got = summarize_sequence([2.0] + [0.2] * 12, np.zeros(13))
    assert got["steps_to_converge"] == 1 and got["final_error_m"] == 0.2
    assert got["success"]["paper"]["0.3m"] and not got["success"]["f3loc"]["0.2m"]
    assert got["recall"]["0.3m"] == pytest.approx(12 / 13)
    assert math.isnan(summarize_sequence([], [])["final_error_m"])


def test_risk_follows_the_most_confident_answers() -> None:
    coverage, risk = risk_coverage([0.1, 0.9, 0.5, 0.7], [False, True, True, False])
    assert coverage.tolist() == [0.25, 0.5, 0.75, 1.0]
    assert risk == pytest.approx([0.0, 1 / 2, 1 / 3, 1 / 2])
    assert aurc([0.1, 0.9, 0.5, 0.7], [False, True, True, False]) == pytest.approx(np.mean([0, 1 / 2, 1 / 3, 1 / 2]))


@given(st.lists(st.tuples(st.sampled_from([0.0, 0.3, 1.0]), st.booleans()), min_size=1, max_size=6))
def test_tied_risk_is_the_mean_over_every_order(answers: list[tuple[float, bool]]) -> None:
    from itertools import permutations

    curves = []
    for order in permutations(answers):
        kept = sorted(order, key=lambda a: -a[0])  # stable: ties stay in the permuted order
        curves.append(np.cumsum([not ok for _, ok in kept]) / np.arange(1, len(kept) + 1))
    confidence, correct = zip(*answers, strict=True)
    assert risk_coverage(confidence, correct)[1] == pytest.approx(np.mean(curves, axis=0))


def test_uninformative_confidence_has_the_base_rate_as_risk() -> None:
    assert aurc(np.full(10, 0.5), np.arange(10) < 3) == pytest.approx(0.7)
    assert math.isnan(aurc([], [])) and math.isnan(calibration_error([], []))


def test_reliability_counts_each_frame_once() -> None:
    count, stated, right = reliability([0.0, 0.05, 0.95, 1.0], [False, True, True, True], bins=10)
    assert count.tolist() == [2] + [0] * 8 + [2]
    assert stated[0] == pytest.approx(0.025) and stated[-1] == pytest.approx(0.975)
    assert right[0] == 0.5 and right[-1] == 1.0 and np.isnan(right[1:-1]).all()


def test_calibration_error_of_true_and_of_false_confidence(rng: np.random.Generator) -> None:
    p = rng.uniform(size=20_000)
    honest = rng.uniform(size=len(p)) < p
    assert calibration_error(p, honest) < 0.015
    assert calibration_error(np.ones(100), np.zeros(100, bool)) == 1.0


@pytest.mark.parametrize(
    ("confidence", "correct"), [([0.5], [True, False]), ([math.nan], [True]), ([1.5], [True]), ([[0.5]], [[True]])]
)
def test_confidence_that_is_none_is_refused(confidence: list, correct: list) -> None:
    with pytest.raises(GalocError):
        risk_coverage(confidence, correct)
    with pytest.raises(GalocError):
        reliability(confidence, correct)


def test_no_bins_are_refused() -> None:
    with pytest.raises(GalocError, match="bins"):
        reliability([0.5], [True], bins=0)


def test_roc_auc_counts_pairs() -> None:
    assert roc_auc(np.array([0.1, 0.2, 0.8, 0.9]), np.array([False, False, True, True])) == 1.0
    assert roc_auc(np.array([0.9, 0.1]), np.array([False, True])) == 0.0
    assert roc_auc([0.5, 0.5, 0.7], [True, False, True]) == 0.75  # the tie counts half
    assert math.isnan(roc_auc([0.1, 0.2], [True, True]))
