"""What the rest of the house needs to know about a robot model: sizes, limits with their source, visuals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.differential import DifferentialDrive
from maps.vehicle import Footprint

WHEELS = ("rear_left", "rear_right", "front_left", "front_right")
"""Wheel links of a car, in the order of `CarSpec.wheel_places`; each spins in the joint ``<link>_spin``."""

HINGES = ("left_steer", "right_steer")
"""Steering joints of a car's front wheels, positive to the left."""


class DriveKind(StrEnum):
    """What a car is told, and how its wheels make it move."""

    ACKERMANN = "ackermann"
    """Steering angle of the equivalent bicycle and speed of the rear axle; its front wheels steer."""
    DIFFERENTIAL = "differential"
    """Yaw rate and speed of the middle between its wheels; those of both sides turn at speeds of their own."""
    LEGGED = "legged"
    """The same of the middle between its feet; its legs step as that asks for."""


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


def visual(
    link: str,
    *,
    rgba: tuple[float, float, float, float],
    mesh: Path | None = None,
    size_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    xyz: tuple[float, float, float] = (0.0, 0.0, 0.0),
    roll: float = 0.0,
    yaw: float = 0.0,
) -> Visual:
    """Give a drawn part of a link: a mesh, or a box of a size [m].

    Args:
        link: The link.
        rgba: Its colour.
        mesh: The mesh; None = a box.
        size_m: Of the box.
        xyz: Its place in the link [m].
        roll: By which it is turned about the link's x axis, and then ...
        yaw: ... about its z axis [rad].
    """
    cr, sr, cy, sy = math.cos(roll), math.sin(roll), math.cos(yaw), math.sin(yaw)
    pose = np.eye(4)
    pose[:3, :3] = [[cy, -sy * cr, sy * sr], [sy, cy * cr, -cy * sr], [0.0, sr, cr]]
    pose[:3, 3] = xyz
    return Visual(link=link, mesh=mesh, size_m=size_m, link_from_visual=pose, rgba=rgba)


@dataclass(frozen=True, kw_only=True)
class CarLimits:
    """What a car can do at most; the file of a model says where each number comes from."""

    max_speed_mps: float
    max_accel_mps2: float
    max_brake_mps2: float
    max_steering_rad: float
    """0 for a car that does not steer."""
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
class PodShape:
    """A shelf pod: what it takes of the floor when it is carried."""

    length_m: float
    width_m: float
    height_m: float
    """Its top above the floor when it stands."""

    @property
    def half_m(self) -> tuple[float, float]:
        """Half of its length and width [m]."""
        return self.length_m / 2, self.width_m / 2


@dataclass(frozen=True, kw_only=True)
class CarSpec(CarLimits):
    """A model of cars; the reference point of its pose is on the floor: the centre of the rear axle, or, of a car that
    does not steer, the middle about which it turns.

    Its links are 'chassis', `WHEELS` and a hinge for each front wheel; each wheel spins in the joint ``<link>_spin``,
    and hinges turn in `HINGES`.
    """

    name: str
    drive: DriveKind
    differential: DifferentialDrive | None = None
    """The drive of a car that is told a yaw rate, on wheels or on legs; None for one that steers."""
    motors: CarMotors
    mass_kg: float
    """Without a load."""
    wheelbase_m: float
    """From axle to axle, or from the hind to the front feet [m]."""
    track_m: float
    wheel_radius_m: float
    front_m: float
    """Body reach ahead of the reference point [m]."""
    rear_m: float
    """Body reach behind the reference point [m]."""
    half_width_m: float
    height_m: float
    """Top of the tray walls above the floor [m]."""
    body_boxes: FloatArray
    """Lowest and highest corners of the boxes with which its body collides, in its frame [m], shape (k, 2, 3)."""
    tray_x_m: float
    """Tray centre ahead of the reference point [m]."""
    tray_floor_z_m: float
    """Top of the tray floor above the ground [m]."""
    tray_size_m: tuple[float, float, float]
    """Inner length, inner width, wall height of the tray [m]."""
    tray_wall_m: float
    tray_places: tuple[tuple[float, float], ...] = ((0.0, 0.0),)
    """Where parcels are set down, ahead of the tray's centre and to the left of it [m]."""
    visuals: tuple[Visual, ...]
    """Links: 'chassis' (frame of the reference point), `WHEELS`, 'tray'."""
    settle_s: float = 0.0
    """How long it has to stand before it counts as at rest: legs bring their last steps to an end [s]."""
    lifts: PodShape | None = None
    """The pods that it drives under and carries, their middle above its reference point; None = it lifts none."""
    rear_axle_m: float = 0.0
    """Rear axle ahead of the reference point [m]."""

    @property
    def steers(self) -> bool:
        """Whether it is told a steering angle; else it is told a yaw rate."""
        return self.differential is None

    @property
    def turn_base_m(self) -> float:
        """Length by which the tangent of its steering angle is its curvature; 0 = it is told a yaw rate [m]."""
        return self.wheelbase_m if self.steers else 0.0

    @property
    def max_turn(self) -> float:
        """Greatest first number of a command: a steering angle [rad] or a yaw rate [rad/s]."""
        return self.max_steering_rad if self.differential is None else self.differential.limits.max_yaw_rate_radps

    @property
    def lock_to_lock_s(self) -> float:
        """Time in which its wheels turn from one side to the other; 0 for a car that does not steer [s]."""
        return 2.0 * self.max_steering_rad / self.max_steering_rate_radps if self.steers else 0.0

    @property
    def footprint(self) -> Footprint:
        """What it takes of the floor, with a pod if it lifts pods, and how tightly it turns."""
        length_m, width_m = (0.0, 0.0) if self.lifts is None else self.lifts.half_m
        return Footprint(
            front_m=max(self.front_m, length_m),
            rear_m=max(self.rear_m, length_m),
            half_width_m=max(self.half_width_m, width_m),
            turn_radius_m=self.wheelbase_m / math.tan(self.max_steering_rad) if self.steers else 0.0,
            pivots=not self.steers,
        )

    def yaw_rate(self, turn: float, speed: float) -> float:
        """Yaw rate of a car that drives as it was told [rad/s]; `turn` is a steering angle or already the yaw rate."""
        return speed * math.tan(turn) / self.wheelbase_m if self.steers else turn

    @property
    def wheel_places(self) -> FloatArray:
        """Centres x, y, z of the wheels in the car's frame, in the order of `WHEELS` [m], shape (4, 3)."""
        y = self.track_m / 2
        axles = self.rear_axle_m, self.rear_axle_m + self.wheelbase_m
        return np.array([[x, side * y, self.wheel_radius_m] for x in axles for side in (1.0, -1.0)])
