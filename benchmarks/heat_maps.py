"""Heat maps of one noisy view: what the paper's cosine and the likelihood say of every place.

    python benchmarks/heat_maps.py --out docs/figures/heat_maps

A view of `apartment` from a wireframe with 5 px of noise; for each scoring the best score over all headings on every
tenth position of the 0.01 m lattice, the best distinct poses, and how many positions fit better than the true one.
Writes OUT.json and OUT.png.
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import views, write

from galoc import Camera, Floorplan, GalocError, Matcher, Rays
from galoc.layout import solve_layout
from galoc.observation import Observation, observation
from galoc.plot_match import draw_heat_map
from galoc.rays import cast_rays
from galoc_env.film import writable_folder

PLACES = 4
"""Distinct poses drawn."""


@dataclass(frozen=True)
class Options:
    """Command line."""

    plan: str = "apartment"
    """Name or file of the plan."""
    seed: int = 2
    """Of the pose and the noise."""
    sigma: float = 5.0
    """Junction noise, px."""
    resolution: float = 0.01
    """Step of the lattice, m."""
    out: Path = Path("runs/heat_maps")
    """Results, without suffix."""


def main(options: Options) -> None:
    """Draw both."""
    from matplotlib.figure import Figure

    writable_folder(options.out.parent)
    plan, camera = Floorplan.load(options.plan), Camera.from_hfov(640, 480, hfov_deg=108)
    (view,) = views(plan, camera, 1, options.sigma, 1.0, (options.seed,))
    matcher = Matcher(plan, options.resolution)
    stride = max(1, round(0.1 / options.resolution))
    figure = Figure(figsize=(12.5, 4.0), layout="constrained")
    found: dict[str, Any] = {}
    for k, (name, method) in enumerate((("cosine", "paper"), ("likelihood", "ml"))):
        layout = solve_layout(view.wireframe, camera, view.gravity, method)
        rays = cast_rays(layout, camera)
        seen: Rays | Observation = rays if name == "cosine" else observation(layout, rays)
        xy, scores, _ = matcher.heat_map(seen, stride)
        best = matcher.topk(seen, PLACES)
        rank = matcher.rank(seen, view.pose[:2])
        error = float(np.hypot(*(best.poses[0, :2] - view.pose[:2])))
        ax = figure.add_subplot(1, 2, k + 1)
        points = draw_heat_map(ax, plan, xy, scores, best.poses, view.pose)
        figure.colorbar(points, ax=ax, shrink=0.7, label="cosine" if k == 0 else "log-likelihood, nats")
        ax.set_title(
            f"{name}: best pose {error:.2f} m off,\n{100 * rank:.2f} % of the positions fit better than the true one",
            fontsize=11,
        )
        found[name] = {"error_m": error, "rank": rank, "certified": best.certified, "poses": best.poses.tolist()}
        print(f"{name:<12}best {error:.3f} m off   rank {100 * rank:.3f} %   certified {best.certified}")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    heading = math.degrees(view.pose[2])
    settings = {"plan": options.plan, "seed": options.seed, "sigma_px": options.sigma, "heading_deg": heading}
    write(options.out, {"settings": settings, "found": found}, buffer.getvalue())
    print(f"picture  {options.out}.png")


if __name__ == "__main__":
    try:
        main(tyro.cli(Options, description=__doc__))
    except GalocError as error:
        raise SystemExit(f"error: {error}") from None
