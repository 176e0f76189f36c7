"""TwistSpec: what the house needs to know about a robot that drives by a speed and a yaw rate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from fleet.robots.spec import Visual
from fleet.robots.twist.skid_steer import SkidSteer
from fleet.robots.twist.trot import TrotConfig

TwistDrive = Literal["differential", "legged"]


@dataclass(frozen=True, kw_only=True)
class TwistLimits:
    """What a robot may be told.

    Speed and yaw rate share what the outer wheels or feet can do: `|v| + lever_m |w| <= max_rim_mps`.
    """

    max_speed_mps: float
    max_yaw_rate_radps: float
    max_accel_mps2: float
    max_brake_mps2: float
    max_yaw_accel_radps2: float
    max_rim_mps: float
    """Greatest speed of a wheel's rim, or of a foot on the floor [m/s]."""
    lever_m: float
    """What a yaw rate of 1 rad/s adds to the rim speed of the outer wheels, or of the farthest foot [m]."""
    max_lateral_mps2: float
    """Greatest sideways acceleration in curves: wheels and feet slip beyond it."""


@dataclass(frozen=True, kw_only=True)
class TwistResponse:
    """How a robot answers its commands; the kinematic model's parameters, fitted by ``python -m fleet robots fit``."""

    speed_gain: float
    """Speed for a command of 1 m/s, when it has settled."""
    speed_lag_s: float
    """Time in which the speed comes to within 37 % of its command, as long as no limit holds it back [s]."""
    yaw_gain: float
    """Yaw rate for a command of 1 rad/s, when it has settled."""
    yaw_lag_s: float
    """The same as `speed_lag_s`, of the yaw rate [s]."""


@dataclass(frozen=True, kw_only=True)
class SkidChassis:
    """How engines build and drive a robot on wheels that do not steer."""

    description: str
    """URDF text; its base frame is the reference point."""
    rollers: tuple[str, str]
    """Links that drive it, left and right; each spins in the joint ``<link>_spin``, forward where positive."""
    supports: tuple[str, ...]
    """Links that it leans on."""
    radius_m: float
    """Of the rollers."""
    skid: SkidSteer
    torque_nm: float
    """Most torque of a side."""


@dataclass(frozen=True, kw_only=True)
class LeggedChassis:
    """How engines build and drive a robot on four legs."""

    description: str
    """URDF text; its base frame is above the reference point, at the height of the hips."""
    joints: tuple[str, ...]
    """Joints in the order of `Trot.joint_targets`."""
    toe_m: float
    """Radius of the feet."""
    trot: TrotConfig
    torque_nm: float
    """Most torque of a joint."""
    gains: tuple[float, float]
    """Of the engine's position motors, for position and velocity."""


@dataclass(frozen=True, kw_only=True)
class TwistSpec:
    """A robot that is told a speed and a yaw rate, and may turn on the spot about the reference point of its pose.

    The reference point is the middle between its wheels or feet, on the floor; x points ahead.
    """

    name: str
    drive: TwistDrive
    chassis: SkidChassis | LeggedChassis
    mass_kg: float
    """Without a load."""
    max_payload_kg: float
    front_m: float
    """Reach of its body and what moves on it ahead of the reference point [m]."""
    rear_m: float
    """Reach behind the reference point [m]."""
    half_width_m: float
    height_m: float
    """Top of the tray walls above the floor [m]."""
    tray_x_m: float
    """Tray centre ahead of the reference point [m]."""
    tray_floor_z_m: float
    """Top of the tray floor above the ground [m]."""
    tray_size_m: tuple[float, float, float]
    """Inner length, inner width, wall height of the tray [m]."""
    limits: TwistLimits
    response: TwistResponse
    visuals: tuple[Visual, ...]
    sources: Mapping[str, str]
    """Where each number is from, by the name of its field here or in `limits`."""
