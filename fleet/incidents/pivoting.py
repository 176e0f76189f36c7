"""Pivoting: how a car that turns on the spot comes back to its lane: a turn, a straight, a turn."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from fleet.arrays import BoolArray, FloatArray
from fleet.robots.twist.rejoin import turn_drive_turn
from planners.motion.car.reeds_shepp import RejoinResult
from planners.motion.status import MotionStatus

_STEP_RAD = 0.1


def pivot_back(start: FloatArray, goal: FloatArray, valid: Callable[[FloatArray], BoolArray]) -> RejoinResult | None:
    """Find the way from one pose to another that turns least, forward or in reverse.

    Args:
        start: x, y, yaw, shape (3,).
        goal: x, y, yaw, shape (3,).
        valid: Says of poses (k, 3) which of them are free, shape (k,).

    Returns:
        The manoeuvre, whose turns are poses at one place, at most 0.1 rad apart; None if neither way is free.
    """
    way = turn_drive_turn(start, goal, valid)
    if way is None:
        return None
    poses, directions = [start[None]], []
    for (points, _), direction in zip(way.pieces, way.directions, strict=True):
        angle = abs(float(points[-1, 2] - points[0, 2]))
        turned = np.linspace(points[0], points[-1], math.ceil(angle / _STEP_RAD) + 1) if angle > 0.0 else points
        poses.append(turned[1:])
        directions += [direction] * (len(turned) - 1)
    travel = np.array([*directions, *directions[-1:]] or [1], dtype=np.int8)
    return RejoinResult(poses=np.concatenate(poses), directions=travel, status=MotionStatus.SOLVED, iterations=0)
