"""Tools of the arms: descriptions that are merged into an arm's URDF text, so that arm and tool stay one body."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fleet.robots.description import fill, spaced
from fleet.robots.spec import Visual

_GREY = (0.2, 0.2, 0.2, 1.0)
_LIGHT_GREY = (0.6, 0.6, 0.6, 1.0)

_CUP_WIDTH_M = 0.04
_CUP_SPAN_M = 0.14

_PALM_SIZE_M = (0.15, 0.06, 0.09)
_FINGER_SIZE_M = (0.012, 0.03, 0.10)
_FINGER_TRAVEL_M = 0.055
# Pads grip best a little above the finger ends: the tip is 13 mm inside them.
_FRICTION_TIP_M = 0.177
# Rubber pads on cardboard; the physics engine multiplies the coefficients of both.
_PAD_FRICTION = 1.0
CARDBOARD_FRICTION = 0.8
"""Coefficient of friction of a parcel."""

_GRAVITY_MPS2 = 9.81
_RESERVE = 3.0
"""Times its weight that a parcel must be held with: lifted and braked at 3 rad/s, it pulls with up to twice of it."""


@dataclass(frozen=True, kw_only=True)
class Tool:
    """What an arm holds parcels with."""

    name: str
    """Key in `TOOLS`: 'suction' or 'friction'."""
    mount_m: float
    """From the arm's last link frame to the face that the tool is mounted on, along its +z [m]; 0 in `TOOLS`."""
    length_m: float
    """From the arm's last link frame to the tool tip along its +z [m]."""
    force_n: float
    """Most force of the cup, or of each finger [N], unless a run says otherwise."""
    force_share: float
    """What it holds up of that force: all of it for a cup, what two pads rub for fingers."""
    touch_links: tuple[str, ...]
    """Links that hold the parcel: the cup, or both fingers."""
    finger_joints: tuple[str, ...]
    """Prismatic joints, each opening from 0 to `finger_travel_m`; empty for suction."""
    finger_turn_rad: float = 0.0
    """From the last link's y axis to the way the fingers open, about its z axis."""
    finger_travel_m: float
    """Way of one finger from closed to open [m]; the opening is twice that."""
    half_width_m: float
    """Half of the tool's largest extent across its axis, fingers open [m]."""
    visuals: tuple[Visual, ...]
    """Parts in the link 'tool', which is the arm's last link frame."""

    def mounted(self, mount_m: float) -> Tool:
        """The tool of this name on the flange of an arm.

        Args:
            mount_m: From the arm's last link frame to the flange's face along its +z [m].
        """
        return _MAKERS[self.name](mount_m)

    def payload_kg(self, force_n: float | None = None) -> float:
        """Heaviest parcel that is held three times over [kg].

        Args:
            force_n: Most force of the cup, or of each finger [N]; None = its usual one.
        """
        return self.force_share * (self.force_n if force_n is None else force_n) / (_RESERVE * _GRAVITY_MPS2)


def tool_urdf(tool: Tool, flange: str) -> str:
    """Give the links and joints of a tool as URDF text.

    Args:
        tool: A member of `TOOLS`, mounted.
        flange: Name of the arm's last link, which the tool is fixed to.

    Returns:
        Text to stand before the arm's closing ``</robot>``.
    """
    if tool.name == "suction":
        return fill(
            "suction",
            flange=flange,
            width=_CUP_WIDTH_M,
            span=tool.length_m - tool.mount_m,
            middle=(tool.length_m + tool.mount_m) / 2,
        )
    fingers = "".join(
        fill(
            "friction_finger",
            name=name,
            direction=side,
            offset=side * _FINGER_SIZE_M[0] / 2,
            middle=_FINGER_SIZE_M[2] / 2,
            size=spaced(_FINGER_SIZE_M),
            mount=tool.mount_m + _PALM_SIZE_M[2],
            friction=_PAD_FRICTION,
            opening=_FINGER_TRAVEL_M,
        )
        for name, side in zip(tool.touch_links, (1, -1), strict=True)
    )
    palm_z = tool.mount_m + _PALM_SIZE_M[2] / 2
    return fill("friction", flange=flange, palm_z=palm_z, palm_size=spaced(_PALM_SIZE_M), fingers=fingers)


def _box(size: tuple[float, float, float], x: float, z: float, rgba: tuple[float, float, float, float]) -> Visual:
    pose = np.eye(4)
    pose[[0, 2], 3] = x, z
    return Visual(link="tool", mesh=None, size_m=size, link_from_visual=pose, rgba=rgba)


def _length(mount_m: float, own_m: float) -> float:
    """Sum of two lengths, rounded, so that decimal numbers stay such [m]."""
    return round(mount_m + own_m, 9)


def _suction(mount_m: float) -> Tool:
    length_m = _length(mount_m, _CUP_SPAN_M)
    span = length_m - mount_m
    part = _box((_CUP_WIDTH_M, _CUP_WIDTH_M, span), 0.0, mount_m + span / 2, _GREY)
    return Tool(
        name="suction",
        mount_m=mount_m,
        length_m=length_m,
        force_n=100.0,
        force_share=1.0,
        touch_links=("cup",),
        finger_joints=(),
        finger_travel_m=0.0,
        half_width_m=_CUP_WIDTH_M / 2,
        visuals=(part,),
    )


def _friction(mount_m: float) -> Tool:
    # Drawn half open: a recorder knows joint angles of the arm, not of the fingers.
    finger_x = _FINGER_TRAVEL_M / 2 + _FINGER_SIZE_M[0] / 2
    finger_z = mount_m + _PALM_SIZE_M[2] + _FINGER_SIZE_M[2] / 2
    parts = (
        _box(_PALM_SIZE_M, 0.0, mount_m + _PALM_SIZE_M[2] / 2, _GREY),
        _box(_FINGER_SIZE_M, finger_x, finger_z, _LIGHT_GREY),
        _box(_FINGER_SIZE_M, -finger_x, finger_z, _LIGHT_GREY),
    )
    return Tool(
        name="friction",
        mount_m=mount_m,
        length_m=_length(mount_m, _FRICTION_TIP_M),
        force_n=40.0,
        force_share=2 * _PAD_FRICTION * CARDBOARD_FRICTION,
        touch_links=("finger_left", "finger_right"),
        finger_joints=("finger_left_slide", "finger_right_slide"),
        finger_turn_rad=math.pi / 2,
        finger_travel_m=_FINGER_TRAVEL_M,
        half_width_m=_PALM_SIZE_M[0] / 2,
        visuals=parts,
    )


_MAKERS = {"suction": _suction, "friction": _friction}
TOOLS: dict[str, Tool] = {name: make(0.0) for name, make in _MAKERS.items()}
"""Tools by name, as they are before they are mounted."""
