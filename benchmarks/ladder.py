"""The oracle ladder: what the network's errors cost, part by part, and which route from columns to a pose is better.

    python benchmarks/ladder.py --out runs/ladder

Single photographs of furnished test homes. On each rung some of what the network says is replaced by the truth; the
same decoder, layout and search follow. "walls": rays are cast onto the walls drawn from the columns; "columns": each
column is a ray of its own. Prints the table; writes OUT.json and OUT.png. A run that was cut off goes on where it
stopped.
"""

from __future__ import annotations

import io
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # photographs use training/, which is not installed

import numpy as np
import tyro
from common import cell, column, resumable, write
from numpy.typing import NDArray
from photos import IMU_DEG, Condition, Photo, furnished_plan, photographs

from galoc import GalocError, Localizer, LocalizerConfig
from galoc.detect.columns import Columns
from galoc.detect.decode import decode
from galoc.heights import Heights
from galoc.metrics import aurc, calibration_error, pose_error
from galoc_env.stress_scores import interval
from galoc_env.truth_columns import true_columns

Array = NDArray[np.float64]

RUNGS = {
    "network as it is": (),
    "+ exact wall edges": ("edges",),
    "line errors clipped at 2 deg": ("clipped",),
    "clipped, exact edges": ("clipped", "edges"),
    "exact lines": ("lines",),
    "exact lines and edges": ("lines", "edges"),
}
"""What is true on each rung."""
CLIP_RAD = math.radians(2.0)
ROUTES = ("walls", "columns")
HEIGHTS_SD = 0.03
"""Relative error of the heights where they are told."""

Task = tuple[int, int, int]
"""Home, photographs, seed."""


def rung(said: Columns, true: Columns, parts: tuple[str, ...]) -> Columns:
    """The network's columns with some parts replaced by the truth."""
    if "lines" in parts:
        said = replace(
            said, elevation=true.elevation, sigma=true.sigma, sure=true.sure, visible=true.visible,
            in_frame=true.in_frame,
        )  # fmt: skip
    if "clipped" in parts:
        off = np.clip(said.elevation - true.elevation, -CLIP_RAD, CLIP_RAD)
        said = replace(said, elevation=true.elevation + off)
    return replace(said, edge=true.edge) if "edges" in parts else said


def measure(task: Task) -> dict[str, Any]:
    """Every rung, route and state of knowledge on the photographs of one home."""
    from galoc.detect.onnx import OnnxDetector

    home, count, seed = task
    condition = Condition(tilt_deg=3.0)
    scene = furnished_plan(home, condition)
    detector = OnnxDetector()
    camera = condition.camera()
    localizers = {
        route: Localizer(scene.plan, camera, config=LocalizerConfig(imu_sigma_deg=IMU_DEG, columns=route == "columns"))
        for route in ROUTES
    }
    rows: dict[str, dict[str, list[float]]] = {}
    for photo in photographs(scene, condition, count, [seed, home]):
        for name, (error_m, confidence) in _located(photo, detector, localizers, scene).items():
            row = rows.setdefault(name, {"error_m": [], "confidence": []})
            row["error_m"].append(error_m)
            row["confidence"].append(confidence)
    return {"plan": scene.plan.name, "rungs": rows}


def _located(
    photo: Photo, detector: Any, localizers: dict[str, Localizer], scene: Any
) -> dict[str, tuple[float, float]]:
    view, camera = photo.view, photo.camera
    said = detector.columns(photo.image, camera, view.measured)
    true = true_columns(scene.sight_plan, camera, view.pose, view.height_m, view.gravity, measured=view.measured)
    known = Heights.known(view.height_m, photo.ceiling_m, sd=HEIGHTS_SD)
    found = {}
    for name, parts in RUNGS.items():
        columns = rung(said, true, parts)
        for told, heights in (("", None), (", heights known", known)):
            ratio = None if heights is None else (heights.k, heights.k_sd)
            wireframe = decode(columns, camera, view.measured, log_ratio=ratio)
            for route, localizer in localizers.items():
                estimate = localizer.locate(wireframe, view.measured, heights)
                error = pose_error(estimate.pose, view.pose)[0]
                sure = min(estimate.confidence, 1.0) if math.isfinite(error) else 0.0
                found[f"{name}|{route}{told}"] = error, sure
    return found


def summary(rows: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Recall with intervals over homes, and what the confidence is worth, of every rung."""
    out = {}
    for name in rows[0]["rungs"]:
        error = column(rows, "rungs", name, "error_m", missing=np.inf)
        sure = column(rows, "rungs", name, "confidence")
        homes = np.repeat(np.arange(len(rows)), [len(row["rungs"][name]["error_m"]) for row in rows])
        recall = {f"{x:g}m": interval((error < x).astype(float), homes) for x in (0.1, 0.3, 0.5)}
        right = error < 0.5
        out[name] = {"recall": recall, "aurc": aurc(sure, right), "ece": calibration_error(sure, right)}
    return out


def report(found: dict[str, dict[str, Any]], frames: int) -> str:
    """The table, for people."""
    lines = [f"{frames} photographs (95 % intervals)"]
    lines.append(f"{'recall / %':<32}{'route':<24}{'0.1 m':>20}{'0.3 m':>20}{'0.5 m':>20}   AURC    ECE")
    for name, f in found.items():
        what, route = name.split("|")
        cells = "".join(f"{cell(f['recall'][x]):>20}" for x in ("0.1m", "0.3m", "0.5m"))
        lines.append(f"{what:<32}{route:<24}{cells}{f['aurc']:7.3f}{f['ece']:7.3f}")
    return "\n".join(lines)


def figure(found: dict[str, dict[str, Any]]) -> bytes:
    """Recall within 0.1 m and 0.5 m up the ladder."""
    from matplotlib.figure import Figure

    page = Figure(figsize=(11.0, 4.2), layout="constrained")
    at = np.arange(len(RUNGS))[::-1]
    styles = {"walls": ("#c8553d", "o"), "columns": ("#3d6fb4", "o")}
    for axes, distance in zip(page.subplots(1, 2, sharey=True), ("0.1m", "0.5m"), strict=True):
        for route, (colour, marker) in styles.items():
            for told, full in (("", True), (", heights known", False)):
                values = np.array([found[f"{name}|{route}{told}"]["recall"][distance] for name in RUNGS], float) * 100
                face = colour if full else "white"
                axes.hlines(at, values[:, 1], values[:, 2], color=colour, lw=0.6, alpha=0.35)
                axes.plot(values[:, 0], at, marker, color=colour, mfc=face, label=f"{route}{told}")
        axes.set(xlabel=f"photographs within {distance[:-1]} m / %", yticks=at, yticklabels=list(RUNGS))
        axes.grid(alpha=0.25)
        axes.spines[["top", "right"]].set_visible(False)
    handles, labels = page.axes[0].get_legend_handles_labels()
    page.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    out = io.BytesIO()
    page.savefig(out, dpi=100)
    return out.getvalue()


def main(homes: int = 40, frames: int = 6, jobs: int = 2, seed: int = 0, out: Path = Path("runs/ladder")) -> None:
    """Measure and report.

    Args:
        homes: Test homes.
        frames: Photographs per home.
        jobs: Processes, one thread each.
        seed: Of poses and noise.
        out: Path without suffix of the JSON and PNG.
    """
    if homes < 1 or frames < 1:
        raise GalocError(f"--homes {homes} --frames {frames}", "1 or more", "Raise them.")
    tasks = [(home, frames, seed) for home in range(homes)]
    settings = {"homes": homes, "frames": frames, "seed": seed}
    rows = resumable(measure, tasks, job=settings, out=out, jobs=jobs, unit="home")
    found = summary(rows)
    write(out, {"settings": settings, "summary": found, "homes": rows}, figure(found))
    print(report(found, homes * frames))


if __name__ == "__main__":
    try:
        tyro.cli(main)
    except GalocError as error:
        raise SystemExit(f"error: {error}") from None
