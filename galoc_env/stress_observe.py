"""What a stressed detector and IMU make of a true view: noise, wrong, one-sided and overlooked junctions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc_env.stress_scenes import HEIGHT, Condition, Scene

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

WRONG_PX = (30.0, 80.0)
"""How far a wrong junction lies from where it should be, px."""


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """One view as the solver gets it."""

    ceiling: Array
    """(n, 2) px; an unseen junction is given where its vertical leaves the image."""
    floor: Array
    """(n, 2) px."""
    ceiling_seen: BoolArray
    """(n,)."""
    floor_seen: BoolArray
    """(n,)."""
    gravity: Array
    """(2,) rad: measured roll and pitch."""
    walls: NDArray[np.int64]
    """(m, 2): walls between the remaining pairs, some of them two merged into one."""
    wrong: BoolArray
    """(n,): one of the pair's junctions was displaced."""


def observe(scene: Scene, condition: Condition, frame: int, seed: int) -> Observation:
    """Degrade a view. The same frame draws the same unit noise in every condition, so conditions compare in pairs.

    Args:
        scene: the truth.
        condition: noise levels and shares.
        frame: number of the view, part of the seed.
        seed: of the run.
    """
    n = len(scene.points)
    rng = np.random.default_rng([seed, frame, 23])
    gravity = scene.gravity + np.radians(condition.tilt_deg) * rng.standard_normal(2)
    pixels = np.stack([scene.ceiling, scene.floor]) + condition.sigma_px * rng.standard_normal((2, n, 2))
    chance, angle, size = rng.random((2, n)), rng.uniform(0.0, 2.0 * np.pi, (2, n)), rng.random((2, n))
    which = rng.random(n)
    overlooked, halved, side = rng.random(n), rng.random(n), rng.random(n)

    wrong = chance < condition.outlier_share
    order = np.argsort(which)[: condition.wrong_junctions]
    wrong[(chance[0, order] < 0.5).astype(int), order] = True
    shift = WRONG_PX[0] + size * (WRONG_PX[1] - WRONG_PX[0])
    pixels += (wrong * shift)[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    seen = np.ones((2, n), dtype=bool)
    one_sided = halved < condition.one_sided_share
    whole = np.argsort(halved)[::-1][:2]  # those least likely to be halved stay whole
    one_sided[whole] = False
    seen[(side < 0.5).astype(int), np.arange(n)] = ~one_sided
    for row, border in ((0, -0.5), (1, HEIGHT - 0.5)):
        other = pixels[1 - row]
        pixels[row] = np.where(seen[row][:, None], pixels[row], np.stack([other[:, 0], np.full(n, border)], axis=1))

    keep, walls = _merged(scene.walls, overlooked < condition.missed_share, n)
    kept = np.flatnonzero(keep)
    return Observation(
        pixels[0, kept],
        pixels[1, kept],
        seen[0, kept],
        seen[1, kept],
        gravity,
        np.searchsorted(kept, walls).astype(np.int64).reshape(-1, 2),
        np.any(wrong & seen, axis=0)[kept],
    )


def _merged(walls: NDArray[np.int64], overlooked: BoolArray, n: int) -> tuple[BoolArray, NDArray[np.int64]]:
    """Drop overlooked corners that join two walls, and make the two walls one."""
    keep = np.ones(n, dtype=bool)
    left = walls.copy()
    for corner in np.flatnonzero(overlooked):
        before, after = np.flatnonzero(left[:, 1] == corner), np.flatnonzero(left[:, 0] == corner)
        if len(before) == 1 and len(after) == 1 and keep.sum() > 2:
            left[before[0], 1] = left[after[0], 1]
            left = np.delete(left, after[0], axis=0)
            keep[corner] = False
    return keep, left
