"""One episode of one policy: what it did, what the localizer made of it, and what it did wrong."""

from __future__ import annotations

import math
import re
import signal
import time
import traceback
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from galoc import GalocError
from galoc.metrics import SUCCESS_THRESHOLDS_M, recall, steps_to_converge, success
from galoc_env import motion
from galoc_env.env import FloorplanEnv
from galoc_env.partial import jsonable
from galoc_env.patrol import Patroller
from galoc_env.policy import Policy, Robot, told

PROTOCOLS = ("paper", "f3loc")
LONGEST_QUOTE = 160
"""Characters of a policy's action or exception that a failure quotes."""


@dataclass(frozen=True, slots=True)
class Step:
    """One observation of a rollout."""

    pose: tuple[float, float, float]
    """True x, y m, heading rad."""
    estimate: tuple[float, float, float] | None
    """Estimated pose; None where there was nothing to report."""
    error_m: float
    """Position error, m; infinity without an estimate."""
    error_rad: float
    """Heading error, rad; pi without an estimate."""
    entropy: float
    """Of the belief, nats; NaN without one."""
    coverage: float
    """Share of rays known, 0..1."""
    abstained: bool
    """This image showed no usable structure."""
    collided: bool
    """The body touched something on the way here."""

    @classmethod
    def of(cls, info: dict[str, Any]) -> Step:
        """What the environment says of a step."""
        estimate = info["estimate"]
        x, y, heading = (float(v) for v in info["pose"])
        found = tuple(float(v) for v in estimate) if math.isfinite(info["error_m"]) else None
        return cls(
            (x, y, heading),
            found,  # type: ignore[arg-type]
            float(info["error_m"]),
            float(info["error_rad"]),
            float(info.get("entropy", math.nan)),
            float(info["coverage"]),
            bool(info["abstained"]),
            bool(info["collided"]),
        )


@dataclass(frozen=True, slots=True)
class Rollout:
    """One walk; ``steps[0]`` is the observation of the reset."""

    seed: int
    plan: str
    steps: tuple[Step, ...]
    failure: str | None = None
    """Why the policy did not finish it; None: it did."""
    missing: int = 0
    """Observations that it did not get to."""

    @property
    def errors_m(self) -> list[float]:
        """Position error per observation, m."""
        return [s.error_m for s in self.steps]

    def steps_to(self, threshold_m: float) -> int | None:
        """First step from which the error stays below the threshold to the end; None: never, or the walk failed."""
        return steps_to_converge(self.errors_m, threshold_m) if self.failure is None else None

    def metrics(self) -> dict[str, Any]:
        """Recall, success under both protocols, convergence and final error of this walk.

        An observation that the policy did not get to is one without an estimate, and a walk that failed is no success.
        """
        errors = self.errors_m + [math.inf] * self.missing
        angles = [s.error_rad for s in self.steps] + [math.pi] * self.missing
        whole = self.failure is None
        return {
            "seed": self.seed,
            "plan": self.plan,
            "steps_to_converge": self.steps_to(0.5),
            "final_error_m": self.errors_m[-1],
            "recall": recall(errors, angles),
            "success": {
                p: {f"{x:g}m": whole and success(errors, x, p) for x in SUCCESS_THRESHOLDS_M} for p in PROTOCOLS
            },
            "coverage": float(np.mean([s.coverage for s in self.steps])),
            "abstained": float(np.mean([s.abstained for s in self.steps])),
            "collisions": sum(s.collided for s in self.steps),
        }

    def path_m(self) -> float:
        """Length of the true path, m."""
        return sum(math.dist(a.pose[:2], b.pose[:2]) for a, b in zip(self.steps, self.steps[1:], strict=False))

    def turns_rad(self) -> float:
        """Sum of all turns, left and right, rad."""
        return sum(abs(motion.wrap(b.pose[2] - a.pose[2])) for a, b in zip(self.steps, self.steps[1:], strict=False))


def steps_table(walk: Rollout) -> list[dict[str, Any]]:
    """The steps of a walk as JSON rows."""
    return [{"step": i, **jsonable(asdict(step))} for i, step in enumerate(walk.steps)]


class Watch:
    """Is told how an episode goes; this one does nothing with it."""

    def begins(self, plan: str) -> None:
        """The environment was reset, to this plan."""

    def seen(self, step: Step) -> None:
        """There is an observation; the first one is that of the reset."""

    def asks(self, call: str) -> None:
        """The policy's ``reset`` or ``act`` is called now."""

    def answered(self) -> None:
        """It has returned or raised."""


class _Misbehaved(Exception):
    """A policy raised, or returned what is no action; ``call`` did it."""

    def __init__(self, call: str, what: str) -> None:
        super().__init__(what)
        self.call = call


def play(
    env: FloorplanEnv,
    policy: Policy,
    seed: int,
    steps: int,
    *,
    name: str = "policy",
    options: dict[str, Any] | None = None,
    watch: Watch | None = None,
) -> tuple[Rollout, list[float]]:
    """Let a policy walk one episode; what it does wrong ends the walk and is told in ``failure``.

    Args:
        env: unwrapped, with a localizer.
        policy: chooses the actions.
        seed: of the environment and of the policy.
        steps: actions; the walk has one observation more.
        name: of the policy, for failures.
        options: of the reset.
        watch: is told how it goes.

    Returns:
        The walk, and the CPU time of each ``act``, ms (all threads of this process).

    Raises:
        GalocError: an environment without a localizer, or one that refuses the reset.
    """
    if env.settings.localizer == "none":
        raise GalocError('an environment with localizer = "none"', "one that localizes", "Change its arguments.")
    watch = watch or Watch()
    observation, info = env.reset(seed=seed, options=options)
    assert env.world is not None
    watch.begins(env.world.plan.name)
    taken = [Step.of(info)]
    watch.seen(taken[0])
    cpu_ms: list[float] = []
    failure = None
    try:
        if isinstance(policy, Patroller):
            policy.enter(env.world)
        _ask(watch, "reset", policy.reset, Robot.of(env, seed, steps))
        for _ in range(steps):
            began = time.process_time()
            action = _ask(watch, "act", policy.act, observation, told(policy, info))
            cpu_ms.append(1e3 * (time.process_time() - began))
            _check(action, env)
            observation, _, _, _, info = env.step(action)
            taken.append(Step.of(info))
            watch.seen(taken[-1])
    except _Misbehaved as error:
        failure = failure_text(name, error.call, len(taken) - 1, str(error))
    return Rollout(seed, env.world.plan.name, tuple(taken), failure, steps + 1 - len(taken)), cpu_ms


def _ask(watch: Watch, call: str, method: Callable[..., Any], *arguments: Any) -> Any:
    """Call a method of the policy; whatever it raises is its failure, ``sys.exit()`` included."""
    watch.asks(call)
    try:
        return method(*arguments)
    except BaseException as error:
        # Ctrl-C is the user's, but for worker processes, which ignore it: there only the policy can have raised it.
        if isinstance(error, KeyboardInterrupt) and signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
            raise
        raise _Misbehaved(call, f"raised {told_error(error)}{_place(error)}") from error
    finally:
        watch.answered()


def _place(error: BaseException) -> str:
    """Where in the policy's own file it went wrong, " (my.py, line 7)"; empty where it was not entered."""
    frames = list(traceback.walk_tb(error.__traceback__))[1:]  # the first one is ours
    own = [
        (f.f_code.co_filename, line) for f, line in frames if f.f_code.co_filename == frames[0][0].f_code.co_filename
    ]
    return f" ({Path(own[-1][0]).name}, line {own[-1][1]})" if own else ""


def _check(action: Any, env: FloorplanEnv) -> None:
    """Refuse what the environment would refuse, in words about the policy."""
    try:
        motion.commanded_motion(action, env.settings.actions)
    except Exception as error:  # an object of any kind: its conversion to an array may do anything
        expected = error.expected if isinstance(error, GalocError) else f"one of {env.action_space}"
        raise _Misbehaved("act", f"returned {_quoted(_shown(action))}, expected {expected}") from error


def told_error(error: BaseException) -> str:
    """An exception of foreign code on one short line: its type and what it says, if it can say it."""
    try:
        said = _quoted(str(error))
    except Exception:
        said = ""
    return f"{type(error).__name__}: {said}" if said else type(error).__name__


def _shown(value: Any) -> str:
    try:
        return repr(value)
    except Exception:
        return f"a {type(value).__name__}"


def _quoted(text: str) -> str:
    """Foreign text on one short line, without memory addresses: the same failure always reads the same."""
    line = re.sub(r" at 0x[0-9a-f]+", "", " ".join(text.split()))
    return line if len(line) <= LONGEST_QUOTE else line[: LONGEST_QUOTE - 3] + "..."


def failure_text(name: str, call: str, step: int, what: str) -> str:
    """What a policy did wrong: ``policy my.py:Mine, step 7: act raised ValueError: ...``.

    Args:
        name: of the policy.
        call: "reset" or "act".
        step: number of the last observation, 0 for that of the reset.
        what: what the call did.
    """
    when = f", step {step}" if call == "act" else ""
    return f"policy {name}{when}: {call} {what}"


def rollout(
    env: FloorplanEnv,
    seed: int,
    steps: int,
    *,
    policy: Policy | None = None,
    name: str = "policy",
    options: dict[str, Any] | None = None,
    on_step: Callable[[FloorplanEnv], None] | None = None,
) -> Rollout:
    """Let a policy walk one episode, watched.

    Args:
        env: unwrapped, with a localizer.
        seed: of the environment and of the policy.
        steps: actions; the rollout has one observation more.
        policy: chooses the actions; None: the scripted walker.
        name: of the policy, for its failure.
        options: of the reset.
        on_step: called after the reset and after every step.

    Raises:
        GalocError: the policy failed.
    """

    class Watching(Watch):
        def seen(self, step: Step) -> None:
            if on_step is not None:
                on_step(env)

    walk, _ = play(env, policy or Patroller(), seed, steps, name=name, options=options, watch=Watching())
    if walk.failure is not None:
        raise GalocError(f"a failed walk ({walk.failure})", "an action at every step", "Mend the policy.")
    return walk
