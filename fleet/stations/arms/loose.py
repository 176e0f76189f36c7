"""Loose parcels: the ways to grip one that lies anywhere, on any of its faces."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fleet.arrays import FloatArray
from fleet.errors import FleetError
from fleet.robots.tools import Tool

MAX_TILT_RAD = math.radians(30.0)
"""A parcel whose uppermost face is steeper than this leans against something, and is not gripped."""
N_YAWS = 16
"""Turns about its axis that are tried for a cup."""
FINGER_PLAY_M = 0.01
"""Room that open fingers need beyond the width of what they grip, both sides together [m]."""


class UngrippableError(FleetError):
    """A parcel cannot be gripped as it lies."""


@dataclass(frozen=True, kw_only=True)
class LooseGrips:
    """All grips of one parcel; any will do."""

    tips: FloatArray
    """Tool tip poses in the frame of the parcel's pose, shape (k, 4, 4), k >= 1."""
    height_m: float
    """The tip's height over the parcel's lower face [m]."""
    size_m: tuple[float, float, float]
    """The parcel's edges as the tool sees them, the one along its axis last [m]."""


def loose_grips(
    pose: FloatArray, size_m: tuple[float, float, float], tool: Tool, gap_m: float, least_height_m: float
) -> LooseGrips:
    """Find the grips of a parcel square to its uppermost face.

    Args:
        pose: Pose of its centre, a 4x4 matrix.
        size_m: Its edges [m].
        tool: Cup or fingers.
        gap_m: A cup stops this far off the face [m].
        least_height_m: Fingers close at least this far above its lower face [m].

    Raises:
        UngrippableError: It leans, is too wide for the fingers, or is nowhere or of no size.
    """
    if not np.isfinite(pose).all() or not all(0 < edge < math.inf for edge in size_m):
        raise UngrippableError(f"the parcel has edges {size_m} and pose {pose.tolist()}; valid: finite, edges > 0")
    rotation, half = pose[:3, :3], np.asarray(size_m) / 2
    up = int(np.abs(rotation[2]).argmax())
    normal = rotation[:, up] * np.sign(rotation[2, up])
    tilt = math.acos(min(1.0, float(normal[2])))
    if tilt > MAX_TILT_RAD:
        raise UngrippableError(
            f"the parcel leans by {math.degrees(tilt):.0f} deg; valid: at most {math.degrees(MAX_TILT_RAD):.0f}"
        )
    sides = [k for k in range(3) if k != up]
    if tool.finger_joints:
        height = max(half[up], least_height_m)
        # The narrower pair of sides first; each can be taken with either finger.
        across = sorted(
            (k for k in sides if size_m[k] + FINGER_PLAY_M <= 2 * tool.finger_travel_m), key=lambda k: size_m[k]
        )
        axes = [sign * rotation[:, k] for k in across for sign in (1.0, -1.0)]
    else:
        height = 2 * half[up] + gap_m
        a, b = (rotation[:, k] for k in sides)
        yaws = np.linspace(-np.pi, np.pi, N_YAWS, endpoint=False)
        axes = [math.cos(yaw) * a + math.sin(yaw) * b for yaw in yaws]
    if not axes:
        narrow, widest = min(size_m[k] for k in sides), 2 * tool.finger_travel_m - FINGER_PLAY_M
        raise UngrippableError(f"the parcel lies {narrow:.3f} m wide; valid: at most {widest:.3f}, for the fingers")
    tips = np.tile(np.eye(4), (len(axes), 1, 1))
    tips[:, :3, 0] = axes
    tips[:, :3, 2] = -normal
    tips[:, :3, 1] = np.cross(tips[:, :3, 2], tips[:, :3, 0])
    tips[:, :3, 3] = pose[:3, 3] + normal * (height - half[up])
    lying = (size_m[sides[0]], size_m[sides[1]], size_m[up])
    return LooseGrips(tips=tips, height_m=float(height), size_m=lying)
