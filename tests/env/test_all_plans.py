"""Every plan at hand goes all the way: load, draw, furnish, render, walk and be localized.

Run as a program (`python tests/env/test_all_plans.py PLAN STEPS FOLDER`) it does this for one plan and prints what
came out and what it cost as JSON; the large plans are tested in such a child, so that its memory can be measured.
"""

import json
import math
import resource
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from galoc import Floorplan, assets
from galoc.plot import save_plan_figure
from galoc_env.env import FloorplanEnv
from galoc_env.motion import BODY_RADIUS, distances
from galoc_env.play import rollout

SHIPPED = ("apartment", "corridor", "gallery", "house", "office")
PUBLISHED = (
    "amrl_maps/NSH1.json",
    "amrl_maps/GHC4.json",
    "amrl_maps/NYU19.json",
    "wrld_westport/westport-house-floor-1.json",
    "ifc_duplex/Duplex_Architecture_1_Level-1.json",
    "utexas_gdc/raw/gdc_1.yaml",
)
STEPS = 30
PEAK_LIMIT_GB = 6.0
"""What an 8 GB machine can spare, 1e9 bytes."""


def all_the_way(plan: str, steps: int, folder: Path) -> dict:
    """Load, draw, render and walk one plan; the facts of it, for JSON."""
    clock = [time.monotonic()]
    loaded = Floorplan.load(plan)
    clock.append(time.monotonic())
    drawing = cv2.imread(str(save_plan_figure(loaded, folder / "plan.png")))
    clock.append(time.monotonic())
    seen, stamps = [], []

    def on_step(env):
        poses, episode = env.world, env.episode
        stamps.append(time.monotonic())
        seen.append(
            {
                "image_sd": float(episode.image.std()),
                "clearance_m": float(distances(episode.moved.pose[:2], poses.obstacles).min()),
                "free": bool(loaded.free_space(0.05).clearance_at(episode.moved.pose[:2]) > 0.0),
                "belief_mass": float(np.sum(poses.observer.belief.position_marginal())),
            }
        )

    env = FloorplanEnv(plan=plan, detector="oracle", width=160, height=120, render_mode="rgb_array")
    walk = rollout(env, 0, steps, on_step=on_step)
    picture = env.render()
    env.close()
    return {
        "segments": len(loaded.segments),
        "bounds": loaded.bounds,
        "drawing_sd": float(drawing.std()),
        "picture": [list(picture.shape), float(picture.std())],
        "seen": seen,
        "found": [s.estimate for s in walk.steps],
        "travelled_m": sum(math.dist(a.pose[:2], b.pose[:2]) for a, b in zip(walk.steps, walk.steps[1:], strict=False)),
        "errors_m": [s.error_m if math.isfinite(s.error_m) else None for s in walk.steps],
        "seconds": {
            "load": clock[1] - clock[0],
            "draw": clock[2] - clock[1],
            "reset": stamps[0] - clock[2],
            "step": (stamps[-1] - stamps[0]) / steps,
        },
        # KiB on Linux, bytes on macOS.
        "peak_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e9,
    }


def check(facts: dict, steps: int) -> None:
    """What holds on every plan."""
    x_min, y_min, x_max, y_max = facts["bounds"]
    assert facts["drawing_sd"] > 5.0  # walls on a light ground
    shape, sd = facts["picture"]
    assert tuple(shape) == (720, 1280, 3) and sd > 20.0
    assert len(facts["seen"]) == steps + 1
    for now in facts["seen"]:
        # Even a close look at a bare wall has the shading of its corners or of the light.
        assert now["image_sd"] > 0.3
        assert now["clearance_m"] >= BODY_RADIUS - 1e-5 and now["free"]
        assert now["belief_mass"] == pytest.approx(1.0, abs=1e-4)  # float32 sums over up to a million cells
    if steps >= STEPS:  # a short walk may still be looking around
        assert facts["travelled_m"] > 0.0
    found = [pose for pose in facts["found"] if pose is not None]
    assert found, "no observation showed any structure"
    for x, y, heading in found:
        assert x_min <= x <= x_max and y_min <= y <= y_max and abs(heading) <= math.pi + 1e-9


def in_a_child(plan: str, steps: int, folder: Path) -> dict:
    """:func:`all_the_way` in a process of its own."""
    command = [sys.executable, "-W", "error", __file__, plan, str(steps), str(folder)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


def test_the_list_of_shipped_plans_is_complete():
    assert assets.plan_names() == sorted(SHIPPED)


@pytest.mark.parametrize("name", ["gallery", "house"])
def test_shipped_plan(name, tmp_path):
    check(all_the_way(name, 5, tmp_path), 5)


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_plan_over_a_walk(name, tmp_path):
    check(all_the_way(name, STEPS, tmp_path), STEPS)


@pytest.mark.slow
@pytest.mark.parametrize("name", PUBLISHED)
def test_published_plan(name, shared_plans, tmp_path):
    if not (shared_plans / name).is_file():
        pytest.skip(f"{name} is not among the published plans on this machine")
    facts = in_a_child(str(shared_plans / name), STEPS, tmp_path)
    check(facts, STEPS)
    # A child's peak starts at what its parent held when it forked, so this can only be too strict.
    assert facts["peak_gb"] < PEAK_LIMIT_GB


if __name__ == "__main__":
    print(json.dumps(all_the_way(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]))))
