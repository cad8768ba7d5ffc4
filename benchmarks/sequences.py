"""Localization along walks: the paper's method, the default and true ranges, under growing odometry noise.

    python benchmarks/sequences.py --out runs/sequences

Scripted walks through generated homes of the test split. All methods see the same images and the same odometry; a walk
is the same under every condition. Prints tables; writes OUT.json and OUT.png. A run that was cut off goes on where it
stopped.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import HEIGHTS_M, chosen, resumable, true_rays, write
from numpy.typing import NDArray
from sequences_report import figure, report, summary

from galoc import Camera, Floorplan, GalocError, Localizer, LocalizerConfig, Wireframe
from galoc.metrics import HOLD, pose_error
from galoc_env.env import FloorplanEnv
from galoc_env.patrol import Patrol

Array = NDArray[np.float64]

METHODS = ("paper", "ml", "oracle")
CONDITIONS = {"exact": (0.0, 0.0), "2%": (0.02, 0.5), "5%": (0.05, 2.0)}
"""Odometry noise: standard deviation of forward and left as a share of the distance, and of the heading, deg/step."""
SENSORS: dict[str, Any] = {
    "width": 640, "height": 480, "hfov_deg": 108.0, "detector_noise_px": 5.0, "imu_noise_deg": 1.0,
}  # fmt: skip

Task = tuple[int, int, int, tuple[str, ...], tuple[str, ...], int]
"""Number of the home, number of the walk in it, frames, methods, conditions, seed."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """What one step of a walk gave."""

    pose: Array
    wireframe: Wireframe
    gravity: Array
    motion: Array
    """True (forward m, left m, turn left rad) since the last frame; zero in the first."""


def walk(env: FloorplanEnv, home: int, seed: int, frames: int) -> Iterator[Frame]:
    """Frames of one scripted walk."""
    observation, info = env.reset(seed=seed, options={"plan_seed": home})
    assert env.world is not None
    walker = Patrol(env.world, np.random.default_rng([seed, 1]))
    for t in range(frames):
        motion = observation["odometry"].astype(float)
        yield Frame(info["pose"], env.snapshot().wireframe, observation["gravity"].astype(float), motion)
        if t < frames - 1:
            observation, _, _, _, info = env.step(walker.action(info["pose"]))


def measured(motion: Array, noise: tuple[float, float], draw: Array) -> Array:
    """Odometry reading: what stands still is measured exactly.

    Args:
        motion: true (3,) motion.
        noise: as in ``CONDITIONS``.
        draw: (3,) standard normal.
    """
    if not motion.any():
        return motion
    along = noise[0] * math.hypot(motion[0], motion[1])
    return motion + draw * np.array([along, along, math.radians(noise[1])])


def make(method: str, plan: Floorplan, camera: Camera, condition: str) -> Localizer:
    """Localizer of a method, told the odometry noise where it can be."""
    if method != "ml":
        return Localizer(plan, camera, geometry="paper", scoring="cosine")
    noise, turn_deg = CONDITIONS[condition]
    if condition == "exact":
        config = LocalizerConfig(imu_sigma_deg=SENSORS["imu_noise_deg"])
    else:
        config = LocalizerConfig(
            imu_sigma_deg=SENSORS["imu_noise_deg"], odometry_noise=noise, odometry_turn_deg=turn_deg
        )
    return Localizer(plan, camera, config=config)


def follow(method: str, localizer: Localizer, frames: list[Frame], readings: list[Array]) -> dict[str, list[float]]:
    """Errors, confidence and time of a method along a walk."""
    rows: dict[str, list[float]] = {k: [] for k in ("error_m", "error_rad", "confidence", "ms")}
    localizer.reset()
    for frame, odometry in zip(frames, readings, strict=True):
        start = time.process_time()
        if method == "oracle":
            rays = true_rays(localizer.plan, localizer.camera, frame.pose)
            start = time.process_time()
            estimate = localizer.fuse(rays, odometry)
        else:
            estimate = localizer.step(frame.wireframe, frame.gravity, odometry)
        rows["ms"].append(1e3 * (time.process_time() - start))
        error_m, error_rad = pose_error(estimate.pose, frame.pose)
        rows["error_m"].append(error_m)
        rows["error_rad"].append(error_rad)
        rows["confidence"].append(min(estimate.confidence, 1.0) if math.isfinite(error_m) else 0.0)
    return rows


def measure(task: Task) -> dict[str, Any]:
    """Every method and condition on one walk."""
    home, number, count, methods, conditions, seed = task
    own = int(np.random.SeedSequence([seed, home, number]).generate_state(1)[0])
    rng = np.random.default_rng([seed, home, number])
    height = float(rng.uniform(*HEIGHTS_M))
    draws = rng.standard_normal((count, 3))
    env = FloorplanEnv(
        plan=None, split="test", localizer="none", renderer="none", detector="oracle", reward="error",
        odometry_noise=0.0, camera_height=height, **SENSORS,
    )  # fmt: skip
    try:
        frames = list(walk(env, home, own, count))
        assert env.world is not None
        plan, camera = env.world.plan, env.camera
    finally:
        env.close()
    found: dict[str, dict[str, Any]] = {}
    for condition in conditions:
        readings = [measured(f.motion, CONDITIONS[condition], d) for f, d in zip(frames, draws, strict=True)]
        found[condition] = {m: follow(m, make(m, plan, camera, condition), frames, readings) for m in methods}
    return {"home": home, "walk": number, "plan": plan.name, "camera_height": height, "conditions": found}


def main(
    plans: int = 20,
    walks: int = 1,
    steps: int = 100,
    methods: tuple[str, ...] = METHODS,
    conditions: tuple[str, ...] = tuple(CONDITIONS),
    jobs: int = 2,
    seed: int = 0,
    out: Path = Path("runs/sequences"),
) -> None:
    """Measure and report.

    Args:
        plans: Generated test homes.
        walks: Walks per home.
        steps: Frames per walk.
        methods: Which to run: paper, ml, oracle.
        conditions: Odometry noise: exact, 2% (0.5 deg per step), 5% (2 deg per step).
        jobs: Processes, one thread each.
        seed: Of walks and noise.
        out: Path without suffix of the JSON and PNG.
    """
    methods = chosen("--methods", methods, METHODS)
    conditions = chosen("--conditions", conditions, tuple(CONDITIONS))
    if plans < 1 or walks < 1 or steps < HOLD:
        got = f"--plans {plans} --walks {walks} --steps {steps}"
        raise GalocError(got, f"at least one walk of at least {HOLD} frames", "Raise them.")
    tasks = [(home, number, steps, methods, conditions, seed) for home in range(plans) for number in range(walks)]
    settings = {
        "plans": plans, "walks": walks, "steps": steps, "methods": methods, "sensors": SENSORS, "seed": seed,
        "conditions": {c: CONDITIONS[c] for c in conditions},
    }  # fmt: skip
    rows = resumable(measure, tasks, job=settings, out=out, jobs=jobs, unit="walk")
    result = {"settings": settings, "summary": summary(rows, methods, conditions), "walks": rows}
    write(out, result, figure(result))
    print(report(result))


if __name__ == "__main__":
    try:
        tyro.cli(main)
    except GalocError as error:
        raise SystemExit(f"error: {error}") from None
