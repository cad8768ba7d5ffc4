"""Probability mass over the cells of a filter: kept normalised, summed up as it changes, idle where nothing is.

Rows whose cells are all at the floor are not live: the floor stands for their content. Sums, maxima and the entropy
fall off the passes that change the cells, so that asking for them costs no further one.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc import _belief_kernel as kernel
from galoc.errors import GalocError

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

LEAST = -60.0
"""No cell is ever further below the best one than this, nats: keeps probabilities far from where float32 ends."""
BOOST = 1e20
"""Factor on probabilities while they are multiplied, for the same reason."""


class Mass:
    """Mass of P rows (positions) of V cells (headings), uniform at first.

    Args:
        positions: P.
        headings: V.
    """

    def __init__(self, positions: int, headings: int) -> None:
        self._p, self._spare = (np.zeros((positions, headings), np.float32) for _ in range(2))
        self._live, self._spare_live = (np.zeros(positions, bool) for _ in range(2))
        self.row_best = np.zeros(positions, np.float32)
        """(P,) greatest cell of each row, up to a factor common to all."""
        self.row_sum = np.zeros(positions)
        """(P,) mass of each row; :attr:`total` in all."""
        self._all = np.arange(positions)
        self._entropy: float | None = None
        self.spread_evenly()

    @property
    def shape(self) -> tuple[int, int]:
        """(P, V)."""
        return self._p.shape[0], self._p.shape[1]

    def spread_evenly(self) -> None:
        """Make all cells equal."""
        self._live[:] = False
        self._floor = np.float32(1.0 / self._p.size)
        self.row_best[:] = self._floor
        self.row_sum[:] = np.float64(self._floor) * self._p.shape[1]
        self._summed()

    def set(self, p: ArrayLike) -> None:
        """Take weights (P, V), 0 or more, and normalise them."""
        given = self._checked(p)
        total = float(given.sum(dtype=np.float64))
        if not 0.0 < total < math.inf or given.min() < 0.0:
            raise GalocError("weights of a belief", "numbers from 0 up that do not sum to 0", "Fix them.")
        np.multiply(given, 1.0 / total, out=self._p)
        self._live[:] = True
        self.row_best = self._p.max(axis=1)
        self._settle(math.exp(LEAST) * float(self.row_best.max()))

    def array(self) -> Float32:
        """(P, V) probabilities, read-only; changed by the next operation."""
        self._normalise()
        self._p[~self._live] = self._floor
        view = self._p.view()
        view.flags.writeable = False
        return view

    def entropy(self) -> float:
        """Entropy over all cells, nats."""
        if self._entropy is None:
            self._settle(float(self._floor))
        assert self._entropy is not None
        return self._entropy

    def best(self) -> tuple[int, int]:
        """Row and column of the greatest cell."""
        i = int(np.argmax(self.row_best))
        return i, int(np.argmax(self._p[i])) if self._live[i] else 0

    def cells(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Array:
        """(R, C) mass of some cells; :attr:`total` in all."""
        return np.where(self._live[rows, None], self._p[np.ix_(rows, columns)], self._floor).astype(np.float64)

    def move(self, at: NDArray[np.int64], index: NDArray[np.int32], *motion: NDArray[np.int64]) -> None:
        """See :func:`galoc._belief_kernel.move`; mass that leaves the map is lost, and the rest counts for more."""
        self._into_spare(kernel.move, at, index, *motion)

    def blur(self, at: NDArray[np.int64], index: NDArray[np.int32], step: int, taps: Float32) -> None:
        """See :func:`galoc._belief_kernel.blur`; no mass is lost."""
        self._into_spare(kernel.blur, at, index, step, taps)

    def blur_headings(self, taps: Float32) -> None:
        """Spread every row around the circle."""
        scale = self._scale(1.0)
        kernel.blur_headings(self._p, self._live, self._floor, scale, taps, self.row_best, self.row_sum)
        self._summed()

    def _into_spare(self, function: Callable[..., None], *arguments: object) -> None:
        scale = self._scale(1.0)
        out = (self._spare, self._spare_live, self.row_best, self.row_sum)
        function(self._p, self._live, self._floor, scale, *arguments, *out)
        self._p, self._spare = self._spare, self._p
        self._live, self._spare_live = self._spare_live, self._live
        self._summed()

    def mix_evenly(self, share: float) -> None:
        """Take this share of the mass from where it is and spread it over all cells."""
        self._mix((1.0 - share) / self.total, share / self._p.size)

    def weigh(
        self, scores: ArrayLike, rows: NDArray[np.intp] | None, least: float, temper: float, frame_floor: float
    ) -> None:
        """Multiply by a likelihood given as logarithm; see :meth:`galoc.belief.Belief.add`."""
        slot = self._all
        if rows is not None:
            slot = np.full(len(self._p), -1)
            rows = which = self._checked_rows(rows, slot)
            slot[which] = self._all[: len(which)]
            if not np.array_equal(slot[which], self._all[: len(which)]):
                raise GalocError("rows that name a position twice", "each position once", "Use numpy.unique.")
        values = self._checked(scores, rows)
        top = np.float32(values.max(initial=-math.inf))
        if not math.isfinite(top):
            raise GalocError(f"best log-likelihood {top}", "a finite number", "Leave frames out that say nothing.")
        rest = math.exp(temper * frame_floor)
        how = (values, slot, top, np.float32(temper), np.float32(max(frame_floor, -87.0 / max(temper, 1e-6))))
        scale = self._scale(BOOST)
        kernel.weigh(self._p, self._live, self._floor, scale, *how, np.float32(rest), self.row_best)
        lowest = self._lowest(least, rest)
        kernel.revive(self._p, self._live, self._floor, np.float32(lowest), *how, self.row_best)
        self._settle(lowest)

    def weigh_power(self, scores: ArrayLike, epsilon: float, power: float) -> None:
        """Multiply by (epsilon + score)^power; scores (P, V) in [0, 1]."""
        values = self._checked(scores)
        low, high = float(values.min()), float(values.max())
        if not (low >= 0.0 and high <= 1.0 + 1e-3):  # NaN compares false
            raise GalocError(f"scores from {low:g} to {high:g}", "similarities from 0 to 1", "Use add for others.")
        how = (values, np.float32(epsilon), np.float32(power))
        scale = self._scale(BOOST)
        kernel.weigh_power(self._p, self._live, self._floor, scale, *how, self.row_best)
        lowest = self._lowest(LEAST, epsilon**power)
        kernel.revive_power(self._p, self._live, self._floor, np.float32(lowest), *how, self.row_best)
        self._settle(lowest)

    def _checked(self, values: ArrayLike, rows: NDArray[np.intp] | None = None) -> Float32:
        given = np.asarray(values)
        if given.dtype.kind not in "biuf":
            raise GalocError(f"values of dtype {given.dtype}", "real numbers", "Convert them to float32.")
        out = np.ascontiguousarray(given, dtype=np.float32)
        expected = (len(self._p) if rows is None else len(rows), self._p.shape[1])
        if out.shape != expected:
            raise GalocError(f"values of shape {out.shape}", f"{expected}: positions x headings", "Score its cells.")
        return out

    def _checked_rows(self, rows: ArrayLike, slot: NDArray[np.int64]) -> NDArray[np.intp]:
        which = np.asarray(rows)
        if which.ndim != 1 or (which.size and which.dtype.kind not in "iu"):
            raise GalocError(f"rows of {which.dtype} {which.shape}", "(R,) whole numbers", "Use numpy.flatnonzero.")
        if which.size and not 0 <= which.min() <= which.max() < len(slot):
            got = f"rows from {which.min()} to {which.max()}"
            raise GalocError(got, f"positions from 0 to {len(slot) - 1}", "Fix rows.")
        return which.astype(np.intp)

    def _scale(self, to: float) -> np.float32:
        """Factor of live cells that makes the total ``to``; idle rows take it at once."""
        scale = np.float32(to / self.total)
        self._floor *= scale
        return scale

    def _lowest(self, least: float, weakest: float) -> float:
        """The new floor: ``least`` below the best, or where a cell at the old one ends with the weakest likelihood."""
        return max(math.exp(max(least, LEAST)) * float(self.row_best.max()), float(self._floor) * weakest)

    def _settle(self, lowest: float) -> None:
        """Raise every cell to a floor; sums and entropy fall off on the way."""
        self._floor = np.float32(lowest)
        best = self.row_best.max()
        logs = kernel.settle(self._p, self._live, self._floor, best, self.row_best, self.row_sum)
        self._summed()
        self._entropy = math.log(self.total / float(best)) - logs / self.total
        if self.total > 1e25:
            self._normalise()

    def _summed(self) -> None:
        """Take up what a kernel left in the rows."""
        self.total = float(self.row_sum.sum())
        self._entropy = None
        if self.total < 1e-6:  # nearly all mass has left
            self._normalise()

    def _normalise(self) -> None:
        if self.total != 1.0:
            entropy = self._entropy
            self._mix(1.0 / self.total, 0.0)
            self.total, self._entropy = 1.0, entropy

    def _mix(self, keep: float, add: float) -> None:
        a, b = np.float32(keep), np.float32(add)
        kernel.mix(self._p, self._live, a, b, self.row_best, self.row_sum)
        self._floor = a * self._floor + b
        self._summed()
