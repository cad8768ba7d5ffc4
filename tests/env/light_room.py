"""Rooms of rectangles, put together face by face, and the places of their light texels."""

import numpy as np

from galoc import Floorplan
from galoc_env.render.facets import Facets, build_facets
from galoc_env.scene import Scene
from galoc_env.scene.mesh import CEILING, FLOOR, FURNITURE, OUTSIDE, WALL, MeshBuilder

WHITE = (1.0, 1.0, 1.0)
HEIGHT = 2.5


class Room:
    """Walls, floor and ceiling of rectangles, put together face by face."""

    def __init__(self) -> None:
        self.builder = MeshBuilder()

    def sheet(self, origin, right, up, kind: int = FURNITURE, glow: float = 0.0, both: bool = False) -> int:  # type: ignore[no-untyped-def]
        instance = self.builder.new_instance(kind)
        o, r, u = (np.asarray(v, float) for v in (origin, right, up))
        self.builder.add_quad("plaster", o, r, u, 1.0, instance, glow=glow)
        if both:
            self.builder.add_quad("plaster", o + r, -r, u, 1.0, instance, glow=glow)
        return instance

    def box(self, x0: float, y0: float, x1: float, y1: float, *, skip: str = "") -> dict[str, int]:
        """The inner faces of a room; ``skip`` leaves out sides of "wesn"."""
        w, d, h = x1 - x0, y1 - y0, HEIGHT
        out = {
            "floor": self.sheet((x0, y0, 0), (w, 0, 0), (0, d, 0), FLOOR),
            "ceiling": self.sheet((x0, y1, h), (w, 0, 0), (0, -d, 0), CEILING),
        }
        sides = {
            "w": ((x0, y0, 0), (0, d, 0)),
            "e": ((x1, y1, 0), (0, -d, 0)),
            "s": ((x1, y0, 0), (-w, 0, 0)),
            "n": ((x0, y1, 0), (w, 0, 0)),
        }
        for name, (o, r) in sides.items():
            if name not in skip:
                out[name] = self.sheet(o, r, (0, 0, h), WALL)  # right x up points into the room
        return out

    def body(self, low, high) -> None:  # type: ignore[no-untyped-def]
        """A closed box that stands in the room."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        w, d, h = x1 - x0, y1 - y0, z1 - z0
        self.sheet((x0, y0, z1), (w, 0, 0), (0, d, 0))
        self.sheet((x0, y1, z0), (w, 0, 0), (0, -d, 0))
        self.sheet((x0, y0, z0), (w, 0, 0), (0, 0, h))
        self.sheet((x1, y1, z0), (-w, 0, 0), (0, 0, h))
        self.sheet((x1, y0, z0), (0, d, 0), (0, 0, h))
        self.sheet((x0, y1, z0), (0, -d, 0), (0, 0, h))

    def scene(self) -> Scene:
        plan = Floorplan.from_segments(np.array([[0, 0, 4, 0], [4, 0, 4, 3], [4, 3, 0, 0]], float), ceiling_height=2.5)
        return Scene(plan, self.builder.finish(0), (), np.zeros((0, 4)), self.builder.semantics)

    def facets(self) -> Facets:
        return build_facets(self.scene())


def texels(facets: Facets, instance: int) -> tuple[np.ndarray, np.ndarray]:
    """Places (K, 3) of an instance's texels, world frame, and their numbers (K,)."""
    places, numbers = [], []
    for i in np.flatnonzero(facets.instance == instance):
        rows = facets.light[i, :, :3].astype(float)
        c, r = (a.ravel() for a in np.meshgrid(*(np.arange(n) for n in facets.light_size[i])))
        axes = rows / (rows**2).sum(axis=1, keepdims=True)
        n, d = facets.plane[i, :3].astype(float), facets.plane[i, 3]
        off = np.column_stack([c, r]) - facets.light[i, :, 3]
        places.append(off @ axes + d * n + facets.origin)
        numbers.append(facets.light_first[i] + np.arange(len(c)))
    return np.concatenate(places), np.concatenate(numbers)


def window_room() -> tuple[Room, dict[str, int], int]:
    """5 x 4 m with a window in the west wall: 1.2 m wide, from 0.9 to 2.1 m, in the plane of the wall."""
    room = Room()
    parts = room.box(0, 0, 5, 4, skip="w")
    for y0, y1, z0, z1 in ((0, 4, 0, 0.9), (0, 4, 2.1, HEIGHT), (0, 1.4, 0.9, 2.1), (2.6, 4, 0.9, 2.1)):
        room.sheet((0, y0, z0), (0, y1 - y0, 0), (0, 0, z1 - z0), WALL)
    pane = room.sheet((0, 1.4, 0.9), (0, 1.2, 0), (0, 0, 1.2), OUTSIDE, glow=1.0)
    return room, parts, pane
