"""Pictures of what the learned detector finds: some drawn by lot, and its worst, each beside the truth.

    python benchmarks/gallery.py --out runs/gallery

Photographs of furnished test homes, as in detector.py. Writes OUT.json (IoU of each), OUT.png (by lot) and
OUT_failures.png (lowest mask IoU among those that show a wall line).
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # photographs use training/, which is not installed

import cv2
import numpy as np
import tyro
from common import write
from numpy.typing import NDArray
from photos import Condition, Photo, furnished_plan, photographs

from galoc import GalocError
from galoc.detect.onnx import OnnxDetector
from galoc.formats.atomic import write_atomic
from galoc.plot_detect import draw_detection
from galoc.types import Wireframe
from galoc.wireframe import layout_mask, mask_iou
from galoc_env.film import writable_folder

Image = NDArray[np.uint8]

SIGHTED = 0.1
"""Share of columns with a visible wall line from which a photograph may be shown."""
TILE = (400, 300)
"""Size of one picture, px."""


def looked(homes: int, frames: int, seed: int) -> list[tuple[float, Photo, Wireframe]]:
    """Mask IoU, photograph and found wireframe of all photographs with something to see."""
    from tqdm import tqdm

    detector, found = OnnxDetector(), []
    for home in tqdm(range(homes), unit="home"):
        condition = Condition()
        for photo in photographs(furnished_plan(home, condition), condition, frames, [seed, home]):
            if photo.labels.visible.any(axis=0).mean() < SIGHTED:
                continue
            wireframe = detector.detect(photo.image, photo.camera, photo.view.measured)
            truth = layout_mask(photo.truth, photo.camera)
            found.append((mask_iou(layout_mask(wireframe, photo.camera), truth), photo, wireframe))
    return found


def sheet(shown: list[tuple[float, Photo, Wireframe]], pairs: int) -> bytes:
    """PNG of rows of (found, truth) pairs."""
    tiles = []
    for iou, photo, wireframe in shown:
        found = draw_detection(photo.image, wireframe, caption=f"found: mask IoU {iou:.2f}")
        truth = draw_detection(photo.image, photo.truth, caption="truth")
        tiles.append(np.hstack([_tile(found), _tile(truth)]))
    blank = np.full_like(tiles[0], 255)
    tiles += [blank] * (-len(tiles) % pairs)
    rows = [np.hstack(tiles[i : i + pairs]) for i in range(0, len(tiles), pairs)]
    ok, png = cv2.imencode(".png", cv2.cvtColor(np.vstack(rows), cv2.COLOR_RGB2BGR), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    assert ok
    return png.tobytes()


def _tile(picture: Image) -> Image:
    small = cv2.resize(picture, TILE, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.copyMakeBorder(small, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=(255, 255, 255)), np.uint8)


def main(
    homes: int = 40, frames: int = 6, count: int = 8, pairs: int = 2, seed: int = 0, out: Path = Path("runs/gallery")
) -> None:
    """Look, draw and write.

    Args:
        homes: Test homes.
        frames: Photographs per home.
        count: Pictures on each sheet.
        pairs: Pictures in a row, each beside the truth.
        seed: Of poses, noise and lot.
        out: Path without suffix.
    """
    if min(homes, frames, count, pairs) < 1:
        raise GalocError(f"--homes {homes} --frames {frames} --count {count} --pairs {pairs}", "1 or more", "Raise it.")
    writable_folder(out.parent)
    found = looked(homes, frames, seed)
    if not found:
        raise GalocError(f"{homes * frames} photographs that show no wall line", "some that do", "Raise --homes.")
    order = np.argsort([iou for iou, _, _ in found])
    lot = np.random.default_rng(seed).permutation(len(found))[:count]
    write_atomic(Path(f"{out}_failures.png"), sheet([found[i] for i in order[:count]], pairs))
    result: dict[str, Any] = {"iou": [iou for iou, _, _ in found], "settings": {"homes": homes, "frames": frames}}
    write(out, result, sheet([found[i] for i in lot], pairs))
    values = np.array(result["iou"])
    print(
        f"{len(values)} photographs that show a wall line: mask IoU mean {values.mean():.3f}, worst {values.min():.2f}"
    )


if __name__ == "__main__":
    try:
        tyro.cli(main)
    except GalocError as error:
        raise SystemExit(f"error: {error}") from None
