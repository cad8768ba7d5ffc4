"""Which episodes an evaluation plays: the fixed sets, and the episodes of one plan or of one split."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from galoc import Floorplan, GalocError
from galoc_env import motion

TEST_HOMES = 100
"""Homes of "homes-test"."""
AMBIGUOUS_PLANS = 60
"""Plans of "ambiguous"."""
SETS = ("homes-test", "ambiguous", "buildings")
"""Names of the fixed sets."""
World = tuple[str | None, int | None]
"""Plan file and number of the generated plan."""


@dataclass(frozen=True, slots=True)
class Task:
    """One episode to play."""

    episode: int
    """Its number in the set, from 0."""
    seed: int
    """Of the environment (start and noise) and of the policy."""
    plan: str | None = None
    """Plan file; None: the plan that the environment's arguments name, or a generated one."""
    home: int | None = None
    """Number of the generated plan; None: the seed decides, or there is a file."""

    @property
    def world(self) -> World:
        """What the episodes that share it had better be played in a row for: an environment keeps one world."""
        return self.plan, self.home

    @property
    def options(self) -> dict[str, Any] | None:
        """Of the environment's reset."""
        return None if self.home is None else {"plan_seed": self.home}

    def arguments(self, common: dict[str, Any]) -> dict[str, Any]:
        """Of the environment that it is played in: those that all episodes have in common, and its own plan file."""
        return common if self.plan is None else {**common, "plan": self.plan}


@dataclass(frozen=True, slots=True)
class EpisodeSet:
    """A rule that says which world and which start an episode has, whatever camera, detector and noise."""

    name: str
    """One of ``SETS``, or "plan" for the environment's own arguments."""
    arguments: dict[str, Any] = field(default_factory=dict)
    """What the set fixes of the environment's arguments."""
    homes: int = 0
    """Episode k takes place in generated plan k modulo this; 0: the seed decides."""
    plans: dict[str, str] = field(default_factory=dict)
    """Plan files and the hash of what is in them; episode k takes place in number k modulo their count."""
    first_seed: int = 0
    """Seed of episode 0."""

    def task(self, episode: int) -> Task:
        """The episode of that number."""
        seed = self.first_seed + episode
        if self.plans:
            return Task(episode, seed, plan=list(self.plans)[episode % len(self.plans)])
        return Task(episode, seed, home=episode % self.homes if self.homes else None)

    def described(self) -> dict[str, Any]:
        """What a result must say of it: other words, other episodes."""
        hashes = {"plans": {Path(file).name: digest[:12] for file, digest in self.plans.items()}} if self.plans else {}
        return {"set": self.name, "first_seed": self.first_seed, **hashes}


def make_set(name: str | None, plans: Path | None, first_seed: int, note: Callable[[str], None]) -> EpisodeSet:
    """A set by name.

    Args:
        name: one of ``SETS``; None: the environment's own plan or split.
        plans: folder of "buildings".
        first_seed: of episode 0; the fixed sets begin at 0.
        note: is told of files of the folder that are no plans.

    Raises:
        GalocError: no such set, or a folder where there is none to name, or the other way round.
    """
    if name is not None and name not in SETS:
        raise GalocError(f"--set {name}", " or ".join(SETS), "Name one of these, or leave --set out.")
    if name == "buildings" and plans is None:
        raise GalocError("--set buildings without --plans", "a folder of plan files", "Add --plans FOLDER.")
    if name != "buildings" and plans is not None:
        got = f"--plans {str(plans)!r} {'without --set' if name is None else f'with --set {name}'}"
        raise GalocError(got, "plans for the set buildings alone", "Pass --set buildings, or leave --plans out.")
    if name is None:
        return EpisodeSet("plan", first_seed=first_seed)
    if first_seed != 0:
        raise GalocError(f"--seed {first_seed} with --set {name}", "a set that fixes the seeds", "Leave --seed out.")
    if name == "homes-test":
        return EpisodeSet(name, {"plan": None, "homes": "rooms", "split": "test"}, homes=TEST_HOMES)
    if name == "ambiguous":
        return EpisodeSet(name, {"plan": None, "homes": "ambiguous", "split": "test"}, homes=AMBIGUOUS_PLANS)
    assert plans is not None
    return EpisodeSet(name, plans=_sound_plans(plans, note))


def _sound_plans(folder: Path, note: Callable[[str], None]) -> dict[str, str]:
    """Files of a folder that hold a plan in which the body fits, sorted by name."""
    if not folder.is_dir():
        raise GalocError(f"--plans {str(folder)!r}, which is no folder", "a folder of plan files", "Name a folder.")
    found: dict[str, str] = {}
    for file in sorted(p for p in folder.iterdir() if p.is_file() and not p.name.startswith(".")):
        try:
            plan = Floorplan.load(file)
            motion.walkable(plan, plan.segments[:0])
        except GalocError as error:
            note(f"{file.name} is left out: {error}")
        else:
            found[str(file)] = plan.content_hash
    if not found:
        raise GalocError(f"--plans {str(folder)!r} without a sound plan", "at least one", "See the notes above.")
    return found
