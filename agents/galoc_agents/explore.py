"""Goes where it sees most that it has not seen, from where it believes to be."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc import Camera
from galoc.metrics import wrap_angle
from galoc_agents.coverage import Coverage
from galoc_agents.moves import FORWARD, LEFT, RIGHT, STEP_M, TURN_RAD, TURNS_AROUND, as_action, cut_short
from galoc_agents.paths import ARRIVED_M, Paths
from galoc_agents.spin import Spin
from galoc_agents.trail import Trail, apart, moved
from galoc_env.motion import BODY_RADIUS, wrap
from galoc_env.policy import Robot

Array = NDArray[np.float64]

JUMP_M, JUMP_RAD = 0.7, math.radians(25.0)
"""An estimate farther than this from where the last one and odometry lead to is another belief."""
WORTH = 0.004
"""Share of the floor that a view must add to be worth a walk."""
COMMITTED = 4
"""So many moves towards a new goal are made whatever the estimate does: one that flickers must not freeze the robot."""
PATIENCE = 3
"""Bumps with hardly a free step between them after which the robot goes off in some other direction."""
RELIEF = 0.5
"""Bumps that a free step makes up for."""


class Explore:
    """Frontier exploration on the map, under the estimate.

    It keeps account of the floor that it has seen from where it believes to have been, and goes on to the view that
    adds most per action. When the estimate jumps, its trail (dead reckoning) is put where it ends at the new estimate,
    and what it has seen is worked out anew. What it bumps into is remembered and walked around. When all is seen, it
    starts over; if it took no step to see it, at the far end. Where there is no estimate, nor a belief, it acts like
    :class:`galoc_agents.spin.Spin`.
    """

    _paths: Paths
    _camera: Camera

    def __init__(self) -> None:
        self._coverage: Coverage | None = None
        self._spin = Spin()

    def reset(self, robot: Robot) -> None:
        """Begin with nothing seen."""
        if self._coverage is None or self._paths.plan is not robot.plan or self._camera != robot.camera:
            self._paths, self._camera = Paths(robot.plan), robot.camera
            self._coverage = Coverage(robot.plan, robot.camera, self._paths.positions)
            self._nodes = [self._paths.node(stand) for stand in self._coverage.stands]
        self._paths.obstruct([])
        self._robot, self._trail, self._first = robot, Trail(), True
        self._spin.reset(robot)
        self._here: Array | None = None
        self._goal: tuple[Array, float] | None = None
        self._distance: Array | None = None
        self._seen = np.zeros(len(self._coverage.cells), bool)
        self._rng = np.random.default_rng(robot.seed)
        self._last: int | None = None
        self._queue: list[int] = []
        self._bumps, self._strikes, self._walked = 0.0, 0, False

    def act(self, observation: dict[str, NDArray[Any]], info: dict[str, Any]) -> Any:
        """The next move."""
        return as_action(self._robot, self.move(observation))

    def move(self, observation: dict[str, NDArray[Any]]) -> int:
        """The next move, as one of the discrete actions."""
        self._take(observation)
        if self._here is None:
            self._last = self._spin.move(observation)
        else:
            if not self._queue:
                self._queue = self._next(self._here)
            self._last = self._queue.pop(0)
        return self._last

    def did(self, move: int) -> None:
        """Be told that another move than its last answer is made: for policies that ask it only now and then."""
        if move != self._last:
            self._last = move
            self._queue.clear()

    def _take(self, observation: dict[str, NDArray[Any]]) -> None:
        """Odometry, bump and estimate of an observation."""
        assert self._coverage is not None
        odometry = np.asarray(observation["odometry"], dtype=np.float64)
        if not self._first:
            self._trail.move(odometry)
        self._first = False
        expected = None if self._here is None else moved(self._here, odometry)
        self._here = self._believed(observation, expected)
        if self._here is None:
            return
        if self._last == FORWARD:
            self._feel(cut_short(observation))
        if expected is None or any(np.greater(apart(expected, self._here), (JUMP_M, JUMP_RAD))):
            self._seen = self._coverage.seen(self._trail.views(self._here))
            self._drop()
        else:
            self._seen |= self._coverage.seen(self._here)

    def _feel(self, bumped: bool) -> None:
        """Take how a step forward ended."""
        if not bumped:
            self._bumps, self._walked = max(0.0, self._bumps - RELIEF), True
            return
        self._trail.bump(BODY_RADIUS + 0.05)
        self._bumps += 1.0
        self._queue.clear()
        self._distance = None  # the way leads around it, if there is one

    def _believed(self, observation: dict[str, NDArray[Any]], expected: Array | None) -> Array | None:
        """(3,) the estimate, else the belief's peak, else where odometry leads to, else None."""
        estimate = observation.get("estimate")
        if estimate is not None and np.any(estimate):
            return np.array(estimate[:3], dtype=np.float64)
        belief = self._robot.belief
        if belief is None:
            return expected
        place, heading = np.unravel_index(int(np.argmax(belief.p)), belief.p.shape)
        return np.array([*belief.positions[place], belief.headings_rad[heading]])

    def _drop(self) -> None:
        """Have no goal."""
        self._goal, self._distance = None, None

    def _done(self, here: Array) -> None:
        """Count what the goal was to show as seen, whether it was reached or not: it is not sought again."""
        assert self._goal is not None and self._coverage is not None
        view = np.array([*self._goal[0], self._goal[1]])
        self._trail.grant(here, view)
        self._seen |= self._coverage.seen(view)
        self._drop()

    def _next(self, here: Array) -> list[int]:
        """The next move on the way to the goal, or the first ones to a new one."""
        if self._bumps >= PATIENCE:
            # What is in the way is not on the map, or the map is that of another place.
            self._bumps, self._strikes = 0.0, self._strikes + 1
            if self._goal is not None:
                self._done(here)
            if self._strikes % 2 == 0:
                return self._get_away()
        for _ in range(3):
            new = self._goal is None
            moves = self._towards(here, COMMITTED if new else 1)
            if moves:
                return moves
            self._done(here)
        return self._get_away()

    def _get_away(self) -> list[int]:
        """Back to where the robot came from, more or less."""
        bearing = self._trail.way_back(COMMITTED * STEP_M)
        turns = TURNS_AROUND // 2 if bearing is None else round(bearing / TURN_RAD)
        turns += int(self._rng.integers(-1, 2))
        return [LEFT if turns > 0 else RIGHT] * abs(turns) + [FORWARD] * COMMITTED

    def _towards(self, here: Array, count: int) -> list[int]:
        """Up to so many moves to the goal: along the way, then turning to its heading; none: there, or stuck."""
        if self._goal is None:
            self._choose(here)
        assert self._goal is not None
        place, heading = self._goal
        if self._distance is None:
            self._paths.obstruct(self._trail.obstacles(here), self._trail.walked(here))
            self._distance = self._paths.distance(place)
        moves = self._paths.moves_down(here, self._distance, count)
        if moves or np.hypot(*(place - here[:2])) > 2.0 * ARRIVED_M:
            return moves
        off = wrap(heading - here[2])
        return [LEFT if off > 0 else RIGHT] * min(count, round(abs(off) / TURN_RAD))

    def _choose(self, here: Array) -> None:
        """The view that adds most per action."""
        assert self._coverage is not None
        self._paths.obstruct(self._trail.obstacles(here), self._trail.walked(here))
        headings = here[2] + TURN_RAD * np.arange(TURNS_AROUND)
        gains = self._coverage.gains(~self._seen, headings)
        if gains.max(initial=0.0) < WORTH:
            self._seen[:], walked, self._walked = False, self._walked, False
            if not walked:  # one small room, all of it in view from here: go and look from elsewhere
                way = self._paths.distance(here[:2])[self._nodes]
                far = int(np.argmax(np.where(np.isfinite(way), way, 0.0)))
                self._goal = self._coverage.stands[far].copy(), float(here[2])
                return
            gains = self._coverage.gains(~self._seen, headings)
        cost = self._actions(here)
        gains[cost <= 0.0] = 0.0
        stand, turn = np.unravel_index(int(np.argmax(gains / np.maximum(cost, 1.0))), gains.shape)
        self._goal = self._coverage.stands[stand].copy(), float(headings[turn])

    def _actions(self, here: Array) -> Array:
        """(K, H) about how many actions each view is away; 0: it is the present one."""
        assert self._coverage is not None
        stands = self._coverage.stands
        way = self._paths.distance(here[:2])[self._nodes]
        bearing = np.arctan2(stands[:, 1] - here[1], stands[:, 0] - here[0])
        turns = np.arange(TURNS_AROUND)
        headings = here[2] + TURN_RAD * turns
        first, last = _turns(bearing - here[2])[:, None], _turns(headings[None] - bearing[:, None])
        walk = (way / STEP_M)[:, None] + first + last
        near = np.linalg.norm(stands - here[:2], axis=1) < ARRIVED_M
        return np.where(near[:, None], np.minimum(turns, TURNS_AROUND - turns), walk)


def _turns(angle: Array) -> Array:
    """How many turns an angle (rad) is, either way round."""
    return np.abs(wrap_angle(angle)) / TURN_RAD
