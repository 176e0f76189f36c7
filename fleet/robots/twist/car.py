"""Twist cars: robots that are told a speed and a yaw rate, as cars of fleets."""

from __future__ import annotations

from fleet.arrays import FloatArray
from fleet.robots.differential import DifferentialDrive, TwistFollowerConfig
from fleet.robots.spec import CarMotors, CarSpec, DriveKind
from fleet.robots.twist.spec import TwistSpec


def twist_car(
    own: TwistSpec,
    drive: DriveKind,
    follower: TwistFollowerConfig,
    *,
    hold_force_n: float,
    rear_axle_m: float,
    wheelbase_m: float,
    track_m: float,
    wheel_radius_m: float,
    body_boxes: FloatArray,
    tray_wall_m: float,
) -> CarSpec:
    """Give what a car of a fleet is, from what the robot is by itself; it does not steer.

    Args:
        own: The robot.
        drive: How it moves.
        follower: Gains with which it follows its paths.
        hold_force_n: With which it is held where it stands [N].
        rear_axle_m: x of the hind wheels, or feet [m].
        wheelbase_m: Distance from these to the front ones [m].
        track_m: Distance from the left to the right ones [m].
        wheel_radius_m: Their radius [m].
        body_boxes: Lowest and highest corners of the boxes with which its body collides [m], shape (n, 2, 3).
        tray_wall_m: Thickness of the walls of its tray [m].
    """
    torque_nm = own.chassis.torque_nm
    return CarSpec(
        name=own.name,
        drive=drive,
        differential=DifferentialDrive(
            limits=own.limits, response=own.response, chassis=own.chassis, follower=follower
        ),
        motors=CarMotors(
            drive_nm=torque_nm, brake_nm=torque_nm, steer_nm=0.0, steer_gain=0.0, hold_force_n=hold_force_n
        ),
        mass_kg=own.mass_kg,
        max_speed_mps=own.limits.max_speed_mps,
        max_accel_mps2=own.limits.max_accel_mps2,
        max_brake_mps2=own.limits.max_brake_mps2,
        max_steering_rad=0.0,
        max_steering_rate_radps=0.0,
        max_payload_kg=own.max_payload_kg,
        rear_axle_m=rear_axle_m,
        wheelbase_m=wheelbase_m,
        track_m=track_m,
        wheel_radius_m=wheel_radius_m,
        front_m=own.front_m,
        rear_m=own.rear_m,
        half_width_m=own.half_width_m,
        height_m=own.height_m,
        body_boxes=body_boxes,
        tray_x_m=own.tray_x_m,
        tray_floor_z_m=own.tray_floor_z_m,
        tray_size_m=own.tray_size_m,
        tray_wall_m=tray_wall_m,
        visuals=own.visuals,
    )
