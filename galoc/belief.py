"""Histogram filter over (x, y, heading): the paper's sequential fusion (Sec. III-E).

The belief lives on the free positions of the grid and V headings, as probabilities that every operation renormalises.
Prediction shifts each heading by its own whole cells and rolls the headings. The paper's cells are 0.01 m and a degree,
ours are larger; so that this costs no motion, what rounding leaves over is carried to the next step per heading
(``motion="carried"``). ``motion="paper"`` drops it, as a plain shift and roll do: it is here to show what that costs.

Mass that motion takes out of the free space is lost and the rest renormalised: those hypotheses are impossible.
Diffusion is the filter's own doubt and loses none: what would spread into a wall stays where it is.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.checked import number, three
from galoc.errors import GalocError
from galoc.mass import LEAST, Mass
from galoc.metrics import wrap_angle
from galoc.profiles import ProfileField

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

EPSILON = 0.01
"""Keeps the weight of a pose above 0 where its score is 0 (paper epsilon)."""
MOTIONS = ("carried", "paper")
"""What becomes of the part of a motion below one cell."""
FAR = 1e9
"""Cells beyond which a pose is just far away."""
MOST_DIFFUSION = 1e6
"""Anything beyond is as good as forgetting everything at each step."""
MOST_WEIGHT = 10.0
"""An observation counts for no more than this many: powers of it stay in float32."""
LEAST_SPREAD = 0.4
"""Diffusion waits until it amounts to this many cells or bins (1 sd): a smaller Gaussian does not show on the grid."""


class Belief:
    """Probability over the positions of a field and V headings.

    Args:
        field: grid positions.
        headings: V, a divisor of 360. Cell v holds the whole degrees v * 360 / V .. (v + 1) * 360 / V - 1, plus
            :attr:`turned_deg`.
        diffusion_m: standard deviation added to the position per predicted metre, m/m (0: none, as in the paper).
        diffusion_rad: standard deviation added to the heading per step that moves or turns, rad (0: none).
        motion: "carried" or "paper": what becomes of the part of a motion below one cell.
        kidnapped: probability per step that the camera was put anywhere.

    Raises:
        GalocError: unknown motion, headings that do not divide 360, diffusion below 0, kidnapped not in [0, 1).
    """

    def __init__(
        self,
        field: ProfileField,
        *,
        headings: int = 360,
        diffusion_m: float = 0.0,
        diffusion_rad: float = 0.0,
        motion: str = "carried",
        kidnapped: float = 0.0,
    ) -> None:
        self.headings = checked_headings(headings)
        """V."""
        self._kidnapped = checked_kidnapped(kidnapped)
        self._field = field
        self._carried = checked_motion(motion) == "carried"
        self._diffusion_m = number("diffusion_m", diffusion_m, 0.0, MOST_DIFFUSION, "m/m", "Use 0.")
        self._diffusion_rad = number("diffusion_rad", diffusion_rad, 0.0, MOST_DIFFUSION, "rad", "Use 0.")
        self.positions = field.positions
        """(P, 2) m: grid positions."""
        self.resolution = field.resolution
        """Grid step, m."""
        self.group = 360 // self.headings
        """Whole degrees per heading cell."""
        self._mass = Mass(len(self.positions), self.headings)
        self._pad = -1
        self.reset()

    def reset(self) -> None:
        """Uniform belief: nothing is known."""
        self._left_over = np.zeros((self.headings, 2))
        self._left_over_deg = 0.0
        self._gathered = np.zeros(2)  # variance that diffusion owes, cells^2 and bins^2
        self._mass.spread_evenly()

    @property
    def size(self) -> int:
        """Number of cells, P * V."""
        return len(self.positions) * self.headings

    @property
    def turned_deg(self) -> int:
        """Whole degrees, at most half a cell, by which the heading cells lie further than at the start."""
        return round(self._left_over_deg)

    @property
    def headings_rad(self) -> Array:
        """(V,) rad: centre of each heading cell, in whole or half degrees."""
        return np.radians(np.arange(self.headings) * self.group + 0.5 * (self.group - 1) + self.turned_deg)

    @property
    def p(self) -> Float32:
        """(P, V) float32 probabilities, read-only; changed by the next operation on the belief."""
        return self._mass.array()

    def set(self, p: ArrayLike) -> None:
        """Believe something else.

        Args:
            p: (P, V) weights, 0 or more; normalised here.
        """
        self._mass.set(p)

    def predict(self, odometry: ArrayLike) -> None:
        """Shift by odometry (paper: shift and roll by Delta x, Delta y, Delta v).

        Args:
            odometry: (dx forward, dy left, dheading) since the last observation in the previous body frame, m and rad.

        Raises:
            GalocError: not three finite numbers.
        """
        step = checked_odometry(odometry)
        heading = self.headings_rad + math.radians(self._left_over_deg - self.turned_deg)
        c, s = np.cos(heading), np.sin(heading)
        shift = np.stack([c * step[0] - s * step[1], s * step[0] + c * step[1]], axis=1) + self._left_over
        cells = np.round(shift / self.resolution)
        turn = math.remainder(math.degrees(step[2]) + self._left_over_deg, 360.0)
        bins = round(turn / self.group)
        if self._carried:
            # Of astronomic motions rounding leaves more than a cell, of which none may remain.
            rest = np.clip(shift - cells * self.resolution, -self.resolution, self.resolution)
            self._left_over = np.roll(rest, bins, axis=0)
            self._left_over_deg = turn - bins * self.group
        if cells.any() or bins % self.headings:
            self._move(cells, bins)
        self._diffuse(math.hypot(step[0], step[1]), moved=bool(np.any(step != 0.0)))
        if self._kidnapped > 0.0:
            self._mass.mix_evenly(self._kidnapped)

    def _move(self, whole: Array, bins: int) -> None:
        # Further than the map is wide is as far as its width: out of it.
        limit = max(self._field.index.shape) + 1
        cells = np.clip(whole, -limit, limit).astype(np.int64)
        self._reach(int(np.abs(cells).max()))
        start = (np.arange(self.headings) - bins) % self.headings
        offsets, which = np.unique(cells[start] @ np.array([1, self._stride]), return_inverse=True)
        self._mass.move(self._at, self._index, offsets, which, start)

    def _diffuse(self, distance: float, *, moved: bool) -> None:
        """Spread by the odometry's noise, once enough of it has gathered that the grid can show it."""
        spread = self._diffusion_m * distance / self.resolution
        self._gathered[0] += spread * spread  # not ** 2, which raises where it overflows
        self._gathered[1] += (math.degrees(self._diffusion_rad) / self.group) ** 2 if moved else 0.0
        due = self._gathered >= LEAST_SPREAD**2
        if due[0]:
            taps = gaussian_taps(min(math.sqrt(self._gathered[0]), max(self._field.index.shape) / 3.0))
            self._reach(len(taps) // 2)
            for axis in (1, self._stride):
                self._mass.blur(self._at, self._index, axis, taps)
        if due[1]:
            self._mass.blur_headings(gaussian_taps(min(math.sqrt(self._gathered[1]), self.headings)))
        self._gathered[due] = 0.0

    def _reach(self, cells: int) -> None:
        """Pad the index map so that this many cells beyond a position can be looked up unchecked."""
        if cells > self._pad:
            self._pad = max(cells, 16)
            padded = np.pad(self._field.index, self._pad, constant_values=-1)
            self._stride = padded.shape[1]
            self._index = padded.ravel()
            self._at = (self._field.cell + self._pad) @ np.array([self._stride, 1])

    def add(
        self,
        log_likelihood: ArrayLike,
        least: float = LEAST,
        *,
        rows: NDArray[np.intp] | None = None,
        temper: float = 1.0,
        frame_floor: float = -math.inf,
    ) -> None:
        """Fuse one observation given as log-likelihood, up to a constant.

        Args:
            log_likelihood: (P, V), or (R, V) with ``rows``.
            least: no cell falls further below the best one than this, nats (at most -LEAST is kept).
            rows: (R,) positions that were scored; the others count as at ``frame_floor``.
            temper: weight of the observation.
            frame_floor: the observation makes no cell less likely than this against its best one, nats (untempered).

        Raises:
            GalocError: wrong shape or rows, no finite best value, a number out of range. The belief is as before then.
        """
        number("least", least, -math.inf, 0.0, "nats", "Leave it out.")
        number("temper", temper, 0.0, MOST_WEIGHT, cure="Use 1.")
        number("frame_floor", frame_floor, -math.inf, 0.0, "nats", "Leave it out.")
        self._mass.weigh(log_likelihood, rows, least, temper, frame_floor)

    def update(self, scores: ArrayLike, confidence: float) -> None:
        """Fuse one observation: log B += c log(epsilon + s) (paper Sec. III-E).

        Args:
            scores: (P, V) similarity in [0, 1].
            confidence: weight c.

        Raises:
            GalocError: wrong shape, scores outside [0, 1], or a weight out of range. The belief is as before then.
        """
        number("confidence", confidence, 0.0, MOST_WEIGHT, cure="Use galoc.score.confidence.")
        self._mass.weigh_power(scores, EPSILON, confidence)

    def position_marginal(self) -> Array:
        """(P,) probability of each position, summing to 1 (the paper's heat map H)."""
        return self._mass.row_sum / self._mass.total

    def entropy(self) -> float:
        """Entropy over all cells, nats."""
        return self._mass.entropy()

    def best_rows(self, least: float) -> NDArray[np.intp]:
        """(R,) positions whose best heading is at most this much below the best cell, nats (negative)."""
        return np.flatnonzero(self._mass.row_best > math.exp(least) * float(self._mass.row_best.max()))

    def _near(self, pose: Array, radius_m: float, angle_rad: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        at = np.clip((pose[:2] - self._field.origin) / self.resolution, -FAR, FAR)
        column, row = np.floor(at).astype(int)
        reach = math.ceil(min(radius_m / self.resolution, FAR)) + 1
        window = self._field.index[max(0, row - reach) : max(0, row + reach + 1)]
        window = window[:, max(0, column - reach) : max(0, column + reach + 1)]
        rows = window[window >= 0].astype(np.intp)
        rows = rows[np.sum((self.positions[rows] - pose[:2]) ** 2, axis=1) < radius_m**2]
        return rows, np.flatnonzero(np.abs(wrap_angle(self.headings_rad - pose[2])) <= angle_rad)

    def mass_near(self, pose: ArrayLike, radius_m: float, angle_rad: float = math.pi) -> float:
        """Probability within ``radius_m`` (m) and ``angle_rad`` (rad) of a pose (3,).

        Raises:
            GalocError: no pose of three finite numbers, a radius or angle below 0.
        """
        number("radius_m", radius_m, 0.0, math.inf, "m")
        number("angle_rad", angle_rad, 0.0, math.inf, "rad")
        rows, columns = self._near(three("pose", pose, "(x, y, heading)"), radius_m, angle_rad)
        if len(columns) == self.headings:
            return float(self._mass.row_sum[rows].sum()) / self._mass.total
        return float(self._mass.cells(rows, columns).sum()) / self._mass.total

    def peak(self) -> Array:
        """(3,) most probable pose, placed between cells by the mass around the best cell (3 cells, 5 degrees)."""
        i, v = self._mass.best()
        headings = self.headings_rad
        best = np.array([*self.positions[i], headings[v]])
        rows, columns = self._near(best, 3.0 * self.resolution, math.radians(max(5.0, self.group)) + 1e-6)
        # Only what rivals the peak places it: squaring keeps a one-sided shoulder from pulling it.
        weight = np.square(self._mass.cells(rows, columns) / float(self._mass.row_best[i]))
        weight /= weight.sum()
        offset = wrap_angle(headings[columns] - best[2])
        # Each heading has been rounded on its own and owes its own rest.
        xy = weight.sum(axis=1) @ self.positions[rows] + weight.sum(axis=0) @ self._left_over[columns]
        heading = best[2] + float(weight.sum(axis=0) @ offset) + math.radians(self._left_over_deg - self.turned_deg)
        return np.array([xy[0], xy[1], float(wrap_angle(heading))])


def checked_odometry(odometry: ArrayLike) -> Array:
    """(dx, dy, dheading) as an array.

    Raises:
        GalocError: not three finite numbers.
    """
    return three("odometry", odometry, "(dx, dy, dheading)")


def checked_motion(motion: object) -> str:
    """The name; GalocError unless it is one of ``MOTIONS``."""
    if motion not in MOTIONS:
        raise GalocError(f"motion {motion!r}", f"one of {MOTIONS}", "Use motion='carried'.")
    return str(motion)


def checked_headings(headings: object) -> int:
    """The number of heading cells; GalocError unless it divides 360."""
    if isinstance(headings, bool) or not isinstance(headings, int | np.integer) or headings < 1 or 360 % headings:
        raise GalocError(f"headings = {headings!r}", "a divisor of 360: 36, 72, 120, 360, ...", "Use 72.")
    return int(headings)


def checked_kidnapped(kidnapped: object) -> float:
    """The probability of being put anywhere; GalocError unless it is from 0 to below 1."""
    number = isinstance(kidnapped, int | float | np.number) and not isinstance(kidnapped, bool)
    if not number or not 0.0 <= kidnapped < 1.0:  # type: ignore[operator]
        raise GalocError(f"kidnapped = {kidnapped!r}", "a probability from 0 to below 1", "Use 0, or 0.001.")
    return float(kidnapped)  # type: ignore[arg-type]


def gaussian_taps(sd: float) -> Float32:
    """(2 r + 1,) float32 normalised Gaussian at whole cells, standard deviation in cells."""
    radius = max(1, math.ceil(3.0 * sd))
    taps = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sd) ** 2)
    return np.asarray(taps / taps.sum(), dtype=np.float32)
