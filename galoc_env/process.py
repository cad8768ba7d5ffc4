"""What the process must be like: Ctrl-C that no import swallows, and no fork after kernels started threads."""

from __future__ import annotations

import importlib
import os
import signal
import sys
import threading

import numba

from galoc import GalocError


def import_whole(name: str) -> None:
    """Import a library, and let Ctrl-C wait until it is there.

    Some (trimesh) guard their optional imports with a bare ``except``, in which the KeyboardInterrupt would get lost.
    """
    before = signal.getsignal(signal.SIGINT)
    held = threading.current_thread() is threading.main_thread() and callable(before)
    if name in sys.modules or not held:
        importlib.import_module(name)
        return
    came: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        importlib.import_module(name)
    finally:
        signal.signal(signal.SIGINT, before)
        if came and callable(before):
            before(signal.SIGINT, None)


_lost_threads = False


def _after_fork() -> None:
    """In the child: GNU's OpenMP ends a process that goes on using the threads of its parent."""
    global _lost_threads
    try:
        _lost_threads = _lost_threads or (sys.platform == "linux" and numba.threading_layer() == "omp")
    except ValueError:  # no parallel kernel has run: the child starts its own threads
        pass


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def refuse_lost_threads() -> None:
    """Say so before a parallel kernel ends the process.

    Raises:
        GalocError: this process was forked after its parent had run such a kernel.
    """
    if _lost_threads:
        raise GalocError(
            "the galoc localizer in a process forked after its parent had run parallel kernels",
            "a process with threads of its own",
            'Start workers with the "spawn" method (AsyncVectorEnv(..., context="spawn")), or before anything else.',
        )
