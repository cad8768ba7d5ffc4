"""Work that can be stopped: finished pieces wait in a file until the result is written."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from galoc.formats.atomic import write_atomic


def jsonable(value: Any) -> Any:
    """The same data with None for numbers that JSON does not have (NaN, infinity)."""
    if isinstance(value, dict):
        return {str(k): jsonable(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [jsonable(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.integer | np.bool_):
        return value.item()
    return value


class Partial:
    """Episodes finished so far, one JSON line each, beside the output; the first line says what they belong to."""

    def __init__(self, path: Path, job: dict[str, Any]) -> None:
        self.path, self._job = path, jsonable(job)
        self.dropped: str | None = None
        """What :meth:`load` did not take over, for people; None: nothing was there, or all of it."""

    def load(self) -> dict[int, dict[str, Any]]:
        """Finished episodes by seed; none if the file is of another job. A torn last line is dropped."""
        rows = json_lines(self.path)
        if not rows or rows[0] != self._job:
            self.dropped = None
            if len(rows) > 1:
                self.dropped = another_run(self.path.name, len(rows) - 1, rows[0], self._job)
            rows = [self._job]
        # Written anew: the torn line must not swallow the next one.
        write_atomic(self.path, ("".join(json.dumps(row) + "\n" for row in rows)).encode())
        return {row["seed"]: _revived(row) for row in rows[1:]}

    def add(self, episode: dict[str, Any]) -> None:
        """Append a finished episode."""
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(jsonable(episode)) + "\n")

    def remove(self) -> None:
        """The result is written: the partial has done its work."""
        self.path.unlink(missing_ok=True)


def json_lines(path: Path) -> list[Any]:
    """The lines of a file, up to the first one that is no JSON; none of a file that is not there."""
    rows: list[Any] = []
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        return rows
    for line in lines:
        try:
            rows.append(json.loads(line))
        except json.JSONDecodeError:
            break
    return rows


def another_run(name: str, count: int, theirs: Any, ours: Any) -> str:
    """How another job differs from this one, and what is lost with it.

    Args:
        name: of the file that holds its episodes.
        count: of these.
        theirs: its job.
        ours: this job.
    """
    there, now = _flat(theirs), _flat(jsonable(ours))
    keys = [key for key in {**there, **now} if there.get(key) != now.get(key)]
    parts = ", ".join(f"{key} {there.get(key)} there, {now.get(key)} now" for key in keys)
    return f"{name} holds {count} finished of another run ({parts}); starting anew"


def _flat(job: Any) -> dict[str, Any]:
    """The settings of a job by name, whatever group they are in."""
    out: dict[str, Any] = {}
    for key, value in job.items() if isinstance(job, dict) else ():
        out.update(value if isinstance(value, dict) else {key: value})
    return out


def _revived(row: dict[str, Any]) -> dict[str, Any]:
    """An episode read back: an error that JSON could not hold was infinite."""
    if "final_error_m" not in row:
        return row
    return {**row, "final_error_m": math.inf if row["final_error_m"] is None else row["final_error_m"]}
