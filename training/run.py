"""One command from nothing to a model: ``python -m training.run --minutes 120 --device auto``.

Stop it at any time: the next run of the same folder goes on where it was.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import tyro


@dataclass(frozen=True, slots=True)
class Options:
    """Train the layout network."""

    minutes: float = 120.0
    """Training time in all, over all runs of this folder: the learning rate falls over it."""
    device: str = "auto"
    """"auto", "cpu" or "cuda"."""
    out: Path = Path("runs/training")
    """Folder of checkpoint, log and shards."""
    threads: int = 0
    """Threads of the trainer on a CPU; 0: all cores."""
    workers: int = 0
    """Processes that make frames; 0: one for every two cores."""
    shards: int = 400
    """Shards of 256 frames (28 MB) kept on disk."""
    batch: int = 32
    """Frames per step."""
    rate: float = 2.5e-3
    """Highest learning rate."""
    reuse: float = 1.0
    """How often a frame is seen before other shards take its turn."""


def _interrupt(_signal: int, _frame: object) -> None:
    raise KeyboardInterrupt


def main(options: Options) -> None:
    """Start the workers, wait for the first frames, train."""
    for name in (signal.SIGINT, signal.SIGTERM):  # a job in the background is born deaf to the first
        signal.signal(name, _interrupt)
    cores = os.cpu_count() or 1
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")
    options.out.mkdir(parents=True, exist_ok=True)
    shards, stop = options.out / "shards", options.out / "stop"
    stop.unlink(missing_ok=True)
    workers = options.workers or max(1, cores // 2)
    context = multiprocessing.get_context("spawn")
    from training.stream import WIDTHS, generate_forever

    crew = [
        context.Process(
            target=generate_forever,
            args=(shards, seed, max(12, options.shards // workers)),
            kwargs={"stop": stop},
            daemon=True,
        )
        for seed in range(workers)
    ]
    for worker in crew:
        worker.start()
    try:
        import torch

        from training.trainer import Plan, Trainer, pick_device

        torch.set_num_threads(options.threads or cores)
        while any(not list(shards.glob(f"w{width}-*.npz")) for width in WIDTHS):
            if not any(worker.is_alive() for worker in crew):
                raise SystemExit("No frames: every worker ended. Run it again with --workers 1 to see why.")
            print("waiting for the first frames", flush=True)
            time.sleep(10.0)
        plan = Plan(
            options.minutes, options.batch, options.rate, device=pick_device(options.device), reuse=options.reuse
        )
        Trainer(options.out, shards, plan).run(60.0 * options.minutes)
        folder = "" if options.out == Options().out else f" --out {options.out}"
        print(f"Done. Next: python -m training.evaluate{folder}; python -m training.export{folder}", flush=True)
    except KeyboardInterrupt:
        print("Interrupted; the checkpoint is saved. Run the same command to go on.", flush=True)
    finally:
        stop.touch()
        for worker in crew:
            worker.join(timeout=30.0)


if __name__ == "__main__":
    main(tyro.cli(Options))
