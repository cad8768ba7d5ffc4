"""Boxes and prisms: what furniture and frames are put together from."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc_env.scene_light import Lighting
from galoc_env.scene_mesh import MeshBuilder

Array = NDArray[np.float64]

FOOT_SHADE = 0.80
"""Light at the foot of an upright face, relative to its top."""


@dataclass(frozen=True, slots=True, eq=False)
class SolidPainter:
    """Adds solids of one instance, placed in a frame that stands on the floor at (x, y), turned by heading."""

    builder: MeshBuilder
    """Where the faces go."""
    lighting: Lighting
    """Brightness by direction."""
    x: float
    """Origin of the frame, m."""
    y: float
    """Origin of the frame, m."""
    heading: float
    """Bearing of the frame's x axis, rad."""
    light: float
    """Factor on the brightness."""
    instance: int
    """Instance number of all faces."""

    def _axes(self) -> tuple[Array, Array]:
        c, s = math.cos(self.heading), math.sin(self.heading)
        return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([self.x, self.y, 0.0])

    def box(self, name: str, low: ArrayLike, high: ArrayLike, tint: ArrayLike = 1.0) -> None:
        """Box between two corners of the frame (x, y, z), m."""
        axes, origin = self._axes()
        a, b = np.asarray(low, np.float64), np.asarray(high, np.float64)
        size = b - a
        for axis in range(3):
            i, j = [(1, 2), (0, 2), (0, 1)][axis]
            for sign in (1, -1):
                if axis == 2 and sign < 0 and a[2] < 0.01:
                    continue  # stands on the floor
                corner = a.copy()
                corner[axis] = b[axis] if sign > 0 else a[axis]
                right, up = np.zeros(3), np.zeros(3)
                right[i], up[j] = size[i], size[j]
                # right x up must point out of the box; mirrored sides start at the other end of ``right``.
                if np.cross(right, up)[axis] * sign < 0:
                    corner[i] += size[i]
                    right = -right
                normal = np.zeros(3)
                normal[axis] = sign
                self._quad(name, corner @ axes + origin, right @ axes, up @ axes, normal @ axes, tint)

    def _quad(self, name: str, corner: Array, right: Array, up: Array, normal: Array, tint: ArrayLike) -> None:
        light = self.light * self.lighting.facing(normal)
        shade = np.full(4, light)
        if abs(normal[2]) < 0.5:
            shade[:2] *= FOOT_SHADE + (1 - FOOT_SHADE) * min(1.0, corner[2] / 0.6)
        self.builder.add_quad(name, corner, right, up, shade, self.instance, tint=tint)

    def prism(
        self, name: str, centre: ArrayLike, radii: tuple[float, float], tint: ArrayLike = 1.0, *, sides: int = 10
    ) -> None:
        """Upright frustum with ``centre`` = (x, y, z_low, z_high) and the radii of its lower and upper end, m."""
        axes, origin = self._axes()
        cx, cy, z0, z1 = np.asarray(centre, np.float64)
        angle = 2 * math.pi * np.arange(sides + 1) / sides
        ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(sides + 1)])
        base = np.array([cx, cy, 0.0])
        low, high = ((base + r * ring + [0, 0, z]) @ axes + origin for r, z in zip(radii, (z0, z1), strict=True))
        facing = self.light * np.array([self.lighting.facing(n @ axes) for n in ring])
        shade = np.concatenate([0.9 * facing, facing])
        n = sides + 1
        k = np.arange(sides)
        faces = np.concatenate([np.stack([k, k + 1, k + n + 1], 1), np.stack([k, k + n + 1, k + n], 1)])
        u = np.tile(angle * max(radii), 2)
        uv = np.column_stack([u, np.repeat([z0, z1], n)])
        self.builder.add(name, np.concatenate([low, high]), uv, shade, faces, self.instance, tint=tint)
        fan = np.stack([np.zeros(sides - 2, np.int64), np.arange(1, sides - 1), np.arange(2, sides)], 1)
        for points, up in ((high[:-1], True), (low[:-1], False)):
            if up or z0 > 0.01:
                light = self.light * self.lighting.facing((0, 0, 1.0 if up else -1.0))
                uv = points[:, :2] * (1.0 if up else -1.0, 1.0)
                self.builder.add(name, points, uv, light, fan if up else fan[:, ::-1], self.instance, tint=tint)
