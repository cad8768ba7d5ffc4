"""From the triangles of a scene to convex polygons, their rectangles of light texels and their clusters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from galoc.errors import GalocError
from galoc_env.render._merge_kernel import merge

if TYPE_CHECKING:
    from galoc_env.scene import Scene

Array = NDArray[np.float64]

LEAST_AREA = 1e-10
"""Smaller triangles are dropped, m^2."""
WELD = 1e-5
"""Corners closer than about this are one, m; also how flat and how alike merged faces must be."""
PAD = 16
"""Corners that padded polygons have."""


@dataclass(frozen=True, slots=True, eq=False)
class Triangles:
    """Triangles of a scene."""

    points: Array
    """(F, 3, 3) m, relative to the origin."""
    normal: Array
    """(F, 3) unit normals."""
    area: Array
    """(F,) m^2."""
    texture: Array
    """(F, 2, 4) affine map to texture widths, each row's value at the triangle's own first corner in [0, 1)."""
    material: NDArray[np.int32]
    """(F,)."""
    tint: NDArray[np.float32]
    """(F, 3)."""
    glow: NDArray[np.float32]
    """(F,)."""
    instance: NDArray[np.int32]
    """(F,)."""
    semantic: NDArray[np.int8]
    """(F,)."""


def dot(a: Array, b: Array) -> Array:
    """Inner product of the last axis of length 3; with no library whose rounding depends on the processor."""
    return np.asarray(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2])


def cross(a: Array, b: Array) -> Array:
    """Vector product of the last axis."""
    x = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    y = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    z = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return np.stack([x, y, z], axis=-1)


def unit(a: Array) -> Array:
    """Vectors of the last axis at length 1; zero stays zero."""
    return np.asarray(a / np.maximum(np.sqrt(dot(a, a)), 1e-300)[..., None])


def gather(scene: Scene) -> tuple[Triangles, Array]:
    """All triangles of a scene that have an area, and the origin (3,) that they are relative to.

    Raises:
        GalocError: a corner or texture coordinate is not finite.
    """
    meshes = [m for m in scene.meshes if len(m.mesh.faces)]
    number = {m.name: i for i, m in enumerate(scene.meshes)}
    points = _joined([np.asarray(m.mesh.vertices, np.float64)[m.mesh.faces] for m in meshes], (3, 3))
    uv = _joined([_uv(m.mesh)[m.mesh.faces] for m in meshes], (3, 2))
    for what, values in (("corner", points), ("texture coordinate", uv)):
        finite = np.isfinite(values)
        if not finite.all():
            bad = ~finite.all(axis=(1, 2))
            raise GalocError(f"{what} of a face = {values[bad][0].tolist()}", "finite numbers", "Mend the mesh.")
    # A whole number of metres: what lies at a round height stays at one.
    ends = [(points[..., k].min(), points[..., k].max()) for k in range(3)] if len(points) else [(0.0, 0.0)] * 3
    origin = np.array([np.rint((low + high) / 2) for low, high in ends])
    points = points - origin
    normal = cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    double = np.sqrt(dot(normal, normal))
    keep = double > 2 * LEAST_AREA
    counts = [len(m.mesh.faces) for m in meshes]
    rest: dict[str, Any] = {
        "material": np.repeat(np.array([number[m.name] for m in meshes], np.int32), counts),
        "tint": _joined([np.asarray(m.tint, np.float32) for m in meshes], (3,)),
        "glow": _joined([np.asarray(m.glow, np.float32) for m in meshes], ()),
        "instance": _joined([np.asarray(m.instance, np.int32) for m in meshes], ()),
        "semantic": _joined([np.asarray(m.semantic, np.int8) for m in meshes], ()),
    }
    points, uv, normal = points[keep], uv[keep], unit(normal[keep])
    texture = _texture(points, uv, normal)
    return Triangles(points, normal, double[keep] / 2, texture, **{k: v[keep] for k, v in rest.items()}), origin


def _joined(parts: list[NDArray[Any]], shape: tuple[int, ...]) -> NDArray[Any]:
    return np.concatenate(parts) if parts else np.zeros((0, *shape))


def _uv(mesh: Any) -> Array:
    uv = getattr(mesh.visual, "uv", None)
    return np.zeros((len(mesh.vertices), 2)) if uv is None else np.asarray(uv, np.float64)


def _texture(points: Array, uv: Array, normal: Array) -> Array:
    """(F, 2, 4) affine map that gives each corner its texture coordinate, up to whole texture widths."""
    a, b = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    # Dual basis of the two edges in the plane.
    to_a, to_b = cross(b, normal), cross(normal, a)
    to_a, to_b = to_a / dot(a, to_a)[:, None], to_b / dot(b, to_b)[:, None]
    start = uv[:, 0] - np.floor(uv[:, 0])
    step_a, step_b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    gradient = step_a[:, :, None] * to_a[:, None] + step_b[:, :, None] * to_b[:, None]
    constant = start - dot(gradient, points[:, None, 0])
    return np.concatenate([gradient, constant[..., None]], axis=2)


def _mix(columns: list[NDArray[Any]]) -> NDArray[np.uint64]:
    """One 64-bit word for each row of whole numbers."""
    word = np.zeros(columns[0].shape, np.uint64)
    for column in columns:
        word = (word ^ column.astype(np.int64).view(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
        word ^= word >> np.uint64(29)
    return word * np.uint64(0xBF58476D1CE4E5B9)


def _steps(values: Array, step: float) -> list[NDArray[Any]]:
    """Columns of whole steps; shifted, since round numbers must not lie where two steps meet."""
    flat = np.floor(values / step + 0.3719)
    return list(np.moveaxis(flat, -1, 0))


def _twins(t: Triangles) -> NDArray[np.int64]:
    """(3 F,) half-edge of the same group that runs the other way; -1 for none."""
    constant = t.texture[:, :, 3] + 0.2413
    alike = [t.material, t.instance, np.ascontiguousarray(t.glow).view(np.int32)]
    alike += list(np.ascontiguousarray(t.tint).view(np.int32).T)
    alike += _steps(t.normal, WELD) + _steps(dot(t.normal, t.points[:, 0])[:, None], WELD)
    alike += _steps(t.texture[:, :, :3].reshape(-1, 6), 10 * WELD) + _steps(constant - np.floor(constant), 10 * WELD)
    group = np.repeat(_mix(alike), 3)
    corner = _mix(_steps(t.points, WELD))
    start, end = corner.reshape(-1).view(np.int64), np.roll(corner, -1, axis=1).reshape(-1).view(np.int64)
    edge, other = _mix([group.view(np.int64), start, end]), _mix([group.view(np.int64), end, start])
    order = np.argsort(edge, kind="stable")
    ranked = edge[order]
    place = np.minimum(np.searchsorted(ranked, other), len(ranked) - 1)
    twin = np.where(ranked[place] == other, order[place], -1)
    # Of edges that several faces share, only one pair is kept.
    mutual = (twin >= 0) & (twin[twin] == np.arange(len(twin)))
    return np.where(mutual, twin, -1)


def polygons(t: Triangles) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Convex polygons: corners (V, 3), where each begins (N + 1,), and the largest triangle of each (N,)."""
    if not len(t.area):
        return np.zeros((0, 3)), np.zeros(1, np.int64), np.zeros(0, np.int64)
    edge = (np.roll(t.points, -1, axis=1) - t.points).reshape(-1, 3)
    length = np.sqrt(dot(edge, edge))
    twin = _twins(t)
    tries = np.flatnonzero(twin > np.arange(len(twin)))
    tries = tries[np.argsort(-length[tries], kind="stable")]
    corner, first, chosen = merge(edge / length[:, None], t.normal, t.area, twin, tries, PAD)
    return t.points.reshape(-1, 3)[corner], first, chosen
