"""Ctrl-C during imports, and workers that were forked too late."""

import multiprocessing
import os
import signal
import subprocess
import sys

import pytest
from small_world import small_plan

from galoc import GalocError
from galoc_env import process

CAREFUL = """import os, signal
try:
    os.kill(os.getpid(), signal.SIGINT)
    for _ in range(1000):
        pass
except BaseException:
    pass
done = True
"""
"""A library that swallows whatever happens during an optional import, as trimesh does."""

LATE = """
import multiprocessing, sys
from galoc_env.env import FloorplanEnv

def work(_):
    env = FloorplanEnv(sys.argv[1], renderer="none", detector="oracle")
    env.reset(seed=0)

if __name__ == "__main__":
    work(0)
    with multiprocessing.get_context("fork").Pool(1) as pool:
        pool.map_async(work, [0]).get(timeout=100)
"""


@pytest.fixture
def careful(tmp_path, monkeypatch):
    (tmp_path / "careful_library.py").write_text(CAREFUL)
    monkeypatch.syspath_prepend(tmp_path)
    yield "careful_library"
    sys.modules.pop("careful_library", None)


def test_ctrl_c_waits_for_the_import_and_is_not_lost(careful):
    handler = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        process.import_whole(careful)
    assert sys.modules[careful].done
    assert signal.getsignal(signal.SIGINT) is handler
    process.import_whole(careful)  # it is there: nothing happens


def test_without_a_handler_to_keep_it_just_imports(careful):
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        process.import_whole(careful)
    finally:
        signal.signal(signal.SIGINT, before)
    assert sys.modules[careful].done


def test_the_first_world_can_be_interrupted(tmp_path):
    (tmp_path / "trimesh.py").write_text(CAREFUL)
    plan = small_plan().save(tmp_path / "small.json")
    code = (
        "import sys; from galoc_env.env import FloorplanEnv; FloorplanEnv(sys.argv[1], localizer='none').reset(seed=0)"
    )
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", code, plan], capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path}
    )
    assert done.stderr.strip().endswith("KeyboardInterrupt"), done.stderr[-2000:]


@pytest.mark.skipif(
    "fork" not in multiprocessing.get_all_start_methods() or sys.platform != "linux",
    reason="GNU's OpenMP is what cannot go on in a child",
)
def test_a_worker_forked_too_late_says_so(tmp_path):
    plan = small_plan().save(tmp_path / "small.json")
    (tmp_path / "late.py").write_text(LATE)
    done = subprocess.run([sys.executable, tmp_path / "late.py", plan], capture_output=True, text=True)
    if done.returncode:  # there is none with other threading layers, whose children go on
        assert "GalocError" in done.stderr and "spawn" in done.stderr, done.stderr[-2000:]


def test_lost_threads_are_refused(monkeypatch):
    process.refuse_lost_threads()
    monkeypatch.setattr(process, "_lost_threads", True)
    with pytest.raises(GalocError, match="spawn"):
        process.refuse_lost_threads()
