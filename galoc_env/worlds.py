"""The worlds that an environment goes back to: built when first entered, the least recently used ones dropped."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable

import numpy as np

from galoc import Floorplan
from galoc_env.settings import HOMES, Settings
from galoc_env.world import World


class Worlds:
    """Worlds by number.

    Args:
        settings: of the environment; a fixed plan is loaded at once, so that a bad one is refused here.
        capacity: worlds kept at most.
    """

    def __init__(self, settings: Settings, capacity: int) -> None:
        self._settings, self._capacity = settings, capacity
        self._fixed = None if settings.plan is None else Floorplan.load(settings.plan)
        self._kept: OrderedDict[int, World] = OrderedDict()

    def number(self, seed: int | None, plan_seed: int | None, here: World | None, rng: np.random.Generator) -> int:
        """Which world an episode takes place in.

        Args:
            seed: of the reset.
            plan_seed: asked for by the reset's options.
            here: where we are; we stay there when nothing else is said.
            rng: of the environment; decides at a first reset without a seed.
        """
        if self._fixed is not None:
            return 0
        if plan_seed is not None:
            return plan_seed
        if seed is not None:
            return seed % HOMES
        return int(rng.spawn(1)[0].integers(HOMES)) if here is None else here.number

    def enter(self, number: int, occupied: Iterable[World] = ()) -> World:
        """The world of that number, built here and now (in the worker: spawn-safe) unless it is kept.

        Args:
            number: of the home.
            occupied: worlds that must not be dropped.
        """
        if number in self._kept:
            self._kept.move_to_end(number)
            return self._kept[number]
        needed = {world.number for world in occupied}
        # Room is made before building, so that there are never more than may be kept.
        for other in [n for n in self._kept if n not in needed][: max(0, len(self._kept) + 1 - self._capacity)]:
            self._kept.pop(other).close()
        plan = self._fixed
        if plan is None:
            from galoc_env import ambiguous, homes

            generate = homes.generate if self._settings.homes == "rooms" else ambiguous.generate
            plan = generate(number, split=self._settings.split)
        world = self._kept[number] = World.build(plan, number, self._settings)
        return world

    def close(self) -> None:
        """Drop all worlds."""
        for world in self._kept.values():
            world.close()
        self._kept.clear()

    def __len__(self) -> int:
        """How many are kept."""
        return len(self._kept)

    def has(self, number: int) -> bool:
        """Whether a world of that number is kept."""
        return number in self._kept

    def __contains__(self, world: World) -> bool:
        """Whether a world is still kept."""
        return self._kept.get(world.number) is world
