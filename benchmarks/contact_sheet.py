"""Contact sheet: 24 pictures over plans, tilts, furnishings and cameras, and the same views drawn by OpenGL.

    python benchmarks/contact_sheet.py --out docs/figures/contact_sheet

Left: `raster` in its best quality, some pictures through cameras of poorer make. Right: the same scenes and
poses in `gl` (left out where there is no OpenGL). Writes OUT.jpg.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tyro
from numpy.typing import NDArray
from tqdm import tqdm

from galoc import Camera, Floorplan, GalocError
from galoc.formats.atomic import write_atomic
from galoc_env.film import writable_folder
from galoc_env.homes import generate
from galoc_env.imaging import Imaging
from galoc_env.motion import walkable
from galoc_env.render import make_renderer
from galoc_env.scene import Scene, build_scene

Image = NDArray[np.uint8]

PLANS = ("apartment", "house", "office", "gallery", None, None, None, None)
"""Of each column's scenes; None: a generated home."""
DENSITIES = (0.4, 1.0, 0.0, 0.7)
CAMERAS = ("none", "none", "phone", "none", "none", "poor", "none", "webcam")
STRIP = 20
"""Height of the caption, px."""
TRIES = 12
"""Poses tried for each picture; the one that shows most is kept, so that few stare at a wall."""


@dataclass(frozen=True)
class Options:
    """Command line."""

    count: int = 24
    """Pictures."""
    columns: int = 4
    """Pictures side by side in each half."""
    width: int = 320
    """Of one picture, px."""
    seed: int = 3
    """Of homes, poses and cameras."""
    out: Path = Path("runs/contact_sheet")
    """Result, without suffix."""


def main(options: Options) -> None:
    """Draw the sheet."""
    writable_folder(options.out.parent)
    camera = Camera.from_hfov(options.width, options.width * 3 // 4, 90)
    ours, theirs = [], []
    for k in tqdm(range(options.count), desc="pictures", unit="picture", disable=None):
        scene, label = _scene(k, options.seed)
        view, tilt_deg = _view(scene, camera, k, options.seed)
        imaging = Imaging.preset(CAMERAS[k % len(CAMERAS)])
        rgb = make_renderer("raster", scene, camera, quality="best").render(*view, rgb_only=True).rgb
        rgb = imaging.apply(rgb, camera, np.random.default_rng([options.seed, k, 2]), turn_rad=0.1, gravity=view[2])
        ours.append(_captioned(rgb, f"{label}, tilt {tilt_deg:.0f}, {CAMERAS[k % len(CAMERAS)]}"))
        theirs.append(_captioned(_by_gl(scene, camera, view), "gl"))
    halves = [_tiled(pictures, options.columns) for pictures in (ours, theirs)]
    gap = np.full((halves[0].shape[0], 12, 3), 255, np.uint8)
    sheet = np.hstack([halves[0], gap, halves[1]])
    done, data = cv2.imencode(".jpg", sheet[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])
    if not done:
        raise GalocError("a sheet that OpenCV cannot encode", "fewer or smaller pictures", "Lower --count or --width.")
    print(write_atomic(options.out.with_suffix(".jpg"), data.tobytes()))


def _scene(k: int, seed: int) -> tuple[Scene, str]:
    name, density = PLANS[k % len(PLANS)], DENSITIES[(k + k // len(DENSITIES)) % len(DENSITIES)]
    number = seed + k
    plan = generate(number) if name is None else Floorplan.load(name)
    scene = build_scene(plan, furniture=density, seed=number, shut_doors=0.3)
    return scene, f"{name or f'home {number}'}, furniture {density:g}"


def _view(scene: Scene, camera: Camera, k: int, seed: int) -> tuple[Any, float]:
    """A pose from which much is to be seen, and the larger of its tilt angles in degrees."""
    rng = np.random.default_rng([seed, k, 1])
    places = walkable(scene.plan, scene.obstacles).positions
    amplitude = math.radians((0.0, 3.0, 8.0, 15.0)[k % 4])
    gravity = tuple(rng.uniform(-1.0, 1.0, 2) * amplitude)
    renderer = make_renderer("raster", scene, Camera.from_hfov(80, 60, 90), quality="fast")
    best, most = None, -1.0
    for _ in range(TRIES):
        pose = (*places[rng.integers(len(places))], rng.uniform(-math.pi, math.pi))
        frame = renderer.render(pose, 1.4, gravity)
        shown = float(np.median(frame.depth)) * min(len(np.unique(frame.instance)), 20)
        if shown > most:
            best, most = (pose, 1.4, gravity), shown
    return best, math.degrees(max(abs(gravity[0]), abs(gravity[1])))


def _by_gl(scene: Scene, camera: Camera, view: Any) -> Image:
    try:
        renderer = make_renderer("gl", scene, camera)
    except GalocError:
        return np.full((camera.height, camera.width, 3), 128, np.uint8)
    try:
        return renderer.render(*view, rgb_only=True).rgb
    finally:
        renderer.close()


def _captioned(rgb: Image, text: str) -> Image:
    strip = np.full((STRIP, rgb.shape[1], 3), 255, np.uint8)
    scale = min(0.42, 0.42 * rgb.shape[1] / 320)
    cv2.putText(strip, text, (3, STRIP - 6), cv2.FONT_HERSHEY_SIMPLEX, scale, (40, 40, 40), 1, cv2.LINE_AA)
    return np.vstack([rgb, strip])


def _tiled(pictures: list[Image], columns: int) -> Image:
    blank = np.full_like(pictures[0], 255)
    padded = pictures + [blank] * (-len(pictures) % columns)
    return np.vstack([np.hstack(padded[i : i + columns]) for i in range(0, len(padded), columns)])


if __name__ == "__main__":
    try:
        main(tyro.cli(Options))
    except GalocError as error:
        raise SystemExit(str(error)) from None
