"""The learned policy that ships: a small network that chooses where to look next."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc import GalocError, assets
from galoc_agents.features import SIZE, Features
from galoc_agents.moves import as_action
from galoc_env.policy import Robot

MODEL = "models/ppo.onnx"
"""The shipped network, among galoc's assets."""
SHARPNESS = 2.0
"""Trained policies still explore: they are followed with their log-odds times this."""
TRAIN = "Train one: python -m galoc_agents.train_ppo --minutes 10 --out runs/ppo (with the extra `rl`)."


class Ppo:
    """Draws its moves as the trained network rates them; needs onnxruntime alone.

    It draws, by the robot's seed, because the best move again and again can be a circle: forward into a wall, say.

    Args:
        model: an ONNX file that :mod:`galoc_agents.train_ppo` wrote; None: the shipped one.

    Raises:
        GalocError: no such file, or not such a network.
    """

    def __init__(self, model: str | Path | None = None) -> None:
        self._session = _session(Path(model) if model is not None else assets.root() / MODEL)
        self._features = Features()

    def reset(self, robot: Robot) -> None:
        """A new episode begins."""
        self._robot = robot
        self._move: int | None = None
        self._features.reset(robot)
        self._rng = np.random.default_rng(robot.seed)

    def act(self, observation: dict[str, NDArray[Any]], info: dict[str, Any]) -> Any:
        """A move, the more likely the higher its score."""
        scores = SHARPNESS * self.scores(observation, info).astype(np.float64)
        chance = np.exp(scores - scores.max())
        self._move = int(self._rng.choice(len(chance), p=chance / chance.sum()))
        return as_action(self._robot, self._move)

    def scores(self, observation: dict[str, NDArray[Any]], info: dict[str, Any]) -> NDArray[np.float32]:
        """(4,) log-probability of each move, up to a constant."""
        vector = self._features.see(observation, info, self._move)
        (logits,) = self._session.run(["logits"], {"features": vector[None]})
        return np.asarray(logits[0], dtype=np.float32)


def _session(path: Path) -> Any:
    import onnxruntime

    if not path.is_file():
        raise GalocError(f"model {path.name!r}, which does not exist", "a trained policy", TRAIN)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1  # microseconds of work
    try:
        session = onnxruntime.InferenceSession(path.read_bytes(), options, providers=["CPUExecutionProvider"])
        shapes = {i.name: i.shape for i in session.get_inputs()}
    except Exception as error:  # onnxruntime's errors share no base class but this
        raise GalocError(f"model {path.name!r} that onnxruntime cannot open", "an ONNX file", TRAIN) from error
    if list(shapes) != ["features"] or shapes["features"][-1] != SIZE:
        got = f"model {path.name!r} with inputs {shapes}"
        raise GalocError(got, f"one input `features` of {SIZE} numbers", TRAIN)
    return session
