"""Furniture as oriented boxes: what stands where, without blocking a way."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from galoc.errors import GalocError
from galoc_env.furniture.footprint import Footprint
from galoc_env.furniture.kinds import KINDS, KINDS_BY_NAME

if TYPE_CHECKING:
    import numpy as np

    from galoc.floorplan import Floorplan
    from galoc_env.scene.rooms import Rooms

__all__ = ["KINDS", "Furniture", "furnish"]

AGENT_RADIUS = 0.3
"""An agent of this radius can still reach every place after furnishing that it could reach before, m."""
DOOR_CLEARANCE = 0.9
"""No furniture this close to a door's centreline, m."""
AREA_PER_ITEM = 1.9
"""Floor area for each piece at density 1, m2."""
MAX_ITEMS = 150
"""Most pieces at density 1: huge plans stay fast to build and to draw."""
WALL_GAP = 0.03
"""Gap between a piece's back and the wall, m."""
MIN_GAP = 0.05
"""Least gap between two pieces that do not belong together, m."""


@dataclass(frozen=True, slots=True)
class Furniture(Footprint):
    """An upright box that stands on the floor; its front faces ``heading``."""

    kind: str
    """One of :data:`KINDS`."""
    x: float
    """Centre, m."""
    y: float
    """Centre, m."""
    heading: float
    """Plan bearing of the front, rad."""
    length: float
    """Extent along the heading, m."""
    width: float
    """Extent across the heading, m."""
    height: float
    """Extent upwards, m. A desk's height is its top's; its screen stands up to 0.5 m higher."""
    group: int = 0
    """Pieces with the same number above 0 belong together and match; 0: a piece of its own."""
    detail: str = ""
    """What else there is to know: the units of a stretch of kitchen, the open side of a corner sofa."""

    @property
    def flat(self) -> bool:
        """Whether it lies on the floor, so that bodies pass over it."""
        return KINDS_BY_NAME[self.kind].flat

    def place(self, ahead: float, left: float) -> tuple[float, float]:
        """Plan coordinates of a point in the piece's frame: m ahead of its centre, m to its left."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        return self.x + c * ahead - s * left, self.y + s * ahead + c * left


def furnish(
    plan: Floorplan, density: float, rng: np.random.Generator, rooms: Rooms | None = None
) -> tuple[Furniture, ...]:
    """Put furniture into a plan: each room by its use, most pieces against walls, one kitchen.

    No piece overlaps a wall or another piece, stands within 0.9 m of a door, or cuts off a place that an agent of
    radius 0.3 m could reach before. Rugs come last; pieces may stand on them, and they stop nobody.

    Args:
        plan: any floorplan.
        density: 0 (none) to 1 (crowded).
        rng: source of all choices.
        rooms: its rooms, where they are known already; their uses are guessed where their styles say none.

    Raises:
        GalocError: density out of range.
    """
    if isinstance(density, str | bool) or not 0.0 <= density <= 1.0:
        raise GalocError(f"furniture = {density!r}", "a density from 0 (empty) to 1 (crowded)", "Pass 0.5, say.")
    if density == 0.0:
        return ()
    from galoc_env.furniture.plan import furnish_rooms

    return furnish_rooms(plan, density, rng, rooms)
