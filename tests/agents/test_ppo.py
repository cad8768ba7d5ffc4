"""The learned policy: what it sees, the plain loop and the training script that make one, and the file they share."""

import json
import math
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from galoc_agents import reinforce, train_ppo
from galoc_agents.features import (
    COARSE,
    MIRRORED_MOVES,
    SECTORS,
    SEES,
    SIZE,
    Features,
    Memory,
    coarse,
    mirrored,
    profiles,
    systematic,
)
from galoc_agents.lesson import HELD, Lesson
from galoc_agents.ppo import Ppo
from galoc_agents.spin import Spin
from galoc_agents.trial import steps_to_localize, trials
from small_world import small_plan

from galoc import Floorplan, GalocError, assets
from galoc.profiles import profile_field
from galoc_env.cli import INTERRUPTED
from galoc_env.env import FloorplanEnv
from galoc_env.policy import TOLD, BeliefView, Robot
from galoc_env.scoring import HOLD_M

BLIND = {"renderer": "none", "detector": "oracle", "hfov_deg": 60.0, "width": 64, "height": 48}
TURN = np.array([0.0, 0.0, math.pi / 6])
STEP = np.array([0.3, 0.0, 0.0])


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory):
    return str(small_plan().save(tmp_path_factory.mktemp("plans") / "small.json"))


@pytest.fixture
def env(plan_file):
    made = FloorplanEnv(plan=plan_file, **BLIND)
    yield made
    made.close()


def view(p, positions=None, headings=None):
    p = np.asarray(p, dtype=np.float32)
    where = np.arange(2.0 * len(p)).reshape(-1, 2) if positions is None else positions
    return BeliefView(where, np.arange(p.shape[1]) * 1.0 if headings is None else headings, p, 0.1)


# --- features


def test_drawn_poses_have_the_shares_of_the_belief():
    belief = view([[0.5, 0.0, 0.0, 0.0], [0.0, 0.25, 0.25, 0.0]])
    positions, headings = systematic(belief, 64)
    first = positions[:, 0] == 0.0
    assert first.sum() == 32 and set(headings[first]) == {0.0}
    counts = [(headings[~first] == h).sum() for h in (1.0, 2.0)]
    assert sum(counts) == 32 and min(counts) >= 14
    again = systematic(belief, 64)
    assert np.array_equal(again[0], positions) and np.array_equal(again[1], headings)


def test_profiles_are_ranges_around_the_robot():
    plan = Floorplan.from_segments([[0, 0, 8, 0], [8, 0, 8, 4], [8, 4, 0, 4], [0, 4, 0, 0]], 2.6)
    field = profile_field(plan)
    # At (2, 1), looking along +x: 6 m ahead, 3 m to the left, 2 m behind, 1 m to the right.
    ahead, left, behind, right = (0, 6, 12, 18)
    found = np.exp(profiles(field, np.array([[2.0, 1.0]]), np.array([0.0])))[0, :, 1]
    assert found[[ahead, left, behind, right]] == pytest.approx([6.0, 3.0, 2.0, 1.0], abs=0.11)
    turned = np.exp(profiles(field, np.array([[2.0, 1.0]]), np.array([math.pi / 2])))[0, :, 1]
    assert np.roll(turned, 6) == pytest.approx(found)  # what was to the left is ahead now
    outside = profiles(field, np.array([[-50.0, 1e4]]), np.array([0.0]))
    assert np.isfinite(outside).all()


def test_memory_turns_with_the_robot_and_fades_when_it_walks():
    memory = Memory(math.radians(60.0))
    memory.add(np.zeros(3), None)
    looked, moves, (turned, steps) = memory.numbers()
    assert list(np.flatnonzero(looked)) == [0, 1, 2, 22, 23] and not moves.any() and (turned, steps) == (0.0, 0.0)
    memory.add(TURN, 2)
    looked, moves, (turned, steps) = memory.numbers()
    assert list(np.flatnonzero(looked)) == [0, 1, 2, 20, 21, 22, 23]  # seen before: two sectors further right
    assert (
        list(moves) == [0, 0, 1, 0, 0, 0, 0, 0] and turned == pytest.approx(1 / 12) and steps == pytest.approx(1 / 60)
    )
    for _ in range(11):
        memory.add(TURN, 2)
    assert memory.numbers()[0] == pytest.approx(np.ones(SECTORS))
    memory.add(STEP, 0)
    looked, _, (turned, _) = memory.numbers()
    assert turned == 0.0 and looked[12] < looked[0] == 1.0


def test_coarse_canvas_keeps_the_mean(rng):
    layer = rng.random((64, 64))
    small = coarse(layer)
    assert small.shape == (COARSE**2,) and small.mean() == pytest.approx(layer.mean())
    assert small[0] == pytest.approx(layer[:4, :4].mean())


@pytest.mark.parametrize("sees", SEES)
def test_vectors_are_finite_and_need_no_truth(env, sees):
    features = SEES[sees]()
    observation, info = env.reset(seed=1)
    features.reset(Robot.of(env, 1, 10))
    assert features.see(observation, info).shape == (features.size,)
    for _ in range(3):
        observation, _, _, _, info = env.step(2)
        told = {key: info[key] for key in TOLD}
        vector = features.see(observation, told, 2)
        assert vector.dtype == np.float32 and vector.shape == (features.size,)
        assert np.isfinite(vector).all() and np.abs(vector).max() < 20.0


def test_heading_canvases_say_where_the_belief_looks(env):
    observation, info = env.reset(seed=1)
    plain, looking = SEES["canvas"](), SEES["headings"]()
    for features in (plain, looking):
        features.reset(Robot.of(env, 1, 10))
    for _ in range(12):
        for features in (plain, looking):
            vector = features.see(observation, info)
        observation, _, _, _, info = env.step(2)
    n = COARSE**2
    assert info["error_m"] < HOLD_M
    cos, sin = vector[2 * n : 3 * n], vector[3 * n : 4 * n]
    top = np.argmax(np.hypot(cos, sin))
    # The vector is of the observation before the last turn.
    assert math.atan2(sin[top], cos[top]) == pytest.approx(
        math.remainder(info["pose"][2] - math.pi / 6, math.tau), abs=0.1
    )
    assert np.hypot(cos, sin).max() <= 1.0 + 1e-5


@pytest.mark.parametrize("localizer", ["small_world:DeadReckoner", "small_world:Silent", "none"])
def test_localizers_without_a_belief_are_seen_too(plan_file, localizer):
    env = FloorplanEnv(plan=plan_file, localizer=localizer, reward="error", **BLIND)
    features = Features()
    observation, info = env.reset(seed=0)
    features.reset(Robot.of(env, 0, 10))
    vector = features.see(observation, info)
    assert vector.shape == (SIZE,) and np.isfinite(vector).all()
    assert vector[:SECTORS].any() == (localizer == "small_world:DeadReckoner")
    env.close()


def test_mirrored_twice_is_the_same():
    index, sign = mirrored()
    vector = np.arange(SIZE, dtype=np.float32)
    once = sign * vector[index]
    assert not np.array_equal(once, vector) and np.array_equal(sign * once[index], vector)


def test_a_mirrored_world_gives_the_mirrored_vector():
    plan = small_plan()
    flipped = plan.segments * np.array([1, -1, 1, -1])
    index, sign = mirrored()
    vectors = []
    for segments, s in ((plan.segments, 1.0), (flipped, -1.0)):
        field = profile_field(Floorplan.from_segments(segments, 2.6))
        memory = Memory(math.radians(60.0))
        memory.add(np.zeros(3), None)
        memory.add(TURN * [1, 1, s], 2 if s > 0 else 3)
        # A grid line apart in y, since the grid is laid from below: compared loosely.
        logs = profiles(field, np.array([[1.55, 1.55 * s]]), np.array([0.3 * s]))[0].mean(axis=1)
        vectors.append(np.concatenate([logs, np.zeros(2 * SECTORS + 2), *memory.numbers(), np.zeros(5)]))
    assert sign * vectors[0][index] == pytest.approx(vectors[1], abs=0.12)


# --- the lesson


@pytest.fixture
def lesson(plan_file):
    made = Lesson([0], plan=plan_file, seed=4, steps=6, **BLIND)
    yield made
    made.close()


def test_gymnasium_checks_the_lesson(lesson):
    from gymnasium.utils.env_checker import check_env

    check_env(lesson, skip_render_check=True)


def test_a_lesson_ends_when_the_robot_knows_or_time_is_up(lesson):
    lengths = []
    for _ in range(12):
        lesson.reset()
        steps, over, total = 0, False, 0.0
        while not over:
            _, reward, knows, late, info = lesson.step(2)
            steps, over, total = steps + 1, knows or late, total + reward
        if knows:
            assert info["localized"] == steps + 1 - HELD
        else:
            assert info["localized"] == steps == 6
        lengths.append(steps)
    assert min(lengths) >= HELD - 1 and max(lengths) <= 6


def test_lessons_take_place_in_every_sort_of_home():
    made = Lesson([0], sorts=("rooms", "ambiguous"), seed=0, **BLIND)
    names = set()
    for _ in range(8):
        made.reset()
        names.add(made._world.world.plan.name)
    assert len(names) == 2
    made.close()


def test_the_same_seed_gives_the_same_lesson(lesson):
    runs = []
    for _ in range(2):
        vectors = [lesson.reset(seed=7)[0]]
        vectors += [lesson.step(2)[0] for _ in range(3)] + [lesson.reset()[0]]
        runs.append(np.array(vectors))
    assert np.array_equal(*runs)


def test_mirrored_lessons_swap_left_and_right(lesson):
    turned = {}
    for _ in range(12):
        lesson.reset()
        flipped, before = lesson._flipped, lesson._world.episode.moved.pose[2]
        lesson.step(2)
        turned[flipped] = math.remainder(lesson._world.episode.moved.pose[2] - before, math.tau)
    assert turned == {False: pytest.approx(math.pi / 6), True: pytest.approx(-math.pi / 6)}
    assert MIRRORED_MOVES == (0, 1, 3, 2)


# --- how long it takes


def test_steps_to_localize_counts_as_the_metrics_do(env):
    found = steps_to_localize(env, Spin(), seed=2, steps=14)
    errors = [score.error_m for score in env.episode.scores]
    assert len(errors) == 15 and 0 <= found <= 14
    assert all(e < HOLD_M for e in errors[found:]) and (found == 0 or errors[found - 1] >= HOLD_M)


def test_a_robot_that_never_knows_counts_as_all_steps(plan_file):
    arguments = {"plan": plan_file, "localizer": "small_world:Silent", "reward": "error", **BLIND}
    assert list(trials(arguments, Spin, [0, 1], steps=11)) == [11, 11]


# --- the plain loop


class Bandit(gymnasium.Env):
    """One step; the action that the observation names is the right one."""

    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float32)
    action_space = gymnasium.spaces.Discrete(3)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.right = int(self.np_random.integers(3))
        return np.eye(3, dtype=np.float32)[self.right], {}

    def step(self, action):
        return np.zeros(3, np.float32), float(action == self.right), True, False, {}


def test_gradient_is_that_of_finite_differences(rng):
    w = reinforce.weights(rng, 5, 7, 4)
    w["w2"] += rng.normal(0, 0.5, w["w2"].shape)
    x, actions, returns = rng.normal(size=(9, 5)), rng.integers(0, 4, 9), rng.normal(size=9)
    value = reinforce.forward(w, x)[2]
    fixed = returns - value
    fixed = (fixed - fixed.mean()) / (fixed.std() + 1e-8)

    def objective():
        _, p, v = reinforce.forward(w, x)
        entropy = -(p * np.log(p)).sum(axis=1)
        return np.mean(fixed * np.log(p[np.arange(9), actions]) + 0.1 * entropy - (returns - v) ** 2 / 2)

    g = reinforce.gradient(w, x, actions, returns, 0.1)
    for name, array in w.items():
        for at in list(np.ndindex(array.shape))[:: max(1, array.size // 6)]:
            kept, ends = array[at], []
            for h in (1e-5, -1e-5):
                array[at] = kept + h
                ends.append(objective())
            array[at] = kept
            assert g[name][at] == pytest.approx((ends[0] - ends[1]) / 2e-5, abs=1e-7)


def test_the_plain_loop_learns_a_bandit(monkeypatch, capsys):
    clock = iter(np.arange(1000.0))
    monkeypatch.setattr(reinforce.time, "monotonic", lambda: next(clock))
    env = Bandit()
    env.reset(seed=0)
    *_, w = reinforce.learn(env, reinforce.Arguments(minutes=2.0, rate=0.02))
    returns = [float(line.split()[-1]) for line in capsys.readouterr().out.splitlines()]
    assert returns[0] < 0.7 and returns[-1] > 0.9
    assert (reinforce.forward(w, np.eye(3))[1].argmax(axis=1) == [0, 1, 2]).all()


def test_the_plain_loop_keeps_what_it_learned_when_it_is_stopped(tmp_path, monkeypatch, capsys):
    class Stopped(Bandit):
        """Ctrl-C comes at a given episode."""

        def __init__(self):
            self.resets, self.np_random = 0, np.random.default_rng(0)

        def reset(self, **more):
            self.resets += 1
            if self.resets == stop_at:
                raise KeyboardInterrupt
            return super().reset(**more)

    def stopped():
        with pytest.raises(SystemExit) as ended:
            reinforce.main()
        assert ended.value.code == INTERRUPTED
        return capsys.readouterr().err

    out = tmp_path / "new" / "w.npz"
    monkeypatch.setattr(reinforce, "Lesson", lambda *_, seed, **__: Stopped())
    monkeypatch.setattr(sys, "argv", ["reinforce", "--episodes", "8", "--seed", "3", "--out", str(out)])
    stop_at = 5
    assert stopped() == "stopped; nothing was learned yet\n" and not out.exists()
    stop_at = 13  # amid the second eight
    assert stopped() == f"stopped; what was learned so far is in {out}\n"
    stop_at = 0
    arguments = reinforce.Arguments(episodes=8, seed=3, minutes=0.0)
    (once,) = reinforce.learn(Stopped(), arguments)
    with np.load(out) as kept:
        assert set(kept) == set(once) and all(np.array_equal(kept[name], once[name]) for name in once)


def test_returns_are_discounted():
    assert reinforce.discounted([1.0, 0.0, 4.0], 0.5) == [2.0, 2.0, 4.0]


# --- the shipped policy


def test_ppo_says_how_to_train_one_where_there_is_none(tmp_path):
    with pytest.raises(GalocError, match="train_ppo"):
        Ppo(tmp_path / "none.onnx")
    (tmp_path / "broken.onnx").write_bytes(b"not a network")
    with pytest.raises(GalocError, match="train_ppo"):
        Ppo(tmp_path / "broken.onnx")


def test_ppo_needs_no_torch():
    code = "import sys, galoc_agents.ppo; assert not {'torch', 'stable_baselines3'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_shipped_policy_is_repeatable_and_draws(env):
    walks = []
    for seed in (3, 3, 4):
        observation, info = env.reset(seed=3)
        policy = Ppo()
        policy.reset(Robot.of(env, seed, 12))
        taken = []
        for _ in range(12):
            taken.append(policy.act(observation, {key: info[key] for key in TOLD}))
            observation, _, _, _, info = env.step(taken[-1])
        walks.append(taken)
    assert walks[0] == walks[1] and set(walks[0]) <= {0, 1, 2, 3}
    chances = np.exp(policy.scores(observation, info))
    assert chances.shape == (4,) and np.isfinite(chances).all()


def shipped(vector):
    (logits,) = Ppo()._session.run(None, {"features": vector[None].astype(np.float32)})
    return logits[0]


def test_the_shipped_policy_has_no_better_side(rng):
    vector = rng.normal(size=SIZE).astype(np.float32)
    index, sign = mirrored()
    assert shipped(sign * vector[index]) == pytest.approx(shipped(vector)[list(MIRRORED_MOVES)], abs=1e-5)


def test_the_shipped_policy_turns_to_the_open_side(env):
    features = Features()
    observation, info = env.reset(seed=1)
    features.reset(Robot.of(env, 1, 10))
    vector = features.see(observation, info)
    left, right = np.arange(3, 9), np.arange(16, 22)
    for block, (near, far) in enumerate(((0.0, 1.8), (0.0, 0.8), (0.0, 1.0))):  # log-range, disagreement, in reach
        vector[block * SECTORS + left], vector[block * SECTORS + right] = far, near
    scores = shipped(vector)
    assert scores[2] > scores[3] + 0.5 and scores[2] > scores[:2].max()


def test_the_shipped_policy_walks_both_action_spaces(plan_file):
    model = assets.root() / "models" / "ppo.onnx"
    assert model.stat().st_size < 2_000_000
    policy = Ppo()
    taken = []
    for actions in ("discrete", "continuous"):
        env = FloorplanEnv(plan=plan_file, actions=actions, **BLIND)
        observation, info = env.reset(seed=5)
        policy.reset(Robot.of(env, 5, 6))
        for _ in range(6):
            action = policy.act(observation, {key: info[key] for key in TOLD})
            assert env.action_space.contains(action)
            observation, _, _, _, info = env.step(action)
        taken.append(info["pose"])
        env.close()
    assert taken[0] == pytest.approx(taken[1])


# --- the training script


def test_training_is_taken_up_again_and_gives_a_policy(tmp_path, plan_file, monkeypatch):
    pytest.importorskip("stable_baselines3", reason="needs the extra `rl` (stable-baselines3)")
    pytest.importorskip("onnx", reason="the export needs onnx")
    arguments = train_ppo.Arguments(out=tmp_path / "ppo", steps=128, processes=1, homes=1, rollout=64, minutes=5.0)
    train_ppo.Run(arguments).train()
    first = json.loads((tmp_path / "ppo" / "progress.json").read_text())
    again = train_ppo.Run(train_ppo.Arguments(**{**as_dict(arguments), "steps": 192}))
    assert again.rows == first["rows"] and len(again.rows) == 2
    model = again.train()
    rows = json.loads((tmp_path / "ppo" / "progress.json").read_text())["rows"]
    assert rows[:2] == first["rows"] and [row[0] for row in rows] == [64, 128, 192]
    assert rows[2][3:] != rows[0][3:]  # other episodes than at the very start
    assert (tmp_path / "ppo" / "curve.png").read_bytes().startswith(b"\x89PNG")
    assert len((tmp_path / "ppo" / "curve.csv").read_text().splitlines()) == 4
    with pytest.raises(GalocError, match="other arguments"):
        train_ppo.Run(train_ppo.Arguments(**{**as_dict(arguments), "seed": 1}))
    agrees_with_torch(tmp_path / "ppo", model)
    for name in ("checkpoint.zip", "progress.json"):
        (tmp_path / "ppo" / name).write_text("spoilt")
        with pytest.raises(GalocError, match=f"spoilt {name}"):
            train_ppo.Run(train_ppo.Arguments(**{**as_dict(arguments), "steps": 256})).train()


def as_dict(arguments):
    return {name: getattr(arguments, name) for name in arguments.__dataclass_fields__}


def agrees_with_torch(folder, model):
    """The exported network gives the mean of the trained one's answers about a world and its mirror image."""
    import torch
    from stable_baselines3 import PPO

    trained = PPO.load(folder / "checkpoint.zip", device="cpu")
    x = np.random.default_rng(0).normal(size=(3, SIZE)).astype(np.float32)
    index, sign = mirrored()

    def logits(vectors):
        with torch.no_grad():
            net = trained.policy
            return net.action_net(net.mlp_extractor.forward_actor(torch.from_numpy(vectors))).numpy()

    expected = (logits(x) + logits(sign * x[:, index])[:, MIRRORED_MOVES]) / 2
    (found,) = Ppo(model)._session.run(None, {"features": x})
    assert found == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("wrong", [{"minutes": -1.0}, {"processes": 0}, {"homes": 0}, {"rollout": 1}])
def test_bad_arguments_are_named(wrong, tmp_path):
    with pytest.raises(GalocError, match=next(iter(wrong))):
        train_ppo.Run(train_ppo.Arguments(out=tmp_path / "x", **wrong))
    assert not (tmp_path / "x").exists()
