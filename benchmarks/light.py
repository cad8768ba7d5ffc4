"""What a new home costs before its first picture: building the scene, merging facets, light, textures.

    python benchmarks/light.py --out docs/figures/light

CPU time of one thread, kernels compiled, nothing from the cache on disk. Prints a table; writes OUT.json and OUT.png.
"""

from __future__ import annotations

import dataclasses
import io
import os
import time
from pathlib import Path
from typing import Any

os.environ["GALOC_CACHE"] = "off"  # before galoc is imported: light is computed, not read

import numba
import numpy as np
import tyro
from common import write
from tqdm import tqdm

from galoc import GalocError
from galoc_env.film import writable_folder
from galoc_env.homes import generate
from galoc_env.render.drawable import drawable
from galoc_env.render.facets import build_facets
from galoc_env.render.light import bake, linear, mean_colours
from galoc_env.scene import build_scene

STAGES = ("build scene", "merge facets", "light", "arrays and textures")
ALL = "all"


@dataclasses.dataclass(frozen=True)
class Options:
    """Command line."""

    homes: int = 12
    """Generated homes, from number 0."""
    furniture: float = 0.5
    """Density."""
    out: Path = Path("runs/light")
    """Results, without suffix."""


def stages(number: int, furniture: float) -> dict[str, float]:
    """CPU seconds of each stage for one home, and its size."""
    plan = generate(number)
    clock = [time.process_time()]
    scene = build_scene(plan, furniture=furniture, seed=number)
    clock.append(time.process_time())
    facets = build_facets(scene)
    clock.append(time.process_time())
    albedo = linear(mean_colours(scene)[facets.material] * facets.tint)
    light = bake(facets, scene.lamps, scene.sun, albedo)
    clock.append(time.process_time())
    drawable(scene, facets, light)
    clock.append(time.process_time())
    spent = dict(zip(STAGES, np.diff(clock).tolist(), strict=True))
    triangles = sum(len(mesh.instance) for mesh in scene.meshes)
    return {**spent, ALL: clock[-1] - clock[0], "triangles": triangles, "facets": len(facets.plane)}


def figure(rows: list[dict[str, float]]) -> bytes:
    """Stages of each home, stacked."""
    from matplotlib.figure import Figure

    page = Figure(figsize=(8.0, 3.2), layout="constrained")
    axes = page.subplots()
    left = np.zeros(len(rows))
    for stage, colour in zip(STAGES, ("#7f9fc9", "#c8b37f", "#c8553d", "#5a9e6f"), strict=True):
        spent = np.array([row[stage] for row in rows])
        axes.barh(range(len(rows)), spent, left=left, label=stage, color=colour)
        left += spent
    axes.set(xlabel="CPU time of one thread / s", ylabel="home", yticks=range(len(rows)))
    axes.invert_yaxis()
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    out = io.BytesIO()
    page.savefig(out, dpi=110)
    return out.getvalue()


def main(options: Options) -> None:
    """Measure, print and write."""
    if options.homes < 1:
        raise GalocError(f"--homes {options.homes}", "1 or more", "Fix --homes.")
    writable_folder(options.out.parent)
    numba.set_num_threads(1)
    stages(0, options.furniture)  # compiles
    rows = [stages(n, options.furniture) for n in tqdm(range(options.homes), unit="home", disable=None)]
    result: dict[str, Any] = {"settings": {"homes": options.homes, "furniture": options.furniture}, "rows": rows}
    write(options.out, result, figure(rows))
    print(f"{'CPU time, one thread / s':<28}{'median':>10}{'largest':>10}")
    for stage in (*STAGES, ALL):
        spent = [row[stage] for row in rows]
        print(f"{stage:<28}{np.median(spent):>10.3f}{max(spent):>10.3f}")
    for size in ("triangles", "facets"):
        print(f"{size:<28}{np.median([row[size] for row in rows]):>10.0f}{max(row[size] for row in rows):>10.0f}")


if __name__ == "__main__":
    try:
        main(tyro.cli(Options, description=__doc__))
    except GalocError as error:
        raise SystemExit(f"light: {error}") from None
