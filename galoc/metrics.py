"""Scores of localization results: recall, rank, success rate, convergence, and what a stated confidence is worth.

Protocols of sequence success are named "paper" and "f3loc".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.errors import GalocError

RECALL_THRESHOLDS_M = (0.1, 0.3, 0.5, 0.7, 1.0)
"""Distances at which recall is reported (paper, Sec. IV), m."""
RANK_THRESHOLDS = (1e-4, 2e-4, 5e-4, 1e-3)
"""Shares of the heat map at which rank is reported (paper: top 0.01, 0.02, 0.05, 0.10 %)."""
SUCCESS_THRESHOLDS_M = (1.0, 0.5, 0.3, 0.2, 0.1)
"""Distances at which sequence success is reported, m."""
HOLD = 10
"""Frames over which success must hold, both protocols."""
MAX_HEADING_ERROR = math.radians(30.0)
"""Heading bound of the "1 m, 30 deg" recall, rad."""


def wrap_angle(angle: ArrayLike) -> NDArray[np.float64]:
    """Angle(s) in rad wrapped to [-pi, pi)."""
    return (np.asarray(angle, dtype=np.float64) + np.pi) % (2.0 * np.pi) - np.pi


def pose_error(estimate: ArrayLike, truth: ArrayLike) -> tuple[float, float]:
    """Position error (m) and absolute heading error (rad) between poses (3,); (inf, pi) for a NaN estimate."""
    e, t = np.asarray(estimate, dtype=np.float64), np.asarray(truth, dtype=np.float64)
    if not np.all(np.isfinite(e)):
        return math.inf, math.pi
    return float(np.hypot(e[0] - t[0], e[1] - t[1])), float(abs(wrap_angle(e[2] - t[2])))


def recall(errors_m: ArrayLike, errors_rad: ArrayLike) -> dict[str, float]:
    """Share of frames (0..1) strictly within each threshold; abstained frames count as misses (error inf).

    Returns:
        Keys "0.1m", "0.3m", "0.5m", "0.7m", "1m" and "1m30deg"; NaN for no frames.
    """
    e, a = np.asarray(errors_m, dtype=np.float64), np.asarray(errors_rad, dtype=np.float64)
    if e.size == 0:
        return {**{f"{x:g}m": math.nan for x in RECALL_THRESHOLDS_M}, "1m30deg": math.nan}
    out = {f"{x:g}m": float(np.mean(e < x)) for x in RECALL_THRESHOLDS_M}
    out["1m30deg"] = float(np.mean((e < 1.0) & (a < MAX_HEADING_ERROR)))
    return out


def rank(scores: ArrayLike, truth_score: float) -> float:
    """Share of the heat map that scores strictly above the ground truth, 0 (best) to 1 (paper, Sec. IV)."""
    s = np.asarray(scores)
    return float(np.count_nonzero(s > truth_score) / max(s.size, 1))


def success(errors_m: ArrayLike, threshold_m: float, protocol: str = "paper") -> bool:
    """Whether a sequence counts as localized.

    Args:
        errors_m: (T,) position error per frame, m.
        threshold_m: m.
        protocol: "paper": within the threshold over any 10 consecutive frames. "f3loc": in all of the last 10 frames.
    """
    near = np.asarray(errors_m, dtype=np.float64) < threshold_m
    if protocol == "f3loc":
        return bool(len(near) >= HOLD and near[-HOLD:].all())
    if protocol == "paper":
        return first_held(near, HOLD) is not None
    raise GalocError(f"protocol {protocol!r}", '"paper" or "f3loc"', "Name one of the two protocols.")


def first_held(near: ArrayLike, hold: int) -> int | None:
    """First index from which ``near`` is True for ``hold`` consecutive frames; None if there is none."""
    run = 0
    for t, ok in enumerate(np.asarray(near, dtype=bool)):
        run = run + 1 if ok else 0
        if run == hold:
            return t - hold + 1
    return None


def steps_to_converge(errors_m: ArrayLike, threshold_m: float = 0.5, hold: int = HOLD) -> int | None:
    """First step from which the error stays below the threshold to the end of the sequence.

    Args:
        errors_m: (T,) position error per step, m.
        threshold_m: m.
        hold: how many last steps at least must be within, so that a lucky last frame does not count.

    Returns:
        Step index (0 = first observation), or None.
    """
    near = np.asarray(errors_m, dtype=np.float64) < threshold_m
    far = np.flatnonzero(~near)
    first = int(far[-1]) + 1 if len(far) else 0
    return first if len(near) - first >= hold else None


def summarize_sequence(errors_m: ArrayLike, errors_rad: ArrayLike) -> Mapping[str, object]:
    """Every sequence metric of one episode: recall over its frames, success under both protocols, convergence."""
    e = np.asarray(errors_m, dtype=np.float64)
    return {
        "recall": recall(e, errors_rad),
        "success": {p: {f"{x:g}m": success(e, x, p) for x in SUCCESS_THRESHOLDS_M} for p in ("paper", "f3loc")},
        "steps_to_converge": steps_to_converge(e),
        "final_error_m": float(e[-1]) if e.size else math.nan,
    }


def risk_coverage(confidence: ArrayLike, correct: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Share of wrong answers when only the most confident ones are given.

    Args:
        confidence: (F,) 0..1; an abstained frame is a wrong one of confidence 0.
        correct: (F,) bool.

    Returns:
        Coverage (F,): shares 1/F, 2/F, ..., 1 of the frames that are answered. Risk (F,): share of wrong ones among
        them. Frames of equal confidence come in no order: the risk is its expectation over all orders.

    Raises:
        GalocError: confidence out of [0, 1] or of another length than ``correct``.
    """
    c, ok = _confidences(confidence, correct)
    _, group, sizes = np.unique(-c, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    wrong = np.bincount(group, ~ok, minlength=len(sizes)) / sizes
    taken = np.arange(1, len(c) + 1, dtype=np.float64)
    return taken / max(len(c), 1), np.cumsum(np.repeat(wrong, sizes)) / taken


def aurc(confidence: ArrayLike, correct: ArrayLike) -> float:
    """Area under the risk-coverage curve: mean risk over all coverages, 0 (best) to 1; NaN for no frames."""
    risk = risk_coverage(confidence, correct)[1]
    return float(np.mean(risk)) if risk.size else math.nan


def reliability(
    confidence: ArrayLike, correct: ArrayLike, bins: int = 10
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """How often answers of a stated confidence are right.

    Args:
        confidence: (F,) 0..1.
        correct: (F,) bool.
        bins: number of equal bins over [0, 1]; the last one includes 1.

    Returns:
        (bins,) frames in each bin, their mean confidence, and the share of them that is right (NaN for an empty bin).

    Raises:
        GalocError: confidence out of [0, 1] or of another length than ``correct``, or no bins.
    """
    c, ok = _confidences(confidence, correct)
    if bins < 1:
        raise GalocError(f"bins = {bins!r}", "1 or more", "Use 10.")
    index = np.minimum((c * bins).astype(np.int64), bins - 1)
    count = np.bincount(index, minlength=bins).astype(np.int64)
    with np.errstate(invalid="ignore"):
        return count, np.bincount(index, c, bins) / count, np.bincount(index, ok, bins) / count


def calibration_error(confidence: ArrayLike, correct: ArrayLike, bins: int = 10) -> float:
    """Expected calibration error: mean over frames of |confidence - share right| of their bin; NaN for no frames."""
    count, stated, right = reliability(confidence, correct, bins)
    return float(np.nansum(count * np.abs(stated - right)) / count.sum()) if count.any() else math.nan


def _confidences(confidence: ArrayLike, correct: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    c, ok = np.asarray(confidence, dtype=np.float64), np.asarray(correct, dtype=bool)
    if c.ndim != 1 or c.shape != ok.shape:
        got = f"confidence of shape {c.shape} for answers of shape {ok.shape}"
        raise GalocError(got, "one confidence per answer", "Pass two lists of one length.")
    if not np.all((c >= 0.0) & (c <= 1.0 + 1e-9)):
        raise GalocError("a confidence that is NaN or out of range", "values from 0 to 1", "Pass 0 for abstained.")
    return c, ok


def _judged(confidence: ArrayLike, correct: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Confidences and 0/1 outcomes of the same frames, or a GalocError."""
    c, ok = np.asarray(confidence, dtype=np.float64), np.asarray(correct)
    if c.ndim != 1 or c.shape != ok.shape or np.isnan(c).any():
        raise GalocError(
            f"confidence of shape {c.shape} ({np.count_nonzero(np.isnan(c))} NaN) and correct of shape {ok.shape}",
            "one number, not NaN, and one truth value per frame",
            "Give a frame without an estimate confidence 0 and count it as wrong.",
        )
    return c, ok.astype(bool).astype(np.float64)


def risk_coverage(confidence: ArrayLike, correct: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Share of wrong answers when only the most confident are given (selective prediction).

    Where several frames are equally confident their order means nothing, so the curve is the expectation over their
    orders: a confidence that never varies gives the overall error rate throughout.

    Args:
        confidence: (n,) any scale, larger = surer.
        correct: (n,) bool.

    Returns:
        coverage: (n,) 1/n .. 1, share of frames answered, the most confident first.
        risk: (n,) 0..1, expected share of wrong ones among these.

    Raises:
        GalocError: different lengths, or a NaN confidence.
    """
    c, ok = _judged(confidence, correct)
    n = len(c)
    order = np.argsort(-c, kind="stable")
    _, start, count = np.unique(-c[order], return_index=True, return_counts=True)
    wrong = 1.0 - ok[order]
    per_frame = np.repeat(np.add.reduceat(wrong, start) / count, count) if n else wrong
    answered = np.arange(1, n + 1)
    return answered / max(n, 1), np.cumsum(per_frame) / answered


def aurc(confidence: ArrayLike, correct: ArrayLike) -> float:
    """Area under the risk-coverage curve, 0 (best) to 1: mean of :func:`risk_coverage`'s risk; NaN for no frames.

    It falls with the error rate as well as with how well the confidence sorts right from wrong. Ties in confidence
    count by expectation.
    """
    risk = risk_coverage(confidence, correct)[1]
    return float(np.mean(risk)) if risk.size else math.nan


class Reliability(NamedTuple):
    """Said against true frequency of being right, in bins of equal width over [0, 1]."""

    edges: NDArray[np.float64]
    """(B + 1,) borders of the bins; the last bin holds confidence 1."""
    count: NDArray[np.int64]
    """(B,) frames."""
    confidence: NDArray[np.float64]
    """(B,) mean confidence said; NaN for an empty bin."""
    accuracy: NDArray[np.float64]
    """(B,) share of frames right; NaN for an empty bin."""


def reliability_table(confidence: ArrayLike, correct: ArrayLike, bins: int = 10) -> Reliability:
    """The reliability diagram's numbers.

    Args:
        confidence: (n,) probabilities of being right, 0..1.
        correct: (n,) bool.
        bins: number of bins.

    Raises:
        GalocError: different lengths, a confidence that is no probability, or no bins.
    """
    c, ok = _judged(confidence, correct)
    if bins < 1:
        raise GalocError(f"bins = {bins}", "at least 1", "Use 10.")
    if np.any((c < 0.0) | (c > 1.0)):
        raise GalocError(f"confidence from {c.min():g} to {c.max():g}", "probabilities, 0 to 1", "Rescale it.")
    bin_of = np.minimum((c * bins).astype(np.int64), bins - 1)
    count = np.bincount(bin_of, minlength=bins)
    with np.errstate(invalid="ignore"):
        said = np.bincount(bin_of, weights=c, minlength=bins) / count
        right = np.bincount(bin_of, weights=ok, minlength=bins) / count
    return Reliability(np.linspace(0.0, 1.0, bins + 1), count, said, right)


def calibration_error(confidence: ArrayLike, correct: ArrayLike, bins: int = 10) -> float:
    """Expected calibration error, 0..1: mean over frames of the distance between what their bin said and its true frequency; NaN for none.

    Arguments as for :func:`reliability_table`.
    """
    table = reliability_table(confidence, correct, bins)
    used = table.count > 0
    if not used.any():
        return math.nan
    gap = np.abs(table.confidence[used] - table.accuracy[used])
    return float(np.average(gap, weights=table.count[used]))


def bootstrap_over(
    groups: ArrayLike,
    values: ArrayLike,
    statistic: Callable[[NDArray], ArrayLike],
    draws: int = 2000,
    seed: int = 0,
) -> NDArray[np.float64]:
    """95 % interval of a statistic by resampling whole groups with replacement.

    Frames of one plan succeed and fail together, so resampling frames would promise too much; resample plans.

    Args:
        groups: (n,) label of each row's group (the plan).
        values: (n, ...) rows.
        statistic: maps rows (m, ...) to a number or an array (K,); m varies with the groups drawn.
        draws: number of resamples.
        seed: the same rows give the same interval.

    Returns:
        (2,) or (2, K): 2.5 % and 97.5 % quantile over the draws in which the statistic is a number; NaN where there
        is none. With a single group there is no spread to see, and both are the statistic itself.

    Raises:
        GalocError: different lengths, no rows, or no draws.
    """
    label, rows = np.asarray(groups), np.asarray(values)
    if label.ndim != 1 or len(label) != len(rows) or len(rows) == 0 or draws < 1:
        raise GalocError(
            f"{label.shape} groups, {rows.shape} values, {draws} draws",
            "one group per row, at least one row and one draw",
            "Check the lengths.",
        )
    _, group_of = np.unique(label, return_inverse=True)
    order = np.argsort(group_of, kind="stable")
    members = np.split(order, np.flatnonzero(np.diff(group_of[order])) + 1)
    rng = np.random.default_rng(seed)
    drawn = []
    for _ in range(draws):
        picked = rng.integers(len(members), size=len(members))
        drawn.append(np.asarray(statistic(rows[np.concatenate([members[g] for g in picked])]), dtype=np.float64))
    ranked = np.sort(np.stack(drawn), axis=0)  # NaN go last
    found = np.count_nonzero(~np.isnan(ranked), axis=0)
    at = [np.maximum(np.ceil(q * found).astype(np.int64) - 1, 0) for q in (0.025, 0.975)]
    # Picked, not interpolated, so that an infinite statistic (nothing converged) stays infinite and not NaN.
    return np.stack([np.take_along_axis(ranked, i[None], axis=0)[0] for i in at])
