"""Hauler: a toy car that is longer, wider, heavier and slower than the usual one, and carries three times as much."""

from fleet.robots.cars.ackermann_body import AckermannBody
from fleet.robots.model import CarEntry, WheelShape
from fleet.robots.spec import CarLimits, CarMotors, CarSpec, visual
from fleet.robots.tray import Tray


def _body() -> AckermannBody:
    """Wheels, chassis and tray; made up, with inertias of boxes and cylinders."""
    size, centre, grey = (0.62, 0.44, 0.08), (0.24, 0.0, 0.08), (0.3, 0.3, 0.35, 1.0)
    return AckermannBody(
        name="hauler",
        wheelbase_m=0.38,
        track_m=0.24,
        wheel_radius_m=0.06,
        wheel_width_m=0.05,
        chassis_size_m=size,
        chassis_centre_m=centre,
        tray=Tray(x_m=0.16, floor_z_m=0.18, inner_m=(0.30, 0.22, 0.07), wall_m=0.005),
        base_mass_kg=12.0,
        base_com_m=(0.19, 0.0, 0.07),
        base_inertia=(0.2, 0.39, 0.58),
        wheel_mass_kg=0.6,
        wheel_inertia=(0.00108, 0.00067),
        hinge_mass_kg=0.15,
        tyre_friction=0.9,
        body_friction=0.8,
        drawn=(visual("chassis", size_m=size, xyz=centre, rgba=grey),),
    )


def hauler_spec() -> CarSpec:
    """Sizes and limits."""
    limits = CarLimits(
        max_speed_mps=0.8,
        max_accel_mps2=1.0,
        max_brake_mps2=1.5,
        max_steering_rad=0.8,
        max_steering_rate_radps=4.0,
        max_payload_kg=6.0,
    )
    return _body().spec(
        limits, CarMotors(drive_nm=1.5, brake_nm=10.0, steer_nm=15.0, steer_gain=0.4, hold_force_n=115.0)
    )


def hauler_urdf(wheels: WheelShape = "sphere") -> str:
    """Description."""
    return _body().urdf(wheels)


ENTRY = CarEntry(spec=hauler_spec, urdf=hauler_urdf)
