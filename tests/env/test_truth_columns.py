"""Exact columns against the ray caster, and the errors that can be added to them."""

import math

import numpy as np
import pytest
from small_world import small_plan

from galoc import Camera, Floorplan, GalocError
from galoc.camera import levelling
from galoc_env.truth import visible_panels
from galoc_env.truth_columns import EDGE_TOP, SURE, UNSURE, WRONG_COLUMNS, true_columns
from galoc_env.truth_kernel import nearest_hit

CAMERA = Camera.from_hfov(640, 480, 108)
POSE = np.array([1.2, 1.5, 0.3])
LEVEL = (0.0, 0.0)


def seen_range(plan: Floorplan, pose: np.ndarray, azimuth: float) -> float:
    bearing = pose[2] - azimuth
    return nearest_hit(plan.segments, pose[0], pose[1], math.cos(bearing), math.sin(bearing))[0]


def test_exact_columns_are_the_ranges_of_the_plan() -> None:
    plan = small_plan()
    columns = true_columns(plan, CAMERA, POSE, 1.4, LEVEL)
    ranges = np.array([seen_range(plan, POSE, a) for a in columns.azimuths])
    np.testing.assert_allclose(np.tan(columns.elevation[0]), 1.2 / ranges, rtol=1e-9)
    np.testing.assert_allclose(np.tan(columns.elevation[1]), -1.4 / ranges, rtol=1e-9)
    assert len(columns.edge_azimuths) == 2 * len(columns)
    np.testing.assert_allclose(columns.azimuths, columns.edge_azimuths.reshape(-1, 2).mean(axis=1), atol=1e-12)


def test_measured_gravity_turns_the_columns() -> None:
    """Seen through the IMU's error, every line still points at the wall's true ceiling or floor, to 1e-6 m."""
    plan, gravity, measured = small_plan(), (0.05, -0.08), (0.04, -0.065)
    columns = true_columns(plan, CAMERA, POSE, 1.4, gravity, measured=measured)
    back = levelling(gravity) @ levelling(measured).T
    checked = 0
    for row, height in ((0, 1.2), (1, -1.4)):
        flat = np.cos(columns.elevation[row])
        seen = np.stack(
            [np.sin(columns.azimuths) * flat, -np.sin(columns.elevation[row]), np.cos(columns.azimuths) * flat], axis=1
        )
        true = seen @ back.T
        azimuth = np.arctan2(true[:, 0], true[:, 2])
        ranges = -height * np.hypot(true[:, 0], true[:, 2]) / true[:, 1]
        expected = np.array([seen_range(plan, POSE, a) for a in azimuth])
        at_edge = np.abs(expected - ranges) > 1e-6  # the line of a column may jump between the rounds at an edge
        assert at_edge.mean() < 0.1
        checked += int((~at_edge).sum())
    assert checked > 150


def test_edges_peak_at_the_walls_ends() -> None:
    plan = small_plan()
    columns = true_columns(plan, CAMERA, POSE, 1.4, LEVEL)
    panels = visible_panels(plan, POSE, -0.9, 0.9)
    ends = [b.azimuth[0] for a, b in zip(panels[:-1], panels[1:], strict=True) if b.azimuth[0] == a.azimuth[1]]
    assert len(ends) >= 2
    any_edge = columns.edge.max(axis=0)
    for end in ends:
        near = np.abs(columns.edge_azimuths - end) < math.radians(0.5)
        assert any_edge[near].max() > 0.7 * EDGE_TOP
    far = np.min(np.abs(columns.edge_azimuths[:, None] - np.array([p.azimuth for p in panels]).ravel()), axis=1)
    assert any_edge[(far > math.radians(3.0)) & (np.abs(columns.edge_azimuths) < 0.85)].max() < 0.05


def test_lines_out_of_the_image_are_said_to_be() -> None:
    columns = true_columns(small_plan(), CAMERA, (5.6, 1.0, 0.0), 1.4, LEVEL)  # 0.4 m before a wall
    middle = np.abs(columns.azimuths) < math.radians(20.0)
    assert not columns.in_frame[:, middle].any() and not columns.visible[:, middle].any()


def test_noise_has_its_size_and_is_shared_along_walls() -> None:
    plan, noise = small_plan(), math.radians(0.6)
    exact = true_columns(plan, CAMERA, POSE, 1.4, LEVEL)
    rng = np.random.default_rng(0)
    draws = [true_columns(plan, CAMERA, POSE, 1.4, LEVEL, noise_rad=noise, rng=rng) for _ in range(100)]
    seen = exact.visible > 0.5
    errors = np.array([d.elevation - exact.elevation for d in draws])
    assert errors[:, seen].std() == pytest.approx(noise, rel=0.05)  # 100 draws of over 100 columns
    both = seen[:, 1:] & seen[:, :-1]
    neighbours = np.mean(errors[:, :, 1:][:, both] * errors[:, :, :-1][:, both]) / noise**2
    assert 0.25 < neighbours < 0.5  # half of the variance is shared, less between walls
    np.testing.assert_allclose(draws[0].sigma[seen], noise)


def test_hidden_wrong_and_missed() -> None:
    plan = small_plan()
    exact = true_columns(plan, CAMERA, POSE, 1.4, LEVEL)
    bad = true_columns(plan, CAMERA, POSE, 1.4, LEVEL, hidden=1.0, wrong=0.2, missed=1.0, rng=np.random.default_rng(1))
    assert not bad.visible[1].any() and bad.visible[0].any()
    moved = bad.elevation != exact.elevation
    assert WRONG_COLUMNS <= moved[0].sum() <= 0.25 * len(exact)
    assert np.all(bad.sure[moved] == UNSURE) and np.all(bad.sure[~moved] == SURE)
    assert bad.edge.max() < 0.1 < exact.edge.max()


def test_same_seed_same_columns() -> None:
    a, b = (
        true_columns(small_plan(), CAMERA, POSE, 1.4, LEVEL, noise_rad=0.01, wrong=0.1, rng=np.random.default_rng(4))
        for _ in range(2)
    )
    assert a.elevation.tobytes() == b.elevation.tobytes() and a.edge.tobytes() == b.edge.tobytes()


@pytest.mark.parametrize(
    ("bad", "said"),
    [({"noise_rad": -0.1}, "noise_rad"), ({"wrong": 2.0}, "wrong"), ({"noise_rad": 0.1}, "rng"), ({}, "camera_height")],
)
def test_bad_input_is_explained(bad: dict[str, float], said: str) -> None:
    with pytest.raises(GalocError, match=said):
        true_columns(small_plan(), CAMERA, POSE, 1.4 if bad else 9.0, LEVEL, **bad)
