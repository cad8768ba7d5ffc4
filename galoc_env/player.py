"""The worker process: plays the episodes that its parent sends, and says at every moment what it is doing.

Messages to the parent are tuples, the first entry names the kind: ``("begins", plan)``, ``("seen", Step)``,
``("asks", call)``, ``("answered",)``, ``("done", Rollout, cpu_ms)``, ``("error", exception)``.
"""

from __future__ import annotations

import os
import queue
import signal
import sys
import threading
import traceback
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from galoc import GalocError
from galoc_env import detection
from galoc_env.benchmark_sets import Task
from galoc_env.env import FloorplanEnv
from galoc_env.play import Step, Watch, play
from galoc_env.policy import make_policy
from galoc_env.settings import DEFAULT_DETECTOR


@dataclass(frozen=True, slots=True)
class Game:
    """What all episodes of a run have in common."""

    policy: str
    """As on the command line."""
    arguments: dict[str, Any]
    """Of the environment."""
    steps: int
    """Actions per episode."""
    model: str | None
    """Digits of the detector's model (:func:`galoc_env.detection.model`)."""


def serve(connection: Connection, game: Game) -> None:
    """Play what comes until the parent closes the connection or ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's business
    _die_with_parent()
    tasks: queue.SimpleQueue[Task] = queue.SimpleQueue()
    # A thread of its own listens, so that the end of the parent is noticed in the middle of an episode too.
    threading.Thread(target=_listen, args=(connection, tasks), daemon=True).start()
    try:
        _play_all(connection, game, tasks)
    except GalocError as error:
        connection.send(("error", GalocError(error)))
    except BaseException:
        # The exception itself may not survive the way to the parent.
        connection.send(("error", RuntimeError(f"in a worker process:\n{traceback.format_exc()}")))


def _die_with_parent() -> None:
    """Have the system end this process with its parent, even while a policy's C code holds Python's lock (Linux)."""
    if sys.platform == "linux":
        import contextlib
        import ctypes

        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG


def _listen(connection: Connection, tasks: queue.SimpleQueue[Task]) -> None:
    try:
        while True:
            tasks.put(connection.recv())
    except (EOFError, OSError):
        os._exit(0)  # nobody is left to play for


class _Reporting(Watch):
    """Sends every moment of an episode to the parent."""

    def __init__(self, connection: Connection) -> None:
        self._send = connection.send

    def begins(self, plan: str) -> None:
        self._send(("begins", plan))

    def seen(self, step: Step) -> None:
        self._send(("seen", step))

    def asks(self, call: str) -> None:
        self._send(("asks", call))

    def answered(self) -> None:
        self._send(("answered",))


def _play_all(connection: Connection, game: Game, tasks: queue.SimpleQueue[Task]) -> None:
    found = detection.model(game.arguments.get("detector", DEFAULT_DETECTOR))
    if found != game.model:
        cure = "Its file was replaced meanwhile: start the command again."
        raise GalocError(f"a worker with model {found}", f"model {game.model}, as the others have", cure)
    policy, watch = make_policy(game.policy), _Reporting(connection)
    env: FloorplanEnv | None = None
    while True:
        task = tasks.get()
        arguments = task.arguments(game.arguments)
        if env is None or env.settings.plan != arguments.get("plan"):
            if env is not None:
                env.close()
            env = FloorplanEnv(**arguments)
        walk, cpu_ms = play(
            env, policy, task.seed, game.steps, name=game.policy, options=task.options, watch=watch
        )  # fmt: skip
        connection.send(("done", walk, cpu_ms))
