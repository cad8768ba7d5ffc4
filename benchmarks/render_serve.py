"""A contestant in a process of its own: does what it is told so many times, and says what that took.

It talks JSON by lines over its standard input and output, and needs nothing but the standard library: other people's
environments are measured with the Python they are installed in.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

Case = tuple[int, Callable[[], None], Callable[[], Any] | None]
"""Units of work in one lap, the lap, and what makes a sample picture (rows of RGB), if it has one."""
WARM_LAPS = 2


def process_cpu(pids: list[int]) -> float:
    """CPU seconds of this process, its threads, and some children that live."""
    total = time.process_time()
    for pid in pids:
        with open(f"/proc/{pid}/stat") as file:
            fields = file.read().rpartition(")")[2].split()
        total += (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return total


def serve(build: Callable[[dict[str, Any], Any], Case], children: Callable[[], list[int]] = list) -> None:
    """Answer until the input ends.

    Each line is {"case": ..., "laps": n}: n laps of a case, which is built when it is first named (n = 0: only that);
    with "picture": path its sample is written there as npy.

    Args:
        build: makes a case from the job (the process's first argument, JSON) and the case's name.
        children: processes whose CPU time counts too.
    """
    job = json.loads(sys.argv[1])
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what libraries print must not mix with the answers
    cases: dict[str, Case] = {}
    for line in sys.stdin:
        asked = json.loads(line)
        try:
            answer = _answer(asked, cases, build, job, children)
        except Exception as error:  # whatever is missing on this machine: the table says so
            answer = {"missing": f"{type(error).__name__}: {error}"}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


def _answer(
    asked: dict[str, Any],
    cases: dict[str, Case],
    build: Callable[[dict[str, Any], Any], Case],
    job: dict[str, Any],
    children: Callable[[], list[int]],
) -> dict[str, Any]:
    key = json.dumps(asked["case"])
    started = time.perf_counter()
    if key not in cases:
        cases[key] = build(job, asked["case"])
        for _ in range(WARM_LAPS):
            cases[key][1]()
    count, lap, sample = cases[key]
    if "picture" in asked and sample is not None:
        import numpy as np

        np.save(asked["picture"], sample())
    ready = time.perf_counter() - started
    wall, cpu = time.perf_counter(), process_cpu(children())
    for _ in range(asked["laps"]):
        lap()
    cpu, wall = process_cpu(children()) - cpu, time.perf_counter() - wall
    return {"count": count * asked["laps"], "cpu": cpu, "wall": wall, "build_s": ready}
