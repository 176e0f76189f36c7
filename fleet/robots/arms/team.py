"""ArmTeam: the arms of a scene in their order, alike or not, with their numbers as arrays for kernels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fleet.arrays import FloatArray, IntArray
from fleet.errors import ConfigError
from fleet.robots.arms.spec import ArmSpec


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmTeam:
    """Models of m arms.

    Rows of arrays have one place for each joint of the arm with most joints. Behind the last joint of an arm with fewer
    there are joints that neither turn nor shift anything: they stand at zero, and the frame after them is that of the
    arm's last link.
    """

    specs: tuple[ArmSpec, ...]
    """Model of each arm."""
    width: int
    """Joints of a row."""

    @classmethod
    def of(cls, specs: Sequence[ArmSpec]) -> ArmTeam:
        """Arms in this order."""
        return cls(specs=tuple(specs), width=max((spec.n_joints for spec in specs), default=0))

    @classmethod
    def alike(cls, spec: ArmSpec, n_arms: int) -> ArmTeam:
        """So many arms of one model; of none, rows are as wide as the model's."""
        return cls(specs=(spec,) * n_arms, width=spec.n_joints)

    def part(self, arms: Sequence[int] | IntArray) -> ArmTeam:
        """Some of the arms; rows stay as wide."""
        return ArmTeam(specs=tuple(self.specs[int(arm)] for arm in arms), width=self.width)

    def __len__(self) -> int:
        return len(self.specs)

    @property
    def models(self) -> tuple[ArmSpec, ...]:
        """The different models, in the order of their first arms."""
        return tuple({spec.name: spec for spec in self.specs}.values())

    def only(self, who: str) -> ArmSpec:
        """The model, if all arms are of one.

        Args:
            who: What needs that, opens the message.

        Raises:
            ConfigError: They are not, or there is no arm.
        """
        if len(self.models) != 1:
            names = ", ".join(spec.name for spec in self.models) or "none"
            raise ConfigError(f"{who}: arms of the models {names}; valid: arms of one model")
        return self.models[0]

    @cached_property
    def n_joints(self) -> IntArray:
        """Joints of each arm, shape (m,)."""
        return np.array([spec.n_joints for spec in self.specs], dtype=np.int64)

    @cached_property
    def joints(self) -> FloatArray:
        """Upper three rows of the fixed transform before each joint, shape (m, width, 3, 4)."""
        joints = np.tile(np.eye(4)[:3], (len(self), self.width, 1, 1))
        for row, spec in zip(joints, self.specs, strict=True):
            row[: spec.n_joints] = spec.joints
        return joints

    @cached_property
    def lower_rad(self) -> FloatArray:
        """Shape (m, width)."""
        return self.padded(lambda spec: spec.lower_rad, 0.0)

    @cached_property
    def upper_rad(self) -> FloatArray:
        """Shape (m, width)."""
        return self.padded(lambda spec: spec.upper_rad, 0.0)

    @cached_property
    def max_velocity_radps(self) -> FloatArray:
        """Shape (m, width); 1 for joints that are not there, as shares are taken of it."""
        return self.padded(lambda spec: spec.max_velocity_radps, 1.0)

    @cached_property
    def tool_length_m(self) -> FloatArray:
        """From the last link's frame to the tool's tip [m], shape (m,)."""
        return np.array([spec.tool_length_m for spec in self.specs])

    @cached_property
    def foot_m(self) -> FloatArray:
        """Radius of each foot at the height of a car's lidar [m], shape (m,)."""
        return np.array([spec.outline.foot_m for spec in self.specs])

    @cached_property
    def home_rad(self) -> FloatArray:
        """Where the arms rest, shape (m, width)."""
        return self.padded(lambda spec: spec.home_rad, 0.0)

    def padded(self, value: Callable[[ArmSpec], FloatArray], beyond: float) -> FloatArray:
        """Numbers of all joints, shape (m, width).

        Args:
            value: Gives those of one model, shape (n_joints,).
            beyond: Stands for joints that are not there.
        """
        rows = np.full((len(self), self.width), beyond)
        for row, spec in zip(rows, self.specs, strict=True):
            row[: spec.n_joints] = value(spec)
        return rows
