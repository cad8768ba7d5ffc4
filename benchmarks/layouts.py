"""Layouts of whole wireframes: range error, coverage, calibration and tilt of the paper's method and of "ml".

    python benchmarks/layouts.py --out docs/figures/layouts

Unlike geometry.py, which hands bare pairs to the solvers, this runs what an image goes through: completion for the
paper, cut and one-sided walls as measurements for "ml". Same views for both: generated homes of the test split, poses
uniform in free space, all views counted. "ml+grid" also uses the wall-direction prior where the map is right-angled.
Prints the table; writes OUT.json.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import tyro
from common import View, cell, true_rays, views
from numpy.typing import NDArray
from tqdm import tqdm

from galoc import Camera, Floorplan, solve_layout
from galoc.formats.atomic import write_atomic
from galoc.localizer import GRID_SHARE
from galoc.plan_facts import manhattan
from galoc.rays import cast_rays
from galoc_env.homes import generate
from galoc_env.stress_scores import FAILED, interval, ratio_interval, ray_error

Array = NDArray[np.float64]

METHODS = ("paper", "ml", "ml+grid")
CONDITIONS = tuple(
    (h, s, t) for h in (108.0, 80.0) for s, t in ((3.0, 1.0), (5.0, 0.0), (5.0, 1.0), (5.0, 2.0), (7.0, 1.0))
)
"""Field of view (deg), junction noise (px), IMU noise (deg)."""


def score(plan: Floorplan, camera: Camera, view: View, imu_deg: float, method: str) -> list[float]:
    """Range error, coverage, rays within 2 sigma and tilt error (deg) of one view; NaN where nothing is known."""
    layout = solve_layout(
        view.wireframe,
        camera,
        view.gravity,
        method.partition("+")[0],
        imu_sigma_rad=math.radians(max(imu_deg, 0.05)),
        on_grid=method == "ml+grid" and manhattan(plan.segments)[0] >= GRID_SHARE,
    )
    rays, truth = cast_rays(layout, camera), true_rays(plan, camera, view.pose)
    known = rays.known & truth.known
    tilt = math.nan if layout.gravity is None else math.degrees(math.hypot(*layout.gravity))
    error = ray_error(np.log(rays.range), truth.range)
    if math.isnan(error):
        return [math.nan, rays.coverage, math.nan, tilt]
    # The unit of a layout is the geometric mean of the two heights, which the view itself does not tell.
    unit = math.sqrt(view.height * (plan.ceiling_height - view.height) / float(np.prod(layout.heights)))
    z = np.log(rays.range[known] / truth.range[known] * unit) / np.sqrt(rays.variance[known])
    return [error, rays.coverage, float(np.mean(np.abs(z) < 2.0)) if method != "paper" else math.nan, tilt]


def measure(condition: tuple[float, float, float], plans: int, frames: int, seed: int) -> dict[str, object]:
    """All methods under one condition."""
    hfov, sigma, imu = condition
    camera = Camera.from_hfov(640, 480, hfov)
    values: dict[str, list[list[float]]] = {m: [] for m in METHODS}
    home, given = [], []
    for number in range(plans):
        plan = generate(number, split="test")
        for view in views(plan, camera, frames, sigma, imu, (seed, number)):
            home.append(number)
            given.append(math.degrees(math.hypot(*view.gravity)))
            for method in METHODS:
                values[method].append(score(plan, camera, view, imu, method))
    table = {m: np.array(v) for m, v in values.items()}
    homes = np.array(home)
    out: dict[str, object] = {"hfov_deg": hfov, "sigma_px": sigma, "imu_deg": imu, "views": len(homes)}
    for method, v in table.items():
        out[method] = {
            "error": interval(v[:, 0], homes),
            "ratio": ratio_interval(v[:, 0], table["paper"][:, 0], homes),
            "failed": float(np.mean(v[:, 0] > FAILED)),
            "coverage": float(np.mean(v[:, 1])),
            "blind": float(np.mean(v[:, 1] == 0.0)),
            "within_2_sigma": interval(v[:, 2], homes),
            "tilt_ratio": ratio_interval(v[:, 3], np.array(given), homes) if imu else (math.nan,) * 3,
        }
    return out


def line(row: dict, method: str) -> str:  # type: ignore[type-arg]
    """One method of one condition, for people."""

    def shown(name: str, scale: float = 1.0) -> str:
        return cell(row[method][name], scale, 2)

    shares = "".join(f"{100 * row[method][k]:9.1f}" for k in ("failed", "coverage", "blind"))
    where = f"{row['hfov_deg']:5.0f}{row['sigma_px']:4.0f}{row['imu_deg']:4.0f}  {method:8s}"
    return (
        f"{where}{shown('error', 100):>18}{shown('ratio'):>18}{shares}"
        f"{shown('within_2_sigma', 100):>22}{shown('tilt_ratio'):>18}"
    )


def main(plans: int = 40, frames: int = 15, seed: int = 0, out: Path = Path("runs/layouts")) -> None:
    """Score layouts of whole wireframes.

    Args:
        plans: Homes.
        frames: Views per home.
        seed: Of the views.
        out: Path without suffix of the JSON.
    """
    rows = [measure(c, plans, frames, seed) for c in tqdm(CONDITIONS, desc="conditions")]
    shares = "".join(f"{name + ' %':>9}" for name in ("failed", "known", "blind"))
    print(f"{' fov  px imu  method':23s}{'range error / %':>18}{'of the paper':>18}{shares}", end="")
    print(f"{'within 2 sigma / %':>22}{'tilt of IMU':>18}")
    for row in rows:
        print("\n".join(line(row, m) for m in METHODS))
    settings = {"plans": plans, "frames": frames, "seed": seed}
    out.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"settings": settings, "rows": rows}, indent=1).replace("NaN", "null")
    write_atomic(out.with_suffix(".json"), (text + "\n").encode())


if __name__ == "__main__":
    tyro.cli(main)
