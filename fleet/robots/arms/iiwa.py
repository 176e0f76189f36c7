"""Kuka LBR iiwa 14: the seven-joint arm of the stations, read from the description in `pybullet_data`."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pybullet_data

from fleet.arrays import FloatArray
from fleet.robots.arms.home import HOME_TIP_M
from fleet.robots.arms.kind import ArmKind
from fleet.robots.arms.spec import ArmOutline, UsualService


def _home(base_from_joint: FloatArray, lower: FloatArray, upper: FloatArray, tool_length_m: float) -> FloatArray:
    """Planar two-link solution with joints 1, 3, 5, 7 at zero: elbow up, tool down behind the base."""
    del lower, upper
    step = np.linalg.norm(base_from_joint[:, :3, 3], axis=1)
    shoulder_z, upper_arm, fore, hand = step[0] + step[1], step[2] + step[3], step[4] + step[5], step[6]
    x, z = HOME_TIP_M[0], HOME_TIP_M[1] + tool_length_m + hand - shoulder_z
    reach = math.hypot(x, z)
    bend = math.acos((reach**2 - upper_arm**2 - fore**2) / (2 * upper_arm * fore))
    # Angles from the vertical, positive to the front: the upper arm stands steeper than the line to the wrist.
    upper_tilt = math.atan2(x, z) + math.asin(fore * math.sin(bend) / reach)
    fore_tilt = upper_tilt - bend
    return np.array([0.0, upper_tilt, 0.0, upper_tilt - fore_tilt, 0.0, -math.pi - fore_tilt, 0.0])


IIWA = ArmKind(
    name="iiwa",
    title="KUKA LBR iiwa 14 R820",
    source="KUKA, LBR iiwa data sheet, LBR iiwa 14 R820",
    urdf=Path(pybullet_data.getDataPath()) / "kuka_iiwa" / "model.urdf",
    flange="lbr_iiwa_link_7",
    # The housing of the media flange ends 45 mm beyond the frame of the last link.
    mount_m=0.045,
    # KUKA, LBR iiwa data sheet (LBR iiwa 14 R820): axis speeds and torques, A1 to A7; the description allows 10 rad/s.
    max_velocity_radps=tuple(np.radians((85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0)).tolist()),
    # KUKA publishes no accelerations. With 12 rad/s^2 no parcel was lost in 20 of 20 simulated picks; about half of
    # that keeps the path error in the millimetres and a reserve in the torques.
    max_acceleration_radps2=(5.0, 5.0, 6.0, 6.0, 8.0, 8.0, 8.0),
    max_torque_nm=(320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0),
    payload_kg=14.0,
    # Farther out, a tool that points down cannot be lifted over what it carries; nearer, the arm is in its own way.
    reach_m=(0.35, 0.65),
    home=_home,
    outline=ArmOutline(
        # Largest half widths of the link meshes, from their bounding boxes: shoulder 0.116, elbow 0.115, wrist 0.09 m.
        link_radii_m=(0.12, 0.12, 0.12, 0.12, 0.10, 0.09, 0.06),
        # The collision mesh of the base at a height of 7 cm, but for its plug.
        foot_m=0.107,
        # The links up to the elbow cannot come nearer to the floor than 8 cm.
        n_standing_links=3,
    ),
    # On shipped sites with suction means were 6.5 to 7.1 s, percentiles at most 7.6 s.
    service=UsualService(mean_s=7.0, p90_s=8.0, load_s=3.1, unload_s=5.9),
    # More would fit closer and check slower.
    spheres_per_link=(3, 4, 4, 4, 4, 4, 3, 2),
    # Joint 6's limits keep the forearm off the flange; only the convex hull of the hollow forearm says otherwise.
    touching=((5, 7),),
)
