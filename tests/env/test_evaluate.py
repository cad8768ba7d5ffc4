"""Evaluation runs: stopped and resumed, policies that misbehave, fixed sets, and what the numbers come to."""

import ast
import json
import math
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure
from small_world import small_plan

from galoc import GalocError
from galoc_env import evaluate as evaluation
from galoc_env import evaluate_figures, evaluate_report
from galoc_env.benchmark_sets import make_set
from galoc_env.cli import main
from galoc_env.evaluate import evaluate, make_job
from galoc_env.intervals import Resampling

RUN = "import sys; from galoc_env.cli import main; main(sys.argv[1:])"
REPO = Path(__file__).resolve().parents[2]
RESULTS = ("episodes.jsonl", "summary.json")

POLICIES = '''
import os, re, signal, time

class Left:
    def reset(self, robot):
        self.seed, self.asked = robot.seed, 0

    def act(self, observation, info):
        self.asked += 1
        return 2

class Slow(Left):
    def act(self, observation, info):
        time.sleep(0.02)
        return super().act(observation, info)

class Stuck(Left):
    """Runs C code that never comes back and never lets go of Python's lock."""

    def act(self, observation, info):
        if super().act(observation, info) and self.seed == 2:
            open("stuck", "w").close()
            re.match("(a+)+$", 40 * "a" + "b")
        return 2

class Naughty(Left):
    def reset(self, robot):
        super().reset(robot)
        if self.seed == 6:
            time.sleep(3600.0)

    def act(self, observation, info):
        if super().act(observation, info) and self.asked == 3:
            if self.seed == 1:
                raise ValueError("no idea")
            if self.seed == 2:
                return float("nan")
            if self.seed == 3:
                re.match("(a+)+$", 40 * "a" + "b")
            if self.seed == 4:
                os._exit(3)
            if self.seed == 5:
                os.kill(os.getpid(), signal.SIGSEGV)
        return 2
'''


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a plan and a file of policies."""
    made = tmp_path_factory.mktemp("world")
    small_plan().save(made / "small.json")
    (made / "mine.py").write_text(POLICIES)
    return made


def flags(folder, policy, out, episodes, *more):
    return [
        "evaluate", "--plan", str(folder / "small.json"), "--policy", f"{folder / 'mine.py'}:{policy}", "--steps", "12",
        "--detector", "oracle", "--localizer", "small_world:DeadReckoner", "--episodes", str(episodes),
        "--out", str(out), *more,
    ]  # fmt: skip


def start(arguments, cwd):
    """The command in a session of its own, as a terminal has it."""
    env = {**os.environ, "PYTHONPATH": str(Path(__file__).parent), "NUMBA_NUM_THREADS": "1"}
    heed = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    command = [sys.executable, "-c", RUN, *arguments]
    return subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True, cwd=cwd, env=env, start_new_session=True, preexec_fn=heed
    )


def wait_until(ready, process=None, seconds=240.0):
    until = time.monotonic() + seconds
    while not ready():
        assert time.monotonic() < until, "it never happened"
        assert process is None or process.poll() is None, process.stderr.read()
        time.sleep(0.02)


def alive(session):
    """Processes of a session that are no zombies."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, its_session = stat.read_text().rpartition(")")[2].split()[:4]
        except OSError:  # ended meanwhile
            continue
        if int(its_session) == session and state != "Z":
            found.append(int(stat.parent.name))
    return found


def lines(path):
    return path.read_text().splitlines() if path.exists() else []


def test_a_killed_run_goes_on_to_the_same_bytes(folder, tmp_path, capsys):
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    main(flags(folder, "Slow", whole, 8, "--workers", "2"))
    process = start(flags(folder, "Slow", cut, 8, "--workers", "2"), tmp_path)
    try:
        wait_until(lambda: len(lines(cut / "partial.jsonl")) > 2, process)
        time.sleep(0.1 * (time.time_ns() % 10) / 10)  # any moment will do
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
    assert not (cut / "summary.json").exists()
    kept = len(lines(cut / "partial.jsonl"))
    main(flags(folder, "Slow", cut, 8, "--workers", "1"))
    for name in RESULTS:
        assert (cut / name).read_bytes() == (whole / name).read_bytes()
    assert kept > 1 and not (cut / "partial.jsonl").exists()
    assert len(lines(cut / "timing.csv")) == 9
    assert "starting anew" not in capsys.readouterr().err


def test_more_episodes_keep_those_that_are_done_and_other_settings_do_not(folder, tmp_path, capsys):
    out = tmp_path / "out"
    main(flags(folder, "Left", out, 2))
    rows = [json.loads(line) for line in lines(out / "episodes.jsonl")]
    marked = {**rows[0], "final_error_m": 7.25}
    (out / "episodes.jsonl").write_text("".join(json.dumps(row) + "\n" for row in [marked, rows[1]]))
    main(flags(folder, "Left", out, 3))
    grown = [json.loads(line) for line in lines(out / "episodes.jsonl")]
    assert grown[:2] == [marked, rows[1]] and grown[2]["seed"] == 2
    # Fewer of them: the others wait for the next time.
    main(flags(folder, "Left", out, 1))
    assert len(lines(out / "episodes.jsonl")) == 1 and len(lines(out / "partial.jsonl")) == 4
    assert "starting anew" not in capsys.readouterr().err
    main(flags(folder, "Left", out, 1, "--steps", "11"))
    said = capsys.readouterr().err
    assert "finished of another run (steps 12 there, 11 now); starting anew" in said
    (row,) = (json.loads(line) for line in lines(out / "episodes.jsonl"))
    assert row["final_error_m"] != 7.25 and len(row["error_m"]) == 12
    main(flags(folder, "Slow", out, 1, "--steps", "11"))
    assert ":Left there" in capsys.readouterr().err


def test_what_policies_do_wrong_costs_their_episode_and_no_more(folder, tmp_path, capsys):
    main(flags(folder, "Naughty", tmp_path, 8, "--workers", "2", "--act-timeout", "1.5"))
    said = capsys.readouterr().out
    rows = [json.loads(line) for line in lines(tmp_path / "episodes.jsonl")]
    assert [row["seed"] for row in rows] == list(range(8))
    expected = {
        1: "step 2: act raised ValueError: no idea",
        2: "step 2: act returned nan, expected 0 (forward), 1 (backward)",
        3: "step 2: act did not return within 1.5 s",
        4: "step 2: act ended the process (exit code 3)",
        5: "step 2: act ended the process (SIGSEGV)",
        6: "reset did not return within 1.5 s",
    }
    for row in rows:
        if row["seed"] not in expected:
            assert row["failure"] is None and len(row["error_m"]) == 13
            continue
        assert row["failure"].startswith(f"policy {folder / 'mine.py'}:Naughty")
        assert expected[row["seed"]] in row["failure"]
        assert row["steps_to_0.5m"] is None and not any(row["success"]["f3loc"].values())
        assert len(row["error_m"]) == (1 if row["seed"] == 6 else 3)
        assert row["final_error_m"] == pytest.approx(row["error_m"][-1], abs=1e-4)
    assert f"6 of 8 episodes failed and count as not localized; policy {folder / 'mine.py'}:Naughty" in said
    assert "act raised ValueError: no idea" in said and "and 3 more" in said
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["summary"]["failed episodes"]["value"] == 0.75 and len(summary["failures"]) == 6


@pytest.mark.skipif(sys.platform != "linux", reason="file systems and platforms may have no locks")
def test_two_runs_do_not_share_a_folder(folder, tmp_path, capsys):
    import fcntl

    handle = os.open(tmp_path, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    with pytest.raises(SystemExit):
        main(flags(folder, "Left", tmp_path, 1))
    assert "another run is at work" in capsys.readouterr().err and not list(tmp_path.iterdir())
    os.close(handle)
    main(flags(folder, "Left", tmp_path, 1, "--steps", "5"))
    assert "Too short to count as held: that takes 10 observations" in capsys.readouterr().out


def test_a_policy_that_cannot_be_made_is_named(tmp_path, capsys):
    (tmp_path / "beside_it.py").write_text("NUMBER = 3\n")
    file = tmp_path / "unmade.py"
    file.write_text("import sys\nfrom beside_it import NUMBER\nclass Exits:\n  def __init__(self): sys.exit(NUMBER)\n")
    for command in ("evaluate", "demo"):
        with pytest.raises(SystemExit) as ended:
            main([command, "--policy", f"{file}:Exits", "--detector", "oracle", "--out", str(tmp_path / "out")])
        assert ended.value.code == 2 and "raised SystemExit when it was made: 3" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
@pytest.mark.parametrize("whom", ["all", "parent"])
def test_nothing_is_left_running(whom, folder, tmp_path):
    process = start(flags(folder, "Stuck", tmp_path / "out", 4), tmp_path)
    try:
        wait_until((tmp_path / "stuck").exists, process)
        if whom == "all":  # Ctrl-C
            os.killpg(process.pid, signal.SIGINT)
        else:
            process.kill()
        _, said = process.communicate(timeout=60)
        wait_until(lambda: not alive(process.pid), seconds=30.0)
    finally:
        for pid in alive(process.pid):
            os.kill(pid, signal.SIGKILL)
    if whom == "all":
        assert process.returncode == 130 and "stopped" in said and "Traceback" not in said
    assert len(lines(tmp_path / "out" / "partial.jsonl")) == 3  # its job, and two episodes


def test_buildings_of_a_folder_in_turn(folder, tmp_path):
    plans, notes = tmp_path / "plans", []
    plans.mkdir()
    for name in ("b", "a"):
        small_plan().save(plans / f"{name}.json")
    (plans / "broken.json").write_text("{")
    (plans / "README").write_text("not a plan")
    chosen = make_set("buildings", plans, 0, notes.append)
    assert len(notes) == 2 and "README is left out" in notes[0] and "broken.json is left out" in notes[1]
    arguments = {"detector": "oracle", "renderer": "none", "localizer": "small_world:DeadReckoner"}
    job = make_job(f"{folder / 'mine.py'}:Left", arguments, 3, chosen)
    found = evaluate(job, 3, 1, tmp_path / "out")
    assert [row["plan"] for row in found.rows] == ["a.json", "b.json", "a.json"]
    assert set(job.described()["plans"]) == {"a.json", "b.json"}
    with pytest.raises(GalocError, match="homes = .* with plan"):  # at once, not in a worker
        make_job("spin", {**arguments, "homes": "ambiguous"}, 3, chosen)
    (plans / "a.json").write_text("")
    (plans / "b.json").write_text("")
    with pytest.raises(GalocError, match="without a sound plan"):
        make_set("buildings", plans, 0, notes.append)


def test_fixed_sets_name_their_worlds_and_seeds():
    homes = make_set("homes-test", None, 0, print)
    assert homes.arguments["split"] == "test"
    assert [(t.seed, t.options) for t in map(homes.task, (0, 99, 100))] == [
        (k, {"plan_seed": k % 100}) for k in (0, 99, 100)
    ]
    ambiguous = make_set("ambiguous", None, 0, print)
    assert ambiguous.arguments["homes"] == "ambiguous" and ambiguous.task(61).home == 1
    own = make_set(None, None, 7, print)
    assert own.task(2).seed == 9 and own.task(2).options is None and own.task(2).world == own.task(5).world


@pytest.mark.parametrize(
    "arguments",
    [
        ["--policy", "spinn"],
        ["--policy", "nowhere.py:Class"],
        ["--policy", "RAISES:Maker"],
        ["--set", "homes"],
        ["--set", "homes-test", "--seed", "3"],
        ["--set", "homes-test", "--plan", "apartment"],
        ["--set", "buildings"],
        ["--set", "buildings", "--plans", "no-such-folder"],
        ["--plans", "."],
        ["--episodes", "0"],
        ["--workers", "0"],
        ["--steps", "0"],
        ["--act-timeout", "0"],
        ["--actions", "wild"],
        ["--hfov-deg", "400"],
        ["--localizer", "small_world:NoStep", "--plan", "apartment", "--steps", "1"],
    ],
)
def test_bad_input_is_named_before_anything_is_written(arguments, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    raises = tmp_path / "raises.py"
    raises.write_text("class Maker:\n    def __init__(self):\n        raise RuntimeError('no weights')\n")
    given = [a.replace("RAISES", str(raises)) for a in arguments]
    with pytest.raises(SystemExit) as stopped:
        main(["evaluate", "--detector", "oracle", *given, "--out", "out"])
    assert stopped.value.code == 2
    said = capsys.readouterr().err
    assert "galoc-env: got" in said and "Traceback" not in said
    assert not (tmp_path / "out" / "summary.json").exists()
    if "--localizer" not in arguments:  # what a world says is known when the first one is built
        assert not (tmp_path / "out").exists()


def row(plan, held, seed=0, final=0.1):
    shares = {key: 0.5 for key in ("0.1m", "0.3m", "0.5m", "0.7m", "1m", "1m30deg")}
    found = {p: {f"{x:g}m": held is not None for x in (1.0, 0.5, 0.3, 0.2, 0.1)} for p in ("paper", "f3loc")}
    errors = [5.0] * 30 + [None if held is None else final] * 31
    return {
        "episode": seed, "seed": seed, "plan": plan, "policy": "some",
        **{f"steps_to_{x:g}m": held for x in (0.5, 0.3, 0.1)},
        "final_error_m": final, "final_error_rad": 0.1, "path_m": 2.0, "turns_rad": math.pi, "collisions": 1,
        "abstained": 0.25, "coverage": 0.5, "recall": shares, "success": found, "failure": None,
        "error_m": errors, "entropy": [None] * 61,
    }  # fmt: skip


def test_summary_of_known_episodes():
    rows = [row("a", 4), row("b", 31), row("c", None, final=None), row("d", 6)]
    found = evaluate_report.summarize(rows, 60)
    line = found["steps to 0.5 m, held (median)"]
    assert (line.value, line.low, line.high) == (6.0, 4.0, math.inf)
    assert found["steps to 0.5 m, at most 60 (mean)"].value == (4 + 31 + 60 + 6) / 4
    assert found["held 0.5 m by step 10"].value == 0.5 and found["held 0.5 m by step 30"].value == 0.5
    assert found["held 0.5 m at the end"].value == 0.75 and found["turned deg (mean)"].value == pytest.approx(180.0)
    recall, sr = found["recall 1m"], found["SR 0.3m (f3loc)"]
    assert (recall.value, recall.low, recall.high) == (0.5, 0.5, 0.5)
    assert sr.low < sr.value == 0.75 <= sr.high
    assert found["failed episodes"].high > 0.2  # none of four says little
    assert "held 0.5 m by step 30" not in evaluate_report.summarize(rows, 30)
    for draw in (evaluate_figures.success, evaluate_figures.error):
        assert draw(rows, 60, "four episodes").startswith(b"\x89PNG")


def test_where_nobody_is_ever_localized_the_picture_says_so():
    def middle(rows, steps):
        image = cv2.imdecode(np.frombuffer(evaluate_figures.success(rows, steps, "t"), np.uint8), cv2.IMREAD_GRAYSCALE)
        height, width = image.shape
        return int((image[height * 2 // 5 : height // 2, width // 3 : width * 2 // 3] < 160).sum())

    never = [row("a", None), row("b", None)]
    assert middle(never, 40) > 100 and middle(never, 3) > 100  # words
    assert middle([row("a", 0), row("b", 0)], 40) == 0
    for steps in (3, 40):
        axes = Figure().add_subplot()
        evaluate_figures.draw_success(axes, never, steps, 0.5, {"color": "k"}, "", band=True)
        x, y = axes.lines[0].get_xdata(), axes.lines[0].get_ydata()
        assert x[0] == 0 and x[-1] == axes.get_xlim()[1] > 0 and set(y) == {0.0}
        assert axes.get_ylim()[0] < -1.0  # the frame does not hide it


def test_plans_are_resampled_with_all_their_episodes(rng):
    # Ten plans of four equal episodes know as much as ten episodes, not as forty.
    values = rng.normal(size=10)
    few = Resampling([f"{k}" for k in range(10)]).mean(values)
    many = Resampling([f"{k}" for k in range(10) for _ in range(4)]).mean(np.repeat(values, 4))
    assert (many.low, many.high) == pytest.approx((few.low, few.high))
    alone = Resampling(["one"] * 40).mean(np.repeat(values, 4))  # one plan: over its episodes
    assert few.high - few.low > 1.5 * (alone.high - alone.low) > 0.0


def test_medians_and_ratios_of_resamples(rng):
    values = np.append(rng.uniform(1.0, 50.0, 40), [math.inf] * 5)
    sample = Resampling([f"{k // 3}" for k in range(45)])
    found = sample.median(values)
    assert found.value == np.sort(values)[22] and found.low <= found.value <= found.high
    weights = sample._weights
    for k in (1, 2, 3):
        drawn = np.sort(np.repeat(values, weights[k]))
        assert sample.medians(values)[k] == drawn[(len(drawn) - 1) // 2]
        assert sample.means(values[:45].clip(max=60))[k] == pytest.approx(
            np.mean(np.repeat(values.clip(max=60), weights[k]))
        )
    half = sample.ratio(values / 2.0, values, Resampling.medians)
    assert (half.value, half.low, half.high) == pytest.approx((0.5, 0.5, 0.5))
    assert math.isnan(sample.ratio(np.full(45, np.inf), np.full(45, np.inf), Resampling.medians).value)


def test_it_is_asked_for_its_own_names_alone():
    own = {
        name for name, value in vars(evaluation).items() if getattr(value, "__module__", None) == evaluation.__name__
    }
    files = [file for place in ("galoc_env", "agents", "benchmarks", "tests") for file in (REPO / place).rglob("*.py")]
    wanted = [
        alias.name for file in files for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module == evaluation.__name__ for alias in node.names
    ]  # fmt: skip
    assert {"evaluate", "make_job"} <= set(wanted) <= own
    assert not hasattr(evaluation, "rollout")
