"""Rejoin: how a robot that was pushed off its path comes back, by a turn, a straight and a turn."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fleet.arrays import BoolArray, FloatArray
from fleet.robots.angle import wrapped
from fleet.robots.twist.path import Piece, straight, turn

_NEAR_M = 0.01
_ALIKE_RAD = 0.01
_CHECKED_RAD = 0.1
"""Spacing of the yaws at which a turn is checked [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TurnDriveTurn:
    """A manoeuvre of at most three pieces, without those that would be nothing."""

    pieces: tuple[Piece, ...]
    directions: tuple[int, ...]
    """+1 forward, -1 reverse, one for each piece."""


def turn_drive_turn(
    start: FloatArray, goal: FloatArray, valid: Callable[[FloatArray], BoolArray] | None = None
) -> TurnDriveTurn | None:
    """Find the way from one pose to another that turns least: forward or in reverse.

    Args:
        start: x, y, yaw, shape (3,).
        goal: x, y, yaw, shape (3,).
        valid: Says of poses (k, 3) which of them are free, shape (k,); None = all.

    Returns:
        The manoeuvre, or None if neither way is free.
    """
    start, goal = np.asarray(start, dtype=np.float64), np.asarray(goal, dtype=np.float64)
    ways = [_way(start, goal, direction) for direction in (1, -1)]
    ways.sort(key=_turned)
    for way in ways:
        if valid is None or all(bool(valid(_checked(points)).all()) for points, _ in way.pieces):
            return way
    return None


def _way(start: FloatArray, goal: FloatArray, direction: int) -> TurnDriveTurn:
    dx, dy = goal[0] - start[0], goal[1] - start[1]
    length = math.hypot(dx, dy)
    if length < _NEAR_M:
        angle = wrapped(goal[2] - start[2])
        only = (turn(start, angle),) if abs(angle) > _ALIKE_RAD else ()
        return TurnDriveTurn(pieces=only, directions=(1,) * len(only))
    ahead = math.atan2(direction * dy, direction * dx)
    pieces: list[Piece] = []
    directions: list[int] = []
    first, last = wrapped(ahead - start[2]), wrapped(goal[2] - ahead)
    pose = start.copy()
    if abs(first) > _ALIKE_RAD:
        pieces.append(turn(pose, first))
        directions.append(1)
    pose[2] = ahead
    points, s = straight(pose, length)
    if direction < 0:
        points[:, :2] = 2.0 * pose[:2] - points[:, :2]
    pieces.append((points, s))
    directions.append(direction)
    if abs(last) > _ALIKE_RAD:
        pieces.append(turn(points[-1], last))
        directions.append(1)
    return TurnDriveTurn(pieces=tuple(pieces), directions=tuple(directions))


def _turned(way: TurnDriveTurn) -> float:
    """How much a manoeuvre turns on the spot [rad]."""
    return sum(abs(float(points[-1, 2] - points[0, 2])) for points, _ in way.pieces)


def _checked(points: FloatArray) -> FloatArray:
    """Poses of a piece at which it is checked: a turn has but two points."""
    angle = abs(float(points[-1, 2] - points[0, 2]))
    if angle == 0.0:
        return points
    n = max(2, math.ceil(angle / _CHECKED_RAD) + 1)
    return np.linspace(points[0], points[-1], n)
