"""Differential: drives that are told a speed and a yaw rate: limits, response, and wheels that do not steer or legs."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fleet.arrays import FloatArray


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
class SkidSteer:
    """Wheels left and right whose tyres scrub sideways in turns, so that a turn takes more than it would without.

    Scrubbing is in this map alone, by the multiplier that real controllers use. The contacts of the simulated wheels
    have hardly any sideways hold and do not scrub: what motors are told and what the floor sees differ.

    Source: A. Mandow et al., "Experimental kinematics for wheeled skid-steer mobile robots", IROS 2007,
    https://doi.org/10.1109/IROS.2007.4399139: a wider track stands for the slip.
    """

    separation_m: float
    """Distance of the wheels' middles, left to right, as the controller has it [m]."""
    multiplier: float
    """How many times as wide the track is that turns the robot as the wheels do."""
    contact_track_m: float
    """Distance of the contacts of the simulated wheels [m]."""

    @property
    def lever_m(self) -> float:
        """What a yaw rate of 1 rad/s adds to the outer wheels [m]."""
        return 0.5 * self.multiplier * self.separation_m

    def rims(self, commands: FloatArray) -> FloatArray:
        """Rim speeds of the left and the right wheels [m/s] for speeds and yaw rates, both of shape (n, 2)."""
        side = self.lever_m * commands[:, 1]
        return np.stack((commands[:, 0] - side, commands[:, 0] + side), axis=1)

    def twists(self, rims: FloatArray) -> FloatArray:
        """Speeds and yaw rates that rim speeds bring, the other way round; the odometry of such a robot."""
        left, right = rims[:, 0], rims[:, 1]
        return np.stack((0.5 * (left + right), 0.5 * (right - left) / self.lever_m), axis=1)

    def contacts(self, rims: FloatArray) -> FloatArray:
        """Rim speeds with which simulated wheels roll as those of the real robot scrub, shape (n, 2)."""
        half = 0.5 * self.contact_track_m
        twists = self.twists(rims)
        side = half * twists[:, 1]
        return np.stack((twists[:, 0] - side, twists[:, 0] + side), axis=1)


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
class TrotConfig:
    """Sizes of the legs and numbers of the gait."""

    link_m: float
    """Length of the upper and of the lower leg [m]."""
    hip_m: float
    """From the axis about which a leg rolls out to the leg [m]."""
    foot_x_m: float
    """Feet stand so far ahead of the middle, and behind it [m]."""
    foot_y_m: float
    """And so far beside it [m]."""
    height_m: float = 0.28
    """Of the hips above the feet [m]."""
    lift_m: float = 0.05
    """How high a foot swings [m]."""
    frequency_hz: float = 3.0
    """Cycles per second."""
    speed_gain: float = 1.045
    """Steps bring so many times the speed for which they are as long as they should be: measured on the A1, whose body
    goes on by itself between two steps."""
    yaw_gain: float = 1.067
    """The same of the yaw rate."""


@dataclass(frozen=True, kw_only=True)
class LeggedChassis:
    """How engines build and drive a robot on four legs."""

    description: str
    """URDF text; its base frame is the reference point."""
    joints: tuple[str, ...]
    """Joints in the order of `Trot.joint_targets`."""
    hip_z_m: float
    """Height of the hips above the reference point when it stands [m]."""
    trot: TrotConfig
    torque_nm: float
    """Most torque of a joint."""
    gains: tuple[float, float]
    """Of the engine's position motors, for position and velocity."""


@dataclass(frozen=True, kw_only=True)
class TwistFollowerConfig:
    """Gains of the follower."""

    cross_per_m2: float = 16.0
    """Curvature against a metre beside the path: errors die out over `1 / sqrt` of it, a quarter of a metre."""
    heading_per_m: float = 8.0
    """Curvature against a radian of heading error: twice the root of `cross_per_m2` damps without overshoot."""
    lag_s: float = 0.05
    """Delay between a yaw rate and the body's, by which the path's own curvature is taken ahead [s]."""
    brake_fraction: float = 0.6
    """Share of the braking, along the path and in turns, that planned stops use."""
    approach_per_s: float = 4.0
    """Speed per metre, and yaw rate per radian, left before a stop [1/s]."""
    creep_mps: float = 0.02
    """Least speed until the stop is reached [m/s]."""
    stop_tolerance_m: float = 0.002
    """A robot this close to its stop, or past it, stands."""
    slow_mps: float = 0.06
    """Below this speed a robot may be told to stand at its stop [m/s]."""
    turn_tolerance_rad: float = 0.005
    """A turn on the spot ends this close to its yaw, or past it."""
    slow_radps: float = 0.05
    """Least yaw rate in a turn on the spot until it is done [rad/s]."""
    hold_per_s: float = 2.0
    """Speed for each metre by which a robot that turns on the spot has left the spot, ahead or back [1/s]."""
    hold_mps: float = 0.05
    """That speed at most [m/s]."""
    restart_m: float = 0.02
    """A standing robot ignores a stop nearer than this [m], so that noise does not wake it."""
    braked_restart_m: float = 0.2
    """One that has its brake on ignores a stop nearer than this [m], as `FollowerConfig` says."""


@dataclass(frozen=True, kw_only=True)
class DifferentialDrive:
    """The drive of a car whose two sides, of wheels or of legs, turn it."""

    limits: TwistLimits
    response: TwistResponse
    chassis: SkidChassis | LeggedChassis
    follower: TwistFollowerConfig = field(default_factory=TwistFollowerConfig)
    """Gains with which it is driven along paths."""
