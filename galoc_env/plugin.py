"""Other people's classes and functions, named on the command line or in an environment's arguments."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any


def load(spec: str) -> tuple[Any, ModuleType]:
    """What ``package.module:name`` or ``file.py:name`` stands for, and its module.

    Modules are also looked for in the current folder. ``name`` may have dots.

    Raises:
        ImportError, AttributeError, ValueError, OSError, SyntaxError: there is no such thing. Callers say what they
            wanted.
    """
    place, colon, name = spec.rpartition(":")
    if not (place and colon and name):
        raise ValueError("no module:name")
    if place.endswith(".py"):
        module = _from_file(Path(place))
    else:
        if str(Path.cwd()) not in sys.path:
            sys.path.insert(0, str(Path.cwd()))
        module = importlib.import_module(place)
    found: Any = module
    for part in name.split("."):
        found = getattr(found, part)
    return found, module


LOADING = (ImportError, AttributeError, ValueError, OSError, SyntaxError)
"""What :func:`load` raises."""


def _from_file(path: Path) -> ModuleType:
    found = importlib.util.spec_from_file_location(path.stem, path)
    if found is None or found.loader is None:
        raise ImportError(f"no Python in {path}")
    module = importlib.util.module_from_spec(found)
    # As with ``python file.py``, files beside it can be imported; behind all others, so that none is hidden.
    folder = str(path.resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)
    sys.modules.setdefault(path.stem, module)  # dataclasses and pickle look their module up there
    found.loader.exec_module(module)
    return module


def digest(module: ModuleType) -> str | None:
    """SHA-256 of a module's file: results of another version are other results. None for a module without a file."""
    file = getattr(module, "__file__", None)
    return hashlib.sha256(Path(file).read_bytes()).hexdigest() if file else None
