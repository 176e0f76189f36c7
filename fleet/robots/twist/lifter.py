"""Lifter: a low vehicle that drives under a shelf pod and lifts it."""

from __future__ import annotations

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.description import box_inertia, fill, rollers, solid_box, spaced, supports
from fleet.robots.differential import SkidChassis, SkidSteer, TwistLimits, TwistResponse
from fleet.robots.spec import Visual, visual
from fleet.robots.twist.pod import LIFT_FORCE_N, LIFT_M, LIFT_MPS
from fleet.robots.twist.spec import TwistSpec

_SPECTRUM = "https://spectrum.ieee.org/three-engineers-hundreds-of-robots-one-warehouse"
_OWN = "our own description"

ROLLERS = ("left_roller", "right_roller")
"""What drives it, as the Husky's; each spins in the joint ``<link>_spin``, forward where positive."""

_BODY_M = (0.75, 0.60, 0.20)
_BODY_Z_M = 0.16
_PLATE_M = (0.45, 0.45, 0.03)
_PLATE_Z_M = 0.285
"""Middle of the plate when it is down, above the floor."""
_ROLLER_Y_M = 0.26
_ROLLER_RADIUS_M = 0.10
_SUPPORT_X_M, _SUPPORT_Y_M = 0.30, 0.20
_RAISED_M = 0.001
_BODY_MASS_KG, _ROLLER_MASS_KG = 60.0, 2.0
_PLATE_MASS_KG = 50.0
"""Of all that moves with the plate. With 30 iterations the engine's solver lifts about three times as much: a plate of
20 kg lifted 60 kg and not 150, one of 6 kg wanted 100 iterations."""
# As the Husky's rollers: both hold the same line sideways, and press against each other along it.
_ROLLER_FRICTION = 1.5
SKID = SkidSteer(separation_m=2 * _ROLLER_Y_M, multiplier=1.0, contact_track_m=2 * _ROLLER_Y_M)
"""Wheels on the middle line and castors: nothing scrubs."""

WHEELBASE_M, TRACK_M, WHEEL_RADIUS_M = 2 * _SUPPORT_X_M, 2 * _ROLLER_Y_M, _ROLLER_RADIUS_M
"""From the castors behind to those ahead, and between the wheels."""

_BODY_RGBA = (0.85, 0.45, 0.10, 1.0)
_PLATE_RGBA = (0.30, 0.30, 0.30, 1.0)


def lifter_spec() -> TwistSpec:
    """Give sizes, limits and sources of the lifter."""
    half_length, half_width = _BODY_M[0] / 2, _BODY_M[1] / 2
    top = _PLATE_Z_M + _PLATE_M[2] / 2
    return TwistSpec(
        name="lifter",
        drive="differential",
        chassis=SkidChassis(
            description=lifter_urdf(),
            rollers=ROLLERS,
            supports=("supports",),
            radius_m=_ROLLER_RADIUS_M,
            skid=SKID,
            torque_nm=60.0,
        ),
        mass_kg=_BODY_MASS_KG + _PLATE_MASS_KG + 2 * _ROLLER_MASS_KG,
        max_payload_kg=120.0,
        front_m=half_length,
        rear_m=half_length,
        half_width_m=half_width,
        height_m=top,
        tray_x_m=0.0,
        tray_floor_z_m=top,
        tray_size_m=(_PLATE_M[0], _PLATE_M[1], 0.0),
        limits=TwistLimits(
            max_speed_mps=1.0,
            max_yaw_rate_radps=1.0,
            max_accel_mps2=0.5,
            max_brake_mps2=0.5,
            max_yaw_accel_radps2=2.0,
            max_rim_mps=1.2,
            lever_m=SKID.lever_m,
            max_lateral_mps2=0.2,
        ),
        # Fitted: python -m fleet robots fit lifter
        response=TwistResponse(speed_gain=1.0, speed_lag_s=0.014, yaw_gain=0.998, yaw_lag_s=0.009),
        visuals=_visuals(),
        sources={
            "mass_kg": _OWN,
            "max_payload_kg": f"{_OWN}: a full pod and a fifth; {_SPECTRUM}: 1000 lb, 450 kg",
            "front_m": f"{_OWN}: it turns under a pod without leaving the pod's square",
            "rear_m": f"{_OWN}: it turns under a pod without leaving the pod's square",
            "half_width_m": f"{_OWN}: between the legs of a pod, 8 cm from each",
            "height_m": f"{_OWN}: 2 cm under a pod's lowest shelf",
            "max_speed_mps": f"{_SPECTRUM}: 1.3 m/s; less our margin",
            "max_rim_mps": f"{_OWN}: top speed and a fifth",
            "max_yaw_rate_radps": _OWN,
            "max_yaw_accel_radps2": "for the pod's sake: its corner is 0.60 m from the middle",
            "max_accel_mps2": "for the pod's sake: its centre of mass is higher than its legs are apart",
            "max_brake_mps2": "as max_accel_mps2",
            "lever_m": f"half of the track of {_OWN}",
            "max_lateral_mps2": "curves of 0.5 m at 0.3 m/s: with more the yaw acceleration would cut them",
        },
    )


def lifter_urdf() -> str:
    """Write the description: a box on two rollers and four supports without friction, as the Husky's, and a lift."""
    places = [(x, y, _ROLLER_RADIUS_M) for x in (_SUPPORT_X_M, -_SUPPORT_X_M) for y in (_SUPPORT_Y_M, -_SUPPORT_Y_M)]
    ixx, iyy, izz = box_inertia(_BODY_MASS_KG, _BODY_M)
    plate_ixx, plate_iyy, plate_izz = box_inertia(_PLATE_MASS_KG, _PLATE_M)
    return fill(
        "lifter",
        body_mass=_BODY_MASS_KG,
        body_com=spaced((0.0, 0.0, _BODY_Z_M)),
        ixx=ixx,
        iyy=iyy,
        izz=izz,
        body=solid_box(_BODY_M, (0.0, 0.0, _BODY_Z_M), "body"),
        supports=supports(places, _ROLLER_RADIUS_M - _RAISED_M),
        rollers=rollers(
            ROLLERS,
            half_track_m=_ROLLER_Y_M,
            radius_m=_ROLLER_RADIUS_M,
            friction=_ROLLER_FRICTION,
            mass_kg=_ROLLER_MASS_KG,
            inertia=round(0.4 * _ROLLER_MASS_KG * _ROLLER_RADIUS_M**2, 6),
        ),
        plate_mass=_PLATE_MASS_KG,
        plate_ixx=plate_ixx,
        plate_iyy=plate_iyy,
        plate_izz=plate_izz,
        plate_xyz=spaced((0.0, 0.0, _PLATE_Z_M)),
        plate=solid_box(_PLATE_M, (0.0, 0.0, 0.0), "plate"),
        lift_m=LIFT_M,
        lift_force_n=LIFT_FORCE_N,
        lift_mps=LIFT_MPS,
    )


def body_boxes() -> FloatArray:
    """Give the boxes with which it collides: its body, and the plate when it is down [m], shape (2, 2, 3)."""
    boxes = []
    for (length, width, height), z in ((_BODY_M, _BODY_Z_M), (_PLATE_M, _PLATE_Z_M)):
        half, middle = np.array([length, width, height]) / 2, np.array([0.0, 0.0, z])
        boxes.append([middle - half, middle + half])
    return np.array(boxes)


def _visuals() -> tuple[Visual, ...]:
    return (
        visual("chassis", rgba=_BODY_RGBA, size_m=_BODY_M, xyz=(0.0, 0.0, _BODY_Z_M)),
        visual("tray", rgba=_PLATE_RGBA, size_m=_PLATE_M, xyz=(0.0, 0.0, _PLATE_Z_M)),
    )
