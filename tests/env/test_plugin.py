"""Digests of other people's code: which files count, and that nothing else does."""

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import pytest
from small_world import small_plan

from galoc_env import plugin
from galoc_env.cli import main
from galoc_env.evaluate import inspect_policy

POLICY = """
import json, os
import numpy as np
from digest_helper import turn

with open("loaded", "a") as file:
    file.write("x")

class Mine:
    def reset(self, robot):
        from digest_later import nothing

    def act(self, observation, info):
        return turn()
"""
HELPER = "import digest_deep.base\n\n\ndef turn():\n    return digest_deep.base.LEFT\n"


@pytest.fixture
def alone(tmp_path, monkeypatch):
    """A policy file with helpers beside it; what it loads is forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    kept = set(sys.modules)
    (tmp_path / "digest_deep").mkdir()
    for name, text in {
        "mine.py": POLICY, "digest_helper.py": HELPER, "digest_later.py": "nothing = None\n",
        "digest_deep/__init__.py": "", "digest_deep/base.py": "LEFT = 2\n", "digest_deep/aside.py": "",
        "aside.py": "",
    }.items():  # fmt: skip
        (tmp_path / name).write_text(text)
    yield tmp_path
    for name in set(sys.modules) - kept:
        if name == "mine" or name.startswith("digest_"):
            del sys.modules[name]


def test_a_file_alone_has_its_own_digest(tmp_path):
    file = tmp_path / "alone.py"
    file.write_text("import os\nfrom numpy import pi\nfrom galoc import Floorplan\n\n\nclass A:\n    pass\n")
    (tmp_path / "galoc").mkdir()  # as in a checkout
    (tmp_path / "galoc" / "__init__.py").write_text("Floorplan = 1\n")
    module = plugin.load(f"{file}:A")[1]
    assert plugin.digest(module) == hashlib.sha256(file.read_bytes()).hexdigest()
    del sys.modules["alone"]


def test_every_file_that_a_file_imports_from_its_folder_counts(alone):
    module = plugin.load("mine.py:Mine")[1]
    before = plugin.digest(module)
    for name in ("mine.py", "digest_helper.py", "digest_later.py", "digest_deep/__init__.py", "digest_deep/base.py"):
        file = alone / name
        text = file.read_text()
        file.write_text(text + "# changed\n")
        assert plugin.digest(module) != before, name
        file.write_text(text)
        assert plugin.digest(module) == before
    (alone / "digest_helper.py").rename(alone / "digest_gone.py")  # the same bytes elsewhere
    assert plugin.digest(module) != before
    (alone / "digest_gone.py").rename(alone / "digest_helper.py")
    for name in ("aside.py", "digest_deep/aside.py", "digest_deep/base.pyc"):
        (alone / name).write_text("changed = True\n")
    plugin.load("aside:changed")
    assert plugin.digest(module) == before
    (alone / "digest_later.py").write_text("no Python at all\n")
    assert plugin.digest(module) not in (None, before)


def test_a_package_counts_and_what_lies_beside_it_does_not(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    texts = {
        "digest_pack/__init__.py": "", "digest_pack/one/__init__.py": "from . import tool\n",
        "digest_pack/one/mine.py": "from ..two import far\nfrom .near import *\nimport digest_side\n\nA = 1\n",
        "digest_pack/one/near.py": "", "digest_pack/one/tool.py": "", "digest_pack/two/far.py": "",
        "digest_pack/two/other.py": "", "digest_side.py": "",
    }  # fmt: skip
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    module = plugin.load("digest_pack.one.mine:A")[1]
    before, counted = plugin.digest(module), set()
    for name, text in texts.items():
        (tmp_path / name).write_text(text + "# changed\n")
        if plugin.digest(module) != before:
            counted.add(name)
        (tmp_path / name).write_text(text)
    assert counted == set(texts) - {"digest_pack/two/other.py", "digest_side.py"}
    for name in [name for name in sys.modules if name.startswith("digest_")]:
        del sys.modules[name]


def test_a_shipped_policy_counts_with_its_kernels_whatever_else_is_loaded():
    import galoc_agents

    folder = Path(galoc_agents.__file__).resolve().parent
    module = plugin.load("galoc_agents.infogain:InfoGain")[1]
    found = plugin._helpers(module, folder / "infogain.py")
    assert {"galoc_agents", "galoc_agents.memory", "galoc_agents._gain_kernel"} <= set(found)
    assert "galoc_agents.ppo" not in found and all(path.suffix == ".py" for path in found.values())
    code = (
        "import galoc_agents.ppo, galoc_agents.oracle\nfrom galoc_env.evaluate import inspect_policy\n"
        "inspect_policy('spin'); print(inspect_policy('infogain')[0])"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert told.split() == [inspect_policy("infogain")[0]]
    assert inspect_policy("infogain")[0] != inspect_policy("explore")[0]


def test_a_changed_helper_starts_a_run_anew_and_its_file_is_loaded_once(alone, capsys):
    small_plan().save(alone / "small.json")
    flags = [
        "evaluate", "--plan", "small.json", "--policy", "mine.py:Mine", "--steps", "3", "--detector", "oracle",
        "--localizer", "small_world:DeadReckoner", "--episodes", "2", "--out", "out",
    ]  # fmt: skip
    inspect_policy("mine.py:Mine")
    assert (alone / "loaded").read_text() == "x"
    main(flags)
    first = json.loads((alone / "out" / "summary.json").read_text())["job"]["digest"]
    main(flags)
    assert "starting anew" not in capsys.readouterr().err
    (alone / "digest_deep" / "base.py").write_text("LEFT = 3\n")
    main(flags)
    second = json.loads((alone / "out" / "summary.json").read_text())["job"]["digest"]
    assert f"finished of another run (digest {first} there, {second} now); starting anew" in capsys.readouterr().err
