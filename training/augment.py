"""Cheap changes to stored strips, so that a frame seen twice is not the same frame."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from training.stream import Frames

FLIP, COLOUR, PATCH, GREY, NOISE, BLUR = 0.5, 0.7, 0.3, 0.05, 0.3, 0.15
"""How often each change is made."""
MOST_BLUR = 4.0
"""Standard deviation of the strongest blur, columns: 2 degrees. What cannot be seen must be said to be unsure."""
MOST_PATCHES = 4
"""Things nobody modelled that stand in front of the wall: patches of one colour."""


def augmented(frames: Frames, rng: np.random.Generator) -> Frames:
    """A batch with flips, other colours, patches and noise; labels follow the flips."""
    rgb, mask, row, seen = frames.rgb.copy(), frames.mask.copy(), frames.row.copy(), frames.seen.copy()
    edges, semantic = frames.edges.copy(), frames.semantic.copy()
    columns = rgb.shape[2]
    flip = np.flatnonzero(rng.random(len(frames)) < FLIP)
    if len(flip):
        rgb[flip] = rgb[flip, :, ::-1]
        mask[flip] = np.packbits(np.unpackbits(mask[flip], axis=2)[:, :, :columns][:, :, ::-1], axis=2)
        row[flip], seen[flip], semantic[flip] = row[flip, :, ::-1], seen[flip, :, ::-1], semantic[flip, :, ::-1]
        edges[flip, :, 0] = columns - 1 - edges[flip, :, 0]
    for k in range(len(frames)):
        rgb[k] = _recoloured(rgb[k], rng)
        if rng.random() < PATCH:
            _patch(rgb[k], rng)
        covered = np.unpackbits(mask[k], axis=1)[:, :columns].astype(bool)
        rgb[k][~covered] = 0
    return Frames(rgb, mask, row, seen, edges, semantic)


def _recoloured(rgb: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Another tone curve per channel, by table; sometimes grey, blurred or noisy."""
    if rng.random() < COLOUR:
        gain, gamma = np.exp(rng.normal(0.0, (0.12, 0.12, 0.12))), np.exp(rng.normal(0.0, 0.25))
        lift = rng.uniform(-0.06, 0.06)
        x = np.arange(256) / 255.0
        table = np.clip(255.0 * (gain[None] * x[:, None] ** gamma + lift), 0, 255).astype(np.uint8)
        rgb = np.stack([table[:, c][rgb[..., c]] for c in range(3)], axis=-1)
        if rng.random() < 0.15:
            rgb = rgb[..., rng.permutation(3)]
    if rng.random() < GREY:
        rgb = np.repeat(rgb.mean(axis=2, keepdims=True).astype(np.uint8), 3, axis=2)
    if rng.random() < BLUR:
        rgb = np.asarray(cv2.GaussianBlur(rgb, (0, 0), float(rng.uniform(0.4, MOST_BLUR))), np.uint8)
    if rng.random() < NOISE:
        grain = rng.integers(-12, 13, rgb.shape[:2], dtype=np.int16)[..., None]
        rgb = np.clip(rgb.astype(np.int16) + (grain * rng.random()).astype(np.int16), 0, 255).astype(np.uint8)
    return rgb


def _patch(rgb: NDArray[np.uint8], rng: np.random.Generator) -> None:
    """Cover parts of a strip."""
    rows, columns = rgb.shape[:2]
    for _ in range(int(rng.integers(1, MOST_PATCHES + 1))):
        high, wide = int(rng.integers(3, 30)), int(rng.integers(3, 40))
        top, left = int(rng.integers(rows // 4, rows)), int(rng.integers(columns))
        colour = rng.integers(0, 256, 3)
        region = rgb[top : top + high, left : left + wide]
        if rng.random() < 0.5:
            region[:] = colour
        else:  # a piece of the same picture, elsewhere
            source = int(rng.integers(columns - wide)) if columns > wide else 0
            region[:] = rgb[top : top + region.shape[0], source : source + region.shape[1]].copy()
