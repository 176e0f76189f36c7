"""ArmSpec: what the rest of the house needs to know about one model of arm with the tool that it holds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.arms.shapes import SolidShape
from fleet.robots.spec import Visual
from fleet.robots.tools import Tool
from planners.motion.arm.kinematics import joint_rows


@dataclass(frozen=True, kw_only=True)
class ArmOutline:
    """How thick an arm is, for worlds that judge distances and rays without its meshes."""

    link_radii_m: tuple[float, ...]
    """Radius of the balls at each joint and half-way to it, which hold the links to about 2 cm [m], base to tip."""
    foot_m: float
    """Radius of the foot at the height of a car's lidar [m]."""
    n_standing_links: int
    """Links above the base that cannot come down to the floor it stands on."""


@dataclass(frozen=True, kw_only=True)
class UsualService:
    """How long an arm is taken by one transfer at the stations that ship, before it has done any."""

    mean_s: float
    p90_s: float
    """90th percentile [s]."""
    load_s: float = 3.0
    """How long a car stands for a parcel that the arm holds ready, until it can go on [s]; abstract runs alone ask."""
    unload_s: float = 6.0
    """How long it stands until its parcel is lifted out of its way [s]."""


@dataclass(frozen=True, kw_only=True)
class ArmSpec:
    """A fixed-base arm with a tool; joint order is base to tip."""

    name: str
    n_joints: int
    urdf: Path
    """The file that describes the arm, read at run time."""
    description: str
    """URDF text of the arm with its tool, as engines load it; its first joints are the arm's."""
    base_from_joint: FloatArray
    """Fixed transform before each joint's rotation about its own z, shape (n_joints, 4, 4)."""
    lower_rad: FloatArray
    upper_rad: FloatArray
    max_velocity_radps: FloatArray
    max_acceleration_radps2: FloatArray
    max_torque_nm: FloatArray
    tool: Tool
    """What it holds, where it is mounted."""
    payload_kg: float
    """What the arm carries beyond its own links, tool included [kg]."""
    reach_m: tuple[float, float]
    """Horizontal distance from the base of the points that it serves from above: least, most [m]."""
    stand_m: float
    """Height of the stand that its base is mounted on [m]; 0 = on the floor."""
    service: UsualService
    home_rad: FloatArray
    visuals: tuple[Visual, ...]
    """Links: 'link_0' to 'link_n' (link i moves with joint i) and 'tool' (rigid in the last link)."""
    outline: ArmOutline
    solids: tuple[tuple[SolidShape, ...], ...]
    """Collision shapes of links 0 to n, each in its link's frame."""
    spheres_per_link: tuple[int, ...] | None = None
    """Spheres that cover links 0 to n for planning; None = as many as suit their sizes."""
    touching: tuple[tuple[int, int], ...] = ()
    """Pairs of links whose hulls meet although the links do not, lower first: 0 is the base, i moves with joint i."""

    @cached_property
    def joints(self) -> FloatArray:
        """The upper three rows of `base_from_joint`, as kernels take them, shape (n_joints, 3, 4)."""
        return joint_rows(self.base_from_joint)

    @property
    def tool_length_m(self) -> float:
        """From the last link's frame to the tool tip along its +z [m]."""
        return self.tool.length_m

    def with_limits(self, velocity_radps: float | None, acceleration_radps2: float | None) -> ArmSpec:
        """The same arm with one limit for all joints; None leaves its own."""
        velocity, acceleration = (
            own if limit is None else np.full(self.n_joints, float(limit))
            for limit, own in (
                (velocity_radps, self.max_velocity_radps),
                (acceleration_radps2, self.max_acceleration_radps2),
            )
        )
        return replace(self, max_velocity_radps=velocity, max_acceleration_radps2=acceleration)
