"""What a policy is, what a robot tells it, and how it is found by name.

A policy decides from what a robot has: its map, its readings, its own belief. The truth that the environment puts in
``info`` for scoring is taken out on the way (:func:`told`), unless the policy says ``sees_truth = True``; then every
table marks it as a bound.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from types import ModuleType
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from gymnasium import Env, spaces
from numpy.typing import NDArray

from galoc import Camera, Floorplan, GalocError
from galoc_env import plugin

if TYPE_CHECKING:
    from galoc_env.env import FloorplanEnv
    from galoc_env.observe import Observer

Array = NDArray[np.float64]

TOLD = ("estimate", "entropy", "coverage", "abstained", "collided")
"""The entries of ``info`` that a robot has: what its localizer says, and its bumper."""


class Policy(Protocol):
    """Chooses actions from what a robot knows.

    Made without arguments, once per process; an episode begins with ``reset``. The same robot (its ``seed`` above all)
    must lead to the same actions, so draw from ``numpy.random.default_rng(robot.seed)``. A class attribute
    ``sees_truth = True`` declares a policy that is told the truth: a bound, not a competitor.
    """

    def reset(self, robot: Robot) -> None:
        """A new episode begins."""

    def act(self, observation: dict[str, NDArray[Any]], info: dict[str, Any]) -> Any:
        """The next action, one of ``robot.action_space``.

        Args:
            observation: of the environment (:class:`galoc_env.env.FloorplanEnv`).
            info: the entries ``TOLD``; all of the environment's where the policy ``sees_truth``.
        """


@dataclass(frozen=True, slots=True, eq=False)
class BeliefView:
    """The robot's belief at one moment, read-only."""

    positions: Array
    """(P, 2) m: grid positions."""
    headings_rad: Array
    """(V,) rad: centres of the heading cells."""
    p: NDArray[np.float32]
    """(P, V) probability of each cell. Valid until the environment's next step."""
    resolution: float
    """Grid step, m."""


@dataclass(frozen=True, slots=True, eq=False)
class Robot:
    """What a robot knows of itself and of its task when an episode begins."""

    plan: Floorplan
    """Its map: walls alone, no furniture, all doors open."""
    camera: Camera
    """Its intrinsics."""
    actions: str
    """"discrete" or "continuous": see the environment's action space."""
    action_space: spaces.Space[Any]
    """A copy of the environment's, seeded with ``seed``."""
    seed: int
    """For the policy's own draws."""
    steps: int
    """Actions that the episode lasts."""
    _observer: Observer | None = field(default=None, repr=False)

    @property
    def belief(self) -> BeliefView | None:
        """What its localizer believes now; None for a localizer without a belief of galoc's kind."""
        belief = None if self._observer is None else self._observer.belief
        if belief is None or not hasattr(belief, "headings_rad"):
            return None
        # Views that refuse to be written to: the localizer works on the very same arrays.
        positions, headings_rad, p = map(_read_only, (belief.positions, belief.headings_rad, belief.p))
        return BeliefView(positions, headings_rad, p, float(belief.resolution))

    @classmethod
    def of(cls, env: Env[Any, Any], seed: int, steps: int) -> Robot:
        """The robot of an environment, wrapped or not, whose episode has begun.

        Raises:
            GalocError: the environment was not reset.
        """
        from copy import deepcopy

        inner: FloorplanEnv = env.unwrapped  # type: ignore[assignment]
        if inner.world is None:
            raise GalocError("an environment before its reset", "a running episode", "Call env.reset() first.")
        space = deepcopy(env.action_space)
        space.seed(seed)
        return cls(inner.world.plan, inner.camera, inner.settings.actions, space, seed, steps, inner.world.observer)


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    view = array.view()
    view.flags.writeable = False
    return view


def told(policy: Policy, info: dict[str, Any]) -> dict[str, Any]:
    """What a policy gets to see of the environment's ``info``."""
    return info if sees_truth(policy) else without_truth(info)


def without_truth(info: dict[str, Any]) -> dict[str, Any]:
    """The entries ``TOLD`` of the environment's ``info``."""
    return {key: info[key] for key in TOLD if key in info}


def sees_truth(policy: object) -> bool:
    """Whether a policy declares that it is told the truth."""
    return bool(getattr(policy, "sees_truth", False))


ENTRY_POINTS = "galoc.policies"
"""Group of entry points by which a package gives its policies names."""
BUILT_IN = {"patrol": "galoc_env.patrol:Patroller"}
"""Policies of this package: the scripted walker, which sees the truth."""


def named() -> dict[str, str]:
    """Names of the installed policies and where they are, "module:Class"."""
    from importlib.metadata import entry_points

    found = {point.name: point.value for point in entry_points(group=ENTRY_POINTS)}
    return dict(sorted((BUILT_IN | found).items()))


def make_policy(name: str) -> Policy:
    """A policy by name or place.

    Args:
        name: of an installed policy (:func:`named`), or "module:Class", also "file.py:Class".

    Raises:
        GalocError: no such policy, one that cannot be made, or that lacks ``reset`` or ``act``.
    """
    return policy_and_module(name)[0]


def policy_and_module(name: str) -> tuple[Policy, ModuleType]:
    """A policy as :func:`make_policy` makes it, and the module that it was found in."""
    known = named()
    try:
        made, module = plugin.load(known.get(name, name))
    except plugin.LOADING as error:
        expected = f'"module:Class", "file.py:Class" or one of {", ".join(known)}'
        raise GalocError(f"policy {name!r} ({error})", expected, "Check the spelling.") from error
    except (Exception, SystemExit) as error:  # of the user's code: of any kind
        raise _unmade(name, "its module was loaded", error) from error
    try:
        policy = made()
    except GalocError:
        raise
    except (Exception, SystemExit) as error:
        raise _unmade(name, "it was made", error) from error
    missing = [method for method in ("reset", "act") if not callable(getattr(policy, method, None))]
    if missing:
        raise GalocError(f"policy {name!r} without {missing}", "methods reset and act", "Add them to the class.")
    return policy, module


def _unmade(name: str, when: str, error: BaseException) -> GalocError:
    got = f"policy {name!r}, which raised {type(error).__name__} when {when}: {' '.join(str(error).split())}"
    return GalocError(got, "a class that is made without arguments", "Mend it.")
