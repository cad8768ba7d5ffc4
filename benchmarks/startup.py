"""Start-up: wall time from a fresh process to the first pose, and where it goes.

    python benchmarks/startup.py --out runs/startup
    python benchmarks/startup.py --cold            # compile all kernels anew: what the first run after an install costs

Each run is a new Python process that knows nothing but a plan and a wireframe: interpreter, import galoc, load the
plan, build a Localizer, locate twice (the first loads compiled kernels). Prints a table; writes OUT.json.
"""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import views

from galoc import Camera, Floorplan, GalocError, Wireframe
from galoc.formats.atomic import write_atomic
from galoc_env.film import writable_folder

SIZE, HFOV_DEG = (640, 480), 90.0
STAGES = ("interpreter", "import galoc", "plan", "localizer", "first locate", "second locate", "exit")
TO_POSE = STAGES[:5]
CHILD = """
import json, sys, time
clock = [time.time()]  # the one clock that two processes share
def tick():
    clock.append(time.time())
import galoc
tick()
plan = galoc.Floorplan.load(sys.argv[1])
tick()
localizer = galoc.Localizer(plan, galoc.Camera.from_hfov(*json.loads(sys.argv[3])))
tick()
import numpy as np
with np.load(sys.argv[2]) as kept:
    seen = {name: kept[name] for name in kept.files}
gravity = seen.pop("gravity")
wireframe = galoc.Wireframe(**seen)
for _ in range(2):
    pose = localizer.locate(wireframe, gravity).pose
    tick()
kernels = sum(
    len(value.signatures)
    for name, module in list(sys.modules.items()) if name.startswith("galoc")
    for key, value in vars(module).items()
    if hasattr(value, "signatures") and getattr(value, "__module__", "") == name
)
print(json.dumps({"clock": clock, "pose": list(pose), "kernels": kernels, "modules": len(sys.modules)}))
"""
"""What a fresh process runs; it imports nothing that localizing does not need."""


@dataclasses.dataclass(frozen=True)
class Options:
    """Command line."""

    plans: tuple[str, ...] = ("apartment", "office")
    """Names or files of plans."""
    runs: int = 5
    """Processes per plan."""
    cold: bool = False
    """Also one run per plan with empty caches: kernels are compiled, range profiles are cast."""
    out: Path = Path("runs/startup")
    """Results, without suffix."""


def save_view(plan: Floorplan, path: Path) -> None:
    """One noisy wireframe of the plan as npz, so that the process under test need not make it."""
    view = views(plan, Camera.from_hfov(*SIZE, HFOV_DEG), 1, 1.0, 0.5, (3,))[0]
    names = [f.name for f in dataclasses.fields(Wireframe) if f.init]
    arrays = {name: getattr(view.wireframe, name) for name in names}
    np.savez(path, gravity=view.gravity, **{name: a for name, a in arrays.items() if a is not None})


def measure(plan: str, view: Path, environment: dict[str, str]) -> dict[str, Any]:
    """Wall seconds of each stage in one fresh process, and CPU seconds of all of it."""
    import resource  # of POSIX only

    command = [sys.executable, "-c", CHILD, plan, str(view), json.dumps([*SIZE, HFOV_DEG])]
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.time()
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **environment}, check=False)
    stop, after = time.time(), resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise GalocError(f"a run that failed on {plan!r}: {done.stderr.strip()}", "a pose", "Mend that first.")
    told = json.loads(done.stdout)
    stages = dict(zip(STAGES, map(float, np.diff([start, *told.pop("clock"), stop])), strict=True))
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"stages": stages, "to_pose": sum(stages[s] for s in TO_POSE), "cpu": cpu, **told}


def table(found: dict[str, list[dict[str, Any]]]) -> str:
    """Median wall milliseconds of the stages by plan."""
    width = max(map(len, found)) + 2
    lines = [f"{'ms, median':<{width}}" + "".join(f"{s:>15}" for s in (*STAGES, "to first pose", "CPU", "kernels"))]
    for name, runs in found.items():
        values = [1e3 * np.median([r["stages"][s] for r in runs]) for s in STAGES]
        values += [1e3 * np.median([r[k] for r in runs]) for k in ("to_pose", "cpu")]
        lines.append(f"{name:<{width}}" + "".join(f"{v:>15.0f}" for v in (*values, runs[0]["kernels"])))
    return "\n".join(lines)


def main(options: Options) -> None:
    """Measure, print and write."""
    if options.runs < 1:
        raise GalocError(f"--runs {options.runs}", "1 or more", "Fix --runs.")
    writable_folder(options.out.parent)
    found: dict[str, list[dict[str, Any]]] = {}
    with tempfile.TemporaryDirectory() as scratch:
        for number, name in enumerate(options.plans):
            view = Path(scratch) / f"{number}.npz"
            save_view(Floorplan.load(name), view)
            if options.cold:
                cold = {"NUMBA_CACHE_DIR": f"{scratch}/n{number}", "GALOC_CACHE": f"{scratch}/g{number}"}
                found[f"{name}, cold"] = [measure(name, view, cold)]
            measure(name, view, {})  # fills the caches
            found[name] = [measure(name, view, {}) for _ in range(options.runs)]
    print(table(found))
    result = {"settings": dataclasses.asdict(options) | {"out": str(options.out)}, "runs": found}
    write_atomic(Path(f"{options.out}.json"), (json.dumps(result, indent=1) + "\n").encode())


if __name__ == "__main__":
    try:
        main(tyro.cli(Options, description=__doc__))
    except GalocError as error:
        sys.exit(f"startup: {error}")
