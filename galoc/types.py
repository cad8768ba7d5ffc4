"""The data that crosses module borders: Wireframe, Layout, Rays, Estimate."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from galoc.errors import GalocError

if TYPE_CHECKING:
    from galoc.detect.columns import Columns
    from galoc.gauge import Gauge

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

CORNER, OCCLUSION, BORDER = 0, 1, 2
"""Values of ``Wireframe.kind``."""


def _array(name: str, value: object, shape: tuple[int | None, ...], dtype: type) -> NDArray:
    """Read-only copy of the wanted shape (None = any) and dtype, or a GalocError that names the field."""
    try:
        given = np.array(value)
    except ValueError:  # rows of different lengths
        given = np.array(None)
    kinds = "biuf" if given.size else "biufO"
    with np.errstate(invalid="ignore"):
        array: NDArray = given.astype(dtype) if given.dtype.kind in kinds else np.empty(0, dtype)
    # A fraction as index or a 2 as flag would be cut to fit without a word.
    if given.dtype.kind not in kinds or (dtype is not np.float64 and not np.array_equal(array, given)):
        got = f"{name} of type {type(value).__name__} that holds other values"
        raise GalocError(got, f"an array of {dtype.__name__}", "Pass plain numbers, one row per junction pair or wall.")
    if array.size == 0 and 0 in [s or 0 for s in shape]:
        array = array.reshape([s or 0 for s in shape])
    if array.ndim != len(shape) or any(s is not None and s != a for s, a in zip(shape, array.shape, strict=True)):
        want = tuple("any" if s is None else s for s in shape)
        raise GalocError(f"{name} with shape {array.shape}", f"shape {want}", "Pass one row per junction pair or wall.")
    array.setflags(write=False)
    return array


@dataclass(frozen=True, slots=True, eq=False)
class Wireframe:
    """Wall structure of one image: N vertical ceiling/floor junction pairs, M wall panels between them.

    Pairs are ordered left to right. A junction outside the image is given where its vertical leaves the image, with
    its ``*_true`` flag False. A border pair (kind 2) holds the pixels where the wall's ceiling and floor lines cross
    the left or right image edge: measurements of the wall, though not corners.
    """

    ceiling: Array
    """(N, 2) float64, px: ceiling junction P of each pair (u, v)."""
    floor: Array
    """(N, 2) float64, px: floor junction Q of each pair."""
    ceiling_true: BoolArray
    """(N,) bool: P is seen inside the image."""
    floor_true: BoolArray
    """(N,) bool: Q is seen inside the image."""
    walls: IntArray
    """(M, 2) int64: left and right pair of each wall panel."""
    kind: NDArray[np.int8] = None  # type: ignore[assignment]  # always an array after construction
    """(N,) int8: 0 corner (real wall end), 1 occlusion (the wall goes on behind a nearer edge), 2 border (cut by the
    left or right image edge). None: all corners."""
    sigma_px: Array | None = None
    """(N, 2) float64, px: standard deviation of P and Q. None: unknown."""
    ceiling_cut: Array | None = None
    """(M, 2, 2) float64, px: where the wall's ceiling line is cut by the image border on its way to the left [m, 0]
    and right [m, 1] pair; NaN where it is not. None: not measured."""
    floor_cut: Array | None = None
    """(M, 2, 2) float64, px: the same for the floor line."""
    columns: Columns | None = None
    """What a network said column by column, where the walls were drawn from that."""

    def __post_init__(self) -> None:
        """Coerce to the documented dtypes and check that the parts agree."""
        put = object.__setattr__
        put(self, "ceiling", _array("ceiling", self.ceiling, (None, 2), np.float64))
        n = len(self.ceiling)
        put(self, "floor", _array("floor", self.floor, (n, 2), np.float64))
        put(self, "ceiling_true", _array("ceiling_true", self.ceiling_true, (n,), np.bool_))
        put(self, "floor_true", _array("floor_true", self.floor_true, (n,), np.bool_))
        put(self, "walls", _array("walls", self.walls, (None, 2), np.int64))
        m = len(self.walls)
        kind = np.zeros(n, np.int8) if self.kind is None else self.kind
        put(self, "kind", _array("kind", kind, (n,), np.int8))
        if self.sigma_px is not None:
            put(self, "sigma_px", _array("sigma_px", self.sigma_px, (n, 2), np.float64))
        for name in ("ceiling_cut", "floor_cut"):
            value = getattr(self, name)
            if value is not None:
                put(self, name, _array(name, value, (m, 2, 2), np.float64))
        self._check_values()

    def _check_values(self) -> None:
        """Refuse what has the right shape and still means nothing."""
        n, walls = len(self.ceiling), self.walls
        if not (np.all(np.isfinite(self.ceiling)) and np.all(np.isfinite(self.floor))):
            raise GalocError("a wireframe with NaN or infinite pixels", "finite pixel coordinates", "Drop such pairs.")
        if len(walls) and (walls.min() < 0 or walls.max() >= n):
            got = f"wall indices from {walls.min()} to {walls.max()}"
            raise GalocError(got, f"indices of the {n} junction pairs, from 0", "Fix walls.")
        if np.any(walls[:, 0] == walls[:, 1]):
            raise GalocError("a wall from a junction pair to itself", "two different pairs per wall", "Drop that wall.")
        if not np.all(np.isin(np.asarray(self.kind), (CORNER, OCCLUSION, BORDER))):
            raise GalocError(f"kind = {self.kind}", "0 (corner), 1 (occlusion) or 2 (border) per pair", "Fix kind.")
        if self.sigma_px is not None and np.any(self.sigma_px < 0):
            raise GalocError("a negative sigma_px", "standard deviations in px, 0 or more", "Fix sigma_px.")

    def __len__(self) -> int:
        """Number of junction pairs N."""
        return len(self.ceiling)

    def resized(self, x: float, y: float) -> Wireframe:
        """The same wireframe in an image resized by these factors (pixel centres at integers)."""

        def moved(pixels: Array) -> Array:
            return (pixels + 0.5) * np.array([x, y]) - 0.5

        return replace(
            self,
            ceiling=moved(self.ceiling),
            floor=moved(self.floor),
            sigma_px=None if self.sigma_px is None else self.sigma_px * y,  # they err along the vertical above all
            ceiling_cut=None if self.ceiling_cut is None else moved(self.ceiling_cut),
            floor_cut=None if self.floor_cut is None else moved(self.floor_cut),
        )

    def shown_lines(self, row: int) -> Iterator[tuple[int, Array, Array]]:
        """Wall, and the two ends (px), of each ceiling line (row 0) or floor line (1) that is in the image."""
        points, seen = ((self.ceiling, self.ceiling_true), (self.floor, self.floor_true))[row]
        cuts = (self.ceiling_cut, self.floor_cut)[row]
        for wall, pairs in enumerate(self.walls):
            ends = []
            for side, pair in enumerate(pairs):
                if seen[pair] or cuts is None:
                    ends.append(points[pair])
                elif np.isfinite(cuts[wall, side]).all():
                    ends.append(cuts[wall, side])
            if len(ends) == 2:
                yield wall, ends[0], ends[1]

    @classmethod
    def empty(cls) -> Wireframe:
        """A wireframe without structure: what a detector returns for a blind frame."""
        none = np.zeros((0, 2))
        return cls(none, none, np.zeros(0, bool), np.zeros(0, bool), np.zeros((0, 2), int))


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Wall chain seen from above in the level camera frame; scale-free unless ``metric``.

    Method "paper" holds recovered pairs only. Method "ml" holds every pair of the wireframe, in metres at the most
    likely scale; the covariance says which of them are known, ``scale_sd`` how well the scale is.
    """

    points: Array
    """(N, 2) float64: (x right, z forward) of each pair; camera at the origin."""
    walls: IntArray
    """(M, 2) int64: known wall panels as indices into ``points``."""
    arcs: Array
    """(M, 2) float64, rad: azimuth of the left and right end of each known panel, as measured in the image."""
    heights: Array
    """(2,) float64: ceiling height above and floor depth below the camera, in the scale of ``points`` (both > 0)."""
    method: str
    """"ml" or "paper"."""
    covariance: Array | None = None
    """(2N, 2N) covariance of (x_0, z_0, x_1, ...) at fixed scale; None where the method gives none."""
    metric: bool = False
    """True when ``points`` and ``heights`` are in metres to within 10 % (1 sd)."""
    gauge: Gauge | None = None
    """Every intermediate of the paper's gauge search (method "paper")."""
    kind: NDArray[np.int8] | None = None
    """(N,) kind of each pair, as in :class:`Wireframe` ("ml")."""
    gravity: Array | None = None
    """(2,) rad: roll and pitch refined by the walls ("ml")."""
    gravity_sd: Array | None = None
    """(2,) rad: their standard deviations ("ml")."""
    flagged: BoolArray | None = None
    """(N,) pairs whose junctions the outlier gate refused ("ml")."""
    hidden: Array | None = None
    """(H, 3): stretches of walls whose ceiling (row 0) or floor (row 1) line is beyond the image: left azimuth, right
    azimuth (rad), row ("ml"). The wall is there, and near."""
    scale_sd: float = math.inf
    """Standard deviation of the log of the metric scale ("ml")."""
    log_ratio: tuple[float, float] = (math.nan, math.nan)
    """log(floor / ceiling height) and its standard deviation ("ml")."""
    sigma_px: float = math.nan
    """Junction noise used, or estimated from the residuals where the detector gave none, px ("ml")."""

    @classmethod
    def unknown(cls, method: str) -> Layout:
        """The abstaining layout: no pair, no known wall."""
        none = np.zeros((0, 2))
        return cls(none, np.zeros((0, 2), np.int64), none, np.ones(2), method)


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """Observation rays at 1 degree. Ray i has plan bearing heading + (i - (n - 1) / 2) degrees (right to left)."""

    range: Array
    """(n,) float64: distance to the wall in the layout's scale; NaN where unknown."""
    known: BoolArray
    """(n,) bool: the ray lies in a known sector."""
    variance: Array
    """(n,) float64: variance of log range at fixed scale; NaN where unknown or not estimated."""
    limit: Array | None = None
    """(n,) float64: where the wall is unknown but its ceiling or floor line is seen to lie beyond the image, the range
    that it cannot exceed, in the layout's scale; NaN elsewhere. None: not derived."""

    @property
    def coverage(self) -> float:
        """Share of rays that are known, 0..1."""
        return float(np.mean(self.known)) if len(self.known) else 0.0

    @property
    def bearings_rad(self) -> Array:
        """(n,) bearing of each ray relative to the heading, rad, counter-clockwise."""
        n = len(self.known)
        return np.radians(np.arange(n) - (n - 1) / 2.0)


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Where the camera is, and how sure we are. Abstention is ``confidence == 0``, not an exception."""

    pose: Array
    """(3,) float64: x, y in metres and heading in rad (plan frame); NaN when there is nothing to report."""
    confidence: float
    """0..1. Scoring "likelihood": calibrated probability that the position is right within 0.5 m. "cosine", single
    image: the paper's c = (|K| / N_r)^2; sequence: belief mass within 0.5 m of the pose. 0: abstained."""
    abstained: bool
    """True when this image showed no usable structure, or the confidence is below ``LocalizerConfig.abstain_below``."""
    candidates: Array = field(default_factory=lambda: np.zeros((0, 4)))
    """(C, 4) float64: x, y, heading, score of the best distinct poses, best first."""
    covariance: Array | None = None
    """(3, 3) of (x, y, heading); None where the method gives none."""
    rays: Rays | None = None
    """The observation that was matched."""
    layout: Layout | None = None
    """The wall chain behind the rays."""
    entropy: float = float("nan")
    """Entropy of the belief after the step, nats; NaN for a single image."""
    certified: bool = False
    """True when no pose of the 0.01 m x 1 degree lattice fits the image better (``LocalizerConfig.exact``)."""
