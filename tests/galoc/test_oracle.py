"""The oracle's noise: its size, its independence, and what may not leave the image border."""

import math

import numpy as np
import pytest

from galoc import Camera, Floorplan, GalocError, Wireframe
from galoc.detect.oracle import OracleDetector, perturb
from galoc.types import BORDER
from galoc_env.truth import visible_wireframe

CAMERA = Camera.from_hfov(640, 480, 108)
PLAN = Floorplan.load("apartment")
PARTS = ("ceiling", "floor", "ceiling_cut", "floor_cut")


def views(count: int = 150) -> list[Wireframe]:
    rng = np.random.default_rng(0)
    free = PLAN.free_space(0.1).positions(0.4)
    poses = [np.array([*free[rng.integers(len(free))], rng.uniform(-np.pi, np.pi)]) for _ in range(count)]
    return [visible_wireframe(PLAN, CAMERA, pose, 1.4, tuple(rng.uniform(-0.06, 0.06, 2))) for pose in poses]


VIEWS = views()


def test_zero_noise_changes_no_byte() -> None:
    for w in VIEWS:
        out = perturb(w, CAMERA, 0.0, np.random.default_rng(0))
        for name in PARTS:
            assert (getattr(w, name) is None) == (getattr(out, name) is None)
            if getattr(w, name) is not None:
                assert getattr(out, name).tobytes() == getattr(w, name).tobytes()
        assert out.sigma_px is not None and not out.sigma_px.any()


@pytest.mark.parametrize("sigma", [1.0, 5.0])
def test_noise_is_gaussian_of_the_asked_size(sigma: float) -> None:
    rng = np.random.default_rng(1)
    moved = []
    for w in VIEWS:
        out = perturb(w, CAMERA, sigma, rng)
        both = w.ceiling_true & w.floor_true & (w.kind != BORDER)
        moved.append(np.hstack([out.ceiling - w.ceiling, out.floor - w.floor])[both])
        assert out.sigma_px is not None and np.all(out.sigma_px == sigma)
    noise = np.concatenate(moved) / sigma
    n = len(noise)
    assert n > 100
    # Five standard errors of mean, standard deviation and correlation.
    assert np.abs(noise.mean(axis=0)).max() < 5 / math.sqrt(n)
    assert np.abs(noise.std(axis=0) - 1.0).max() < 5 / math.sqrt(2 * n)
    assert np.abs(np.corrcoef(noise.T) - np.eye(4)).max() < 5 / math.sqrt(n)


def test_border_pairs_stay_on_the_edge_and_equal_their_cut() -> None:
    rng, border_ends = np.random.default_rng(2), 0
    for w in VIEWS:
        out = perturb(w, CAMERA, 5.0, rng)
        border = w.kind == BORDER
        for name, flag in (("ceiling", w.ceiling_true), ("floor", w.floor_true)):
            before, after = getattr(w, name), getattr(out, name)
            np.testing.assert_array_equal(after[border, 0], before[border, 0])
            np.testing.assert_array_equal(after[~flag, 1], before[~flag, 1])
            measured = (border & flag)[w.walls]
            np.testing.assert_array_equal(getattr(out, f"{name}_cut")[measured], after[w.walls][measured])
            assert np.all(after[border & flag, 1] != before[border & flag, 1])
            border_ends += np.count_nonzero(measured)
    assert border_ends > 50


def test_cuts_move_along_their_border_only() -> None:
    rng, moved = np.random.default_rng(3), {0: 0, 1: 0}
    for w in VIEWS:
        out = perturb(w, CAMERA, 5.0, rng)
        for name in ("ceiling_cut", "floor_cut"):
            before, after = getattr(w, name), getattr(out, name)
            flag = getattr(w, name.replace("cut", "true"))
            there = np.isfinite(before).all(axis=-1) & ~((w.kind == BORDER) & flag)[w.walls]
            for a, b in zip(before[there], after[there], strict=True):
                axis = 0 if min(abs(a[1] + 0.5), abs(a[1] - (CAMERA.height - 0.5))) < 1e-6 else 1
                assert b[1 - axis] == a[1 - axis] and b[axis] != a[axis]
                moved[axis] += 1
            np.testing.assert_array_equal(np.isnan(after).all(axis=-1)[~there & np.isnan(before).all(axis=-1)], True)
    assert moved[0] > 50


def test_same_seed_same_result() -> None:
    def run(seed: int) -> list[Wireframe]:
        frames = iter(VIEWS[:20])
        detector = OracleDetector(lambda: next(frames), 2.0, np.random.default_rng(seed))
        return [detector.detect(np.zeros((480, 640, 3), np.uint8), CAMERA, (0.0, 0.0)) for _ in range(20)]

    first, again, other = run(7), run(7), run(8)
    assert all(a.ceiling.tobytes() == b.ceiling.tobytes() for a, b in zip(first, again, strict=True))
    assert any(a.ceiling.tobytes() != b.ceiling.tobytes() for a, b in zip(first, other, strict=True))


def test_empty_stays_empty() -> None:
    assert len(perturb(Wireframe.empty(), CAMERA, 5.0, np.random.default_rng(0))) == 0


@pytest.mark.parametrize("sigma", [-1.0, math.nan, math.inf])
def test_bad_noise_is_refused(sigma: float) -> None:
    with pytest.raises(GalocError, match="noise"):
        perturb(VIEWS[0], CAMERA, sigma, np.random.default_rng(0))
