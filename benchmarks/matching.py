"""The exact SE(2) search against a dense reference: the same poses, how much sooner.

    python benchmarks/matching.py --out runs/matching
    python benchmarks/matching.py --plans ../shared/data/plans/amrl_maps/NSH1.json --tiles 40 --steps

Both see the same frames of a plan: what the layout makes of noisy wireframes (with unknown arcs), and true rays over
the whole view. The reference scores every pose of the lattice, in tiles of positions whose profiles are cast beforehand
and not counted. Of a plan with more tiles than --tiles, that many are scored, evenly spread, and the time is taken in
proportion; then no scored pose may beat the search's. Times are CPU time; the search is timed before, amid and after
the reference, and the median is taken. A run that was cut off goes on where it stopped.
"""

from __future__ import annotations

import copy
import math
import os
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import chosen, resumable, write
from matching_frames import IMU_DEG, KINDS, SIGMA_PX, Frame, frames, load
from matching_reference import Best, Reference, score_tile
from matching_report import figure, report, summary
from numpy.typing import NDArray

from galoc import Floorplan, GalocError
from galoc.likelihood_bound import LikelihoodBound
from galoc.match import Found, Matcher
from galoc.profiles import Caster
from galoc.pyramid import Pyramid
from galoc.score import GAMMA, cosine

Array = NDArray[np.float64]
Int = NDArray[np.int64]

SCORINGS = ("cosine", "likelihood")
TIE = {"cosine": 1e-6, "likelihood": 2e-4}
"""Scores closer than this are equal: the cosine in float64, the likelihood (costs of up to 50) in float32."""


@dataclass(frozen=True)
class Options:
    """Command line."""

    plans: tuple[str, ...] = (
        "apartment", "home-54", "home-15", "home-20", "home-39", "home-87", "house", "corridor",
    )  # fmt: skip
    """Names or files of plans, or home-N."""
    frames: int = 34
    """Frames of each plan."""
    large_frames: int = 8
    """Frames of plans above 150 m2."""
    resolution: float = 0.01
    """Step of the lattice, m."""
    steps: tuple[float, ...] = (0.02, 0.05, 0.1)
    """Further steps on the first plan, m."""
    scorings: tuple[str, ...] = SCORINGS
    """Which to run."""
    tiles: int = 1000
    """Tiles of positions that the reference scores at most."""
    threads: int = 1
    """Threads of both."""
    seed: int = 0
    """Of poses and noise."""
    keep_cache: bool = False
    """Use the disk cache, instead of building each pyramid anew."""
    out: Path = Path("runs/matching")
    """Results, without suffix."""


def ask(matcher: Matcher, scoring: str, frame: Frame) -> tuple[Found, float, float]:
    """Answer of the search, CPU and wall seconds: from the observation to the pose."""
    wall, cpu = time.perf_counter(), time.process_time()
    found = matcher.argmax(frame.rays if scoring == "cosine" else frame.seen)
    return found, time.process_time() - cpu, time.perf_counter() - wall


def measure(task: tuple[str, float, Options]) -> dict[str, Any]:
    """All frames of one plan at one step."""
    import numba

    name, step, options = task
    numba.set_num_threads(options.threads)
    plan = load(name)
    matcher = Matcher(plan, step)
    build = {}
    for scoring in options.scorings:
        start = time.process_time(), time.perf_counter()
        pyramid = matcher.pyramid(scoring != "cosine")
        seconds = time.process_time() - start[0], time.perf_counter() - start[1]
        build[scoring] = {
            "cpu_s": seconds[0], "wall_s": seconds[1], "bytes": sum(level.boxes.nbytes for level in pyramid.levels),
            "levels": len(pyramid.levels),
        }  # fmt: skip
    area = pyramid.positions * step**2
    seen = frames(plan, options.frames if area <= 150.0 else options.large_frames, options.seed)
    cases = [(scoring, frame) for scoring in options.scorings for frame in seen]
    reference = Reference(pyramid, Caster(plan), options.tiles)
    best = [Best() for _ in cases]
    _compile(matcher, cases, reference, step)
    cold = [_cold(matcher, *case) for case in cases]
    found = [ask(matcher, *case)[0] for case in cases]  # now its profiles are there
    rounds = [[ask(matcher, *case)[1:] for case in cases]]
    for k, (leaves, profiles) in enumerate(reference.tiles()):
        if k == reference.middle():
            rounds.append([ask(matcher, *case)[1:] for case in cases])
        for (scoring, frame), b in zip(cases, best, strict=True):
            score_tile(scoring, frame, step, profiles, leaves, b)
    rounds.append([ask(matcher, *case)[1:] for case in cases])
    share = reference.scored / pyramid.positions
    rows = []
    for k, (scoring, frame) in enumerate(cases):
        cpu, wall = np.median([r[k] for r in rounds], axis=0)
        rows.append(
            {
                "scoring": scoring, "kind": frame.kind, "hfov": frame.hfov, "known": int(frame.rays.known.sum()),
                "cold_s": cold[k], "cpu_s": cpu, "wall_s": wall, "reference_s": best[k].seconds / share,
                "certified": found[k].certified, "boxes": found[k].boxes, "scored": found[k].scored,
                **compare(matcher, pyramid, scoring, frame, found[k], best[k], step),
            }
        )  # fmt: skip
    return {
        "plan": plan.name, "step": step, "area_m2": area, "positions": pyramid.positions, "walls": len(plan.segments),
        "build": build, "whole": reference.whole, "share": share, "cases": rows,
    }  # fmt: skip


def _compile(matcher: Matcher, cases: list[tuple[str, Frame]], reference: Reference, step: float) -> None:
    """Run everything once on little."""
    leaves, profiles = next(reference.tiles())
    for scoring in dict.fromkeys(s for s, _ in cases):
        for case in [c for c in cases if c[0] == scoring][:2]:
            ask(matcher, *case)
            score_tile(*case, step, profiles[:64], leaves[:64], Best())


def _cold(matcher: Matcher, scoring: str, frame: Frame) -> float:
    """CPU seconds of the search where no profile has been cast yet (the pyramid is there)."""
    return ask(copy.copy(matcher), scoring, frame)[1]  # copies share the pyramids, not the profiles


def compare(
    matcher: Matcher, pyramid: Pyramid, scoring: str, frame: Frame, found: Found, best: Best, step: float
) -> dict[str, Any]:
    """Whether the search found the reference's pose or one as good; never worse than any pose that was scored."""
    cells = np.floor(found.poses[0, :2] / step).astype(np.int64)
    leaf, heading = int(pyramid.grid.find(cells[None])[0]), round(math.degrees(found.poses[0, 2])) % 360
    same = (leaf, heading) == (best.leaf, best.heading)
    poses = ((leaf, heading), (best.leaf, best.heading))
    scores = [score(matcher.plan, pyramid, scoring, frame, pose, step) for pose in poses]
    return {"same": same, "lead": scores[0] - scores[1], "equal": same or scores[0] >= scores[1] - TIE[scoring]}


def score(plan: Floorplan, pyramid: Pyramid, scoring: str, frame: Frame, pose: tuple[int, int], step: float) -> float:
    """Score of one pose: the cosine in float64, the likelihood by the dense kernel."""
    profile = Caster(plan)(pyramid.grid.positions(np.array([pose[0]])))
    if scoring == "cosine":
        return float(cosine(profile[0].astype(np.float64), frame.rays, pose[1]) ** (1.0 / GAMMA))
    return float(LikelihoodBound(frame.seen, step).volume(profile, np.zeros(1, np.int64))[0, pose[1]])


def main(options: Options) -> None:
    """Measure, report and write."""
    chosen("--scorings", options.scorings, SCORINGS)
    for flag, value in (("--frames", options.frames), ("--large-frames", options.large_frames)):
        if value < 1:
            raise GalocError(f"{flag} {value}", "1 or more", f"Fix {flag}.")
    tasks = [(name, options.resolution, options) for name in options.plans]
    tasks += [(options.plans[0], step, options) for step in options.steps]
    names = [Path(p).stem for p in options.plans]
    settings = {
        "plans": names, "steps": [t[1] for t in tasks], "frames": options.frames, "large_frames": options.large_frames,
        "scorings": options.scorings, "tiles": options.tiles, "threads": options.threads, "seed": options.seed,
        "kinds": KINDS, "sigma_px": SIGMA_PX, "imu_deg": IMU_DEG,
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as scratch:
        if not options.keep_cache:
            os.environ["GALOC_CACHE"] = scratch  # so that building is timed
        rows = resumable(measure, tasks, job=settings, out=options.out, jobs=1, unit="plan")
    result = {"settings": settings, "summary": summary(rows), "rows": rows}
    write(options.out, result, figure(result))
    print(report(result))


if __name__ == "__main__":
    try:
        main(tyro.cli(Options, description=__doc__))
    except GalocError as error:
        sys.exit(f"error: {error}")
