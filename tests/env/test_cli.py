import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import time
from functools import partial

import cv2
import imageio_ffmpeg
import numpy as np
import pytest
from small_world import small_plan

from galoc import assets
from galoc.detect.model import SHIPPED
from galoc_env import detection, evaluate
from galoc_env.benchmark_sets import make_set
from galoc_env.cli import main

RUN = "import sys; from galoc_env.cli import main; main(sys.argv[1:])"


@pytest.fixture(scope="module")
def plan_file(tmp_path_factory):
    return str(small_plan().save(tmp_path_factory.mktemp("plans") / "small plan.json"))


needs_model = pytest.mark.skipif(
    not (assets.root() / SHIPPED).is_file(), reason=f"this checkout has no {SHIPPED}: the learned detector needs it"
)

SHARED = ["--steps", "5", "--seed", "3", "--detector", "oracle"]


@pytest.fixture(scope="module")
def demo(plan_file, tmp_path_factory):
    """Folder of a demo, and what it printed."""
    out = tmp_path_factory.mktemp("runs") / "a new" / "folder"
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        main(["demo", "--plan", plan_file, *SHARED, "--out", str(out)])
    return out, said.getvalue()


def test_demo_writes_film_summary_and_numbers(demo, plan_file):
    out, said = demo
    assert sorted(p.name for p in out.iterdir()) == ["episode.mp4", "result.json", "summary.png"]
    assert "too short to say whether it converged" in said  # 6 observations, and it takes 10 in a row
    assert str(out / "episode.mp4") in said
    film = cv2.VideoCapture(str(out / "episode.mp4"))
    frames = [film.read()[1] for _ in range(6)]  # one per observation
    assert all(f.shape == (720, 1280, 3) and f.std() > 20.0 for f in frames) and not film.read()[0]
    probe = [imageio_ffmpeg.get_ffmpeg_exe(), "-hide_banner", "-i", str(out / "episode.mp4")]
    facts = subprocess.run(probe, capture_output=True, text=True).stderr
    assert "h264" in facts and "yuv420p" in facts  # what every browser plays
    summary = cv2.imread(str(out / "summary.png"))
    assert summary.shape[1] > 1000 and summary.std() > 20.0
    # NaN and infinity are no JSON.
    result = json.loads((out / "result.json").read_text(), parse_constant=lambda name: pytest.fail(name))
    assert result["settings"]["plan"] == plan_file and result["settings"]["seed"] == 3
    assert result["settings"]["detector"] == "oracle" and result["settings"]["model"] is None
    assert len(result["steps"]) == 6 and result["collisions"] == 0
    errors = [np.inf if s["error_m"] is None else s["error_m"] for s in result["steps"]]
    assert result["recall"]["0.5m"] == pytest.approx(np.mean(np.array(errors) < 0.5))


def test_demo_and_evaluation_see_the_same_walk(demo, plan_file, tmp_path):
    main(["evaluate", "--plan", plan_file, *SHARED, "--episodes", "1", "--out", str(tmp_path)])
    filmed = json.loads((demo[0] / "result.json").read_text())
    (walk,) = map(json.loads, (tmp_path / "episodes.jsonl").read_text().splitlines())
    assert walk["final_error_m"] == filmed["final_error_m"] and walk["recall"] == filmed["recall"]


def test_evaluation_says_what_it_found(plan_file, tmp_path, capsys):
    out = tmp_path / "a new" / "folder"
    arguments = ["evaluate", "--plan", plan_file, "--steps", "11", "--detector", "oracle", "--out", str(out)]
    main([*arguments, "--episodes", "2"])
    said = capsys.readouterr().out
    assert sorted(p.name for p in out.iterdir()) == [
        "episodes.jsonl",
        "error.png",
        "success.png",
        "summary.json",
        "timing.csv",
    ]
    for words in ("patrol (sees the truth)", "2 episodes in 1 plan, 11 steps each", "95 % interval over walks",
                  "recall 0.5m", "SR 0.3m (f3loc)", "steps to 0.5 m, held", "CPU ms", "detector oracle"):  # fmt: skip
        assert words in said
    assert str(out / "summary.json") in said
    assert max(map(len, said.splitlines())) < 120 + len(str(out))
    told = json.loads((out / "summary.json").read_text(), parse_constant=lambda name: pytest.fail(name))
    assert told["job"]["policy"] == "patrol" and told["job"]["sees_truth"] and told["episodes"] == 2
    assert told["job"]["arguments"]["detector_noise_px"] == 5.0 and told["job"]["steps"] == 11
    rows = [json.loads(line) for line in (out / "episodes.jsonl").read_text().splitlines()]
    assert [(r["episode"], r["seed"]) for r in rows] == [(0, 0), (1, 1)] and all(len(r["entropy"]) == 12 for r in rows)
    assert all(cv2.imread(str(out / name)).std() > 10.0 for name in ("success.png", "error.png"))


@needs_model
def test_the_learned_detector_is_the_default_and_its_model_is_named(plan_file, tmp_path, capsys):
    arguments = ["--plan", plan_file, "--steps", "2", "--seed", "1"]
    main(["demo", *arguments, "--out", str(tmp_path)])
    filmed = json.loads((tmp_path / "result.json").read_text())
    out = tmp_path / "walks"
    main(["evaluate", *arguments, "--episodes", "1", "--out", str(out)])
    found = json.loads((out / "summary.json").read_text())
    (walk,) = map(json.loads, (out / "episodes.jsonl").read_text().splitlines())
    digits = detection.model("onnx")
    assert filmed["settings"]["detector"] == found["job"]["arguments"]["detector"] == "onnx"
    assert filmed["settings"]["model"] == found["job"]["model"] == digits
    assert walk["recall"] == filmed["recall"]  # what is filmed is what is scored
    assert f"detector onnx, model {digits}" in capsys.readouterr().out
    # Walks of another model are not mixed in, and that is said.
    job = {**found["job"], "model": "0123456789ab"}
    marked = {**walk, "final_error_m": 7.25}
    (out / "partial.jsonl").write_text(json.dumps(job) + "\n" + json.dumps(marked) + "\n")
    (out / "summary.json").unlink()
    main(["evaluate", *arguments, "--episodes", "1", "--out", str(out)])
    assert json.loads((out / "episodes.jsonl").read_text()) == walk
    assert f"model 0123456789ab there, {digits} now" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(
    "detector", [{"detector": "oracle", "renderer": "none"}, pytest.param({"detector": "onnx"}, marks=needs_model)]
)
def test_workers_do_not_change_the_numbers(plan_file, detector, tmp_path):
    arguments = {"plan": plan_file, "width": 96, "height": 72, **detector}
    job = evaluate.make_job("patrol", arguments, 3, make_set(None, None, 0, print))
    for workers in (1, 2):
        evaluate.evaluate(job, 3, workers, tmp_path / str(workers))
    one, two = ((tmp_path / name / "episodes.jsonl").read_bytes() for name in "12")
    assert one == two


@pytest.mark.parametrize(
    "arguments",
    [
        ["demo", "--plan", "no_such_plan"],
        ["demo", "--plan", "PLAN", "--steps", "0"],
        ["demo", "--plan", "PLAN", "--seed", "-1"],
        ["demo", "--plan", "PLAN", "--odometry-noise", "-1"],
        ["demo", "--plan", "PLAN", "--detector", "magic"],
        ["demo", "--plan", "PLAN", "--detector-noise-px", "3"],
        ["evaluate", "--plan", "PLAN", "--detector-noise-px", "3"],
        ["demo", "--plan", "PLAN", "--homes", "ambiguous"],
        ["evaluate", "--plan", "PLAN", "--detector", "oracle", "--homes", "ambiguous"],
        ["demo", "--plan", "PLAN", "--out", "PLAN/inside"],
        ["evaluate", "--plan", "PLAN", "--detector", "oracle", "--out", "PLAN/inside"],
    ],
)
def test_bad_input_is_one_readable_line(arguments, plan_file, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stopped:
        main([a.replace("PLAN", plan_file) for a in arguments])
    assert stopped.value.code == 2
    said = capsys.readouterr().err
    assert "galoc-env: got" in said and "Traceback" not in said


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write into read-only folders")
def test_read_only_folder_is_refused(plan_file, tmp_path, capsys):
    tmp_path.chmod(0o500)
    with pytest.raises(SystemExit):
        main(["demo", "--plan", plan_file, "--out", str(tmp_path)])
    assert "read-only" in capsys.readouterr().err


def test_ctrl_c_leaves_nothing_half_written(plan_file, tmp_path):
    command = [
        sys.executable,
        "-c",
        RUN,
        "demo",
        "--plan",
        plan_file,
        "--steps",
        "5000",
        "--detector",
        "oracle",
        "--out",
        str(tmp_path),
    ]
    # Its own process group, signalled as a whole: that is what a terminal does, and ffmpeg gets it too.
    # Tests that run in a shell's background inherit an ignored interrupt; whoever presses Ctrl-C does not.
    heed = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True, preexec_fn=heed)
    try:
        until = time.monotonic() + 240.0  # kernels may have to be compiled first, on a busy machine
        while not list(tmp_path.glob(".episode*")) and time.monotonic() < until and process.poll() is None:
            time.sleep(0.1)
        time.sleep(0.5)
        os.killpg(process.pid, signal.SIGINT)
        _, said = process.communicate(timeout=30)
    finally:
        process.kill()
    assert process.returncode == 130, said
    assert "stopped" in said and "Traceback" not in said
    assert list(tmp_path.iterdir()) == []
