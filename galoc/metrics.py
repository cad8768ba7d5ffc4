"""Scores of localization results: recall, rank, success rate, convergence, and what a stated confidence is worth.

Protocols of sequence success are named "paper" and "f3loc".
"""

from __future__ import annotations

import math
from collections.abc import Mapping

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


def roc_auc(score: ArrayLike, positive: ArrayLike) -> float:
    """Area under the ROC curve: how often a positive has the higher score, a tie counting half; NaN without both kinds.

    Args:
        score: (F,).
        positive: (F,) bool.
    """
    s, yes = np.asarray(score, dtype=np.float64), np.asarray(positive, dtype=bool)
    below, above = np.sort(s[~yes]), s[yes]
    if len(below) == 0 or len(above) == 0:
        return math.nan
    wins = np.searchsorted(below, above, "left") + np.searchsorted(below, above, "right")
    return float(wins.mean() / (2.0 * len(below)))


def _confidences(confidence: ArrayLike, correct: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    c, ok = np.asarray(confidence, dtype=np.float64), np.asarray(correct, dtype=bool)
    if c.ndim != 1 or c.shape != ok.shape:
        got = f"confidence of shape {c.shape} for answers of shape {ok.shape}"
        raise GalocError(got, "one confidence per answer", "Pass two lists of one length.")
    if not np.all((c >= 0.0) & (c <= 1.0 + 1e-9)):
        raise GalocError("a confidence that is NaN or out of range", "values from 0 to 1", "Pass 0 for abstained.")
    return c, ok
