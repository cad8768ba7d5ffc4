"""The SE(2) search on noise-free views, and its parts."""

import math
from functools import cache

import numpy as np
import pytest

from galoc import Camera, Floorplan, Rays
from galoc.layout import solve_layout
from galoc.metrics import pose_error, wrap_angle
from galoc.peaks import APART_M, APART_RAD, MIN_RANGE, Peaks, distinct_peaks, refine, search
from galoc.profiles import profile_field
from galoc.rays import cast_rays
from galoc.score import score_volume
from galoc_env.truth import visible_wireframe

CAMERA = Camera.from_hfov(640, 480, 108)
PLAN = Floorplan.load("apartment")
FIELD = profile_field(PLAN, 0.1)


@cache
def frames(count: int = 60) -> list[tuple[np.ndarray, Rays, Peaks]]:
    """Noise-free views at whole-degree headings off the grid, each with its search."""
    rng, out = np.random.default_rng(0), []
    free = PLAN.free_space(0.1).positions(0.4)
    for _ in range(count):
        xy = free[rng.integers(len(free))] + rng.uniform(-0.04, 0.04, 2)
        pose = np.array([*xy, math.radians(int(rng.integers(360)))])
        gravity = tuple(rng.uniform(-0.08, 0.08, 2))
        wireframe = visible_wireframe(PLAN, CAMERA, pose, 1.4, gravity)
        rays = cast_rays(solve_layout(wireframe, CAMERA, gravity, "paper"), CAMERA)
        if rays.known.any():
            out.append((pose, rays, search(FIELD, rays)))
    return out


def test_noise_free_search_finds_the_pose() -> None:
    """On frames whose pose is unique: no candidate beyond 0.3 m scores within 2e-4 of the truth."""
    errors, turns = [], []
    for pose, rays, match in frames():
        heading = np.array([round(math.degrees(pose[2]))])
        truth = score_volume(FIELD.caster(pose[:2]), rays, heading)[0, 0]
        assert truth > 0.9999
        far = np.hypot(*(match.candidates[:, :2] - pose[:2]).T) > 0.3
        if not np.any(match.candidates[far, 3] > truth - 2e-4):
            distance, angle = pose_error(match.candidates[0, :3], pose)
            errors.append(distance)
            turns.append(angle)
    assert len(errors) >= 30
    assert np.median(errors) <= 0.02
    # A cell beside the true one can score higher at 0.1 m and take its place; the pose is then off by a cell at most.
    assert np.max(errors) <= 0.1 * math.sqrt(2.0) and np.max(turns) <= math.radians(1.01)
    assert np.mean(np.array(errors) <= 0.02) >= 0.8


def test_best_first_and_clear_of_walls() -> None:
    for _, _, match in frames():
        assert np.all(np.diff(match.candidates[:, 3]) <= 0.0)
        assert FIELD.caster(match.candidates[:, :2]).min() >= MIN_RANGE - 1e-6
        assert match.volume.shape == (len(FIELD.positions), 360)


@pytest.mark.parametrize("count", [1, 8, 32])
def test_distinct_peaks_are_apart(count: int) -> None:
    for _, _, match in frames()[:10]:
        peaks = distinct_peaks(FIELD, match.volume, count)
        assert 1 <= len(peaks) <= count and peaks[0, 3] == match.volume.max()
        assert np.all(np.diff(peaks[:, 3]) <= 0.0)
        for i, a in enumerate(peaks):
            for b in peaks[:i]:
                turn = abs(wrap_angle(a[2] - b[2]))
                assert np.hypot(*(a - b)[:2]) >= APART_M or turn >= APART_RAD


def test_refine_never_lowers_the_score() -> None:
    for _, rays, match in frames()[:15]:
        cells = distinct_peaks(FIELD, match.volume, 12)
        better = refine(FIELD, rays, cells)
        # 2e-3: the cell's centre itself is not on the 1 cm grid; it is tried up to 5 mm away.
        assert np.all(better[:, 3] >= cells[:, 3] - 2e-3)
        assert np.all(np.abs(better[:, :2] - cells[:, :2]) <= 0.1 + 0.02 + 0.011)
        np.testing.assert_allclose(better[:, :2], np.round(better[:, :2], 2), atol=1e-9)


def test_given_volume_is_used() -> None:
    _, rays, match = frames()[0]
    np.testing.assert_array_equal(search(FIELD, rays, volume=match.volume).candidates, match.candidates)
