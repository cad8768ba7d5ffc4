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
    main(["evaluate", "--plan", plan_file, *SHARED, "--episodes", "1", "--out", str(tmp_path / "walks.json")])
    filmed = json.loads((demo[0] / "result.json").read_text())
    walk = json.loads((tmp_path / "walks.json").read_text())["walks"][0]
    assert walk["final_error_m"] == filmed["final_error_m"] and walk["recall"] == filmed["recall"]


def test_evaluation_resumes_and_cleans_up(plan_file, tmp_path, capsys):
    out = tmp_path / "walks.json"
    arguments = ["evaluate", "--plan", plan_file, "--steps", "3", "--detector", "oracle", "--out", str(out)]
    main([*arguments, "--episodes", "2"])
    first = json.loads(out.read_text())
    partial = tmp_path / "walks.json.partial.jsonl"
    assert not partial.exists()
    # A run that was stopped: seed 0 finished (marked), the line of seed 1 torn.
    marked = {**first["walks"][0], "final_error_m": 7.25}
    job = {key: first["settings"][key] for key in ("arguments", "steps", "model")}
    partial.write_text(json.dumps(job) + "\n" + json.dumps(marked) + "\n" + '{"seed": 1, "pl')
    main([*arguments, "--episodes", "2"])
    second = json.loads(out.read_text())
    assert second["walks"][0]["final_error_m"] == 7.25  # taken over
    assert second["walks"][1] == first["walks"][1]  # walked again
    said = capsys.readouterr()
    assert "95 % interval" in said.out and "starting anew" not in said.err
    # The partial of another job is not taken over.
    partial.write_text(json.dumps({**job, "steps": 99}) + "\n" + json.dumps(marked) + "\n")
    main([*arguments, "--episodes", "1"])
    assert json.loads(out.read_text())["walks"] == first["walks"][:1]
    said = capsys.readouterr().err
    assert "1 finished of another run (steps 99 there, 3 now); starting anew" in said


@needs_model
def test_the_learned_detector_is_the_default_and_its_model_is_named(plan_file, tmp_path, capsys):
    arguments = ["--plan", plan_file, "--steps", "2", "--seed", "1"]
    main(["demo", *arguments, "--out", str(tmp_path)])
    filmed = json.loads((tmp_path / "result.json").read_text())
    out = tmp_path / "walks.json"
    partial = tmp_path / "walks.json.partial.jsonl"
    main(["evaluate", *arguments, "--episodes", "1", "--out", str(out)])
    found = json.loads(out.read_text())
    digits = detection.model("onnx")
    assert filmed["settings"]["detector"] == found["settings"]["arguments"]["detector"] == "onnx"
    assert filmed["settings"]["model"] == found["settings"]["model"] == digits
    assert found["walks"][0]["recall"] == filmed["recall"]  # what is filmed is what is scored
    assert f"detector onnx, model {digits}" in capsys.readouterr().out
    # Walks of another model are not mixed in, and that is said.
    job = {**{key: found["settings"][key] for key in ("arguments", "steps")}, "model": "0123456789ab"}
    partial.write_text(json.dumps(job) + "\n" + json.dumps({**found["walks"][0], "final_error_m": 7.25}) + "\n")
    main(["evaluate", *arguments, "--episodes", "1", "--out", str(out)])
    assert json.loads(out.read_text()) == found
    assert f"model 0123456789ab there, {digits} now" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(
    "detector", [{"detector": "oracle", "renderer": "none"}, pytest.param({"detector": "onnx"}, marks=needs_model)]
)
def test_jobs_do_not_change_the_numbers(plan_file, detector):
    arguments = {"plan": plan_file, "width": 96, "height": 72, **detector}
    alone, shared = (list(evaluate.run_seeds(arguments, [0, 1], 3, jobs)) for jobs in (1, 2))
    assert sorted(shared, key=lambda e: e["seed"]) == alone


def test_summary_of_known_walks():
    def walk(converged, final):
        shares = {key: 0.5 for key in ("0.1m", "0.3m", "0.5m", "0.7m", "1m", "1m30deg")}
        success = {p: {f"{x:g}m": converged is not None for x in (1.0, 0.5, 0.3, 0.2, 0.1)} for p in ("paper", "f3loc")}
        return {"steps_to_converge": converged, "final_error_m": final, "recall": shares, "success": success}

    summary = evaluate.summarize([walk(4, 0.1), walk(31, 0.2), walk(None, 5.0), walk(6, 0.1)], 60)
    assert summary["converged by step 30"]["value"] == 0.5
    assert summary["converged at all"]["value"] == 0.75
    assert summary["steps to converge (median)"] == {"value": 6.0, "low": 4.0, "high": None}
    assert summary["recall 1m"] == {"value": 0.5, "low": 0.5, "high": 0.5}
    row = summary["SR 1m (paper)"]
    assert row["low"] < row["value"] == 0.75 <= row["high"]


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
        ["demo", "--plan", "PLAN", "--out", "PLAN/inside"],
        ["evaluate", "--plan", "PLAN", "--episodes", "0"],
        ["evaluate", "--plan", "PLAN", "--out", "PLAN/inside.json"],
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
