"""Husky: Clearpath's A200, a skid-steered robot of four wheels, with an open tray for several parcels."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pybullet_data

from fleet.arrays import FloatArray
from fleet.robots.description import fill, rollers, solid_box, spaced, supports
from fleet.robots.differential import SkidChassis, SkidSteer, TwistLimits, TwistResponse
from fleet.robots.spec import Visual, visual
from fleet.robots.tray import TRAY_RGBA, Tray, Triple
from fleet.robots.twist.spec import TwistSpec

_MANUAL = "https://docs.clearpathrobotics.com/docs_robots/outdoor_robots/husky/a200/user_manual_husky"
_CONTROLLER = "https://github.com/husky/husky husky_control/config/control.yaml"
_DRIVER = "https://github.com/husky/husky husky_base/launch/base.launch"
_DESCRIPTION = "husky/husky.urdf in pybullet_data, Clearpath's own"

WHEELS = ("front_left", "front_right", "rear_left", "rear_right")
"""Wheels that are seen."""
ROLLERS = ("left_roller", "right_roller")
"""What drives the robot, see `husky_urdf`; each spins in the joint ``<link>_spin``, forward where positive."""
# Wheel places, radius, masses and inertias: Clearpath's description. Its wheels' axle is y.
_WHEEL_X_M, _WHEEL_Y_M = 0.256, 0.2854
WHEEL_RADIUS_M = 0.17775
_WHEEL_MASS_KG = 2.637
_WHEEL_INERTIA = (0.02467, 0.04411)
_CHASSIS_MASS_KG = 33.455
_ROLLER_MASS_KG = 0.25
_ROLLER_INERTIA = 0.003
_RAISED_M = 0.001
_CHASSIS_COM_M = (-0.08748, -0.00085, 0.09947 + 0.14493)
_CHASSIS_INERTIA = (0.6022, 1.7386, 2.0296)
# The chassis box of that description, from the floor up, as long as the bumpers of the manual.
_CHASSIS_SIZE_M = (0.99, 0.5709, 0.2675)
_CHASSIS_Z_M = 0.26991
# A tray of our own on the top plate: sheet metal, room for two rows of three parcels of 20 cm.
TRAY = Tray(x_m=0.0, floor_z_m=0.41, inner_m=(0.72, 0.46, 0.10), wall_m=0.01)
_TRAY_MASS_KG = 2.0
# What the rollers weigh is taken from all that.
_BASE_MASS_KG = _CHASSIS_MASS_KG + 4 * _WHEEL_MASS_KG + _TRAY_MASS_KG - 2 * _ROLLER_MASS_KG
_BODY_FRICTION = 0.8
# Rubber has 0.9, as the racecar's. But both rollers hold the same line sideways, so that nothing tells the engine how
# to share it: they press against each other, and that takes from their hold ahead (with 0.9 one of them slips at the
# end of every second curve).
_ROLLER_FRICTION = 1.5

SKID = SkidSteer(separation_m=0.555, multiplier=1.875, contact_track_m=0.993 * 2 * _WHEEL_Y_M)
"""Track of the manual, multiplier of Clearpath's controller; the rollers turn the robot as if they were 0.7 % nearer to
each other than they are (fitted)."""

_BODY_RGBA = (0.15, 0.15, 0.15, 1.0)
_PLATE_RGBA = (0.85, 0.70, 0.10, 1.0)
_RAIL_RGBA = (0.30, 0.30, 0.30, 1.0)
_TYRE_RGBA = (0.10, 0.10, 0.10, 1.0)


def husky_spec() -> TwistSpec:
    """Give sizes, limits and sources of the Husky."""
    return TwistSpec(
        name="husky",
        drive="differential",
        chassis=husky_chassis(),
        mass_kg=_CHASSIS_MASS_KG + 4 * _WHEEL_MASS_KG + _TRAY_MASS_KG,
        max_payload_kg=20.0,
        front_m=0.495,
        rear_m=0.495,
        half_width_m=0.345,
        height_m=TRAY.top_z_m,
        tray_x_m=TRAY.x_m,
        tray_floor_z_m=TRAY.floor_z_m,
        tray_size_m=TRAY.inner_m,
        limits=TwistLimits(
            max_speed_mps=1.0,
            max_yaw_rate_radps=2.0,
            max_accel_mps2=1.5,
            max_brake_mps2=2.5,
            max_yaw_accel_radps2=6.0,
            max_rim_mps=1.0,
            lever_m=SKID.lever_m,
            max_lateral_mps2=2.5,
        ),
        # Fitted: python -m fleet robots fit husky
        response=TwistResponse(speed_gain=0.997, speed_lag_s=0.06, yaw_gain=1.0, yaw_lag_s=0.041),
        visuals=_visuals(),
        sources={
            "mass_kg": f"44.0 kg of {_DESCRIPTION}, tray 2.0 kg; the manual's 50 kg has fittings that we leave out",
            "max_payload_kg": f"{_MANUAL}: 20 kg where it turns in place on a floor that holds; 75 kg with wide turns",
            "front_m": f"{_MANUAL}: 990 mm long",
            "rear_m": f"{_MANUAL}: 990 mm long",
            "half_width_m": f"{_MANUAL}: 670 mm wide; its description's wheels reach 345 mm from the middle",
            "height_m": "top of our tray on the plate, which is 390 mm high in the manual",
            "max_speed_mps": f"{_MANUAL}: 1 m/s",
            "max_rim_mps": f"{_DRIVER}: max_speed 1.0, to which the driver scales both sides of wheels",
            "max_yaw_rate_radps": f"{_CONTROLLER}: 2.0 rad/s",
            "max_yaw_accel_radps2": f"{_CONTROLLER}: 6.0 rad/s^2",
            "max_accel_mps2": f"as the racecar, for parcels' sake; {_CONTROLLER} allows 3.0",
            "max_brake_mps2": f"as the racecar, for parcels' sake; {_CONTROLLER} allows 3.0",
            "lever_m": f"half of the track 0.555 m times the multiplier 1.875 of {_CONTROLLER}",
            "max_lateral_mps2": "the wheels' sideways hold in our physics, see `husky_urdf`",
        },
    )


def husky_chassis() -> SkidChassis:
    """Give what engines build and drive it by."""
    return SkidChassis(
        description=husky_urdf(),
        rollers=ROLLERS,
        supports=("supports",),
        radius_m=WHEEL_RADIUS_M,
        skid=SKID,
        # 2.5 m/s^2 with a full load needs 15 N m.
        torque_nm=60.0,
    )


def body_boxes() -> FloatArray:
    """Give the boxes with which its body collides: chassis, floor and walls of the tray.

    Returns:
        Lowest and highest corners in its frame [m], shape (6, 2, 3).
    """
    boxes = np.array([(_CHASSIS_SIZE_M, (0.0, 0.0, _CHASSIS_Z_M)), *_tray_boxes()])
    sizes, centres = boxes[:, 0], boxes[:, 1]
    return np.stack((centres - sizes / 2, centres + sizes / 2), axis=1)


def husky_urdf() -> str:
    """Write the description; meshes are named by absolute path.

    Four wheels that skid cannot be told to the engine: it turns friction that has a direction the wrong way on the way
    round (on the spot, a yaw rate of 1 rad/s moves the middle by 0.13 to 0.22 m/s, and curves at 1 m/s slide outwards).
    So the robot rolls on two spheres in the middle between its wheels, and leans on four more without friction at the
    wheels' places, a millimetre above the floor. It turns about its middle, as a skid-steered robot does whose load is
    even; what skidding costs is in `SKID`. The wheels that are seen do not spin: four joints less are half the price.
    """
    meshes = _meshes().as_posix()
    com, inertia = _base()
    places = wheel_places()
    return fill(
        "husky",
        meshes=meshes,
        lift=0.14493,
        base_mass=_BASE_MASS_KG,
        com=spaced(com),
        ixx=round(inertia[0], 4),
        iyy=round(inertia[1], 4),
        izz=round(inertia[2], 4),
        body_friction=_BODY_FRICTION,
        chassis_size=spaced(_CHASSIS_SIZE_M),
        chassis_xyz=spaced((0.0, 0.0, _CHASSIS_Z_M)),
        tray_parts="\n".join(solid_box(size, xyz, "tray") for size, xyz in _tray_boxes()),
        wheels="\n".join(
            f'    <visual><origin xyz="{spaced(place)}"/><geometry><mesh filename="{meshes}/wheel.stl"/></geometry>'
            '<material name="tyre"/></visual>'
            for place in places.tolist()
        ),
        supports=supports(places.tolist(), WHEEL_RADIUS_M - _RAISED_M),
        rollers=rollers(
            ROLLERS,
            half_track_m=_WHEEL_Y_M,
            radius_m=WHEEL_RADIUS_M,
            friction=_ROLLER_FRICTION,
            mass_kg=_ROLLER_MASS_KG,
            inertia=_ROLLER_INERTIA,
        ),
    )


def wheel_places() -> FloatArray:
    """Centres x, y, z of the wheels in the order of `WHEELS` [m], shape (4, 3)."""
    return np.array([(x, y, WHEEL_RADIUS_M) for x in (_WHEEL_X_M, -_WHEEL_X_M) for y in (_WHEEL_Y_M, -_WHEEL_Y_M)])


def _base() -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Centre of mass and moments of inertia about it of chassis, wheels and tray, by the parallel-axis theorem."""
    length, width, _ = TRAY.inner_m
    tray = _TRAY_MASS_KG / 12.0 * np.array([width**2, length**2, length**2 + width**2])
    across, axle = _WHEEL_INERTIA
    parts = [
        (_CHASSIS_MASS_KG, np.array(_CHASSIS_COM_M), np.array(_CHASSIS_INERTIA)),
        (_TRAY_MASS_KG, np.array([TRAY.x_m, 0.0, TRAY.floor_z_m]), tray),
        *((_WHEEL_MASS_KG, place, np.array([across, axle, across])) for place in wheel_places()),
        # The rollers' mass is theirs.
        *((-_ROLLER_MASS_KG, np.array([0.0, side * _WHEEL_Y_M, WHEEL_RADIUS_M]), np.zeros(3)) for side in (1.0, -1.0)),
    ]
    com = sum(part * at for part, at, _ in parts) / _BASE_MASS_KG
    total = np.zeros(3)
    for part, at, moments in parts:
        off = at - com
        total += moments + part * (off @ off - off**2)
    x, y, z = (round(float(number), 5) for number in com)
    ixx, iyy, izz = (float(number) for number in total)
    return (x, y, z), (ixx, iyy, izz)


def _meshes() -> Path:
    return Path(pybullet_data.getDataPath()) / "husky" / "meshes"


def _tray_boxes() -> list[tuple[Triple, Triple]]:
    """Size and centre of the floor plate, which reaches down to the chassis, and the four walls."""
    return [TRAY.floor(_CHASSIS_Z_M + _CHASSIS_SIZE_M[2] / 2), *TRAY.plates()]


def _visuals() -> tuple[Visual, ...]:
    meshes, lift = _meshes(), 0.14493
    parts = [
        visual("chassis", mesh=meshes / "base_link.stl", xyz=(0.0, 0.0, lift), rgba=_BODY_RGBA),
        visual("chassis", mesh=meshes / "top_plate.stl", xyz=(0.0, 0.0, lift), rgba=_PLATE_RGBA),
        visual("chassis", mesh=meshes / "user_rail.stl", xyz=(0.272, 0.0, lift + 0.245), rgba=_RAIL_RGBA),
        visual("chassis", mesh=meshes / "bumper.stl", xyz=(0.48, 0.0, lift + 0.091), rgba=_RAIL_RGBA),
        visual("chassis", mesh=meshes / "bumper.stl", xyz=(-0.48, 0.0, lift + 0.091), rgba=_RAIL_RGBA, yaw=math.pi),
    ]
    parts.extend(visual(name, mesh=meshes / "wheel.stl", rgba=_TYRE_RGBA) for name in WHEELS)
    parts.extend(visual("tray", size_m=size, xyz=xyz, rgba=TRAY_RGBA) for size, xyz in _tray_boxes())
    return tuple(parts)
