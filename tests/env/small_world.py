"""A small plan, and a localizer that costs nothing: what the environment's own tests run on."""

import math

import numpy as np

from galoc import Estimate, Floorplan

# Two rooms joined by a 1 m doorway, with a notch, so that no view of it is symmetric.
WALLS = [
    [0, 0, 6, 0], [6, 0, 6, 4], [6, 4, 2.5, 4], [2.5, 4, 2.5, 3.2], [2.5, 3.2, 0, 3.2], [0, 3.2, 0, 0],
    [3.5, 0, 3.5, 1.4], [3.5, 2.4, 3.5, 4],
]  # fmt: skip


def small_plan() -> Floorplan:
    return Floorplan.from_segments(WALLS, 2.6, name="small")


class DeadReckoner:
    """Starts at a fixed guess and adds up odometry; no belief."""

    def __init__(self, plan, camera):
        self.start = np.array([1.0, 1.0, 0.0])
        self.reset()

    def reset(self):
        self.pose = self.start.copy()

    def step(self, wireframe, *, gravity, odometry):
        c, s = math.cos(self.pose[2]), math.sin(self.pose[2])
        self.pose = self.pose + [
            c * odometry[0] - s * odometry[1],
            s * odometry[0] + c * odometry[1],
            odometry[2],
        ]
        return Estimate(self.pose, 0.5, False)


class Silent(DeadReckoner):
    """Never has anything to report."""

    def step(self, wireframe, *, gravity, odometry):
        return Estimate(np.full(3, np.nan), 0.0, True)


class NoStep:
    def __init__(self, plan, camera):
        pass

    def reset(self):
        pass
