"""Words of planning on an open floor: the shape of the cars, and who stands where and wants to go where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planners.errors import PlanningError
from planners.open_floor.arrays import FloatArray


class OpenFloorError(PlanningError):
    """A problem on an open floor contradicts itself."""


@dataclass(frozen=True, kw_only=True)
class CarOutline:
    """A rectangle that drives like a car; its pose is that of the middle of the rear axle.

    Raises:
        OpenFloorError: A length is not positive.
    """

    front_m: float
    """Reach ahead of the rear axle [m]."""
    rear_m: float
    """Reach behind it [m]."""
    half_width_m: float
    turning_radius_m: float
    """Of the tightest curve of the rear axle [m]."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value > 0):
                raise OpenFloorError(f"car shape: {name} = {value}; valid: a length > 0")


BENCHMARK_CAR = CarOutline(front_m=2.0, rear_m=1.0, half_width_m=1.0, turning_radius_m=3.0)
"""Of the published instances: L. Wen et al., "CL-MAPF: Multi-Agent Path Finding for Car-Like Robots with Kinematic and
Spatiotemporal Constraints", 2022, https://github.com/APRIL-ZJU/CL-CBS."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenFloorProblem:
    """Cars that all go from where they stand to goals, without lanes.

    Raises:
        OpenFloorError: An array has another shape, a number is not finite, or a radius or the floor not positive.
    """

    size_m: tuple[float, float]
    """The floor reaches from (0, 0) to this x and y [m]."""
    car: CarOutline
    starts: FloatArray
    """Poses x, y [m], yaw [rad], counter-clockwise, shape (n, 3)."""
    goals: FloatArray
    """Where each car stays for good, shape (n, 3)."""
    discs: FloatArray
    """Obstacles: x, y and radius [m], shape (k, 3)."""
    walled: bool = False
    """Whether the whole body of a car has to stay on the floor; else only its rear axle, as in published instances."""

    def __post_init__(self) -> None:
        n = len(self.starts)
        for name, shape in (("starts", (n, 3)), ("goals", (n, 3)), ("discs", (len(self.discs), 3))):
            value = np.asarray(getattr(self, name))
            if value.shape != shape:
                raise OpenFloorError(f"open floor: {name} has shape {value.shape}; valid: {shape}")
            bad = np.argwhere(~np.isfinite(value))
            if len(bad):
                row, column = bad[0]
                raise OpenFloorError(f"open floor: {name}[{row}, {column}] = {value[row, column]}; valid: a number")
        if not all(np.isfinite(side) and side > 0 for side in self.size_m):
            raise OpenFloorError(f"open floor: size_m = {self.size_m}; valid: two lengths > 0")
        wrong = np.flatnonzero(self.discs[:, 2] <= 0)
        if len(wrong):
            raise OpenFloorError(f"open floor: discs[{wrong[0]}] has radius {self.discs[wrong[0], 2]}; valid: > 0")

    @property
    def n_cars(self) -> int:
        """Number of cars."""
        return len(self.starts)
