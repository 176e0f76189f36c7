"""Hands: velocities of an arm's tip become velocities of its joints, with the tool kept pointing down."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from fleet.arrays import FloatArray, IntArray
from fleet.config import require
from fleet.envs.warehouse.rows import N_JOINTS
from fleet.robots.arms.spec import ArmSpec
from fleet.robots.arms.team import ArmTeam
from fleet.world.scene import Scene
from planners.motion.arm.kinematics import jacobian_into, link_frames_into

N_TIP = 4
"""Entries of a tip's motion: outwards, around the base, up, and turn about the vertical."""
TIP_MPS, TIP_RADPS = 0.5, 1.0
"""Velocity of the tip outwards and up, and its turns around the base and about itself, at full action."""
WIND_UP_RAD, WIND_UP_TICKS = 0.1, 1.15
"""A joint's target runs at most this far ahead of the joint, so that a blocked arm does not wind up [rad], or as far as
the arm's first joint turns at full speed in so many ticks, whatever is more."""
LEAST_RADIUS_M = 0.25
"""Nearer to the base's axis than this the tip is not led: the arm would have to fold [m]."""
_DAMPING = 0.05
"""Keeps joints calm near singular postures, at the price of a lag there."""
_UPRIGHT_PER_S = 4.0
"""A tool that leans is brought back by this share of its lean per second."""
_CENTRE_PER_S = 0.5
"""Joints drift to the middles of their ranges by this share per second, as far as the tip does not notice."""


class HandModel(NamedTuple):
    """What the motion of a tip is worked out from."""

    joints: FloatArray
    """The arm's joints as `link_frames_into` takes them."""
    tool_length_m: float
    max_velocity: FloatArray
    """Of the joints [rad/s], shape (n_joints,)."""
    middle: FloatArray
    """Of the joints' ranges [rad], shape (n_joints,)."""
    half: FloatArray
    """Half of the joints' ranges [rad], shape (n_joints,)."""


def agents_arm(scene: Scene) -> ArmSpec:
    """The model of the arms that agents move, which observations and actions have the form of.

    Raises:
        ConfigError: Arms differ, or do not turn as far one way as the other in `N_JOINTS` joints.
    """
    arm = scene.arms.only("arms of agents")
    fits = arm.n_joints == N_JOINTS and bool(np.allclose(arm.lower_rad, -arm.upper_rad))
    require(fits, "arms of agents", arm.name, f"arms of {N_JOINTS} joints with limits that are the same either way")
    return arm


def hand_model(arm: ArmSpec) -> HandModel:
    """The model of an arm's hand."""
    return HandModel(
        joints=arm.joints,
        tool_length_m=arm.tool_length_m,
        max_velocity=arm.max_velocity_radps,
        middle=0.5 * (arm.lower_rad + arm.upper_rad),
        half=0.5 * (arm.upper_rad - arm.lower_rad),
    )


class Hands(NamedTuple):
    """The arms of one model among those that agents move."""

    arms: IntArray
    """Which they are, shape (k,)."""
    spec: ArmSpec
    model: HandModel


def hands_of(team: ArmTeam, n_arms: int) -> tuple[Hands, ...]:
    """The first arms of a team, by model."""
    names = np.array([spec.name for spec in team.specs[:n_arms]])
    return tuple(
        Hands(arms=np.flatnonzero(names == spec.name), spec=spec, model=hand_model(spec))
        for spec in team.part(range(n_arms)).models
    )


def turning_joints(spec: ArmSpec) -> FloatArray:
    """1 for joints that turn an arm about its base as long as it is upright, else 0, shape (n_joints,).

    That is the first one; of an arm of seven joints also the third, which goes about the axis of the upper arm.
    """
    turning = np.zeros(spec.n_joints)
    turning[[0, 2] if spec.n_joints > 6 else [0]] = 1.0
    return turning


def is_ahead(spec: ArmSpec) -> bool:
    """Whether an arm faces ahead where its `turning_joints` are zero: it rests behind its base."""
    return abs(float(turning_joints(spec) @ spec.home_rad)) > 0.5 * math.pi


@njit(cache=True)
def lead_tips(hand: HandModel, q: FloatArray, wishes: FloatArray, out: FloatArray) -> None:  # pragma: no cover
    """Fill in joint velocities that move the tips, slowed down as a whole where a joint would be too fast.

    Args:
        hand: The model.
        q: Joint positions [rad], shape (m, n_joints).
        wishes: Shares of `TIP_MPS` outwards from the base's axis, of `TIP_RADPS` around it, of `TIP_MPS` up and of
            `TIP_RADPS` about the vertical through the tip, shape (m, 4).
        out: Joint velocities [rad/s], shape (m, n_joints).

    Source: damped least squares with a secondary task in the null space, A. Liegeois, "Automatic supervisory control
    of the configuration and behavior of multibody mechanisms", IEEE Trans. SMC 7(12), 1977; Y. Nakamura and
    H. Hanafusa, "Inverse kinematic solutions with singularity robustness for robot manipulator control", ASME J.
    Dynamic Systems, Measurement, and Control 108(3), 1986.
    """
    n = q.shape[1]
    frames, jacobian, twist = np.empty((n + 1, 3, 4)), np.empty((6, n)), np.empty(6)
    for arm in range(len(q)):
        link_frames_into(hand.joints, q[arm], frames)
        jacobian_into(frames, jacobian)
        _at_tip(jacobian, frames[n], hand.tool_length_m)
        _twist(frames[n], hand.tool_length_m, wishes[arm], twist)
        square = jacobian @ jacobian.T
        for k in range(6):
            square[k, k] += _DAMPING * _DAMPING
        centring = np.empty(n)
        for j in range(n):
            centring[j] = -_CENTRE_PER_S * (q[arm, j] - hand.middle[j]) / hand.half[j]
        qd = centring + jacobian.T @ np.linalg.solve(square, twist - jacobian @ centring)
        over = np.abs(qd / hand.max_velocity).max()
        out[arm] = qd / over if over > 1.0 else qd


@njit(cache=True)
def _at_tip(jacobian: FloatArray, flange: FloatArray, length: float) -> None:  # pragma: no cover - compiled
    """Make the flange's Jacobian the tip's: v_tip = v_flange + w x (length * z)."""
    x, y, z = length * flange[0, 2], length * flange[1, 2], length * flange[2, 2]
    for j in range(jacobian.shape[1]):
        wx, wy, wz = jacobian[3, j], jacobian[4, j], jacobian[5, j]
        jacobian[0, j] += wy * z - wz * y
        jacobian[1, j] += wz * x - wx * z
        jacobian[2, j] += wx * y - wy * x


@njit(cache=True)
def _twist(flange: FloatArray, length: float, wish: FloatArray, twist: FloatArray) -> None:  # pragma: no cover
    """Fill in the tip's motion [m/s, rad/s] that a wish stands for, with what keeps the tool upright."""
    x, y = flange[0, 3] + length * flange[0, 2], flange[1, 3] + length * flange[1, 2]
    radius = math.hypot(x, y)
    cos, sin = (x / radius, y / radius) if radius > 1e-6 else (1.0, 0.0)
    out, around = wish[0] * TIP_MPS, wish[1] * TIP_RADPS
    if radius < LEAST_RADIUS_M:
        out = max(out, 0.0)
    twist[0] = out * cos - around * radius * sin
    twist[1] = out * sin + around * radius * cos
    twist[2] = wish[2] * TIP_MPS
    # The axis about which the tool leans: its own z axis times straight down, (0, 0, -1).
    twist[3] = -_UPRIGHT_PER_S * flange[1, 2]
    twist[4] = _UPRIGHT_PER_S * flange[0, 2]
    # A tool that goes round the base goes on looking the same way from there.
    twist[5] = around + wish[3] * TIP_RADPS


@njit(cache=True)
def move_targets(
    targets: FloatArray,
    qd: FloatArray,
    q: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    max_velocity: FloatArray,
    tick: float,
) -> None:  # pragma: no cover - compiled
    """Move joints' targets on by their velocities for one tick; a target that is held up has no velocity.

    All arrays but the tick are of shape (m, n_joints).
    """
    for arm in range(len(q)):
        ahead = max(WIND_UP_RAD, WIND_UP_TICKS * max_velocity[arm, 0] * tick)
        for j in range(q.shape[1]):
            wanted = targets[arm, j] + qd[arm, j] * tick
            wanted = min(max(wanted, q[arm, j] - ahead), q[arm, j] + ahead)
            targets[arm, j] = min(max(wanted, lower[arm, j]), upper[arm, j])
            if targets[arm, j] != wanted:
                qd[arm, j] = 0.0
