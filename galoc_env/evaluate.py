"""Evaluation of a policy and of the localizer along its way: episodes, their rows, and a run that can be stopped.

A run leaves in its folder ``episodes.jsonl`` (one line per episode), ``summary.json``, ``timing.csv``, ``success.png``
and ``error.png``. Times are kept apart: the first two are the same to the last byte however often it was stopped.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
import os
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from galoc import GalocError
from galoc.formats.atomic import write_atomic
from galoc_env import detection, evaluate_figures, evaluate_report, plugin
from galoc_env.benchmark_sets import EpisodeSet
from galoc_env.env import FloorplanEnv
from galoc_env.film import writable_folder
from galoc_env.partial import Partial, another_run, json_lines, jsonable
from galoc_env.player import Game
from galoc_env.policy import policy_and_module, sees_truth
from galoc_env.pool import Played, Pool

EPISODES, SUMMARY, TIMING, PARTIAL = "episodes.jsonl", "summary.json", "timing.csv", "partial.jsonl"
"""Files of a run."""
DIGITS = 4
"""Decimals of the curves in a row: a tenth of a millimetre."""

Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Job:
    """What is evaluated; episodes of another job are never mixed in."""

    game: Game
    """Policy, environment, steps, model."""
    episode_set: EpisodeSet
    """Worlds and starts."""
    digest: str | None
    """Of the policy's module and of its helpers, see :func:`galoc_env.plugin.digest`."""
    sees_truth: bool
    """The policy is told the truth: a bound."""
    act_timeout: float
    """What one call of the policy may take, s."""

    def described(self) -> dict[str, Any]:
        """The job as JSON data."""
        return {
            "policy": self.game.policy,
            "digest": self.digest,
            "sees_truth": self.sees_truth,
            **self.episode_set.described(),
            "arguments": self.game.arguments,
            "steps": self.game.steps,
            "model": self.game.model,
            "act_timeout": self.act_timeout,
        }


def make_job(
    policy: str, arguments: dict[str, Any], steps: int, episode_set: EpisodeSet, act_timeout: float = 60.0
) -> Job:
    """Put a job together, and refuse what cannot run before anything is written.

    Args:
        policy: name, "module:Class" or "file.py:Class".
        arguments: of :class:`FloorplanEnv`; the set's go before them. The reward plays no part.
        steps: actions per episode.
        episode_set: worlds and starts.
        act_timeout: what one call of the policy may take, s.

    Raises:
        GalocError: no such policy, one that cannot be made, bad arguments, a missing model, numbers out of range.
    """
    if steps < 1 or not 0.0 < act_timeout < math.inf:
        got = f"--steps {steps} --act-timeout {act_timeout:g}"
        raise GalocError(got, "at least 1 step and a time above 0 s", "Pass such numbers.")
    digest, truth = inspect_policy(policy)
    # Rewards are not looked at, and this one suits localizers without a belief too.
    arguments = {**arguments, **episode_set.arguments, "reward": "error"}
    env = FloorplanEnv(**episode_set.task(0).arguments(arguments))
    env.close()
    game = Game(policy, arguments, steps, detection.model(env.settings.detector))
    return Job(game, episode_set, digest, truth, act_timeout)


def inspect_policy(policy: str) -> tuple[str | None, bool]:
    """Make a policy once, to see that it can be made.

    Returns:
        First digits of the digest of its files (:func:`galoc_env.plugin.digest`), and whether it sees the truth.

    Raises:
        GalocError: no such policy, or it cannot be made.
    """
    try:
        made, module = policy_and_module(policy)
    except GalocError as error:
        got = error.got if error.got.startswith("policy") else f"policy {policy!r} with {error.got}"
        raise GalocError(got, error.expected, error.cure) from error
    digest = plugin.digest(module)
    return None if digest is None else digest[: detection.DIGITS], sees_truth(made)


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """What a run found."""

    job: Job
    rows: list[Row]
    """One per episode, as in ``episodes.jsonl``."""
    timing: list[Row]
    """"episode", "seconds" and "act_cpu_ms" of each."""
    summary: dict[str, evaluate_report.Line]
    """Statistics by name."""
    files: list[Path]


def evaluate(
    job: Job,
    episodes: int,
    workers: int,
    out: Path,
    *,
    note: Callable[[str], None] = lambda text: None,
    track: Callable[[int, int], None] = lambda done, total: None,
) -> Evaluation:
    """Play the first episodes of a job, but those that the folder already holds, and write what came out.

    Args:
        job: what is evaluated.
        episodes: how many.
        workers: processes.
        out: folder, made if needed.
        note: is told what was not taken over, and why.
        track: is told how many episodes are done, at the start and after each.

    Raises:
        GalocError: numbers out of range, a folder that cannot be written or that another run writes to, an environment
            that cannot be made.
    """
    if episodes < 1 or workers < 1:
        raise GalocError(f"--episodes {episodes} --workers {workers}", "at least 1 of each", "Pass 1 or more.")
    folder = writable_folder(out)
    with _alone(folder):
        return _evaluated(job, episodes, workers, folder, note, track)


def _evaluated(
    job: Job,
    episodes: int,
    workers: int,
    folder: Path,
    note: Callable[[str], None],
    track: Callable[[int, int], None],
) -> Evaluation:
    partial, rows = _resumed(folder, job, note)
    wanted = [job.episode_set.task(number) for number in range(episodes)]
    missing = [task for task in wanted if task.seed not in rows]
    track(episodes - len(missing), episodes)
    pool = Pool(job.game, min(workers, max(1, len(missing))), job.act_timeout)
    try:
        for i, played in enumerate(pool.play(missing), 1):
            row = _row(job, played)
            partial.add(row)
            rows[played.task.seed] = jsonable(row)
            track(episodes - len(missing) + i, episodes)
    finally:
        pool.close()
    found = _written(folder, job, [rows[task.seed] for task in wanted])
    if len(rows) == episodes:  # else it goes on holding those that nobody asked for this time
        partial.remove()
    return found


@contextlib.contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Keep other runs out of a folder: two would mix their episodes. The system lets go when this process ends.

    Raises:
        GalocError: another run is at work there.
    """
    with contextlib.ExitStack() as stack:
        # A platform or a file system without locks: then it is up to the user.
        with contextlib.suppress(ImportError, OSError):
            import fcntl

            handle = os.open(folder, os.O_RDONLY)
            stack.callback(os.close, handle)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                got = f"output folder {str(folder)!r}, in which another run is at work"
                raise GalocError(got, "a folder for every run", "Wait for it, or choose another --out.") from None
        yield


def _row(job: Job, played: Played) -> Row:
    """An episode as JSON data; the times in it are taken out before it is published."""
    walk, task = played.walk, played.task
    found = walk.metrics()
    return {
        "episode": task.episode,
        "seed": task.seed,
        "plan": Path(task.plan).name if task.plan else walk.plan,
        "policy": job.game.policy,
        **{f"steps_to_{x:g}m": walk.steps_to(x) for x in evaluate_report.HELD_M},
        "final_error_m": found["final_error_m"],
        "final_error_rad": walk.steps[-1].error_rad,
        "path_m": round(walk.path_m(), DIGITS),
        "turns_rad": round(walk.turns_rad(), DIGITS),
        "collisions": found["collisions"],
        "abstentions": sum(s.abstained for s in walk.steps),
        **{key: found[key] for key in ("abstained", "coverage", "recall", "success")},
        "failure": walk.failure,
        "error_m": [round(s.error_m, DIGITS) for s in walk.steps],
        "entropy": [round(s.entropy, DIGITS) for s in walk.steps],
        "timing": {"seconds": round(played.seconds, 3), "act_cpu_ms": played.act_cpu_ms},
    }


def _resumed(folder: Path, job: Job, note: Callable[[str], None]) -> tuple[Partial, dict[int, Row]]:
    """Episodes of this very job that the folder holds, by seed: of a stopped run and of a finished one."""
    partial = Partial(folder / PARTIAL, job.described())
    rows = {seed: jsonable(row) for seed, row in partial.load().items()}
    if partial.dropped is not None:
        note(partial.dropped)
    finished = json_lines(folder / EPISODES)
    try:
        theirs = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))["job"]
    except (OSError, ValueError, KeyError, TypeError):
        return partial, rows
    if theirs != jsonable(job.described()):
        if not rows and finished:
            note(another_run(EPISODES, len(finished), theirs, job.described()))
        return partial, rows
    times = _times(folder / TIMING)
    for row in finished:
        if row["seed"] not in rows:
            rows[row["seed"]] = {**row, "timing": times.get(row["episode"], {"seconds": None, "act_cpu_ms": None})}
            partial.add(rows[row["seed"]])
    return partial, rows


def _times(path: Path) -> dict[int, Row]:
    """The times of finished episodes; none where the file was lost or spoilt."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            return {
                int(line["episode"]): {
                    key: float(line[key]) if line[key] else None for key in ("seconds", "act_cpu_ms")
                }
                for line in csv.DictReader(file)
            }
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _written(folder: Path, job: Job, kept: list[Row]) -> Evaluation:
    """Write the files of a run."""
    rows = [{key: value for key, value in row.items() if key != "timing"} for row in kept]
    timing = [{"episode": row["episode"], **row["timing"]} for row in kept]
    summary = evaluate_report.summarize(rows, job.game.steps)
    told = {
        "job": job.described(),
        "episodes": len(rows),
        "summary": {name: asdict(line) for name, line in summary.items()},
        "failures": [row["failure"] for row in rows if row["failure"] is not None],
    }
    table = io.StringIO()
    writer = csv.DictWriter(table, list(timing[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(timing)
    title = evaluate_report.title(job, rows)
    contents = {
        EPISODES: "".join(json.dumps(row) + "\n" for row in rows).encode(),
        SUMMARY: (json.dumps(jsonable(told), indent=1) + "\n").encode(),
        TIMING: table.getvalue().encode(),
        "success.png": evaluate_figures.success(rows, job.game.steps, title),
        "error.png": evaluate_figures.error(rows, job.game.steps, title),
    }
    files = [write_atomic(folder / name, data) for name, data in contents.items()]
    return Evaluation(job, rows, timing, summary, files)
