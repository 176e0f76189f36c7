"""Arm spheres: the collision model of an arm with its tool, fitted to its meshes once and kept on disk."""

from __future__ import annotations

import os
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from fleet.robots.spec import ArmSpec
from fleet.robots.tools import Tool
from planners.motion.arm.arm_model import ArmModel, build_arm_model
from planners.motion.arm.spheres import box_spheres, read_binary_stl

SPHERES_PER_LINK = (3, 4, 4, 4, 4, 4, 3, 2)
"""Links 0 to 7 of the iiwa; more spheres fit closer and check slower."""

TOOL_SPHERE_M = 0.03
"""A tool's boxes are cut into cells of this edge, one sphere around each [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedArm:
    """An arm as planners need it: its limits, its tool, and the spheres that cover both."""

    spec: ArmSpec
    tool: Tool
    spheres: ArmModel


def planned_arm(spec: ArmSpec, tool: Tool) -> PlannedArm:
    """Cover an arm that holds a tool; see `arm_spheres`."""
    return PlannedArm(spec=spec, tool=tool, spheres=arm_spheres(spec, tool))


def cache_dir() -> Path:
    """Where fitted models are kept between runs; `FLEET_CACHE` or the user's cache directory."""
    root = os.environ.get("FLEET_CACHE") or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "fleet"


def arm_spheres(spec: ArmSpec, tool: Tool) -> ArmModel:
    """Fit spheres to an arm's collision meshes and its tool.

    Args:
        spec: The arm; its description's folder holds `meshes/link_0.stl` to `link_7.stl`.
        tool: Its boxes are covered by a grid of spheres.

    Returns:
        The model in the arm's base frame.
    """
    meshes = [read_binary_stl(spec.urdf.parent / "meshes" / f"link_{k}.stl") for k in range(spec.n_joints + 1)]
    centres, radii, corners = [], [], []
    for part in tool.visuals:
        size = np.array(part.size_m)
        centre, radius = box_spheres(size / 2, tuple(np.ceil(size / TOOL_SPHERE_M).astype(int).tolist()))
        middle = part.link_from_visual[:3, 3].copy()
        if middle[0] != 0.0:
            # Fingers are drawn half open, and planned for as wide as they open.
            middle[0] += np.sign(middle[0]) * tool.finger_travel_m / 2
        centres.append(centre + middle)
        radii.append(radius)
        corners.append(middle + np.array(list(product((-0.5, 0.5), repeat=3))) * size)
    return build_arm_model(
        base_from_joint=spec.base_from_joint,
        lower=spec.lower_rad,
        upper=spec.upper_rad,
        link_vertices=meshes,
        spheres_per_link=SPHERES_PER_LINK,
        tool_length=spec.tool_length_m,
        tool_centre=np.concatenate(centres),
        tool_radius=np.concatenate(radii),
        tool_vertices=np.concatenate(corners),
        cache_dir=cache_dir(),
    )
