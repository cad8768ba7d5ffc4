"""Localization from pixels: single photographs and walks, the learned front end against the oracle.

    python benchmarks/pixels.py --out runs/pixels
    python benchmarks/pixels.py --mode walks --out runs/pixels_walks
    python benchmarks/pixels.py --mode walks --real ../shared/data/plans --out runs/pixels_real

Furnished test homes (or real plans, furnished by us), photographed with every fault of lens and sensor. All methods see
the same views, the same gravity and the same odometry (noise 2 % and 0.5 degrees a step). Prints tables; writes
OUT.json and OUT.png. A run that was cut off goes on where it stopped.
"""

from __future__ import annotations

import math
import sys
import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # photographs use training/, which is not installed

import numpy as np
import tyro
from common import HEIGHTS_M, chosen, resumable, write
from numpy.typing import NDArray
from photos import IMU_DEG, Condition, furnished_plan, photographs
from pixels_report import figure, report, summary
from sequences import measured
from single_image import REAL

from galoc import Camera, Floorplan, GalocError, Localizer, LocalizerConfig, Wireframe
from galoc.detect.oracle import perturb
from galoc.metrics import pose_error
from galoc_env.env import FloorplanEnv
from galoc_env.imaging import Imaging
from galoc_env.patrol import Patrol

Array = NDArray[np.float64]

METHODS = ("onnx", "onnx+heights", "lines", "oracle5", "paper7")
"""Learned; the same told both heights to 3 %; without weights; true junctions plus 5 px; the paper's method on true
junctions plus 7 px."""
ODOMETRY = (0.02, 0.5)
"""Noise as a share of the distance, and degrees per step."""
MODES = ("single", "walks")
TILT_DEG = 3.0
"""True sway of the camera along walks."""

Task = tuple[str, int | str, int, int, tuple[str, ...], int]
"""Mode, home or plan file, its number, frames, methods, seed."""


def make(method: str, plan: Floorplan, camera: Camera, heights: tuple[float, float]) -> Localizer:
    """Localizer of a method."""
    if method.startswith("paper"):
        return Localizer(plan, camera, geometry="paper", scoring="cosine")
    told = heights if method.endswith("+heights") else None
    config = LocalizerConfig(
        imu_sigma_deg=IMU_DEG, odometry_noise=ODOMETRY[0], odometry_turn_deg=ODOMETRY[1], heights=told
    )
    detector = "lines" if method == "lines" else "onnx"
    return Localizer(plan, camera, detector=detector, config=config)


def seen_by(method: str, image: NDArray[np.uint8], truth: Wireframe, camera: Camera, seed: list[int]) -> Any:
    """What a method is given of a view: the image, or true junctions with noise."""
    if not method.startswith(("oracle", "paper")):
        return image
    sigma = float(method.removeprefix("oracle").removeprefix("paper")) * camera.width / 640.0
    return perturb(truth, camera, sigma, np.random.default_rng([*seed, int(sigma * 100)]))


def single(source: int | str, number: int, count: int, methods: tuple[str, ...], seed: int) -> dict[str, Any]:
    """Every method on photographs of one home, each by itself."""
    rows = _empty(methods)
    condition = Condition(tilt_deg=TILT_DEG)
    scene = furnished_plan(source, condition)
    for i, photo in enumerate(photographs(scene, condition, count, [seed, number])):
        heights = (photo.view.height_m, photo.ceiling_m)
        for method in methods:
            localizer = make(method, scene.plan, photo.camera, heights)
            given = seen_by(method, photo.image, photo.truth, photo.camera, [seed, number, i])
            start = time.process_time()
            estimate = localizer.locate(given, photo.view.measured)
            _note(rows[method], estimate, photo.view.pose, time.process_time() - start)
    return {"plan": scene.plan.name, "number": number, "methods": rows}


def walks(source: int | str, number: int, count: int, methods: tuple[str, ...], seed: int) -> dict[str, Any]:
    """Every method along one walk."""
    own = int(np.random.SeedSequence([seed, number]).generate_state(1)[0])
    rng = np.random.default_rng([seed, number])
    height = float(rng.uniform(*HEIGHTS_M))
    draws = rng.standard_normal((count, 3))
    env = FloorplanEnv(
        plan=None if isinstance(source, int) else source, split="test", localizer="none", detector="oracle",
        detector_noise_px=0.0, reward="error", odometry_noise=0.0, camera_height=height, width=640, height=480,
        hfov_deg=108.0, imu_noise_deg=IMU_DEG, tilt_deg=TILT_DEG, furniture=0.5,
        imaging=Imaging.random(rng, 1.0).knobs(),
    )  # fmt: skip
    rows = _empty(methods)
    try:
        options = {"plan_seed": source} if isinstance(source, int) else {}
        observation, info = env.reset(seed=own, options=options)
        assert env.world is not None
        walker = Patrol(env.world, np.random.default_rng([own, 1]))
        plan = env.world.plan
        localizers = {m: make(m, plan, env.camera, (height, plan.ceiling_height)) for m in methods}
        for t in range(count):
            odometry = measured(observation["odometry"].astype(float), ODOMETRY, draws[t])
            gravity, truth = observation["gravity"].astype(float), env.snapshot().wireframe
            for method, localizer in localizers.items():
                given = seen_by(method, observation["image"], truth, env.camera, [own, t])
                start = time.process_time()
                estimate = localizer.step(given, gravity, odometry)
                _note(rows[method], estimate, info["pose"], time.process_time() - start)
            if t < count - 1:
                observation, _, _, _, info = env.step(walker.action(info["pose"]))
    finally:
        env.close()
    return {"plan": plan.name, "number": number, "camera_height": height, "methods": rows}


def _empty(methods: tuple[str, ...]) -> dict[str, dict[str, list[float]]]:
    return {m: {k: [] for k in ("error_m", "error_rad", "confidence", "coverage", "ms")} for m in methods}


def _note(row: dict[str, list[float]], estimate: Any, pose: Array, seconds: float) -> None:
    error_m, error_rad = pose_error(estimate.pose, pose)
    row["error_m"].append(error_m)
    row["error_rad"].append(error_rad)
    row["confidence"].append(min(estimate.confidence, 1.0) if math.isfinite(error_m) else 0.0)
    row["coverage"].append(0.0 if estimate.rays is None else estimate.rays.coverage)
    row["ms"].append(1e3 * seconds)


def measure(task: Task) -> dict[str, Any]:
    """Dispatch."""
    mode, source, number, count, methods, seed = task
    return (single if mode == "single" else walks)(source, number, count, methods, seed)


def main(
    mode: str = "single",
    plans: int = 40,
    frames: int = 0,
    methods: tuple[str, ...] = METHODS,
    real: Path | None = None,
    plan: str | None = None,
    jobs: int = 2,
    seed: int = 0,
    out: Path = Path("runs/pixels"),
) -> None:
    """Measure and report.

    Args:
        mode: single (each photograph by itself) or walks.
        plans: Generated test homes; with --real at most so many plans.
        frames: Per home: photographs, or steps of its walk; 0: 6, or 100.
        methods: Which to run.
        real: Folder of real plans.
        plan: One plan (a shipped one's name, or a file) instead; --plans is how many times.
        jobs: Processes, one thread each.
        seed: Of poses, walks and noise.
        out: Path without suffix of the JSON and PNG.
    """
    if mode not in MODES:
        raise GalocError(f"--mode {mode}", " or ".join(MODES), "Fix --mode.")
    methods = chosen("--methods", methods, METHODS)
    if plans < 1 or frames < 0:
        raise GalocError(f"--plans {plans} --frames {frames}", "1 or more", "Raise them.")
    count = frames or (6 if mode == "single" else 100)
    sources: list[int | str] = list(range(plans))
    if plan is not None:
        sources = [plan] * plans
    elif real is not None:
        sources = [str(real / name) for name in REAL if (real / name).exists()][:plans]
        if not sources:
            raise GalocError(f"--real {real}", "a folder with the plans of single_image.py", "Fix the path.")
    tasks = [(mode, source, number, count, methods, seed) for number, source in enumerate(sources)]
    settings = {
        "mode": mode, "plans": plans, "frames": count, "methods": methods, "real": real is not None,
        "plan": plan, "seed": seed,
        "condition": asdict(replace(Condition(), tilt_deg=TILT_DEG)), "odometry": ODOMETRY, "imu_deg": IMU_DEG,
    }  # fmt: skip
    rows = resumable(measure, tasks, job=settings, out=out, jobs=jobs, unit="home")
    result = {"settings": settings, "summary": summary(rows, methods, mode), "homes": rows}
    write(out, result, figure(result))
    print(report(result))


if __name__ == "__main__":
    try:
        tyro.cli(main)
    except GalocError as error:
        raise SystemExit(f"error: {error}") from None
