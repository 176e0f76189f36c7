"""Hands: velocities of an arm's tip become velocities of its joints."""

from __future__ import annotations

import numpy as np
from numba import njit

from fleet.arrays import FloatArray
from fleet.robots.spec import ArmSpec
from planners.motion.arm.kinematics import jacobian_into, link_frames_into

N_TIP = 6
"""Entries of a tip's motion: along and about x, y, z."""
TIP_MPS, TIP_RADPS = 0.5, 1.0
"""Velocity of the tip, and its turn, at full action."""
WIND_UP_RAD = 0.1
"""A joint's target runs at most this far ahead of the joint, so that a blocked arm does not wind up [rad]."""
_DAMPING = 0.05
"""Keeps joints calm near singular postures, at the price of a lag there."""


def joint_velocities(arm: ArmSpec, q: FloatArray, twists: FloatArray) -> FloatArray:
    """Joint velocities that move the tips, slowed down as a whole where a joint would be too fast.

    Args:
        arm: The model.
        q: Joint positions [rad], shape (m, n_joints).
        twists: Shares of `TIP_MPS` along, and of `TIP_RADPS` about, the axes of the arms' frames, shape (m, 6).

    Returns:
        Joint velocities [rad/s], shape (m, n_joints).

    Source: damped least squares, Y. Nakamura and H. Hanafusa, "Inverse kinematic solutions with singularity
    robustness for robot manipulator control", ASME J. Dynamic Systems, Measurement, and Control 108(3), 1986.
    """
    out = np.empty_like(q)
    wanted = twists * np.array([TIP_MPS] * 3 + [TIP_RADPS] * 3)
    _solve(arm.joints, arm.tool_length_m, q, wanted, arm.max_velocity_radps, out)
    return out


@njit(cache=True)
def _solve(
    joints: FloatArray,
    tool_length: float,
    q: FloatArray,
    wanted: FloatArray,
    max_velocity: FloatArray,
    out: FloatArray,
) -> None:  # pragma: no cover - compiled
    """Fill in joint velocities; `wanted` is the tips' motion [m/s, rad/s], shape (m, 6)."""
    n = q.shape[1]
    frames, jacobian = np.empty((n + 1, 3, 4)), np.empty((6, n))
    for arm in range(len(q)):
        link_frames_into(joints, q[arm], frames)
        jacobian_into(frames, jacobian)
        # From the flange to the tip: v_tip = v_flange + w x (tool_length * z).
        x, y, z = tool_length * frames[n, 0, 2], tool_length * frames[n, 1, 2], tool_length * frames[n, 2, 2]
        for j in range(n):
            wx, wy, wz = jacobian[3, j], jacobian[4, j], jacobian[5, j]
            jacobian[0, j] += wy * z - wz * y
            jacobian[1, j] += wz * x - wx * z
            jacobian[2, j] += wx * y - wy * x
        square = jacobian @ jacobian.T
        for k in range(6):
            square[k, k] += _DAMPING * _DAMPING
        qd = jacobian.T @ np.linalg.solve(square, wanted[arm])
        over = np.abs(qd / max_velocity).max()
        out[arm] = qd / over if over > 1.0 else qd


@njit(cache=True)
def shares_of(limits: FloatArray, shares: FloatArray, out: FloatArray) -> None:  # pragma: no cover - compiled
    """Fill in shares of limits, row by row."""
    for k in range(len(out)):
        for j in range(out.shape[1]):
            out[k, j] = shares[k, j] * limits[j]


@njit(cache=True)
def move_targets(
    targets: FloatArray, qd: FloatArray, q: FloatArray, lower: FloatArray, upper: FloatArray, tick: float
) -> None:  # pragma: no cover - compiled
    """Move joints' targets on by their velocities for one tick; a target that is held up has no velocity."""
    for arm in range(len(q)):
        for j in range(q.shape[1]):
            wanted = targets[arm, j] + qd[arm, j] * tick
            wanted = min(max(wanted, q[arm, j] - WIND_UP_RAD), q[arm, j] + WIND_UP_RAD)
            targets[arm, j] = min(max(wanted, lower[j]), upper[j])
            if targets[arm, j] != wanted:
                qd[arm, j] = 0.0
