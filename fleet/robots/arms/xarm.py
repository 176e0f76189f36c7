"""UFACTORY xArm 6: a six-joint arm, read from the description in `pybullet_data`."""

from __future__ import annotations

import math
from pathlib import Path

import pybullet_data

from fleet.robots.arms.home import behind_the_base
from fleet.robots.arms.kind import ArmKind
from fleet.robots.arms.spec import ArmOutline, UsualService

# Joints 1, 4 and 6 of the real arm turn by 360 degrees either way. Half a turn reaches everything, and keeps cables and
# searches short; joint 1 has a little more, so that the arm need not turn back behind its base.
_TURN_RAD = math.radians(180.0)
_BASE_TURN_RAD = math.radians(225.0)

XARM = ArmKind(
    name="xarm",
    title="UFACTORY xArm 6",
    source="UFACTORY, xArm 6 user manual",
    urdf=Path(pybullet_data.getDataPath()) / "xarm" / "xarm6_robot.urdf",
    flange="link6",
    # The frame of the last link lies in the flange's face.
    mount_m=0.0,
    # UFACTORY, xArm 6 user manual: 180 deg/s and 1145 deg/s^2 for every joint; torques and limits of the description.
    lower_rad=(-_BASE_TURN_RAD, -2.059, -3.927, -_TURN_RAD, -1.69297, -_TURN_RAD),
    upper_rad=(_BASE_TURN_RAD, 2.0944, 0.19198, _TURN_RAD, math.pi, _TURN_RAD),
    max_velocity_radps=(math.radians(180.0),) * 6,
    max_acceleration_radps2=(math.radians(1145.0),) * 6,
    max_torque_nm=(50.0, 50.0, 32.0, 32.0, 32.0, 20.0),
    # UFACTORY, xArm 6 data sheet.
    payload_kg=5.0,
    # With the flange it reaches 0.70 m from its shoulder: on the floor, a tool that points down could not be lifted
    # out of a tray 0.6 m away; on the stand it could at 0.65 m, and 2 cm beside that.
    reach_m=(0.35, 0.65),
    stand_m=0.15,
    home=behind_the_base(math.pi, -0.2, -1.4, 0.0, 1.6, 0.0, z_m=0.42),
    outline=ArmOutline(
        # Farthest corners of the collision meshes' bounding boxes from the joints' axes, rounded up.
        link_radii_m=(0.10, 0.10, 0.10, 0.09, 0.09, 0.06),
        # Half the width of the stand, which is what a car's lidar sees.
        foot_m=0.09,
        # On its stand, links up to the elbow stay off the floor.
        n_standing_links=2,
    ),
    # On `small` and `medium` with suction means were 5.6 to 5.8 s, percentiles at most 6.5 s.
    service=UsualService(mean_s=6.0, p90_s=7.0, load_s=2.4, unload_s=5.1),
)
