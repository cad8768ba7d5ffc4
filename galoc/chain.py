"""The maximum-likelihood wall chain: everything a wireframe measures, fitted at once in pixels.

What the paper completes by construction is measured here: a junction that is out of the image, a wall cut by the image
edge or seen by its ceiling line alone all enter the same least squares, and the covariance says what is known.
Derivation in docs/geometry.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc._chain_kernel import LINE, POINT, TIE, VERTICAL
from galoc._chain_solve import solve_chain
from galoc.camera import MAX_TILT, Camera
from galoc.heights import Heights
from galoc.types import BORDER, OCCLUSION, Wireframe

Array = NDArray[np.float64]

SIGMA_PX = 5.0 / 640.0
"""Junction noise assumed before the residuals tell, as a share of the image width."""
SIGMA_FLOOR_PX = 0.25 / 640.0
"""No detector is better than this, as a share of the image width: keeps noise-free input finite."""
TIE_SD = 2e-3
"""How well an occluded wall's end shares the abscissa of the edge that hides it."""
S_PRIOR = (0.8, 2.0)
"""Weak prior of an inverse depth (mean, sd), in units of the mean height."""
MAX_DROPS = 3
"""Pairs that the gate may refuse in one frame, at most a third of them."""


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """A fitted chain of N nodes, in the gauge where the geometric mean of the two heights is 1."""

    m: Array
    """(N,) abscissa x / z of each node on the level plane (tangent of its azimuth)."""
    s: Array
    """(N,) inverse depth 1 / z."""
    covariance: Array
    """(2N, 2N) of (m_0, s_0, m_1, s_1, ...), with k and the tilt marginalised."""
    k: float
    """log(floor depth / ceiling height)."""
    k_sd: float
    """Standard deviation of k after the fit."""
    gravity: Array
    """(2,) refined roll and pitch, rad."""
    gravity_sd: Array
    """(2,) their standard deviations, rad."""
    flagged: NDArray[np.bool_]
    """(N,) pairs whose junctions the chi-square gate refused."""
    sigma_factor: float
    """Estimated noise over the assumed one (1 where the detector gave its sigma)."""


class Measurements:
    """Collects what a wireframe measures as the flat arrays of the kernel."""

    def __init__(self) -> None:
        self._rows: list[tuple[int, int, int, int, float, float, float, float, int]] = []

    def add(
        self, kind: int, a: int, b: int, row: int, uv: Array | tuple[float, float], along_v: bool, sd: float, group: int
    ) -> None:
        """Append one measurement (arguments as in :func:`galoc._chain_solve.solve_chain`)."""
        self._rows.append((kind, a, b, row, float(uv[0]), float(uv[1]), float(along_v), sd, group))

    def __len__(self) -> int:
        """Number of measurements."""
        return len(self._rows)

    def arrays(self) -> tuple[NDArray, ...]:
        """(kind, a, b, row, uv, sd, group)."""
        table = np.array(self._rows, dtype=np.float64).reshape(-1, 9)
        whole = table[:, [0, 1, 2, 3, 8]].astype(np.int64)
        pixels, sd = np.ascontiguousarray(table[:, 4:7]), np.ascontiguousarray(table[:, 7])
        kind, a, b, row, group = (np.ascontiguousarray(whole[:, c]) for c in range(5))
        return kind, a, b, row, pixels, sd, group


def fit_chain(
    wireframe: Wireframe,
    camera: Camera,
    gravity: Array,
    *,
    imu_sd: float,
    heights: Heights,
    on_grid: bool,
) -> Chain | None:
    """Fit every node of a wireframe; None for an empty one or one that no camera geometry explains.

    Args:
        wireframe: N pairs.
        camera: intrinsics.
        gravity: (2,) measured roll and pitch, rad.
        imu_sd: standard deviation of each, rad.
        heights: prior of the two heights.
        on_grid: whether the map's walls lie on one right-angled grid (switches the wall-direction prior on).
    """
    n = len(wireframe)
    if n == 0:
        return None
    sigma = _sigma(wireframe, camera)
    m0 = _abscissa(wireframe, camera, gravity)
    measured = measure(wireframe, camera, sigma, m0)
    if len(measured) == 0:
        return None
    kind, a, b, row, uv, sd, group = measured.arrays()
    prior, prior_sd = priors(m0, np.asarray(wireframe.kind) == BORDER, gravity, imu_sd, heights)
    theta, cov, use, factor = solve_chain(
        n, kind, a, b, row, uv, sd, group, intrinsics(camera), prior, prior_sd, wireframe.walls, on_grid,
        min(MAX_DROPS, n // 3), wireframe.sigma_px is None,
    )  # fmt: skip
    if factor < 0.0 or not np.all(np.isfinite(theta)) or np.abs(theta[2 * n + 1 : 2 * n + 3]).max() > MAX_TILT:
        return None
    dropped = np.zeros(n, dtype=bool)
    dropped[a[(kind == POINT) & ~use]] = True
    spread = np.sqrt(np.diag(cov))
    return Chain(
        theta[: 2 * n : 2], theta[1 : 2 * n : 2], cov[: 2 * n, : 2 * n], float(theta[2 * n]), float(spread[2 * n]),
        theta[2 * n + 1 : 2 * n + 3], spread[2 * n + 1 : 2 * n + 3], dropped, float(factor),
    )  # fmt: skip


def intrinsics(camera: Camera) -> Array:
    """(4,) fx, fy, cx, cy for the kernels."""
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy])


def priors(
    m0: Array, pinned: NDArray[np.bool_], gravity: Array, imu_sd: float, heights: Heights
) -> tuple[Array, Array]:
    """Prior means and standard deviations (2N+4,) of the parameter vector; pinned nodes keep their abscissa."""
    n = len(m0)
    mean, spread = np.empty(2 * n + 4), np.empty(2 * n + 4)
    mean[: 2 * n : 2], spread[: 2 * n : 2] = m0, np.where(pinned, 1e-3, 10.0)
    mean[1 : 2 * n : 2], spread[1 : 2 * n : 2] = S_PRIOR
    mean[2 * n :] = heights.k, gravity[0], gravity[1], 0.0
    spread[2 * n :] = heights.k_sd, max(imu_sd, 1e-4), max(imu_sd, 1e-4), 10.0
    return mean, spread


def _sigma(wireframe: Wireframe, camera: Camera) -> Array:
    """(N, 2) px: noise of each junction as given, or the first guess."""
    if wireframe.sigma_px is None:
        return np.full((len(wireframe), 2), SIGMA_PX * camera.width)
    return np.maximum(wireframe.sigma_px, SIGMA_FLOOR_PX * camera.width)


def _abscissa(wireframe: Wireframe, camera: Camera, gravity: Array) -> Array:
    """(N,) x / z of each pair at the measured gravity: of its seen ends, or of both where none is seen."""
    rays = np.stack([camera.rays_level(wireframe.ceiling, gravity), camera.rays_level(wireframe.floor, gravity)])
    m = rays[..., 0] / np.maximum(rays[..., 2], 1e-3)
    seen = np.stack([wireframe.ceiling_true, wireframe.floor_true])
    weight = np.where(seen.any(axis=0), seen, True).astype(np.float64)
    return np.clip((m * weight).sum(axis=0) / weight.sum(axis=0), -50.0, 50.0)


def measure(wireframe: Wireframe, camera: Camera, sigma: Array, m0: Array) -> Measurements:
    """Everything the wireframe says about its nodes.

    - A junction seen inside the image: a POINT of its node.
    - An end whose vertical leaves the image: a VERTICAL, the azimuth alone.
    - A border pair's pixel and every cut of a wall line by the image border: a LINE of the wall.
    - An occluded end beside the edge that hides it: a TIE of their abscissas.
    """
    found = Measurements()
    n = len(wireframe)
    kind, flags = wireframe.kind, (wireframe.ceiling_true, wireframe.floor_true)
    pixels, cuts = (wireframe.ceiling, wireframe.floor), (wireframe.ceiling_cut, wireframe.floor_cut)
    for i in range(n):
        if kind[i] == BORDER:
            continue
        for row in (0, 1):
            what = POINT if flags[row][i] else VERTICAL
            found.add(what, i, i, row, pixels[row][i], False, sigma[i, row], i)
    for w, ends in enumerate(wireframe.walls):
        i, j = int(ends[0]), int(ends[1])
        for row in (0, 1):
            sd = float(0.5 * (sigma[i, row] + sigma[j, row]))
            for side, node in enumerate((i, j)):
                uv, cut = pixels[row][node], cuts[row]
                if not flags[row][node]:  # where the line leaves the image on its way there
                    uv = np.full(2, np.nan) if cut is None else cut[w, side]
                elif kind[node] != BORDER:
                    continue
                if np.isfinite(uv).all():
                    inside = -0.5 + 0.75 < uv[1] < camera.height - 0.5 - 0.75
                    found.add(LINE, i, j, row, uv, bool(inside), sd, n + len(found))
    for i in range(n - 1):
        if OCCLUSION in (kind[i], kind[i + 1]) and BORDER not in (kind[i], kind[i + 1]):
            near = 4.0 * (sigma[i].mean() + sigma[i + 1].mean()) / camera.fx * (1.0 + m0[i] ** 2)
            joined = np.any((wireframe.walls == (i, i + 1)).all(axis=1))
            if not joined and abs(m0[i + 1] - m0[i]) < near:
                found.add(TIE, i, i + 1, 0, (0.0, 0.0), False, TIE_SD * (1.0 + float(m0[i]) ** 2), n + len(found))
    return found


def to_points(m: Array, s: Array, covariance: Array) -> tuple[Array, Array]:
    """Points (..., N, 2) as (x, z) and their covariance (..., 2N, 2N), from the level-plane parameters."""
    points = np.stack([m / s, 1.0 / s], axis=-1)
    return points, _turned(covariance, 1.0 / s, -m / s**2, -1.0 / s**2)


def to_level(points: Array, covariance: Array) -> tuple[Array, Array, Array]:
    """Inverse of :func:`to_points`: m (..., N), s (..., N) and their covariance (..., 2N, 2N)."""
    x, z = points[..., 0], points[..., 1]
    return x / z, 1.0 / z, _turned(covariance, 1.0 / z, -x / z**2, -1.0 / z**2)


def _turned(covariance: Array, d00: Array, d01: Array, d11: Array) -> Array:
    """``J C J^T`` for a block-diagonal J with blocks [[d00, d01], [0, d11]].

    Written out: as a matrix product it would wake the threads of BLAS, which cost more than the product.
    """
    rows = np.empty(covariance.shape)
    even, odd = covariance[..., ::2, :], covariance[..., 1::2, :]
    rows[..., ::2, :] = d00[..., None] * even + d01[..., None] * odd
    rows[..., 1::2, :] = d11[..., None] * odd
    out = np.empty(covariance.shape)
    left, right = rows[..., ::2], rows[..., 1::2]
    out[..., ::2] = left * d00[..., None, :] + right * d01[..., None, :]
    out[..., 1::2] = right * d11[..., None, :]
    return out
