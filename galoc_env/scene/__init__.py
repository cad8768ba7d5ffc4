"""A plan as a textured three-dimensional world, with the class and the instance of every face."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from galoc.errors import GalocError
from galoc.floorplan import Floorplan
from galoc.formats.atomic import write_atomic
from galoc_env.furniture import Furniture, furnish
from galoc_env.scene.ceilings import add_ceilings
from galoc_env.scene.doors import Leaf, add_leaves, hang_leaves, leaf_edges, shut_lines
from galoc_env.scene.dressing import add_dressing
from galoc_env.scene.fittings import add_fittings, add_switches
from galoc_env.scene.furniture import add_furniture
from galoc_env.scene.ground import Clutter
from galoc_env.scene.lamps import add_lamps, draw_sun
from galoc_env.scene.light import Lamp, Lighting, Sun
from galoc_env.scene.mesh import SEMANTIC_NAMES, MeshBuilder, SceneMesh
from galoc_env.scene.openings import add_doorways, find_holes
from galoc_env.scene.rooms import add_floors, find_rooms
from galoc_env.scene.walls import add_walls, wall_sides, window_cuts
from galoc_env.scene.windows import add_windows

if TYPE_CHECKING:
    import trimesh

__all__ = ["SEMANTIC_NAMES", "Scene", "SceneMesh", "build_scene"]

VARIANTS = 64
"""Number of variants of each texture. Few are drawn twice, and more would fill memory."""


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
    """(S, 4) m: x1, y1, x2, y2 of the footprint edges of furniture, then of open door leaves, then of shut doors."""
    instance_semantic: NDArray[np.int8]
    """(I + 1,): semantic class of each instance number; index 0 is "nothing". Instance i + 1 is plan segment i."""
    lamps: tuple[Lamp, ...] = ()
    """What lights it, beside the windows (the faces of class OUTSIDE)."""
    sun: Sun | None = None
    """Shines in through the windows; None on a dull day."""
    leaves: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 4)))
    """(K, 4) m: footprint edges of open door leaves; they are in ``obstacles`` too."""
    sight_plan: Floorplan | None = None
    """The plan as a camera sees it, with walls where doors are shut; without such doors ``plan`` itself."""

    def __post_init__(self) -> None:
        """A scene made without it sees its plan."""
        if self.sight_plan is None:
            object.__setattr__(self, "sight_plan", self.plan)

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


def build_scene(plan: Floorplan, *, furniture: float = 0.5, seed: int = 0, shut_doors: float = 0.0) -> Scene:
    """Build the world of a plan: the same arguments give the same scene, byte for byte.

    Args:
        plan: any floorplan.
        furniture: density from 0 (none: bare rooms with lamps and doors) to 1 (crowded); what hangs on walls and at
            windows goes with it.
        seed: a number from 0; chooses materials, tints, light, furniture, fittings, and how far doors stand open.
        shut_doors: share of doors that are shut, 0 to 1. An open door leaves its gap passable.

    Raises:
        GalocError: density, share or seed out of range.
    """
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise GalocError(f"seed = {seed!r}", "a whole number from 0", "Pass seed=0, 1, 2, ...")
    # One stream each, so that more of one thing moves nothing else.
    style, item, part, leaf, window, fitting, sky, lamp = (np.random.default_rng([int(seed), k]) for k in range(8))
    lighting = Lighting(float(style.uniform(0.0, 2 * math.pi)))
    rooms = find_rooms(plan, style)
    items = furnish(plan, furniture, item, rooms)
    leaves = hang_leaves(plan, items, shut_doors, leaf)
    builder = MeshBuilder()
    sides, holes, cuts = wall_sides(plan, rooms), find_holes(plan, rooms), window_cuts(plan)
    add_walls(builder, plan, rooms, sides, cuts, lighting)
    add_floors(builder, plan, rooms)
    add_doorways(builder, plan, holes, rooms.trim, lighting)
    add_leaves(builder, leaves, rooms, lighting, leaf)
    add_windows(builder, plan, holes, rooms.trim, lighting, window)
    add_furniture(builder, items, rooms, lighting, part)
    lamps = add_lamps(builder, plan, rooms, holes, lighting, lamp)
    if furniture > 0.0:
        clutter = Clutter([*items, *(one.box() for one in leaves)])
        add_dressing(builder, plan, holes, rooms, clutter, lighting, furniture, window)
        add_fittings(builder, plan, rooms, sides, cuts, clutter, lighting, furniture, fitting)
        add_switches(builder, plan, holes, lighting, fitting)
        add_ceilings(builder, plan, rooms, lighting, furniture, fitting)
    swung, shut = leaf_edges(leaves), shut_lines(plan, leaves)
    edges = np.concatenate([np.zeros((0, 4)), *(one.edges() for one in items), swung, shut])
    for array in (edges, swung):
        array.setflags(write=False)
    return Scene(
        plan,
        builder.finish(int(seed) % VARIANTS),
        items,
        edges,
        builder.semantics,
        lamps,
        draw_sun(holes, sky),
        swung,
        _sight_plan(plan, leaves, shut),
    )


def _sight_plan(plan: Floorplan, leaves: tuple[Leaf, ...], lines: NDArray[np.float64]) -> Floorplan:
    """The plan with walls instead of shut doors."""
    if not len(lines):
        return plan
    shut = {leaf.door for leaf in leaves if leaf.shut}
    openings = tuple(opening for k, opening in enumerate(plan.openings) if k not in shut)
    return replace(plan, segments=np.vstack([plan.segments, lines]), openings=openings)
