"""Frames: quaternions (x, y, z, w) as rotation matrices and headings."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def rotation(quat_xyzw: FloatArray) -> FloatArray:
    """Turn unit quaternions into matrices.

    Args:
        quat_xyzw: Shape (..., 4).

    Returns:
        Rotation matrices, shape (..., 3, 3).
    """
    quat = np.asarray(quat_xyzw, dtype=np.float64)
    x, y, z, w = quat[..., 0], quat[..., 1], quat[..., 2], quat[..., 3]
    turn = np.empty((*quat.shape[:-1], 3, 3))
    turn[..., 0, 0] = 1 - 2 * (y * y + z * z)
    turn[..., 0, 1] = 2 * (x * y - z * w)
    turn[..., 0, 2] = 2 * (x * z + y * w)
    turn[..., 1, 0] = 2 * (x * y + z * w)
    turn[..., 1, 1] = 1 - 2 * (x * x + z * z)
    turn[..., 1, 2] = 2 * (y * z - x * w)
    turn[..., 2, 0] = 2 * (x * z - y * w)
    turn[..., 2, 1] = 2 * (y * z + x * w)
    turn[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return turn


def quaternion(yaw: float) -> tuple[float, float, float, float]:
    """Turn a heading [rad] into a quaternion x, y, z, w."""
    return 0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2))
