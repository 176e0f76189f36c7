"""Lidar: what a scanner on the nose of a car sees in its plane."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Lidar:
    """A scanner with rays at equal angles, symmetric about straight ahead."""

    ahead_m: float
    """Of the rear axle's centre; just before the body, so that no ray begins inside it."""
    height_m: float
    """Over the floor."""
    rays_n: int = 31
    field_of_view_rad: float = np.pi
    range_m: float = 5.0

    def rays(self, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Beginnings and ends of the rays of cars [m].

        Args:
            poses: Rear axles x, y, yaw, shape (n, 3).

        Returns:
            Two arrays of shape (n * rays_n, 3), car by car, from right to left.
        """
        half = self.field_of_view_rad / 2
        yaw = poses[:, 2]
        angle = yaw[:, None] + np.linspace(-half, half, self.rays_n)
        origin = np.empty((len(poses), self.rays_n, 3))
        origin[..., 0] = (poses[:, 0] + self.ahead_m * np.cos(yaw))[:, None]
        origin[..., 1] = (poses[:, 1] + self.ahead_m * np.sin(yaw))[:, None]
        origin[..., 2] = self.height_m
        end = origin.copy()
        end[..., 0] += self.range_m * np.cos(angle)
        end[..., 1] += self.range_m * np.sin(angle)
        return origin.reshape(-1, 3), end.reshape(-1, 3)

    def scan(
        self, poses: FloatArray, cast: Callable[[FloatArray, FloatArray], FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Scan around cars.

        Args:
            poses: Rear axles x, y, yaw, shape (n, 3).
            cast: `World.rays`, or what answers alike.

        Returns:
            Beginnings and hits of the rays that hit something [m], both (k, 3).
        """
        origin, end = self.rays(poses)
        fraction = cast(origin, end)
        hit = fraction < 1.0
        return origin[hit], origin[hit] + fraction[hit, None] * (end[hit] - origin[hit])
