"""A plan as a textured three-dimensional world, with the class and the instance of every face."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from galoc.errors import GalocError
from galoc.floorplan import Floorplan
from galoc.formats.atomic import write_atomic
from galoc_env.furniture import Furniture, furnish
from galoc_env.scene_furniture import add_furniture
from galoc_env.scene_light import Lamp, Lighting, Sun
from galoc_env.scene_mesh import SEMANTIC_NAMES, MeshBuilder, SceneMesh
from galoc_env.scene_openings import add_openings
from galoc_env.scene_rooms import add_floors, find_rooms
from galoc_env.scene_walls import add_walls

if TYPE_CHECKING:
    import trimesh

__all__ = ["SEMANTIC_NAMES", "Scene", "SceneMesh", "build_scene"]

VARIANTS = 8
"""Number of variants of each texture: more would cost every reset its drawing time."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """The world of one plan. World frame: x, y of the plan, z up, m; the floor is at z = 0."""

    plan: Floorplan
    """What it was built from."""
    meshes: tuple[SceneMesh, ...]
    """All faces, one mesh per material, ordered by name."""
    furniture: tuple[Furniture, ...]
    """What stands in it."""
    obstacles: NDArray[np.float64]
    """(S, 4) m: x1, y1, x2, y2 of the footprint edges of all furniture."""
    instance_semantic: NDArray[np.int8]
    """(I + 1,): semantic class of each instance number; index 0 is "nothing". Instance i + 1 is plan segment i."""
    lamps: tuple[Lamp, ...] = ()
    """What lights it, beside the windows (the faces of class OUTSIDE)."""
    sun: Sun | None = None
    """Shines in through the windows; None on a dull day."""

    def as_trimesh(self) -> trimesh.Scene:
        """The same faces as a trimesh scene, nodes named by material; baked light as vertex colours."""
        import trimesh

        scene = trimesh.Scene()
        for mesh in self.meshes:
            scene.add_geometry(mesh.mesh, geom_name=mesh.name, node_name=mesh.name)
        return scene

    def export(self, path: str | Path) -> Path:
        """Write a binary glTF file (y up, as that format wants it); it appears whole or not at all.

        Raises:
            GalocError: the name does not end in ``.glb``, or the folder cannot be written to.
        """
        target = Path(path)
        if target.suffix.lower() != ".glb":
            raise GalocError(f"path = {str(path)!r}", "a file name that ends in .glb", "Rename the file.")
        y_up = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
        scene = self.as_trimesh()
        scene.apply_transform(y_up)
        data = scene.export(file_type="glb")
        return write_atomic(target, data)


def build_scene(plan: Floorplan, *, furniture: float = 0.5, seed: int = 0) -> Scene:
    """Build the world of a plan: the same plan, density and seed give the same scene, byte for byte.

    Args:
        plan: any floorplan.
        furniture: density from 0 (none) to 1 (crowded).
        seed: a number from 0; chooses materials, tints, light and furniture.

    Raises:
        GalocError: density or seed out of range.
    """
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise GalocError(f"seed = {seed!r}", "a whole number from 0", "Pass seed=0, 1, 2, ...")
    style_rng, item_rng, part_rng = (np.random.default_rng([int(seed), stream]) for stream in range(3))
    items = furnish(plan, furniture, item_rng)
    builder = MeshBuilder()
    lighting = Lighting(float(style_rng.uniform(0.0, 2 * math.pi)))
    rooms = find_rooms(plan, style_rng)
    add_walls(builder, plan, rooms, lighting)
    add_floors(builder, plan, rooms)
    add_openings(builder, plan, rooms, lighting)
    add_furniture(builder, items, rooms, lighting, part_rng)
    edges = np.concatenate([item.edges() for item in items]) if items else np.zeros((0, 4))
    edges.setflags(write=False)
    lamps = tuple(
        Lamp(*polygon.representative_point().coords[0], plan.ceiling_height - 0.35, (1.6, 1.5, 1.35))
        for polygon in rooms.polygons
    )
    return Scene(plan, builder.finish(int(seed) % VARIANTS), items, edges, builder.semantics, lamps)
