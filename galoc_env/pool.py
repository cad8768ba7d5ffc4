"""Worker processes that play episodes, and the watchdog over the policies in them.

The parent hears from every worker when its policy is called and when it has answered. One that does not answer in time
is killed from outside, which works whatever it is doing; it has cost its episode, and another worker takes its place.
Only the policy's own time counts: an environment may take as long as it needs.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from typing import Any

from galoc import GalocError
from galoc_env.benchmark_sets import Task, World
from galoc_env.play import Rollout, Step, failure_text
from galoc_env.player import Game, serve

TICK_S = 0.25
"""How often the watchdog looks, s."""
THREAD_VARIABLES = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""What numerical libraries read when they are loaded."""


@dataclass(frozen=True, slots=True)
class Played:
    """One episode that came to its end, good or bad."""

    task: Task
    walk: Rollout
    seconds: float
    """From the first observation to the end, as the clock on the wall has it."""
    act_cpu_ms: float | None
    """Median CPU time of an action, ms; None where nobody could measure it."""


@dataclass(slots=True, eq=False)
class _Worker:
    process: Any
    connection: Connection
    task: Task | None = None
    world: World | None = None
    """Where its last episode took place."""
    plan: str = ""
    steps: list[Step] = field(default_factory=list)
    call: str | None = None
    """What of the policy is running; None: nothing."""
    waited_s: float | None = None
    """How long it has been running; None: it has begun since the last look."""
    began: float = 0.0

    def start(self, task: Task) -> None:
        self.task, self.world, self.plan, self.steps, self.call = task, task.world, "", [], None
        # A worker that ended while it was idle is found out at the next look.
        with contextlib.suppress(OSError):
            self.connection.send(task)

    def note(self, kind: str, *what: Any) -> None:
        if kind == "begins":
            self.plan, self.began = what[0], time.monotonic()
        elif kind == "seen":
            self.steps.append(what[0])
        else:
            self.call, self.waited_s = (what[0] if kind == "asks" else None), None

    def finished(self, walk: Rollout, cpu_ms: Sequence[float] = ()) -> Played:
        assert self.task is not None
        task, self.task = self.task, None
        middle = round(statistics.median(cpu_ms), 3) if cpu_ms else None
        return Played(task, walk, time.monotonic() - self.began, middle)


class Pool:
    """Plays episodes in worker processes of its own; leave it with ``close``, which ends them.

    Args:
        game: what the episodes have in common.
        workers: processes.
        act_timeout: what one call of the policy may take, s.
    """

    def __init__(self, game: Game, workers: int, act_timeout: float) -> None:
        self._game, self._count, self._timeout = game, workers, act_timeout
        self._workers: list[_Worker] = []

    def play(self, tasks: Sequence[Task]) -> Iterator[Played]:
        """The episodes as they end. Those in one world are played by one worker, one after the other, if possible.

        Raises:
            GalocError: an environment that cannot be made, or a worker that was ended from outside.
        """
        left = _by_world(tasks)
        last = time.monotonic()
        while left or any(w.task for w in self._workers):
            self._occupy(left)
            wait([w.connection for w in self._workers], TICK_S)
            for worker in list(self._workers):
                yield from self._hear(worker)
            # Time in which this process itself stood still (Ctrl-Z, a sleeping laptop) is nobody's fault.
            now = time.monotonic()
            passed, last = min(now - last, 4 * TICK_S), now
            for worker in [w for w in self._workers if w.call is not None]:
                worker.waited_s = 0.0 if worker.waited_s is None else worker.waited_s + passed
                if worker.waited_s > self._timeout:
                    yield self._lost(worker, f"did not return within {self._timeout:g} s")

    def close(self) -> None:
        """End all workers at once."""
        for worker in self._workers:
            worker.process.kill()
        while self._workers:
            worker = self._workers.pop()
            worker.process.join()
            worker.connection.close()

    def _occupy(self, left: dict[World, list[Task]]) -> None:
        """Give every idle worker something to do: in the world it is in, else in one of its own, else in any."""
        while left:
            idle = next((w for w in self._workers if w.task is None), None)
            if idle is None and len(self._workers) == self._count:
                return
            worker = idle or self._hire()
            taken = {w.world for w in self._workers if w is not worker}
            own = (worker.world,) if worker.world in left else ()
            world = next((w for w in (*own, *left) if w in own or w not in taken), next(iter(left)))
            task = left[world].pop(0)
            if not left[world]:
                del left[world]
            worker.start(task)

    def _hire(self) -> _Worker:
        """Start a process. Ctrl-C waits meanwhile, and never reaches the new one, which inherits that."""
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=serve, args=(theirs, self._game), daemon=True)
        worker = _Worker(process, ours)
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            with _threads(self._count):
                process.start()
            self._workers.append(worker)
        finally:
            theirs.close()  # so that the end of the worker ends the connection
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        return worker

    def _hear(self, worker: _Worker) -> Iterator[Played]:
        """Take in what a worker has said since the last look."""
        alive = worker.process.is_alive()  # asked before: what it said last still counts
        try:
            while worker.connection.poll():
                kind, *rest = worker.connection.recv()
                if kind == "error":
                    raise rest[0]
                if kind == "done":
                    yield worker.finished(*rest)
                else:
                    worker.note(kind, *rest)
        except (EOFError, ConnectionError):
            alive = False
        if not alive:
            worker.process.join()
            yield self._lost(worker, f"ended the process ({_ending(worker.process.exitcode)})")

    def _lost(self, worker: _Worker, what: str) -> Played:
        """Let go of a worker whose policy did ``what``; the episode is over.

        Raises:
            GalocError: it was not the policy.
        """
        self._workers.remove(worker)
        worker.process.kill()
        worker.process.join()
        worker.connection.close()
        if worker.call is None or worker.task is None:
            got = f"a worker that ended outside the policy ({_ending(worker.process.exitcode)})"
            cure = "Is there enough memory? Start again with fewer --workers: finished episodes are kept."
            raise GalocError(got, "one that stays", cure)
        failure = failure_text(self._game.policy, worker.call, len(worker.steps) - 1, what)
        missing = self._game.steps + 1 - len(worker.steps)
        return worker.finished(Rollout(worker.task.seed, worker.plan, tuple(worker.steps), failure, missing))


def _by_world(tasks: Sequence[Task]) -> dict[World, list[Task]]:
    worlds: dict[World, list[Task]] = {}
    for task in tasks:
        worlds.setdefault(task.world, []).append(task)
    return worlds


@contextlib.contextmanager
def _threads(workers: int) -> Iterator[None]:
    """Let new processes share the cores: each gets its part of the threads, unless the user has said how many."""
    if workers == 1:
        yield
        return
    share = str(max(1, (os.cpu_count() or 1) // workers))
    added = {name: share for name in THREAD_VARIABLES if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


def _ending(code: int | None) -> str:
    """How a process ended."""
    if code is not None and code < 0:
        return signal.Signals(-code).name
    return f"exit code {code}"
