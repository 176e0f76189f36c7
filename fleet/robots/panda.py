"""Franka Emika Panda with its own hand, read from the description in `pybullet_data`."""

from __future__ import annotations

import re
from pathlib import Path

import pybullet_data

from fleet.robots.spec import ArmOutline
from fleet.robots.tools import CARDBOARD_FRICTION, Tool

FINGER_TRAVEL_M = 0.04
TIP_M = 0.107 + 0.1034
"""From the last joint to between the finger tips [m]: Franka Emika, FCI documentation, flange and hand frames."""
HAND_TURN_RAD = -0.7853981633974483
"""The hand is mounted an eighth of a turn about the last joint's axis; its fingers open along its y."""

PANDA_HAND = Tool(
    name="friction",
    length_m=TIP_M,
    force_n=25.0,
    force_share=2 * 1.2 * CARDBOARD_FRICTION,
    touch_links=("panda_leftfinger", "panda_rightfinger"),
    finger_joints=("panda_finger_joint1", "panda_finger_joint2"),
    finger_travel_m=FINGER_TRAVEL_M,
    half_width_m=0.105,
    visuals=(),
)
"""Two fingers with a stroke of 80 mm."""

PANDA_OUTLINE = ArmOutline(
    # Farthest corners of the collision meshes' bounding boxes from the joints' axes, rounded up.
    link_radii_m=(0.14, 0.14, 0.15, 0.15, 0.14, 0.14, 0.10),
    # Half the width of the base's mesh.
    foot_m=0.1,
    # With the shoulder at its limit the elbow is 0.27 m high.
    n_standing_links=3,
)

PANDA_HAND_BOXES_M = (
    ((-0.032, -0.104, 0.081), (0.032, 0.101, 0.173), (2, 5, 2)),
    ((-0.011, 0.040, 0.165), (0.011, 0.067, 0.220), (2, 2, 4)),
    ((-0.011, -0.067, 0.165), (0.011, -0.040, 0.220), (2, 2, 4)),
)
"""Hand and open fingers as boxes: lowest and highest corner in the last joint's frame before `HAND_TURN_RAD`, and cells
to cover with a sphere each. Extents of the description's collision meshes, rounded up to a millimetre."""


def panda_urdf() -> str:
    """The description as text; meshes are named by absolute path."""
    path = panda_path()
    return re.sub(r"package://", f"{path.parent.as_posix()}/", path.read_text(encoding="utf-8"))


def panda_path() -> Path:
    """The description's file."""
    return Path(pybullet_data.getDataPath()) / "franka_panda" / "panda.urdf"
