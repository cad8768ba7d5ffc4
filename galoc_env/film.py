"""The picture of a step (view, plan, error so far) and the film made of such pictures."""

from __future__ import annotations

import contextlib
import math
import os
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc import Floorplan, GalocError
from galoc.overlay import CEILING_RGB, FLOOR_RGB, draw_wireframe
from galoc_env import topdown
from galoc_env.topdown import ESTIMATE, FAINT, INK, PAPER, TRUTH, Colour, write
from galoc_env.world import Snapshot

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

WIDTH, HEIGHT = 1280, 720
"""Size of a picture, px; even, as H.264 wants."""
_HEAD = 52
_VIEW_W, _VIEW_H = 640, 480
_GOOD_M = 0.5
"""Error drawn as the line to get under, m."""
_AXIS_M = (0.1, 0.5, 1.0, 5.0, 20.0)
"""Ticks of the logarithmic error axis, m."""


class Painter:
    """Paints the snapshots of one plan."""

    def __init__(self, plan: Floorplan, furniture: Array) -> None:
        self.plan = plan
        self._map = topdown.TopDown(plan, furniture, WIDTH - _VIEW_W, HEIGHT - _HEAD)

    def paint(self, snapshot: Snapshot) -> Image:
        """(720, 1280, 3) uint8 RGB: view with wireframe, error so far, plan with belief, truth and estimate."""
        picture = np.full((HEIGHT, WIDTH, 3), PAPER, np.uint8)
        self._header(picture[:_HEAD], snapshot)
        picture[_HEAD : _HEAD + _VIEW_H, :_VIEW_W] = _view(snapshot)
        _error_chart(picture[_HEAD + _VIEW_H :, :_VIEW_W], [s.error_m for s in snapshot.scores])
        plan = self._map.draw(
            positions=snapshot.positions,
            marginal=snapshot.marginal,
            resolution=snapshot.resolution,
            trail=snapshot.trail,
            estimates=snapshot.estimates,
            estimate=snapshot.estimate,
        )
        write(plan, (topdown.MARGIN_PX, 18), self._title(snapshot), 14, INK, bold=True)
        _legend(plan, snapshot)
        picture[_HEAD:, _VIEW_W:] = plan
        return picture

    def _title(self, snapshot: Snapshot) -> str:
        name = f"floorplan {self.plan.name}" if self.plan.name else "floorplan"
        return name if snapshot.estimate is None else f"{name}: where could the camera be?"

    def _header(self, strip: Image, snapshot: Snapshot) -> None:
        strip[:] = INK
        middle = strip.shape[0] // 2
        x = 18 + write(strip, (18, middle), f"step {snapshot.step}", 22, (255, 255, 255), bold=True)
        if snapshot.collided:
            write(strip, (x + 18, middle), "touching a wall", 16, (255, 160, 120))
        if snapshot.estimate is None or not snapshot.scores:
            return
        now = snapshot.scores[-1]
        found = math.isfinite(now.error_m)
        error = (
            f"error {now.error_m:.2f} m, {math.degrees(now.error_rad):.0f}\N{DEGREE SIGN}" if found else "no estimate"
        )
        colour: Colour = (120, 230, 150) if now.error_m < _GOOD_M else (255, 190, 110)
        write(strip, (WIDTH // 2 + 22, middle), error, 22, colour, bold=True)
        coverage = 0.0 if snapshot.estimate.rays is None else snapshot.estimate.rays.coverage
        facts = f"walls recovered in {100.0 * coverage:.0f} % of the view"
        if snapshot.estimate.abstained:
            facts = "nothing recovered from this view"
        write(strip, (WIDTH - 18, middle), facts, 15, (214, 220, 228), anchor="rm")


def _view(snapshot: Snapshot) -> Image:
    """(480, 640, 3): the camera image with its wireframe, letterboxed."""
    import cv2

    out = np.full((_VIEW_H, _VIEW_W, 3), 24, np.uint8)
    camera = snapshot.camera
    scale = min(_VIEW_W / camera.width, _VIEW_H / camera.height)
    width, height = max(1, round(camera.width * scale)), max(1, round(camera.height * scale))
    if snapshot.image is None:
        frame = np.full((height, width, 3), 70, np.uint8)
        write(frame, (width // 2, 20), "image not drawn (renderer none)", 14, (200, 200, 200), anchor="mm")
    else:
        mode = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC
        frame = np.asarray(cv2.resize(snapshot.image, (width, height), interpolation=mode), dtype=np.uint8)
    frame = draw_wireframe(frame, snapshot.wireframe.resized(width / camera.width, height / camera.height))
    left, top = (_VIEW_W - width) // 2, (_VIEW_H - height) // 2
    out[top : top + height, left : left + width] = frame
    _caption(out, f"camera view, {snapshot.wireframe_source}")
    return out


def _caption(image: Image, text: str) -> None:
    """White text on a dark veil in the lower left corner."""
    import cv2

    height = image.shape[0]
    veil = image[height - 26 :, :]
    veil[:] = cv2.addWeighted(veil, 0.35, np.zeros_like(veil), 0.65, 0.0)
    write(image, (12, height - 13), text, 14, (255, 255, 255))
    x = image.shape[1] - 12
    for label, colour in (("floor", FLOOR_RGB), ("ceiling", CEILING_RGB)):
        x -= write(image, (x, height - 13), label, 14, colour, bold=True, anchor="rm") + 14


def _error_chart(panel: Image, errors_m: list[float]) -> None:
    """Position error over the steps on a log axis, with the 0.5 m line."""
    import cv2

    panel[:] = (255, 255, 255)
    height, width = panel.shape[:2]
    left, right, top, bottom = 64, width - 16, 30, height - 16
    write(panel, (12, 15), "position error over the steps", 14, INK, bold=True)
    low, high = math.log(0.04), math.log(30.0)

    def row(error: float) -> float:
        return bottom - (bottom - top) * (math.log(min(max(error, 0.04), 30.0)) - low) / (high - low)

    for tick in _AXIS_M:
        y = round(row(tick))
        good = tick == _GOOD_M
        cv2.line(panel, (left, y), (right, y), TRUTH if good else (226, 229, 233), 2 if good else 1)
        write(panel, (left - 8, y), f"{tick:g} m", 12, TRUTH if good else FAINT, bold=good, anchor="rm")
    if not errors_m:
        write(panel, ((left + right) // 2, (top + bottom) // 2), "no localizer", 14, FAINT, anchor="mm")
        return
    span = max(60, len(errors_m) - 1)
    points = [(left + (right - left) * i / span, row(e)) for i, e in enumerate(errors_m)]
    fixed = np.round(np.array(points) * 16).astype(np.int32)
    cv2.polylines(panel, [fixed], False, ESTIMATE, 2, cv2.LINE_AA, 4)
    cv2.circle(panel, tuple(int(v) for v in fixed[-1]), 5 << 4, ESTIMATE, -1, cv2.LINE_AA, 4)


def _legend(plan: Image, snapshot: Snapshot) -> None:
    """Names of what the map shows, on one line at the bottom right."""
    import cv2

    y, x = plan.shape[0] - 16, plan.shape[1] - 16
    entries: list[tuple[str, Colour]] = [("true pose", TRUTH)]
    if snapshot.estimate is not None:
        entries += [("estimate + walls it sees", ESTIMATE)]
    if snapshot.marginal is not None:
        entries += [("belief", topdown.HEAT[3])]
    for text, colour in reversed(entries):
        x -= write(plan, (x, y), text, 13, INK, anchor="rm") + 10
        cv2.circle(plan, (x, y), 6, colour, -1, cv2.LINE_AA)
        x -= 18


def writable_folder(path: str | Path) -> Path:
    """Make a folder that files can be written into.

    Raises:
        GalocError: it cannot be made or written.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise GalocError(
            f"output folder {str(folder)!r} ({error.strerror})", "a folder to write to", "Choose another --out."
        ) from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise GalocError(
            f"output folder {str(folder)!r}, which is read-only", "a folder to write to", "Choose another --out."
        )
    return folder


def temporary(target: Path) -> Path:
    """Name of the temporary file beside a target: same suffix, hidden, this process's own."""
    return target.with_name(f".{target.stem}.{os.getpid()}.part{target.suffix}")


class Film:
    """An H.264 film that appears under its name only when it is complete (a context manager)."""

    def __init__(self, path: Path, fps: int) -> None:
        self.path, self.fps = path, fps
        self._part = temporary(path)
        self._writer: Any = None

    def __enter__(self) -> Film:
        """Nothing is opened before the first picture."""
        return self

    def add(self, picture: Image) -> None:
        """Append one picture (H, W, 3) uint8 RGB with even sides."""
        if self._writer is None:
            import imageio_ffmpeg

            height, width = picture.shape[:2]
            self._writer = imageio_ffmpeg.write_frames(
                str(self._part), (width, height), fps=self.fps, codec="libx264", pix_fmt_out="yuv420p", quality=None,
                output_params=["-crf", "20", "-preset", "veryfast", "-movflags", "+faststart"], macro_block_size=2,
                ffmpeg_log_level="error",
            )  # fmt: skip
            self._writer.send(None)
        self._writer.send(np.ascontiguousarray(picture))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish and publish the film, or drop it after an error."""
        try:
            if self._writer is not None and kind is None:
                self._writer.close()
                os.replace(self._part, self.path)
            elif self._writer is not None:
                # Ctrl-C reaches ffmpeg too; what it says about that must not hide the first error.
                with contextlib.suppress(OSError):
                    self._writer.close()
        finally:
            self._part.unlink(missing_ok=True)
