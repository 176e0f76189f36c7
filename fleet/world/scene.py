"""Scene: everything a world is built from, as plain arrays, so that every fidelity starts from the same place."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from fleet.arrays import FloatArray, IntArray
from fleet.config import require
from fleet.robots.arms.team import ArmTeam
from fleet.robots.cars.models import CarModels
from fleet.robots.spec import CarSpec


@dataclass(frozen=True, kw_only=True)
class StaticBox:
    """An immovable axis-aligned box."""

    kind: str
    """'wall', 'shelf', 'pedestal' under a slot, or 'stand' under an arm."""
    centre_m: tuple[float, float, float]
    half_m: tuple[float, float, float]
    where: str = ""
    """The cells that it covers, as messages name them, where a plan has them."""


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Robots and fixed things at the start of a run."""

    size_m: tuple[float, float]
    """Extent of the floor along x and y [m]; the floor's corner is the origin."""
    boxes: tuple[StaticBox, ...]
    car_kinds: tuple[CarSpec, ...]
    """Models of the cars, at least one."""
    car_start: FloatArray
    """Start poses x, y, yaw [m, m, rad], shape (n_cars, 3)."""
    arms: ArmTeam
    arm_base: FloatArray
    """Base poses x, y, z, yaw, shape (n_arms, 4)."""
    arm_start: FloatArray
    """Start joint positions [rad], shape (n_arms, n_joints); n_joints is `arms.width` everywhere."""

    pod_start: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    """Where pods stand at the start, x, y, yaw of their middles, shape (n_pods, 3)."""
    car_kind_of: IntArray | None = None
    """Which of the models each car is, shape (n_cars,); None = all are the first."""

    def __post_init__(self) -> None:
        shapes = (np.shape(self.arm_base), np.shape(self.arm_start))
        n_arms = len(self.arms)
        valid = ((n_arms, 4), (n_arms, self.arms.width))
        require(shapes == valid, "scene: shapes of arm_base, arm_start", shapes, f"{valid} for {n_arms} arms")

    @cached_property
    def cars(self) -> CarModels:
        """Which model each car is."""
        kind_of = np.zeros(len(self.car_start), dtype=np.int64) if self.car_kind_of is None else self.car_kind_of
        return CarModels(kinds=self.car_kinds, kind_of=kind_of)

    @property
    def car(self) -> CarSpec:
        """The model of all cars, for what is made for one only.

        Raises:
            ConfigError: There are several.
        """
        return self.cars.only
