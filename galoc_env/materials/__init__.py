"""Procedural surface textures: seamless, made from a seed, with a physical size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from galoc_env.materials import outside, things, walls
from galoc_env.materials import wood as woods
from galoc_env.materials.noise import SIZE, Canvas, Field

__all__ = ["NAMES", "SIZE", "Material", "material"]


@dataclass(frozen=True, slots=True, eq=False)
class Material:
    """One tileable surface."""

    name: str
    """Unique name, such as "planks"."""
    image: NDArray[np.uint8]
    """(256, 256, 3) sRGB; row 0 is the top; left/right and top/bottom edges match."""
    size_m: float
    """Edge length that the image covers, m."""


_RECIPES: dict[str, tuple[Callable[[Canvas], Field], float]] = {
    "art": (things.art, 1.3),
    "books": (things.books, 0.8),
    "brick": (walls.brick, 1.25),
    "carpet": (walls.carpet, 1.0),
    "ceiling": (walls.ceiling, 2.0),
    "check": (things.check, 0.6),
    "checker_tiles": (walls.checker_tiles, 1.3),
    "concrete": (walls.concrete, 2.4),
    "damask": (walls.damask, 1.6),
    "dark_planks": (woods.dark_planks, 1.2),
    "fabric": (things.fabric, 0.5),
    "floral": (walls.floral, 1.3),
    "geometric": (walls.geometric, 1.3),
    "granite": (walls.granite, 0.6),
    "herringbone": (woods.herringbone, 1.2),
    "lacquer": (things.lacquer, 1.0),
    "leaves": (things.leaves, 0.5),
    "loop_carpet": (walls.loop_carpet, 0.6),
    "marble": (walls.marble, 1.4),
    "metal": (things.metal, 0.6),
    "metro": (walls.metro, 1.2),
    "mirror": (things.mirror, 1.8),
    "mosaic": (walls.mosaic, 0.7),
    "oak": (woods.oak, 0.9),
    "outdoors": (outside.outdoors, 3.0),
    "painted_wood": (woods.painted_wood, 0.9),
    "pale_planks": (woods.pale_planks, 1.1),
    "pine": (woods.pine, 0.9),
    "planks": (woods.planks, 1.1),
    "plaster": (walls.plaster, 2.0),
    "rough_plaster": (walls.rough_plaster, 1.2),
    "rug": (things.rug, 1.2),
    "screen": (things.screen, 1.6),
    "shade": (things.shade, 0.6),
    "slabs": (walls.slabs, 1.8),
    "stripes": (walls.stripes, 1.6),
    "terrazzo": (walls.terrazzo, 0.9),
    "ticking": (things.ticking, 0.6),
    "tiles": (walls.tiles, 1.6),
    "velvet": (things.velvet, 0.8),
    "wall_tiles": (walls.wall_tiles, 1.5),
    "walnut": (woods.walnut, 0.9),
    "weave": (things.weave, 0.4),
    "wood": (woods.wood, 0.9),
    "white_brick": (walls.white_brick, 1.25),
    "wood_panelling": (woods.wood_panelling, 1.1),
}
"""Name -> recipe and physical size (m), which varies by a tenth with the seed."""

NAMES = tuple(sorted(_RECIPES))
"""Names of all materials."""
_FIXED = ("outdoors",)  # drawn to the height of windows


@lru_cache(maxsize=256)
def material(name: str, seed: int) -> Material:
    """The named texture for a seed: the same bytes for the same arguments.

    Args:
        name: one of :data:`NAMES`, or such a name with a dot and a number ("art.2"): that many different ones can be
            in one scene.
        seed: variant.

    Raises:
        KeyError: unknown name (a programming error: names never come from users).
    """
    kind, _, copy = name.partition(".")
    recipe, size_m = _RECIPES[kind]
    rng = np.random.default_rng([seed, int(copy or 0), *kind.encode()])
    if kind not in _FIXED:
        size_m *= float(rng.uniform(0.9, 1.1))
    # In place: float images are large.
    canvas = recipe(Canvas(rng))
    image = np.clip(np.rint(canvas, out=canvas), 0, 255, out=canvas).astype(np.uint8)
    image.setflags(write=False)
    return Material(name, image, size_m)
