"""What the paper says of its gauge search, each statement put to a measurement with a stated rule."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc.bev import inscribed_position
from galoc.camera import azimuth
from galoc.gauge import Gauge, constraint_matrix, solve_gauge
from galoc.profiles import Caster
from galoc.score import score_volume
from galoc.types import Rays
from galoc_env.stress_observe import Observation, observe
from galoc_env.stress_scenes import Condition, Scene, home_of, scenes
from galoc_env.stress_scores import ratio_interval, ray_error, rays_of, share

Array = NDArray[np.float64]

HOLDS, FAILS, UNSHOWN = "holds", "does not hold", "not shown"
MOST = "holds if the 95 % interval of the share lies above one half, does not hold if below"
GAIN = "holds if the 95 % interval of the error ratio (with / without) lies below 1, does not hold if above"
NEAR_DEG = 5.0
"""An angle counts as found within this, degrees."""
EXACT = 1e-9
"""Relative difference that double precision explains."""
SCORED_VIEWS = 8
"""Views whose whole score volume is computed for the statement on gamma."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """A statement, what was measured, and what follows by the rule."""

    name: str
    claim: str
    measured: str
    rule: str
    verdict: str
    numbers: dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """One baseline view, solved by the paper's method."""

    scene: Scene
    seen: Observation
    p: Array
    q: Array
    gauge: Gauge

    def error(self, points: Array) -> float:
        """Ray error of a structure."""
        return ray_error(rays_of(points, self.seen.walls, self.scene.azimuths)[0], self.scene.ranges)


def _views(frames: int, seed: int) -> list[_View]:
    condition = Condition()
    out = []
    for i, scene in enumerate(scenes(condition, frames, seed)):
        seen = observe(scene, condition, i, seed)
        p, q = (condition.camera.rays_level(x, seen.gravity) for x in (seen.ceiling, seen.floor))
        out.append(_View(scene, seen, p, q, solve_gauge(p, q)))
    return out


def _share(name: str, claim: str, yes: list[bool], what: str, **more: Any) -> Verdict:
    """Verdict on a statement about most views."""
    value, low, high = share(np.array(yes))
    verdict = HOLDS if low > 0.5 else FAILS if high < 0.5 else UNSHOWN
    measured = f"{what}: {100 * value:.0f} % of {len(yes)} views ({100 * low:.0f} to {100 * high:.0f})"
    return Verdict(name, claim, measured, MOST, verdict, {"share": value, "low": low, "high": high} | more)


def _gain(name: str, claim: str, views: list[_View], with_it: Array, without: Array) -> Verdict:
    """Verdict on a step that should lower the ray error."""
    value, low, high = ratio_interval(with_it, without, np.array([v.scene.plan for v in views]))
    verdict = HOLDS if high < 1.0 else FAILS if low > 1.0 else UNSHOWN
    means = float(np.nanmean(with_it)), float(np.nanmean(without))
    measured = (
        f"ray error {100 * means[0]:.2f} % with, {100 * means[1]:.2f} % without: ratio {value:.3f} "
        f"({low:.3f} to {high:.3f})"
    )
    return Verdict(name, claim, measured, GAIN, verdict, {"ratio": value, "low": low, "high": high})


def yaw(frames: int, seed: int) -> Verdict:
    """Does theta_hat find the direction of the walls?"""
    folded = []
    for v in _views(frames, seed):
        walls = v.scene.points[v.scene.walls[:, 1]] - v.scene.points[v.scene.walls[:, 0]]
        longest = walls[int(np.argmax(np.hypot(*walls.T)))]
        off = math.degrees(v.gauge.theta - math.atan2(longest[1], longest[0]))
        folded.append((off + 45.0) % 90.0 - 45.0)
    claim = "the gauge angle aligns the frame with the walls (a yaw)"
    what = f"theta_hat within {NEAR_DEG:g} deg of the longest wall, modulo 90 deg (chance: 11 %)"
    return _share("yaw", claim, [abs(f) < NEAR_DEG for f in folded], what, folded_deg=np.round(folded, 2).tolist())


def identified(frames: int, seed: int) -> Verdict:
    """Does the noise-free landscape have a minimum at all?"""
    uneven = []
    camera = Condition().camera
    for scene in scenes(Condition(), frames, seed):
        p, q = (camera.rays_level(x, scene.gravity) for x in (scene.ceiling, scene.floor))
        uneven.append(not solve_gauge(p, q).flat)
    claim = "exact pixels and gravity determine the gauge angle"
    return _share("identified", claim, uneven, "noise-free sigma_min above 1e-9 at some angle")


def four_minima(frames: int, seed: int) -> Verdict:
    """Are there four minima a quarter turn apart?"""
    symmetric, counts = [], []
    for v in _views(frames, seed):
        curve = v.gauge.scan_sigma_min
        minima = np.flatnonzero((curve < np.roll(curve, 1)) & (curve <= np.roll(curve, -1)))
        counts.append(len(minima))
        apart = math.degrees(v.gauge.scan_theta[minima[-1]] - v.gauge.scan_theta[minima[0]]) if len(minima) == 2 else 0
        symmetric.append(abs(apart - 90.0) < NEAR_DEG)
    what = f"two minima per half turn, 90 +- {NEAR_DEG:g} deg apart (median {np.median(counts):.0f} minima)"
    claim = "sigma_min has four minima at steps of pi/2"
    return _share("four minima", claim, symmetric, what, minima=counts)


def periodic(frames: int, seed: int) -> Verdict:
    """Is the spectrum of A(theta) the same at theta + pi?"""
    worst = 0.0
    for v in _views(frames, seed):
        for theta in np.radians((-71.3, -20.9, 12.7, 58.1)):
            a, b = (
                np.linalg.svd(constraint_matrix(v.p, v.q, float(t))[0], compute_uv=False)
                for t in (theta, theta + np.pi)
            )
            worst = max(worst, float(np.abs(a - b).max() / a[0]))
    rule = f"holds if the largest relative difference is below {EXACT:g}"
    measured = f"spectra at theta and theta + pi differ by at most {worst:.1e} sigma_max ({frames} views)"
    verdict = HOLDS if worst < EXACT else FAILS
    return Verdict("periodic", "sigma_min is exactly pi-periodic", measured, rule, verdict, {"worst": worst})


def search(frames: int, seed: int) -> Verdict:
    """Is the searched angle better than zero?"""
    views = _views(frames, seed)
    found = np.array([v.error(v.gauge.points) for v in views])
    zero = np.array([v.error(solve_gauge(v.p, v.q, theta=0.0).points) for v in views])
    return _gain("search", "minimizing sigma_min over theta improves the structure over theta = 0", views, found, zero)


def verticality(frames: int, seed: int) -> Verdict:
    """Do the verticality rows of A improve the depths?"""
    views = _views(frames, seed)
    without = []
    for v in views:
        depths = np.linalg.svd(v.gauge.matrix[len(v.p) :])[2][-1]
        depths = depths * np.sign(depths.sum())
        # In the level frame corner i lies at Z_i (x, z) of its ceiling ray, whatever theta was.
        without.append(v.error(v.p[:, [0, 2]] * depths[:, None]))
    found = np.array([v.error(v.gauge.points) for v in views])
    return _gain("verticality", "the verticality rows help to recover the depths", views, found, np.array(without))


def symmetry(frames: int, seed: int) -> Verdict:
    """Does counting points behind the camera and order errors choose the better structure?"""
    right, by_order = [], 0
    for v in _views(frames, seed):
        if len(v.gauge.candidates) < 4:
            continue
        errors = [v.error(solve_gauge(v.p, v.q, theta=float(t)).points) for t in v.gauge.candidates[:2]]
        errors = [math.inf if math.isnan(e) else e for e in errors]
        chosen = int(np.argmin(np.abs(np.tan(v.gauge.candidates[:2] - v.gauge.theta))))  # modulo pi: one structure
        right.append(errors[chosen] <= errors[1 - chosen] * (1.0 + 1e-9))
        fewest = v.gauge.negative_depths == v.gauge.negative_depths.min()
        by_order += len(np.unique(v.gauge.order_errors[fewest])) > 1
    what = f"chosen one of theta_hat and theta_hat + pi/2 has the smaller error (left-right order decided {by_order})"
    return _share("symmetry", "the symmetry check picks the right minimum", right, what, decided_by_order=by_order)


def inscribed(frames: int, seed: int) -> Verdict:
    """Does moving the camera to the inscribed-angle position improve the rays?"""
    views = _views(frames, seed)
    moved = []
    for v in views:
        column = 0.5 * (azimuth(v.p) + azimuth(v.q))
        moved.append(v.error(v.gauge.points - inscribed_position(v.gauge.points, float(column[-1] - column[0]))))
    stay = np.array([v.error(v.gauge.points) for v in views])
    return _gain("inscribed angle", "the inscribed-angle step improves the layout", views, np.array(moved), stay)


def gamma(frames: int, seed: int) -> Verdict:
    """Does the exponent 10 change which pose of a single image scores best?"""
    changed = []
    headings = np.arange(0, 360, 10)
    for v in _views(min(frames, SCORED_VIEWS), seed):
        plan = home_of(v.scene.plan, v.scene.kind)
        profiles = Caster(plan)(plan.free_space(0.1).positions(0.3)[::40])
        ranges = np.exp(rays_of(v.gauge.points, v.seen.walls, v.scene.azimuths)[0])[::-1]  # rays run right to left
        known = np.isfinite(ranges)
        n = len(ranges)
        bins = (headings[:, None] + np.arange(n)[known] - (n - 1) // 2) % 360
        seen = profiles.astype(np.float64)[:, bins]
        plain = (seen @ ranges[known]) / (np.linalg.norm(seen, axis=2) * np.linalg.norm(ranges[known]))
        sharp = score_volume(profiles, Rays(ranges, known, np.full(n, np.nan)), headings)
        best = np.unravel_index(int(np.argmax(sharp)), plain.shape)
        changed.append(bool(plain[best] < plain.max() - 1e-6))  # single precision of the score volume
    rule = "holds if no view's best pose differs by more than single precision"
    measured = f"best pose changed in {sum(changed)} of {len(changed)} views ({plain.size} poses each)"
    claim = "gamma = 10 cannot change the best pose of a single image"
    verdict = FAILS if any(changed) else HOLDS
    return Verdict("gamma", claim, measured, rule, verdict, {"changed": sum(changed), "views": len(changed)})


def landscape(frames: int, seed: int) -> dict[str, Any]:
    """sigma_min / sigma_max over a turn for one view, noise-free and noisy, with the poles of lambda."""
    camera = Condition().camera
    views = _views(min(frames, 12), seed)
    v = next((v for v in views if 4 <= len(v.p) <= 6), views[0])
    exact = [camera.rays_level(x, v.scene.gravity) for x in (v.scene.ceiling, v.scene.floor)]
    degrees = np.arange(-180.0, 180.0, 0.5) + 0.0625
    curves = []
    for p, q in (exact, (v.p, v.q)):
        singular = [np.linalg.svd(constraint_matrix(p, q, math.radians(t))[0], compute_uv=False) for t in degrees]
        curves.append([float(s[-1] / s[0]) for s in singular])
    poles = np.degrees(np.arctan2(v.q[:, 2], v.q[:, 0]))
    return {
        "theta_deg": degrees.tolist(),
        "exact": curves[0],
        "noisy": curves[1],
        "poles_deg": [float(p) for p in np.unique(np.concatenate([poles, poles - 180.0]))],
        "theta_hat_deg": math.degrees(v.gauge.theta),
    }


CLAIMS: dict[str, Callable[[int, int], Verdict]] = {
    "yaw": yaw,
    "identified": identified,
    "four minima": four_minima,
    "periodic": periodic,
    "search": search,
    "verticality": verticality,
    "symmetry": symmetry,
    "inscribed angle": inscribed,
    "gamma": gamma,
}
"""Every statement by name."""


def judge(name: str, frames: int, seed: int) -> dict[str, Any]:
    """One statement's verdict as a JSON object."""
    return asdict(CLAIMS[name](frames, seed))
