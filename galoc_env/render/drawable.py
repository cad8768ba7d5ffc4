"""Drawable: a lit scene in the arrays that the drawing kernels read; several make an arena's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from galoc_env.render._lanes import LANES
from galoc_env.render._shading_kernel import level_start
from galoc_env.render.textures import digest, length, packed, texture_of
from galoc_env.scene.mesh import FLOOR

if TYPE_CHECKING:
    from galoc_env.render.facets import Facets
    from galoc_env.scene import Scene

UNIT = 2065
"""Stored light at which a texture keeps its own colour (:func:`galoc_env.render._lanes.lit`, in steps of 16)."""
BRIGHTEST = 4095
"""Stored light has 12 bits."""
GLOSS = {
    "checker_tiles": 0.96, "concrete": 0.4, "dark_planks": 0.72, "granite": 0.96, "herringbone": 0.72, "marble": 1,
    "mosaic": 0.56, "pale_planks": 0.56, "pine": 0.48, "planks": 0.64, "slabs": 0.48, "terrazzo": 0.96, "tiles": 0.88,
    "wood": 0.56,
}  # fmt: skip
"""How much of a mirror a floor of these materials is; others are dull."""


class SceneArrays(NamedTuple):
    """All homes' arrays, as the kernels take them; columns as in :class:`Drawable`."""

    vertices: NDArray[np.float32]
    table: NDArray[np.float32]
    numbers: NDArray[np.int32]
    boxes: NDArray[np.float32]
    cluster_first: NDArray[np.int32]
    texels: NDArray[np.int32]
    light: NDArray[np.uint64]


class Homes(NamedTuple):
    """Which part of the arrays is whose."""

    clusters: NDArray[np.int32]
    """(H, 2) first cluster of each home, and the one after its last."""
    origin: NDArray[np.float64]
    """(H, 3) m."""
    glossy: NDArray[np.bool_]
    """(H,) whether it has a glossy floor."""


@dataclass(frozen=True, slots=True, eq=False)
class Drawable:
    """One scene. Columns of ``table``: plane (4), maps to texture u, v and light column, row (4 each).

    Columns of ``numbers``: first vertex, vertex after the last, texture (in an arena its first texel, had it all
    levels), first light texel, light columns, light rows, instance, semantic class, gloss (floors only, 0 to 255).
    """

    vertices: NDArray[np.float32]
    """(3, V) m."""
    table: NDArray[np.float32]
    """(N, 20)."""
    numbers: NDArray[np.int32]
    """(N, 9)."""
    boxes: NDArray[np.float32]
    """(C, 2, 3) m."""
    cluster_first: NDArray[np.int32]
    """(C + 1,)."""
    textures: tuple[str, ...]
    """Digests, in the order in which ``numbers`` counts texels."""
    texels: tuple[NDArray[np.int32], ...]
    """Packed texture of each."""
    light: NDArray[np.uint64]
    """(T,) packed light."""
    origin: NDArray[np.float64]
    """(3,) m."""

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Facets, clusters, and corners of the facets of a cluster at most."""
        ends = self.numbers[self.cluster_first[1:] - 1, 1]
        corners = ends - self.numbers[self.cluster_first[:-1], 0]
        return len(self.table), len(self.boxes), int(corners.max())


def drawable(scene: Scene, facets: Facets, light: NDArray[np.float32], finest: int = 0) -> Drawable:
    """Arrays of a scene.

    Args:
        scene: for its textures.
        facets: of the scene.
        light: (T, 3) linear light of the facets' light texels.
        finest: first mip level of its textures.
    """
    white = np.full((4, 4, 3), 255, np.uint8)
    found = [texture_of(mesh) for mesh in scene.meshes]
    images = [white if image is None else image for image in found]
    names = tuple(digest(image) for image in images)
    count = len(facets.plane)
    table = np.concatenate([facets.plane, facets.texture.reshape(count, 8), facets.light.reshape(count, 8)], axis=1)
    columns = (facets.first[:-1], facets.first[1:], facets.material, facets.light_first[:-1], facets.light_size,
               facets.instance, facets.semantic, _gloss(facets))  # fmt: skip
    return Drawable(
        np.ascontiguousarray(facets.vertices.T),
        np.ascontiguousarray(table, np.float32),
        np.column_stack(columns).astype(np.int32),
        np.ascontiguousarray(facets.cluster_box),
        facets.cluster_first,
        names,
        tuple(packed(image, name, finest) for image, name in zip(images, names, strict=True)),
        packed_light(facets, light),
        facets.origin,
    )


def _gloss(facets: Facets) -> NDArray[np.int32]:
    """(N,) of floors at height 0, by material, 0 to 255."""
    of_material = np.array([round(255 * GLOSS.get(name.split(".")[0], 0.0)) for name in facets.materials], np.int32)
    height = facets.plane[:, 3] + facets.origin[2]
    floor = (facets.semantic == FLOOR) & (facets.plane[:, 2] > 0.999) & (np.abs(height) < 0.01)
    return np.where(floor, of_material[facets.material], 0).astype(np.int32)


def packed_light(facets: Facets, light: NDArray[np.float32]) -> NDArray[np.uint64]:
    """(T,) what each texel's texture colour is multiplied with: three numbers of 12 bits, 20 bits apart.

    Light is compressed (a place twice as bright as "full" is drawn 1.6 times as bright), brought to the picture's
    scale by a square root (near sRGB's curve, and exact on every machine), and takes the facet's tint.
    """
    counts = np.diff(facets.light_first)
    e = np.maximum(light.astype(np.float64), 0.0)
    glow = np.repeat(facets.glow.astype(np.float64), counts)[:, None]
    shown = np.where(glow > 0.0, glow, np.sqrt(1.35 * e / (1.0 + 0.35 * e)))
    shown = shown * np.repeat(facets.tint.astype(np.float64), counts, axis=0)
    level = np.clip(np.floor(UNIT * shown + 0.5), 0, BRIGHTEST).astype(np.int64)
    return (level[:, 0] | level[:, 1] << 20 | level[:, 2] << 40).astype(np.uint64)


def arena_arrays(homes: Sequence[Drawable], finest: int = 0) -> tuple[SceneArrays, Homes]:
    """All homes in one set of arrays, equal textures once.

    Args:
        homes: at least one.
        finest: first mip level of their textures.
    """
    place: dict[str, int] = {}
    texels: list[NDArray[np.int32]] = []
    indices, firsts, ranges = [], [np.zeros(1, np.int32)], []
    vertex = facet = cluster = lit = 0
    for home in homes:
        for name, texture in zip(home.textures, home.texels, strict=True):
            if name not in place:
                place[name] = len(texels) * length(finest) - level_start.py_func(finest)
                texels.append(texture)
        numbers = home.numbers.copy()
        numbers[:, :2] += vertex
        numbers[:, 2] = np.array([place[name] for name in home.textures], np.int32)[home.numbers[:, 2]]
        numbers[:, 3] += lit
        indices.append(numbers)
        firsts.append(home.cluster_first[1:] + np.int32(facet))
        ranges.append((cluster, cluster + len(home.boxes)))
        vertex, facet = vertex + home.vertices.shape[1], facet + len(home.table)
        cluster, lit = cluster + len(home.boxes), lit + len(home.light)
    scene = SceneArrays(
        np.concatenate([*(home.vertices for home in homes), np.zeros((3, LANES), np.float32)], axis=1),
        np.concatenate([home.table for home in homes]),
        np.concatenate(indices),
        np.concatenate([home.boxes for home in homes]),
        np.concatenate(firsts),
        np.concatenate(texels),
        np.concatenate([home.light for home in homes]),
    )
    glossy = np.array([bool(home.numbers[:, 8].any()) for home in homes])
    return scene, Homes(np.array(ranges, np.int32), np.array([home.origin for home in homes]), glossy)
