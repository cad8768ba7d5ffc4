"""Trains the policy that ships: PPO of stable-baselines3, on homes that no test meets.

    python -m galoc_agents.train_ppo --minutes 10 --out runs/ppo

Started again with the same --out it goes on from the checkpoint. Leaves in OUT: checkpoint.zip, progress.json,
curve.csv, curve.png, ppo.onnx, and tensorboard/ where tensorboard is installed. Needs the extra `rl`.
"""

from __future__ import annotations

import io
import json
import sys
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from galoc import GalocError
from galoc.formats.atomic import write_atomic
from galoc_agents.lesson import Lesson
from galoc_env.cli import INTERRUPTED
from galoc_env.film import writable_folder

CHECKPOINT, PROGRESS = "checkpoint.zip", "progress.json"
COLUMNS = ("steps", "seconds", "episodes", "steps_to_localize", "localized", "return")
"""Of the learning curve: one row per rollout, the last three means over the episodes that ended in it."""
FREE = ("minutes", "steps", "out", "every_s")
"""Arguments that may change when a run is taken up again."""


@dataclass(frozen=True, slots=True)
class Arguments:
    """Train a policy that localizes fast."""

    minutes: float = 10.0
    """Of training, all runs into this folder together."""
    steps: int | None = None
    """Stop after so many, if that is sooner; the last rollout is played to its end."""
    out: Path = Path("runs/ppo")
    """Folder of the results."""
    seed: int = 0
    """Of network, homes and starts."""
    processes: int = 2
    """Environments, one process each; 1: in this process."""
    homes: int = 32
    """Generated homes of the training split to learn in, of each sort."""
    sorts: tuple[Literal["rooms", "ambiguous"], ...] = ("rooms",)
    """Sorts of homes."""
    first_home: int = 0
    """Number of the first of them."""
    hfov_deg: float = 60.0
    """Horizontal field of view, degrees."""
    sees: Literal["profile", "canvas", "headings"] = "profile"
    """What the network sees: galoc_agents.features."""
    rollout: int = 1024
    """Steps between two updates, all environments together."""
    every_s: float = 60.0
    """Seconds between two checkpoints."""

    def check(self) -> None:
        """Refuse what cannot be trained.

        Raises:
            GalocError: an argument out of range.
        """
        for name, low in (
            ("minutes", 0.0),
            ("processes", 1),
            ("homes", 1),
            ("seed", 0),
            ("rollout", 8 * self.processes),
        ):
            if not getattr(self, name) >= low:
                raise GalocError(f"--{name} {getattr(self, name)}", f"{low:g} or more", f"Raise --{name}.")
        if self.steps is not None and self.steps < 1:
            raise GalocError(f"--steps {self.steps}", "1 or more", "Raise --steps, or leave it out.")


class Run:
    """One training run in a folder, from its checkpoint where it has one.

    Args:
        arguments: of the command line.

    Raises:
        GalocError: a folder that cannot be written or holds a run with other arguments.
    """

    def __init__(self, arguments: Arguments) -> None:
        arguments.check()
        self.arguments, self.folder = arguments, writable_folder(arguments.out)
        self.rows: list[list[float]] = []
        self.seconds = 0.0
        self._job = json.loads(json.dumps({k: v for k, v in asdict(arguments).items() if k not in FREE}, default=str))
        if (self.folder / PROGRESS).exists() and (self.folder / CHECKPOINT).exists():
            try:
                kept = json.loads((self.folder / PROGRESS).read_text(encoding="utf-8"))
                job, self.seconds, self.rows = kept["job"], kept["seconds"], kept["rows"]
            except (ValueError, KeyError, TypeError) as error:
                raise self._spoilt(PROGRESS) from error
            if job != self._job:
                other = [f"--{k.replace('_', '-')} {v}" for k, v in job.items() if v != self._job.get(k)]
                got = f"a run in {self.folder.name!r} with other arguments ({', '.join(other)})"
                raise GalocError(got, "the same as now", "Choose another --out, or delete the folder.")

    def _spoilt(self, name: str) -> GalocError:
        return GalocError(f"a spoilt {name} in {self.folder.name!r}", "what a run left there", "Delete the folder.")

    def train(self) -> Path:
        """Train until the time is up and export; returns the ONNX file.

        Raises:
            GalocError: a library is missing, or the checkpoint is spoilt.
        """
        missing = [name for name in ("torch", "stable_baselines3", "onnx") if find_spec(name) is None]
        if missing:  # onnx is needed at the end alone: too late to say so
            cure = "Install galoc with the extra rl."
            raise GalocError(f"a Python without {', '.join(missing)}", "the libraries that training needs", cure)
        import torch

        torch.set_num_threads(1)  # the network is small: threads would only wait for each other
        env = self._environments()
        try:
            model = self._model(env)
            left = (self.arguments.steps or 10**9) - model.num_timesteps
            if left > 0 and self.seconds < 60.0 * self.arguments.minutes:
                model.learn(left, callback=_callback(self), reset_num_timesteps=False, tb_log_name="ppo")
            self.save(model)
        finally:
            with suppress(EOFError, OSError):  # after Ctrl-C the workers are gone before us
                env.close()
        (self.folder / "curve.png").write_bytes(curve_picture([self.rows], [self.arguments.out.name]))
        return write_atomic(self.folder / "ppo.onnx", onnx_model(model, self.note()))

    def note(self) -> dict[str, str]:
        """What the exported model says of itself."""
        steps = int(self.rows[-1][0]) if self.rows else 0
        return {"trained": json.dumps({**self._job, "steps": steps, "minutes": round(self.seconds / 60.0, 1)})}

    def save(self, model: Any) -> None:
        """Write checkpoint, progress and curve, each whole or not at all."""
        packed = io.BytesIO()
        model.save(packed)
        write_atomic(self.folder / CHECKPOINT, packed.getvalue())
        progress = {"job": self._job, "seconds": self.seconds, "rows": self.rows}
        write_atomic(self.folder / PROGRESS, (json.dumps(progress) + "\n").encode())
        lines = [",".join(COLUMNS), *(",".join(f"{v:.6g}" for v in row) for row in self.rows)]
        write_atomic(self.folder / "curve.csv", ("\n".join(lines) + "\n").encode())

    def _environments(self) -> Any:
        from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecMonitor

        a = self.arguments
        make: list[Any] = [
            partial(
                Lesson, range(a.first_home, a.first_home + a.homes), a.sees,
                seed=[a.seed, number], sorts=a.sorts, hfov_deg=a.hfov_deg,
            )
            for number in range(a.processes)
        ]  # fmt: skip
        made = DummyVecEnv(make) if a.processes == 1 else SubprocVecEnv(make, start_method="spawn")
        return VecMonitor(made, info_keywords=("localized",))

    def _model(self, env: Any) -> Any:
        from stable_baselines3 import PPO

        if self.seconds > 0.0:
            try:
                model = PPO.load(self.folder / CHECKPOINT, env=env, device="cpu")
            except (ValueError, OSError, KeyError) as error:
                raise self._spoilt(CHECKPOINT) from error
            # Loading has seeded everything as at the very start: it would live through the same episodes again.
            done = [self.arguments.seed, model.num_timesteps]
            model.set_random_seed(int(np.random.SeedSequence(done).generate_state(1)[0] >> 1))
            return model
        each = 4 * (self.arguments.rollout // (4 * self.arguments.processes))
        log = str(self.folder / "tensorboard") if find_spec("tensorboard") else None
        return PPO(
            "MlpPolicy", env, n_steps=each, batch_size=each * self.arguments.processes // 4, n_epochs=8,
            learning_rate=5e-4, gamma=0.97, gae_lambda=0.9, ent_coef=0.005, policy_kwargs={"net_arch": [128, 128]},
            seed=self.arguments.seed, device="cpu", tensorboard_log=log,
        )  # fmt: skip


def _callback(run: Run) -> Any:
    """Stops in time, keeps the curve, saves now and then, shows a bar."""
    from stable_baselines3.common.callbacks import BaseCallback
    from tqdm import tqdm

    class Watch(BaseCallback):
        def _on_training_start(self) -> None:
            self.limit, self.started, self.before = 60.0 * run.arguments.minutes, time.monotonic(), run.seconds
            self.saved, self.episodes = self.started, list[dict[str, Any]]()
            self.count = int(run.rows[-1][2]) if run.rows else 0
            self.bar = tqdm(total=round(self.limit), initial=round(run.seconds), unit="s")

        def _on_step(self) -> bool:
            for info in self.locals["infos"]:
                if "localized" in info:
                    self.episodes.append(info)
            run.seconds = self.before + time.monotonic() - self.started
            self.bar.update(min(round(run.seconds), self.bar.total) - self.bar.n)
            return run.seconds < self.limit

        def _on_rollout_end(self) -> None:
            done, self.episodes = self.episodes, []
            self.count += len(done)
            if not done:
                return
            found = np.array([info["localized"] for info in done], dtype=np.float64)
            knew = np.mean([info["knows"] for info in done])
            returns = float(np.mean([info["episode"]["r"] for info in done]))
            row = [self.num_timesteps, run.seconds, self.count, found.mean(), knew, returns]
            run.rows.append([float(v) for v in row])
            self.logger.record("rollout/steps_to_localize", found.mean())
            self.bar.set_postfix_str(f"{self.num_timesteps} steps, localized after {found.mean():.2f}")
            if time.monotonic() - self.saved > run.arguments.every_s:
                self.saved = time.monotonic()
                run.save(self.model)

        def _on_training_end(self) -> None:
            self.bar.close()

    return Watch()


def curve_picture(curves: list[list[list[float]]], names: list[str]) -> bytes:
    """PNG of steps to localize over training time, one line per run."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes = figure.subplots()
    for rows, name in zip(curves, names, strict=True):
        values = np.array(rows, dtype=np.float64).reshape(-1, len(COLUMNS))
        axes.plot(values[:, 1] / 60.0, values[:, 3], label=name)
    axes.set(xlabel="training time, minutes", ylabel="steps until localized (mean, training episodes)")
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False)
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=130)
    return png.getvalue()


def onnx_model(model: Any, note: dict[str, str]) -> bytes:
    """The policy as an ONNX graph, built layer by layer: "features" (N, S) to "logits" (N, 4).

    A policy that sees profiles is asked twice, about the world and about the mirrored one, and answers with the mean.
    """
    import onnx
    from onnx import TensorProto, helper, numpy_helper
    from torch import nn

    from galoc_agents.features import MIRRORED_MOVES, mirrored

    layers = [*model.policy.mlp_extractor.policy_net, model.policy.action_net]
    size = int(model.observation_space.shape[0])
    weights: dict[str, NDArray[Any]] = {}
    nodes: list[Any] = []

    def network(source: str, suffix: str) -> str:
        here = source
        for i, layer in enumerate(layers):
            after = f"layer{i}{suffix}"
            if isinstance(layer, nn.Linear):
                weights[f"weight{i}"], weights[f"bias{i}"] = (v.detach().numpy() for v in (layer.weight, layer.bias))
                nodes.append(helper.make_node("Gemm", [here, f"weight{i}", f"bias{i}"], [after], transB=1))
            else:
                nodes.append(helper.make_node("Tanh", [here], [after]))
            here = after
        return here

    straight = network("features", "")
    if note and json.loads(note["trained"])["sees"] == "profile":
        index, sign = mirrored()
        weights |= {
            "index": index,
            "sign": sign,
            "moves": np.array(MIRRORED_MOVES),
            "half": np.full(1, 0.5, np.float32),
        }
        nodes.append(helper.make_node("Gather", ["features", "index"], ["gathered"], axis=1))
        nodes.append(helper.make_node("Mul", ["gathered", "sign"], ["mirrored"]))
        nodes.append(helper.make_node("Gather", [network("mirrored", "m"), "moves"], ["back"], axis=1))
        nodes.append(helper.make_node("Add", [straight, "back"], ["sum"]))
        nodes.append(helper.make_node("Mul", ["sum", "half"], ["logits"]))
    else:
        nodes.append(helper.make_node("Identity", [straight], ["logits"]))
    graph = helper.make_graph(
        nodes, "ppo",
        [helper.make_tensor_value_info("features", TensorProto.FLOAT, ["N", size])],
        [helper.make_tensor_value_info("logits", TensorProto.FLOAT, ["N", 4])],
        [numpy_helper.from_array(np.asarray(value), name) for name, value in weights.items()],
    )  # fmt: skip
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    helper.set_model_props(made, note)
    onnx.checker.check_model(made)
    return bytes(made.SerializeToString())


def main() -> None:
    """Command line."""
    import tyro

    try:
        run = Run(tyro.cli(Arguments))
        print(run.train())
    except GalocError as error:
        raise SystemExit(f"error: {error}") from None
    except KeyboardInterrupt:
        print("stopped; the same command goes on from the last checkpoint", file=sys.stderr)
        raise SystemExit(INTERRUPTED) from None


if __name__ == "__main__":
    main()
