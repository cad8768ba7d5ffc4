"""What the learned policy sees: the belief, turned into numbers around the robot.

A belief is a cloud of poses. Each of its hypotheses says what the walls around the robot look like, in the robot's own
frame: how far they are on average is where it can look, and how much the hypotheses differ is where looking pays.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from galoc import Floorplan
from galoc.config import LocalizerConfig
from galoc.profiles import MAX_POSITIONS, ProfileField, profile_field
from galoc_agents.sight import LINE_M
from galoc_env.motion import STEP_M
from galoc_env.observe import CANVAS_CELLS, Canvas
from galoc_env.policy import BeliefView, Robot

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

SECTORS = 24
"""Directions around the robot, 15 degrees each, counter-clockwise from straight ahead."""
RAYS = 3
"""Rays per sector."""
HYPOTHESES = 64
"""Poses drawn from the belief, at even steps of its cumulative mass: no chance involved."""
NEAREST_M, FARTHEST_M = 0.2, 12.0
"""Ranges are told apart between these, m."""
MOVES = 4
"""Forward, backward, left, right."""
MEMORY = 2
"""Last moves that are seen."""
MIRRORED_MOVES = (0, 1, 3, 2)
"""What a robot in a mirrored world does instead."""
LONGEST = 60
"""Steps after which time stands still."""
BOUND = 10.0
"""No number in a vector is larger."""
COARSE = 16
"""Cells on a side of the canvases that a network sees."""
FADE = 0.8
"""What a step forward or backward leaves of having looked somewhere."""
GRID_M = LocalizerConfig().resolution
"""Grid that localizers ask for unless told otherwise, m."""
COARSENED = MAX_POSITIONS // 2
"""A grid of more positions may be that one, coarsened for a large plan."""
GOLDEN = 0.6180339887498949
MEMORY_SIZE = SECTORS + MEMORY * MOVES + 2
SIZE = 3 * SECTORS + 2 + MEMORY_SIZE + 5
"""Numbers that the network sees."""


def systematic(belief: BeliefView, count: int = HYPOTHESES) -> tuple[Array, Array]:
    """Poses that stand for a belief: positions (count, 2) m and headings (count,) rad, of equal weight."""
    marginal = np.cumsum(belief.p.sum(axis=1), dtype=np.float64)
    levels = (np.arange(count) + 0.5) / count
    rows = np.minimum(np.searchsorted(marginal, levels * marginal[-1]), len(marginal) - 1)
    within = np.cumsum(belief.p[rows], axis=1, dtype=np.float64)
    drawn = (np.arange(count) * GOLDEN % 1.0) * within[:, -1]
    columns = np.minimum((within <= drawn[:, None]).sum(axis=1), within.shape[1] - 1)
    return belief.positions[rows], belief.headings_rad[columns]


def profiles(field: ProfileField, positions: Array, headings: Array) -> Array:
    """(H, 24, 3) log of the wall's range from each hypothesis, in the robot's frame, counter-clockwise."""
    cell = np.floor((positions - field.origin) / field.resolution).astype(np.int64)
    high, wide = field.index.shape
    row, column = np.clip(cell[:, 1], 0, high - 1), np.clip(cell[:, 0], 0, wide - 1)
    at = field.index[row, column].astype(np.int64)
    for lost in np.flatnonzero(at < 0):  # an estimate between the cells that a camera can be in
        at[lost] = field.nearest(positions[lost])
    width = 360 // (SECTORS * RAYS)
    bearings = np.arange(SECTORS * RAYS) * width - (RAYS // 2) * width
    degrees = (np.round(np.degrees(headings)).astype(np.int64)[:, None] + bearings) % 360
    ranges = np.clip(field.ranges[at[:, None], degrees], NEAREST_M, FARTHEST_M)
    return np.log(ranges.astype(np.float64)).reshape(len(at), SECTORS, RAYS)


def field_of(plan: Floorplan, belief: BeliefView | None) -> ProfileField:
    """Profiles on the grid of a belief: those that its localizer already has, where that is galoc's."""
    if belief is None or len(belief.positions) > COARSENED:
        return profile_field(plan, GRID_M)
    return profile_field(plan, belief.resolution)


class Memory:
    """What a robot remembers of its own moves: where it has looked, what it did last."""

    def __init__(self, hfov_rad: float) -> None:
        bearing = (np.arange(SECTORS) + SECTORS // 2) % SECTORS - SECTORS // 2
        self._seen_now = np.abs(bearing) * math.tau / SECTORS <= hfov_rad / 2.0
        self._looked = np.zeros(SECTORS)
        self._moves = np.zeros((MEMORY, MOVES))
        self._turned, self._steps = 0.0, 0

    def add(self, odometry: Array, move: int | None) -> None:
        """Turn with the robot what it has looked at, and add what it sees now."""
        if move is not None:
            self._moves = np.roll(self._moves, 1, axis=0)
            self._moves[0] = np.eye(MOVES)[move]
            self._steps += 1
        shift = odometry[2] / math.tau * SECTORS
        whole = math.floor(shift)
        here, next_one = (np.roll(self._looked, -whole - extra) for extra in (0, 1))
        self._looked = here + (shift - whole) * (next_one - here)
        gone = math.hypot(odometry[0], odometry[1])
        self._looked *= FADE ** (gone / STEP_M)
        self._turned = 0.0 if gone > STEP_M / 2.0 else self._turned + odometry[2]
        self._looked[self._seen_now] = 1.0

    def numbers(self) -> list[Array]:
        """(24,) looked at, 0 to 1; (8,) the last moves; (2,) turns since the last step, time."""
        scalars = np.array([self._turned / math.tau, min(self._steps, LONGEST) / LONGEST])
        return [self._looked, self._moves.ravel(), scalars]


class Features:
    """Turns observations into the network's vector.

    ``reset`` at the start of an episode, then ``see`` once per observation, telling the move that led to it.
    """

    size = SIZE
    """Numbers in a vector."""
    _plan: Floorplan | None = None
    """Whose profiles are at hand."""

    def reset(self, robot: Robot) -> None:
        """A new episode begins."""
        self._robot = robot
        if robot.plan is not self._plan:
            self._plan, self._field = robot.plan, field_of(robot.plan, robot.belief)
        self._memory = Memory(math.radians(robot.camera.hfov_deg))
        self._reach = math.log(LINE_M * 2.0 * robot.camera.fy / robot.camera.height)

    def see(self, observation: dict[str, Any], info: dict[str, Any], move: int | None = None) -> Floats:
        """The (size,) vector of this observation.

        Args:
            observation: of the environment.
            info: of the environment; only what every robot is told is read.
            move: that led here; None at the start.
        """
        self._memory.add(np.asarray(observation["odometry"], dtype=np.float64), move)
        belief, estimate = self._robot.belief, np.asarray(observation.get("estimate", np.zeros(4)), dtype=np.float64)
        nats = math.log(belief.p.size) if belief is not None else 1.0
        told = [
            estimate[3],
            float(info.get("entropy", nats)) / nats,
            float(info.get("coverage", 0.0)),
            float(info.get("abstained", False)),
            float(info.get("collided", False)),
        ]
        parts = [*self._view(belief, estimate), *self._memory.numbers(), np.array(told)]
        return np.clip(np.concatenate(parts), -BOUND, BOUND).astype(np.float32)

    def _view(self, belief: BeliefView | None, estimate: Array) -> list[Array]:
        """Per sector mean log-range, disagreement and share in reach; how positions scatter and headings agree."""
        if belief is not None:
            positions, headings = systematic(belief)
        elif estimate[3] > 0.0:
            positions, headings = estimate[None, :2], estimate[None, 2]
        else:
            return [np.zeros(3 * SECTORS + 2)]
        logs = profiles(self._field, positions, headings)
        shown = np.maximum(logs, self._reach)  # walls nearer than that all look the same: no edge in the image
        scatter = math.log1p(float(np.hypot(*positions.std(axis=0))))
        agree = abs(complex(np.exp(1j * headings).mean()))
        doubt = shown.std(axis=0).mean(axis=1)
        return [logs.mean(axis=(0, 2)), doubt, (logs > self._reach).mean(axis=(0, 2)), np.array([scatter, agree])]


class CanvasFeatures(Features):
    """The belief as the observation has it, on a canvas of the plan; to compare with.

    Args:
        headings: also where the belief's poses look: two more canvases, mass times cosine and sine.
    """

    def __init__(self, headings: bool) -> None:
        self._headings = headings
        self.size = (4 if headings else 2) * COARSE**2 + 5 + MEMORY_SIZE + 5

    def reset(self, robot: Robot) -> None:
        """A new episode begins."""
        super().reset(robot)
        self._canvas = Canvas.of(robot.plan)

    def see(self, observation: dict[str, Any], info: dict[str, Any], move: int | None = None) -> Floats:
        """The (size,) vector of this observation; arguments as for :class:`Features`."""
        self._belief_canvas = np.asarray(observation["belief"], dtype=np.float64)
        return super().see(observation, info, move)

    def _view(self, belief: BeliefView | None, estimate: Array) -> list[Array]:
        half = self._canvas.cell_m * CANVAS_CELLS / 2.0
        at = (estimate[:2] - self._canvas.origin - half) / half if estimate[3] > 0.0 else np.zeros(2)
        turn = estimate[2]
        pose = np.array([*at, math.cos(turn), math.sin(turn), math.log(half)])
        canvases = [coarse(layer) for layer in self._belief_canvas]
        if self._headings:
            canvases += self._heading_canvases(belief)
        return [*canvases, pose]

    def _heading_canvases(self, belief: BeliefView | None) -> list[Array]:
        """Mean cosine and sine of the heading times the mass, scaled like the mass to a maximum of 1."""
        if belief is None:
            return [np.zeros(COARSE**2)] * 2
        cell = np.floor((belief.positions - self._canvas.origin) / (self._canvas.cell_m * CANVAS_CELLS / COARSE))
        column, up = np.clip(cell, 0, COARSE - 1).astype(np.int64).T
        flat = (COARSE - 1 - up) * COARSE + column
        towards = np.stack(
            [np.ones_like(belief.headings_rad), np.cos(belief.headings_rad), np.sin(belief.headings_rad)]
        )
        mass, cos, sin = (np.bincount(flat, belief.p @ t.astype(np.float32), COARSE**2) for t in towards)
        return [cos / mass.max(), sin / mass.max()]


def coarse(layer: Array) -> Array:
    """(256,) means of the 64 x 64 canvas's blocks of 4 x 4."""
    block = CANVAS_CELLS // COARSE
    return layer.reshape(COARSE, block, COARSE, block).mean(axis=(1, 3)).ravel()


SEES: dict[str, Callable[[], Features]] = {
    "profile": Features,
    "canvas": lambda: CanvasFeatures(headings=False),
    "headings": lambda: CanvasFeatures(headings=True),
}
"""What a network can be trained on."""


def mirrored() -> tuple[NDArray[np.int64], Floats]:
    """How the vector of the mirrored world comes from this one: (index, sign), mirror = sign * vector[index]."""
    index, sign = np.arange(SIZE), np.ones(SIZE, np.float32)
    flip = (-np.arange(SECTORS)) % SECTORS
    start = 0
    for block in (SECTORS, SECTORS, SECTORS, 2, SECTORS, *[MOVES] * MEMORY):
        if block == SECTORS:
            index[start : start + block] = start + flip
        elif block == MOVES:
            index[start : start + block] = start + np.array(MIRRORED_MOVES)
        start += block
    sign[start] = -1.0  # turned
    return index, sign
