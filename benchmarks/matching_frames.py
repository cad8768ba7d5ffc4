"""Frames of the matching benchmark: rays with unknown arcs as layouts give them, and whole true views."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from common import View, true_rays, views

from galoc import Camera, Floorplan, GalocError, Rays
from galoc.layout import solve_layout
from galoc.observation import Observation, observation
from galoc.rays import cast_rays
from galoc.types import Layout

SIZE = (640, 480)
KINDS = (("layout", 108.0), ("layout", 80.0), ("true", 108.0), ("true", 80.0))
"""Frames in turn: rays of the layout, or all true rays; horizontal field of view, degrees."""
SIGMA_PX, IMU_DEG = 5.0, 1.0
"""Noise of junctions, and of roll and pitch."""
HOMES = "home-"
"""Plans named so are homes of the test split."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One view, as each scoring takes it."""

    kind: str
    hfov: float
    rays: Rays
    seen: Observation


def load(name: str) -> Floorplan:
    """A plan by name, file, or number of a home."""
    if name.startswith(HOMES):
        from galoc_env.homes import generate

        return generate(int(name.removeprefix(HOMES)), split="test")
    return Floorplan.load(name)


def frames(plan: Floorplan, count: int, seed: int) -> list[Frame]:
    """Frames of all kinds in turn; views without a known ray are passed over."""
    out: list[Frame] = []
    for k, (kind, hfov) in enumerate(KINDS):
        camera = Camera.from_hfov(*SIZE, hfov)
        want, batch = len(range(k, count, len(KINDS))), 0
        mine: list[Frame] = []
        while len(mine) < want:
            if batch > 20:
                raise GalocError(f"plan {plan.name!r} without a view of a wall", "corners in sight", "Leave it out.")
            for view in views(plan, camera, want, SIGMA_PX, IMU_DEG, (seed, k, batch)):
                if kind == "true":
                    rays = true_rays(plan, camera, view.pose)
                    mine.append(Frame(kind, hfov, rays, observation(Layout.unknown("ml"), rays)))
                    continue
                paper, likely = (_seen(method, view, camera) for method in ("paper", "ml"))
                seen = observation(*likely)
                if paper[1].known.any() and np.isfinite(seen.variance).any():
                    mine.append(Frame(kind, hfov, paper[1], seen))
            batch += 1
        out += mine[:want]
    return out


def _seen(method: str, view: View, camera: Camera) -> tuple[Layout, Rays]:
    layout = solve_layout(view.wireframe, camera, view.gravity, method)
    return layout, cast_rays(layout, camera)
