"""How a policy turns an ambiguity of several rooms into one: the belief at some steps, as a strip.

    python benchmarks/ambiguity.py --out docs/figures/ambiguity

draws OUT.png and writes OUT.json. By default infogain in a building of like rooms that no training met.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from galoc import GalocError
from galoc.formats.atomic import write_atomic
from galoc_env.env import FloorplanEnv
from galoc_env.film import writable_folder
from galoc_env.partial import jsonable
from galoc_env.play import Rollout, rollout
from galoc_env.policy import make_policy
from galoc_env.scoring import NEAR_M
from galoc_env.topdown import INK, PAPER, TopDown, write

PANEL = (560, 400)
"""Width and height of a panel, px."""
RING_M, LEAST_RING, MOST_RINGS = 0.5, 0.08, 6
"""Places within this radius (m) that hold this share of the belief get a ring, so many at most."""
RING = (58, 44, 170)
"""Its colour: that of the belief."""
TITLE_PX = 34
"""Height of its title, px."""
Image = np.ndarray


@dataclass(frozen=True)
class Options:
    """Draw a belief at some steps of an episode."""

    policy: str = "infogain"
    """Who walks."""
    homes: str = "ambiguous"
    """Which buildings: ambiguous or rooms."""
    seed: int = 29
    """Of building, start and noise, in the test split."""
    at: tuple[int, ...] = ()
    """Steps that are drawn; left out: six, from the first view to some steps after the last change of mind."""
    steps: int = 60
    """Actions."""
    hfov: float = 60.0
    """Horizontal field of view, degrees."""
    out: Path = Path("runs/ambiguity")
    """Name of the files, without extension."""


@dataclass(frozen=True)
class Moment:
    """What a panel shows."""

    picture: Image
    mass: float
    """Of the belief near the truth, 0..1."""
    error_m: float


def walk(options: Options) -> tuple[Rollout, list[Moment]]:
    """The episode, and a picture of every step."""
    env = FloorplanEnv(
        homes=options.homes, split="test", detector="oracle", renderer="none", width=640, height=480,
        hfov_deg=options.hfov,
    )  # fmt: skip
    moments: list[Moment] = []
    drawn: list[TopDown] = []

    def look(env: FloorplanEnv) -> None:
        now = env.snapshot()
        assert env.world is not None and env.world.observer is not None
        if not drawn:
            drawn.append(TopDown(env.world.plan, env.world.furniture, *PANEL))
        picture = drawn[0].draw(
            positions=now.positions, marginal=now.marginal, resolution=now.resolution, trail=now.trail,
            estimates=now.estimates[-1:], estimate=now.estimate,
        )  # fmt: skip
        mark_places(picture, drawn[0], np.asarray(now.positions), np.asarray(now.marginal))
        mass = float(env.world.observer.belief.mass_near(now.trail[-1], NEAR_M, math.pi))
        moments.append(Moment(picture, mass, now.scores[-1].error_m))

    try:
        walker = make_policy(options.policy)
        return rollout(env, options.seed, options.steps, policy=walker, name=options.policy, on_step=look), moments
    finally:
        env.close()


def mark_places(picture: Image, drawn: TopDown, positions: Image, marginal: Image) -> None:
    """Ring the places that hold much of the belief, and say how much: two cells of it would not show."""
    import cv2

    left = marginal.copy()
    for _ in range(MOST_RINGS):
        centre = positions[int(np.argmax(left))]
        near = np.hypot(*(positions - centre).T) < RING_M
        share = float(left[near].sum())
        if share < LEAST_RING:
            return
        left[near] = 0.0
        x, y = (round(v) for v in drawn.pixels(centre))
        radius = round(RING_M * drawn.px_per_m)
        cv2.circle(picture, (x, y), radius, RING, 2, cv2.LINE_AA)
        write(picture, (x + radius + 4, y), f"{100 * share:.0f} %", 15, RING, bold=True)


def chosen_steps(options: Options, taken: Rollout) -> list[int]:
    """The steps that are drawn."""
    if options.at:
        return list(options.at)
    settled = taken.steps_to(0.5)
    last = options.steps if settled is None else min(options.steps, settled + 2)
    return sorted({round(step) for step in np.linspace(0, last, 6)})


def strip(moments: Sequence[Moment], steps: Sequence[int]) -> Image:
    """The panels, three to a row."""
    width, height = PANEL
    columns = min(3, len(steps))
    rows = math.ceil(len(steps) / columns)
    sheet = np.full((rows * (height + TITLE_PX), columns * width, 3), PAPER, np.uint8)
    for i, step in enumerate(steps):
        moment = moments[step]
        top, left = (i // columns) * (height + TITLE_PX), (i % columns) * width
        sheet[top + TITLE_PX : top + TITLE_PX + height, left : left + width] = moment.picture
        off = "no estimate" if not math.isfinite(moment.error_m) else f"off by {moment.error_m:.1f} m"
        title = f"step {step}: {100 * moment.mass:.0f} % of the belief at the truth, {off}"
        write(sheet, (left + 20, top + TITLE_PX // 2 + 4), title, 17, INK, bold=True)
    return sheet


def main() -> None:
    """Run the script."""
    options = tyro.cli(Options, description=__doc__)
    try:
        if options.steps < 1 or any(not 0 <= step <= options.steps for step in options.at):
            expected = "at least 1 step, and --at from 0 to --steps"
            raise GalocError(f"--steps {options.steps} --at {options.at}", expected, "Pass such numbers.")
        if options.seed < 0:
            raise GalocError(f"--seed {options.seed}", "a seed from 0", "Pass such a number.")
        writable_folder(options.out.parent)
        taken, moments = walk(options)
    except GalocError as error:
        sys.exit(f"ambiguity: {error}")
    import imageio.v3 as imageio

    steps = chosen_steps(options, taken)
    picture = imageio.imwrite("<bytes>", strip(moments, steps), extension=".png")
    drawn, told = (options.out.with_name(options.out.name + suffix) for suffix in (".png", ".json"))
    write_atomic(drawn, picture)
    result = {
        "policy": options.policy, "homes": options.homes, "plan": taken.plan, "seed": options.seed,
        "steps_to_0.5m": taken.steps_to(0.5), "mass": [round(m.mass, 4) for m in moments],
        "error_m": [round(m.error_m, 3) for m in moments], "drawn": steps,
    }  # fmt: skip
    write_atomic(told, (json.dumps(jsonable(result), indent=1) + "\n").encode())
    held = taken.steps_to(0.5)
    found = "not within 0.5 m for good" if held is None else f"within 0.5 m and staying from step {held} on"
    print(f"{taken.plan}, {options.policy}: {found}")
    print(f"written  {drawn}, {told}")


if __name__ == "__main__":
    main()
