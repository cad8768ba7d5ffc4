"""The house rules that no single module can check: who imports whom, sizes, pins, and what files may say."""

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parent.parent
PACKAGES = {"galoc": REPO / "galoc", "galoc_env": REPO / "galoc_env", "galoc_agents": REPO / "agents" / "galoc_agents"}
MAY_NOT_IMPORT = {"galoc": {"galoc_env", "galoc_agents"}, "galoc_env": {"galoc_agents"}, "galoc_agents": set[str]()}
"""Imports point one way: galoc <- galoc_env <- galoc_agents."""
HEAVY = {"gymnasium", "trimesh", "pyrender", "torch", "matplotlib", "onnxruntime", "galoc_env", "galoc_agents"}
"""What a robot that only localizes must not pay for at import."""
MAX_LINES = 350

SKIPPED_FOLDERS = {".git", ".venv", ".hypothesis", "__pycache__", "build", "dist", "runs"}
# Written so that the patterns do not match themselves.
MACHINE_PATH = re.compile(r"(?<![\w.])/(?:root|work|home|Users|opt/pypi|tmp/w)/")
REGISTRY = re.compile(
    r"\b(?:pypi|pythonhosted|anaconda|condaforge|npmjs|crates)\.(?:org|com|io)\b|--(?:extra-)?index-url"
)


def modules(package: str) -> list[Path]:
    """Source files of a package."""
    return sorted(PACKAGES[package].rglob("*.py"))


def imported_names(path: Path) -> Iterator[str]:
    """Top-level names that a file imports anywhere in it, at run time or for type checking."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), str(path))):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.module.partition(".")[0]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
            name = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
            first = node.args[0] if node.args else None
            if name in {"import_module", "__import__"} and isinstance(first, ast.Constant):
                yield str(first.value).partition(".")[0]


def repository_files() -> list[Path]:
    """What git tracks or would add; every file outside build folders where there is no git."""
    if (REPO / ".git").exists() and shutil.which("git"):
        command = ["git", "-C", str(REPO), "ls-files", "-co", "--exclude-standard", "-z"]
        answer = subprocess.run(command, capture_output=True, check=False)
        if answer.returncode == 0:
            names = answer.stdout.decode().split("\0")
            return [REPO / name for name in names if name and (REPO / name).is_file()]
    found = (path for path in REPO.rglob("*") if path.is_file())
    return [
        p for p in found if not any(part in SKIPPED_FOLDERS or "_cache" in part for part in p.relative_to(REPO).parts)
    ]


def text_of(path: Path) -> str:
    """The file's text, or nothing for pictures and weights."""
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return ""


def test_import_galoc_stays_light() -> None:
    code = "import sys, galoc; print(*sorted({name.partition('.')[0] for name in sys.modules}))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=REPO).stdout
    assert "galoc" in loaded.split()
    assert not HEAVY & set(loaded.split())


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_point_one_way(package: str) -> None:
    files = modules(package)
    assert files
    forbidden = MAY_NOT_IMPORT[package]
    wrong = [f"{path.name}: {name}" for path in files for name in imported_names(path) if name in forbidden]
    assert not wrong


def test_imports_are_found_wherever_they_hide(tmp_path: Path) -> None:
    source = tmp_path / "hidden.py"
    source.write_text(
        "import a.b\nfrom c.d import e\nfrom . import own\nif 0:\n    import f as g\n"
        "def h():\n    from i import j\n    importlib.import_module('k.l'); __import__('m')\n"
    )
    assert set(imported_names(source)) == {"a", "c", "f", "i", "k", "m"}


def test_modules_stay_readable() -> None:
    sizes = {path: len(path.read_text(encoding="utf-8").splitlines()) for p in PACKAGES for path in modules(p)}
    assert {str(path.relative_to(REPO)): n for path, n in sizes.items() if n > MAX_LINES} == {}


def test_files_name_no_machine_and_no_registry() -> None:
    found = []
    for path in repository_files():
        text = text_of(path)
        hits = [match.group() for pattern in (MACHINE_PATH, REGISTRY) for match in pattern.finditer(text)]
        found += [f"{path.relative_to(REPO)}: {hit}" for hit in hits]
    assert not found


def test_the_patterns_find_what_they_look_for() -> None:
    user = "/".join(["", "home", "someone", "galoc"])
    assert MACHINE_PATH.search(f"path = '{user}'")
    assert not MACHINE_PATH.search("assets/home/plan.json")
    assert REGISTRY.search("https://" + "pypi" + ".org/simple")


def pins() -> dict[str, str]:
    """Name and version of every pin, the name in its normal form."""
    lines = (REPO / "constraints.txt").read_text(encoding="utf-8").splitlines()
    matches = [re.fullmatch(r"([A-Za-z0-9._-]+)==([A-Za-z0-9.+!]+)", line) for line in lines]
    bad = [line for line, match in zip(lines, matches, strict=True) if match is None]
    assert not bad, "constraints.txt holds name==version lines only"
    return {normal(match[1]): match[2] for match in matches if match}


def normal(name: str) -> str:
    """A package name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def test_every_dependency_is_pinned_within_its_bounds() -> None:
    from packaging.requirements import Requirement

    project = tomllib.loads((REPO / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    pinned = pins()
    for line in project["dependencies"] + project["optional-dependencies"]["dev"]:
        requirement = Requirement(line)
        assert normal(requirement.name) in pinned, line
        assert requirement.specifier.contains(pinned[normal(requirement.name)]), line


def test_no_second_opencv() -> None:
    assert [name for name in pins() if name.startswith("opencv")] == ["opencv-python-headless"]


def test_make_help_lists_every_public_target() -> None:
    listed = subprocess.run(["make", "-s", "help"], capture_output=True, text=True, check=True, cwd=REPO).stdout
    wanted = {"help", "setup", "demo", "test", "test-slow", "lint", "types", "clean"}
    assert {line.split()[0] for line in listed.splitlines()[1:]} == wanted
