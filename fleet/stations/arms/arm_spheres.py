"""Arm spheres: the collision model of an arm with its tool, fitted to its meshes once and kept on disk."""

from __future__ import annotations

import os
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from fleet.robots.arms.spec import ArmSpec
from planners.motion.arm.arm_model import ArmModel, build_arm_model
from planners.motion.arm.spheres import box_spheres, sphere_count

TOOL_SPHERE_M = 0.03
"""A tool's boxes are cut into cells of this edge, one sphere around each [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedArm:
    """An arm as planners need it: its limits, its tool, and the spheres that cover both."""

    spec: ArmSpec
    spheres: ArmModel


def planned_arm(spec: ArmSpec) -> PlannedArm:
    """Cover an arm and its tool; see `arm_spheres`."""
    return PlannedArm(spec=spec, spheres=arm_spheres(spec))


def cache_dir() -> Path:
    """Where fitted models are kept between runs; `FLEET_CACHE` or the user's cache directory."""
    root = os.environ.get("FLEET_CACHE") or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "fleet"


def arm_spheres(spec: ArmSpec) -> ArmModel:
    """Fit spheres to the hulls of an arm's links, and cover the boxes of its tool by a grid of them.

    Args:
        spec: The arm.

    Returns:
        The model in the arm's base frame.
    """
    tool = spec.tool
    links = [np.concatenate([solid.vertices() for solid in solids]) for solids in spec.solids]
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
        link_vertices=links,
        spheres_per_link=spec.spheres_per_link or [sphere_count(vertices) for vertices in links],
        tool_length=spec.tool_length_m,
        tool_centre=np.concatenate(centres),
        tool_radius=np.concatenate(radii),
        tool_vertices=np.concatenate(corners),
        cache_dir=cache_dir(),
    )
