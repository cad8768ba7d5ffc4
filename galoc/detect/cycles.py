"""From junctions and edges to walls: finds the cycles (ceiling edge, vertical, floor edge, vertical) of a graph.

A cycle that the image cuts off is open: its lines end on the image border, and its verticals may. Such an end belongs
to the nearest vertical beyond it whose own junction of that row is out of the image; where there is none, the left or
right image edge cuts the wall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from galoc.camera import Camera
from galoc.types import BORDER, CORNER, OCCLUSION, Wireframe

Array = NDArray[np.float64]

SAME_PLUMB = math.radians(0.5)
"""Verticals nearer than this stand on one plumb line, rad."""
EDGE_PX = 1.0
"""What is nearer to the image border than this lies on it, px."""
FREE = -1
"""In place of a pair: a line's end that is cut by the image border."""
OPEN, LEFT, RIGHT = -2, -3, -4
"""In place of a neighbour: none yet; the left and the right image edge."""


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Verticals, ordered by azimuth."""

    pixels: Array
    """(P, 2, 2) px: ceiling and floor junction of each."""
    seen: NDArray[np.bool_]
    """(P, 2): whether each is seen inside the image."""
    azimuth: Array
    """(P,) rad."""
    slope: Array
    """(P, 2): tangent of the elevation of both junctions; the larger in size, the nearer the wall."""
    occluded: NDArray[np.bool_]
    """(P,): the detector says that the wall goes on behind a nearer edge."""
    typed: NDArray[np.bool_]
    """(P,): the detector knows corners from occlusions."""


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A ceiling or floor line, left to right."""

    row: int
    """0 ceiling, 1 floor."""
    ends: tuple[int, int]
    """Pair at the left and right end; ``FREE`` where the image border cuts it."""
    azimuth: tuple[float, float]
    """Of both ends, rad."""
    pixels: Array
    """(2, 2) px."""
    score: float
    """Its probability."""


@dataclass(slots=True)
class _Panel:
    """One wall: left and right pair, LEFT or RIGHT for an image edge, and the lines that it owns."""

    left: int
    right: int
    lines: list[Line] = field(default_factory=list)


class Cycles:
    """Joins pairs to walls.

    Args:
        pairs: N verticals.
        lines: ceiling and floor lines.
        camera: for the image border.
    """

    def __init__(self, pairs: Pairs, lines: list[Line], camera: Camera) -> None:
        self._p, self._camera = pairs, camera
        count = len(pairs.azimuth)
        self._owner: list[list[_Panel | None]] = [[None, None] for _ in range(count)]
        """Per pair the panel on its left and on its right."""
        self._panels: list[_Panel] = []
        whole = [line for line in lines if FREE not in line.ends]
        for line in sorted(whole, key=lambda line: (-line.score, line.azimuth)):
            self._join(line.ends[0], line.ends[1], line)
        for line in sorted((line for line in lines if FREE in line.ends), key=lambda line: (-line.score, line.azimuth)):
            self._join_cut(line)
        self._join_blank()

    def _join(self, left: int, right: int, line: Line | None = None) -> bool:
        """Make a panel, or give its line to the one that is there; False where another one is in the way."""
        on_left = self._owner[left][1] if left >= 0 else None
        on_right = self._owner[right][0] if right >= 0 else None
        across = [panel for panel in self._panels if (panel.left, panel.right) == (LEFT, RIGHT) == (left, right)]
        panel = on_left or on_right or (across[0] if across else None)
        if panel is None:
            panel = _Panel(left, right)
            self._panels.append(panel)
        elif (panel.left, panel.right) != (left, right):
            return False
        if left >= 0:
            self._owner[left][1] = panel
        if right >= 0:
            self._owner[right][0] = panel
        if line is not None and all(line.row != other.row for other in panel.lines):
            panel.lines.append(line)
        return True

    def _join_cut(self, line: Line) -> None:
        """A line that the image border cuts: of the panel that is there already, else of a new one."""
        for side in (0, 1):
            pair = line.ends[side]
            panel = self._owner[pair][1 - side] if pair != FREE else None
            if panel is not None:
                self._join(panel.left, panel.right, line)
                return
        ends = [
            pair if pair != FREE else self._beyond(line.azimuth[side], line.row, side)
            for side, pair in enumerate(line.ends)
        ]
        self._join(ends[0], ends[1], line)

    def _beyond(self, azimuth: float, row: int, side: int) -> int:
        """The pair that ends a wall (side 0: on its left) whose line of this row is cut at an azimuth."""
        p, sign = self._p, (-1.0, 1.0)[side]
        distance = sign * (p.azimuth - azimuth)
        open_here = [i for i in np.flatnonzero(distance > -SAME_PLUMB) if not p.seen[i, row]]
        if not open_here:
            return (LEFT, RIGHT)[side]
        nearest = min(distance[i] for i in open_here)
        group = [int(i) for i in open_here if distance[i] < nearest + SAME_PLUMB]
        # Two on one plumb line are the end of a near wall and what it hides: each has a wall on one side only.
        taken = [self._owner[i][1 - side] is not None for i in group]
        facing = [self._owner[i][side] is not None for i in group]
        order = sorted(
            range(len(group)), key=lambda k: (facing[k] and len(group) > 1, taken[k], sign * distance[group[k]])
        )
        return group[order[0]]

    def _join_blank(self) -> None:
        """Walls of which neither line is in the image: between verticals that show no junction at all."""
        p = self._p
        blank = ~np.asarray(p.seen.any(axis=1))
        count = len(blank)
        for i in range(count):
            if not blank[i] or self._owner[i][1] is not None:
                continue
            j = next((j for j in range(i + 1, count) if p.azimuth[j] > p.azimuth[i] + SAME_PLUMB), None)
            if j is None:
                self._join(i, RIGHT)
            elif blank[j] and self._owner[j][0] is None:
                self._join(i, j)
        if count and blank[0] and self._owner[0][0] is None:
            self._join(LEFT, 0)

    def wireframe(self) -> Wireframe:
        """The walls found, with the pairs that belong to one, left to right."""
        used = [i for i in range(len(self._p.azimuth)) if any(self._owner[i])]
        index = {pair: k for k, pair in enumerate(used)}
        kind = [self._kind(i) for i in used]
        pixels = [self._p.pixels[i] for i in used]
        seen = [self._p.seen[i] for i in used]
        walls, cuts = [], []
        for panel in sorted(self._panels, key=self._place):
            ends = []
            for side, pair in enumerate((panel.left, panel.right)):
                if pair >= 0:
                    ends.append(index[pair])
                    continue
                ends.append(len(pixels))
                border, border_seen = self._border(panel, side)
                pixels.append(border)
                seen.append(border_seen)
                kind.append(BORDER)
            walls.append(ends)
            cuts.append(_cuts(panel))
        return self._ordered(np.array(pixels).reshape(-1, 2, 2), np.array(seen).reshape(-1, 2), kind, walls, cuts)

    def _ordered(
        self, pixels: Array, seen: NDArray[np.bool_], kind: list[int], walls: list[list[int]], cuts: list[Array]
    ) -> Wireframe:
        """Pairs in the order in which the walls, left to right, name them."""
        order = list(dict.fromkeys(pair for ends in walls for pair in ends))
        place = {pair: k for k, pair in enumerate(order)}
        joined = np.array([[place[pair] for pair in ends] for ends in walls], np.int64).reshape(-1, 2)
        cut = np.array(cuts).reshape(-1, 2, 2, 2)
        return Wireframe(
            pixels[order, 0],
            pixels[order, 1],
            seen[order, 0].astype(bool),
            seen[order, 1].astype(bool),
            joined,
            np.array(kind, np.int8)[order],
            ceiling_cut=cut[:, 0],
            floor_cut=cut[:, 1],
        )

    def _place(self, panel: _Panel) -> float:
        """Azimuth of a panel's middle; those at the image edges come first and last."""
        left = self._p.azimuth[panel.left] if panel.left >= 0 else -math.pi
        right = self._p.azimuth[panel.right] if panel.right >= 0 else math.pi
        return float(left + right)

    def _border(self, panel: _Panel, side: int) -> tuple[Array, NDArray[np.bool_]]:
        """(2, 2) px and (2,) seen: where the panel's lines cross the left or right image edge."""
        edge = (-0.5, self._camera.width - 0.5)[side]
        pixels = np.array([[edge, -0.5], [edge, self._camera.height - 0.5]])
        seen = np.zeros(2, bool)
        for line in panel.lines:
            end = line.pixels[side]
            beside = abs(end[0] - edge)
            over = min(abs(end[1] + 0.5), abs(end[1] - self._camera.height + 0.5))  # from the top or bottom edge
            if line.ends[side] == FREE and beside <= min(EDGE_PX, over):
                pixels[line.row], seen[line.row] = end, True
        return pixels, seen

    def _kind(self, pair: int) -> int:
        """A pair with a wall on one side is an occlusion where a nearer one stands on its plumb line."""
        p = self._p
        if p.typed[pair]:
            return OCCLUSION if p.occluded[pair] else CORNER
        if all(self._owner[pair]):
            return CORNER
        near = np.abs(p.azimuth - p.azimuth[pair]) < SAME_PLUMB
        near[pair] = False
        rows = p.seen[pair]
        # An unseen junction of the nearer wall is at least as far out as the image border where it was put.
        closer = [i for i in np.flatnonzero(near) if np.any(np.abs(p.slope[i][rows]) > np.abs(p.slope[pair][rows]))]
        return OCCLUSION if closer else CORNER


def _cuts(panel: _Panel) -> Array:
    """(2 rows, 2 sides, 2) px: where the panel's lines are cut by the image border; NaN where they are not."""
    cuts = np.full((2, 2, 2), np.nan)
    for line in panel.lines:
        for side in (0, 1):
            if line.ends[side] == FREE:
                cuts[line.row, side] = line.pixels[side]
    return cuts
