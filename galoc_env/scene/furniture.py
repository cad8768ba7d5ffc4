"""What furniture looks like: every piece drawn inside its own box, in materials that suit its room."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from galoc_env.furniture import Furniture
from galoc_env.scene import furniture_bath as bath
from galoc_env.scene import furniture_beds as beds
from galoc_env.scene import furniture_decor as decor
from galoc_env.scene import furniture_kitchen as kitchens
from galoc_env.scene import furniture_seats as seats
from galoc_env.scene import furniture_storage as storage
from galoc_env.scene import furniture_tables as tables
from galoc_env.scene.furniture_palette import Look, draw_stock
from galoc_env.scene.light import Lighting
from galoc_env.scene.mesh import FURNITURE, MeshBuilder
from galoc_env.scene.rooms import Rooms
from galoc_env.scene.solids import SolidPainter

Draw = Callable[[SolidPainter, Furniture, Look], None]


def add_furniture(
    builder: MeshBuilder, items: Sequence[Furniture], rooms: Rooms, lighting: Lighting, rng: np.random.Generator
) -> None:
    """All pieces, one instance each, in order.

    Pieces of one group draw their choices from the same numbers: chairs around a table match, and so do the units of a
    kitchen, but for what stands on them.
    """
    home = int(rng.integers(1 << 31))
    stock = draw_stock(rng)
    found = rooms.at(np.array([(item.x, item.y) for item in items]).reshape(-1, 2))
    for number, (item, room) in enumerate(zip(items, found, strict=True)):
        style = rooms.style(int(room))
        paint = SolidPainter(
            builder, lighting, item.x, item.y, item.heading, style.light, builder.new_instance(FURNITURE)
        )
        key = [home, 1, item.group] if item.group else [home, 0, number]
        look = Look(np.random.default_rng(key), str(style.wall), np.asarray(style.wall_tint), stock)
        DRAW[item.kind](paint, item, look)
        paint.flush()


DRAW: dict[str, Draw] = {
    "armchair": seats.sofa,
    "basin": bath.basin,
    "basket": decor.basket,
    "bathtub": bath.bathtub,
    "bed": beds.bed,
    "cabinet": storage.cabinet,
    "chair": seats.chair,
    "chaise": seats.chaise,
    "coat_rack": decor.coat_rack,
    "coffee_table": tables.coffee_table,
    "counter": kitchens.kitchen,
    "desk": tables.desk,
    "fridge": kitchens.fridge,
    "kitchen": kitchens.kitchen,
    "lamp": decor.lamp,
    "nightstand": beds.nightstand,
    "office_chair": seats.office_chair,
    "piano": storage.piano,
    "plant": decor.plant,
    "pouf": seats.pouf,
    "round_table": tables.round_table,
    "rug": decor.rug,
    "shelf": storage.shelf,
    "shower": bath.shower,
    "sofa": seats.sofa,
    "table": tables.table,
    "toilet": bath.toilet,
    "tv_stand": storage.tv_stand,
    "wardrobe": storage.wardrobe,
    "washer": bath.washer,
}
"""How each kind is drawn."""
