"""What matching and filtering cost per step, and whether the walk ends in the right place.

    OMP_NUM_THREADS=1 python benchmarks/filter.py --out runs/filter

Seeded walks of the scripted walker at 0.1 m; layouts are solved beforehand and the same for all methods. CPU time of
one thread (idle BLAS threads would count); each step is taken by every method in turn, so that the ratios are of one
moment. Then the same on larger plans. Prints tables; writes OUT.json and OUT.png.
"""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numba
import numpy as np
import tyro
from ablation import walk
from common import write
from filter_methods import NOISE, Method, Step, config, methods
from tqdm import tqdm

from galoc import Floorplan, GalocError, Localizer
from galoc.metrics import pose_error
from galoc.observation import observation
from galoc_env.env import FloorplanEnv
from galoc_env.film import writable_folder

HEIGHT_M = 1.4
"""Camera above the floor, m."""
WITHIN_M = 0.5
"""A walk is a success if it ends this close, m."""
REAL = ("amrl_maps/NSH1.json", "amrl_maps/GHC4.json")
"""Plans below the folder of --real."""
PARTS = {"matching": "#3d6fb4", "filter": "#c8553d", "rest": "#b0b0b0"}


def steps_of(plan: str, seed: int, count: int) -> tuple[Floorplan, Any, list[Step]]:
    """Plan, camera and the steps of one walk."""
    env = FloorplanEnv(
        plan=plan, localizer="none", renderer="none", detector="oracle", reward="error", camera_height=HEIGHT_M,
        width=640, height=480, hfov_deg=108.0, **NOISE,
    )  # fmt: skip
    try:
        frames = list(walk(env, seed, count - 1))
        assert env.world is not None
        here, camera = env.world.plan, env.camera
    finally:
        env.close()
    localizer = Localizer(here, camera, config=config(here, HEIGHT_M))
    out = []
    for f in frames:
        layout, rays = localizer.observe(f.wireframe, f.gravity)
        out.append(Step(f.pose, f.odometry, f.wireframe, f.gravity, rays, observation(layout, rays)))
    return here, camera, out


def follow(made: dict[str, Callable[[], Method]], steps: list[Step]) -> dict[str, dict[str, Any]]:
    """Milliseconds of each part per step, and the error at the end, of every method along one walk."""
    running = {name: make() for name, make in made.items()}
    rows: dict[str, dict[str, Any]] = {name: {part: [] for part in PARTS} for name in made}
    for step in steps:
        for name, method in running.items():
            ms, pose = method.timed(step)
            for part in PARTS:
                rows[name][part].append(ms[part])
            rows[name]["error_m"] = pose_error(pose, step.pose)[0]
    return rows


def summary(walks: list[dict[str, dict[str, Any]]]) -> dict[str, dict[str, Any]]:
    """Per method over all steps and walks; ratios are medians of step-by-step quotients with the plain method."""
    out: dict[str, dict[str, Any]] = {}
    plain = None
    for name in walks[0]:
        parts = {part: np.concatenate([w[name][part] for w in walks]) for part in PARTS}
        total = np.sum(list(parts.values()), axis=0)
        plain = total if plain is None else plain
        errors = np.array([w[name]["error_m"] for w in walks])
        out[name] = {
            "ms": {"median": float(np.median(total)), "mean": float(total.mean())},
            "parts_ms": {part: [float(np.median(ms)), float(ms.mean())] for part, ms in parts.items()},
            "ratio": float(np.median(plain / np.maximum(total, 1e-6))),
            "success": float(np.mean(errors < WITHIN_M)),
            "median_error_m": float(np.median(errors)),
        }
    return out


def measure(plan: str, walks: int, steps: int, particles: int, seed: int) -> dict[str, Any]:
    """All methods on one plan."""
    rows = []
    for number in tqdm(range(walks), unit="walk", desc=Path(plan).stem):
        here, camera, taken = steps_of(plan, seed + number, steps)
        if number == 0:
            made = methods(here, camera, HEIGHT_M, particles)
            follow(made, taken)  # compiles, down to what only happens now and then
        rows.append(follow(made, taken))
    field = Localizer(here, camera, config=config(here, HEIGHT_M)).field
    area = len(field.positions) * field.resolution**2
    size = {"area_m2": area, "positions": len(field.positions), "resolution_m": field.resolution}
    return {"plan": Path(plan).stem, **size, "methods": summary(rows)}


def report(result: dict[str, Any]) -> str:
    """Tables for the terminal."""
    first = result["plans"][0]
    head = f"{'':24s}{'CPU ms/step: median':>20s}{'mean':>8s}{'matching':>10s}{'filter':>8s}{'plain / this':>14s}"
    lines = [f"{first['plan']}, {first['positions']} positions", f"{head}{'within 0.5 m':>14s}{'error m':>9s}"]
    for name, m in first["methods"].items():
        parts = [f"{m['parts_ms'][p][0]:.2f}" if m["parts_ms"]["rest"][0] == 0 else "-" for p in ("matching", "filter")]
        lines.append(
            f"{name:24s}{m['ms']['median']:20.2f}{m['ms']['mean']:8.2f}{parts[0]:>10s}{parts[1]:>8s}"
            f"{m['ratio']:14.1f}{100 * m['success']:12.0f} %{m['median_error_m']:9.2f}"
        )
    lines += ["", f"{'median CPU ms/step':24s}" + "".join(f"{p['plan'][:12]:>14s}" for p in result["plans"])]
    lines.append(f"{'area, m2':24s}" + "".join(f"{p['area_m2']:14.0f}" for p in result["plans"]))
    lines.append(f"{'grid, m':24s}" + "".join(f"{p['resolution_m']:14.3f}" for p in result["plans"]))
    for name in first["methods"]:
        lines.append(f"{name:24s}" + "".join(f"{p['methods'][name]['ms']['median']:14.2f}" for p in result["plans"]))
    return "\n".join(lines)


def figure(result: dict[str, Any]) -> bytes:
    """Bars of the parts on the first plan; cost against area."""
    from matplotlib.figure import Figure

    picture = Figure(figsize=(12.5, 4.6), layout="constrained")
    left, right = picture.subplots(1, 2, width_ratios=(1.15, 1.0))
    first = result["plans"][0]["methods"]
    names = list(first)[::-1]
    start = np.zeros(len(names))
    for part, colour in PARTS.items():
        # Means add up; the medians are written beside.
        width = np.array([first[n]["parts_ms"][part][1] for n in names])
        label = {"rest": "with layout and tracker"}.get(part, part)
        left.barh(names, width, 0.62, left=start, color=colour, label=label)
        start += width
    for y, name in enumerate(names):
        m = first[name]
        text = f" {m['ms']['median']:.1f} ms, {m['ratio']:.0f}x, {100 * m['success']:.0f} %"
        left.text(start[y], y, text, va="center", fontsize=8)
    left.set(xlabel="mean CPU ms per step", xlim=(0, 1.45 * start.max()))
    title = f"{result['plans'][0]['plan']}, 0.1 m: median, times faster than plain, walks within {WITHIN_M:g} m"
    left.set_title(title, fontsize=9)
    picture.legend(*left.get_legend_handles_labels(), fontsize=8, loc="outside lower left", ncols=3)
    order = np.argsort([p["area_m2"] for p in result["plans"]])
    plans = [result["plans"][i] for i in order]
    for k, name in enumerate(first):
        ms = [p["methods"][name]["ms"]["median"] for p in plans]
        right.plot([p["area_m2"] for p in plans], ms, "o-", ms=4, lw=1.4, color=f"C{k}", label=name)
    for p in plans:
        right.text(p["area_m2"], 1.0, f" {p['plan']}", transform=right.get_xaxis_transform(), rotation=50, fontsize=7)
    right.set(xscale="log", yscale="log", xlabel="free area, m2", ylabel="median CPU ms per step")
    right.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    buffer = BytesIO()
    picture.savefig(buffer, format="png", dpi=120)
    return buffer.getvalue()


def main(
    plans: tuple[str, ...] = ("apartment", "house", "corridor", "office"),
    walks: int = 10,
    steps: int = 40,
    area_steps: int = 20,
    particles: int = 5000,
    real: Path | None = None,
    seed: int = 0,
    out: Path = Path("runs/filter"),
) -> None:
    """Measure and report.

    Args:
        plans: Plan files or names of shipped plans; the first is walked in full, the others once.
        walks: Walks on the first plan.
        steps: Frames per walk.
        area_steps: Frames of the one walk on each other plan.
        particles: Of the particle filter.
        real: Folder of the published plans; adds two large ones.
        seed: Of walks and noise.
        out: Path without suffix of the JSON and PNG.
    """
    if walks < 1 or steps < 2 or area_steps < 2 or not plans:
        got = f"--walks {walks} --steps {steps} --area-steps {area_steps}, {len(plans)} plans"
        raise GalocError(got, "a plan, a walk and two steps at least", "Raise them.")
    writable_folder(out.parent)
    numba.set_num_threads(1)
    others = [*plans[1:], *(str(real / name) for name in REAL)] if real is not None else list(plans[1:])
    found = [measure(plans[0], walks, steps, particles, seed)]
    found += [measure(plan, 1, area_steps, particles, seed) for plan in others]
    settings = {"walks": walks, "steps": steps, "area_steps": area_steps, "particles": particles, "seed": seed}
    result = {"settings": {**settings, **NOISE}, "plans": found}
    write(out, result, figure(result))
    print(report(result))


if __name__ == "__main__":
    try:
        tyro.cli(main)
    except GalocError as error:
        raise SystemExit(f"error: {error}") from None
