"""Franka Emika Panda, read from the description in `pybullet_data`; at stations without its own hand."""

from __future__ import annotations

from pathlib import Path

import pybullet_data

from fleet.robots.arms.home import behind_the_base
from fleet.robots.arms.kind import ArmKind, OwnHand
from fleet.robots.arms.spec import ArmOutline, UsualService
from fleet.robots.tools import CARDBOARD_FRICTION, Tool

_FLANGE_M = 0.107
"""From the last joint to the flange [m]: Franka Emika, FCI documentation, flange frame."""
_FINGER_TRAVEL_M = 0.04
_TURN_RAD = -0.7853981633974483

_HAND = OwnHand(
    tool=Tool(
        name="friction",
        mount_m=_FLANGE_M,
        # To between the finger tips: FCI documentation, hand frame.
        length_m=_FLANGE_M + 0.1034,
        force_n=25.0,
        force_share=2 * 1.2 * CARDBOARD_FRICTION,
        touch_links=("panda_leftfinger", "panda_rightfinger"),
        finger_joints=("panda_finger_joint1", "panda_finger_joint2"),
        # Mounted an eighth of a turn about the last joint's axis; its fingers open along its y.
        finger_turn_rad=_TURN_RAD,
        finger_travel_m=_FINGER_TRAVEL_M,
        half_width_m=0.105,
        visuals=(),
    ),
    # Extents of the description's collision meshes, rounded up to a millimetre.
    boxes_m=(
        ((-0.032, -0.104, 0.081), (0.032, 0.101, 0.173), (2, 5, 2)),
        ((-0.011, 0.040, 0.165), (0.011, 0.067, 0.220), (2, 2, 4)),
        ((-0.011, -0.067, 0.165), (0.011, -0.040, 0.220), (2, 2, 4)),
    ),
    open_at={"panda_finger_joint1": _FINGER_TRAVEL_M, "panda_finger_joint2": _FINGER_TRAVEL_M},
    home_rad=(0.0, -0.6, 0.0, -2.4, 0.0, 1.8, 0.785),
)

PANDA = ArmKind(
    name="panda",
    title="Franka Emika Panda",
    source="Franka Emika, Panda data sheet",
    urdf=Path(pybullet_data.getDataPath()) / "franka_panda" / "panda.urdf",
    flange="panda_link7",
    mount_m=_FLANGE_M,
    # Franka Emika, FCI documentation, "Limits for Panda": joint space limits. The description rounds the position
    # limits outwards, joint 4 to zero, where the forearm would lie on the upper arm.
    lower_rad=(-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
    upper_rad=(2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
    max_velocity_radps=(2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61),
    max_acceleration_radps2=(15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0),
    max_torque_nm=(87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0),
    # Franka Emika, Panda data sheet.
    payload_kg=3.0,
    reach_m=(0.35, 0.65),
    home=behind_the_base(2.4, 0.3, 0.9, -2.2, -0.5, 2.3, 0.8),
    outline=ArmOutline(
        # Farthest corners of the collision meshes' bounding boxes from the joints' axes, rounded up.
        link_radii_m=(0.14, 0.14, 0.15, 0.15, 0.14, 0.14, 0.10),
        # Half the width of the base's mesh.
        foot_m=0.1,
        # With the shoulder at its limit the elbow is 0.27 m high.
        n_standing_links=3,
    ),
    # On `small` and `medium` with suction means were 5.6 s, percentiles at most 5.7 s; fingers take 0.4 s longer.
    service=UsualService(mean_s=6.0, p90_s=6.5, load_s=2.8, unload_s=5.2),
    # Their hulls overlap by 4 mm in every ordinary posture; the links themselves are apart.
    touching=((5, 7),),
    hand=_HAND,
)
