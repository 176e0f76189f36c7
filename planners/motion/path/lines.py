"""Straight lines of the tool for any arm: by branches where inverse kinematics has them, else by descent."""

from __future__ import annotations

import math

import numpy as np

from planners.motion import checks
from planners.motion.arm.ik import SrsGeometry
from planners.motion.arm.ik_numeric import NumericInverse
from planners.motion.arm.inverse import InverseKinematics
from planners.motion.arrays import FloatArray
from planners.motion.path.cartesian import MAX_JOINT_STEP_RAD, cartesian_line, turned

STEP_M = 0.01
"""Distance of the inverse-kinematics points of a line."""
STEP_RAD = 0.1
"""And their turn."""
_MOST_M = 100.0  # longer than any arm; shorter lines that leave the reach are found out on the way


def tip_pose(inverse: InverseKinematics, q: FloatArray, tool_length_m: float) -> FloatArray:
    """Pose of the tool tip, ahead of the last link on its +z, in the base frame for q (n,); shape (4, 4)."""
    return _tip_of(inverse.flange(q), tool_length_m)


def _tip_of(flange: FloatArray, tool_length_m: float) -> FloatArray:
    """Pose of the tool tip for that of the last link, shape (4, 4)."""
    tip = flange.copy()
    tip[:3, 3] += tool_length_m * tip[:3, 2]
    return tip


def straight_line(
    inverse: InverseKinematics,
    descent: NumericInverse,
    q_start: FloatArray,
    base_from_tip: FloatArray,
    tool_length_m: float,
) -> FloatArray | None:
    """Joint path along which the tool tip moves straight to a pose, turning at a constant rate.

    Args:
        inverse: The arm's solver; one with an arm angle uses it to keep away from joint limits.
        descent: The same arm's solver by descent, for the others.
        q_start: Where the line starts [rad], shape (n,).
        base_from_tip: Tip pose at its end, shape (4, 4).
        tool_length_m: From the last link frame to the tip along its +z [m].

    Returns:
        Configurations [rad], about 1 cm apart, shape (k, n), the first being `q_start`; None if the line leaves the
        reach or the joint limits, or needs a jump.

    Raises:
        PlanningError: No pose, no configuration, or no length.
    """
    checks.vector("straight_line: tool_length_m", [tool_length_m], 1)
    q_start = checks.vector("straight_line: q_start", q_start, len(descent.lower))
    base_from_tip = checks.rigid("straight_line: base_from_tip", base_from_tip)
    flange = inverse.flange(q_start)
    first = _tip_of(flange, tool_length_m)
    way = base_from_tip[:3, 3] - first[:3, 3]
    way_m = math.sqrt(way.dot(way))
    if way_m > _MOST_M:
        return None
    cosine = float(((first[:3, :3].T @ base_from_tip[:3, :3]).trace() - 1.0) / 2.0)
    turn_rad = float(np.arccos(min(max(cosine, -1.0), 1.0)))
    n_steps = max(2, math.ceil(way_m / STEP_M), math.ceil(turn_rad / STEP_RAD))
    if isinstance(inverse, SrsGeometry):
        return cartesian_line(inverse, q_start, base_from_tip, n_steps, tool_length_m=tool_length_m, flange=flange)
    return _by_descent(descent, q_start, first, base_from_tip, n_steps, tool_length_m)


def _by_descent(
    descent: NumericInverse, q_start: FloatArray, first: FloatArray, last: FloatArray, n_steps: int, tool_m: float
) -> FloatArray | None:
    parts = np.arange(1, n_steps + 1) / n_steps
    turns = turned(np.ascontiguousarray(first[:3, :3]), np.ascontiguousarray(last[:3, :3]), parts)
    path = [q_start]
    for part, turn in zip(parts, turns, strict=True):
        pose = np.eye(4)
        pose[:3, :3] = turn
        pose[:3, 3] = first[:3, 3] + part * (last[:3, 3] - first[:3, 3]) - tool_m * pose[:3, 2]
        q = descent.ik_near(pose, path[-1])
        if q is None or np.abs(q - path[-1]).max() > MAX_JOINT_STEP_RAD:
            return None
        path.append(q)
    return np.array(path)
