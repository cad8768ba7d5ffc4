"""Make the frames that ``galoc detect --check`` tries a model on: ``python -m scripts.make_check_frames``.

Furnished homes of the test split, which no training has seen, drawn by the raster renderer, with their truth beside
them in assets/check. The same bytes on every run.
"""

from __future__ import annotations

import json
import math
from typing import Any

import cv2
import numpy as np

from galoc import Camera, Wireframe, assets
from galoc.detect.check_frames import FORMAT
from galoc.detect.strip import columns_for, elevation_of
from galoc.formats.atomic import write_atomic
from galoc_env import homes
from galoc_env.motion import walkable
from galoc_env.render import make_renderer
from galoc_env.scene import build_scene
from galoc_env.truth import visible_wireframe
from training.labels import Labels, label
from training.views import View

FRAMES = (
    # seed of the home, width, height (px), field of view, furniture density, largest tilt (degrees)
    (11, 320, 240, 108.0, 0.3, 0.0),
    (12, 320, 240, 108.0, 0.6, 4.0),
    (13, 320, 240, 100.0, 0.5, 10.0),
    (14, 320, 240, 75.0, 0.4, 3.0),
    (15, 320, 180, 90.0, 0.5, 4.0),
    (16, 240, 320, 60.0, 0.4, 5.0),
    (17, 240, 240, 90.0, 0.7, 8.0),
    (18, 320, 240, 65.0, 0.3, 2.0),
)
QUALITY = 90
"""Of the JPEG files."""
CLEARANCE_M = 0.5
"""No frame is taken nearer to a wall or a cupboard."""
LEAST_VISIBLE = 0.35
"""Share of a frame's boundary that has to be seen: a blind frame tells nothing of a model."""
TRIES = 60


def main() -> None:
    """Write all frames and ``truth.json``."""
    folder = assets.root() / "check"
    folder.mkdir(exist_ok=True)
    truth = []
    for number, (seed, width, height, hfov_deg, furniture, tilt_deg) in enumerate(FRAMES):
        camera = Camera.from_hfov(width, height, hfov_deg)
        picture, entry = _frame(seed, camera, furniture, math.radians(tilt_deg))
        name = f"{number}.jpg"
        write_atomic(folder / name, picture)
        truth.append({"image": name, "width": width, "height": height, "hfov_deg": hfov_deg, **entry})
        print(f"{name}  {len(picture) / 1000:.0f} kB  {len(entry['wireframe']['walls'])} walls")
    text = json.dumps({"format": FORMAT, "frames": truth}, separators=(",", ":"))
    write_atomic(folder / "truth.json", (text.replace('{"image"', '\n{"image"') + "\n").encode())
    print(f"{sum(path.stat().st_size for path in folder.iterdir()) / 1000:.0f} kB in all")


def _frame(seed: int, camera: Camera, furniture: float, tilt_rad: float) -> tuple[bytes, dict[str, Any]]:
    """The first view of a home that shows enough, as a JPEG, and its truth."""
    rng = np.random.default_rng(seed)
    plan = homes.generate(seed, split="test")
    scene = build_scene(plan, furniture=furniture, seed=seed)
    places = walkable(plan, np.asarray(scene.obstacles).reshape(-1, 4), CLEARANCE_M).positions
    renderer = make_renderer("raster", scene, camera)
    for _ in range(TRIES):
        pose = np.array([*places[rng.integers(len(places))], rng.uniform(-math.pi, math.pi)])
        roll, pitch = np.round(np.degrees(rng.uniform(-tilt_rad, tilt_rad, 2)), 2)
        height_m = round(float(rng.uniform(1.2, 1.6)), 2)
        gravity = math.radians(roll), math.radians(pitch)
        frame = renderer.render(pose, height_m, gravity)
        found = label(scene, camera, View(pose, height_m, gravity, gravity), frame, columns_for(camera))
        if found is None or not _tells(found, 2 if camera.hfov_deg > 80.0 else 1):
            continue
        wireframe = visible_wireframe(scene.sight_plan or plan, camera, pose, height_m, gravity)
        _, data = cv2.imencode(".jpg", frame.rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        truth = {"roll_deg": float(roll), "pitch_deg": float(pitch), "height_m": height_m}
        ceiling_m = {"ceiling_height_m": plan.ceiling_height}
        return data.tobytes(), {**truth, **ceiling_m, **_columns(found), "wireframe": _plain(wireframe)}
    raise SystemExit(f"home {seed} has no view that shows enough")


def _tells(found: Labels, least_edges: int) -> bool:
    """Whether enough of a frame's boundary and edges is seen."""
    inside = found.in_frame.any(axis=0)
    seen = found.visible.any(axis=0)
    enough = seen.sum() >= LEAST_VISIBLE * max(inside.sum(), 30)
    return bool(enough and np.count_nonzero(found.edges[:, 2] > 0.5) >= least_edges)


def _columns(found: Labels) -> dict[str, Any]:
    elevation = np.degrees(elevation_of(found.row.astype(np.float64)))
    return {
        "elevation_deg": [[None if math.isnan(v) else round(v, 2) for v in row] for row in elevation.tolist()],
        "visible": ["".join(str(int(v)) for v in row) for row in found.visible],
        "in_frame": ["".join(str(int(v)) for v in row) for row in found.in_frame],
    }


def _plain(wireframe: Wireframe) -> dict[str, Any]:
    """The wireframe as JSON values: pixels to 0.01, NaN as null."""
    names = ("ceiling", "floor", "ceiling_true", "floor_true", "walls", "kind", "ceiling_cut", "floor_cut")
    return {name: _rounded(np.asarray(getattr(wireframe, name)).tolist()) for name in names}


def _rounded(value: Any) -> Any:
    if isinstance(value, list):
        return [_rounded(part) for part in value]
    if isinstance(value, float):
        return None if math.isnan(value) else round(value, 2)
    return value


if __name__ == "__main__":
    main()
