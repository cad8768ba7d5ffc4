"""Policy gradient in one file and nothing but numpy: the plain loop, to read and to start from.

    python -m galoc_agents.reinforce --minutes 5 --out runs/reinforce.npz

REINFORCE with a value baseline: play whole episodes, then make what turned out better than expected more likely. For
the policy that ships, :mod:`galoc_agents.train_ppo` does the same with more care.
"""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from gymnasium import Env
from numpy.typing import NDArray

from galoc import GalocError
from galoc.formats.atomic import write_atomic
from galoc_agents.lesson import Lesson
from galoc_env.cli import INTERRUPTED
from galoc_env.film import writable_folder

Array = NDArray[np.float64]
Weights = dict[str, Array]


@dataclass(frozen=True, slots=True)
class Arguments:
    """Learn to localize fast."""

    minutes: float = 5.0
    """How long."""
    out: Path = Path("runs/reinforce.npz")
    """Where the weights go."""
    seed: int = 0
    """Of network and episodes."""
    homes: int = 64
    """Training homes."""
    hfov_deg: float = 60.0
    """Horizontal field of view, degrees."""
    episodes: int = 32
    """Between two updates."""
    hidden: int = 64
    """Units of the hidden layer."""
    rate: float = 3e-3
    """Learning rate of Adam."""
    discount: float = 0.97
    """Of the next reward against this one."""
    entropy: float = 0.01
    """Reward for staying undecided, nats."""

    def check(self) -> None:
        """Refuse what cannot be played.

        Raises:
            GalocError: an argument out of range.
        """
        for name, low in (("minutes", 0.0), ("seed", 0), ("homes", 1), ("episodes", 1), ("hidden", 1)):
            if not getattr(self, name) >= low:
                raise GalocError(f"--{name} {getattr(self, name)}", f"{low:g} or more", f"Raise --{name}.")


def weights(rng: np.random.Generator, inputs: int, hidden: int, actions: int) -> Weights:
    """A network with one hidden layer, one score per action and a value."""
    return {
        "w1": rng.normal(0.0, inputs**-0.5, (inputs, hidden)),
        "b1": np.zeros(hidden),
        "w2": rng.normal(0.0, 0.01 * hidden**-0.5, (hidden, actions + 1)),
        "b2": np.zeros(actions + 1),
    }


def forward(w: Weights, x: Array) -> tuple[Array, Array, Array]:
    """(N, H) hidden units, (N, A) probabilities, (N,) values of inputs (N, S)."""
    h = np.tanh(x @ w["w1"] + w["b1"])
    out = h @ w["w2"] + w["b2"]
    p = np.exp(out[:, :-1] - out[:, :-1].max(axis=1, keepdims=True))
    return h, p / p.sum(axis=1, keepdims=True), out[:, -1]


def gradient(w: Weights, x: Array, actions: NDArray[np.int64], returns: Array, entropy: float) -> Weights:
    """Of mean(advantage * log p(action) + entropy bonus - (return - value)^2 / 2), uphill; the advantage is fixed."""
    h, p, value = forward(w, x)
    advantage = returns - value
    advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
    log_p = np.log(np.maximum(p, 1e-12))
    bonus = -p * (log_p - (p * log_p).sum(axis=1, keepdims=True))
    chosen = np.eye(p.shape[1])[actions]
    out = np.column_stack([advantage[:, None] * (chosen - p) + entropy * bonus, returns - value]) / len(x)
    back = (out @ w["w2"].T) * (1.0 - h**2)
    return {"w1": x.T @ back, "b1": back.sum(axis=0), "w2": h.T @ out, "b2": out.sum(axis=0)}


class Adam:
    """Steps uphill, each weight at its own pace."""

    def __init__(self, w: Weights, rate: float) -> None:
        self._rate, self._t = rate, 0
        self._mean, self._square = ({k: np.zeros_like(v) for k, v in w.items()} for _ in range(2))

    def step(self, w: Weights, g: Weights) -> None:
        """Change the weights in place."""
        self._t += 1
        for k in w:
            self._mean[k] += 0.1 * (g[k] - self._mean[k])
            self._square[k] += 0.001 * (g[k] ** 2 - self._square[k])
            mean, square = self._mean[k] / (1 - 0.9**self._t), self._square[k] / (1 - 0.999**self._t)
            w[k] += self._rate * mean / (np.sqrt(square) + 1e-8)


def episode(env: Env[Any, Any], w: Weights, rng: np.random.Generator) -> tuple[list[Any], list[int], list[float]]:
    """Observations, actions and rewards of one episode."""
    xs, actions, rewards = [], [], []
    x, _ = env.reset()
    over = False
    while not over:
        _, p, _ = forward(w, x[None].astype(np.float64))
        xs.append(x)
        actions.append(int(rng.choice(p.shape[1], p=p[0])))
        x, reward, terminated, truncated, _ = env.step(actions[-1])
        rewards.append(float(reward))
        over = terminated or truncated
    return xs, actions, rewards


def discounted(rewards: list[float], discount: float) -> list[float]:
    """Return from each step on."""
    out, later = [], 0.0
    for reward in reversed(rewards):
        later = reward + discount * later
        out.append(later)
    return out[::-1]


def learn(env: Env[Any, Any], a: Arguments) -> Iterator[Weights]:
    """Play and improve until the time is up, at least once; the weights after each update."""
    rng = np.random.default_rng(a.seed)
    assert env.observation_space.shape is not None
    w = weights(rng, env.observation_space.shape[0], a.hidden, int(env.action_space.n))  # type: ignore[attr-defined]
    adam, start, more = Adam(w, a.rate), time.monotonic(), True
    while more:
        played = [episode(env, w, rng) for _ in range(a.episodes)]
        x = np.array([v for xs, _, _ in played for v in xs], dtype=np.float64)
        actions = np.array([v for _, acts, _ in played for v in acts])
        returns = np.array([v for _, _, r in played for v in discounted(r, a.discount)])
        for _ in range(4):  # plain REINFORCE would take one step; a few cost little and change the policy little
            adam.step(w, gradient(w, x, actions, returns, a.entropy))
        more = time.monotonic() - start < 60.0 * a.minutes
        totals = [sum(r) for _, _, r in played]
        print(f"{time.monotonic() - start:6.0f} s  {len(x):5d} steps  return {np.mean(totals):6.3f}", flush=True)
        yield {k: v.copy() for k, v in w.items()}


def save(path: Path, w: Weights) -> Path:
    """Write the weights, whole or not at all."""
    file = io.BytesIO()
    np.savez(file, **w)  # type: ignore[arg-type]
    return write_atomic(path, file.getvalue())


def main() -> None:
    """Command line."""
    a, w = tyro.cli(Arguments), Weights()
    try:
        a.check()
        path = writable_folder(a.out.parent) / a.out.name
        env = Lesson(range(a.homes), seed=a.seed, hfov_deg=a.hfov_deg)
        for learnt in learn(env, a):
            w = learnt
        env.close()
        print(save(path, w))
    except GalocError as error:
        raise SystemExit(f"error: {error}") from None
    except KeyboardInterrupt:
        kept = f"what was learned so far is in {save(path, w)}" if w else "nothing was learned yet"
        print(f"stopped; {kept}", file=sys.stderr)
        raise SystemExit(INTERRUPTED) from None


if __name__ == "__main__":
    main()
