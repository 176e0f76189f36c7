"""Angles within a turn, and rotations of quaternions (x, y, z, w)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from fleet.arrays import FloatArray


@njit(cache=True)
def wrapped(angle: float) -> float:
    """The same direction in [-pi, pi)."""
    turned = angle + math.pi
    # Most angles are within the range already: then the remainder, which is slow, would give the same number.
    if 0.0 <= turned < 2.0 * math.pi:
        return turned - math.pi
    return turned % (2.0 * math.pi) - math.pi


def wrapped_all(angles: FloatArray) -> FloatArray:
    """The same of many angles, any shape; without a kernel, as it is one line of numpy."""
    return (angles + math.pi) % math.tau - math.pi


@njit(cache=True)
def yaw_of(pose: FloatArray) -> float:
    """Direction of a body's own x axis, seen from above [rad].

    Args:
        pose: x, y, z [m] and a unit quaternion x, y, z, w, shape (7,).
    """
    qx, qy, qz, qw = pose[3], pose[4], pose[5], pose[6]
    return math.atan2(2.0 * (qx * qy + qw * qz), 1.0 - 2.0 * (qy * qy + qz * qz))


@njit(cache=True)
def rotation_into(quat: FloatArray, turn: FloatArray) -> None:
    """Fill in the matrix of a unit quaternion x, y, z, w, shape (3, 3)."""
    x, y, z, w = quat[0], quat[1], quat[2], quat[3]
    turn[0, 0] = 1 - 2 * (y * y + z * z)
    turn[0, 1] = 2 * (x * y - z * w)
    turn[0, 2] = 2 * (x * z + y * w)
    turn[1, 0] = 2 * (x * y + z * w)
    turn[1, 1] = 1 - 2 * (x * x + z * z)
    turn[1, 2] = 2 * (y * z - x * w)
    turn[2, 0] = 2 * (x * z - y * w)
    turn[2, 1] = 2 * (y * z + x * w)
    turn[2, 2] = 1 - 2 * (x * x + y * y)


def rotation(quat_xyzw: FloatArray) -> FloatArray:
    """Turn unit quaternions into matrices.

    Args:
        quat_xyzw: Shape (..., 4).

    Returns:
        Rotation matrices, shape (..., 3, 3).
    """
    quat = np.ascontiguousarray(quat_xyzw, dtype=np.float64)
    turn = np.empty((*quat.shape[:-1], 3, 3))
    _rotations(quat.reshape(-1, 4), turn.reshape(-1, 3, 3))
    return turn


@njit(cache=True)
def _rotations(quats: FloatArray, turns: FloatArray) -> None:
    for k in range(len(quats)):
        rotation_into(quats[k], turns[k])
