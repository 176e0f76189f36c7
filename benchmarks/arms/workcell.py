"""Workcell: one iiwa with a two-finger gripper between a rack, a table and a car with a tray."""

from __future__ import annotations

from functools import cache

from fleet.robots import ARMS
from fleet.robots.arms.spec import ArmSpec
from fleet.robots.tools import TOOLS
from fleet.stations.arms.arm_spheres import arm_spheres
from planners.motion.arm.arm_model import ArmModel
from planners.motion.collision.obstacles import Boxes

TOOL = TOOLS["friction"]
FLOOR_FRAME = 2
"""Links below this are bolted down and may touch the floor."""
RACK_SHELVES_M = (0.33, 0.71)
"""Tops of the shelves that are picked from."""
TRAY_M = (0.05, -0.65, 0.196)
"""Centre of the tray's floor."""


@cache
def spec() -> ArmSpec:
    """Limits and joints of the arm."""
    return ARMS["iiwa"].spec(TOOL)


@cache
def model() -> ArmModel:
    """The arm as spheres."""
    return arm_spheres(spec())


@cache
def boxes() -> Boxes:
    """Twenty-one boxes in the arm's base frame [m]."""
    one = Boxes.one
    x, y, floor = TRAY_M
    return Boxes.join(
        one((0.0, 0.0, -0.05), (3.0, 3.0, 0.05), min_frame=FLOOR_FRAME),
        *(one((0.755, 0.0, z), (0.175, 0.55, 0.01)) for z in (0.02, 0.32, 0.70, 1.08)),
        *(one((0.755, side, 0.55), (0.175, 0.01, 0.55)) for side in (-0.55, 0.0, 0.55)),
        one((0.935, 0.0, 0.55), (0.005, 0.55, 0.55)),
        one((0.0, 0.68, 0.40), (0.25, 0.25, 0.02)),
        *(one((u * 0.23, 0.68 + v * 0.23, 0.19), (0.02, 0.02, 0.19)) for u in (-1, 1) for v in (-1, 1)),
        one((x, y, 0.09), (0.22, 0.15, 0.09)),
        one((x, y, floor - 0.006), (0.17, 0.13, 0.006)),
        *(one((x + side * 0.17, y, floor + 0.029), (0.005, 0.13, 0.04)) for side in (-1, 1)),
        *(one((x, y + side * 0.13, floor + 0.029), (0.17, 0.005, 0.04)) for side in (-1, 1)),
    )
