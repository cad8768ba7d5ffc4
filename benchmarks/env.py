"""Steps per second of the whole environment: single, in Gymnasium's vectors, and as our batch; beside MiniWorld's.

    python benchmarks/env.py --out docs/figures/env
    python benchmarks/env.py --miniworld path/to/python      # MiniWorld from another environment

A step moves, draws, senses and, with the localizer, detects, localizes and scores; actions are random. All lanes walk
in one generated home. Each contestant has a process of its own, and all take turns. Rates are by CPU time (all threads
and worker processes) and by wall time. Prints a table; writes OUT.json and OUT.png.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import sys
from pathlib import Path
from typing import Any

import tyro
from common import chosen, write
from env_report import figure, report
from render import size_of
from render_rounds import Contestant, Entry, machine, race, rate, ratio, reasons

from galoc import GalocError
from galoc_env.film import writable_folder

KINDS = ("single", "fast", "sync", "async", "batch", "threads", "miniworld")
NAMES = {
    "single": "single", "fast": "single, fast", "sync": "gymnasium sync", "async": "gymnasium async",
    "batch": "our batch", "threads": "our batch, threads", "miniworld": "MiniWorld Maze",
}  # fmt: skip
LOCALIZED = " + localizer"
"""Ends the names of what localizes."""
LOCALIZERS = ("none", "galoc")
BARS: tuple[tuple[str, str, tuple[int, int, int], float], ...] = (
    ("single, fast", "MiniWorld Maze", (80, 60, 1), 10.0),
    ("single, fast", "MiniWorld Maze", (320, 240, 1), 10.0),
    ("our batch", "single", (160, 120, 64), 3.0),
)
"""Who should be how many times faster than whom by CPU time in which case; a single environment's case has one lane."""


@dataclasses.dataclass(frozen=True)
class Options:
    """Command line."""

    home: int = 3
    """Number of the generated home."""
    renderer: str = "raster"
    """What draws."""
    quality: str = "default"
    """Of `raster`."""
    sizes: tuple[str, ...] = ("80x60", "160x120", "320x240")
    """Picture sizes of the single environments, px."""
    vector_size: str = "160x120"
    """Picture size of the vectors, px."""
    lanes: tuple[int, ...] = (1, 16, 64, 256)
    """Sizes of the vectors."""
    most_sync: int = 64
    """The sync vector has no more lanes than this: each has a world of its own in memory."""
    most_processes: int = 16
    """The async vector has no more lanes than this: each is a process."""
    most_localized: int = 16
    """With the localizer no vector has more lanes than this."""
    kinds: tuple[str, ...] = KINDS
    """Contestants."""
    localizers: tuple[str, ...] = LOCALIZERS
    """With which localizers."""
    threads: int = os.cpu_count() or 1
    """Threads of "our batch, threads"; everything else has one, beside OpenGL's own."""
    rounds: int = 5
    """Turns of each contestant."""
    slice_s: float = 0.6
    """CPU time of a turn, s."""
    miniworld: str = sys.executable
    """Python in which MiniWorld is installed (extra `bench`)."""
    out: Path = Path("runs/env")
    """Results, without suffix."""


def checked(options: Options) -> None:
    """Refuse what cannot be measured."""
    for name in ("rounds", "threads", "most_sync", "most_processes", "most_localized"):
        if getattr(options, name) < 1:
            flag = name.replace("_", "-")
            raise GalocError(f"--{flag} {getattr(options, name)}", "1 or more", f"Fix --{flag}.")
    if not options.lanes or min(options.lanes) < 1:
        raise GalocError(f"--lanes {' '.join(map(str, options.lanes))}", "numbers from 1", "Fix --lanes.")


def cases_of(options: Options, kind: str, localizer: str) -> list[tuple[int, int, int]]:
    """Width, height and lanes of what a contestant does."""
    if kind in ("single", "fast", "miniworld"):
        return [(*size_of(text), 1) for text in options.sizes]
    most = {"sync": options.most_sync, "async": options.most_processes}.get(kind, max(options.lanes))
    if localizer != "none":
        most = min(most, options.most_localized)
    return [(*size_of(options.vector_size), n) for n in options.lanes if n <= most]


def entries_of(options: Options, stack: contextlib.ExitStack) -> list[Entry]:
    """A process per kind and localizer, and an entry per case."""
    entries = []
    for localizer in chosen("--localizers", options.localizers, LOCALIZERS):
        for kind in chosen("--kinds", options.kinds, KINDS):
            if kind in ("miniworld", "fast") and localizer != options.localizers[0]:
                continue
            quality = "fast" if kind == "fast" else options.quality
            arguments = {"localizer": localizer, "renderer": options.renderer, "quality": quality, "detector": "oracle"}
            role = {"threads": "batch", "fast": "single"}.get(kind, kind)
            job = {"kind": role, "home": options.home, "arguments": arguments}
            python = options.miniworld if kind == "miniworld" else sys.executable
            made = Contestant("env_run.py", job, python, options.threads if kind == "threads" else 1)
            stack.callback(made.close)
            name = NAMES[kind] + (LOCALIZED if localizer != "none" and kind != "miniworld" else "")
            entries += [Entry(name, made, case) for case in cases_of(options, kind, localizer)]
    return entries


def comparisons(entries: list[Entry]) -> list[dict[str, Any]]:
    """Single against MiniWorld by size, and our batch against Gymnasium's vectors by lanes."""
    by_case = {(e.name, e.case): e for e in entries}
    out = []
    for (name, case), entry in by_case.items():
        plain = name.removesuffix(LOCALIZED)
        others = {
            "single": ["miniworld"],
            "single, fast": ["miniworld"],
            "our batch": ["sync"],
            "our batch, threads": ["async"],
        }.get(plain, [])
        for kind in others:
            other = NAMES[kind] + (LOCALIZED if name != plain and kind != "miniworld" else "")
            against = by_case.get((other, case))
            found = None if against is None else ratio(entry, against)
            if found is not None:
                out.append({"name": name, "other": other, "case": list(case), "ratio": found})
    return out


def bars(entries: list[Entry]) -> list[dict[str, Any]]:
    """What is asked, and the ratio found; None where one of the two was not measured."""
    by_case = {(e.name, e.case): e for e in entries}
    out = []
    for name, other, case, least in BARS:
        one, two = by_case.get((name, case)), by_case.get((other, (*case[:2], 1)))
        found = None if one is None or two is None else ratio(one, two)
        met = None if found is None else found["cpu"][0] >= least
        out.append({"name": name, "other": other, "case": list(case), "least": least, "ratio": found, "met": met})
    return out


def main(options: Options) -> None:
    """Measure, print and write."""
    checked(options)
    writable_folder(options.out.parent)
    with contextlib.ExitStack() as stack:
        entries = entries_of(options, stack)
        race(entries, options.rounds, options.slice_s)
    rows = [{"name": e.name, "case": list(e.case), "rate": rate(e), "build_s": e.build_s} for e in entries]
    result = {
        "settings": dataclasses.asdict(options) | {"out": str(options.out), "miniworld": Path(options.miniworld).name},
        "machine": machine(),
        "rows": rows,
        "ratios": comparisons(entries),
        "bars": bars(entries),
        "missing": reasons(entries),
    }
    write(options.out, result, figure(result))
    print(report(result))


if __name__ == "__main__":
    try:
        main(tyro.cli(Options, description=__doc__))
    except GalocError as error:
        sys.exit(f"env: {error}")
