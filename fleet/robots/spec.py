"""What the rest of the house needs to know about a robot model: sizes, limits with their source, visuals."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from pathlib import Path

import numpy as np

from fleet.arrays import FloatArray
from maps.vehicle import Footprint
from planners.motion.arm.kinematics import joint_rows

WHEELS = ("rear_left", "rear_right", "front_left", "front_right")
"""Wheel links of a car, in the order of `CarSpec.wheel_places`; each spins in the joint ``<link>_spin``."""

HINGES = ("left_steer", "right_steer")
"""Steering joints of a car's front wheels, positive to the left."""


class DriveKind(StrEnum):
    """What a car is told, and how its wheels make it move."""

    ACKERMANN = "ackermann"
    """Steering angle of the equivalent bicycle and speed of the rear axle; its front wheels steer."""


@dataclass(frozen=True, kw_only=True)
class Visual:
    """One drawn part of a robot, rigid in one of its links."""

    link: str
    """Name of the link the part is fixed to."""
    mesh: Path | None
    """Mesh file (.stl or .obj); None for a box."""
    size_m: tuple[float, float, float]
    """Full box size [m]; ignored for a mesh."""
    link_from_visual: FloatArray
    """Pose of the part in its link, 4x4 matrix."""
    rgba: tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class CarLimits:
    """What a car can do at most; the file of a model says where each number comes from."""

    max_speed_mps: float
    max_accel_mps2: float
    max_brake_mps2: float
    max_steering_rad: float
    max_steering_rate_radps: float
    max_payload_kg: float


@dataclass(frozen=True, kw_only=True)
class CarMotors:
    """What a car's motors and brakes give in physics."""

    drive_nm: float
    """Torque of each wheel's motor [Nm]."""
    brake_nm: float
    """The same when the car is told to stand: enough to lock the wheel, so that grip decides [Nm]."""
    steer_nm: float
    """Torque of each steering hinge [Nm]."""
    steer_gain: float
    """Share of the error of its angle that a hinge makes good in a physics step."""
    hold_force_n: float
    """Force that holds a standing car where it is: the grip of its tyres [N]."""


@dataclass(frozen=True, kw_only=True)
class CarSpec(CarLimits):
    """A model of cars; the reference point of its pose is the centre of the rear axle, on the floor.

    Its links are 'chassis', `WHEELS` and a hinge for each front wheel; each wheel spins in the joint ``<link>_spin``,
    and hinges turn in `HINGES`.
    """

    name: str
    drive: DriveKind
    motors: CarMotors
    mass_kg: float
    """Without a load."""
    wheelbase_m: float
    track_m: float
    wheel_radius_m: float
    front_m: float
    """Body reach ahead of the rear axle [m]."""
    rear_m: float
    """Body reach behind the rear axle [m]."""
    half_width_m: float
    height_m: float
    """Top of the tray walls above the floor [m]."""
    body_boxes: FloatArray
    """Lowest and highest corners of the boxes with which its body collides, in its frame [m], shape (k, 2, 3)."""
    tray_x_m: float
    """Tray centre ahead of the rear axle [m]."""
    tray_floor_z_m: float
    """Top of the tray floor above the ground [m]."""
    tray_size_m: tuple[float, float, float]
    """Inner length, inner width, wall height of the tray [m]."""
    tray_wall_m: float
    visuals: tuple[Visual, ...]
    """Links: 'chassis' (rear axle frame), `WHEELS`, 'tray'."""

    @property
    def footprint(self) -> Footprint:
        """What it takes of the floor, and how tightly it turns."""
        return Footprint(
            front_m=self.front_m,
            rear_m=self.rear_m,
            half_width_m=self.half_width_m,
            turn_radius_m=self.wheelbase_m / math.tan(self.max_steering_rad),
        )

    @property
    def wheel_places(self) -> FloatArray:
        """Centres x, y, z of the wheels in the car's frame, in the order of `WHEELS` [m], shape (4, 3)."""
        y = self.track_m / 2
        return np.array([[x, side * y, self.wheel_radius_m] for x in (0.0, self.wheelbase_m) for side in (1.0, -1.0)])


@dataclass(frozen=True, kw_only=True)
class ArmOutline:
    """How thick an arm is, for worlds that judge distances and rays without its meshes."""

    link_radii_m: tuple[float, ...]
    """Radius of the balls at each joint and half-way to it, which hold the links to about 2 cm [m], base to tip."""
    foot_m: float
    """Radius of the foot at the height of a car's lidar [m]."""
    n_standing_links: int
    """Links above the base that cannot come down to the floor it stands on."""


@dataclass(frozen=True, kw_only=True)
class ArmSpec:
    """A fixed-base arm with a tool; joint order is base to tip."""

    name: str
    n_joints: int
    urdf: Path
    """Description of the bare arm, read at run time; its folder has the meshes."""
    description: str
    """URDF text of the arm with its tool, as engines load it; its first joints are the arm's."""
    base_from_joint: FloatArray
    """Fixed transform before each joint's rotation about its own z, shape (n_joints, 4, 4)."""
    lower_rad: FloatArray
    upper_rad: FloatArray
    max_velocity_radps: FloatArray
    max_acceleration_radps2: FloatArray
    max_torque_nm: FloatArray
    tool_length_m: float
    """From the flange (last link frame) to the tool tip along the flange's +z [m]."""
    home_rad: FloatArray
    visuals: tuple[Visual, ...]
    """Links: 'link_0'..'link_7' (link i moves with joint i) and 'tool' (rigid in the last link)."""
    outline: ArmOutline
    touching: tuple[tuple[int, int], ...] = ()
    """Pairs of links whose hulls meet although the links do not, lower first: 0 is the base, i moves with joint i."""

    @cached_property
    def joints(self) -> FloatArray:
        """The upper three rows of `base_from_joint`, as kernels take them, shape (n_joints, 3, 4)."""
        return joint_rows(self.base_from_joint)

    def with_limits(self, velocity_radps: float | None, acceleration_radps2: float | None) -> ArmSpec:
        """The same arm with one limit for all joints; None leaves its own."""
        velocity, acceleration = (
            own if limit is None else np.full(self.n_joints, float(limit))
            for limit, own in (
                (velocity_radps, self.max_velocity_radps),
                (acceleration_radps2, self.max_acceleration_radps2),
            )
        )
        return replace(self, max_velocity_radps=velocity, max_acceleration_radps2=acceleration)
