"""ArmKind: everything that one model of arm brings along; a file of this folder makes one."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.arms.description import ArmDescription, read_description
from fleet.robots.arms.home import Home
from fleet.robots.arms.spec import ArmOutline, ArmSpec, UsualService
from fleet.robots.errors import ArmDescriptionError
from fleet.robots.tools import TOOLS, Tool, tool_urdf


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnHand:
    """The hand that an arm's description comes with; stations mount the tools of `TOOLS` in its place."""

    tool: Tool
    boxes_m: tuple[tuple[tuple[float, float, float], tuple[float, float, float], tuple[int, int, int]], ...]
    """Hand and open fingers as boxes: lowest and highest corner in the last joint's frame before it is turned by
    `tool.finger_turn_rad`, and cells to cover with a sphere each."""
    open_at: Mapping[str, float]
    """Where its fingers stand open, by joint [m]."""
    home_rad: tuple[float, ...]
    """Where the arm rests with it, over a table."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmKind:
    """One model of arm, without a tool."""

    name: str
    """Key in `ARMS`, by which sites and runs name it."""
    title: str
    """Maker and model."""
    urdf: Path
    """Description of the arm; its folder has the meshes."""
    flange: str
    """Name of the link that the last joint moves."""
    mount_m: float
    """From the frame of that link to the face that tools are mounted on, along its +z [m]."""
    max_velocity_radps: tuple[float, ...]
    """Limits of the real arm, one for each joint."""
    max_acceleration_radps2: tuple[float, ...]
    """The same."""
    max_torque_nm: tuple[float, ...]
    """The same."""
    lower_rad: tuple[float, ...] | None = None
    """Position limits; None = those of the description."""
    upper_rad: tuple[float, ...] | None = None
    """The same."""
    payload_kg: float
    """What the real arm carries, tool included [kg]."""
    reach_m: tuple[float, float]
    """Horizontal distance from the base of the points that it serves from above: least, most [m]."""
    stand_m: float = 0.0
    """Height of the stand that it is mounted on at a station [m]."""
    home: Home
    """Where it rests."""
    outline: ArmOutline
    service: UsualService
    spheres_per_link: tuple[int, ...] | None = None
    """Spheres that cover the links for planning, from the base on; None = as many as suit their sizes."""
    touching: tuple[tuple[int, int], ...] = ()
    """Pairs of links whose hulls meet although the links do not, lower first: 0 is the base, i moves with joint i."""
    hand: OwnHand | None = None
    source: str = "the file of its model"
    """Where its limits and its payload come from."""

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return len(self.max_velocity_radps)

    @cached_property
    def described(self) -> ArmDescription:
        """What the file says.

        Raises:
            ArmDescriptionError: It does not describe this arm.
        """
        try:
            return read_description(self.urdf, flange=self.flange, n_joints=self.n_joints)
        except ArmDescriptionError as error:
            raise ArmDescriptionError(f"arm {self.name}: {error}") from error

    def touching_links(self) -> tuple[tuple[str, str], ...]:
        """`touching` by the names of the links."""
        links = self.described.links
        return tuple((links[a], links[b]) for a, b in self.touching)

    def whole_text(self) -> str:
        """The description as it is in the file, with what hangs on the flange; meshes are named by absolute path."""
        text = self.urdf.read_text(encoding="utf-8")
        return re.sub(r"package://", f"{self.urdf.parent.as_posix()}/", text)

    def text(self, tool: Tool | None = None) -> str:
        """The arm's description with a tool of `TOOLS` merged into it, suction when None."""
        return self.described.with_tool(tool_urdf(self._mounted(tool), self.flange))

    def spec(self, tool: Tool | None = None) -> ArmSpec:
        """Read the arm's geometry and limits.

        Args:
            tool: A member of `TOOLS`, to be mounted on the flange; suction when None.

        Returns:
            The arm with that tool.

        Raises:
            ArmDescriptionError: The file does not describe this arm.
        """
        described, mounted = self.described, self._mounted(tool)
        lower = self._limits(self.lower_rad, described.lower_rad)
        upper = self._limits(self.upper_rad, described.upper_rad)
        try:
            home = self.home(described.base_from_joint, lower, upper, mounted.length_m)
        except ArmDescriptionError as error:
            raise ArmDescriptionError(f"arm {self.name}: {error}") from error
        return ArmSpec(
            name=self.name,
            n_joints=self.n_joints,
            urdf=self.urdf,
            description=described.with_tool(tool_urdf(mounted, self.flange)),
            base_from_joint=described.base_from_joint,
            lower_rad=lower,
            upper_rad=upper,
            max_velocity_radps=np.array(self.max_velocity_radps),
            max_acceleration_radps2=np.array(self.max_acceleration_radps2),
            max_torque_nm=np.array(self.max_torque_nm),
            tool=mounted,
            payload_kg=self.payload_kg,
            reach_m=self.reach_m,
            stand_m=self.stand_m,
            service=self.service,
            home_rad=home,
            visuals=described.visuals + mounted.visuals,
            outline=self.outline,
            solids=described.solids,
            spheres_per_link=self.spheres_per_link,
            touching=self.touching,
        )

    def _mounted(self, tool: Tool | None) -> Tool:
        return (tool or TOOLS["suction"]).mounted(self.mount_m)

    def _limits(self, own: tuple[float, ...] | None, described: FloatArray) -> FloatArray:
        if own is None:
            return described
        if len(own) != self.n_joints:
            raise ArmDescriptionError(f"arm {self.name}: {len(own)} position limits; valid: {self.n_joints}")
        return np.array(own)
