"""The data stream: homes are furnished, lit and photographed in worker processes, frames wait in shards on disk."""

from __future__ import annotations

import io
import math
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from galoc import Floorplan, GalocError
from galoc.detect.strip import upright_strip
from galoc.formats.atomic import write_atomic
from galoc_env.homes import generate
from galoc_env.imaging import Imaging
from galoc_env.render import make_renderer
from galoc_env.scene import Scene, build_scene
from training.labels import MOST_EDGES, label
from training.views import WIDTHS, Viewpoints, random_camera, strip_columns

SHARD = 256
"""Frames per shard."""
CAMERAS_PER_HOME, VIEWS_PER_CAMERA = 4, 40
"""A home takes some half a second to furnish and to light, a frame five milliseconds."""
TRAIN_HOMES = 600_000
"""Homes that training draws from; the last of the split's are kept for validation."""
STRETCHED_SHARE, MOST_STRETCH = 0.3, 2.4
"""Share of homes that are stretched, and how far at most."""
PLAIN_SHARE = 0.12
"""Share of frames that the sensor leaves as they were drawn."""


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """N labelled strips of one width W; C = W / 2. Rows of pairs are ceiling and floor."""

    rgb: NDArray[np.uint8]
    """(N, ROWS, W, 3)."""
    mask: NDArray[np.uint8]
    """(N, ROWS, W / 8) bits: where the image reaches."""
    row: NDArray[np.float16]
    """(N, 2, C) row coordinate of the boundary, NaN without wall."""
    seen: NDArray[np.uint8]
    """(N, 2, C) 0 outside the image, 1 inside but hidden, 2 visible."""
    edges: NDArray[np.float16]
    """(N, MOST_EDGES, 3) column coordinate, kind, share seen; NaN where there are no more."""
    semantic: NDArray[np.uint8]
    """(N, ROWS / 2, C)."""

    def __len__(self) -> int:
        """N."""
        return len(self.rgb)

    def pick(self, rows: NDArray[np.int64]) -> Frames:
        """Some of them."""
        return Frames(*(getattr(self, f.name)[rows] for f in fields(self)))

    @staticmethod
    def joined(parts: list[Frames]) -> Frames:
        """All of them."""
        return Frames(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Frames)))

    def save(self, path: Path) -> None:
        """Write a shard; it appears whole or not at all."""
        file = io.BytesIO()
        np.savez(file, **{f.name: getattr(self, f.name) for f in fields(self)})
        write_atomic(path, file.getvalue())

    @classmethod
    def load(cls, path: Path) -> Frames:
        """Read a shard."""
        with np.load(path) as file:
            return cls(*(file[f.name] for f in fields(cls)))


def photograph(scene: Scene, rng: np.random.Generator, cameras: int, views: int) -> Iterator[tuple[int, Frames]]:
    """Frames of a home, one at a time, each with the width of its strip."""
    viewpoints = Viewpoints(scene)
    for _ in range(cameras):
        camera = random_camera(rng)
        columns = strip_columns(camera)
        quality = "fast" if rng.random() < 0.25 else "default"
        renderer = make_renderer("raster", scene, camera, quality=quality)
        for _ in range(views):
            view = viewpoints.draw(rng)
            frame = renderer.render(view.pose, view.height_m, view.gravity)
            labels = label(scene, camera, view, frame, columns)
            strength = 0.0 if rng.random() < PLAIN_SHARE else float(rng.random())
            turn = float(rng.normal(0.0, 0.25))
            imaging = Imaging.random(rng, strength)
            if labels is None:
                continue
            rgb = imaging.apply(frame.rgb, camera, rng, turn_rad=turn, gravity=view.gravity)
            strip = upright_strip(rgb, camera, view.measured, columns)
            edges = np.full((MOST_EDGES, 3), np.nan, np.float16)
            edges[: len(labels.edges)] = labels.edges
            yield (
                columns,
                Frames(
                    strip.rgb[None],
                    np.packbits(strip.mask, axis=1)[None],
                    labels.row.astype(np.float16)[None],
                    (labels.in_frame.astype(np.uint8) + labels.visible)[None],
                    edges[None],
                    labels.semantic[None],
                ),
            )
        renderer.close()


def stretched(plan: Floorplan, rng: np.random.Generator) -> Floorplan:
    """The plan drawn larger along x and y, under a higher ceiling: halls and offices, which no generated home has."""
    x, y = np.exp(rng.uniform(math.log(0.9), math.log(MOST_STRETCH), 2)).tolist()
    factors = np.array([x, y, x, y])
    openings = tuple(
        replace(o, x1=x * o.x1, y1=y * o.y1, x2=x * o.x2, y2=y * o.y2, thickness=o.thickness * min(x, y))
        for o in plan.openings
    )
    outline = None if plan.outline is None else plan.outline * factors[:2]
    ceiling = plan.ceiling_height * float(rng.uniform(1.0, 1.4))
    return replace(plan, segments=plan.segments * factors, openings=openings, outline=outline, ceiling_height=ceiling)


def furnished(seed: int, rng: np.random.Generator) -> Scene:
    """A home of the train split, furnished anyhow; some are stretched to larger buildings."""
    plan = generate(seed, split="train")
    if rng.random() < STRETCHED_SHARE:
        plan = stretched(plan, rng)
    furniture = float(rng.beta(1.4, 1.2))
    shut = float(rng.choice([0.0, rng.uniform(0.0, 0.6)]))
    return build_scene(plan, furniture=furniture, seed=int(rng.integers(1 << 31)), shut_doors=shut)


def generate_forever(folder: Path, seed: int, most_shards: int, *, stop: Path, nice: int = 5) -> None:
    """Fill a folder with shards until a file ``stop`` appears or the parent is gone; the oldest shards make room.

    Args:
        folder: of the shards.
        seed: of this worker; no two workers may share one.
        most_shards: kept on disk by this worker.
        stop: ends the work when it exists.
        nice: how much the worker gives way to the trainer.
    """
    os.nice(nice)
    parent = os.getppid()
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng([seed, time.time_ns()])
    waiting: dict[int, list[Frames]] = {width: [] for width in WIDTHS}
    while not stop.exists() and os.getppid() == parent:
        try:
            scene = furnished(int(rng.integers(TRAIN_HOMES)), rng)
        except GalocError:  # a stretched home in which nobody can stand
            continue
        for width, frame in photograph(scene, rng, CAMERAS_PER_HOME, VIEWS_PER_CAMERA):
            waiting[width].append(frame)
        for width, frames in waiting.items():
            while len(frames) >= SHARD:
                Frames.joined(frames[:SHARD]).save(folder / f"w{width}-{seed:02d}-{time.time_ns()}.npz")
                del frames[:SHARD]
        mine = sorted(folder.glob(f"w*-{seed:02d}-*.npz"), key=lambda p: p.name.rsplit("-", 1)[1])
        for old in mine[: max(0, len(mine) - most_shards)]:
            old.unlink(missing_ok=True)


class Shuffler:
    """Batches of one width each, drawn from a window of shards in memory that moves over those on disk.

    Args:
        folder: of the shards.
        batch: frames per batch.
        rng: decides everything.
        window: shards of each width in memory.
        reuse: how often a frame is seen, on average, before its shard leaves the window.
    """

    def __init__(
        self, folder: Path, batch: int, rng: np.random.Generator, *, window: int = 10, reuse: float = 1.0
    ) -> None:
        self._folder, self._batch, self._rng = folder, batch, rng
        self._window, self._reuse = window, reuse
        self._held: dict[int, list[Frames]] = {width: [] for width in WIDTHS}
        self._drawn: dict[int, float] = dict.fromkeys(WIDTHS, 0.0)
        self._used: dict[str, int] = {}

    def on_disk(self) -> dict[int, list[Path]]:
        """Shards by width."""
        return {width: sorted(self._folder.glob(f"w{width}-*.npz")) for width in WIDTHS}

    def next(self) -> Frames:
        """One batch."""
        have = {width: len(paths) for width, paths in self.on_disk().items()}
        total = sum(have.values())
        shares = np.array([have[width] / total for width in WIDTHS])
        width = int(self._rng.choice(WIDTHS, p=shares))
        held = self._held[width]
        while len(held) < min(self._window, have[width]) or self._drawn[width] >= SHARD * self._reuse:
            fresh = self._fresh(width)
            if fresh is None:
                break
            held.append(fresh)
            if len(held) > self._window:
                held.pop(0)
            self._drawn[width] = max(0.0, self._drawn[width] - SHARD * self._reuse)
        self._drawn[width] += self._batch
        picks = self._rng.integers(len(held), size=4)
        part = math.ceil(self._batch / 4)
        return Frames.joined([held[k].pick(self._rng.integers(len(held[k]), size=part)) for k in picks])

    def _fresh(self, width: int) -> Frames | None:
        """A shard that was used least so far."""
        paths = self.on_disk()[width]
        if not paths:
            return None
        least = min(self._used.get(p.name, 0) for p in paths)
        choice = [p for p in paths if self._used.get(p.name, 0) == least]
        path = choice[int(self._rng.integers(len(choice)))]
        self._used[path.name] = least + 1
        try:
            return Frames.load(path)
        except (OSError, ValueError, KeyError):  # made room just now
            return None
