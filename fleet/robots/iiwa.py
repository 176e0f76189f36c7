"""Kuka LBR iiwa 14: the seven-joint arm of the stations, read from the description in `pybullet_data`."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pybullet_data

from fleet.arrays import FloatArray
from fleet.robots.spec import ArmOutline, ArmSpec, Visual
from fleet.robots.tools import TOOLS, Tool, tool_urdf

N_JOINTS = 7
FLANGE = "lbr_iiwa_link_7"
"""Last link of the bare arm."""

# KUKA, LBR iiwa data sheet (LBR iiwa 14 R820): axis speeds [deg/s] and torques [Nm], A1 to A7.
_MAX_SPEED_DEGPS = (85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0)
_MAX_TORQUE_NM = (320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0)
# KUKA publishes no accelerations. With 12 rad/s^2 no parcel was lost in 20 of 20 simulated picks; about half of that
# keeps the path error in the millimetres and a reserve in the torques.
_MAX_ACCELERATION_RADPS2 = (5.0, 5.0, 6.0, 6.0, 8.0, 8.0, 8.0)
# Rest: the tool tip behind the base, pointing down, so that nothing reaches over the dock lane.
_HOME_TIP_X_M = -0.40
_HOME_TIP_Z_M = 0.62
_OUTLINE = ArmOutline(
    # Largest half widths of the link meshes, from their bounding boxes: shoulder 0.116, elbow 0.115, wrist 0.09 m.
    link_radii_m=(0.12, 0.12, 0.12, 0.12, 0.10, 0.09, 0.06),
    # The collision mesh of the base at a height of 7 cm, but for its plug.
    foot_m=0.107,
    # The links up to the elbow cannot come nearer to the floor than 8 cm.
    n_standing_links=3,
)


def iiwa_spec(tool: Tool | None = None) -> ArmSpec:
    """Read the arm's geometry and limits.

    Position limits are those of the description; speeds and torques those of the real iiwa 14, because the
    description allows 10 rad/s.

    Args:
        tool: What the arm holds; suction when None.

    Returns:
        The arm with that tool.
    """
    tool = tool or TOOLS["suction"]
    path = _description()
    joints = _joints(path)
    base_from_joint = np.array([_origin(joint.find("origin")) for joint in joints])
    limits = [joint.find("limit") for joint in joints]
    return ArmSpec(
        name="iiwa14",
        n_joints=N_JOINTS,
        urdf=path,
        description=iiwa_urdf(tool),
        base_from_joint=base_from_joint,
        lower_rad=np.array([float(limit.attrib["lower"]) for limit in limits if limit is not None]),
        upper_rad=np.array([float(limit.attrib["upper"]) for limit in limits if limit is not None]),
        max_velocity_radps=np.radians(_MAX_SPEED_DEGPS),
        max_acceleration_radps2=np.array(_MAX_ACCELERATION_RADPS2),
        max_torque_nm=np.array(_MAX_TORQUE_NM),
        tool_length_m=tool.length_m,
        home_rad=_home(base_from_joint, tool.length_m),
        visuals=_link_visuals(path) + tool.visuals,
        outline=_OUTLINE,
        # Joint 6's limits keep the forearm off the flange; only the convex hull of the hollow forearm says otherwise.
        touching=((5, 7),),
    )


def iiwa_urdf(tool: Tool | None = None) -> str:
    """Write the arm's description with a tool merged into it.

    A tool that hangs on a constraint instead costs a quarter more per step and slips ten times as much.

    Args:
        tool: What the arm holds; suction when None.

    Returns:
        URDF text; meshes are named by absolute path.
    """
    path = _description()
    text = path.read_text(encoding="utf-8").replace('filename="meshes/', f'filename="{path.parent.as_posix()}/meshes/')
    head, closing, _ = text.rpartition("</robot>")
    return head + tool_urdf(tool or TOOLS["suction"], FLANGE) + closing + "\n"


def _description() -> Path:
    return Path(pybullet_data.getDataPath()) / "kuka_iiwa" / "model.urdf"


def _joints(path: Path) -> list[ElementTree.Element]:
    joints = [joint for joint in ElementTree.parse(path).getroot().findall("joint") if joint.get("type") == "revolute"]
    axes = [joint.find("axis") for joint in joints]
    if len(joints) != N_JOINTS or any(axis is None or axis.attrib["xyz"] != "0 0 1" for axis in axes):
        raise ValueError(f"{path}: {len(joints)} revolute joints; valid: {N_JOINTS} joints about their own z axis")
    return joints


def _origin(element: ElementTree.Element | None) -> FloatArray:
    """URDF origin (xyz and fixed-axis roll, pitch, yaw) as a 4x4 matrix."""
    pose = np.eye(4)
    if element is None:
        return pose
    roll, pitch, yaw = (float(x) for x in element.get("rpy", "0 0 0").split())
    cr, cp, cy = math.cos(roll), math.cos(pitch), math.cos(yaw)
    sr, sp, sy = math.sin(roll), math.sin(pitch), math.sin(yaw)
    pose[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    pose[:3, 3] = [float(x) for x in element.get("xyz", "0 0 0").split()]
    return pose


def _home(base_from_joint: FloatArray, tool_length_m: float) -> FloatArray:
    """Planar two-link solution with joints 1, 3, 5, 7 at zero: elbow up, tool down behind the base."""
    step = np.linalg.norm(base_from_joint[:, :3, 3], axis=1)
    shoulder_z, upper, fore, hand = step[0] + step[1], step[2] + step[3], step[4] + step[5], step[6]
    x, z = _HOME_TIP_X_M, _HOME_TIP_Z_M + tool_length_m + hand - shoulder_z
    reach = math.hypot(x, z)
    bend = math.acos((reach**2 - upper**2 - fore**2) / (2 * upper * fore))
    # Angles from the vertical, positive to the front: the upper arm stands steeper than the line to the wrist.
    upper_tilt = math.atan2(x, z) + math.asin(fore * math.sin(bend) / reach)
    fore_tilt = upper_tilt - bend
    return np.array([0.0, upper_tilt, 0.0, upper_tilt - fore_tilt, 0.0, -math.pi - fore_tilt, 0.0])


def _link_visuals(path: Path) -> tuple[Visual, ...]:
    root = ElementTree.parse(path).getroot()
    colours = {
        material.attrib["name"]: colour.attrib["rgba"]
        for material in root.findall("material")
        if (colour := material.find("color")) is not None
    }
    visuals = []
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            mesh, material = visual.find("geometry/mesh"), visual.find("material")
            if mesh is None or material is None:
                continue
            red, green, blue, alpha = (float(x) for x in colours[material.attrib["name"]].split())
            visuals.append(
                Visual(
                    link=link.attrib["name"].removeprefix("lbr_iiwa_"),
                    mesh=path.parent / mesh.attrib["filename"],
                    size_m=(0.0, 0.0, 0.0),
                    link_from_visual=_origin(visual.find("origin")),
                    rgba=(red, green, blue, alpha),
                )
            )
    return tuple(visuals)
