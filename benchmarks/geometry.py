"""What the layout solvers reach on the same views: ray error, tilt, calibration, wrong junctions, time.

    python benchmarks/geometry.py --out docs/figures/geometry

Views come from generated test homes (mixed kinds), as in ``galoc-env stress``. Intervals are 95 %, by bootstrap over
homes. Prints tables; writes OUT.png and OUT.json.
"""

from __future__ import annotations

import io
import json
import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import cell
from numpy.typing import NDArray

from galoc.formats.atomic import write_atomic
from galoc.gauge import constraint_matrix
from galoc_env.film import writable_folder
from galoc_env.partial import jsonable
from galoc_env.stress_observe import observe
from galoc_env.stress_scenes import Condition, scenes
from galoc_env.stress_scores import Scores, built_in, interval, ratio_interval, score, share

Array = NDArray[np.float64]
Row = dict[str, Any]

SOLVERS = ("paper", "tls", "ml")
SIGMAS = (3.0, 5.0, 7.0)
TILTS = (0.0, 1.0, 2.0)
HFOVS = (108.0, 80.0)
TIMED_PAIRS = 8
COLOURS = {"paper": "#c8553d", "paper-fixed": "#e3a35a", "tls": "#5a9e6f", "ml": "#3d6fb4"}


def accuracy(condition: Condition, scores: dict[str, Scores]) -> Row:
    """Ray error and failures of every solver, and the ratio to the paper's on the views both recovered."""
    row: Row = {"hfov_deg": condition.hfov_deg, "sigma_px": condition.sigma_px, "tilt_deg": condition.tilt_deg}
    for name, s in scores.items():
        row[f"{name}_error"] = interval(s.ray_error, s.plan)
        row[f"{name}_median"] = float(np.nanmedian(s.ray_error))
        row[f"{name}_failed"] = share(s.failed)
        if name != "paper":
            row[f"{name}_ratio"] = ratio_interval(s.ray_error, scores["paper"].ray_error, s.plan)
    return row


def calibration(s: Scores) -> tuple[float, float, float]:
    """Share of rays within two predicted standard deviations of the truth."""
    inside = np.array([float(np.sum(np.abs(z) < 2.0)) for z in s.z])
    return ratio_interval(inside, np.array([float(len(z)) for z in s.z]), s.plan)


def tilt(s: Scores) -> Row:
    """Tilt error of the solver and of the IMU, degrees, and their ratio."""
    both = {"solver_deg": np.degrees(s.tilt), "imu_deg": np.degrees(s.imu)}
    out: Row = {name: interval(values, s.plan) for name, values in both.items()}
    return out | {"ratio": ratio_interval(s.tilt, s.imu, s.plan) if s.imu.any() else (math.nan,) * 3}


def svd_scan(p: Array, q: Array) -> Array:
    """The paper's search as it reads: 360 dense SVDs, one more for the depths; (N, 2) level points."""
    thetas = np.radians(np.arange(-180.0, 180.0) + 0.01)
    values = [np.linalg.svd(constraint_matrix(p, q, float(t))[0], compute_uv=False)[-1] for t in thetas]
    depths = np.linalg.svd(constraint_matrix(p, q, float(thetas[int(np.argmin(values))]))[0])[2][-1]
    return np.asarray(p[:, [0, 2]] * depths[:, None])


def timing(views: int, seed: int) -> dict[str, float]:
    """Processor time per solve, microseconds, of views with 8 pairs; after compilation, median of 9 batches."""
    condition = Condition(pairs=TIMED_PAIRS)
    seen = [observe(s, condition, i, seed) for i, s in enumerate(scenes(condition, views, seed))]
    pixels = {name: np.stack([getattr(o, name) for o in seen]) for name in ("ceiling", "floor", "gravity")}
    told = {"sigma_px": condition.sigma_px, "imu_sigma_rad": math.radians(condition.tilt_deg), **pixels}
    out = {}
    for name, solver in built_in().items():
        out[name] = 1e6 / views * _median_time(lambda s=solver: s(camera=condition.camera, **told), 9)  # type: ignore[misc]
    rays = [[condition.camera.rays_level(x, o.gravity) for x in (o.ceiling, o.floor)] for o in seen[:10]]
    out["numpy SVD scan"] = 1e6 / len(rays) * _median_time(lambda: [svd_scan(p, q) for p, q in rays], 3)
    return out


def _median_time(call: Callable[[], Any], repeats: int) -> float:
    call()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return float(np.median(times))


def measure(frames: int, seed: int) -> dict[str, Any]:
    """All tables."""
    from tqdm import tqdm

    solvers = built_in(SOLVERS)
    result: dict[str, Any] = {"settings": {"frames": frames, "seed": seed}, "accuracy": [], "ml": [], "wrong": []}
    grid = [(h, s, t) for h in HFOVS for s in SIGMAS for t in TILTS]
    for hfov, sigma, imu in tqdm(grid, desc="conditions"):
        condition = Condition(sigma_px=sigma, tilt_deg=imu, hfov_deg=hfov)
        scores = score(condition, frames, seed, solvers)
        result["accuracy"].append(accuracy(condition, scores))
        blind = score(replace(condition, noise_known=False), frames, seed, built_in(("ml",)))["ml"]
        own = {"hfov_deg": hfov, "sigma_px": sigma, "tilt_deg": imu, **tilt(scores["ml"])}
        own |= {"within_2_sigma": calibration(scores["ml"]), "within_2_sigma_noise_unknown": calibration(blind)}
        result["ml"].append(own)
    for sigma in SIGMAS:
        condition = Condition(sigma_px=sigma, wrong_junctions=1)
        scores = score(condition, frames, seed, solvers)
        row = accuracy(condition, scores)
        row["found"] = interval(scores["ml"].found, scores["ml"].plan)
        row["right_refused"] = interval(scores["ml"].refused, scores["ml"].plan)
        row["recovered"] = interval(scores["ml"].recovered, scores["ml"].plan)
        result["wrong"].append(row)
    result["time_us"] = timing(min(frames, 200), seed)
    return result


def report(result: dict[str, Any]) -> str:
    """The tables, for people."""
    lines = ["(a) mean ray error / %, share of views that failed / %, error ratio to the paper (95 % intervals)"]
    head = "".join(f"{s:>18} {'failed':>7}" for s in SOLVERS)
    lines.append(f"{'hfov sigma tilt':<16}{head}{'tls/paper':>20}{'ml/paper':>20}")
    for rows, title in (
        (result["accuracy"], None),
        (result["wrong"], "(d) one wrong junction in each view (30-80 px)"),
    ):
        lines += ["", title] if title else []
        for r in rows:
            errors = [cell(r[f"{s}_error"], digits=2) for s in SOLVERS]
            failed = [100 * r[f"{s}_failed"][0] for s in SOLVERS]
            cells = "".join(f"{e:>18} {f:>6.1f}%" for e, f in zip(errors, failed, strict=True))
            ratios = "".join(f"{cell(r[f'{s}_ratio'], 1.0, 2):>20}" for s in SOLVERS[1:])
            lines.append(f"{r['hfov_deg']:4.0f} {r['sigma_px']:5.0f} {r['tilt_deg']:4.0f} {cells}{ratios}")
    for r in result["wrong"]:
        lines.append(
            f"  sigma {r['sigma_px']:.0f}: ml found {cell(r['found'], digits=1)} % of the wrong pairs, refused "
            f"{cell(r['right_refused'], digits=2)} % of the right ones, kept {cell(r['recovered'], digits=1)} % "
            "of the rays"
        )
    lines += ["", "(b) tilt error / deg  (c) rays within 2 sigma / %  (ml)"]
    lines.append(f"{'hfov sigma tilt':<16}{'IMU':>18}{'ml':>18}{'ml/IMU':>18}{'noise told':>20}{'noise estimated':>20}")
    for r in result["ml"]:
        cells = "".join(f"{cell(r[k], 1.0, 2):>18}" for k in ("imu_deg", "solver_deg", "ratio"))
        inside = "".join(f"{cell(r[k], digits=1):>20}" for k in ("within_2_sigma", "within_2_sigma_noise_unknown"))
        lines.append(f"{r['hfov_deg']:4.0f} {r['sigma_px']:5.0f} {r['tilt_deg']:4.0f} {cells}{inside}")
    lines += ["", f"(e) processor time per solve, N = {TIMED_PAIRS}"]
    times = result["time_us"]
    for name, us in times.items():
        lines.append(f"  {name:<16}{us:10.1f} us   paper / this: {times['paper'] / us:8.2f}")
    return "\n".join(lines)


def figure(result: dict[str, Any]) -> bytes:
    """Ray errors, tilt, calibration and time."""
    from matplotlib.figure import Figure

    page = Figure(figsize=(15.0, 3.6), layout="constrained")
    axes = page.subplots(1, 5, width_ratios=(1.2, 1.2, 1.0, 1.0, 1.0))
    ticks = [f"{s:.0f}/{t:.0f}" for s in SIGMAS for t in TILTS]
    for panel, hfov in zip(axes[:2], HFOVS, strict=True):
        rows = [r for r in result["accuracy"] if r["hfov_deg"] == hfov]
        for k, name in enumerate(SOLVERS):
            value, low, high = 100.0 * np.array([r[f"{name}_error"] for r in rows], dtype=float).T
            x = np.arange(len(rows)) + 0.27 * (k - 1)
            panel.bar(x, value, 0.25, color=COLOURS[name], label=name)
            panel.vlines(x, low, high, color="black", lw=0.8)
        panel.set(title=f"{hfov:.0f} deg", ylabel="mean ray error / %", xlabel="pixel noise / px, IMU error / deg")
        panel.set_xticks(np.arange(len(rows)), ticks, fontsize=7)
        panel.legend(fontsize=8)
    wide = [r for r in result["ml"] if r["hfov_deg"] == HFOVS[0]]
    for sigma, shade in zip(SIGMAS, ("#9dbbe0", "#3d6fb4", "#1d3a66"), strict=True):
        rows = [r for r in wide if r["sigma_px"] == sigma]
        x = [r["tilt_deg"] for r in rows]
        axes[2].plot(x, [r["solver_deg"][0] for r in rows], "o-", color=shade, label=f"ml, {sigma:.0f} px")
        axes[3].plot(x, [100.0 * r["within_2_sigma"][0] for r in rows], "o-", color=shade, label=f"{sigma:.0f} px")
        blind = [100.0 * r["within_2_sigma_noise_unknown"][0] for r in rows]
        axes[3].plot(x, blind, "s:", color=shade, label=f"{sigma:.0f} px, noise estimated")
    axes[2].plot(x, [r["imu_deg"][0] for r in rows], "k--", label="IMU")
    axes[2].set(xlabel="IMU error / deg (sd per angle)", ylabel="tilt error / deg", title=f"tilt, {HFOVS[0]:.0f} deg")
    axes[2].legend(fontsize=7)
    axes[3].axhline(95.45, color="0.5", lw=1, ls="--")
    axes[3].set(xlabel="IMU error / deg (sd per angle)", ylabel="rays within 2 sigma / %", ylim=(85, 100))
    axes[3].set_title("calibration")
    axes[3].legend(fontsize=7)
    names = list(result["time_us"])
    axes[4].barh(names, list(result["time_us"].values()), color=[COLOURS.get(n, "0.5") for n in names])
    axes[4].set(xscale="log", xlabel="time per solve / us", title=f"N = {TIMED_PAIRS}")
    out = io.BytesIO()
    page.savefig(out, dpi=110)
    return out.getvalue()


def main(frames: int = 600, seed: int = 0, out: Path = Path("runs/geometry")) -> None:
    """Measure and report.

    Args:
        frames: Views per condition.
        seed: Seed of homes, poses and noise.
        out: Path without suffix of the PNG and JSON.
    """
    writable_folder(out.parent)
    result = jsonable(measure(frames, seed))
    write_atomic(out.with_suffix(".json"), (json.dumps(result, indent=1) + "\n").encode())
    write_atomic(out.with_suffix(".png"), figure(result))
    print(report(result))


if __name__ == "__main__":
    tyro.cli(main)
