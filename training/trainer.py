"""The training loop: resumable, with a moving average of the weights and a progress line."""

from __future__ import annotations

import io
import json
import math
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from galoc.formats.atomic import write_atomic
from training.augment import augmented
from training.loss import inputs, losses, targets, total
from training.network import LayoutNet, Shape
from training.stream import Shuffler

CHECKPOINT = "checkpoint.pt"
WARM_UP = 200
"""Steps until the learning rate is reached."""
LAST_RATE = 0.02
"""Learning rate at the end, as a share."""
AVERAGE = 0.999
"""How much of the averaged weights each step keeps."""


@dataclass(frozen=True, slots=True)
class Plan:
    """How long and how fast to train."""

    minutes: float
    """Of this and all earlier runs together: the learning rate falls over this time."""
    batch: int = 32
    rate: float = 2.5e-3
    decay: float = 0.02
    reuse: float = 1.0
    """How often a frame is seen, on average, before other shards take its turn."""
    device: str = "cpu"
    every_s: float = 300.0
    """Seconds between checkpoints."""
    seed: int = 0


def pick_device(name: str) -> str:
    """The device that a name means: "auto" is a GPU where there is one."""
    return ("cuda" if torch.cuda.is_available() else "cpu") if name == "auto" else name


class Trainer:
    """Trains in a folder, from its checkpoint where it has one.

    Args:
        folder: of checkpoint and log.
        shards: folder of the data stream.
        plan: how long and how fast.
        shape: of a new network.
    """

    def __init__(self, folder: Path, shards: Path, plan: Plan, shape: Shape | None = None) -> None:
        self.folder, self.plan = folder, plan
        state: dict[str, Any] = {}
        if (folder / CHECKPOINT).exists():
            state = torch.load(folder / CHECKPOINT, map_location="cpu", weights_only=True)
            shape = Shape.of(state["shape"])
        self.shape = shape or Shape()
        torch.manual_seed(plan.seed)
        self.net = LayoutNet(self.shape).to(plan.device, memory_format=torch.channels_last)
        self._optimizer = torch.optim.AdamW(self.net.parameters(), lr=plan.rate, weight_decay=plan.decay)
        self.steps, self.seconds = 0, 0.0
        if state:
            self.net.load_state_dict(state["net"])
            self._optimizer.load_state_dict(state["optimizer"])
            self.steps, self.seconds = state["steps"], state["seconds"]
        average = state.get("average") or self.net.state_dict()
        self._average = {k: v.detach().clone().to(plan.device) for k, v in average.items()}
        rng = np.random.default_rng([plan.seed, self.steps])
        self._rng = rng
        self._stream = Shuffler(shards, plan.batch, rng, reuse=plan.reuse)
        self._recent: list[dict[str, float]] = []

    def run(self, until_s: float) -> None:
        """Train until that much time has been spent in all, saving on the way and when interrupted."""
        began, before, saved, shown = time.monotonic(), self.seconds, time.monotonic(), time.monotonic()
        try:
            while self.seconds < until_s:
                self._step()
                now = time.monotonic()
                self.seconds = before + now - began
                if now - shown > 20.0:
                    self._show()
                    shown = now
                if now - saved > self.plan.every_s:
                    self.save()
                    saved = now
        finally:
            self.save()

    def _rate(self) -> float:
        spent = min(1.0, self.seconds / (60.0 * self.plan.minutes))
        cosine = 0.5 * (1.0 + math.cos(math.pi * spent))
        return self.plan.rate * min(1.0, (self.steps + 1) / WARM_UP) * (LAST_RATE + (1.0 - LAST_RATE) * cosine)

    def _step(self) -> None:
        frames = augmented(self._stream.next(), self._rng)
        device = self.plan.device
        strip = inputs(frames).to(device).contiguous(memory_format=torch.channels_last)
        wanted = targets(frames)
        if device != "cpu":
            wanted = type(wanted)(*(t.to(device) for t in (wanted.row, wanted.seen, wanted.edge, wanted.semantic)))
        for group in self._optimizer.param_groups:
            group["lr"] = self._rate()
        with torch.autocast(device, torch.bfloat16):
            output = self.net(strip)
        parts = losses(output, wanted)
        loss = total(parts)
        self._optimizer.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(self.net.parameters(), 5.0)
        self._optimizer.step()
        self.steps += 1
        self._follow()
        self._recent.append({name: float(value.detach()) for name, value in parts.items()})

    @torch.no_grad()
    def _follow(self) -> None:
        keep = min(AVERAGE, (self.steps + 1) / (self.steps + 20))
        for name, value in self.net.state_dict().items():
            if value.dtype.is_floating_point:
                self._average[name].mul_(keep).add_(value, alpha=1.0 - keep)
            else:
                self._average[name].copy_(value)

    def _show(self) -> None:
        means = {name: float(np.mean([r[name] for r in self._recent])) for name in self._recent[0]}
        speed = self.steps * self.plan.batch / max(self.seconds, 1e-9)
        line = {
            "steps": self.steps,
            "minutes": self.seconds / 60.0,
            "frames_per_s": speed,
            "rate": self._rate(),
            **means,
        }
        text = "  ".join(f"{k} {v:.4g}" for k, v in line.items())
        print(f"[{self.seconds / 60.0:6.1f} / {self.plan.minutes:g} min] {text}", flush=True)
        with (self.folder / "log.jsonl").open("a") as file:
            file.write(json.dumps(line) + "\n")
        self._recent.clear()

    def averaged(self) -> LayoutNet:
        """The network with averaged weights, on the CPU."""
        net = LayoutNet(self.shape)
        net.load_state_dict({k: v.cpu() for k, v in self._average.items()})
        return net.eval()

    def save(self) -> None:
        """Write the checkpoint; it appears whole or not at all."""
        state: dict[str, Any] = {
            "net": self.net.state_dict(),
            "average": self._average,
            "optimizer": self._optimizer.state_dict(),
            "shape": asdict(self.shape),
            "steps": self.steps,
            "seconds": self.seconds,
            "frames": self.steps * self.plan.batch,
        }
        file = io.BytesIO()
        torch.save(state, file)
        write_atomic(self.folder / CHECKPOINT, file.getvalue())


def load_average(path: Path) -> tuple[LayoutNet, dict[str, Any]]:
    """The averaged network of a checkpoint, and what is known of its training."""
    state = torch.load(path, map_location="cpu", weights_only=True)
    shape = Shape.of(state["shape"])
    net = LayoutNet(shape)
    net.load_state_dict(state["average"])
    return net.eval(), {k: state[k] for k in ("steps", "seconds", "frames", "shape")}
