"""Scene: everything a world is built from, as plain arrays, so that every fidelity starts from the same place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fleet.arrays import FloatArray
from fleet.config import require
from fleet.robots.arms.team import ArmTeam
from fleet.robots.spec import CarSpec


@dataclass(frozen=True, kw_only=True)
class StaticBox:
    """An immovable axis-aligned box."""

    kind: str
    """'wall', 'shelf', 'pedestal' under a slot, or 'stand' under an arm."""
    centre_m: tuple[float, float, float]
    half_m: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Robots and fixed things at the start of a run."""

    size_m: tuple[float, float]
    """Extent of the floor along x and y [m]; the floor's corner is the origin."""
    boxes: tuple[StaticBox, ...]
    car: CarSpec
    car_start: FloatArray
    """Start poses x, y, yaw [m, m, rad], shape (n_cars, 3)."""
    arms: ArmTeam
    arm_base: FloatArray
    """Base poses x, y, z, yaw, shape (n_arms, 4)."""
    arm_start: FloatArray
    """Start joint positions [rad], shape (n_arms, n_joints); n_joints is `arms.width` everywhere."""

    def __post_init__(self) -> None:
        shapes = (np.shape(self.arm_base), np.shape(self.arm_start))
        n_arms = len(self.arms)
        valid = ((n_arms, 4), (n_arms, self.arms.width))
        require(shapes == valid, "scene: shapes of arm_base, arm_start", shapes, f"{valid} for {n_arms} arms")
