"""What a layout network says of a strip, column by column, before any wall is drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """C columns 1 degree apart in the level frame of the measured gravity. Rows of pairs: ceiling, floor."""

    azimuths: Array
    """(C,) rad, right positive."""
    elevation: Array
    """(2, C) rad above the horizon of the wall's ceiling and floor line, also where the image does not reach."""
    sigma: Array
    """(2, C) rad, standard deviation of elevation, given that the line is near there at all."""
    sure: Array
    """(2, C) probability that it is."""
    visible: Array
    """(2, C) probability that the line is inside the image and nothing hides it."""
    in_frame: Array
    """(2, C) probability that it is inside the image."""
    edge_azimuths: Array
    """(E,) rad, centres of the narrower columns that wall edges are sought in."""
    edge: Array
    """(2, E) probability of a corner (row 0: two walls meet) and an occlusion (row 1: a wall ends before another)."""

    def __len__(self) -> int:
        """C."""
        return len(self.azimuths)
