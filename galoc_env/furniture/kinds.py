"""The kinds of furniture: their sizes and habits."""

from __future__ import annotations

from dataclasses import dataclass

Span = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Kind:
    """Sizes and habits of one kind of furniture."""

    length: Span
    """Extent along the heading, m."""
    width: Span
    """Extent across the heading, m."""
    height: Span
    """Extent upwards, m."""
    free: bool = False
    """Stands away from walls."""
    front: float = 0.5
    """Clear distance wanted before it, m."""
    flat: bool = False
    """Lies on the floor, and bodies pass over it."""


KINDS_BY_NAME = {
    "armchair": Kind((0.80, 0.90), (0.80, 0.95), (0.80, 0.95)),
    "basin": Kind((0.42, 0.52), (0.55, 1.00), (1.75, 1.95)),
    "basket": Kind((0.30, 0.45), (0.30, 0.45), (0.30, 0.60), front=0.1),
    "bathtub": Kind((0.70, 0.80), (1.50, 1.75), (0.54, 0.60)),
    "bed": Kind((2.05, 2.15), (1.00, 1.80), (0.90, 1.20)),
    "cabinet": Kind((0.40, 0.50), (0.80, 1.80), (0.70, 1.15)),
    "chair": Kind((0.46, 0.52), (0.42, 0.48), (0.82, 0.95), free=True),
    "chaise": Kind((1.45, 1.60), (0.80, 0.95), (0.78, 0.88), free=True),
    "coat_rack": Kind((0.45, 0.50), (0.45, 0.50), (1.70, 1.85), front=0.1),
    "coffee_table": Kind((0.50, 0.70), (0.80, 1.20), (0.36, 0.46), free=True),
    "counter": Kind((0.62, 0.62), (0.60, 2.40), (0.90, 0.90)),
    "desk": Kind((0.65, 0.80), (1.20, 1.70), (0.72, 0.76)),
    "fridge": Kind((0.62, 0.66), (0.60, 0.60), (1.45, 2.05)),
    "kitchen": Kind((0.62, 0.62), (0.60, 2.40), (2.10, 2.10)),
    "lamp": Kind((0.38, 0.48), (0.38, 0.48), (1.45, 1.75), front=0.1),
    "nightstand": Kind((0.36, 0.45), (0.38, 0.50), (0.50, 0.62), front=0.3),
    "office_chair": Kind((0.60, 0.64), (0.60, 0.64), (0.95, 1.15), free=True),
    "piano": Kind((0.58, 0.64), (1.40, 1.52), (1.10, 1.30)),
    "plant": Kind((0.45, 0.75), (0.45, 0.75), (0.80, 1.80), front=0.1),
    "pouf": Kind((0.40, 0.55), (0.40, 0.55), (0.36, 0.44), free=True),
    "round_table": Kind((0.90, 1.25), (0.90, 1.25), (0.72, 0.76), free=True),
    "rug": Kind((1.40, 2.00), (2.00, 2.90), (0.010, 0.018), free=True, flat=True),
    "shelf": Kind((0.28, 0.38), (0.70, 1.60), (1.20, 2.20)),
    "shower": Kind((0.80, 0.95), (0.80, 1.10), (1.95, 2.00)),
    "sofa": Kind((0.85, 0.95), (1.50, 2.45), (0.78, 0.88)),
    "table": Kind((0.80, 0.95), (1.20, 1.80), (0.72, 0.76), free=True),
    "toilet": Kind((0.62, 0.70), (0.37, 0.42), (0.76, 0.84)),
    "tv_stand": Kind((0.38, 0.46), (1.20, 1.90), (1.10, 1.25)),
    "wardrobe": Kind((0.56, 0.65), (0.95, 2.40), (1.90, 2.40)),
    "washer": Kind((0.60, 0.62), (0.60, 0.60), (0.85, 0.87)),
}
"""Kind -> sizes and habits."""

KINDS = tuple(KINDS_BY_NAME)
"""All kinds of furniture."""
