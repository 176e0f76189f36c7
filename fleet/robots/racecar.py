"""Racecar: the Ackermann car of the fleet, 1:10 scale, with an open tray for one parcel."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pybullet_data

from fleet.arrays import FloatArray
from fleet.robots.description import fill, spaced
from fleet.robots.model import WheelShape
from fleet.robots.spec import CarSpec, Visual

# Wheelbase, track, radius, wheel masses and mesh places: racecar/racecar.urdf in pybullet_data, the MIT RACECAR.
_WHEELBASE_M = 0.325
_TRACK_M = 0.2
_RADIUS_M = 0.05
_WHEEL_WIDTH_M = 0.045
# The stock chassis has no collision shape: this box covers chassis, wheels and bumpers.
_CHASSIS_SIZE_M = (0.50, 0.28, 0.08)
_CHASSIS_CENTRE_M = (0.16, 0.0, 0.07)
_TRAY_X_M = 0.16
_TRAY_FLOOR_M = 0.18
_TRAY_INNER_M = (0.30, 0.22, 0.07)
_WALL_M = 0.005
# Base mass and inertia: 4.2 kg of stock chassis at axle height (0.1477 m ahead for 4.0 kg of it), lidar 0.13 kg,
# tray 0.4 kg, brought to the common centre of mass with the parallel-axis theorem.
_BASE_MASS_KG = 4.73
_BASE_COM_M = (0.1457, 0.0, 0.0648)
_BASE_INERTIA = (0.0223, 0.0687, 0.0697)
# Rubber on a warehouse floor; Bullet multiplies the coefficients of the two bodies (the floor has 1.0).
_TYRE_FRICTION = 0.9
_BODY_FRICTION = 0.8

WHEELS = ("rear_left", "rear_right", "front_left", "front_right")
"""Wheel links, in the order of `wheel_places`; each spins in the joint ``<link>_spin``."""
HINGES = ("left_steer", "right_steer")
"""Steering joints of the front wheels, positive to the left."""

_BODY_RGBA = (0.10, 0.25, 0.60, 1.0)
_TYRE_RGBA = (0.08, 0.08, 0.08, 1.0)
_TRAY_RGBA = (0.85, 0.60, 0.15, 1.0)
_SENSOR_RGBA = (0.2, 0.2, 0.2, 1.0)


def wheel_places(spec: CarSpec) -> FloatArray:
    """Give the wheel centres in the car's frame.

    Args:
        spec: The car.

    Returns:
        Centres x, y, z [m] in the order of `WHEELS`, shape (4, 3).
    """
    y = spec.track_m / 2
    return np.array([[x, side * y, spec.wheel_radius_m] for x in (0.0, spec.wheelbase_m) for side in (1.0, -1.0)])


def body_boxes() -> FloatArray:
    """Give the boxes with which a car's body collides: chassis, block below the tray, walls of the tray.

    Returns:
        Lowest and highest corners in the car's frame [m], shape (6, 2, 3).
    """
    plates = [(size, xyz) for size, xyz in _tray_boxes() if not _is_floor(size)]
    boxes = np.array([(_CHASSIS_SIZE_M, _CHASSIS_CENTRE_M), _support(), *plates])
    sizes, centres = boxes[:, 0], boxes[:, 1]
    return np.stack((centres - sizes / 2, centres + sizes / 2), axis=1)


def racecar_spec() -> CarSpec:
    """Give sizes and limits of the racecar.

    Limits and their source: speed 2 m/s is the fastest at which a pure-pursuit controller was measured to hold a track
    (3 cm at a 1 m radius); 1.5 m/s^2 kept an unsecured parcel in the tray in every one of 810 trials, braking may be
    harder because the tray has walls; the steering limit is the bicycle angle at which the inner hinge meets its stop
    at 1 rad (0.81 rad), less a margin; the steering rate is that of a hobby servo (0.17 s for 60 degrees), derated by
    a third for the load.
    """
    length, _, _ = _CHASSIS_SIZE_M
    return CarSpec(
        name="racecar",
        wheelbase_m=_WHEELBASE_M,
        track_m=_TRACK_M,
        wheel_radius_m=_RADIUS_M,
        front_m=_CHASSIS_CENTRE_M[0] + length / 2,
        rear_m=length / 2 - _CHASSIS_CENTRE_M[0],
        half_width_m=_CHASSIS_SIZE_M[1] / 2,
        height_m=_TRAY_FLOOR_M + _TRAY_INNER_M[2],
        max_speed_mps=2.0,
        max_accel_mps2=1.5,
        max_brake_mps2=2.5,
        max_steering_rad=0.8,
        max_steering_rate_radps=4.0,
        tray_x_m=_TRAY_X_M,
        tray_floor_z_m=_TRAY_FLOOR_M,
        tray_size_m=_TRAY_INNER_M,
        tray_wall_m=_WALL_M,
        max_payload_kg=2.0,
        visuals=_visuals(),
    )


def racecar_urdf(wheels: WheelShape = "sphere") -> str:
    """Write the car's description.

    Args:
        wheels: Collision shape of the wheels. A sphere touches the floor in one point and costs less than half of a
            cylinder per physics step at the same tracking error.

    Returns:
        URDF text; meshes are named by absolute path.

    Raises:
        ValueError: Unknown wheel shape.
    """
    if wheels == "sphere":
        geometry = f'<sphere radius="{_RADIUS_M}"/>'
    elif wheels == "cylinder":
        geometry = f'<cylinder radius="{_RADIUS_M}" length="{_WHEEL_WIDTH_M}"/>'
    else:
        raise ValueError(f"racecar wheel shape is {wheels!r}; valid: 'sphere', 'cylinder'")
    meshes = _meshes().as_posix()
    parts = []
    for side, y in (("left", _TRACK_M / 2), ("right", -_TRACK_M / 2)):
        parts.append(fill("racecar_hinge", side=side, xyz=spaced((_WHEELBASE_M, y, _RADIUS_M))))
        mounts = (("rear", "chassis", (0.0, y, _RADIUS_M)), ("front", f"{side}_hinge", (0.0, 0.0, 0.0)))
        for axle, parent, place in mounts:
            parts.append(
                fill(
                    "racecar_wheel",
                    name=f"{axle}_{side}",
                    parent=parent,
                    xyz=spaced(place),
                    mesh=f"{side}_{axle}_wheel.obj",
                    meshes=meshes,
                    geometry=geometry,
                    friction=_TYRE_FRICTION,
                )
            )
    support_size, support_xyz = _support()
    return fill(
        "racecar",
        meshes=meshes,
        radius=_RADIUS_M,
        base_mass=_BASE_MASS_KG,
        com_x=_BASE_COM_M[0],
        com_z=_BASE_COM_M[2],
        ixx=_BASE_INERTIA[0],
        iyy=_BASE_INERTIA[1],
        izz=_BASE_INERTIA[2],
        body_friction=_BODY_FRICTION,
        chassis_xyz=spaced(_CHASSIS_CENTRE_M),
        chassis_size=spaced(_CHASSIS_SIZE_M),
        support_xyz=spaced(support_xyz),
        support_size=spaced(support_size),
        tray_parts="\n".join(_tray_part(size, xyz) for size, xyz in _tray_boxes()),
        wheels="".join(parts),
    )


def _meshes() -> Path:
    return Path(pybullet_data.getDataPath()) / "racecar" / "meshes"


def _support() -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Size and centre of the block between chassis and tray floor: a floor too thick to be pressed through."""
    bottom = _CHASSIS_CENTRE_M[2] + _CHASSIS_SIZE_M[2] / 2
    length, width, _ = _TRAY_INNER_M
    size = (length + 2 * _WALL_M, width + 2 * _WALL_M, _TRAY_FLOOR_M - bottom)
    return size, (_TRAY_X_M, 0.0, (_TRAY_FLOOR_M + bottom) / 2)


def _tray_boxes() -> list[tuple[tuple[float, float, float], tuple[float, float, float]]]:
    """Size and centre of the drawn floor plate and the four walls."""
    length, width, wall = _TRAY_INNER_M
    outer = (length + 2 * _WALL_M, width + 2 * _WALL_M)
    middle = _TRAY_FLOOR_M + wall / 2
    boxes = [((outer[0], outer[1], _WALL_M), (_TRAY_X_M, 0.0, _TRAY_FLOOR_M - _WALL_M / 2))]
    for side in (1.0, -1.0):
        boxes.append(((_WALL_M, outer[1], wall), (_TRAY_X_M + side * (length + _WALL_M) / 2, 0.0, middle)))
        boxes.append(((length, _WALL_M, wall), (_TRAY_X_M, side * (width + _WALL_M) / 2, middle)))
    return boxes


def _tray_part(size: tuple[float, float, float], xyz: tuple[float, float, float]) -> str:
    shape = f'<origin xyz="{spaced(xyz)}"/><geometry><box size="{spaced(size)}"/></geometry>'
    visual = f'    <visual>{shape}<material name="tray"/></visual>'
    return visual if _is_floor(size) else f"{visual}\n    <collision>{shape}</collision>"


def _is_floor(size: tuple[float, float, float]) -> bool:
    """Whether a box of the tray is its floor: the top of the support block, which collides in its place."""
    return size[2] == _WALL_M


def _visuals() -> tuple[Visual, ...]:
    meshes = _meshes()
    none = (0.0, 0.0, 0.0)
    parts = [
        _visual("chassis", meshes / "chassis.STL", none, (0.0, 0.0, _RADIUS_M), _BODY_RGBA),
        _visual("chassis", meshes / "hokuyo.obj", none, (0.265, 0.0, 0.125), _SENSOR_RGBA),
    ]
    for name in WHEELS:
        axle, side = name.split("_")
        mesh = meshes / f"{side}_{axle}_wheel.obj"
        parts.append(_visual(name, mesh, none, (0.0, 0.0, 0.0), _TYRE_RGBA, roll=math.pi / 2))
    parts.extend(_visual("tray", None, size, xyz, _TRAY_RGBA) for size, xyz in _tray_boxes())
    return tuple(parts)


def _visual(
    link: str,
    mesh: Path | None,
    size: tuple[float, float, float],
    xyz: tuple[float, float, float],
    rgba: tuple[float, float, float, float],
    roll: float = 0.0,
) -> Visual:
    pose = np.eye(4)
    c, s = math.cos(roll), math.sin(roll)
    pose[1:3, 1:3] = [[c, -s], [s, c]]
    pose[:3, 3] = xyz
    return Visual(link=link, mesh=mesh, size_m=size, link_from_visual=pose, rgba=rgba)
