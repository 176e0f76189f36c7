"""A1: Unitree's four-legged robot, which trots by position motors, with an open tray on its back."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pybullet_data

from fleet.arrays import FloatArray
from fleet.robots.description import fill, solid_box, spaced
from fleet.robots.differential import LeggedChassis, TrotConfig, TwistFollowerConfig, TwistLimits, TwistResponse
from fleet.robots.spec import Visual, visual
from fleet.robots.tray import TRAY_RGBA, Tray, Triple
from fleet.robots.twist.spec import TwistSpec
from fleet.robots.twist.trot import LEGS, two_links

_MAKER = "https://www.unitree.com/products/a1/"
_DESCRIPTION = "a1/a1.urdf in pybullet_data, Unitree's own"
_MEASURED = "measured here, `python -m fleet robots show a1`"

JOINTS = tuple(f"{leg}_{joint}_joint" for leg in LEGS for joint in ("hip", "upper", "lower"))
"""Joints in the order of `Trot.joint_targets`."""
TROT = TrotConfig(link_m=0.2, hip_m=0.085, foot_x_m=0.183, foot_y_m=0.132)
"""Legs of the description: hips 0.183 m ahead and 0.047 m aside, legs 0.085 m farther out."""
TOE_RADIUS_M = 0.02
"""Of the balls that are the feet of the description [m]."""
A1_FOLLOWER = TwistFollowerConfig(
    cross_per_m2=9.0,
    heading_per_m=6.0,
    lag_s=0.15,
    approach_per_s=2.0,
    creep_mps=0.08,
    stop_tolerance_m=0.01,
    turn_tolerance_rad=0.03,
    slow_radps=0.15,
)
"""Softer gains than those of wheels: a body that sways by a centimetre with every step answers after one.

It comes to stops faster than wheels do: with half of that speed, sway decided when it was there, and arrivals spread
twice as far.
"""

_HIP_Z_M = TROT.height_m + TOE_RADIUS_M
"""Of the hips, and of the middle of the trunk, above the floor."""
_TRUNK_M = (0.267, 0.194, 0.114)
"""The trunk's box in the description."""
_LEG_M = 0.035
"""How thick legs are drawn, and how far knees are taken to reach out."""
# A tray of our own on the trunk, with a mat of rubber: steps shake parcels along anything smoother.
_TRAY_BOTTOM_M = _HIP_Z_M + 0.062
TRAY = Tray(x_m=0.0, floor_z_m=_TRAY_BOTTOM_M + 0.004, inner_m=(0.26, 0.18, 0.06), wall_m=0.004)
_TRAY_MASS_KG = 0.3

_BODY_RGBA = (0.75, 0.33, 0.05, 1.0)
_LEG_RGBA = (0.20, 0.20, 0.20, 1.0)


def a1_spec() -> TwistSpec:
    """Give sizes, limits and sources of the A1."""
    return TwistSpec(
        name="a1",
        drive="legged",
        chassis=a1_chassis(),
        mass_kg=12.46 + _TRAY_MASS_KG,
        max_payload_kg=3.0,
        front_m=0.30,
        rear_m=0.30,
        half_width_m=0.19,
        height_m=TRAY.top_z_m,
        tray_x_m=TRAY.x_m,
        tray_floor_z_m=TRAY.floor_z_m,
        tray_size_m=TRAY.inner_m,
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
        # Fitted: python -m fleet robots fit a1; its speed is 1.6 % more than told on straights, and less in curves.
        response=TwistResponse(speed_gain=1.005, speed_lag_s=0.022, yaw_gain=1.0, yaw_lag_s=0.015),
        visuals=_visuals(),
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


def a1_chassis() -> LeggedChassis:
    """Give what engines build and drive it by."""
    return LeggedChassis(
        description=a1_urdf(),
        joints=JOINTS,
        hip_z_m=_HIP_Z_M,
        trot=TROT,
        # Unitree, A1 motor.
        torque_nm=33.5,
        # The engine's motors are implicit: explicit torques of published gains need steps of 1/500 s.
        gains=(0.2, 0.5),
    )


def a1_urdf() -> str:
    """The description with our tray on its trunk; meshes are named by absolute path.

    Its base frame is moved from the trunk's middle to the floor below a robot that stands, as that of any car.
    """
    path = Path(pybullet_data.getDataPath()) / "a1" / "a1.urdf"
    text = path.read_text(encoding="utf-8").replace('filename="meshes/', f'filename="{path.parent.as_posix()}/meshes/')
    length, width = TRAY.outer_m
    robot = ElementTree.fromstring(text)
    trunk = next(link for link in robot.iter("link") if link.get("name") == "trunk")
    from_trunk = (joint for joint in robot.iter("joint") if _parent(joint) == "trunk")
    for part in (*trunk, *from_trunk):
        origin = part.find("origin")
        if origin is not None:
            x, y, z = (float(number) for number in origin.get("xyz", "0 0 0").split())
            origin.set("xyz", spaced((x, y, round(z + _HIP_Z_M, 9))))
    head, closing, _ = ElementTree.tostring(robot, encoding="unicode").rpartition("</robot>")
    tray = fill(
        "a1_tray",
        mass=_TRAY_MASS_KG,
        ixx=round(_TRAY_MASS_KG / 12 * width**2, 6),
        iyy=round(_TRAY_MASS_KG / 12 * length**2, 6),
        izz=round(_TRAY_MASS_KG / 12 * (length**2 + width**2), 6),
        com=spaced((TRAY.x_m, 0.0, _TRAY_BOTTOM_M)),
        parts="\n".join(solid_box(size, xyz, "grey") for size, xyz in _tray_boxes()),
    )
    return head + tray + closing + "\n"


def body_boxes() -> FloatArray:
    """Give the boxes that stand for it where nothing looks at its legs one by one: trunk, tray, front and hind legs.

    Returns:
        Lowest and highest corners in its frame [m], shape (k, 2, 3).
    """
    across = 2 * TROT.foot_y_m + _LEG_M
    pair: Triple = (2 * _LEG_M + TROT.link_m / 2, across, _HIP_Z_M)
    legs = [(pair, (end * TROT.foot_x_m, 0.0, _HIP_Z_M / 2)) for end in (1.0, -1.0)]
    boxes = np.array([(_TRUNK_M, (0.0, 0.0, _HIP_Z_M)), *legs, *_tray_boxes()])
    sizes, centres = boxes[:, 0], boxes[:, 1]
    return np.stack((centres - sizes / 2, centres + sizes / 2), axis=1)


def _parent(joint: ElementTree.Element) -> str | None:
    parent = joint.find("parent")
    return None if parent is None else parent.get("link")


def _tray_boxes() -> list[tuple[Triple, Triple]]:
    return [TRAY.floor(_TRAY_BOTTOM_M), *TRAY.plates()]


def _visuals() -> tuple[Visual, ...]:
    """Trunk, legs as they stand, and tray."""
    parts = [visual("chassis", rgba=_BODY_RGBA, size_m=_TRUNK_M, xyz=(0.0, 0.0, _HIP_Z_M))]
    hip, knee = two_links(TROT.link_m, 0.0, TROT.height_m)
    for x in (TROT.foot_x_m, -TROT.foot_x_m):
        for y in (TROT.foot_y_m, -TROT.foot_y_m):
            inner = math.copysign((TROT.foot_y_m + _TRUNK_M[1] / 2) / 2, y)
            parts.append(visual("chassis", rgba=_BODY_RGBA, size_m=(0.08, TROT.hip_m, 0.08), xyz=(x, inner, _HIP_Z_M)))
            top = np.array([x, y, _HIP_Z_M])
            for pitch in (hip, hip + knee):
                end = top - TROT.link_m * np.array([math.sin(pitch), 0.0, math.cos(pitch)])
                parts.append(_bar(top, end, pitch))
                top = end
    return (*parts, *(visual("tray", rgba=TRAY_RGBA, size_m=size, xyz=xyz) for size, xyz in _tray_boxes()))


def _bar(top: FloatArray, end: FloatArray, pitch: float) -> Visual:
    """A part of a leg from one joint to the next, pitched about y [m, rad]."""
    pose = np.eye(4)
    sin, cos = math.sin(pitch), math.cos(pitch)
    pose[:3, :3] = [[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]]
    pose[:3, 3] = (top + end) / 2
    size = (_LEG_M, _LEG_M, TROT.link_m)
    return Visual(link="chassis", mesh=None, size_m=size, link_from_visual=pose, rgba=_LEG_RGBA)
