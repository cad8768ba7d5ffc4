"""Other people's classes and functions, named on the command line or in an environment's arguments."""

from __future__ import annotations

import ast
import hashlib
import importlib
import importlib.util
import sys
from collections.abc import Iterator
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


OURS = ("galoc", "galoc_env")
"""What plugins are called from: no part of any, also of one that lies beside it in a checkout."""
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
    """SHA-256 of a module's file and of its helpers': results of another version are other results.

    Helpers are what it imports, directly or not, at once or later, from its own package, or from its folder where it is
    a single file; galoc and galoc_env are none. The files alone decide, not what happens to be loaded. None for a
    module without a file.
    """
    file = getattr(module, "__file__", None)
    if not file:
        return None
    own = Path(file).resolve()
    found = hashlib.sha256(own.read_bytes())
    for name, path in sorted(_helpers(module, own).items()):
        found.update(f"\0{name}\0".encode() + path.read_bytes())
    return found.hexdigest()


def _helpers(module: ModuleType, own: Path) -> dict[str, Path]:
    """Files of a module's helpers by dotted name."""
    top = module.__name__.partition(".")[0]
    places = [Path(place).resolve() for place in getattr(sys.modules.get(top), "__path__", ())]
    package = next((place for place in places if own.is_relative_to(place)), None)
    if package is None and own.parent.name in ("site-packages", "dist-packages"):
        return {}  # those beside it are other people's
    root = own.parent if package is None else package.parent
    found, waiting = {module.__name__: own}, list(_imports(module.__name__, own))
    if package is not None:
        waiting.append(module.__name__)  # and the packages around it
    while waiting:
        wanted = waiting.pop()
        first = wanted.partition(".")[0]
        if first in OURS or (package is not None and first != top):
            continue
        for name, path in _files(root, wanted):
            if name not in found:
                found[name] = path
                waiting += _imports(name, path)
    return {name: path for name, path in found.items() if path != own}


def _files(root: Path, dotted: str) -> Iterator[tuple[str, Path]]:
    """The file of a module, and those of the packages around it, by dotted name; none that lies elsewhere."""
    parts = dotted.split(".")
    for count in range(1, len(parts) + 1):
        place = root.joinpath(*parts[:count])
        for path in (place / "__init__.py", place.with_name(f"{place.name}.py")):
            if path.is_file():
                yield ".".join(parts[:count]), path.resolve()
                break


def _imports(name: str, path: Path) -> Iterator[str]:
    """What a module imports anywhere in its file, dotted; of ``from a import b`` it is ``a.b``, module or not."""
    try:
        tree = ast.parse(path.read_bytes())
    except (SyntaxError, ValueError):  # one that is never loaded, or no source
        return
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            try:
                base = importlib.util.resolve_name("." * node.level + (node.module or ""), package)
            except ImportError:  # beyond the outermost package
                continue
            yield from (f"{base}.{alias.name}" for alias in node.names)
