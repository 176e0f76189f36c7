"""Husky as a car of fleets; what it is and where its numbers come from stands in `fleet.robots.twist.husky`."""

from __future__ import annotations

from fleet.robots.differential import DifferentialDrive
from fleet.robots.model import CarEntry, WheelShape
from fleet.robots.spec import CarMotors, CarSpec, DriveKind
from fleet.robots.twist.husky import (
    TRAY,
    WHEEL_RADIUS_M,
    body_boxes,
    husky_chassis,
    husky_spec,
    husky_urdf,
    wheel_places,
)


def _spec() -> CarSpec:
    """Give sizes, limits and drive; a standing one is held by its tyres with 0.9 of its weight."""
    own, chassis = husky_spec(), husky_chassis()
    (ahead, aside, _), _, (behind, _, _), _ = wheel_places().tolist()
    return CarSpec(
        name=own.name,
        drive=DriveKind.DIFFERENTIAL,
        differential=DifferentialDrive(limits=own.limits, response=own.response, chassis=chassis),
        motors=CarMotors(
            drive_nm=chassis.torque_nm,
            brake_nm=chassis.torque_nm,
            steer_nm=0.0,
            steer_gain=0.0,
            hold_force_n=round(0.9 * 9.81 * own.mass_kg, 0),
        ),
        mass_kg=own.mass_kg,
        max_speed_mps=own.limits.max_speed_mps,
        max_accel_mps2=own.limits.max_accel_mps2,
        max_brake_mps2=own.limits.max_brake_mps2,
        max_steering_rad=0.0,
        max_steering_rate_radps=0.0,
        max_payload_kg=own.max_payload_kg,
        rear_axle_m=behind,
        wheelbase_m=ahead - behind,
        track_m=2 * aside,
        wheel_radius_m=WHEEL_RADIUS_M,
        front_m=own.front_m,
        rear_m=own.rear_m,
        half_width_m=own.half_width_m,
        height_m=own.height_m,
        body_boxes=body_boxes(),
        tray_x_m=own.tray_x_m,
        tray_floor_z_m=own.tray_floor_z_m,
        tray_size_m=own.tray_size_m,
        tray_wall_m=TRAY.wall_m,
        # One behind the other: arms on either side of a dock reach them, and tools have room beside what lies there.
        tray_places=((0.0, 0.0), (0.22, 0.0), (-0.22, 0.0)),
        visuals=own.visuals,
    )


def _urdf(wheels: WheelShape) -> str:
    """Write its description; it rolls on spheres, whatever is asked for."""
    del wheels
    return husky_urdf()


ENTRY = CarEntry(spec=_spec, urdf=_urdf, sources=husky_spec().sources)
