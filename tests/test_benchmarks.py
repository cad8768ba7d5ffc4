"""The benchmark scripts: a tiny run from the command line, its files, and that a cut run goes on."""

import importlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from galoc import GalocError

TINY = {
    "single_image": ["--plans", "1", "--frames", "2", "--hfov", "108", "--jobs", "1"],
    "sequences": ["--plans", "1", "--steps", "12", "--conditions", "2%", "--jobs", "1"],
    "geometry": ["--frames", "12"],
    "layouts": ["--plans", "1", "--frames", "3"],
    "matching": ["--plans", "apartment", "--frames", "4", "--resolution", "0.05", "--steps", "0.1"],
    "startup": ["--plans", "apartment", "--runs", "1"],
    "heat_maps": ["--resolution", "0.05"],
    "light": ["--homes", "1"],
    "contact_sheet": ["--count", "2", "--width", "64"],
    "render": ["--sizes", "32x24", "--poses", "4", "--rounds", "2", "--slice-s", "0.001"],
    "env": ["--renderer", "none", "--sizes", "32x24", "--vector-size", "32x24", "--lanes", "1", "2", "--rounds", "1",
            "--slice-s", "0.001", "--localizers", "none", "--kinds", "single", "sync", "batch", "miniworld"],
    "detector": ["--homes", "1", "--frames", "2", "--jobs", "1"],
    "pixels": ["--plans", "1", "--frames", "2", "--jobs", "1"],
    "ladder": ["--homes", "1", "--frames", "1", "--jobs", "1"],
    "gallery": ["--homes", "1", "--frames", "3", "--count", "2"],
    "filter": ["--plans", "apartment", "--walks", "1", "--steps", "3", "--particles", "300"],
    "active": ["--policies", "stay", "spin", "no_such", "patrol", "--against", "spin", "--sets", "homes-test",
               "--episodes", "2", "--steps", "12", "--width", "64"],
    "ppo_curve": ["--homes", "2", "--steps", "12", "--jobs", "1"],
}  # fmt: skip
ROWS = {"single_image": "frames", "sequences": "walks"}


def run(repo: Path, script: str, out: Path, *more: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(repo / "benchmarks" / f"{script}.py"), *TINY[script], *more, "--out", str(out)]
    env = {**os.environ, "NUMBA_NUM_THREADS": "1"}
    return subprocess.run(command, capture_output=True, text=True, env=env, check=False, timeout=600)


@pytest.fixture
def common(repo: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(repo / "benchmarks"))
    return importlib.import_module("common")


@pytest.mark.parametrize("script", ["geometry", "layouts"])
def test_tiny_run_of_the_layout_benchmarks(script: str, repo: Path, tmp_path: Path) -> None:
    done = run(repo, script, tmp_path / "tiny")
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "tiny.json").read_text()
    assert "Infinity" not in text and "NaN" not in text and json.loads(text)
    assert "paper" in done.stdout and "ml" in done.stdout


def test_tiny_run_of_the_heat_maps(repo: Path, tmp_path: Path) -> None:
    done = run(repo, "heat_maps", tmp_path / "tiny")
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "tiny.json").read_text())["found"]
    assert (tmp_path / "tiny.png").read_bytes().startswith(b"\x89PNG")
    for name in ("cosine", "likelihood"):
        assert name in done.stdout and found[name]["certified"] and 0.0 <= found[name]["rank"] < 0.2


def test_tiny_run_of_the_filter_benchmark(repo: Path, tmp_path: Path) -> None:
    done = run(repo, "filter", tmp_path / "tiny")
    assert done.returncode == 0, done.stderr
    (plan,) = json.loads((tmp_path / "tiny.json").read_text())["plans"]
    assert (tmp_path / "tiny.png").read_bytes().startswith(b"\x89PNG")
    for name, found in plan["methods"].items():
        assert name in done.stdout
        assert found["ms"]["mean"] == pytest.approx(sum(mean for _, mean in found["parts_ms"].values()))
        assert 0.0 <= found["success"] <= 1.0
    assert plan["methods"]["plain, 36 headings"]["ratio"] == 1.0


def test_tiny_run_of_the_matching_benchmark(repo: Path, tmp_path: Path) -> None:
    done = run(repo, "matching", tmp_path / "tiny")
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "tiny.json").read_text()
    assert "Infinity" not in text and "NaN" not in text
    assert (tmp_path / "tiny.png").read_bytes().startswith(b"\x89PNG")
    rows = json.loads(text)["summary"]
    assert [(r["step"], r["scoring"]) for r in rows] == [
        (step, scoring) for step in (0.05, 0.1) for scoring in ("cosine", "likelihood")
    ]
    for row in rows:
        assert row["whole"] and row["scoring"] in done.stdout
        assert row["frames"] == row["equal"] == row["certified"] == 4  # every pose scored, none better
        assert row["ratio"]["worst"] <= row["ratio"]["median"]


def test_tiny_run_of_the_startup_benchmark(repo: Path, tmp_path: Path) -> None:
    done = run(repo, "startup", tmp_path / "tiny")
    assert done.returncode == 0, done.stderr
    (child,) = json.loads((tmp_path / "tiny.json").read_text())["runs"]["apartment"]
    stages = list(child["stages"].values())
    assert min(stages) > 0.0 and child["to_pose"] == pytest.approx(sum(stages[:5]))
    assert len(child["pose"]) == 3 and child["kernels"] > 0
    for stage in child["stages"]:
        assert stage in done.stdout


def test_tiny_run_of_the_render_benchmark(repo: Path, tmp_path: Path) -> None:
    done = run(repo, "render", tmp_path / "tiny")
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "tiny.json").read_text())
    assert (tmp_path / "tiny.png").read_bytes().startswith(b"\x89PNG")
    rows = {(r["name"], r["outputs"]): r["rate"] for r in result["rows"]}
    for name in ("raster fast", "raster default", "raster best", "gl", "pyrender"):
        for outputs in ("all", "rgb"):
            for middle, low, high in rows[name, outputs].values():
                assert 0.0 < low <= middle <= high
        assert name in done.stdout
    told = {reason.partition(":")[0] for reason in result["missing"]}
    for world in ("MiniWorld FourRooms", "MiniWorld Maze"):  # an extra: measured, or named with the reason
        assert (rows[world, "rgb"] is None) == (world in told) and world in done.stdout


def test_a_missing_miniworld_is_named(repo: Path, tmp_path: Path) -> None:
    only = ["--only", "MiniWorld FourRooms", "--miniworld", "no-such-python"]
    done = run(repo, "render", tmp_path / "tiny", *only)
    assert done.returncode == 0, done.stderr
    assert "not measured: MiniWorld FourRooms: " in done.stdout and "no-such-python" in done.stdout


def test_tiny_run_of_the_environment_benchmark(repo: Path, tmp_path: Path) -> None:
    done = run(repo, "env", tmp_path / "tiny")
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "tiny.json").read_text())
    assert (tmp_path / "tiny.png").read_bytes().startswith(b"\x89PNG")
    rows = {(r["name"], r["case"][2]): r["rate"] for r in result["rows"]}
    for case in (("single", 1), ("gymnasium sync", 1), ("gymnasium sync", 2), ("our batch", 1), ("our batch", 2)):
        assert rows[case]["cpu"][0] > 0.0 and case[0] in done.stdout
    pairs = {(r["name"], r["other"], r["case"][2]) for r in result["ratios"]}
    assert {("our batch", "gymnasium sync", 1), ("our batch", "gymnasium sync", 2)} <= pairs


@pytest.mark.parametrize("script", ["detector", "pixels", "ladder"])
def test_tiny_run_of_the_benchmarks_of_the_front_end(script: str, repo: Path, tmp_path: Path) -> None:
    done = run(repo, script, tmp_path / "tiny")
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "tiny.json").read_text()
    assert "Infinity" not in text and "NaN" not in text
    assert (tmp_path / "tiny.png").read_bytes().startswith(b"\x89PNG")
    result = json.loads(text)
    if script == "detector":
        rows = {row["method"]: row for row in result["summary"]}
        assert set(rows) == {"onnx", "onnx+k", "lines", "oracle3", "oracle5", "oracle7"}
        assert rows["oracle3"]["iou"] > 0.9 and rows["oracle3"]["precision"] > 0.9
    names = result["summary"] if script != "detector" else [row["method"] for row in result["summary"]]
    assert all(name.split("|")[0] in done.stdout for name in names)


def test_tiny_run_of_the_gallery(repo: Path, tmp_path: Path) -> None:
    done = run(repo, "gallery", tmp_path / "tiny")
    assert done.returncode == 0, done.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["tiny.json", "tiny.png", "tiny_failures.png"]
    iou = json.loads((tmp_path / "tiny.json").read_text())["iou"]
    assert 1 <= len(iou) <= 3 and f"{min(iou):.2f}" in done.stdout


def test_tiny_run_of_the_policy_leaderboard(repo: Path, tmp_path: Path) -> None:
    done = run(repo, "active", tmp_path / "tiny")
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "tiny.json").read_text()
    assert "Infinity" not in text and "NaN" not in text
    assert (tmp_path / "tiny.png").read_bytes().startswith(b"\x89PNG")
    result = json.loads(text)
    assert list(result["missing"]) == ["no_such"] and "not run: no_such: " in done.stdout
    stay, spin, patrol = result["scores"]["homes-test"]
    assert patrol["sees_truth"] and "patrol *" in done.stdout and not spin["sees_truth"]
    assert spin["capped_ratio"] is None and stay["capped_ratio"] is not None
    assert stay["path"]["value"] == 0.0 and all(0.0 <= s["capped"]["value"] <= 12.0 for s in (stay, spin, patrol))
    assert (tmp_path / "tiny.md").read_text().count("\n| spin ") == 1
    # What is done is not done again.
    kept = tmp_path / "tiny" / "homes-test" / "spin" / "episodes.jsonl"
    rows = [json.loads(line) for line in kept.read_text().splitlines()]
    kept.write_text("".join(json.dumps({**row, "path_m": 123.0}) + "\n" for row in rows))
    assert run(repo, "active", tmp_path / "tiny", "--policies", "spin").returncode == 0
    assert json.loads((tmp_path / "tiny.json").read_text())["scores"]["homes-test"][0]["path"]["value"] == 123.0


def test_tiny_run_of_the_learning_curve(repo: Path, tmp_path: Path) -> None:
    runs = []
    for seed in (0, 1):
        folder = tmp_path / f"ppo{seed}"
        folder.mkdir()
        shutil.copy(repo / "assets" / "models" / "ppo.onnx", folder)
        rows = [[1024.0 * (i + 1), 9.0 * i, 90.0 * i, 8.0 - i, 1.0, -0.5] for i in range(5 + seed)]
        kept = {"job": {"sees": "profile"}, "seconds": 60.0, "rows": rows}
        (folder / "progress.json").write_text(json.dumps(kept))
        runs.append(str(folder))
    done = run(repo, "ppo_curve", tmp_path / "tiny", "--runs", *runs)
    assert done.returncode == 0, done.stderr
    scores = json.loads((tmp_path / "tiny.json").read_text())["scores"]
    assert (tmp_path / "tiny.png").read_bytes().startswith(b"\x89PNG")
    assert list(scores) == ["random", "spin", "ppo0", "ppo1"] and all(name in done.stdout for name in scores)
    assert scores["ppo0"]["steps"] == scores["ppo1"]["steps"]  # the same network on the same episodes
    assert scores["spin"]["minus_spin"]["value"] == 0.0


@pytest.mark.parametrize("script", list(ROWS))
def test_tiny_run_and_its_resumption(script: str, repo: Path, tmp_path: Path) -> None:
    out = tmp_path / "results" / "tiny.v1"  # a dot in the name is no suffix
    done = run(repo, script, out)
    assert done.returncode == 0, done.stderr
    assert sorted(p.name for p in out.parent.iterdir()) == ["tiny.v1.json", "tiny.v1.png"]
    assert (out.parent / "tiny.v1.png").read_bytes().startswith(b"\x89PNG")
    text = (out.parent / "tiny.v1.json").read_text()
    assert "Infinity" not in text and "NaN" not in text
    result = json.loads(text)
    for method in ("paper", "ml", "oracle"):
        assert method in done.stdout
    _check(script, result)

    # What a cut run leaves: its job, finished rows, and the torn line that it was writing.
    row = {**result[ROWS[script]][0], "plan": "kept"}
    left = out.parent / "tiny.v1.partial.jsonl"
    left.write_text(json.dumps(result["settings"]) + "\n" + json.dumps(row) + '\n{"seed": 1, "pl')
    assert run(repo, script, out).returncode == 0
    again = json.loads((out.parent / "tiny.v1.json").read_text())
    assert again[ROWS[script]][0]["plan"] == "kept" and not left.exists()
    assert again["summary"] == result["summary"]


def _check(script: str, result: dict[str, Any]) -> None:
    if script == "single_image":
        summary = result["summary"][0]
        assert summary["frames"] == 2 and sum(summary["bins"].values()) == 4  # each frame once by coverage, by pairs
        assert summary["methods"]["ml"]["recall"]["1m"][0] >= summary["methods"]["ml"]["recall"]["0.1m"][0]
        assert len(result["frames"][0]["methods"]["ml+heights"]["error_m"]) == 2
    else:
        ml = result["walks"][0]["conditions"]["2%"]["ml"]
        assert len(ml["confidence"]) == len(ml["error_m"]) == 12
        assert result["summary"]["2%"]["ml"]["success"]["paper"]["1m"] == {}  # too short for any published T


@pytest.mark.parametrize(
    ("script", "flags"),
    [
        ("single_image", ["--methods", "magic"]),
        ("single_image", ["--frames", "0"]),
        ("sequences", ["--steps", "3"]),
        ("sequences", ["--conditions", "windy"]),
        ("filter", ["--walks", "0"]),
        ("detector", ["--table", "magic"]),
        ("detector", ["--homes", "0"]),
        ("pixels", ["--mode", "magic"]),
        ("pixels", ["--plans", "0"]),
        ("ladder", ["--homes", "0"]),
        ("matching", ["--frames", "0"]),
        ("startup", ["--runs", "0"]),
        ("render", ["--poses", "0"]),
        ("render", ["--sizes", "wide"]),
        ("render", ["--only", "magic"]),
        ("render", ["--shown", "4"]),
        ("env", ["--lanes", "0"]),
        ("env", ["--kinds", "magic"]),
        ("ppo_curve", ["--homes", "0"]),
        ("ppo_curve", ["--runs", "no_such"]),
        ("active", ["--episodes", "0"]),
        ("active", ["--policies", "magic"]),
    ],
)
def test_bad_flags_are_named(script: str, flags: list[str], repo: Path, tmp_path: Path) -> None:
    done = run(repo, script, tmp_path / "x", *flags)
    assert done.returncode != 0
    assert flags[0] in done.stderr and "Traceback" not in done.stderr


def test_only_open_tasks_are_run(common: ModuleType, tmp_path: Path) -> None:
    calls: list[int] = []

    def work(task: int) -> dict[str, int]:
        calls.append(task)
        if calls == [10, 20]:
            raise KeyboardInterrupt
        return {"double": 2 * task}

    args = {"job": {"a": 1}, "out": tmp_path / "r", "jobs": 1, "unit": "task"}
    with pytest.raises(KeyboardInterrupt):
        common.resumable(work, [10, 20, 30], **args)
    rows = common.resumable(work, [10, 20, 30], **args)
    assert [r["double"] for r in rows] == [20, 40, 60]
    assert calls == [10, 20, 20, 30]
    common.resumable(work, [10], **{**args, "job": {"a": 2}})  # of another job: nothing is taken up
    assert calls[4:] == [10]
    with pytest.raises(GalocError, match="jobs"):
        common.resumable(work, [10], **{**args, "jobs": 0})


def test_tiny_runs_of_light_and_contact_sheet(repo: Path, tmp_path: Path) -> None:
    done = run(repo, "light", tmp_path / "light")
    assert done.returncode == 0, done.stderr
    (row,) = json.loads((tmp_path / "light.json").read_text())["rows"]
    assert row["facets"] < row["triangles"]
    assert row["all"] == pytest.approx(sum(row[stage] for stage in ("build scene", "merge facets", "light"))
                                       + row["arrays and textures"])  # fmt: skip
    done = run(repo, "contact_sheet", tmp_path / "sheet")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "sheet.jpg").read_bytes()[:3] == b"\xff\xd8\xff"
