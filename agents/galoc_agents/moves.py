"""The same moves for both action spaces: a policy thinks in steps and turns."""

from __future__ import annotations

from typing import Any

import numpy as np

from galoc_env.motion import BACKWARD, FORWARD, LEFT, RIGHT, STEP_M, TURN_RAD
from galoc_env.policy import Robot

TURNS_AROUND = 12
"""Turns of 30 degrees in a full circle."""
_CONTINUOUS = {FORWARD: (1, 0, 0), BACKWARD: (-1, 0, 0), LEFT: (0, 0, 1), RIGHT: (0, 0, -1)}

__all__ = ["BACKWARD", "FORWARD", "LEFT", "RIGHT", "STEP_M", "TURNS_AROUND", "TURN_RAD", "as_action", "cut_short"]


def as_action(robot: Robot, move: int) -> Any:
    """The action of the robot's space for ``FORWARD``, ``BACKWARD``, ``LEFT`` or ``RIGHT``."""
    return move if robot.actions == "discrete" else np.array(_CONTINUOUS[move], dtype=np.float32)


def cut_short(observation: dict[str, Any]) -> bool:
    """Whether the last step forward or backward, as odometry has it, ended at an obstacle."""
    return abs(float(observation["odometry"][0])) < STEP_M / 2.0
