"""What the benchmarks share: views of plans, true rays, resumable work on several processes, output files."""

from __future__ import annotations

import json
import math
import multiprocessing
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc import Camera, Floorplan, GalocError, Rays, Wireframe
from galoc.detect.oracle import perturb
from galoc.formats.atomic import write_atomic
from galoc.rays import ray_count
from galoc.types import CORNER
from galoc_env.film import writable_folder
from galoc_env.partial import Partial, jsonable
from galoc_env.truth import visible_wireframe
from galoc_env.truth_kernel import nearest_hit

Array = NDArray[np.float64]

CLEARANCE_M = 0.3
"""Cameras keep this distance to every wall, m."""
HEIGHTS_M = (1.0, 1.7)
"""Range of the camera's height above the floor, m."""
COLOURS = {
    "paper": "#c8553d", "ml": "#3d6fb4", "ml+ceiling": "#5a9e6f", "ml+heights": "#8f6bb3", "oracle": "#7f7f7f",
}  # fmt: skip


WIDTHS = {"oracle": 3.4, "paper": 2.2}
"""Lines that may coincide are drawn the wide ones first; 1.3 for the rest."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One image as the sensors give it, and the truth."""

    pose: Array
    """(3,) x, y, heading."""
    height: float
    """Camera above the floor, m."""
    wireframe: Wireframe
    """Noisy junctions."""
    gravity: Array
    """(2,) measured roll and pitch, rad (true: 0)."""
    corner_pairs: int
    """Corner pairs whose ceiling and floor junction are both in the image."""


def views(
    plan: Floorplan, camera: Camera, count: int, sigma_px: float, imu_deg: float, seed: Sequence[int]
) -> list[View]:
    """Views from uniformly drawn poses; poses and heights depend on the plan and seed alone, not on camera or noise.

    Args:
        plan: the map.
        camera: intrinsics.
        count: views.
        sigma_px: junction noise, px.
        imu_deg: noise of roll and pitch, degrees.
        seed: of poses and noise.
    """
    free = plan.free_space(0.05)
    cells = free.positions(CLEARANCE_M)
    if len(cells) == 0:
        raise GalocError(f"plan {plan.name!r} without a place {CLEARANCE_M} m from walls", "rooms", "Leave it out.")
    places, noise = np.random.default_rng([*seed, 0]), np.random.default_rng([*seed, 1])
    out: list[View] = []
    while len(out) < count:
        xy = cells[places.integers(len(cells))] + free.resolution * places.uniform(-0.5, 0.5, 2)
        pose = np.array([*xy, places.uniform(-math.pi, math.pi)])
        height = float(places.uniform(HEIGHTS_M[0], min(HEIGHTS_M[1], 0.9 * plan.ceiling_height)))
        true = visible_wireframe(plan, camera, pose, height)
        seen = perturb(true, camera, sigma_px, noise)
        gravity = np.radians(imu_deg) * noise.standard_normal(2)
        whole = (np.asarray(true.kind) == CORNER) & true.ceiling_true & true.floor_true
        out.append(View(pose, height, seen, gravity, int(whole.sum())))
    return out


def true_rays(plan: Floorplan, camera: Camera, pose: Array) -> Rays:
    """Every ray of the field of view with its true range."""
    x, y, heading = pose
    n = ray_count(camera.hfov_deg)
    bearings = heading + np.radians(np.arange(n) - (n - 1) / 2)
    hits = np.array([nearest_hit(plan.segments, x, y, math.cos(b), math.sin(b))[0] for b in bearings])
    known = np.isfinite(hits)
    return Rays(np.where(known, hits, np.nan), known, np.full(n, np.nan))


def resumable(
    function: Callable[[Any], dict[str, Any]],
    tasks: Sequence[Any],
    *,
    job: dict[str, Any],
    out: Path,
    jobs: int,
    unit: str,
) -> list[dict[str, Any]]:
    """Results of the tasks in order; finished ones are kept beside the output until it is written.

    Args:
        function: of this module's caller, top level; result must be JSON data.
        tasks: arguments, one each.
        job: what the results belong to: those of another job are not taken up.
        out: output path without suffix.
        jobs: processes with one thread each; 1 runs here.
        unit: of the progress bar.
    """
    from tqdm import tqdm

    if jobs < 1:
        raise GalocError(f"--jobs {jobs}", "1 or more", "Use the number of free cores.")
    writable_folder(out.parent)
    partial = _partial(out, job)
    done = partial.load()
    open_tasks = [(i, function, task) for i, task in enumerate(tasks) if i not in done]
    with tqdm(total=len(tasks), initial=len(done), unit=unit) as bar:

        def keep(row: dict[str, Any]) -> None:
            partial.add(row)
            done[row["seed"]] = jsonable(row)
            bar.update()

        if jobs == 1:
            import numba

            numba.set_num_threads(1)
            for task in open_tasks:
                keep(_call(task))
        elif open_tasks:
            os.environ["NUMBA_NUM_THREADS"] = "1"  # read by the workers when they import numba
            with multiprocessing.get_context("spawn").Pool(min(jobs, len(open_tasks))) as pool:
                for row in pool.imap_unordered(_call, open_tasks):
                    keep(row)
    return [done[i] for i in range(len(tasks))]


def _call(task: tuple[int, Callable[[Any], dict[str, Any]], Any]) -> dict[str, Any]:
    number, function, argument = task
    return {"seed": number, **function(argument)}


def _partial(out: Path, job: dict[str, Any]) -> Partial:
    return Partial(out.parent / f"{out.name}.partial.jsonl", job)


def write(out: Path, result: dict[str, Any], png: bytes) -> None:
    """OUT.json and OUT.png; what was kept for resuming goes."""
    write_atomic(Path(f"{out}.json"), (json.dumps(jsonable(result)) + "\n").encode())
    write_atomic(Path(f"{out}.png"), png)
    _partial(out, {}).remove()


def column(rows: Sequence[dict[str, Any]], *keys: str, missing: float = math.nan) -> Array:
    """(F,) values of a list below these keys, joined over rows; ``missing`` where JSON had none (NaN, infinity)."""
    parts = []
    for row in rows:
        value: Any = row
        for key in keys:
            value = value[key]
        parts.append(np.array(value, dtype=np.float64))
    joined = np.concatenate(parts) if parts else np.zeros(0)
    return np.where(np.isnan(joined), missing, joined)


def chosen(flag: str, names: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    """The names in the order of ``known``; GalocError if one is not among them."""
    unknown = [n for n in names if n not in known]
    if unknown or not names:
        raise GalocError(f"{flag} {' '.join(unknown)}".strip(), f"some of {', '.join(known)}", f"Fix {flag}.")
    return tuple(n for n in known if n in names)


def cell(value: Sequence[float | None], scale: float = 100.0, digits: int = 1) -> str:
    """A value with its interval, for tables."""
    v, low, high = (math.nan if x is None else scale * x for x in value)
    return "-" if math.isnan(v) else f"{v:.{digits}f} ({low:.{digits}f}-{high:.{digits}f})"


def line_of(method: str) -> dict[str, Any]:
    """Colour, width and order of a method's line."""
    width = WIDTHS.get(method, 1.3)
    return {"color": COLOURS[method], "lw": width, "zorder": 5.0 - width}


def draw_reliability(axes: Any, found: dict[str, dict[str, Any]], within_m: float) -> None:
    """Reliability diagram of methods with "reliability" and "ece"."""
    axes.plot([0, 1], [0, 1], color="0.7", lw=1, ls="--", zorder=0)
    for method, f in found.items():
        count, stated, right = np.array(f["reliability"], dtype=float)
        full = count > 0
        area = 8.0 + 250.0 * count[full] / count.sum()
        axes.scatter(stated[full], right[full], area, color=COLOURS[method], alpha=0.7, lw=0)
    axes.set(xlim=(-0.03, 1.03), ylim=(-0.03, 1.03), xlabel="stated confidence (dot area: share of frames)")
    axes.set_ylabel(f"share within {within_m:g} m")
    errors = [f"{m} {f['ece']:.2f}" for m, f in found.items()]
    axes.set_title("calibration error: " + ", ".join(errors[:2]) + "\n" + ", ".join(errors[2:]), fontsize=9)
