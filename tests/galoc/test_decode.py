"""The decoder: its kernels against plain numpy, true columns against the true wireframe, and what errors may do."""

import math
from dataclasses import replace

import numpy as np
import pytest

from galoc import Camera, Floorplan, GalocError, Wireframe, solve_layout
from galoc.detect._segment_kernel import SHORTEST, best_cut, merged
from galoc.detect._wall_fit_kernel import fit_line
from galoc.detect.breaks import break_at, break_costs
from galoc.detect.decode import DecodeConfig, decode
from galoc.detect.evidence import evidence_of
from galoc.detect.frame import frame_borders
from galoc.types import BORDER, CORNER, OCCLUSION
from galoc.wireframe import layout_mask, mask_iou
from galoc_env.truth import visible_wireframe
from galoc_env.truth_columns import true_columns

CAMERA = Camera.from_hfov(640, 480, 108)
LEVEL = (0.0, 0.0)
ROOM = [[0, 0, 6, 0], [6, 0, 6, 4], [6, 4, 0, 4], [0, 4, 0, 0], [4, 0, 4, 1]]
"""6 x 4 m with a 1 m deep screen on the right of a camera that looks along x."""
POSE = (1.0, 2.0, 0.0)


def room() -> Floorplan:
    return Floorplan.from_segments(np.array(ROOM, float), ceiling_height=2.5)


def apartment_views(count: int, seed: int) -> list[tuple[np.ndarray, tuple[float, float]]]:
    rng = np.random.default_rng(seed)
    positions = Floorplan.load("apartment").free_space(0.1).positions(0.5)
    return [
        (
            np.array([*positions[rng.integers(len(positions))], rng.uniform(-np.pi, np.pi)]),
            (float(rng.uniform(-0.1, 0.1)), float(rng.uniform(-0.1, 0.1))),
        )
        for _ in range(count)
    ]


def squares(m: np.ndarray, s: np.ndarray, weight: np.ndarray, lo: int, hi: int) -> float:
    """Weighted squares that the best line leaves, by numpy's least squares."""
    root = np.sqrt(weight[:, lo:hi]).ravel()
    x = np.tile(m[lo:hi], 2)
    design = np.stack([root, root * x], axis=1)
    found = np.linalg.lstsq(design, root * s[:, lo:hi].ravel(), rcond=None)[0]
    return float(np.sum((root * s[:, lo:hi].ravel() - design @ found) ** 2))


@pytest.mark.parametrize("seed", range(4))
def test_the_cut_is_the_best_of_all(seed: int) -> None:
    """Against every possible cut of 11 columns; equal cost to 1e-4 of it (the ridge of the fits)."""
    rng = np.random.default_rng(seed)
    count, temper = 11, 2.0
    m = np.sort(rng.uniform(-1.0, 1.0, count))
    s = np.where(m < rng.uniform(-0.3, 0.3), 0.5 + 0.2 * m, 0.9 - 0.4 * m) + 0.03 * rng.standard_normal((2, count))
    weight = rng.uniform(100.0, 1500.0, (2, count))
    breaks = rng.uniform(0.5, 4.0, count)

    def cost(bounds: list[int]) -> float:
        pieces = zip(bounds[:-1], bounds[1:], strict=True)
        left = sum(squares(m, s, weight, lo, hi) for lo, hi in pieces) / (2.0 * temper)
        return left + sum(breaks[b] for b in bounds[1:-1])

    every = [[0, *(c for c in range(1, count) if code >> (c - 1) & 1), count] for code in range(2 ** (count - 1))]
    least = min(cost(bounds) for bounds in every if min(np.diff(bounds)) >= SHORTEST)
    found = best_cut(m, s, weight, breaks, temper).tolist()
    assert found[0] == 0 and found[-1] == count
    assert cost(found) == pytest.approx(least, rel=1e-4)


def test_line_and_its_covariance_are_those_of_dense_algebra() -> None:
    """Weighted least squares with prior, and the covariance that errors with correlation keep^|i - j| give it."""
    rng = np.random.default_rng(3)
    count, keep = 30, 0.8
    m = np.linspace(-0.4, 0.7, count)
    sd = rng.uniform(0.01, 0.03, (1, count))
    belongs = rng.uniform(0.2, 1.0, (1, count))
    y = 0.6 + 0.3 * m[None] + 1e-3 * rng.standard_normal((1, count))
    prior, prior_sd, out = np.array([0.5, 0.1]), np.array([0.2, 0.3]), np.empty(6)
    fit_line(m, y, sd, belongs, 0, count, keep, prior, prior_sd, out)
    temper = (1.0 + keep) / (1.0 - keep)
    weight = (belongs / sd**2 / temper)[0]
    design = np.stack([np.ones(count), m - out[0]], axis=1)
    precision = np.diag(prior_sd**-2.0)
    middle = 0.5 * (m[0] + m[-1])
    expected = np.array([prior[0] + prior[1] * (out[0] - middle), prior[1]])
    inverse = np.linalg.inv(design.T @ (weight[:, None] * design) + precision)
    np.testing.assert_allclose(out[1:3], inverse @ (design.T @ (weight * y[0]) + precision @ expected), rtol=1e-9)
    errors = sd.T @ sd * keep ** np.abs(np.arange(count)[:, None] - np.arange(count))
    spread = inverse @ (design.T @ (weight[:, None] * errors * weight) @ design + precision) @ inverse
    np.testing.assert_allclose([out[3], out[4], out[5]], [spread[0, 0], spread[0, 1], spread[1, 1]], rtol=1e-9)


def test_a_run_of_wrong_columns_is_healed() -> None:
    """A straight wall with six columns elsewhere in one row: cut out by the least squares, joined again robustly."""
    count = 60
    m = np.tan(np.radians(np.arange(count) - 30.0))
    s = np.tile(0.5 + 0.1 * m, (2, 1))
    s[1, 25:31] += 0.3
    sd, odds = np.full((2, count), 0.02), np.full((2, count), 0.01)
    nothing, breaks = np.full((2, count), np.nan), np.full(count, 6.0)
    cut = best_cut(m, s, sd**-2.0, breaks, 4.0)
    assert len(cut) > 2
    healed = merged(m, s, sd, nothing, nothing, odds, sd**-2.0, breaks, cut, 4.0)
    assert healed.tolist() == [0, count]


@pytest.mark.parametrize("gravity", [LEVEL, (0.1, -0.15)])
def test_borders_are_on_the_border(gravity: tuple[float, float]) -> None:
    """Points at the returned heights project onto the edge of the image, to 1e-6 px."""
    m = np.tan(np.radians(np.linspace(-45.0, 45.0, 19)))
    borders = frame_borders(m, CAMERA, gravity)
    assert np.isfinite(borders).all()
    for row, sign in ((0, -1.0), (1, 1.0)):
        u, v = CAMERA.project_level(np.stack([m, sign * borders[row], np.ones_like(m)], axis=1), gravity).T
        off = np.minimum.reduce([np.abs(u + 0.5), np.abs(u - 639.5), np.abs(v + 0.5), np.abs(v - 479.5)])
        assert off.max() < 1e-6


def test_edge_peaks_are_found_between_columns() -> None:
    """A bump of the width that networks are trained on gives its place to 0.02 degrees."""
    columns = true_columns(room(), CAMERA, POSE, 1.5, LEVEL)
    wanted = math.atan2(-2.0, 5.0)  # the far left corner
    after = int(np.searchsorted(columns.azimuths, wanted))
    cut = break_at(columns, after)
    assert abs(cut.azimuth - wanted) < math.radians(0.02)
    assert cut.corner_logit > 2.0
    costs = break_costs(columns)
    assert costs[after] < 0.5 * np.median(costs)


def test_hand_made_view() -> None:
    """Every kind of end, in its true place to 1 px."""
    true = visible_wireframe(room(), CAMERA, POSE, 1.4)
    found = decode(true_columns(room(), CAMERA, POSE, 1.4, LEVEL), CAMERA, LEVEL)
    assert found.kind.tolist() == true.kind.tolist() == [BORDER, CORNER, OCCLUSION, CORNER, CORNER, BORDER]
    assert found.walls.tolist() == true.walls.tolist()
    assert found.floor_true.tolist() == true.floor_true.tolist()
    assert found.ceiling_true.tolist() == true.ceiling_true.tolist()
    np.testing.assert_allclose(found.floor, true.floor, atol=1.0)
    np.testing.assert_allclose(found.ceiling, true.ceiling, atol=1.0)


def test_exact_columns_give_the_true_wireframe() -> None:
    """Median mask IoU; flags and order as a wireframe promises."""
    plan = Floorplan.load("apartment")
    overlap = []
    for pose, gravity in apartment_views(24, 5):
        true = visible_wireframe(plan, CAMERA, pose, 1.4, gravity)
        found = decode(true_columns(plan, CAMERA, pose, 1.4, gravity), CAMERA, gravity)
        overlap.append(mask_iou(layout_mask(found, CAMERA), layout_mask(true, CAMERA)))
        for pixels in (found.ceiling, found.floor):
            assert np.all((pixels > -0.5 - 1e-6) & (pixels < np.array([639.5, 479.5]) + 1e-6))
        assert len(found) == 0 or (found.sigma_px is not None and np.all(found.sigma_px >= 0.0))
    assert np.median(overlap) > 0.985


def test_noise_costs_little_and_wrong_columns_hardly_more() -> None:
    """0.6 degrees of error along the walls, 10 % of the columns elsewhere and 40 % of the floors hidden."""
    plan, rng = Floorplan.load("apartment"), np.random.default_rng(2)
    overlap = []
    for pose, gravity in apartment_views(24, 6):
        true = visible_wireframe(plan, CAMERA, pose, 1.4, gravity)
        columns = true_columns(
            plan, CAMERA, pose, 1.4, gravity, noise_rad=math.radians(0.6), wrong=0.1, hidden=0.4, rng=rng
        )
        overlap.append(mask_iou(layout_mask(decode(columns, CAMERA, gravity), CAMERA), layout_mask(true, CAMERA)))
    assert np.median(overlap) > 0.97


def test_an_edge_alone_makes_no_wall_and_none_is_needed() -> None:
    columns = true_columns(room(), CAMERA, POSE, 1.5, LEVEL)
    true = decode(columns, CAMERA, LEVEL)
    edge = columns.edge.copy()
    false_edge = int(np.searchsorted(columns.edge_azimuths, 0.0))  # in the middle of the far wall
    edge[0, false_edge] = 0.95
    assert decode(replace(columns, edge=edge), CAMERA, LEVEL).walls.tolist() == true.walls.tolist()
    blurred = decode(replace(columns, edge=np.full_like(edge, 0.02)), CAMERA, LEVEL)
    assert blurred.walls.tolist() == true.walls.tolist()
    np.testing.assert_allclose(blurred.floor, true.floor, atol=4.0)  # px: 0.5 degrees at 40 degrees off the axis


def test_floors_do_not_move_ceilings() -> None:
    """P is measured by the ceiling's columns and Q by the floor's: a common shift of one leaves the other, to 0.3 px.

    What is left is the breaks' azimuth, which both decide.
    """
    columns = true_columns(room(), CAMERA, POSE, 1.5, LEVEL)
    moved = columns.elevation.copy()
    moved[1] -= math.radians(0.4)
    a, b = decode(columns, CAMERA, LEVEL), decode(replace(columns, elevation=moved), CAMERA, LEVEL)
    seen = a.ceiling_true & (a.kind != BORDER)
    assert seen.sum() >= 3
    np.testing.assert_allclose(b.ceiling[seen], a.ceiling[seen], atol=0.3)
    assert np.all((b.floor - a.floor)[a.floor_true & (a.kind != BORDER), 1] > 1.0)


def test_stated_deviations_are_those_of_repeated_frames() -> None:
    """Rows of seen junctions over 60 draws of 0.6 degrees: at most as scattered as stated, at least a third of it."""
    rng, noise = np.random.default_rng(7), math.radians(0.6)
    plan = room()
    true = decode(true_columns(plan, CAMERA, POSE, 1.5, LEVEL), CAMERA, LEVEL)
    errors, stated = [], []
    for _ in range(60):
        found = decode(true_columns(plan, CAMERA, POSE, 1.5, LEVEL, noise_rad=noise, rng=rng), CAMERA, LEVEL)
        if found.walls.tolist() != true.walls.tolist():
            continue
        errors.append(np.stack([found.ceiling - true.ceiling, found.floor - true.floor])[:, 1:5, 1])
        stated.append(found.sigma_px[1:5].T)
    assert len(errors) > 24  # frames in which the same walls were found
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / np.mean(stated, axis=0)
    assert np.all(ratio < 1.3) and np.all(ratio > 0.3)  # 30 draws know a deviation to 13 %


def test_the_layout_covers_the_truth_as_often_as_it_says() -> None:
    """Shape (scale taken out) of the walls within two of the layout's standard deviations: 95 % would be perfect."""
    plan, rng = Floorplan.load("apartment"), np.random.default_rng(9)
    within = []
    for pose, gravity in apartment_views(24, 8):
        columns = true_columns(plan, CAMERA, pose, 1.4, gravity, noise_rad=math.radians(0.6), rng=rng)
        layout = solve_layout(decode(columns, CAMERA, gravity), CAMERA, gravity, "ml")
        true = solve_layout(visible_wireframe(plan, CAMERA, pose, 1.4, gravity), CAMERA, gravity, "ml")
        within += list(_deviations(layout, true))
    assert len(within) > 300
    assert 0.85 < np.mean(np.abs(within) < 2.0)


def _deviations(layout, true) -> np.ndarray:  # type: ignore[no-untyped-def]
    from galoc.rays import cast_rays

    got, wanted = cast_rays(layout, CAMERA), cast_rays(true, CAMERA)
    both = got.known & wanted.known
    if both.sum() < 5:
        return np.zeros(0)
    error = np.log(got.range[both] / wanted.range[both])
    return (error - np.median(error)) / np.sqrt(got.variance[both])


def test_mirrored_columns_give_the_mirrored_wireframe() -> None:
    columns = true_columns(room(), CAMERA, POSE, 1.5, LEVEL)
    rows = {
        name: getattr(columns, name)[:, ::-1] for name in ("elevation", "sigma", "sure", "visible", "in_frame", "edge")
    }
    found, other = decode(columns, CAMERA, LEVEL), decode(replace(columns, **rows), CAMERA, LEVEL)
    assert sorted(other.kind.tolist()) == sorted(found.kind.tolist())
    mirrored = layout_mask(other, CAMERA)[:, ::-1]
    assert mask_iou(mirrored, layout_mask(found, CAMERA)) > 0.995  # a pixel's width along the lines


def test_lines_beyond_the_image_are_not_measured() -> None:
    """Guesses that stick to the border from inside, with in_frame right: flags are the truth's, walls go on."""
    plan, pose = room(), (2.0, 0.6, 0.0)
    true = visible_wireframe(plan, CAMERA, pose, 1.3)
    columns = true_columns(plan, CAMERA, pose, 1.3, LEVEL)
    border = frame_borders(np.tan(columns.azimuths), CAMERA, LEVEL)
    inside = np.arctan(0.97 * border * np.cos(columns.azimuths)) * np.array([[1.0], [-1.0]])
    outside = (columns.in_frame < 0.5) & np.isfinite(border)
    assert outside.sum() > 20
    pulled = replace(
        columns,
        elevation=np.where(outside, inside, columns.elevation),
        sigma=np.where(outside, math.radians(2.0), columns.sigma),
    )
    found = decode(pulled, CAMERA, LEVEL)
    assert mask_iou(layout_mask(found, CAMERA), layout_mask(true, CAMERA)) > 0.97
    for kind in (CORNER, OCCLUSION):
        assert np.sum(found.ceiling_true & (found.kind == kind)) == np.sum(true.ceiling_true & (true.kind == kind))


def test_known_heights_place_a_floor_that_is_not_seen() -> None:
    plan = room()
    columns = true_columns(plan, CAMERA, POSE, 1.5, LEVEL)
    sure, visible, elevation = columns.sure.copy(), columns.visible.copy(), columns.elevation.copy()
    sure[1], visible[1] = 0.02, 0.0
    elevation[1] = math.radians(-60.0)
    blind = replace(columns, sure=sure, visible=visible, elevation=elevation, sigma=columns.sigma + [[0.0], [0.3]])
    true = visible_wireframe(plan, CAMERA, POSE, 1.5)
    known = evidence_of(blind, CAMERA, LEVEL, (math.log(1.5 / 1.0), 0.01)).heights
    assert known[1] / known[0] == pytest.approx(1.5, rel=0.03)
    found = decode(blind, CAMERA, LEVEL, log_ratio=(math.log(1.5 / 1.0), 0.01))
    np.testing.assert_allclose(found.floor[1:5], true.floor[1:5], atol=6.0)  # px
    assert found.sigma_px is not None and np.all(found.sigma_px[1:5, 1] > 5.0 * found.sigma_px[1:5, 0])


def test_blind_frames_are_empty() -> None:
    columns = true_columns(room(), CAMERA, POSE, 1.5, LEVEL)
    unseen = replace(columns, visible=np.zeros_like(columns.visible))
    assert len(decode(unseen, CAMERA, LEVEL)) == 0
    assert isinstance(decode(unseen, CAMERA, LEVEL, config=DecodeConfig(least_seen=0.0)), Wireframe)


def test_same_columns_same_bytes() -> None:
    columns = true_columns(room(), CAMERA, POSE, 1.5, LEVEL)
    a, b = decode(columns, CAMERA, LEVEL), decode(columns, CAMERA, LEVEL)
    assert a.floor.tobytes() == b.floor.tobytes() and a.sigma_px.tobytes() == b.sigma_px.tobytes()


@pytest.mark.parametrize("name", ["elevation", "edge"])
def test_bad_columns_are_explained(name: str) -> None:
    columns = true_columns(room(), CAMERA, POSE, 1.5, LEVEL)
    bad = getattr(columns, name).copy()
    bad[0, 3] = np.nan
    with pytest.raises(GalocError, match="columns"):
        decode(replace(columns, **{name: bad}), CAMERA, LEVEL)
    with pytest.raises(GalocError, match="columns"):
        decode(replace(columns, edge=columns.edge[:, :-1]), CAMERA, LEVEL)
