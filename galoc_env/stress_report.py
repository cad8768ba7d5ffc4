"""Files and tables of a stress run."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import Any

from galoc.formats.atomic import write_atomic
from galoc_env import stress_figures

FILES = ("conditions.csv", "stress.json", "verdicts.md", "stress.png")
"""What a run leaves in its folder."""


def write(result: dict[str, Any], folder: Path) -> list[Path]:
    """Write numbers, verdicts and figures.

    Args:
        result: of :func:`galoc_env.stress.collect`, NaN as None.
        folder: existing folder.

    Returns:
        The files: CSV (one row per condition and solver), JSON (settings, rows, verdicts), verdicts and figures.
    """
    contents = (
        rows_csv(result["rows"]),
        (json.dumps(result, indent=1) + "\n").encode(),
        verdicts(result["claims"]).encode(),
        stress_figures.page(result),
    )
    return [write_atomic(folder / name, data) for name, data in zip(FILES, contents, strict=True)]


def rows_csv(rows: list[dict[str, Any]]) -> bytes:
    """One line per condition and solver; histograms are in the JSON only."""
    text = io.StringIO(newline="")
    names = [name for name in rows[0] if name != "z_histogram"] if rows else ["sweep", "level", "solver"]
    writer = csv.DictWriter(text, names, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def verdicts(claims: list[dict[str, Any]]) -> str:
    """Markdown table of the paper's statements."""
    lines = ["| statement | measured | rule | verdict |", "| --- | --- | --- | --- |"]
    lines += [f"| {c['claim']} | {c['measured']} | {c['rule']} | **{c['verdict']}** |" for c in claims]
    return "\n".join(lines) + "\n"


def table(result: dict[str, Any]) -> str:
    """Ray error and failures of every condition, and the verdicts, for people."""
    rows = result["rows"]
    solvers = list(dict.fromkeys(row["solver"] for row in rows))
    lines: list[str] = []
    if rows:
        lines.append(f"{'mean ray error / % (failed views / %)':<36}" + "".join(f"{s[:16]:>17}" for s in solvers))
    cells: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        error = "   -" if row["ray_error"] is None else f"{100 * row['ray_error']:.2f}"
        cells.setdefault((row["sweep"], row["level"]), []).append(f"{error} ({100 * row['failure']:.1f})")
    lines += [f"{sweep:<14}{level:<22}" + "".join(f"{c:>17}" for c in row) for (sweep, level), row in cells.items()]
    if result["claims"]:
        lines += ["", f"{'verdict':<15}statement"]
        for claim in result["claims"]:
            lines += [f"{claim['verdict']:<15}{claim['claim']}", f"{'':<15}{claim['measured']}"]
    return "\n".join(lines)
