"""A1 as a car of fleets; what it is and where its numbers come from stands in `fleet.robots.twist.a1`."""

from __future__ import annotations

from fleet.robots.differential import DifferentialDrive
from fleet.robots.model import CarEntry, WheelShape
from fleet.robots.spec import CarMotors, CarSpec, DriveKind
from fleet.robots.twist.a1 import A1_FOLLOWER, TOE_RADIUS_M, TRAY, TROT, a1_chassis, a1_spec, a1_urdf, body_boxes


def _spec() -> CarSpec:
    """Give sizes, limits and drive; its feet are told as wheels are, and it stands by them without a brake."""
    own, chassis = a1_spec(), a1_chassis()
    return CarSpec(
        name=own.name,
        drive=DriveKind.LEGGED,
        differential=DifferentialDrive(limits=own.limits, response=own.response, chassis=chassis, follower=A1_FOLLOWER),
        motors=CarMotors(
            drive_nm=chassis.torque_nm, brake_nm=chassis.torque_nm, steer_nm=0.0, steer_gain=0.0, hold_force_n=0.0
        ),
        mass_kg=own.mass_kg,
        max_speed_mps=own.limits.max_speed_mps,
        max_accel_mps2=own.limits.max_accel_mps2,
        max_brake_mps2=own.limits.max_brake_mps2,
        max_steering_rad=0.0,
        max_steering_rate_radps=0.0,
        max_payload_kg=own.max_payload_kg,
        rear_axle_m=-TROT.foot_x_m,
        wheelbase_m=2 * TROT.foot_x_m,
        track_m=2 * TROT.foot_y_m,
        wheel_radius_m=TOE_RADIUS_M,
        front_m=own.front_m,
        rear_m=own.rear_m,
        half_width_m=own.half_width_m,
        height_m=own.height_m,
        body_boxes=body_boxes(),
        tray_x_m=own.tray_x_m,
        tray_floor_z_m=own.tray_floor_z_m,
        tray_size_m=own.tray_size_m,
        tray_wall_m=TRAY.wall_m,
        visuals=own.visuals,
        # A cycle and a third, in which all feet come home.
        settle_s=round(4 / 3 / TROT.frequency_hz, 2),
    )


def _urdf(wheels: WheelShape) -> str:
    """Write its description; it has no wheels, whatever is asked for."""
    del wheels
    return a1_urdf()


ENTRY = CarEntry(spec=_spec, urdf=_urdf, sources=a1_spec().sources)
