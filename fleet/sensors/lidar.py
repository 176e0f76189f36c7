"""Lidar: a ring of rays around a car, in the plane of its chassis."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fleet.sensors.errors import SensorError

FloatArray = npt.NDArray[np.float64]

HEIGHT_M = 0.07
"""The plane of the rays: the middle of a chassis; walls, shelves, pedestals and the feet of arms stand in it too."""
_CLEAR_M = 0.002
"""Rays begin this far outside of the car's own body, which would else be all that they meet."""


@dataclass(frozen=True, kw_only=True)
class Lidar:
    """Rays at even angles, the first one straight ahead, then to the left."""

    rays_n: int = 36
    range_m: float = 5.0
    """Distance from the lidar at which the rays end [m]."""
    noise_m: float = 0.01
    """Standard deviation of a distance [m]; a ray that meets nothing has none."""

    def __post_init__(self) -> None:
        _require(36 <= self.rays_n <= 360, "rays_n", self.rays_n, "an integer from 36 to 360")
        _require(1.0 <= self.range_m <= 100.0, "range_m", self.range_m, "a number from 1 to 100")
        _require(0.0 <= self.noise_m <= 1.0, "noise_m", self.noise_m, "a number from 0 to 1")


class LidarRing:
    """The rays of one lidar on each of some cars of a model.

    Args:
        lidar: The sensor.
        front_m: From the rear axle to the front of the body [m].
        rear_m: From the rear axle to its back [m].
        half_width_m: Half of its width [m].
    """

    def __init__(self, lidar: Lidar, front_m: float, rear_m: float, half_width_m: float) -> None:
        self.lidar = lidar
        self._ahead_m = (front_m - rear_m) / 2
        angles = 2.0 * math.pi * np.arange(lidar.rays_n) / lidar.rays_n
        self._angles = angles
        along = np.abs(np.cos(angles)) / ((front_m + rear_m) / 2 + _CLEAR_M)
        across = np.abs(np.sin(angles)) / (half_width_m + _CLEAR_M)
        self._body_m = 1.0 / np.maximum(along, across)

    def rays(self, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where the rays of cars begin and end.

        Args:
            poses: Rear-axle poses x, y, yaw, shape (n, 3).

        Returns:
            World points, each shape (n * rays_n, 3), car by car.
        """
        yaw = poses[:, 2, None]
        along, across = np.cos(yaw + self._angles), np.sin(yaw + self._angles)
        x = poses[:, 0, None] + self._ahead_m * np.cos(yaw)
        y = poses[:, 1, None] + self._ahead_m * np.sin(yaw)
        points = np.full((2, len(poses), self.lidar.rays_n, 3), HEIGHT_M)
        for point, reach_m in zip(points, (self._body_m, self.lidar.range_m), strict=True):
            point[..., 0], point[..., 1] = x + reach_m * along, y + reach_m * across
        origins, ends = points.reshape(2, -1, 3)
        return origins, ends

    def distances(self, fractions: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Measured distances over the range, 1 for nothing met.

        Args:
            fractions: Hit fractions of the rays, shape (n * rays_n,).
            rng: Source of the noise.

        Returns:
            Shape (n, rays_n), in [0, 1].
        """
        range_m = self.lidar.range_m
        fractions = fractions.reshape(-1, self.lidar.rays_n)
        out = (self._body_m + fractions * (range_m - self._body_m)) / range_m
        if self.lidar.noise_m:
            noise = rng.standard_normal(out.shape) * (self.lidar.noise_m / range_m)
            out = np.where(fractions < 1.0, out + noise, out)
        return np.clip(out, 0.0, 1.0)


def _require(ok: bool, what: str, value: object, valid: str) -> None:
    if not ok:
        raise SensorError(f"lidar {what} is {value!r}; valid: {valid}")
