"""Frames: quaternions (x, y, z, w) of headings."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np


def turned(yaw: float, quat_xyzw: Sequence[float]) -> tuple[float, float, float, float]:
    """Turn an orientation by a heading [rad] about the world's z; exact to the last bits, which the engine's is not."""
    c, s = math.cos(yaw / 2), math.sin(yaw / 2)
    x, y, z, w = quat_xyzw
    return c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z


def quaternion(yaw: float) -> tuple[float, float, float, float]:
    """Turn a heading [rad] into a quaternion x, y, z, w."""
    return 0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2))
