"""Facets: a scene as flat convex polygons in arrays, the form that kernels draw and light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from galoc_env.render.facet_build import PAD, Triangles, dot, gather, polygons
from galoc_env.render.facet_layout import boxes, clusters, extent, light_rectangles, padded

if TYPE_CHECKING:
    from galoc_env.scene import Scene

Array = NDArray[np.float64]

MOST_CORNERS = PAD
"""Corners of a facet at most."""
TEXEL = 0.20
"""Spacing of light texels on large facets, m."""
MOST_LIGHT = 2_000_000
"""Texels of a scene: where there would be more they lie farther apart."""


@dataclass(frozen=True, slots=True, eq=False)
class Facets:
    """Convex polygons, each of one instance, material and tint. Frame: the world's, moved so that ``origin`` is zero.

    Faces of the scene that lie in one plane and continue each other are merged. The order is by cluster: facets that
    lie close together, so that many can be passed over at once.
    """

    origin: NDArray[np.float64]
    """(3,) m, world frame. float32 coordinates stay exact to 1e-5 m however far away a plan lies."""
    vertices: NDArray[np.float32]
    """(V, 3) m: corners, counter-clockwise from the visible side."""
    first: NDArray[np.int32]
    """(N + 1,): facet i has the corners first[i] to first[i + 1], from 3 to ``MOST_CORNERS``."""
    plane: NDArray[np.float32]
    """(N, 4): unit normal n towards the visible side and d, with n . p = d for the points p of the facet."""
    texture: NDArray[np.float32]
    """(N, 2, 4): u and v at p, in texture widths, are texture[:, :, :3] @ p + texture[:, :, 3]."""
    material: NDArray[np.int32]
    """(N,): which of ``materials`` it wears."""
    materials: tuple[str, ...]
    """Names, as in ``Scene.meshes``."""
    tint: NDArray[np.float32]
    """(N, 3): factor on the texture."""
    glow: NDArray[np.float32]
    """(N,): brightness of a facet that shines by itself; 0 for one that is lit."""
    instance: NDArray[np.int32]
    """(N,): from 1."""
    semantic: NDArray[np.int8]
    """(N,): class, as in ``galoc_env.scene.mesh``."""
    light: NDArray[np.float32]
    """(N, 2, 4): column and row at p in the facet's own rectangle of light texels are light[:, :, :3] @ p +
    light[:, :, 3]. Texel centres are at integers, and the rectangle covers the facet: 0 <= column <= columns - 1."""
    light_size: NDArray[np.int32]
    """(N, 2): columns and rows of that rectangle, each at least 2."""
    light_first: NDArray[np.int64]
    """(N + 1,): texels light_first[i] to light_first[i + 1] are facet i's, row by row."""
    cluster_first: NDArray[np.int32]
    """(C + 1,): cluster c holds the facets cluster_first[c] to cluster_first[c + 1]."""
    cluster_box: NDArray[np.float32]
    """(C, 2, 3) m: lowest and highest corner of each cluster."""


def build_facets(scene: Scene, *, texel_m: float = TEXEL) -> Facets:
    """The facets of a scene: the same scene gives the same bytes.

    Args:
        scene: any scene; faces without area are left out.
        texel_m: spacing of light texels on large facets, m.

    Raises:
        GalocError: a face is not finite.
    """
    triangles, origin = gather(scene)
    corners, first, chosen = polygons(triangles)
    shape = padded(corners, first)
    order, cluster_first = clusters(shape)
    shape, chosen = shape[order], chosen[order]
    names = tuple(mesh.name for mesh in scene.meshes)
    return _facets(triangles, chosen, shape, np.diff(first)[order], cluster_first, origin, names, texel_m)


def _facets(
    t: Triangles,
    chosen: NDArray[np.int64],
    shape: Array,
    count: NDArray[np.int64],
    cluster_first: NDArray[np.int32],
    origin: Array,
    names: tuple[str, ...],
    texel_m: float,
) -> Facets:
    """Facets of ordered polygons (N, PAD, 3) with ``count`` corners, each like its triangle ``chosen``."""
    normal = t.normal[chosen]
    low, high = extent(shape, 1)
    middle = (low + high) / 2
    offset = dot(normal, shape[:, 0])  # a corner: the middle of a box need not lie in the plane
    texture = t.texture[chosen]
    texture[:, :, 3] -= np.floor(dot(texture[:, :, :3], middle[:, None]) + texture[:, :, 3])
    light, light_size, light_first = _texels(shape, normal, texel_m)
    return Facets(
        origin=origin,
        vertices=shape[np.arange(PAD) < count[:, None]].astype(np.float32),
        first=np.concatenate([[0], np.cumsum(count)]).astype(np.int32),
        plane=np.column_stack([normal, offset]).astype(np.float32),
        texture=texture.astype(np.float32),
        material=t.material[chosen],
        materials=names,
        tint=t.tint[chosen],
        glow=t.glow[chosen],
        instance=t.instance[chosen],
        semantic=t.semantic[chosen],
        light=light.astype(np.float32),
        light_size=light_size,
        light_first=light_first,
        cluster_first=cluster_first,
        cluster_box=boxes(shape, cluster_first).astype(np.float32),
    )


def _texels(shape: Array, normal: Array, texel_m: float) -> tuple[Array, NDArray[np.int32], NDArray[np.int64]]:
    """``light``, ``light_size`` and ``light_first`` of polygons."""
    most = max(MOST_LIGHT, 5 * len(shape))  # none has less than four
    while True:
        light, size = light_rectangles(shape, normal, texel_m)
        first = np.concatenate([[0], np.cumsum(size.astype(np.int64).prod(axis=1))])
        if first[-1] <= most:
            return light, size, first
        texel_m *= 1.25
