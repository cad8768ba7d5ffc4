"""Statistics over episodes with 95 % intervals, by bootstrap over plans: walks through one plan are not independent."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

DRAWS = 2000
"""Resamples behind each interval."""
LEVEL = 0.95
"""Of the intervals."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A statistic and its 95 % interval; all may be infinite."""

    value: float
    low: float
    high: float


class Resampling:
    """The same resamples for every statistic of the same episodes.

    Args:
        plans: of each episode. Plans are drawn with replacement and bring all their episodes along; where all
            episodes share one plan, episodes are drawn.
    """

    def __init__(self, plans: Sequence[str]) -> None:
        names, index = np.unique(np.asarray(plans), return_inverse=True)
        self.plans = len(names)
        """Different plans, C."""
        if self.plans == 1:
            index = np.arange(len(plans))
        self.units = int(index.max()) + 1
        """What is drawn: plans, or the episodes of the only one."""
        rng = np.random.default_rng(0)  # the interval of the same episodes is always the same
        drawn = rng.multinomial(self.units, np.full(self.units, 1.0 / self.units), size=DRAWS)
        self._weights = np.concatenate([np.ones((1, len(plans)), np.int64), drawn[:, index.reshape(-1)]])

    def mean(self, values: ArrayLike) -> Interval:
        """Mean of finite numbers (E,)."""
        return self._interval(self.means(values))

    def median(self, values: ArrayLike) -> Interval:
        """Lower median of numbers (E,), some perhaps infinite: it stays one of them."""
        return self._interval(self.medians(values))

    def share(self, values: ArrayLike) -> Interval:
        """Share of yes (1) among yes and no (0), (E,). All alike show no spread: the interval is then Wilson's."""
        found = np.asarray(values, dtype=np.float64)
        if 0.0 < found.mean() < 1.0:
            return self.mean(found)
        from scipy.stats import binomtest

        yes = self.units if found.mean() == 1.0 else 0
        wilson = binomtest(yes, self.units).proportion_ci(LEVEL, method="wilson")
        return Interval(float(found.mean()), float(wilson.low), float(wilson.high))

    def ratio(
        self, above: ArrayLike, below: ArrayLike, statistic: Callable[[Resampling, ArrayLike], Array]
    ) -> Interval:
        """Ratio of a statistic of two paired lists (E,): both over the same resamples.

        Args:
            above: of the numerator.
            below: of the denominator.
            statistic: ``Resampling.means`` or ``Resampling.medians``.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            return self._interval(statistic(self, above) / statistic(self, below))

    def means(self, values: ArrayLike) -> Array:
        """(1 + DRAWS,) the mean and that of each resample."""
        found = np.asarray(values, dtype=np.float64)
        return np.asarray((self._weights @ found) / self._weights.sum(axis=1))

    def medians(self, values: ArrayLike) -> Array:
        """(1 + DRAWS,) the lower median and that of each resample."""
        found = np.asarray(values, dtype=np.float64)
        order = np.argsort(found, kind="stable")
        upto = np.cumsum(self._weights[:, order], axis=1)
        middle = (upto[:, -1:] - 1) // 2
        return np.asarray(found[order][np.argmax(upto > middle, axis=1)])

    @staticmethod
    def _interval(found: Array) -> Interval:
        draws = np.sort(found[1:])  # NaN (infinity over infinity) comes last
        low, high = (draws[round(q * (DRAWS - 1))] for q in ((1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0))
        return Interval(float(found[0]), float(low), float(high))


def finite(value: float, digits: int = 2, scale: float = 1.0) -> str:
    """A number for a table, "-" where it is infinite or NaN."""
    return f"{scale * value:.{digits}f}" if math.isfinite(value) else "-"
