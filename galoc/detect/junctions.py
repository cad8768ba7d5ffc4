"""Ends of fitted walls: which of them are shared corners, where they stand, and how well that is known."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from galoc.detect.breaks import Break, break_at
from galoc.detect.columns import Columns
from galoc.detect.ends import LEAST_Y, End, joint_factor, line_at
from galoc.types import BORDER, CORNER, OCCLUSION

Array = NDArray[np.float64]

CROSSING_RAD = math.radians(3.0)
"""Two planes that cross further than this from the break say nothing of its azimuth, rad."""
ROOM_SHARE = 0.45
"""A break moves by at most this share of the walls beside it."""
RANGE_TOL = 0.01
"""Walls of a corner meet to this share of their range."""


class Joiner:
    """Turns S fitted walls into their 2 S ends.

    Args:
        columns: behind the walls.
        bounds: (S + 1,) first column of each wall.
        planes: (S, 6) fused lines of inverse depth.
        lines: (S, 2, 6) lines of ceiling and floor.
        limits: outermost azimuths, rad.
    """

    def __init__(
        self, columns: Columns, bounds: NDArray[np.int64], planes: Array, lines: Array, limits: tuple[float, float]
    ) -> None:
        self._columns, self._limits = columns, limits
        self._bounds: list[int] = bounds.tolist()
        self._planes: list[list[float]] = planes.tolist()
        self._lines: list[list[list[float]]] = lines.tolist()

    def ends(self) -> list[tuple[End, End]]:
        """Left and right end of every wall."""
        walls = len(self._planes)
        left: list[End | None] = [None] * walls
        right: list[End | None] = [None] * walls
        cuts = [break_at(self._columns, b) for b in self._bounds[1:-1]]
        at = [self._limits[0], *(cut.azimuth for cut in cuts), self._limits[1]]
        factor = [
            [joint_factor(line, math.tan(at[w]), math.tan(at[w + 1])) for line in self._lines[w]] for w in range(walls)
        ]
        left[0] = self._own(0, math.tan(at[0]), 0.0, BORDER, factor)
        right[-1] = self._own(walls - 1, math.tan(at[-1]), 0.0, BORDER, factor)
        for w, cut in enumerate(cuts):
            room = ROOM_SHARE * at[w + 1] - ROOM_SHARE * at[w], ROOM_SHARE * at[w + 2] - ROOM_SHARE * at[w + 1]
            right[w], left[w + 1] = self._joint(w, cut, room, factor)
        return [(a, b) for a, b in zip(left, right, strict=True) if a is not None and b is not None]

    def _own(self, wall: int, m: float, m_sd: float, kind: int, factor: list[list[float]]) -> End:
        """An end that this wall alone measures."""
        found = [line_at(line, m) for line in self._lines[wall]]
        variance = [v * f for (_, v), f in zip(found, factor[wall], strict=True)]
        return End(m, m_sd, [max(y, LEAST_Y) for y, _ in found], variance, kind)

    def _joint(self, wall: int, cut: Break, room: tuple[float, float], factor: list[list[float]]) -> tuple[End, End]:
        """Right end of a wall and left end of the next one."""
        m = math.tan(cut.azimuth)
        per_rad = 1.0 + m * m
        m_sd = cut.sd * per_rad
        a, b = self._planes[wall], self._planes[wall + 1]
        (s_a, var_a), (s_b, var_b) = line_at(a, m), line_at(b, m)
        turn = b[2] - a[2]
        near = max(s_a, s_b, 0.05)
        variance = var_a + var_b + (turn * m_sd) ** 2 + (RANGE_TOL * near) ** 2
        gap = s_b - s_a
        meets = -0.5 * gap * gap / variance - 0.5 * math.log(2.0 * math.pi * variance) + math.log(near)
        if meets + cut.corner_logit <= 0.0:
            kinds = (CORNER, OCCLUSION) if s_a > s_b else (OCCLUSION, CORNER)
            return (
                self._own(wall, m, m_sd, kinds[0], factor),
                self._own(wall + 1, m, m_sd, kinds[1], factor),
            )
        if abs(gap) < CROSSING_RAD * per_rad * abs(turn):  # the planes' crossing tells the azimuth, too
            move = -gap / turn
            crossing_var = (var_a + var_b) / turn**2
            share = m_sd**2 / (m_sd**2 + crossing_var)
            azimuth = math.atan(m + share * move)
            azimuth = min(max(azimuth, cut.azimuth - room[0]), cut.azimuth + room[1])
            m = math.tan(azimuth)
            m_sd *= math.sqrt(1.0 - share)
        one, two = self._own(wall, m, m_sd, CORNER, factor), self._own(wall + 1, m, m_sd, CORNER, factor)
        for row in (0, 1):
            v, w = one.y_var[row] + 1e-12, two.y_var[row] + 1e-12
            one.y[row] = two.y[row] = (one.y[row] * w + two.y[row] * v) / (v + w)
            one.y_var[row] = two.y_var[row] = v * w / (v + w)
        return one, two
