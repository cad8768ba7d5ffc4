"""JSON floorplans: ``segments`` in metres, with optional openings, outline and ceiling height."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from galoc.errors import GalocError
from galoc.floorplan import DEFAULT_CEILING, Floorplan, Opening
from galoc.plan_check import checked_segments

MAX_BYTES = 256 * 2**20
"""Larger files are refused before they are read."""
UNITS = ("m", "metre", "metres", "meter", "meters")
OPENING_KEYS = ("kind", "x1", "y1", "x2", "y2", "thickness", "bottom", "top")


def read_json(path: Path, ceiling_height: float | None = None) -> Floorplan:
    """Read a JSON plan.

    ``segments_doors_open``, where present, is preferred over ``segments``: a camera looks through open doorways.

    Args:
        path: the file.
        ceiling_height: replaces the file's value, m; openings taller than it are cut down to it.

    Raises:
        GalocError: not JSON, not a plan, another unit, bad values.
    """
    data = _parsed(path)
    try:
        opened = data.get("segments_doors_open")
        height = data.get("ceiling_height", DEFAULT_CEILING) if ceiling_height is None else ceiling_height
        return Floorplan(
            segments=opened or data["segments"],
            ceiling_height=DEFAULT_CEILING if height is None else height,
            openings=_openings(data.get("openings") or [], ceiling_height),
            outline=_closed_outline(data["segments"]) if opened and "outline" not in data else data.get("outline"),
            name=_text(data, "name", path.stem),
            notes=_text(data, "notes", ""),
        )
    except GalocError as error:
        raise GalocError(f"{path.name!r}: {error.got}", error.expected, error.cure) from error


def _closed_outline(segments: Any) -> Any:
    """Storey boundary from walls with closed doors, where they enclose one polygon; None where they do not."""
    from shapely import MultiLineString, Polygon, get_parts, polygonize, unary_union

    walls = checked_segments(segments)
    merged = unary_union(MultiLineString(list(walls.reshape(-1, 2, 2))))
    storey = unary_union(get_parts(polygonize(get_parts(merged))))
    return list(storey.exterior.coords) if isinstance(storey, Polygon) and not storey.is_empty else None


def to_json(plan: Floorplan) -> str:
    """The plan as JSON text, one wall a line; floats are written so that they read back bit-equal."""
    x_min, y_min, x_max, y_max = plan.bounds
    head: dict[str, Any] = {
        "name": plan.name,
        "units": "metre",
        "ceiling_height": plan.ceiling_height,
        "extent": [x_max - x_min, y_max - y_min],
        "notes": plan.notes,
    }
    parts = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in head.items()]
    parts.append(f'"segments": {_rows(plan.segments.tolist())}')
    parts.append(f'"openings": {_rows([asdict(opening) for opening in plan.openings])}')
    if plan.outline is not None:
        parts.append(f'"outline": {json.dumps(plan.outline.tolist())}')
    return "{\n" + ",\n".join(parts) + "\n}\n"


def _rows(items: list[Any]) -> str:
    return "[\n" + ",\n".join(f"  {json.dumps(item)}" for item in items) + "\n]" if items else "[]"


def _parsed(path: Path) -> dict[str, Any]:
    """The JSON object in a file."""
    words = 'a JSON object with "segments": [[x1, y1, x2, y2], ...] in metres'
    try:
        if path.stat().st_size > MAX_BYTES:
            raise GalocError(f"{path.name!r} of {path.stat().st_size} bytes", "at most 256 MiB", "Split the plan.")
        data = json.loads(path.read_bytes())
    except OSError as error:
        raise GalocError(f"{str(path)!r} ({error.strerror})", "a readable file", "Check the path.") from error
    except GalocError:
        raise
    except (ValueError, RecursionError) as error:
        raise GalocError(f"{path.name!r} that is not JSON ({error})", words, "Check the file.") from error
    if not isinstance(data, dict) or not isinstance(data.get("segments"), list):
        raise GalocError(f"{path.name!r} without a list of segments", words, "Check the file.")
    if data.get("units", "metre") not in UNITS:
        raise GalocError(f"{path.name!r} in units {data['units']!r}", "metres", "Convert the plan to metres.")
    return data


def _text(data: dict[str, Any], key: str, default: str) -> str:
    value = data.get(key, default)
    return value if isinstance(value, str) else json.dumps(value)


def _openings(items: Any, ceiling_height: float | None) -> tuple[Opening, ...]:
    """Openings from a list of objects; their heads are cut at a ceiling height that replaces the file's."""
    if not isinstance(items, list):
        raise GalocError("openings that are no list", f"a list of objects with {OPENING_KEYS}", "Fix the file.")
    out = []
    for index, item in enumerate(items):
        if not isinstance(item, dict) or set(item) != set(OPENING_KEYS):
            got = sorted(item) if isinstance(item, dict) else type(item).__name__
            raise GalocError(f"openings[{index}] with {got}", f"an object with {OPENING_KEYS}", "Fix the file.")
        opening = Opening(**item)
        if isinstance(ceiling_height, int | float) and isinstance(opening.top, int | float):
            opening = Opening(**{**item, "top": min(opening.top, ceiling_height)})
        out.append(opening)
    return tuple(out)
