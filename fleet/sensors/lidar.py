"""Lidar: a ring of rays around a car, in the plane of its chassis."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray
from fleet.config.field_checks import is_whole
from fleet.sensors.errors import SensorError

HEIGHT_M = 0.07
"""The plane of the rays: the middle of a chassis; walls, shelves, pedestals and the feet of arms stand in it too."""
_CLEAR_M = 0.002
"""Rays begin this far outside of the car's own body, which would else be all that they meet."""


@dataclass(frozen=True, kw_only=True)
class Lidar:
    """Rays at even angles, the first one straight ahead, then to the left."""

    n_rays: int = 36
    range_m: float = 5.0
    """Distance from the lidar at which the rays end [m]."""
    noise_m: float = 0.01
    """Standard deviation of a distance [m]; a ray that meets nothing has none."""

    def __post_init__(self) -> None:
        _require(is_whole(self.n_rays) and 36 <= self.n_rays <= 360, "n_rays", self.n_rays, "an integer from 36 to 360")
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
        angles = 2.0 * math.pi * np.arange(lidar.n_rays) / lidar.n_rays
        self._angles = angles
        along = np.abs(np.cos(angles)) / ((front_m + rear_m) / 2 + _CLEAR_M)
        across = np.abs(np.sin(angles)) / (half_width_m + _CLEAR_M)
        self._body_m = 1.0 / np.maximum(along, across)

    def rays(self, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where the rays of cars begin and end.

        Args:
            poses: Rear-axle poses x, y, yaw, shape (n, 3).

        Returns:
            World points, each shape (n * n_rays, 3), car by car.
        """
        n = len(poses) * self.lidar.n_rays
        origins, ends = np.empty((n, 3)), np.empty((n, 3))
        _aim(poses, self._ahead_m, self._angles, self._body_m, self.lidar.range_m, HEIGHT_M, origins, ends)
        return origins, ends

    def hits(
        self, poses: FloatArray, cast: Callable[[FloatArray, FloatArray], FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Scan without noise.

        Args:
            poses: Rear-axle poses x, y, yaw, shape (n, 3).
            cast: `World.rays`, or what answers alike.

        Returns:
            Beginnings of the rays that met something, and what they met: world points, both shape (k, 3).
        """
        origins, ends = self.rays(poses)
        fractions = cast(origins, ends)
        met = fractions < 1.0
        return origins[met], origins[met] + fractions[met, None] * (ends[met] - origins[met])

    def distances(self, fractions: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Measured distances over the range, 1 for nothing met.

        Args:
            fractions: Hit fractions of the rays, shape (n * n_rays,).
            rng: Source of the noise.

        Returns:
            Shape (n, n_rays), in [0, 1].
        """
        out = np.empty((len(fractions) // self.lidar.n_rays, self.lidar.n_rays))
        self.measure(fractions, rng.standard_normal(out.shape), out)
        return out

    def measure(self, fractions: FloatArray, noise: FloatArray, out: npt.NDArray[np.floating]) -> None:
        """Do `distances` with noise that is drawn already.

        Args:
            fractions: Hit fractions of the rays, shape (n * n_rays,).
            noise: Drawn from the standard normal distribution, shape (n, n_rays).
            out: Filled with what `distances` returns, shape (n, n_rays).
        """
        _measure(fractions, noise, self.lidar.noise_m, self._body_m, self.lidar.range_m, out)


@njit(cache=True)
def _aim(
    poses: FloatArray,
    ahead: float,
    angles: FloatArray,
    body: FloatArray,
    reach: float,
    height: float,
    origins: FloatArray,
    ends: FloatArray,
) -> None:
    row = 0
    for car in range(len(poses)):
        yaw = poses[car, 2]
        x, y = poses[car, 0] + ahead * math.cos(yaw), poses[car, 1] + ahead * math.sin(yaw)
        for ray in range(len(angles)):
            along, across = math.cos(yaw + angles[ray]), math.sin(yaw + angles[ray])
            origins[row, 0], origins[row, 1], origins[row, 2] = x + body[ray] * along, y + body[ray] * across, height
            ends[row, 0], ends[row, 1], ends[row, 2] = x + reach * along, y + reach * across, height
            row += 1


@njit(cache=True)
def _measure(
    fractions: FloatArray,
    noise: FloatArray,
    sigma: float,
    body: FloatArray,
    reach: float,
    out: npt.NDArray[np.floating],
) -> None:
    for car in range(len(out)):
        for ray in range(len(body)):
            fraction = fractions[car * len(body) + ray]
            met = body[ray] + fraction * (reach - body[ray])
            if fraction < 1.0:
                met += sigma * noise[car, ray]
            out[car, ray] = min(max(met / reach, 0.0), 1.0)


def _require(ok: bool, what: str, value: object, valid: str) -> None:
    if not ok:
        raise SensorError(f"lidar {what} is {value!r}; valid: {valid}")
