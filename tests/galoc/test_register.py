"""Registration to the map: its kernels against plain ones, exactness without noise, calibration with it."""

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from galoc import Camera, Floorplan
from galoc._linalg_kernel import cholesky, cholesky_inverse, cholesky_solve
from galoc._register_kernel import ALONG_WALL, ON_CORNER, ON_WALL, OUTLIER, OUTLIER_SD, linearize
from galoc._visibility_kernel import NEAR, cast, nearby, ray_cost, unseen_corners, visible_corners
from galoc.corners import map_corners
from galoc.detect.oracle import perturb
from galoc.heights import Heights
from galoc.layout import solve_layout
from galoc.metrics import wrap_angle
from galoc.observation import Observation, observation
from galoc.rays import cast_rays
from galoc.register import LEAST_CLEARANCE, SAME_M, SAME_RAD, Modes, register_poses
from galoc_env.homes import generate
from galoc_env.truth import visible_wireframe

CAMERA = Camera.from_hfov(640, 480, 108)
PLAN = generate(3, kind="rectilinear")
HOMES = [PLAN, generate(4, kind="atlanta"), generate(5, kind="free")]
View = tuple[Floorplan, np.ndarray, Any, Any]


def seen_by(plan: Floorplan, wireframe: Any, gravity: Any) -> Observation:
    """Under exact gravity and heights."""
    heights = Heights.known(1.4, plan.ceiling_height, sd=1e-3)
    layout = solve_layout(wireframe, CAMERA, gravity, imu_sigma_rad=0.0, heights=heights)
    return observation(layout, cast_rays(layout, CAMERA))


@cache
def views(least_corners: int = 4) -> list[View]:
    """Views that show some whole corners: plan, pose, gravity, true wireframe."""
    rng, out = np.random.default_rng(0), []
    for plan in HOMES:
        free = plan.free_space(0.1).positions(0.5)
        found = 0
        while found < 8:
            pose = np.array([*free[rng.integers(len(free))] + rng.uniform(-0.04, 0.04, 2), rng.uniform(-np.pi, np.pi)])
            gravity = tuple(rng.uniform(-0.04, 0.04, 2))
            wireframe = visible_wireframe(plan, CAMERA, pose, 1.4, gravity)
            whole = (wireframe.kind == 0) & wireframe.ceiling_true & wireframe.floor_true
            if np.count_nonzero(whole) >= least_corners:
                out.append((plan, pose, gravity, wireframe))
                found += 1
    return out


def register(plan: Floorplan, starts: np.ndarray, seen: Observation, **options: Any) -> Modes:
    corners, share = map_corners(plan)
    return register_poses(np.atleast_2d(starts), seen, plan.segments, corners, share, **options)


def off(rng: np.random.Generator) -> np.ndarray:
    """Up to 10 cm and 1 degree."""
    angle, far = rng.uniform(0.0, 2.0 * np.pi), 0.1 * math.sqrt(rng.random())
    return np.array([far * math.cos(angle), far * math.sin(angle), math.radians(rng.uniform(-1.0, 1.0))])


def test_near_starts_come_back_without_noise() -> None:
    """To 1 mm and 0.01 degrees, but for one start in fifty that may take a corner for its neighbour."""
    rng, errors, turns = np.random.default_rng(1), [], []
    for plan, pose, gravity, wireframe in views():
        seen = seen_by(plan, perturb(wireframe, CAMERA, 0.0, rng), gravity)
        for _ in range(4):
            found = register(plan, pose + off(rng), seen)
            assert len(found) == 1
            turns.append(abs(wrap_angle(found.poses[0, 2] - pose[2])))
            errors.append(np.hypot(*(found.poses[0, :2] - pose[:2])))
    right = (np.array(errors) < 1e-3) & (np.array(turns) < math.radians(0.01))
    assert len(right) == 96 and np.mean(right) >= 0.98


def test_covariance_is_calibrated_over_noise() -> None:
    """NEES per freedom of (x, y, heading): 24 views, 10 draws of 3 px, 0.5 degrees and 1 % in each known height."""
    rng, nees = np.random.default_rng(2), []
    for plan, pose, gravity, wireframe in views() * 10:
        noisy = perturb(wireframe, CAMERA, 3.0, rng)
        measured = np.asarray(gravity) + np.radians(0.5) * rng.standard_normal(2)
        camera, ceiling = np.array([1.4, plan.ceiling_height]) * np.exp(0.01 * rng.standard_normal(2))
        known = Heights.known(camera, ceiling, sd=0.01)
        layout = solve_layout(noisy, CAMERA, measured, imu_sigma_rad=math.radians(0.5), heights=known)
        seen = observation(layout, cast_rays(layout, CAMERA))
        found = register(plan, pose, seen, map_sd=0.001, slack=0.3)  # the map is exact here
        error = found.poses[0, :3] - pose
        error[2] = wrap_angle(error[2])
        nees.append(error @ np.linalg.solve(found.covariances[0, :3, :3], error) / 3.0)
    assert 0.85 <= np.mean(nees) <= 1.2  # its standard error is 0.05
    assert np.mean(np.array(nees) < 16.27 / 3.0) > 0.98  # the 99.9 % quantile of chi-square with three freedoms


def test_a_node_that_nothing_explains_is_left_out() -> None:
    """A corner reported in mid-air, at a third of the wall's depth, changes the pose by less than 1 mm."""
    rng = np.random.default_rng(3)
    for plan, pose, gravity, wireframe in views():
        seen = seen_by(plan, perturb(wireframe, CAMERA, 0.0, rng), gravity)
        before = register(plan, pose, seen)
        rays = np.flatnonzero(np.isfinite(seen.variance) & ~seen.is_limit)
        # On the ray that is farthest from all nodes.
        m_ray = np.tan(seen.azimuths[rays])
        pick = int(np.argmax(np.abs(m_ray[:, None] - seen.nodes[:, 0]).min(axis=1)))
        m, depth = m_ray[pick], math.exp(seen.log_range[rays[pick]]) * math.cos(seen.azimuths[rays[pick]])
        n = len(seen.nodes)
        covariance = np.zeros((2 * n + 2, 2 * n + 2))
        covariance[: 2 * n, : 2 * n] = seen.covariance
        covariance[2 * n :, 2 * n :] = 1e-4 * np.eye(2)
        ghost = replace(
            seen,
            nodes=np.vstack([seen.nodes, [m, 3.0 / depth]]),
            covariance=covariance,
            is_corner=np.append(seen.is_corner, True),
            side=np.append(seen.side, 0),
        )
        after = register(plan, pose, ghost)
        assert after.matched[0, 1] == before.matched[0, 1] + 1
        assert np.hypot(*(after.poses[0, :2] - before.poses[0, :2])) < 1e-3


def test_modes_are_where_a_camera_can_be_and_apart() -> None:
    rng = np.random.default_rng(4)
    plan, pose, gravity, wireframe = views()[0]
    seen = seen_by(plan, perturb(wireframe, CAMERA, 2.0, rng), gravity)
    x0, y0, x1, y1 = plan.bounds
    spread = np.stack([rng.uniform(x0 - 2, x1 + 2, 150), rng.uniform(y0 - 2, y1 + 2, 150), rng.uniform(-3, 3, 150)])
    starts = np.concatenate([spread.T, pose + np.array([off(rng) for _ in range(10)])])
    free = plan.free_space(0.05)
    inside = register(plan, starts, seen, free=free)
    assert np.all(free.clearance_at(inside.poses[:, :2]) >= LEAST_CLEARANCE)
    assert np.all(np.diff(inside.log_mass) <= 0.0)
    assert np.hypot(*(inside.poses[0, :2] - pose[:2])) < 0.1
    for i in range(len(inside)):
        rest = np.delete(inside.poses, i, axis=0)
        apart = np.hypot(*(rest[:, :2] - inside.poses[i, :2]).T) > SAME_M
        assert np.all(apart | (np.abs(wrap_angle(rest[:, 2] - inside.poses[i, 2])) > SAME_RAD))
    # Held 3 cm from a wall, where no camera is.
    a, b = plan.segments[0, :2], plan.segments[0, 2:]
    normal = np.array([a[1] - b[1], b[0] - a[0]]) / np.hypot(*(b - a))
    at_wall = np.array([[*(0.5 * (a + b) + 0.03 * side * normal), pose[2]] for side in (-1.0, 1.0)])
    held = {"prior_precision": np.diag([1e8, 1e8, 1e8])}
    assert len(register(plan, at_wall, seen, **held)) > 0
    assert len(register(plan, at_wall, seen, free=free, **held)) == 0


def test_a_prior_holds_the_pose() -> None:
    plan, pose, gravity, wireframe = views()[1]
    seen = seen_by(plan, perturb(wireframe, CAMERA, 0.0, np.random.default_rng(0)), gravity)
    start = pose + [0.05, -0.03, 0.01]
    held = register(plan, start, seen, prior_precision=np.diag([1e10, 1e10, 1e10]))
    np.testing.assert_allclose(held.poses[0, :3], start, atol=1e-3)
    assert np.all(np.diag(held.covariances[0])[:3] < 1e-8)


def segments(rng: np.random.Generator, count: int = 25) -> np.ndarray:
    a = rng.uniform(-4.0, 4.0, (count, 2))
    return np.concatenate([a, a + rng.uniform(-2.0, 2.0, (count, 2))], axis=1)


def plain_cast(walls: np.ndarray, x: float, y: float, c: float, s: float) -> tuple[float, int]:
    hits = []
    for x0, y0, x1, y1 in walls:
        t, u = np.linalg.solve(np.array([[c, x0 - x1], [s, y0 - y1]]), [x0 - x, y0 - y])
        hits.append(t if t > 1e-9 and 0.0 <= u <= 1.0 else np.inf)
    return min(hits), int(np.argmin(hits)) if np.isfinite(min(hits)) else -1


def test_cast_and_nearby_equal_plain_ones() -> None:
    rng = np.random.default_rng(5)
    walls = segments(rng)
    for _ in range(60):
        x, y, angle, size = *rng.uniform(-3.0, 3.0, 2), rng.uniform(-np.pi, np.pi), rng.uniform(0.2, 3.0)
        c, s = size * math.cos(angle), size * math.sin(angle)
        got, want = cast(walls, x, y, c, s), plain_cast(walls, x, y, c, s)
        assert got[0] == pytest.approx(want[0]) and got[1] == want[1]
        along = np.linspace(0.0, 1.0, 2001)[:, None, None]
        points = walls[:, :2] + along * (walls[:, 2:] - walls[:, :2])
        distance = np.hypot(*np.moveaxis(points - [x, y], -1, 0)).min(axis=0)
        reach = 1.5
        clear = np.abs(distance - reach) > 2e-3
        found, far = nearby(walls, x, y, reach)
        near = {tuple(w) for w in found}
        assert len(near) == len(found) == len(far)
        assert np.all(np.diff(far) >= 0.0)
        for wall, d in zip(found, far, strict=True):  # to what the sampled wall is off, 2 mm at most
            assert abs(distance[(walls == wall).all(axis=1)][0] - d) < 2e-3
        for wall, d in zip(walls[clear], distance[clear], strict=True):
            assert (tuple(wall) in near) == (d < reach)


def test_visible_corners_equal_a_plain_search() -> None:
    rng = np.random.default_rng(6)
    corners, _ = map_corners(PLAN)
    free = PLAN.free_space(0.1).positions(0.4)
    compared = 0
    for _ in range(15):
        (x, y), heading = free[rng.integers(len(free))], rng.uniform(-np.pi, np.pi)
        c, s = math.cos(heading), math.sin(heading)
        out = np.empty((64, 3))
        count = visible_corners(PLAN.segments, corners, x, y, heading, -1.5, 1.5, out)
        got = {int(row[2]): row[:2] for row in out[:count]}
        for k, corner in enumerate(corners):
            ahead, right = (corner - [x, y]) @ [c, s], (corner - [x, y]) @ [s, -c]
            there = ahead >= NEAR and abs(right / ahead) <= 1.5
            distance = np.hypot(ahead, right)
            steps = np.linspace(0.0, 1.0, 50)[1:-1]
            # Looked at from 5 cm before the corner, which a wall's end must not hide.
            reach = cast(PLAN.segments, x, y, *(corner - [x, y]))[0] * distance
            if abs(reach - (distance - 0.03 - 0.005 * distance)) < 1e-6 or not steps.size:
                continue
            there = there and reach > distance - 0.03 - 0.005 * distance
            assert (k in got) == there
            if there:
                np.testing.assert_allclose(got[k], [right / ahead, ahead], rtol=1e-9)
                compared += 1
    assert compared > 30


def test_ray_cost_equals_a_plain_sum() -> None:
    rng = np.random.default_rng(7)
    plan, pose = views()[0][:2]
    azimuths, seen = np.radians(np.arange(-50, 51, 5.0)), rng.uniform(0.0, 1.5, 21)
    sd = np.where(rng.random(21) < 0.8, 0.1, 0.0)
    least = np.where(rng.random(21) < 0.3, 0.0, -1e9)
    g, want = 0.07, 0.0
    for azimuth, log_range, own, low in zip(azimuths, seen, sd, least, strict=True):
        if own > 0.0:
            reach, k = plain_cast(
                plan.segments, pose[0], pose[1], math.cos(pose[2] - azimuth), math.sin(pose[2] - azimuth)
            )
            q = (max(math.log(reach) - log_range - g, low) / own if k >= 0 else 1e3) ** 2
            want += q * 9.0 / (q + 9.0)
    assert ray_cost(np.array([*pose, g]), plan.segments, azimuths, seen, sd, least, 9.0) == pytest.approx(want)


def test_unseen_corners_are_counted() -> None:
    """At the true pose of a noise-free view none is missing; without the corner nodes those on known walls are."""
    missing = 0.0
    for plan, pose, gravity, wireframe in views()[:6]:
        seen = seen_by(plan, perturb(wireframe, CAMERA, 0.0, np.random.default_rng(0)), gravity)
        corners, _ = map_corners(plan)
        sd = np.where(np.isfinite(seen.variance), 0.1, 0.0)
        at = np.array([*pose, 0.0])
        args = (seen.azimuths, sd, np.empty((64, 3)))
        assert unseen_corners(at, plan.segments, corners, seen.nodes, seen.covariance, *args) <= 1.0
        missing += unseen_corners(at, plan.segments, corners, seen.nodes[:0], seen.covariance[:0, :0], *args)
    assert missing >= 12.0


def test_linearization_equals_finite_differences() -> None:
    """Jacobian of the predictions by pose, and the covariance opened for walls and outliers."""
    rng = np.random.default_rng(8)
    nodes = np.array([[0.1, 0.4], [-0.5, 0.3], [0.6, 0.5]])
    root = 0.05 * rng.standard_normal((6, 6))
    state = np.array([ON_CORNER, ON_WALL, OUTLIER])
    data = np.array([[3.0, 0.4, 0.0, 0.0], [2.0, 2.5, 0.6, 0.8], [0.0, 0.0, 0.0, 0.0]])
    pose = np.array([0.2, 0.1, 0.3, 0.05])

    def at(p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        e, jac, big = np.empty(6), np.empty((6, 4)), np.empty((6, 6))
        linearize(p, nodes, root @ root.T, state, data, 0.02, e, jac, big)
        return e, jac, big

    _, jacobian, big = at(pose)
    step = 1e-6
    for q in range(4):
        shift = step * np.eye(4)[q]
        np.testing.assert_allclose(
            jacobian[:, q], (at(pose - shift)[0] - at(pose + shift)[0]) / (2.0 * step), atol=1e-6
        )
    opened = big - root @ root.T
    assert np.all(np.linalg.eigvalsh(opened) > -1e-12)
    np.testing.assert_allclose(opened[4:, 4:], OUTLIER_SD**2 * np.eye(2))
    # Opened along the line of the wall: a node that moves on it, by 0.1 in m, keeps its residual.
    direction = opened[2:4, 2] / ALONG_WALL**2
    moved = nodes.copy()
    moved[1] += 0.1 * direction
    before = at(pose)[0][3]
    nodes[:] = moved
    assert at(pose)[0][3] == pytest.approx(before, abs=1e-12)


def test_linear_algebra_equals_numpy() -> None:
    rng = np.random.default_rng(9)
    for n in (1, 3, 12):
        root = rng.standard_normal((n, n))
        matrix = root @ root.T + 0.1 * np.eye(n)
        factor, right = matrix.copy(), rng.standard_normal(n)
        assert cholesky(factor, n)
        np.testing.assert_allclose(np.tril(factor), np.linalg.cholesky(matrix), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(cholesky_inverse(factor, n), np.linalg.inv(matrix), rtol=1e-7, atol=1e-10)
        solved = right.copy()
        cholesky_solve(factor, solved, n)
        np.testing.assert_allclose(solved, np.linalg.solve(matrix, right), rtol=1e-7, atol=1e-10)
    assert not cholesky(np.array([[1.0, 2.0], [2.0, 1.0]]), 2) and not cholesky(np.full((2, 2), np.nan), 2)
