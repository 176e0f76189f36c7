"""Straight lines of the tool, followed in one inverse-kinematics branch with a slowly varying arm angle."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planners.motion import checks
from planners.motion.arm.ik import SrsGeometry, branch_into, wrist_target_into
from planners.motion.arrays import FloatArray, IntArray
from planners.motion.kernel import kernel

MAX_JOINT_STEP_RAD = 0.25
"""Largest change of any joint between way points, unless told otherwise."""
_N_ARM_ANGLES = 72  # grid of 5 deg around the start's arm angle
_MOST_STEPS = 100_000
_MAX_TURN = 2  # grid steps the arm angle may change per way point


class _Arm(NamedTuple):
    """The arm as the kernel sees it."""

    packed: FloatArray
    """`SrsGeometry.packed`."""
    lower: FloatArray
    upper: FloatArray


class _Chains(NamedTuple):
    """Of m+1 way points x a arm angles: the cheapest chain of solutions that leads there."""

    cost: FloatArray
    """Shape (m+1, a)."""
    origin: IntArray
    """Arm angle of the way point before, shape (m+1, a)."""
    solution: FloatArray
    """Shape (m+1, a, 7)."""


@kernel
def _follow(
    arm: _Arm,
    poses: FloatArray,
    start_angle: float,
    branch: int,
    max_step: float,
    chains: _Chains,
    path: FloatArray,
) -> bool:
    """Fill in the chains and, behind its start, the path (m+1, 7); False if no chain reaches the last way point."""
    packed, lower, upper = arm.packed, arm.lower, arm.upper
    cost, origin, solution = chains.cost, chains.origin, chains.solution
    m, n_angles = poses.shape[0], cost.shape[1]
    cost[:] = np.inf
    origin[:] = 0
    cost[0, 0] = 0.0
    solution[0, 0] = path[0]
    target = np.empty((3, 4))
    q = np.empty(7)
    for p in range(1, m + 1):
        wrist_target_into(poses[p - 1], packed, target)
        found = False
        for a in range(n_angles):
            solved = False
            for turn in range(-_MAX_TURN, _MAX_TURN + 1):
                before = (a - turn) % n_angles
                if cost[p - 1, before] == np.inf:
                    continue
                if not solved:
                    if not branch_into(target, start_angle + 2.0 * np.pi * a / n_angles, branch, packed, q):
                        return False
                    solved = True
                step = 0.0
                square = 0.0
                inside = True
                for k in range(7):
                    change = q[k] - solution[p - 1, before, k]
                    step = max(step, abs(change))
                    square += change * change
                    inside = inside and lower[k] <= q[k] <= upper[k]
                if not inside or step > max_step:
                    continue
                if cost[p - 1, before] + square < cost[p, a]:
                    cost[p, a] = cost[p - 1, before] + square
                    origin[p, a] = before
                    for k in range(7):
                        solution[p, a, k] = q[k]
                    found = True
        if not found:
            return False
    column = int(np.argmin(cost[m]))
    for p in range(m, -1, -1):
        path[p] = solution[p, column]
        column = origin[p, column]
    return True


@kernel
def turned(first: FloatArray, last: FloatArray, parts: FloatArray) -> FloatArray:
    """Orientations on the way from one to another at a constant rate.

    Args:
        first: Orientation at part 0, shape (3, 3).
        last: Orientation at part 1, shape (3, 3).
        parts: Parts of the way, shape (k,).

    Returns:
        Orientations, shape (k, 3, 3).

    Source: Shepperd, Quaternion from rotation matrix, Journal of Guidance and Control 1978 (its largest component
        first, so that half a turn is no special case), and Rodrigues' formula.
    """
    relative = first.T @ last
    four = np.empty(4)  # squares of twice the quaternion's components, w last
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        four[i] = 1.0 + relative[i, i] - relative[j, j] - relative[k, k]
    four[3] = 1.0 + relative[0, 0] + relative[1, 1] + relative[2, 2]
    largest = int(np.argmax(four))
    quat = np.empty(4)
    quat[largest] = four[largest]
    if largest == 3:
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            quat[i] = relative[k, j] - relative[j, k]
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        quat[3] = relative[k, j] - relative[j, k]
        quat[j] = relative[i, j] + relative[j, i]
        quat[k] = relative[i, k] + relative[k, i]
    sine = np.sqrt(quat[0] ** 2 + quat[1] ** 2 + quat[2] ** 2)
    angle = 2.0 * np.arctan2(sine, abs(quat[3]))
    axis = quat[:3] * ((1.0 if quat[3] >= 0.0 else -1.0) / sine) if sine > 0.0 else np.zeros(3)
    out = np.empty((parts.shape[0], 3, 3))
    turn = np.empty((3, 3))
    for p in range(parts.shape[0]):
        c, s = np.cos(parts[p] * angle), np.sin(parts[p] * angle)
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            turn[i, i] = c + (1.0 - c) * axis[i] * axis[i]
            turn[i, j] = (1.0 - c) * axis[i] * axis[j] - s * axis[k]
            turn[j, i] = (1.0 - c) * axis[i] * axis[j] + s * axis[k]
        out[p] = first @ turn
    return out


def cartesian_line(
    srs: SrsGeometry,
    q_start: npt.ArrayLike,
    base_from_goal: npt.ArrayLike,
    n_steps: int,
    *,
    tool_length_m: float = 0.0,
    max_joint_step_rad: float = MAX_JOINT_STEP_RAD,
    flange: FloatArray | None = None,
) -> FloatArray | None:
    """Joint path along which the tool tip moves on a straight line, turning at a constant rate.

    The branch stays that of the start; the arm angle may drift by up to 10 deg per step, where this avoids joint
    limits or shortens the joint motion (dynamic programming over a grid of arm angles).

    Args:
        srs: The arm.
        q_start: Configuration at the start of the line [rad], shape (7,).
        base_from_goal: Tip pose at the end of the line, shape (4, 4).
        n_steps: Number of way points after the start, >= 1.
        tool_length_m: From the last link frame to the tip along +z [m]; 0 moves the last link frame itself.
        max_joint_step_rad: Largest change of any joint between way points [rad].
        flange: Pose of the last link at the start, shape (4, 4), where it is known.

    Returns:
        Configurations [rad], shape (n_steps + 1, 7), the first being `q_start`; None if the line leaves the reach or
        the joint limits, or needs a jump.

    Raises:
        PlanningError: Malformed input.
    """
    start = checks.vector("cartesian_line: q_start", q_start, len(srs.lower))
    goal = checks.rigid("cartesian_line: base_from_goal", base_from_goal)
    checks.whole("cartesian_line: n_steps", n_steps, 1, _MOST_STEPS)
    step_rad = checks.positive("cartesian_line: max_joint_step_rad", max_joint_step_rad)
    if not srs.within_limits(start):
        return None
    fraction = np.arange(1, n_steps + 1) / n_steps
    first = srs.flange(start) if flange is None else flange
    tip = first[:3, 3] + tool_length_m * first[:3, 2]
    poses = np.zeros((n_steps, 3, 4))
    poses[:, :, :3] = turned(np.ascontiguousarray(first[:3, :3]), np.ascontiguousarray(goal[:3, :3]), fraction)
    poses[:, :, 3] = tip + fraction[:, None] * (goal[:3, 3] - tip) - tool_length_m * poses[:, :, 2]
    angle, branch = srs.arm_angle_and_branch(start)
    n_rows = n_steps + 1
    chains = _Chains(
        cost=np.empty((n_rows, _N_ARM_ANGLES)),
        origin=np.empty((n_rows, _N_ARM_ANGLES), dtype=np.int64),
        solution=np.empty((n_rows, _N_ARM_ANGLES, len(start))),
    )
    path = np.empty((n_rows, len(start)))
    path[0] = start
    arm = _Arm(packed=srs.packed, lower=srs.lower, upper=srs.upper)
    return path if _follow(arm, poses, angle, branch, step_rad, chains, path) else None
