"""Take the photograph of the shipped flat that the README localizes: ``python -m scripts.make_photo``.

Writes assets/photos/apartment.jpg, the same bytes on every run on one machine: hFOV 80 degrees, camera level, 1.45 m
above the floor, at x 2.4 m, y 3.6 m, heading -30 degrees.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from galoc import Camera, Floorplan, assets
from galoc.formats.atomic import write_atomic
from galoc_env.imaging import Imaging
from galoc_env.render import make_renderer
from galoc_env.scene import build_scene

POSE = (2.4, 3.6, math.radians(-30.0))
HEIGHT_M = 1.45
CAMERA = Camera.from_hfov(640, 480, 80.0)
SEED = 0


def main() -> None:
    """Draw, develop and write."""
    scene = build_scene(Floorplan.load("apartment"), furniture=0.5, seed=SEED)
    frame = make_renderer("raster", scene, CAMERA, quality="best").render(POSE, HEIGHT_M, (0.0, 0.0), rgb_only=True)
    phone = Imaging.preset("phone").apply(np.ascontiguousarray(frame.rgb), CAMERA, np.random.default_rng(1))
    ok, jpeg = cv2.imencode(".jpg", cv2.cvtColor(phone, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 90])
    assert ok
    (assets.root() / "photos").mkdir(exist_ok=True)
    print(write_atomic(assets.root() / "photos" / "apartment.jpg", jpeg.tobytes()))


if __name__ == "__main__":
    main()
