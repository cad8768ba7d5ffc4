"""One end of a fitted wall, and what a fitted line says at an abscissa."""

from __future__ import annotations

import math
from dataclasses import dataclass

LEAST_Y = 0.01
"""Smallest height of a line above or below the horizon, over depth."""


@dataclass(slots=True)
class End:
    """One end of a wall on the level plane."""

    m: float
    """Abscissa: tangent of the azimuth."""
    m_sd: float
    """Its standard deviation."""
    y: list[float]
    """Height of the ceiling and floor line above and below the horizon, over depth."""
    y_var: list[float]
    """Their variances along the vertical."""
    kind: int
    """CORNER, OCCLUSION or BORDER."""


def line_at(line: list[float], m: float) -> tuple[float, float]:
    """Value and variance at an abscissa of a line as :func:`galoc.detect._wall_fit_kernel.fit_line` gives it."""
    d = m - line[0]
    return line[1] + line[2] * d, max(line[3] + 2.0 * d * line[4] + d * d * line[5], 0.0)


def joint_factor(line: list[float], m0: float, m1: float) -> float:
    """What the variances of a line's two ends must grow by to stand for errors that both have in common."""
    d0, d1 = m0 - line[0], m1 - line[0]
    both = line[3] + (d0 + d1) * line[4] + d0 * d1 * line[5]
    spread = math.sqrt(max(line_at(line, m0)[1] * line_at(line, m1)[1], 1e-18))
    return 1.0 + min(max(both / spread, 0.0), 1.0)
