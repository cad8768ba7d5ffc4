"""Nodes of the pyramid: a cell of positions and the headings from one whole degree on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]
Int = NDArray[np.int64]
Headings = NDArray[np.int16]


@dataclass(frozen=True, slots=True, eq=False)
class Nodes:
    """Nodes of one level."""

    cells: NDArray[np.int32]
    """(N,) cell of the level."""
    headings: Headings
    """(N,) first whole degree of heading."""
    scales: Float32 | None = None
    """(N, 2) log scales that may still do, where the scoring narrows them down."""

    def __len__(self) -> int:
        """N."""
        return len(self.cells)

    def chosen(self, keep: NDArray[np.bool_]) -> Nodes:
        """Those where ``keep`` is set."""
        scales = None if self.scales is None else self.scales[keep]
        return Nodes(self.cells[keep], self.headings[keep], scales)
