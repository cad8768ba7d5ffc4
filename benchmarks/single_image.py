"""Localization from one image: the paper's method, the default, the default with known heights, and true ranges.

    python benchmarks/single_image.py --out runs/single_image
    python benchmarks/single_image.py --real ../shared/data/plans --out runs/single_image_real

All methods see the same images: generated homes of the test split, or real plans with --real; poses uniform in free
space, camera 1 to 1.7 m above the floor; every image counts. Prints tables; writes OUT.json and OUT.png. A run that was
cut off goes on where it stopped.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import View, chosen, resumable, true_rays, views, write
from numpy.typing import NDArray
from single_image_report import figure, report, summary

from galoc import Camera, Estimate, Floorplan, GalocError, Localizer, LocalizerConfig, Rays
from galoc.heights import Heights
from galoc.metrics import pose_error, rank
from galoc.peaks import search
from galoc_env.homes import generate

Array = NDArray[np.float64]
Scores = NDArray[np.float32]

METHODS = ("paper", "ml", "ml+ceiling", "ml+heights", "oracle")
SIZE = (640, 480)
HEIGHTS_SD = 0.03
"""Relative error of the heights that "ml+heights" is told."""
REAL = (
    "amrl_maps/AHG1.json", "amrl_maps/GDC1.json", "amrl_maps/GDC3.json", "amrl_maps/NSH1.json", "amrl_maps/GHC1.json",
    "amrl_maps/LGRC1.json", "ifc_duplex/Duplex_Architecture_1_Level-1.json", "mlstruct_fp/floor_302.json",
    "mlstruct_fp/floor_1058.json", "mlstruct_fp/floor_848.json", "wrld_westport/westport-house-floor-1.json",
    "utexas_gdc/raw/gdc_1.yaml", "utexas_gdc/raw/gdc_3.yaml", "turtlebot_willow/willow-2010-02-18-0.10.json",
)  # fmt: skip
"""Plans below the folder of --real."""

Task = tuple[str | int, float, float, float, int, int, tuple[str, ...], int]
"""Plan file or number of the home, hfov, sigma, imu, number of the plan, frames, methods, seed."""
Found = tuple[Estimate, Callable[[], Scores]]
"""Estimate, and what gives the (P, 360) scores behind it."""


def locate(method: str, localizer: Localizer, view: View, heights: tuple[float, float]) -> Found:
    """Estimate of one method.

    Args:
        method: one of ``METHODS``.
        localizer: of that method.
        view: the image.
        heights: of camera and ceiling as told to "ml+heights", m.
    """
    if method == "oracle":
        rays = true_rays(localizer.plan, localizer.camera, view.pose)
        match = search(localizer.field, rays)
        return _cosine(rays, match.candidates[0, :3]), lambda: match.volume
    told = Heights.known(*heights, sd=HEIGHTS_SD) if method == "ml+heights" else None
    seen = (view.wireframe, view.gravity, told)
    return localizer.locate(*seen), lambda: localizer.scores(*seen)


def _cosine(rays: Rays, pose: Array) -> Estimate:
    return Estimate(pose, rays.coverage**2, False, rays=rays)


def truth_rank(localizer: Localizer, scores: Scores, pose: Array) -> float:
    """Share of the positions whose best heading beats the true pose's, headings within 2 degrees of the truth."""
    headings = (round(math.degrees(pose[2])) + np.arange(-2, 3)) % 360
    truth = float(scores[localizer.field.nearest(pose[:2]), headings].max())
    return rank(scores.max(axis=1), truth)


def measure(task: Task) -> dict[str, Any]:
    """Every method on the views of one plan under one condition."""
    source, hfov, sigma, imu, number, frames, methods, seed = task
    plan = generate(source, split="test") if isinstance(source, int) else Floorplan.load(source)
    camera = Camera.from_hfov(*SIZE, hfov)
    paper = Localizer(plan, camera, geometry="paper", scoring="cosine")
    default = Localizer(plan, camera, config=LocalizerConfig(imu_sigma_deg=max(imu, 0.1)))
    under = LocalizerConfig(imu_sigma_deg=max(imu, 0.1), ceiling_from_plan=True)
    localizers = {"paper": paper, "oracle": paper, "ml": default, "ml+heights": default}
    if "ml+ceiling" in methods:
        localizers["ml+ceiling"] = Localizer(plan, camera, config=under)
    told = np.random.default_rng([seed, number, 2])
    rows: dict[str, dict[str, list[float]]] = {
        m: {k: [] for k in ("error_m", "error_rad", "confidence", "rank", "ms")} for m in methods
    }
    seen = views(plan, camera, frames, sigma, imu, (seed, number))
    coverage = []
    for i, view in enumerate(seen):
        coverage.append(paper.observe(view.wireframe, view.gravity)[1].coverage)
        off = np.exp(HEIGHTS_SD * told.standard_normal(2))
        camera_m, ceiling_m = view.height * off[0], plan.ceiling_height * off[1]
        heights = (float(min(camera_m, 0.98 * ceiling_m)), float(ceiling_m))
        for method in methods:
            localizer, row = localizers[method], rows[method]
            if i == 0:
                locate(method, localizer, view, heights)  # compiles
            start = time.process_time()
            estimate, scores = locate(method, localizer, view, heights)
            row["ms"].append(1e3 * (time.process_time() - start))
            error_m, error_rad = pose_error(estimate.pose, view.pose)
            row["error_m"].append(error_m)
            row["error_rad"].append(error_rad)
            row["confidence"].append(0.0 if estimate.abstained else min(estimate.confidence, 1.0))
            row["rank"].append(1.0 if estimate.abstained else truth_rank(localizer, scores(), view.pose))
    return {
        "condition": [hfov, sigma, imu],
        "plan": plan.name,
        "number": number,
        "positions": len(paper.field.positions),
        "coverage": coverage,
        "corner_pairs": [v.corner_pairs for v in seen],
        "methods": rows,
    }


def sources(plans: int, real: Path | None) -> list[str | int]:
    """Numbers of the generated homes, or the files of the real plans."""
    if real is None:
        if plans < 1:
            raise GalocError(f"--plans {plans}", "1 or more", "Use 24.")
        return list(range(plans))
    files = [real / name for name in REAL]
    missing = [f for f in files if not f.is_file()]
    if missing:
        raise GalocError(f"no plan {str(missing[0])!r}", "the folder of the published plans", "Fix --real.")
    return [str(f) for f in files]


def main(
    plans: int = 24,
    frames: int | None = None,
    hfov: tuple[float, ...] = (108.0, 80.0),
    sigma: tuple[float, ...] = (5.0,),
    imu: tuple[float, ...] = (1.0,),
    methods: tuple[str, ...] = METHODS,
    real: Path | None = None,
    jobs: int = 2,
    seed: int = 0,
    out: Path = Path("runs/single_image"),
) -> None:
    """Measure and report.

    Args:
        plans: Generated test homes.
        frames: Images per plan; by default 20, or 8 with --real.
        hfov: Horizontal fields of view, degrees.
        sigma: Standard deviations of the junctions, px.
        imu: Standard deviations of measured roll and pitch, degrees.
        methods: Which to run.
        real: Folder of the published plans; replaces the generated homes.
        jobs: Processes, one thread each.
        seed: Of poses and noise.
        out: Path without suffix of the JSON and PNG.
    """
    methods = chosen("--methods", methods, METHODS)
    frames = (20 if real is None else 8) if frames is None else frames
    if frames < 1:
        raise GalocError(f"--frames {frames}", "1 or more", "Use 20.")
    from_plans = list(enumerate(sources(plans, real)))
    conditions = [(h, s, i) for h in hfov for s in sigma for i in imu]
    tasks = [(source, *c, number, frames, methods, seed) for c in conditions for number, source in from_plans]
    settings = {
        "plans": [Path(s).stem if isinstance(s, str) else s for _, s in from_plans], "frames": frames,
        "conditions": conditions, "methods": methods, "seed": seed, "size": SIZE, "heights_sd": HEIGHTS_SD,
    }  # fmt: skip
    rows = resumable(measure, tasks, job=settings, out=out, jobs=jobs, unit="plan")
    result = {"settings": settings, "summary": summary(rows, methods), "frames": rows}
    write(out, result, figure(result))
    print(report(result, per_plan=real is not None))


if __name__ == "__main__":
    try:
        tyro.cli(main)
    except GalocError as error:
        raise SystemExit(f"error: {error}") from None
