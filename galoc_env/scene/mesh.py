"""From textured quads and triangles to a few trimesh meshes, one per material."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc_env.materials import material

if TYPE_CHECKING:
    import trimesh

Array = NDArray[np.float64]

WALL, FLOOR, CEILING, DOOR, WINDOW, FURNITURE, OUTSIDE, FITTING = 1, 2, 3, 4, 5, 6, 7, 8
"""Semantic class of a face (0: nothing). DOOR is a door's frame, lintel and leaf, WINDOW a window's frame and reveal,
FURNITURE what stands on the floor and is an obstacle, FITTING what hangs on walls and ceilings."""

SEMANTIC_NAMES = ("nothing", "wall", "floor", "ceiling", "door", "window", "furniture", "outside", "fitting")
"""Name of each semantic class, by number."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneMesh:
    """All faces of the scene that wear one material. Faces are seen from the side they turn counter-clockwise to."""

    name: str
    """Name of the material; unique in the scene."""
    mesh: trimesh.Trimesh
    """World frame (x, y of the plan, z up, m), with TextureVisuals: UV in texture widths, (0, 0) the lower left."""
    shade: NDArray[np.uint8]
    """(V, 3): simple light times tint; a renderer without light of its own draws texture * shade / 255."""
    tint: NDArray[np.float32]
    """(F, 3): factor on the texture, without light."""
    glow: NDArray[np.float32]
    """(F,): 0 for what is lit; above 0 the face shines by itself, and looks like texture * tint * glow."""
    semantic: NDArray[np.int8]
    """(F,): semantic class of each face."""
    instance: NDArray[np.int32]
    """(F,): instance of each face, > 0, unique over the scene."""


class MeshBuilder:
    """Collects faces by material and hands out instance numbers."""

    def __init__(self) -> None:
        self._parts: dict[str, list[_Part]] = {}
        self._semantics: list[int] = [0]

    def new_instance(self, semantic: int) -> int:
        """Next free instance number (from 1), of this semantic class."""
        self._semantics.append(semantic)
        return len(self._semantics) - 1

    @property
    def semantics(self) -> NDArray[np.int8]:
        """(I + 1,): semantic class of each instance; entry 0 is "nothing"."""
        return np.array(self._semantics, np.int8)

    def add(
        self,
        name: str,
        points: ArrayLike,
        uv_m: ArrayLike,
        light: ArrayLike,
        faces: ArrayLike,
        instance: int,
        *,
        tint: ArrayLike = 1.0,
        glow: float = 0.0,
    ) -> None:
        """Add triangles of one instance.

        Args:
            name: material.
            points: (V, 3) m.
            uv_m: (V, 2) texture coordinates, m.
            light: scalar or (V,), simple light, 0..1; only renderers without light of their own use it.
            faces: (F, 3) vertex indices, counter-clockwise from the visible side.
            instance: number from :meth:`new_instance`.
            tint: scalar or (3,), factor on the texture.
            glow: brightness of a face that shines by itself; 0 for one that is lit.
        """
        p, colour = np.asarray(points, np.float64), np.broadcast_to(np.asarray(tint, np.float64), (3,))
        bright = np.asarray(min(glow, 1.0) if glow > 0.0 else light, np.float64)
        shade = np.broadcast_to(bright, (len(p),))[:, None] * colour
        uv, corners = np.asarray(uv_m, np.float64), np.asarray(faces, np.int64)
        part = _Part(p, uv, shade, corners, instance, self._semantics[instance], colour, glow)
        self._parts.setdefault(name, []).append(part)

    def add_quad(
        self,
        name: str,
        origin: ArrayLike,
        right: ArrayLike,
        up: ArrayLike,
        light: ArrayLike,
        instance: int,
        uv_m: tuple[float, float] = (0.0, 0.0),
        *,
        tint: ArrayLike = 1.0,
        glow: float = 0.0,
    ) -> None:
        """Add a parallelogram seen from the side of ``right x up``.

        Its texture runs in metres along ``right`` and ``up`` and has coordinate ``uv_m`` at ``origin``; ``light``
        is a scalar or one value for each corner, counter-clockwise from ``origin``.
        """
        o, r, u = (np.asarray(a, np.float64) for a in (origin, right, up))
        width, height = float(np.linalg.norm(r)), float(np.linalg.norm(u))
        uv = np.array(((0.0, 0.0), (width, 0.0), (width, height), (0.0, height))) + uv_m
        points, faces = np.stack([o, o + r, o + r + u, o + u]), ((0, 1, 2), (0, 2, 3))
        self.add(name, points, uv, light, faces, instance, tint=tint, glow=glow)

    def finish(self, seed: int) -> tuple[SceneMesh, ...]:
        """One mesh per material, ordered by name."""
        return tuple(_merge(name, self._parts[name], seed) for name in sorted(self._parts))


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """Faces of one call of :meth:`MeshBuilder.add`."""

    points: Array
    uv: Array
    shade: Array
    faces: NDArray[np.int64]
    instance: int
    semantic: int
    tint: Array
    glow: float


def _merge(name: str, parts: list[_Part], seed: int) -> SceneMesh:
    import trimesh
    from PIL import Image

    skin = material(name, seed)
    points, uv, shade = (np.concatenate([getattr(part, key) for part in parts]) for key in ("points", "uv", "shade"))
    starts = np.cumsum([0] + [len(part.points) for part in parts[:-1]])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)])
    counts = [len(part.faces) for part in parts]
    instance = np.repeat(np.array([part.instance for part in parts], np.int32), counts)
    semantic = np.repeat(np.array([part.semantic for part in parts], np.int8), counts)
    tint = np.repeat(np.array([part.tint for part in parts], np.float32), counts, axis=0)
    glow = np.repeat(np.array([part.glow for part in parts], np.float32), counts)
    colour = np.rint(255.0 * np.clip(shade, 0.0, 1.0)).astype(np.uint8)
    surface = trimesh.visual.material.PBRMaterial(
        name=name, baseColorTexture=Image.fromarray(skin.image), metallicFactor=0.0, roughnessFactor=1.0
    )
    visual = trimesh.visual.TextureVisuals(uv=uv / skin.size_m, material=surface)
    visual.vertex_attributes["color"] = np.column_stack([colour, np.full(len(colour), 255, np.uint8)])
    mesh = trimesh.Trimesh(points, faces, visual=visual, process=False, validate=False)
    return SceneMesh(name, mesh, colour, tint, glow, semantic, instance)
