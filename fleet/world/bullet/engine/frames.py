"""Frames: quaternions (x, y, z, w) as rotation matrices and headings."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit

from fleet.arrays import FloatArray
from fleet.robots.angle import rotation_into


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


def turned(yaw: float, quat_xyzw: Sequence[float]) -> tuple[float, float, float, float]:
    """Turn an orientation by a heading [rad] about the world's z; exact to the last bits, which the engine's is not."""
    c, s = math.cos(yaw / 2), math.sin(yaw / 2)
    x, y, z, w = quat_xyzw
    return c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z


def quaternion(yaw: float) -> tuple[float, float, float, float]:
    """Turn a heading [rad] into a quaternion x, y, z, w."""
    return 0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2))
