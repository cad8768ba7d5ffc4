"""Rounds in which contestants, each in a process of its own, take turns; medians, spreads and ratios of them."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from galoc import GalocError

ONE_THREAD = {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Environment of the contestants. What draws with OpenGL uses the threads that it uses by itself."""
CLOCKS = ("cpu", "wall")


class Contestant:
    """A process that runs ``render_serve.serve``."""

    def __init__(self, script: str, job: dict[str, Any], python: str = sys.executable, threads: int = 1) -> None:
        path = Path(__file__).with_name(script)
        environment = {**os.environ, **{name: str(threads) for name in ONE_THREAD}}
        self._process: subprocess.Popen[str] | None = None
        self._reason = ""
        try:
            self._process = subprocess.Popen(
                [python, str(path), json.dumps(job)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL, env=environment, text=True,
            )  # fmt: skip
        except OSError as error:
            self._reason = str(error)

    def ask(self, case: Any, laps: int, picture: Path | None = None) -> dict[str, Any]:
        """What so many laps took: "count", "cpu", "wall" and "build_s"; or "missing", the reason why it cannot be."""
        if self._process is None:
            return {"missing": self._reason}
        assert self._process.stdin is not None and self._process.stdout is not None
        asked = {"case": case, "laps": laps} | ({} if picture is None else {"picture": str(picture)})
        try:
            self._process.stdin.write(json.dumps(asked) + "\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline()
        except BrokenPipeError:
            line = ""
        return json.loads(line) if line else {"missing": f"its process ended ({self._process.wait()})"}

    def close(self) -> None:
        """End the process."""
        if self._process is None:
            return
        assert self._process.stdin is not None and self._process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()


@dataclass(slots=True)
class Entry:
    """A case of a contestant, and its rates so far."""

    name: str
    contestant: Contestant
    case: Any
    laps: int = 0
    build_s: float = 0.0
    missing: str | None = None
    """Why it was not measured."""
    rates: list[dict[str, float]] = field(default_factory=list)
    """Per round and clock, units of work per second."""


def race(entries: Sequence[Entry], rounds: int, slice_s: float) -> None:
    """Let all entries take turns, round after round, for about ``slice_s`` CPU seconds each; fills in their rates."""
    for entry in tqdm(entries, unit="build", leave=False):
        first = entry.contestant.ask(entry.case, 1)
        entry.missing = first.get("missing")
        if entry.missing is None:
            entry.build_s = first["build_s"]
            entry.laps = max(1, round(slice_s / max(first["cpu"], 1e-6)))
    running = [e for e in entries if e.missing is None]
    for _ in tqdm(range(rounds), unit="round", leave=False):
        for entry in running:
            took = entry.contestant.ask(entry.case, entry.laps)
            if "missing" in took:
                raise GalocError(f"{entry.name} that failed midway: {took['missing']}", "rates", "Mend that first.")
            entry.rates.append({c: took["count"] / max(took[c], 1e-9) for c in CLOCKS})


def spread(values: Sequence[float]) -> list[float]:
    """Median, least and largest."""
    return [float(np.median(values)), float(np.min(values)), float(np.max(values))]


def rate(entry: Entry) -> dict[str, list[float]] | None:
    """Median, least and largest rate by clock; None where there are none."""
    if not entry.rates:
        return None
    return {c: spread([r[c] for r in entry.rates]) for c in CLOCKS}


def ratio(entry: Entry, other: Entry) -> dict[str, list[float]] | None:
    """How many times faster it is than another: median, least and largest of the rounds, by clock."""
    if not entry.rates or not other.rates:
        return None
    pairs = list(zip(entry.rates, other.rates, strict=False))
    return {c: spread([a[c] / b[c] for a, b in pairs]) for c in CLOCKS}


def reasons(entries: Sequence[Entry]) -> list[str]:
    """What was not measured, and why."""
    return list(dict.fromkeys(f"{e.name}: {e.missing}" for e in entries if e.missing is not None))


def told(value: Sequence[float] | None, digits: int = 0) -> str:
    """Median with its range, for tables."""
    if value is None:
        return "-"
    return f"{value[0]:.{digits}f} ({value[1]:.{digits}f}-{value[2]:.{digits}f})"


def machine() -> dict[str, Any]:
    """Where this ran."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        model = next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        model = "unknown"
    return {"processor": model, "cores": os.cpu_count(), "load": list(os.getloadavg())}
