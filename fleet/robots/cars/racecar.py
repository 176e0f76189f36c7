"""Racecar: the Ackermann car of the fleet, 1:10 scale, with an open tray for one parcel."""

from __future__ import annotations

import math
from pathlib import Path

import pybullet_data

from fleet.robots.cars.ackermann_body import AckermannBody
from fleet.robots.model import CarEntry, WheelShape
from fleet.robots.spec import WHEELS, CarLimits, CarMotors, CarSpec, Visual, visual
from fleet.robots.tray import Tray

_BODY_RGBA = (0.10, 0.25, 0.60, 1.0)
_TYRE_RGBA = (0.08, 0.08, 0.08, 1.0)
_SENSOR_RGBA = (0.2, 0.2, 0.2, 1.0)


def _body() -> AckermannBody:
    """Wheels, chassis and tray.

    Wheelbase, track, radius, masses and inertia of the wheels and places of the meshes: racecar/racecar.urdf in
    pybullet_data, the MIT RACECAR. Its chassis has no collision shape. Mass and inertia of the base: 4.2 kg of stock
    chassis at axle height (0.1477 m ahead for 4.0 kg of it), lidar 0.13 kg, tray 0.4 kg, brought to the common centre
    of mass with the parallel-axis theorem. Friction: rubber on a warehouse floor.
    """
    radius_m = 0.05
    return AckermannBody(
        name="racecar",
        wheelbase_m=0.325,
        track_m=0.2,
        wheel_radius_m=radius_m,
        wheel_width_m=0.045,
        chassis_size_m=(0.50, 0.28, 0.08),
        chassis_centre_m=(0.16, 0.0, 0.07),
        tray=Tray(x_m=0.16, floor_z_m=0.18, inner_m=(0.30, 0.22, 0.07), wall_m=0.005),
        base_mass_kg=4.73,
        base_com_m=(0.1457, 0.0, 0.0648),
        base_inertia=(0.0223, 0.0687, 0.0697),
        wheel_mass_kg=0.34055,
        wheel_inertia=(0.00041226, 0.00026046),
        hinge_mass_kg=0.1,
        tyre_friction=0.9,
        body_friction=0.8,
        drawn=_drawn(radius_m),
    )


def racecar_spec() -> CarSpec:
    """Give sizes and limits of the racecar.

    Limits and their source: speed 2 m/s is the fastest at which a pure-pursuit controller was measured to hold a track
    (3 cm at a 1 m radius); 1.5 m/s^2 kept an unsecured parcel in the tray in every one of 810 trials, braking may be
    harder because the tray has walls; the steering limit is the bicycle angle at which the inner hinge meets its stop
    at 1 rad (0.81 rad), less a margin; the steering rate is that of a hobby servo (0.17 s for 60 degrees), derated by
    a third for the load. Motors: 2 m/s^2 with a full tray needs 0.21 Nm at each wheel; tyres hold 0.8 x 6.2 kg x
    9.81 m/s^2.
    """
    limits = CarLimits(
        max_speed_mps=2.0,
        max_accel_mps2=1.5,
        max_brake_mps2=2.5,
        max_steering_rad=0.8,
        max_steering_rate_radps=4.0,
        max_payload_kg=2.0,
    )
    motors = CarMotors(drive_nm=0.6, brake_nm=4.0, steer_nm=10.0, steer_gain=0.4, hold_force_n=48.0)
    return _body().spec(limits, motors)


def racecar_urdf(wheels: WheelShape = "sphere") -> str:
    """Write its description, see `AckermannBody.urdf`."""
    return _body().urdf(wheels)


def _drawn(radius_m: float) -> tuple[Visual, ...]:
    meshes = Path(pybullet_data.getDataPath()) / "racecar" / "meshes"
    parts = [
        visual("chassis", mesh=meshes / "chassis.STL", xyz=(0.0, 0.0, radius_m), rgba=_BODY_RGBA),
        visual("chassis", mesh=meshes / "hokuyo.obj", xyz=(0.265, 0.0, 0.125), rgba=_SENSOR_RGBA),
    ]
    for name in WHEELS:
        axle, side = name.split("_")
        mesh = meshes / f"{side}_{axle}_wheel.obj"
        parts.append(visual(name, mesh=mesh, rgba=_TYRE_RGBA, roll=math.pi / 2))
    return tuple(parts)


_DESCRIPTION = "racecar/racecar.urdf in pybullet_data, the MIT RACECAR"
_MEASURED = "measured here; see the docstring of `racecar_spec`"
ENTRY = CarEntry(
    spec=racecar_spec,
    urdf=racecar_urdf,
    sources={
        "mass_kg": f"{_DESCRIPTION}, lidar and our tray",
        "max_payload_kg": "chosen here",
        "wheelbase_m": _DESCRIPTION,
        "track_m": _DESCRIPTION,
        "wheel_radius_m": _DESCRIPTION,
        "front_m": "the box about chassis, wheels and bumpers",
        "rear_m": "the same box",
        "half_width_m": "the same box",
        "height_m": "top of our tray",
        "max_speed_mps": _MEASURED,
        "max_accel_mps2": _MEASURED,
        "max_brake_mps2": _MEASURED,
        "max_steering_rad": f"stops of the hinges in {_DESCRIPTION}, less a margin",
        "max_steering_rate_radps": "a hobby servo, 0.17 s for 60 degrees, derated by a third",
    },
)
