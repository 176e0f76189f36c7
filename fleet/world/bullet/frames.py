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
    x, y, z, w = np.moveaxis(np.asarray(quat_xyzw, dtype=np.float64), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def quaternion(yaw: float) -> tuple[float, float, float, float]:
    """Turn a heading [rad] into a quaternion x, y, z, w."""
    return 0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2))
