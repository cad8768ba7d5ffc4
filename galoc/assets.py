"""Files that ship with galoc: the one place that knows where they lie."""

from __future__ import annotations

from pathlib import Path

from galoc.errors import GalocError

_HERE = Path(__file__).resolve().parent


def root() -> Path:
    """The assets folder: inside the installed package, or beside it in a source checkout."""
    installed = _HERE / "assets"
    return installed if installed.is_dir() else _HERE.parent / "assets"


def path(name: str) -> Path:
    """Path of a shipped file, such as ``"plans/apartment.json"``.

    Raises:
        GalocError: no such file ships with galoc.
    """
    found = root() / name
    if not found.exists():
        shipped = sorted(str(p.relative_to(root())) for p in root().rglob("*") if p.is_file())
        raise GalocError(f"asset {name!r}", f"one of {shipped}", "Reinstall galoc or fix the name.")
    return found


def plan_names() -> list[str]:
    """Names of the shipped floorplans, which :meth:`galoc.Floorplan.load` takes in place of a path."""
    return sorted(p.stem for p in (root() / "plans").glob("*.json"))
