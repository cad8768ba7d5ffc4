"""Histogram filter over (x, y, heading): the paper's sequential fusion (Sec. III-E).

The belief lives in the log domain on the free positions of the grid and 360 headings. Prediction shifts it by the
odometry in whole cells and whole degrees. The paper's cells are 0.01 m, ours 0.1 m; so that this costs no motion, what
rounding leaves over is carried to the next step per heading (``motion="carried"``). ``motion="rounded"`` drops it, as
a plain integer shift does: it is here to show what that costs.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange
from numpy.typing import ArrayLike, NDArray

from galoc.errors import GalocError
from galoc.metrics import wrap_angle
from galoc.profiles import ProfileField

Array = NDArray[np.float64]

EPSILON = 0.01
"""Keeps the logarithm finite where the score is 0 (paper epsilon)."""
MOTIONS = ("carried", "rounded")
"""What becomes of the part of a motion below one cell."""
LEAST_SPREAD = 0.4
"""Diffusion waits until it amounts to this many cells or bins (1 sd): a smaller Gaussian does not show on the grid."""
HEADINGS = 360
"""Heading cells, 1 degree each."""


class Belief:
    """Log-probability over the positions of a field and 360 headings.

    Args:
        field: grid positions.
        diffusion_m: standard deviation added to the position per predicted metre, m/m (0: none, as in the paper).
        diffusion_rad: standard deviation added to the heading per step that moves or turns, rad (0: none).
        motion: "carried" or "rounded": what becomes of the part of a motion below one cell.

    Raises:
        GalocError: unknown motion.
    """

    def __init__(
        self,
        field: ProfileField,
        *,
        diffusion_m: float = 0.0,
        diffusion_rad: float = 0.0,
        motion: str = "carried",
    ) -> None:
        if motion not in MOTIONS:
            raise GalocError(f"motion {motion!r}", f"one of {MOTIONS}", "Use motion='carried'.")
        self._field = field
        self._carried = motion == "carried"
        self._diffusion_m, self._diffusion_rad = diffusion_m, diffusion_rad
        self.positions = field.positions
        """(P, 2) m: grid positions."""
        self.resolution = field.resolution
        """Grid step, m."""
        self.headings_rad = np.radians(np.arange(HEADINGS))
        """(360,) rad: heading of each cell."""
        self.reset()

    def reset(self) -> None:
        """Uniform belief: nothing is known."""
        self.log_p = np.zeros((len(self.positions), HEADINGS), np.float32)
        """(P, 360) float32: log-probability up to a constant; the largest entry is 0."""
        self._left_over = np.zeros((HEADINGS, 2))
        self._left_over_heading = 0.0
        self._gathered = np.zeros(2)  # variance that diffusion owes, cells^2 and bins^2

    def predict(self, odometry: ArrayLike) -> None:
        """Shift by odometry (paper: shift and roll by Delta x, Delta y, Delta v).

        Args:
            odometry: (dx forward, dy left, dheading) since the last observation in the previous body frame, m and rad.

        Raises:
            GalocError: not three finite numbers.
        """
        move = checked_odometry(odometry)
        c, s = np.cos(self.headings_rad), np.sin(self.headings_rad)
        shift = np.stack([c * move[0] - s * move[1], s * move[0] + c * move[1]], axis=1) + self._left_over
        cells = np.round(shift / self.resolution)
        turn = move[2] + self._left_over_heading
        bins = round(math.degrees(turn) * HEADINGS / 360.0)
        if self._carried:
            self._left_over = np.roll(shift - cells * self.resolution, bins, axis=0)
            self._left_over_heading = turn - math.radians(bins * 360.0 / HEADINGS)
        if cells.any() or bins:
            floor = np.float32(self.log_p.min() + math.log(EPSILON))  # what enters from outside the free space
            self.log_p = _shift(self.log_p, self._field.cell, self._field.index, cells.astype(np.int64), bins, floor)
        self._diffuse(math.hypot(move[0], move[1]), moved=bool(np.any(move != 0.0)))
        self.log_p -= self.log_p.max()

    def _diffuse(self, distance: float, *, moved: bool) -> None:
        """Spread by the odometry's noise, once enough of it has gathered that the grid can show it."""
        self._gathered[0] += (self._diffusion_m * distance / self.resolution) ** 2
        self._gathered[1] += math.degrees(self._diffusion_rad) ** 2 if moved else 0.0
        due = self._gathered >= LEAST_SPREAD**2
        if not due.any():
            return
        p = np.exp(self.log_p - self.log_p.max())
        if due[0]:
            p = _blur_positions(p, self._field.cell, self._field.index, _kernel(math.sqrt(self._gathered[0])))
        if due[1]:
            p = _blur_headings(p, _kernel(math.sqrt(self._gathered[1])))
        self._gathered[due] = 0.0
        self.log_p = np.log(np.maximum(p, np.float32(1e-37)))

    def add(self, log_likelihood: NDArray[np.float32], least: float = -math.inf) -> None:
        """Fuse one observation given as log-likelihood (P, 360), up to a constant.

        Args:
            log_likelihood: (P, 360) float32.
            least: no cell falls further below the best one than this, nats.
        """
        self.log_p += log_likelihood
        self.log_p -= self.log_p.max()
        if least > -math.inf:
            np.maximum(self.log_p, np.float32(least), out=self.log_p)

    def update(self, scores: NDArray[np.float32], confidence: float) -> None:
        """Fuse one observation: log B += c log(epsilon + s) (paper Sec. III-E).

        Args:
            scores: (P, 360) similarity in [0, 1].
            confidence: weight c.
        """
        self.add(np.float32(confidence) * np.log(np.float32(EPSILON) + scores))

    def position_marginal(self) -> Array:
        """(P,) probability of each position, summing to 1 (the paper's heat map H)."""
        p = np.exp(self.log_p).sum(axis=1, dtype=np.float64)
        return np.asarray(p / p.sum())

    def entropy(self) -> float:
        """Entropy over all cells, nats."""
        p = np.exp(self.log_p)
        total = float(p.sum(dtype=np.float64))
        return math.log(total) - float(np.sum(p * self.log_p, dtype=np.float64)) / total

    def _near(self, pose: Array, radius_m: float, angle_rad: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        rows = np.flatnonzero(np.sum((self.positions - pose[:2]) ** 2, axis=1) < radius_m**2)
        columns = np.flatnonzero(np.abs(wrap_angle(self.headings_rad - pose[2])) <= angle_rad)
        return rows, columns

    def mass_near(self, pose: ArrayLike, radius_m: float, angle_rad: float = math.pi) -> float:
        """Probability within ``radius_m`` (m) and ``angle_rad`` (rad) of a pose (3,)."""
        rows, columns = self._near(np.asarray(pose, dtype=np.float64), radius_m, angle_rad)
        near = np.exp(self.log_p[np.ix_(rows, columns)]).sum(dtype=np.float64)
        return float(near / np.exp(self.log_p).sum(dtype=np.float64))

    def peak(self) -> Array:
        """(3,) most probable pose, placed between cells by the mass around the best cell (3 cells, 5 degrees)."""
        p, v = np.unravel_index(int(np.argmax(self.log_p)), self.log_p.shape)
        best = np.array([*self.positions[p], self.headings_rad[v]])
        rows, columns = self._near(best, 3.0 * self.resolution, math.radians(5.0))
        # Only what rivals the peak places it: squaring keeps a one-sided shoulder from pulling it.
        weight = np.exp(2.0 * self.log_p[np.ix_(rows, columns)].astype(np.float64))
        weight /= weight.sum()
        offset = wrap_angle(self.headings_rad[columns] - best[2])
        xy = weight.sum(axis=1) @ self.positions[rows] + self._left_over[v]
        heading = best[2] + float(weight.sum(axis=0) @ offset) + self._left_over_heading
        return np.array([xy[0], xy[1], float(wrap_angle(heading))])


def checked_odometry(odometry: ArrayLike) -> Array:
    """(dx, dy, dheading) as an array.

    Raises:
        GalocError: not three finite numbers.
    """
    try:
        move = np.asarray(odometry, dtype=np.float64)
    except (TypeError, ValueError):
        move = np.empty(0)  # refused below like every other shape
    if move.shape != (3,) or not np.all(np.isfinite(move)):
        raise GalocError(f"odometry {odometry!r}", "(dx, dy, dheading), three finite numbers in m and rad", "Fix it.")
    return move


def _kernel(sd: float) -> Array:
    """Normalised Gaussian taps at whole cells, standard deviation in cells."""
    radius = max(1, math.ceil(3.0 * sd))
    taps = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sd) ** 2)
    return np.asarray(taps / taps.sum())


@njit(cache=True, parallel=True)
def _shift(log_p, cell, index, cells, bins, floor):  # type: ignore[no-untyped-def]
    """Move heading slice v by cells[v] (x, y) and to heading v + bins."""
    n, headings = log_p.shape
    height, width = index.shape
    out = np.empty_like(log_p)
    for p in prange(n):
        for to in range(headings):
            v = (to - bins) % headings
            row, column = cell[p, 0] - cells[v, 1], cell[p, 1] - cells[v, 0]
            source = -1
            if 0 <= row < height and 0 <= column < width:
                source = index[row, column]
            out[p, to] = log_p[source, v] if source >= 0 else floor
    return out


@njit(cache=True, parallel=True)
def _blur_axis(p, cell, index, taps, along_rows):  # type: ignore[no-untyped-def]
    n, headings = p.shape
    height, width = index.shape
    radius = taps.shape[0] // 2
    out = np.zeros_like(p)
    for i in prange(n):
        for k in range(-radius, radius + 1):
            row = cell[i, 0] + (k if along_rows else 0)
            column = cell[i, 1] + (0 if along_rows else k)
            j = np.int64(i)  # mass that would leave the free space stays where it is
            if 0 <= row < height and 0 <= column < width and index[row, column] >= 0:
                j = np.int64(index[row, column])
            for v in range(headings):
                out[i, v] += taps[k + radius] * p[j, v]
    return out


def _blur_positions(p, cell, index, taps):  # type: ignore[no-untyped-def]
    return _blur_axis(_blur_axis(p, cell, index, taps, True), cell, index, taps, False)


def _blur_headings(p: NDArray[np.float32], taps: Array) -> NDArray[np.float32]:
    radius = len(taps) // 2
    return np.asarray(sum(t * np.roll(p, k - radius, axis=1) for k, t in enumerate(taps)), dtype=np.float32)
