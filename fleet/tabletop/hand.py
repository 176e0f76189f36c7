"""Hand: where a tool takes hold of a thing, as poses of its tip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fleet.arrays import FloatArray
from planners.motion.arm.kinematics import pointing_down

N_YAWS = 8
"""Turns about the vertical that a cup may stand in."""
CUP_GAP_M = 0.003
"""Distance that a cup comes to a top face with: it takes hold from 10 mm."""
_FINGER_HALF_M = (0.012, 0.012)
"""Half the thickness and half the width of a finger, with a margin."""
_N_GRIP_YAWS = 16
_INTO_M = 0.024
"""The tip goes at most so far below the top of a thing: the hand, which is wide, then stays above its neighbours."""
_FLOOR_M = 0.014
"""The tip stays so far above the table: fingers end 9 mm below it."""
_SPARE_M = 0.004
"""Room between an open finger and the thing."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Grasp:
    """A way to take hold of a thing."""

    tips: FloatArray
    """Poses of the tip that all mean this grasp, world frame, shape (k, 4, 4)."""
    below_m: float
    """Reach of the thing below the tip."""
    half_width_m: float
    """Greatest distance of the thing from the tip's axis."""


def down(yaw: float, point: FloatArray) -> FloatArray:
    """Pose of a tip that looks down at a point (3,), turned about the vertical; shape (4, 4)."""
    pose = pointing_down(yaw)
    pose[:3, 3] = point
    return pose


def cup_grasps(pose: FloatArray, corners: FloatArray) -> list[Grasp]:
    """From above onto the middle of the thing's top.

    Args:
        pose: Centre and orientation of the thing, shape (7,).
        corners: Corners of its box in the world, shape (8, 3).
    """
    top, bottom = float(corners[:, 2].max()), float(corners[:, 2].min())
    point = np.array([pose[0], pose[1], top + CUP_GAP_M])
    tips = np.stack([down(yaw, point) for yaw in np.linspace(-np.pi, np.pi, N_YAWS, endpoint=False)])
    reach = float(np.linalg.norm(corners[:, :2] - pose[:2], axis=1).max())
    return [Grasp(tips=tips, below_m=point[2] - bottom, half_width_m=reach)]


def finger_grasps(corners: FloatArray, others: list[FloatArray], opening_m: float, turn_rad: float) -> list[Grasp]:
    """From above around a thing, in turns in which it fits between the fingers and nothing is in their way.

    The fingers close along the tip's y, turned by `turn_rad` about its axis. A thing is judged by the part of it that
    lies at the fingers' height; of several turns, the narrowest first.

    Args:
        corners: Corners of its mesh in the world, shape (v, 3).
        others: Corners of the other things, each (v, 3).
        opening_m: Distance of the open fingers.
        turn_rad: Angle from the tip's y to the way the fingers open, about its axis.
    """
    top, bottom = float(corners[:, 2].max()), float(corners[:, 2].min())
    tip_z = max(top - _INTO_M, bottom + _FLOOR_M, (top + bottom) / 2 - 0.01 if top - bottom < 2 * _INTO_M else -np.inf)
    found = []
    for yaw in np.linspace(0.0, np.pi, _N_GRIP_YAWS, endpoint=False):
        along, across = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
        middle = np.array([(corners[:, :2] @ a).max() + (corners[:, :2] @ a).min() for a in (along, across)]) / 2
        width = float(np.ptp(corners[:, :2] @ along))
        if width > opening_m - 2 * _SPARE_M:
            continue
        blocked = any(
            _meets(other, np.stack([along, across], axis=1), np.array([at, middle[1]]), tip_z)
            for at in (middle[0] - opening_m / 2 - _FINGER_HALF_M[0], middle[0] + opening_m / 2 + _FINGER_HALF_M[0])
            for other in others
        )
        if not blocked:
            found.append((width, yaw, middle[0] * along + middle[1] * across))
    grasps = []
    for _, yaw, xy in sorted(found, key=lambda item: item[0]):
        point = np.array([*xy, tip_z])
        # The tip's y in the world is (sin, -cos) of its yaw; fingers open either way round.
        tips = np.stack([down(yaw + np.pi / 2 + turn_rad + half, point) for half in (0.0, np.pi)])
        reach = float(np.linalg.norm(corners[:, :2] - xy, axis=1).max())
        grasps.append(Grasp(tips=tips, below_m=tip_z - bottom, half_width_m=reach))
    return grasps


def _meets(corners: FloatArray, axes: FloatArray, finger: FloatArray, tip_z: float) -> bool:
    """Whether the box around a thing, in the finger's directions (2, 2), overlaps a finger at a point (2,) of them."""
    if float(corners[:, 2].max()) < tip_z - _SPARE_M:
        return False
    local, half = corners[:, :2] @ axes - finger, np.array(_FINGER_HALF_M)
    return bool(((local.min(axis=0) < half) & (local.max(axis=0) > -half)).all())
