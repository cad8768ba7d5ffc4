"""Frames per second of the renderers: ours, pyrender as its manual has it, and Farama's MiniWorld.

    python benchmarks/render.py --out docs/figures/render
    python benchmarks/render.py --miniworld path/to/python   # of another environment, where MiniWorld is installed

Ours draw a furnished generated home from random places, tilted, 108 degrees wide; MiniWorld draws FourRooms and Maze.
Each contestant has a process of its own, and all take turns, so that ratios are of one moment. Rates are by CPU time
(all threads of the process: OpenGL's software renderer has several) and by wall time. What cannot run on this machine
is named with the reason. Prints tables; writes OUT.json and OUT.png.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import write
from render_report import figure, report
from render_rounds import Contestant, Entry, machine, race, rate, ratio, reasons

from galoc import GalocError
from galoc_env.film import writable_folder

SHOWN_SIZE = (320, 240)
"""Size of the pictures in the figure."""
TILT_RAD = math.radians(8.0)
"""Largest roll and pitch of the views."""
OURS = {
    "raster fast": {"kind": "raster", "quality": "fast"},
    "raster default": {"kind": "raster", "quality": "default"},
    "raster best": {"kind": "raster", "quality": "best"},
    "gl": {"kind": "gl"},
    "pyrender": {"kind": "pyrender"},
}
OTHERS = {f"MiniWorld {w}": {"kind": "miniworld", "world": w} for w in ("FourRooms", "Maze")}
BARS: tuple[tuple[str, str, str, tuple[int, int], float], ...] = (
    ("raster fast", "MiniWorld FourRooms", "rgb", (320, 240), 7.0),
    ("raster fast", "MiniWorld FourRooms", "rgb", (640, 480), 10.0),
    ("raster default", "MiniWorld FourRooms", "rgb", (320, 240), 4.0),
    ("raster default", "MiniWorld FourRooms", "rgb", (640, 480), 4.0),
    ("raster fast", "gl", "all", (320, 240), 50.0),
    ("raster fast", "pyrender", "all", (320, 240), 50.0),
)
"""Who must be how many times faster than whom, both with these outputs, at which size."""


@dataclasses.dataclass(frozen=True)
class Options:
    """Command line."""

    home: int = 3
    """Number of the generated test home."""
    furniture: float = 0.5
    """Density of its furniture."""
    poses: int = 64
    """Views, drawn in turn."""
    sizes: tuple[str, ...] = ("80x60", "160x120", "320x240", "640x480")
    """Picture sizes, px."""
    only: tuple[str, ...] = (*OURS, *OTHERS)
    """Contestants."""
    rounds: int = 7
    """Turns of each contestant."""
    slice_s: float = 0.5
    """CPU time of a turn, at least that of 16 views, s."""
    miniworld: str = sys.executable
    """Python in which MiniWorld is installed (extra `bench`)."""
    shown: int = 3
    """Number of the view in the figure."""
    out: Path = Path("runs/render")
    """Results, without suffix."""


def checked(options: Options) -> list[tuple[int, int]]:
    """The sizes, after the other flags were looked at."""
    for name in ("poses", "rounds"):
        if getattr(options, name) < 1:
            raise GalocError(f"--{name} {getattr(options, name)}", "1 or more", f"Fix --{name}.")
    if not 0 <= options.shown < options.poses:
        raise GalocError(f"--shown {options.shown}", f"0 to {options.poses - 1}", "Fix --shown or --poses.")
    unknown = [name for name in options.only if name not in OURS | OTHERS]
    if unknown or not options.only:
        raise GalocError(f"--only {' '.join(unknown)}".strip(), f"some of {', '.join(OURS | OTHERS)}", "Fix --only.")
    return [size_of(text) for text in options.sizes]


def size_of(text: str) -> tuple[int, int]:
    """Width and height of "320x240", px."""
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit() and min(int(width), int(height)) >= 16):
        raise GalocError(f"--sizes {text}", "WIDTHxHEIGHT from 16x16, such as 320x240", "Fix the size.")
    return int(width), int(height)


def views(options: Options) -> list[list[float]]:
    """x, y, heading, roll, pitch of random places in which a body fits."""
    from galoc_env.homes import generate
    from galoc_env.motion import walkable
    from galoc_env.scene import build_scene

    plan = generate(options.home, split="test")
    scene = build_scene(plan, furniture=options.furniture, seed=options.home)
    places = walkable(plan, np.asarray(scene.obstacles).reshape(-1, 4)).positions
    rng = np.random.default_rng(options.home)
    xy = places[rng.integers(len(places), size=options.poses)]
    heading = rng.uniform(-math.pi, math.pi, (options.poses, 1))
    return np.column_stack([xy, heading, rng.uniform(-TILT_RAD, TILT_RAD, (options.poses, 2))]).tolist()


def entries_of(
    options: Options, sizes: list[tuple[int, int]], stack: contextlib.ExitStack
) -> tuple[dict[str, Contestant], list[Entry]]:
    """A process per contestant, and an entry per size and set of outputs, those to be compared side by side."""
    common = {"home": options.home, "furniture": options.furniture, "views": views(options), "shown": options.shown}
    made = {}
    for name in [n for n in OURS | OTHERS if n in options.only]:
        python = options.miniworld if name in OTHERS else sys.executable
        made[name] = Contestant("render_draw.py", common | (OURS | OTHERS)[name], python)
        stack.callback(made[name].close)
    entries = [
        Entry(name, contestant, (*size, outputs))
        for size in sizes
        for name, contestant in made.items()
        for outputs in (("rgb",) if name in OTHERS else ("all", "rgb"))
    ]
    return made, entries


def pictures(made: dict[str, Contestant]) -> dict[str, Any]:
    """The same view by each contestant that can."""
    found = {}
    with tempfile.TemporaryDirectory() as scratch:
        for number, (name, contestant) in enumerate(made.items()):
            path = Path(scratch) / f"{number}.npy"
            contestant.ask((*SHOWN_SIZE, "rgb"), 0, path)
            if path.exists():
                found[name] = np.load(path)
    return found


def bars(entries: list[Entry]) -> list[dict[str, Any]]:
    """What was asked of us, and what was measured."""
    by_case = {(e.name, *e.case): e for e in entries}
    out = []
    for name, other, outputs, size, least in BARS:
        pair = by_case.get((name, *size, outputs)), by_case.get((other, *size, outputs))
        if pair[0] is None or pair[1] is None:
            continue
        found = ratio(pair[0], pair[1])
        row = {"name": name, "other": other, "outputs": outputs, "size": list(size), "least": least, "ratio": found}
        out.append(row | {"met": None if found is None else found["cpu"][0] >= least})
    return out


def main(options: Options) -> None:
    """Measure, print and write."""
    sizes = checked(options)
    writable_folder(options.out.parent)
    with contextlib.ExitStack() as stack:
        made, entries = entries_of(options, sizes, stack)
        race(entries, options.rounds, options.slice_s)
        shown = pictures(made)
    rows = [
        {"name": e.name, "size": list(e.case[:2]), "outputs": e.case[2], "rate": rate(e), "build_s": e.build_s}
        for e in entries
    ]
    result = {
        "settings": dataclasses.asdict(options) | {"out": str(options.out), "miniworld": Path(options.miniworld).name},
        "machine": machine(),
        "rows": rows,
        "bars": bars(entries),
        "missing": reasons(entries),
    }
    write(options.out, result, figure(result, shown))
    print(report(result))


if __name__ == "__main__":
    try:
        main(tyro.cli(Options, description=__doc__))
    except GalocError as error:
        sys.exit(f"render: {error}")
