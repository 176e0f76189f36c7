"""Reach: postures in which an arm's tool points down near a point."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from fleet.arrays import FloatArray
from fleet.envs.warehouse.control.hands import (
    TIP_MPS,
    TIP_RADPS,
    HandModel,
    Hands,
    is_ahead,
    lead_tips,
    turning_joints,
)
from fleet.envs.warehouse.rows import around
from planners.motion.arm.kinematics import link_frames_into

_STEP_S, _STEPS, _GAIN_PER_S = 0.05, 300, 4.0


def reach_down(hands: Hands, point: FloatArray) -> FloatArray:
    """A posture in which the tip is at a point, or as near as the tip is led there from home.

    Args:
        hands: Arms of the model.
        point: In the arm's base frame [m], shape (3,).

    Returns:
        Joint positions [rad], shape (n_joints,).
    """
    arm = hands.spec
    q = arm.home_rad.copy()
    turning = turning_joints(arm) if is_ahead(arm) else np.zeros(0)
    _lead(hands.model, arm.lower_rad, arm.upper_rad, turning, np.asarray(point, dtype=np.float64), q)
    return q


@njit(cache=True)
def _lead(
    hand: HandModel, lower: FloatArray, upper: FloatArray, turning: FloatArray, point: FloatArray, q: FloatArray
) -> None:  # pragma: no cover - compiled
    """Lead the tip up and around to over a point, and then down to it; changes `q`. With `turning` joints it goes
    around by the front."""
    frames, wish, qd = np.empty((len(q) + 1, 3, 4)), np.zeros((1, 4)), np.empty((1, len(q)))
    for _ in range(_STEPS):
        link_frames_into(hand.joints, q, frames)
        flange = frames[len(q)]
        x, y = flange[0, 3] + hand.tool_length_m * flange[0, 2], flange[1, 3] + hand.tool_length_m * flange[1, 2]
        out = math.hypot(point[0], point[1]) - math.hypot(x, y)
        turn = math.atan2(point[1] * x - point[0] * y, point[0] * x + point[1] * y)
        if len(turning):
            turn = around(point[0], point[1], 0.0, True) - around(x, y, float(np.dot(turning, q)), True)
        up = point[2] - flange[2, 3] - hand.tool_length_m * flange[2, 2]
        wish[0, 0] = min(max(_GAIN_PER_S * out / TIP_MPS, -1.0), 1.0)
        wish[0, 1] = min(max(_GAIN_PER_S * turn / TIP_RADPS, -1.0), 1.0)
        wish[0, 2] = min(max(_GAIN_PER_S * up / TIP_MPS, -1.0), 1.0)
        lead_tips(hand, q.reshape(1, -1), wish, qd)
        for j in range(len(q)):
            q[j] = min(max(q[j] + _STEP_S * qd[0, j], lower[j]), upper[j])
