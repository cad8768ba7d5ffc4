import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_world import WALLS, small_plan

from galoc import GalocError
from galoc_env import motion

SEGMENTS = np.array(WALLS, float)
TOLERANCE_M = 1e-9  # rounding of a few additions of numbers around 10


def test_discrete_actions_move_as_documented():
    pose = np.array([1.0, 1.0, math.pi / 2])
    nothing = np.zeros((0, 4))
    forward = motion.move(pose, motion.commanded_motion(0, "discrete"), nothing)
    assert forward.pose == pytest.approx([1.0, 1.3, math.pi / 2])
    assert motion.move(pose, motion.commanded_motion(1, "discrete"), nothing).pose == pytest.approx(
        [1.0, 0.7, math.pi / 2]
    )
    assert motion.move(pose, motion.commanded_motion(2, "discrete"), nothing).pose[2] == pytest.approx(
        math.radians(120)
    )
    assert motion.move(pose, motion.commanded_motion(3, "discrete"), nothing).pose[2] == pytest.approx(math.radians(60))


def test_continuous_action_scales_and_left_is_left():
    wanted = motion.commanded_motion(np.array([0.0, 1.0, -0.5], np.float32), "continuous")
    assert wanted == pytest.approx([0.0, 0.3, -math.radians(15)])
    moved = motion.move(np.zeros(3), wanted, np.zeros((0, 4)))
    assert moved.pose[:2] == pytest.approx([0.0, 0.3])  # facing +x, left is +y


@pytest.mark.parametrize("action", [4, -1, 1.5, "forward", None, [0, 1], math.nan, True])
def test_discrete_refusals(action):
    with pytest.raises(GalocError, match="action"):
        motion.commanded_motion(action, "discrete")


@pytest.mark.parametrize("action", [[0, 0, math.nan], [0, 1.2, 0], [0, 0], 0, "left", None, [math.inf, 0, 0]])
def test_continuous_refusals(action):
    with pytest.raises(GalocError, match="action"):
        motion.commanded_motion(action, "continuous")


def dense_free_fraction(start, shift, segments, radius):
    """The same by brute force: 4000 positions along the way."""
    for t in np.linspace(0.0, 1.0, 4001):
        if motion.distances(start + t * shift, segments).min() < radius:
            return t
    return 1.0


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_contact_agrees_with_brute_force(seed):
    rng = np.random.default_rng(seed)
    segments = rng.uniform(-2, 2, (4, 4))
    start, shift = rng.uniform(-2, 2, 2), rng.uniform(-2, 2, 2)
    if motion.distances(start, segments).min() < 0.26:
        return
    # Two sample steps (a grazing touch may fall between samples), plus the skin.
    tolerance = 2 / 4000 + motion.SKIN_M / float(np.hypot(*shift))
    exact = motion.free_fraction(start, shift, segments, 0.25)
    brute = dense_free_fraction(start, shift, segments, 0.25)
    if exact < 1.0 and brute == 1.0:  # touched between two samples only: then the way really grazes
        graze = motion.distances(start + (exact + motion.SKIN_M) * shift, segments).min()
        assert graze == pytest.approx(0.25, abs=2e-3)
    else:
        assert exact == pytest.approx(brute, abs=tolerance)


def reference_free_fraction(start, shift, segments, radius):
    """The kernel's rules in numpy: first contact with an end or a flank of any segment."""
    length = float(np.hypot(*shift))
    if length < 1e-12 or len(segments) == 0:
        return 1.0
    u = shift / length
    a, b = segments[:, :2] - start, segments[:, 2:] - start
    ends = np.concatenate([a, b])
    along = ends @ u
    off2 = np.einsum("ij,ij->i", ends, ends) - along**2
    hit = (along > 0.0) & (off2 < radius**2)
    travel = [np.maximum(along[hit] - np.sqrt(radius**2 - off2[hit]), 0.0)]
    size = np.hypot(*(b - a).T)
    d = (b - a) / np.maximum(size, 1e-15)[:, None]
    normal = np.stack([-d[:, 1], d[:, 0]], axis=1)
    gap = np.einsum("ij,ij->i", a, normal)
    normal[gap < 0.0] *= -1.0
    approach = normal @ u
    with np.errstate(divide="ignore", invalid="ignore"):
        flank = np.maximum(np.abs(gap) - radius, 0.0) / approach
        foot = flank * (d @ u) - np.einsum("ij,ij->i", a, d)
    travel.append(flank[(approach > 1e-12) & (foot >= 0.0) & (foot <= size)])
    first = min(float(np.concatenate(travel).min(initial=np.inf)), length)
    return 1.0 if first >= length else max(0.0, first - motion.SKIN_M) / length


def reference_move(pose, wanted, segments):
    c, s = math.cos(pose[2]), math.sin(pose[2])
    shift = np.array([[c, -s], [s, c]]) @ wanted[:2]
    share = reference_free_fraction(pose[:2], shift, segments, motion.BODY_RADIUS)
    after = [*(pose[:2] + share * shift), motion.wrap(pose[2] + wanted[2])]
    return np.array(after), np.array([share, share, 1.0]) * wanted, share < 1.0


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_kernel_agrees_with_numpy(seed):
    rng = np.random.default_rng(seed)
    segments = rng.uniform(-2, 2, (rng.integers(0, 12), 4))
    if seed % 2 and len(segments):  # as in a plan: right angles, shared ends, a segment without length
        segments = np.round(segments, 0)
    pose, wanted = rng.uniform(-2, 2, 3), rng.uniform(-1, 1, 3)
    moved = motion.move(pose, wanted, segments)
    after, odometry, collided = reference_move(pose, wanted, segments)
    # Rounding of a few operations on numbers around 1, through one square root.
    assert moved.pose == pytest.approx(after, abs=1e-12)
    assert moved.odometry == pytest.approx(odometry, abs=1e-12)
    assert moved.collided == collided


def test_many_bodies_move_as_each_does_alone():
    from galoc_env import settings as arguments
    from galoc_env.bodies import Bodies
    from galoc_env.sensors import Tilt

    rng = np.random.default_rng(5)
    homes = [SEGMENTS, SEGMENTS[:, [1, 0, 3, 2]].copy()]
    together = Bodies(4, arguments.Settings(tilt_deg=5.0))
    together.surround([homes[0], homes[1], homes[0], None])
    poses = [np.array([1.5, 1.5, angle]) for angle in rng.uniform(-3, 3, 4)]
    for body, pose in enumerate(poses):
        streams = [np.random.default_rng([body, k]) for k in range(3)]
        together.place(body, pose, Tilt.random(0.1, streams[0]), streams[1:])
    for _ in range(20):
        wanted = rng.uniform(-0.3, 0.3, (4, 3))
        together.wanted[:] = wanted
        together.step(resting=[2])
        for body in (0, 1, 3):
            obstacles = (homes + [SEGMENTS, np.zeros((0, 4))])[body]
            moved = motion.move(poses[body], wanted[body], obstacles)
            poses[body] = moved.pose
            assert together.pose[body].tobytes() == moved.pose.tobytes()
            assert together.moved[body].tobytes() == moved.odometry.tobytes()
            assert together.has_collided(body) == moved.collided
    assert together.steps.tolist() == [20, 20, 0, 20]
    assert together.pose[2] == pytest.approx(poses[2])


def test_no_tunnelling_through_a_thin_wall():
    wall = np.array([[0.0, -5.0, 0.0, 5.0]])
    moved = motion.move(np.array([-1.0, 0.0, 0.0]), np.array([50.0, 0.0, 0.0]), wall)
    assert moved.collided
    assert moved.pose[0] == pytest.approx(-motion.BODY_RADIUS, abs=2 * motion.SKIN_M)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_random_walk_never_enters_a_wall_and_odometry_adds_up(seed):
    rng = np.random.default_rng(seed)
    pose = np.array([1.5, 1.5, rng.uniform(-3, 3)])
    reckoned = pose.copy()
    for _ in range(100):
        moved = motion.move(pose, rng.uniform(-1, 1, 3) * [0.3, 0.3, 0.5], SEGMENTS)
        pose = moved.pose
        c, s = math.cos(reckoned[2]), math.sin(reckoned[2])
        dx, dy, turn = moved.odometry
        reckoned = reckoned + [c * dx - s * dy, s * dx + c * dy, turn]
        assert motion.distances(pose[:2], SEGMENTS).min() >= motion.BODY_RADIUS - TOLERANCE_M
        assert -math.pi <= pose[2] < math.pi
    assert pose[:2] == pytest.approx(reckoned[:2], abs=1e-9)
    assert math.cos(pose[2] - reckoned[2]) == pytest.approx(1.0)


def test_an_overlapping_body_may_leave_but_not_press_on():
    wall = np.array([[0.0, -5.0, 0.0, 5.0]])
    start = np.array([-0.1, 0.0])
    assert motion.free_fraction(start, np.array([-1.0, 0.0]), wall) == 1.0
    assert motion.free_fraction(start, np.array([1.0, 0.0]), wall) == 0.0


def test_walkable_is_clear_and_connected():
    plan = small_plan()
    furniture = np.array([[1.0, 1.0, 2.0, 1.0], [2.0, 1.0, 2.0, 2.0], [2.0, 2.0, 1.0, 2.0], [1.0, 2.0, 1.0, 1.0]])
    walk = motion.walkable(plan, furniture)
    obstacles = np.concatenate([plan.segments, furniture])
    least = min(motion.distances(xy, obstacles).min() for xy in walk.positions)
    assert least >= motion.BODY_RADIUS  # centres, with the 5 cm of reserve eating up the rasterization
    inside_box = np.all((walk.positions > 1.0) & (walk.positions < 2.0), axis=1)
    assert not inside_box.any()  # a closed piece of furniture is not part of the region
    assert (walk.positions[:, 0] > 4.0).any() and (walk.positions[:, 0] < 1.0).any()  # through the doorway
    assert walk.mask[walk.cell(walk.positions[0])]


def test_walkable_refuses_a_cupboard():
    from galoc import Floorplan

    closet = Floorplan.from_segments([[0, 0, 0.5, 0], [0.5, 0, 0.5, 5], [0.5, 5, 0, 5], [0, 5, 0, 0]])
    with pytest.raises(GalocError, match="unit"):
        motion.walkable(closet, np.zeros((0, 4)))


@pytest.mark.parametrize(
    "pose", [(0.1, 1, 0), (-5, 1, 0), (3.5, 0.7, 0), (1, 1), (1, math.nan, 0), "here", (1e9, 1e9, 0), None]
)
def test_start_refusals(pose):
    with pytest.raises(GalocError, match="start"):
        motion.checked_start(pose, small_plan(), SEGMENTS)


def test_start_accepted_and_wrapped():
    assert motion.checked_start([1, 1, 7.0], small_plan(), SEGMENTS) == pytest.approx([1, 1, 7.0 - 2 * math.pi])
