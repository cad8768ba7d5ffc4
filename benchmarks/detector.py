"""The front ends: boundary error, mask IoU, corners, coverage, abstention and time, on homes nobody trained on.

    python benchmarks/detector.py --out runs/detector
    python benchmarks/detector.py --table robust --methods onnx --out runs/detector_robust
    python benchmarks/detector.py --table domain --methods onnx --out runs/detector_domain

Furnished test homes, photographed with every fault of lens and sensor that the environment knows. The oracle (true
junctions plus noise) at 3, 5 and 7 px is the ruler. Prints tables; writes OUT.json and OUT.png. A run that was cut off
goes on where it stopped.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the label writer is in training/, which is not installed

import numpy as np
import tyro
from common import chosen, resumable, write
from detector_report import figure, report, summary
from numpy.typing import NDArray
from photos import DEGRADED, Condition, Photo, boundary_of, edges_of, furnished_plan, photographs

from galoc import GalocError, Wireframe, solve_layout
from galoc.detect.oracle import perturb
from galoc.detect.strip import azimuth_of, elevation_of
from galoc.rays import cast_rays
from galoc.wireframe import layout_mask, mask_iou

Array = NDArray[np.float64]

METHODS = ("onnx", "onnx+k", "lines", "oracle3", "oracle5", "oracle7")
"""Learned; the same told the ratio of the heights, as a run learns it; no weights; true junctions plus noise, px."""
BASE = Condition()
TABLES: dict[str, dict[str, Condition]] = {
    "base": {"base": BASE},
    "robust": {
        "base": BASE,
        **{f"hFOV {v:g}": replace(BASE, hfov_deg=v) for v in (55.0, 70.0, 90.0)},
        "16:9": replace(BASE, height=360),
        "portrait 3:4, 70 deg": replace(BASE, width=480, height=640, hfov_deg=70.0),
        "portrait 9:16, 55 deg": replace(BASE, width=360, height=640, hfov_deg=55.0),
        **{f"{v} px wide": replace(BASE, width=v, height=v * 3 // 4) for v in (160, 320, 1920)},
        **{f"tilt {v:g}": replace(BASE, tilt_deg=v) for v in (0.0, 10.0, 15.0)},
        **{f"camera {v:g} m": replace(BASE, camera_m=(v, v)) for v in (0.3, 0.7, 2.0)},
        "empty rooms": replace(BASE, furniture=0.0),
        "crowded rooms": replace(BASE, furniture=1.0),
    },
    "domain": {
        "raster, clean": replace(BASE, imaging=None),
        "gl, clean": replace(BASE, imaging=None, renderer="gl"),
        "raster, best": replace(BASE, imaging=None, quality="best"),
        **{name: replace(BASE, after=name) for name in DEGRADED},
    },
}
"""Conditions by table."""
ISOLATED_DEG, NEAR_DEG, SEEN_SHARE = 4.0, 1.5, 0.3
"""A corner counts for recall when no other edge is nearer, and when so much of it is seen; it is found within NEAR."""
BLIND_SHARE = 0.04
"""Views whose visible wall lines cover less of their columns are blind."""

Task = tuple[str, dict[str, Any], int | str, int, tuple[str, ...], int]
"""Condition's name and values, home, photographs, methods, seed."""
Detect = Callable[[Photo, np.random.Generator], tuple[Wireframe, float]]
"""The wireframe of a photo, and a score that something is seen."""


def detectors(methods: tuple[str, ...]) -> dict[str, Detect]:
    """For each method, what gives the wireframe of a photo and a score that something is seen."""
    found: dict[str, Detect] = {}
    for method in methods:
        if method.startswith("oracle"):
            found[method] = partial(_oracle, float(method[6:]))
        elif method.startswith("onnx"):
            from galoc.detect.onnx import OnnxDetector

            found[method] = partial(_learned, OnnxDetector(), method == "onnx+k")
        else:
            from galoc.detect.lines import LinesDetector

            found[method] = partial(_plain, LinesDetector())
    return found


def _oracle(sigma: float, photo: Photo, rng: np.random.Generator) -> tuple[Wireframe, float]:
    noisy = perturb(photo.truth, photo.camera, sigma * photo.camera.width / 640.0, rng)
    return noisy, float(len(noisy) > 0)


def _learned(detector: Any, k_known: bool, photo: Photo, _: np.random.Generator) -> tuple[Wireframe, float]:
    height = photo.view.height_m
    told = (math.log(height / (photo.ceiling_m - height)), 0.02) if k_known else None
    wireframe = detector.detect(photo.image, photo.camera, photo.view.measured, log_ratio=told)
    columns = wireframe.columns
    return wireframe, 0.0 if columns is None else float(columns.visible.max(axis=0).mean())


def _plain(detector: Any, photo: Photo, _: np.random.Generator) -> tuple[Wireframe, float]:
    wireframe = detector.detect(photo.image, photo.camera, photo.view.measured)
    return wireframe, float(len(wireframe) > 0)


def score(photo: Photo, wireframe: Wireframe) -> dict[str, Any]:
    """Everything that is measured of one wireframe."""
    camera, gravity, labels = photo.camera, photo.view.measured, photo.labels
    count = labels.row.shape[1]
    azimuths = azimuth_of(2.0 * np.arange(count) + 0.5, 2 * count)
    truth = elevation_of(labels.row.astype(float))
    error = np.degrees(np.abs(boundary_of(wireframe, camera, gravity, azimuths) - truth))
    known = np.isfinite(truth)
    visible, hidden = labels.visible & known, labels.in_frame & ~labels.visible & known
    rays = cast_rays(solve_layout(wireframe, camera, gravity), camera)
    edges = edges_of(wireframe, camera, gravity)
    wanted = azimuth_of(labels.edges[:, 0].astype(float), 2 * count)
    inside = np.abs(wanted) < camera.hfov_rad / 2.0 - math.radians(2.0)
    alone = np.array([np.sum(np.abs(wanted - a) < math.radians(ISOLATED_DEG)) == 1 for a in wanted], bool)
    target = wanted[alone & inside & (labels.edges[:, 2] > SEEN_SHARE)] if len(wanted) else wanted
    near = math.radians(NEAR_DEG)
    return {
        "visible": error[visible & np.isfinite(error)].round(3).tolist(),
        "visible_missing": int(np.count_nonzero(visible & ~np.isfinite(error))),
        "hidden": error[hidden & np.isfinite(error)].round(3).tolist(),
        "hidden_missing": int(np.count_nonzero(hidden & ~np.isfinite(error))),
        "iou": mask_iou(layout_mask(wireframe, camera), layout_mask(photo.truth, camera)),
        "corners_found": len(edges),
        "corners_right": int(sum(bool(np.any(np.abs(wanted - e) < near)) for e in edges)),
        "corners_wanted": len(target),
        "corners_hit": int(sum(bool(np.any(np.abs(edges - t) < near)) for t in target)),
        "coverage": rays.coverage,
        "abstained": len(wireframe) == 0,
    }


def measure(task: Task) -> dict[str, Any]:
    """Every method on the photographs of one home under one condition."""
    name, values, source, count, methods, seed = task
    condition = Condition(**{**values, "camera_m": tuple(values["camera_m"])})
    scene = furnished_plan(source, condition)
    found = detectors(methods)
    number = source if isinstance(source, int) else 0
    rng = np.random.default_rng([seed, number, 5])
    rows: dict[str, list[dict[str, Any]]] = {method: [] for method in methods}
    blind = []
    for photo in photographs(scene, condition, count, [seed, number]):
        blind.append(float(photo.labels.visible.any(axis=0).mean()) <= BLIND_SHARE)
        for method, detect in found.items():
            if not rows[method]:
                detect(photo, np.random.default_rng(0))  # compiles
            start = time.process_time()
            wireframe, seen = detect(photo, rng)
            spent = 1e3 * (time.process_time() - start)
            rows[method].append({**score(photo, wireframe), "ms": spent, "seen": seen})
    return {"condition": name, "plan": scene.plan.name, "blind": blind, "methods": rows}


def main(
    table: str = "base",
    homes: int = 60,
    frames: int = 6,
    methods: tuple[str, ...] = METHODS,
    conditions: tuple[str, ...] = (),
    jobs: int = 2,
    seed: int = 0,
    out: Path = Path("runs/detector"),
) -> None:
    """Measure and report.

    Args:
        table: Which conditions: base, robust, domain.
        homes: Test homes.
        frames: Photographs per home and condition.
        methods: Which front ends.
        conditions: Some of the table's; default: all.
        jobs: Processes, one thread each.
        seed: Of poses and noise.
        out: Path without suffix of the JSON and PNG.
    """
    if table not in TABLES:
        raise GalocError(f"--table {table}", f"one of {', '.join(TABLES)}", "Fix --table.")
    if homes < 1 or frames < 1:
        raise GalocError(f"--homes {homes} --frames {frames}", "1 or more", "Raise them.")
    methods = chosen("--methods", methods, METHODS)
    wanted = chosen("--conditions", conditions or tuple(TABLES[table]), tuple(TABLES[table]))
    tasks = [
        (name, asdict(TABLES[table][name]), home, frames, methods, seed) for home in range(homes) for name in wanted
    ]
    settings = {
        "table": table,
        "homes": homes,
        "frames": frames,
        "methods": methods,
        "conditions": wanted,
        "seed": seed,
    }
    rows = resumable(measure, tasks, job=settings, out=out, jobs=jobs, unit="home")
    result = {"settings": settings, "summary": summary(rows, wanted, methods), "homes": rows}
    write(out, result, figure(result))
    print(report(result))


if __name__ == "__main__":
    try:
        tyro.cli(main)
    except GalocError as error:
        raise SystemExit(f"error: {error}") from None
