"""The demo: one walk, filmed, drawn and measured."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc import Floorplan
from galoc.formats.atomic import write_atomic
from galoc.metrics import HOLD
from galoc_env import detection
from galoc_env.env import FloorplanEnv
from galoc_env.film import Film, temporary, writable_folder
from galoc_env.partial import jsonable
from galoc_env.play import Rollout, rollout, steps_table
from galoc_env.policy import make_policy

Image = NDArray[np.uint8]

FRAMES_SHOWN = 6
"""Pictures of the film that the summary shows."""
_GREEN, _ORANGE, _BLUE, _GREY = "#16963f", "#e8541c", "#3a2caa", "#788090"


@dataclass(frozen=True, slots=True)
class DemoFiles:
    """What a demo leaves behind."""

    film: Path
    summary: Path
    result: Path
    walk: Rollout


def run_demo(
    arguments: dict[str, Any],
    *,
    steps: int,
    seed: int,
    out: Path,
    policy: str = "patrol",
    on_progress: Callable[[], None] | None = None,
) -> DemoFiles:
    """Walk, film and measure; every file appears whole or not at all.

    Args:
        arguments: of :class:`FloorplanEnv`, without ``render_mode``.
        steps: actions.
        seed: of the environment and the walker.
        policy: who walks, see :func:`galoc_env.policy.make_policy`.
        out: folder, made if needed.
        on_progress: called once per observation.

    Raises:
        GalocError: bad arguments, or a folder that cannot be written.
    """
    walker = make_policy(policy)
    env = FloorplanEnv(**arguments, render_mode="rgb_array")  # refuses bad arguments before anything is written
    model = detection.model(env.settings.detector)
    folder = writable_folder(out)
    files = [folder / name for name in ("episode.mp4", "summary.png", "result.json")]
    views: list[Image] = []
    kept = {round(i) for i in np.linspace(0, steps, FRAMES_SHOWN)}
    try:
        with Film(files[0], fps=int(env.metadata["render_fps"])) as film:

            def on_step(env: FloorplanEnv) -> None:
                picture = env.render()
                assert picture is not None
                film.add(picture)
                if env.snapshot().step in kept:
                    views.append(picture)
                if on_progress is not None:
                    on_progress()

            walk = rollout(env, seed, steps, policy=walker, name=policy, on_step=on_step)
        assert env.world is not None
        plan, furniture = env.world.plan, env.world.furniture
        save_summary(files[1], plan, furniture, walk, views, sorted(kept))
    finally:
        env.close()
    chosen = {
        **arguments,
        "detector": env.settings.detector,
        "model": model,
        "policy": policy,
        "steps": steps,
        "seed": seed,
    }
    result = {"settings": chosen, **walk.metrics(), "steps": steps_table(walk)}
    write_atomic(files[2], (json.dumps(jsonable(result), indent=1) + "\n").encode())
    return DemoFiles(files[0], files[1], files[2], walk)


def report(files: DemoFiles) -> str:
    """What came out, for people: three to six lines."""
    metrics = files.walk.metrics()
    last = files.walk.steps[-1]
    final = "no estimate"
    if math.isfinite(last.error_m):
        final = f"{last.error_m:.2f} m, {math.degrees(last.error_rad):.1f} deg"
    shares = ", ".join(f"{100 * metrics['recall'][k]:.0f} % < {k.replace('m', ' m')}" for k in ("0.1m", "0.5m", "1m"))
    return "\n".join(
        [
            f"{files.walk.plan or 'plan'}, seed {files.walk.seed}: {_verdict(files.walk)}",
            f"  final error {final}; of {len(files.walk.steps)} observations {shares}",
            f"  film     {files.film}",
            f"  summary  {files.summary}",
            f"  numbers  {files.result}",
        ]
    )


def _verdict(walk: Rollout) -> str:
    """Whether it converged, in words."""
    step = walk.metrics()["steps_to_converge"]
    if step is not None:
        return f"converged at step {step} (within 0.5 m, held to the end)"
    if len(walk.steps) < HOLD:
        return f"too short to say whether it converged (that takes {HOLD} observations)"
    return "did not converge (never within 0.5 m for good)"


def save_summary(
    path: Path, plan: Floorplan, furniture: NDArray, walk: Rollout, pictures: list[Image], shown: list[int]
) -> None:
    """One page: where it walked and where it was believed to be, errors, belief over time, pictures of the film."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14.0, 11.0), dpi=110, layout="constrained")
    halves = figure.add_gridspec(2, 1, height_ratios=[1.0, 1.0])
    upper = figure.add_subfigure(halves[0])
    lower = figure.add_subfigure(halves[1])
    charts = upper.add_gridspec(2, 2, width_ratios=[1.9, 1.0])
    _draw_paths(upper.add_subplot(charts[:, 0]), plan, furniture, walk)
    _draw_errors(upper.add_subplot(charts[0, 1]), walk)
    _draw_belief(upper.add_subplot(charts[1, 1]), walk)
    views = lower.add_gridspec(2, 3)
    for i, (picture, step) in enumerate(zip(pictures, shown, strict=False)):
        axes = lower.add_subplot(views[i // 3, i % 3])
        axes.imshow(picture)
        axes.set_title(f"step {step}", fontsize=10, loc="left")
        axes.axis("off")
    title = f"{walk.plan or 'plan'}, seed {walk.seed}: {_verdict(walk)}"
    upper.suptitle(title, fontsize=15, fontweight="bold", x=0.01, ha="left")
    part = temporary(path)
    try:
        figure.savefig(part)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def _draw_paths(axes: Any, plan: Floorplan, furniture: NDArray, walk: Rollout) -> None:
    from matplotlib.collections import LineCollection

    axes.add_collection(LineCollection(list(furniture.reshape(-1, 2, 2)), colors="#d6d0c6", linewidths=1.2))
    axes.add_collection(LineCollection(list(plan.segments.reshape(-1, 2, 2)), colors="#2c323c", linewidths=1.6))
    truth = np.array([s.pose for s in walk.steps])
    found = [i for i, s in enumerate(walk.steps) if s.estimate is not None]
    axes.plot(truth[:, 0], truth[:, 1], "-", color=_GREEN, linewidth=2.2, label="true path")
    axes.plot(*truth[0, :2], "o", color=_GREEN, markersize=9, markerfacecolor="white", label="start")
    axes.plot(*truth[-1, :2], "o", color=_GREEN, markersize=9, label="end")
    if found:
        guess = np.array([walk.steps[i].estimate for i in found])
        pairs = np.stack([truth[found, :2], guess[:, :2]], axis=1)
        axes.add_collection(LineCollection(list(pairs), colors=_ORANGE, linewidths=0.6, alpha=0.45))
        axes.scatter(guess[:, 0], guess[:, 1], s=16, color=_ORANGE, zorder=3, label="estimates, tied to the truth")
    x0, y0, x1, y1 = plan.bounds
    axes.set(xlim=(x0 - 0.5, x1 + 0.5), ylim=(y0 - 0.5, y1 + 0.5), aspect="equal", ylabel="m")
    axes.set_title("where the camera walked, and where it was believed to be", fontsize=11, loc="left")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncols=4, fontsize=9, frameon=False)


def _draw_errors(axes: Any, walk: Rollout) -> None:
    errors = np.array(walk.errors_m)
    shown = np.where(np.isfinite(errors), np.maximum(errors, 0.01), np.nan)
    axes.semilogy(shown, color=_ORANGE, linewidth=2)
    for threshold in (0.1, 0.5, 1.0):
        style = "-" if threshold == 0.5 else ":"
        axes.axhline(threshold, color=_GREEN, linestyle=style, linewidth=1)
        axes.text(len(errors) - 0.5, threshold, f" {threshold:g} m", color=_GREEN, fontsize=8, va="center")
    converged = walk.metrics()["steps_to_converge"]
    if converged is not None:
        axes.axvspan(converged, len(errors) - 1, color=_GREEN, alpha=0.1, linewidth=0)
    axes.set(xlim=(0, max(1, len(errors) - 1)), ylim=(0.01, 30.0), ylabel="m")
    axes.set_yticks([0.01, 0.1, 1.0, 10.0], ["0.01", "0.1", "1", "10"])
    axes.locator_params(axis="x", integer=True)
    axes.set_title("position error over the steps (shaded: converged)", fontsize=11, loc="left")
    axes.grid(alpha=0.25)


def _draw_belief(axes: Any, walk: Rollout) -> None:
    axes.plot([s.entropy for s in walk.steps], color=_BLUE, linewidth=2)
    axes.set(xlim=(0, max(1, len(walk.steps) - 1)), xlabel="step")
    axes.set_ylabel("belief entropy / nats", color=_BLUE)
    axes.set_ylim(bottom=0.0)
    axes.locator_params(axis="x", integer=True)
    other = axes.twinx()
    other.fill_between(
        range(len(walk.steps)), [100.0 * s.coverage for s in walk.steps], color=_GREY, alpha=0.25, step="mid"
    )
    other.set(ylim=(0, 100))
    other.set_ylabel("walls recovered / % of view", color=_GREY)
    axes.set_title("uncertainty left (line), walls recovered per view (area)", fontsize=11, loc="left")
    axes.grid(alpha=0.25)
