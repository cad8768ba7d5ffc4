"""What a layout network says of a strip, column by column, before any wall is drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc.errors import GalocError

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


def checked_columns(columns: Columns) -> Columns:
    """The columns, if their parts agree.

    Raises:
        GalocError: arrays that do not go together or are not finite, or azimuths that do not go from left to right.
    """
    count, edges = len(columns.azimuths), len(columns.edge_azimuths)
    rows = (columns.elevation, columns.sigma, columns.sure, columns.visible, columns.in_frame)
    fits = all(row.shape == (2, count) for row in rows) and columns.edge.shape == (2, edges) and edges == 2 * count
    sides = (columns.azimuths, columns.edge_azimuths)
    if count < 2 or not fits or not all(np.isfinite(row).all() for row in (*rows, columns.edge, *sides)):
        got = f"{count} columns and {edges} edge columns, of shapes {[row.shape for row in rows]}"
        raise GalocError(got, "finite (2, C) rows and (2, 2 C) edges, C at least 2", "Check the network's outputs.")
    if not all(np.all(np.diff(side) > 0.0) for side in sides):
        raise GalocError("columns whose azimuths do not rise", "columns from left to right", "Sort them.")
    return columns
