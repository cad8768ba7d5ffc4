"""The ``galoc-env`` command."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from galoc import GalocError

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""


@dataclass(frozen=True)
class WorldOptions:
    """Options that the commands share."""

    plan: str | None = None
    """Plan file, or the name of a shipped plan such as apartment. Left out: a home generated from the seed."""
    steps: int = 60
    """Actions per walk."""
    seed: int = 0
    """Seed of start, walk and noise (evaluate: of the first episode)."""
    detector: str = "onnx"
    """What finds the walls: onnx (learned, looks at the picture), lines (line segments in the picture) or oracle (the
    true walls plus noise)."""
    detector_noise_px: float = 5.0
    """With --detector oracle: noise of each junction coordinate, px of a 640 px wide image."""
    imu_noise_deg: float = 0.5
    """Noise of each gravity reading, degrees."""
    odometry_noise: float = 0.02
    """Noise of odometry as a fraction of the motion."""
    tilt_deg: float = 0.0
    """Largest true roll and pitch, degrees."""
    furniture: float = 0.5
    """Furniture density, 0 to 1."""
    hfov_deg: float = 108.0
    """Horizontal field of view, degrees."""
    geometry: str = "ml"
    """Layout method: ml or paper."""
    scoring: str = "likelihood"
    """likelihood or cosine; only paper with cosine is the paper's method."""
    split: str = "train"
    """Which generated homes: train or test."""
    homes: str = "rooms"
    """Sort of generated homes: rooms, or ambiguous, where views repeat. Not with --plan."""

    def arguments(self) -> dict[str, Any]:
        """Arguments for the environment."""
        shared = (
            "plan",
            "detector",
            "detector_noise_px",
            "imu_noise_deg",
            "odometry_noise",
            "tilt_deg",
            "furniture",
            "hfov_deg",
            "geometry",
            "scoring",
            "split",
            "homes",
        )
        return {name: getattr(self, name) for name in shared} | {"width": 640, "height": 480}

    def check(self) -> None:
        """Refuse counts that make no walk."""
        if self.steps < 1 or self.seed < 0:
            raise GalocError(
                f"--steps {self.steps} --seed {self.seed}", "at least 1 step and a seed from 0", "Pass such numbers."
            )


@dataclass(frozen=True)
class Demo(WorldOptions):
    """Walk through a floorplan, be localized from wall geometry, and leave a film, a summary and numbers."""

    policy: str = "patrol"
    """Who walks: patrol (a scripted walker that knows the truth), infogain, explore, spin, ... or your own
    "module:Class" or "file.py:Class"."""
    out: Path = Path("runs/demo")
    """Folder for episode.mp4, summary.png and result.json."""

    def run(self) -> None:
        """Run the command."""
        from tqdm import tqdm

        from galoc_env.demo import report, run_demo

        self.check()
        with tqdm(total=self.steps + 1, desc="preparing", unit="step", mininterval=0.5) as bar:

            def on_progress() -> None:
                # The first step waits for the plan's range profiles and, on a fresh machine, for the compiler.
                bar.set_description("walking", refresh=False)
                bar.update()

            files = run_demo(
                self.arguments(),
                steps=self.steps,
                seed=self.seed,
                out=self.out,
                policy=self.policy,
                on_progress=on_progress,
            )
        print(report(files))


@dataclass(frozen=True)
class Evaluate(WorldOptions):
    """Score a policy, and the localizer along its way, over many episodes.

    Without --policy the scripted walker walks. A policy that raises, hangs or returns what is no action loses that
    episode, and the run goes on. With --detector oracle nothing is drawn unless --renderer says so.
    """

    policy: str = "patrol"
    """Name of an installed policy (infogain, explore, ppo, spin, random, ...), "module:Class" or "file.py:Class".
    patrol is the scripted walker, which sees the truth."""
    set: str | None = None
    """A fixed set of worlds and starts: homes-test (100 test homes), ambiguous (60 generated plans in which views
    repeat) or buildings (the plans of --plans). The first two fix --split and --homes too. Left out: --plan or
    --split, with seeds from --seed on."""
    plans: Path | None = None
    """With --set buildings: folder of plan files; episodes go through them by name, again and again."""
    episodes: int = 20
    """Episodes; the first ones of a set are in as many different plans as it has. A later run with more of them
    keeps those that are done."""
    workers: int = 1
    """Processes."""
    act_timeout: float = 60.0
    """Seconds that a policy has for one action, or for its reset, before it is stopped."""
    actions: str = "discrete"
    """discrete or continuous."""
    localizer: str = "galoc"
    """What finds the pose: galoc, or your own "module:Class"."""
    renderer: str | None = None
    """What draws: raster, gl or none. Left out: raster, but none with --detector oracle."""
    out: Path = Path("runs/evaluate")
    """Folder for episodes.jsonl, summary.json, timing.csv, success.png and error.png. A stopped run goes on where it
    was."""

    def run(self) -> None:
        """Run the command."""
        from tqdm import tqdm

        from galoc_env import benchmark_sets, detection, evaluate, evaluate_report

        self.check()
        if self.set is not None and self.plan is not None:
            raise GalocError(f"--set {self.set} with --plan {self.plan}", "one of the two", "Leave one of them out.")

        def note(text: str) -> None:
            tqdm.write(f"galoc-env: {text}", file=sys.stderr)

        chosen = benchmark_sets.make_set(self.set, self.plans, self.seed, note)
        job = evaluate.make_job(self.policy, self.world(), self.steps, chosen, self.act_timeout)
        with tqdm(total=self.episodes, desc="episodes", unit="episode") as bar:

            def track(done: int, total: int) -> None:
                bar.n = bar.initial = done if bar.n == 0 else bar.initial
                bar.update(done - bar.n)

            found = evaluate.evaluate(job, self.episodes, self.workers, self.out, note=note, track=track)
        print(evaluate_report.table(found))
        print(f"detector {detection.described(self.detector)}")
        print("\n".join(f"written  {file}" for file in found.files))

    def world(self) -> dict[str, Any]:
        """Arguments for the environment."""
        drawn = self.renderer or ("none" if self.detector == "oracle" else "raster")
        return {**self.arguments(), "actions": self.actions, "localizer": self.localizer, "renderer": drawn}


@dataclass(frozen=True)
class Stress:
    """Stress-test gauge solvers on synthetic corner pairs: noise, tilt, few pairs, wrong and missing junctions."""

    frames: int = 400
    """Views per condition."""
    seed: int = 0
    """Seed of homes, poses and noise."""
    jobs: int = 1
    """Processes. Times per solve are only comparable when as many cores are free."""
    out: Path = Path("runs/stress")
    """Folder for conditions.csv, stress.json, verdicts.md and stress.png. A stopped run goes on where
    it was."""
    sweeps: tuple[str, ...] = ()
    """Only these: sigma, tilt, pairs, hfov, kind, outliers, missed, one-sided, height, true-tilt, noise-known, grid,
    claims. Left out: all."""
    solver: str | None = None
    """Your own solver beside the shipped ones: module:function or file.py:function, called like
    galoc.pairs.solve_pairs without method, in batches of views with equally many pairs."""
    quick: bool = False
    """A small run: 160 views and three levels per sweep."""

    def run(self) -> None:
        """Run the command."""
        from tqdm import tqdm

        from galoc_env import stress, stress_report
        from galoc_env.film import writable_folder
        from galoc_env.partial import Partial, jsonable

        if self.jobs < 1:
            raise GalocError(f"--jobs {self.jobs}", "at least 1 process", "Pass 1 or more.")
        frames = min(self.frames, 160) if self.quick else self.frames
        plan = stress.Plan.make(self.sweeps, frames, self.seed, self.solver, self.quick)
        plan.solvers()  # refuses a bad solver before anything is written
        folder = writable_folder(self.out)
        partial = Partial(folder / "partial.jsonl", plan.job())
        done = partial.load()
        missing = [task for task in range(plan.tasks) if task not in done]
        with tqdm(total=plan.tasks, initial=plan.tasks - len(missing), desc="conditions", unit="condition") as bar:
            for result in stress.run_tasks(plan, missing, self.jobs):
                partial.add(result)
                done[result["seed"]] = jsonable(result)
                bar.update()
        collected = jsonable(stress.collect(plan, done))
        files = stress_report.write(collected, folder)
        partial.remove()
        print(stress_report.table(collected))
        print("\n".join(f"written  {file}" for file in files))


Command = (
    Annotated[Demo, tyro.conf.subcommand("demo")]
    | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
    | Annotated[Stress, tyro.conf.subcommand("stress")]
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of ``galoc-env``: exit code 0, 2 after bad input, 130 after Ctrl-C."""
    try:
        command = tyro.cli(
            Command,
            prog="galoc-env",
            description="The galoc world: a camera walks through floorplans and is localized from wall geometry.",
            args=arguments,
            config=(tyro.conf.FlagCreatePairsOff,),
        )
        command.run()
    except GalocError as error:
        print(f"galoc-env: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("galoc-env: stopped; nothing half-written was left behind", file=sys.stderr)
        sys.exit(INTERRUPTED)
