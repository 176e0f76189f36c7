"""A1: Unitree's four-legged robot, which trots by position motors, with an open tray on its back."""

from __future__ import annotations

from pathlib import Path

import pybullet_data

from fleet.robots.description import fill, solid_box, spaced
from fleet.robots.differential import TwistLimits, TwistResponse
from fleet.robots.tray import Tray
from fleet.robots.twist.follower import TwistFollowerConfig
from fleet.robots.twist.spec import LeggedChassis, TwistSpec
from fleet.robots.twist.trot import LEGS, TrotConfig

_MAKER = "https://www.unitree.com/products/a1/"
_DESCRIPTION = "a1/a1.urdf in pybullet_data, Unitree's own"
_MEASURED = "measured here, `python -m fleet robots show a1`"

JOINTS = tuple(f"{leg}_{joint}_joint" for leg in LEGS for joint in ("hip", "upper", "lower"))
"""Joints in the order of `Trot.joint_targets`."""
TROT = TrotConfig(link_m=0.2, hip_m=0.085, foot_x_m=0.183, foot_y_m=0.132)
"""Legs of the description: hips 0.183 m ahead and 0.047 m aside, legs 0.085 m farther out."""
A1_FOLLOWER = TwistFollowerConfig(
    cross_per_m2=9.0,
    heading_per_m=6.0,
    lag_s=0.15,
    approach_per_s=2.0,
    creep_mps=0.04,
    stop_tolerance_m=0.01,
    turn_tolerance_rad=0.03,
    slow_radps=0.15,
)
"""Softer gains than those of wheels: a body that sways by a centimetre with every step answers after one."""

# A tray of our own on the trunk, which is 0.114 m high.
_TRAY = Tray(x_m=0.0, floor_z_m=0.004, inner_m=(0.26, 0.18, 0.06), wall_m=0.004)
"""In the frame of its underside."""
_TRAY_BOTTOM_M = 0.062
_TRAY_MASS_KG = 0.3


def a1_spec() -> TwistSpec:
    """Give sizes, limits and sources of the A1."""
    floor = TROT.height_m + TOE_RADIUS_M + _TRAY_BOTTOM_M + _TRAY.floor_z_m
    return TwistSpec(
        name="a1",
        drive="legged",
        chassis=LeggedChassis(
            description=a1_urdf(),
            joints=JOINTS,
            toe_m=TOE_RADIUS_M,
            trot=TROT,
            # Unitree, A1 motor.
            torque_nm=33.5,
            # The engine's motors are implicit: explicit torques of published gains need steps of 1/500 s.
            gains=(0.2, 0.5),
        ),
        mass_kg=12.46 + _TRAY_MASS_KG,
        max_payload_kg=3.0,
        front_m=0.30,
        rear_m=0.30,
        half_width_m=0.19,
        height_m=floor + _TRAY.inner_m[2],
        tray_x_m=_TRAY.x_m,
        tray_floor_z_m=floor,
        tray_size_m=_TRAY.inner_m,
        limits=TwistLimits(
            max_speed_mps=0.5,
            max_yaw_rate_radps=0.6,
            max_accel_mps2=0.5,
            max_brake_mps2=0.5,
            max_yaw_accel_radps2=1.0,
            max_rim_mps=0.6,
            lever_m=0.226,
            max_lateral_mps2=0.5,
        ),
        # Fitted: python -m fleet robots fit a1
        response=TwistResponse(speed_gain=1.0, speed_lag_s=0.022, yaw_gain=1.0, yaw_lag_s=0.015),
        visuals=(),
        sources={
            "mass_kg": f"12.46 kg of {_DESCRIPTION}, tray 0.3 kg",
            "max_payload_kg": f"{_MAKER} says 5 kg; less our margin, as far as tilt stays below 0.1 rad",
            "front_m": f"trunk and feet of {_DESCRIPTION}, with half a stride",
            "rear_m": f"trunk and feet of {_DESCRIPTION}, with half a stride",
            "half_width_m": f"legs of {_DESCRIPTION}, with half a stride",
            "height_m": "top of our tray on the trunk of a robot that stands",
            "max_speed_mps": f"{_MAKER} says 3.3 m/s; an open-loop trot holds 0.5 m/s, {_MEASURED}",
            "max_yaw_rate_radps": f"an open-loop trot holds 0.6 rad/s, {_MEASURED}",
            "max_accel_mps2": _MEASURED,
            "max_brake_mps2": _MEASURED,
            "max_yaw_accel_radps2": _MEASURED,
            "max_rim_mps": f"a stride of 10 cm at 3 Hz, {_MEASURED}",
            "lever_m": f"feet are 0.226 m from the middle in {_DESCRIPTION}",
            "max_lateral_mps2": _MEASURED,
        },
    )


TOE_RADIUS_M = 0.02
"""Of the balls that are the feet of the description [m]."""


def a1_urdf() -> str:
    """The description with our tray on its trunk; meshes are named by absolute path."""
    path = Path(pybullet_data.getDataPath()) / "a1" / "a1.urdf"
    text = path.read_text(encoding="utf-8").replace('filename="meshes/', f'filename="{path.parent.as_posix()}/meshes/')
    head, closing, _ = text.rpartition("</robot>")
    length, width = _TRAY.outer_m
    boxes = [_TRAY.floor(0.0), *_TRAY.plates()]
    tray = fill(
        "a1_tray",
        mass=_TRAY_MASS_KG,
        ixx=round(_TRAY_MASS_KG / 12 * width**2, 6),
        iyy=round(_TRAY_MASS_KG / 12 * length**2, 6),
        izz=round(_TRAY_MASS_KG / 12 * (length**2 + width**2), 6),
        xyz=spaced((_TRAY.x_m, 0.0, _TRAY_BOTTOM_M)),
        parts="\n".join(solid_box(size, xyz, "grey") for size, xyz in boxes),
    )
    return head + tray + closing + "\n"
