"""Which part of the paper's method loses what, over a sequence: one part is replaced at a time.

    python benchmarks/ablation.py --out docs/figures/ablation

walks the scripted walker through a plan, records what the sensors saw, and localizes the same walks with one part of
the method or one noise source changed. Prints the table; writes OUT.json and OUT.png.
"""

from __future__ import annotations

import json
import math
import multiprocessing
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import tyro
from common import true_rays
from numpy.typing import NDArray
from tqdm import tqdm

from galoc import Camera, Floorplan, Localizer, LocalizerConfig, Rays, Wireframe, solve_layout
from galoc.formats.atomic import write_atomic
from galoc.metrics import pose_error, steps_to_converge
from galoc.rays import cast_rays
from galoc.wireframe import true_corners
from galoc_env.env import FloorplanEnv
from galoc_env.patrol import Patrol

NOISE = {"detector_noise_px": 5.0, "imu_noise_deg": 0.5, "odometry_noise": 0.02}


@dataclass(frozen=True, slots=True)
class Frame:
    """What one step of a walk gave."""

    pose: NDArray[np.float64]
    wireframe: Wireframe
    gravity: NDArray[np.float64]
    odometry: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Variant:
    """One changed part."""

    name: str
    noise: dict[str, float]
    observe: Callable[[Localizer, Frame], Rays]
    config: LocalizerConfig = LocalizerConfig()


def as_published(localizer: Localizer, frame: Frame) -> Rays:
    """The method as it is."""
    return localizer.observe(frame.wireframe, frame.gravity)[1]


def without_inscribed_step(localizer: Localizer, frame: Frame) -> Rays:
    """The bird's-eye view keeps the camera where the gauge solver put it."""
    layout = solve_layout(frame.wireframe, localizer.camera, frame.gravity, "paper", inscribed=False)
    return cast_rays(layout, localizer.camera)


def fixed_gauge(localizer: Localizer, frame: Frame) -> Rays:
    """Theta = 0 instead of the search."""
    return cast_rays(
        solve_layout(frame.wireframe, localizer.camera, frame.gravity, "paper", theta=0.0), localizer.camera
    )


def without_completion(localizer: Localizer, frame: Frame) -> Rays:
    """Only walls whose four corners are all seen."""
    w = frame.wireframe
    whole = true_corners(w) == 4
    assert w.ceiling_cut is not None and w.floor_cut is not None
    w = replace(w, walls=w.walls[whole], ceiling_cut=w.ceiling_cut[whole], floor_cut=w.floor_cut[whole])
    return cast_rays(solve_layout(w, localizer.camera, frame.gravity, "paper"), localizer.camera)


def true_ranges(localizer: Localizer, frame: Frame) -> Rays:
    """The rays that the method knows, with their true ranges: no geometry error left."""
    rays = as_published(localizer, frame)
    everything = true_view(localizer, frame)
    return Rays(np.where(rays.known, everything.range, np.nan), rays.known, rays.variance)


def true_view(localizer: Localizer, frame: Frame) -> Rays:
    """Every ray of the field of view with its true range."""
    return true_rays(localizer.plan, localizer.camera, frame.pose)


VARIANTS = (
    Variant("as published", {}, as_published),
    Variant("junction noise 0", {"detector_noise_px": 0.0}, as_published),
    Variant("junction noise 10 px", {"detector_noise_px": 10.0}, as_published),
    Variant("IMU noise 0", {"imu_noise_deg": 0.0}, as_published),
    Variant("odometry noise 0", {"odometry_noise": 0.0}, as_published),
    Variant("no inscribed-angle step", {}, without_inscribed_step),
    Variant("theta = 0, no gauge search", {}, fixed_gauge),
    Variant("no corner completion", {}, without_completion),
    Variant("true ranges, same sectors", {}, true_ranges),
    Variant("true ranges, whole view", {}, true_view),
    Variant("0.1 m shifts, rest dropped", {}, as_published, LocalizerConfig(motion="paper")),
)


def walk(env: FloorplanEnv, seed: int, steps: int) -> Iterator[Frame]:
    """Frames of one scripted walk; the walk itself does not depend on the noise."""
    observation, info = env.reset(seed=seed)
    assert env.world is not None
    walker = Patrol(env.world, np.random.default_rng([seed, 1]))
    for t in range(steps + 1):
        motion = observation["odometry"].astype(float)
        yield Frame(info["pose"], env.snapshot().wireframe, observation["gravity"].astype(float), motion)
        if t < steps:
            observation, _, _, _, info = env.step(walker.action(info["pose"]))


def run(task: tuple[str, int, int, int]) -> tuple[int, int, list[float]]:
    """Position errors of one walk under one variant."""
    plan, number, seed, steps = task
    variant = VARIANTS[number]
    env = FloorplanEnv(
        plan=plan, localizer="none", renderer="none", detector="oracle", reward="error", **{**NOISE, **variant.noise}
    )
    localizer = _localizer(plan, env.settings.camera(), variant.config)
    localizer.reset()
    errors = []
    for frame in walk(env, seed, steps):
        estimate = localizer.fuse(variant.observe(localizer, frame), frame.odometry)
        errors.append(pose_error(estimate.pose, frame.pose)[0])
    return number, seed, errors


@lru_cache(maxsize=2)
def _localizer(plan: str, camera: Camera, config: LocalizerConfig) -> Localizer:
    """One per process and configuration: profiles take longer than a walk."""
    return Localizer(Floorplan.load(plan), camera, geometry="paper", scoring="cosine", config=config)


def summarize(errors: NDArray[np.float64]) -> dict[str, float]:
    """Numbers of one variant over its walks (W, T)."""
    converged = [steps_to_converge(e) for e in errors]
    by = {f"converged by step {k}": float(np.mean([c is not None and c <= k for c in converged])) for k in (5, 10, 30)}
    found = [c for c in converged if c is not None]
    return {
        **by,
        "median step": float(np.median(found)) if found else math.nan,
        **{f"recall {x:g} m": float(np.mean(errors < x)) for x in (0.1, 0.3, 0.5)},
        "first-frame recall 0.5 m": float(np.mean(errors[:, 0] < 0.5)),
        "median final error m": float(np.median(errors[:, -1])),
    }


def draw(results: dict[str, dict[str, float]], title: str, path: Path) -> None:
    """Bars per variant: share of frames within 0.1 and 0.5 m, and of walks converged by step 5."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.5, 5.6), layout="constrained")
    axes = figure.subplots()
    names = list(results)[::-1]
    columns = (("recall 0.1 m", "#c8553d"), ("recall 0.5 m", "#e9a23b"), ("converged by step 5", "#3d6fb4"))
    for k, (column, colour) in enumerate(columns):
        values = [100 * results[n][column] for n in names]
        bars = axes.barh(np.arange(len(names)) + 0.27 * (1 - k), values, 0.25, color=colour, label=column)
        axes.bar_label(bars, fmt="%.0f", fontsize=7, padding=2)
        axes.axvline(100 * results["as published"][column], color=colour, lw=0.8, ls=":")
    axes.set_yticks(np.arange(len(names)), names)
    axes.set_xlim(0, 106)
    axes.set_xlabel("% of frames (recall) or walks (converged: within 0.5 m from there to the end)")
    axes.set_title(title, fontsize=10)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


def main(
    plan: str = "apartment", walks: int = 12, steps: int = 40, jobs: int = 2, out: Path = Path("runs/ablation")
) -> None:
    """Run every variant on the same walks.

    Args:
        plan: Plan file or name of a shipped plan.
        walks: Seeds 0 to walks - 1.
        steps: Actions per walk.
        jobs: Processes.
        out: Path without suffix of the JSON and PNG.
    """
    tasks = [(plan, number, seed, steps) for number in range(len(VARIANTS)) for seed in range(walks)]
    errors = np.full((len(VARIANTS), walks, steps + 1), np.nan)
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        for number, seed, walked in tqdm(pool.imap_unordered(run, tasks), total=len(tasks), unit="walk"):
            errors[number, seed] = walked
    results = {v.name: summarize(e) for v, e in zip(VARIANTS, errors, strict=True)}
    columns = list(results["as published"])
    print("  ".join([f"{'variant':28s}", *columns]))
    for name, row in results.items():
        cells = [f"{row[c]:{len(c)}.2f}" for c in columns]
        print("  ".join([f"{name:28s}", *cells]))
    settings = {"plan": plan, "walks": walks, "steps": steps, **NOISE}
    out.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(
        out.with_suffix(".json"), (json.dumps({"settings": settings, "results": results}, indent=1) + "\n").encode()
    )
    title = f"{plan}: {walks} walks of {steps} steps; noise 5 px, IMU 0.5 deg, odometry 2 % unless changed"
    draw(results, title, out.with_suffix(".png"))


if __name__ == "__main__":
    tyro.cli(main)
