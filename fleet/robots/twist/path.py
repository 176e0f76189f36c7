"""Pieces of path for robots that can turn on the spot, as `PathBuffer.append` takes them.

A turn on the spot is a piece whose points share one place. Its arc length is not the way of the reference point, which
is zero, but `TURN_M_PER_RAD` for each radian: progress along the path then grows in turns, too, and a stop may lie
before, in or behind a turn.
"""

from __future__ import annotations

import math

import numpy as np

from fleet.arrays import FloatArray
from maps.vehicle import TURN_M_PER_RAD

SPACING_M = 0.02
"""Distance of neighbouring points [m]."""

Piece = tuple[FloatArray, FloatArray]
"""Poses x, y, yaw, shape (k, 3), and arc length from the first of them [m], shape (k,)."""


def straight(pose: FloatArray, length_m: float) -> Piece:
    """Go straight on from a pose x, y, yaw, over a length > 0 [m]."""
    s = _spaced(length_m)
    points = np.empty((len(s), 3))
    points[:, 0] = pose[0] + s * math.cos(pose[2])
    points[:, 1] = pose[1] + s * math.sin(pose[2])
    points[:, 2] = pose[2]
    return points, s


def arc(pose: FloatArray, radius_m: float, angle_rad: float) -> Piece:
    """Drive a part of a circle from a pose x, y, yaw; a positive angle turns left [m, rad]."""
    s = _spaced(radius_m * abs(angle_rad))
    side = math.copysign(1.0, angle_rad)
    yaws = pose[2] + side * s / radius_m
    points = np.empty((len(s), 3))
    points[:, 0] = pose[0] + side * radius_m * (np.sin(yaws) - math.sin(pose[2]))
    points[:, 1] = pose[1] - side * radius_m * (np.cos(yaws) - math.cos(pose[2]))
    points[:, 2] = yaws
    return points, s


def turn(pose: FloatArray, angle_rad: float) -> Piece:
    """Turn on the spot; a positive angle turns left, at most a full turn [rad]."""
    # Yaws of neighbours tell which way round: they are less than half a turn apart.
    shares = np.linspace(0.0, 1.0, max(2, math.ceil(abs(angle_rad)) + 1))
    points = np.tile(np.asarray(pose, dtype=np.float64), (len(shares), 1))
    points[:, 2] += shares * angle_rad
    return points, TURN_M_PER_RAD * abs(angle_rad) * shares


def _spaced(length_m: float) -> FloatArray:
    return np.linspace(0.0, length_m, max(2, math.ceil(length_m / SPACING_M) + 1))
