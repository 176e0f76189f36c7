"""InertialEstimator: where robots are and how they lean, from gyro, accelerometer, odometer and fixes of their pose."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fleet.arrays import BoolArray, FloatArray
from fleet.robots.angle import wrapped_all

GRAVITY_MPS2 = 9.81
FALLEN_RAD = 0.7
"""A robot that leans more than this has fallen: legs that should stand no longer reach the floor [rad]."""


@dataclass(frozen=True, kw_only=True)
class InertialConfig:
    """Errors of the sensors; those of the inertial unit are of the class of a phone's (Bosch BMI160 data sheet)."""

    gyro_noise_radps: float = 0.002
    """Standard deviation of a measured rate [rad/s]."""
    gyro_bias_radps: float = 0.002
    """Standard deviation of the constant error of each gyro axis [rad/s]."""
    accelerometer_noise_mps2: float = 0.05
    odometer_noise_mps: float = 0.01
    odometer_scale: float = 0.01
    """Standard deviation of the constant relative error of the odometer."""
    fix_noise_m: float = 0.01
    """Of x and of y of a fix [m]; as the cars' measurements."""
    fix_noise_rad: float = math.radians(0.5)
    fix_every_ticks: int = 6
    """A fix comes every so many ticks: ten a second at 60 Hz; 0 = none comes."""
    lean_s: float = 2.0
    """Time over which the accelerometer corrects the lean that the gyro tells [s]."""
    place_gain: float = 0.2
    """Share of a fix's surprise that is believed, of place and yaw."""
    bias_gain_per_s: float = 0.02
    """How fast surprises of the yaw teach the gyro's constant error [1/s]."""


class InertialEstimator:
    """Estimates poses, motions and leans of robots.

    Between fixes, gyro and odometer carry the pose on; a fix pulls it back by a fixed share. The lean follows the gyro,
    and in the long run the accelerometer, which takes the robot's own accelerations for gravity.

    Attributes:
        poses: x, y, yaw, shape (n, 3).
        motions: Speeds ahead and to the left [m/s] and yaw rates [rad/s], shape (n, 3).
        leans: Roll and pitch [rad], shape (n, 2).

    Args:
        start: Where the robots are put up, shape (n, 3); known exactly.
        tick_s: Period of `update` [s].
        rng: Source of all errors.
        config: Sensors and gains.

    Source: R. Mahony, T. Hamel, J.-M. Pflimlin, "Nonlinear complementary filters on the special orthogonal group", IEEE
    Transactions on Automatic Control 53(5), 2008, https://doi.org/10.1109/TAC.2008.923738, for small leans.
    """

    def __init__(
        self, start: FloatArray, tick_s: float, *, rng: np.random.Generator, config: InertialConfig | None = None
    ) -> None:
        self._config = c = config or InertialConfig()
        n = len(start)
        self._tick_s, self._rng, self._tick = tick_s, rng, 0
        self.poses = np.array(start, dtype=np.float64)
        self.motions = np.zeros((n, 3))
        self.leans = np.zeros((n, 2))
        self._bias = c.gyro_bias_radps * rng.standard_normal((n, 3))
        self._scale = 1.0 + c.odometer_scale * rng.standard_normal((n, 1))
        self._known_bias = np.zeros(n)
        self._before = (np.zeros((n, 2)), np.zeros((n, 2)))

    @property
    def fallen(self) -> BoolArray:
        """Robots that lie, as far as they can tell, shape (n,)."""
        fallen: BoolArray = np.abs(self.leans).max(axis=1) > FALLEN_RAD
        return fallen

    def update(self, poses: FloatArray, motions: FloatArray, leans: FloatArray) -> FloatArray:
        """Take in a tick of what sensors measure of the truth.

        Args:
            poses: True x, y, yaw, shape (n, 3).
            motions: True speeds ahead and to the left [m/s] and yaw rates [rad/s], shape (n, 3).
            leans: True roll and pitch [rad], shape (n, 2).

        Returns:
            Estimated poses, shape (n, 3).
        """
        c, dt, rng, n = self._config, self._tick_s, self._rng, len(poses)
        speeds_before, leans_before = self._before
        rates = np.column_stack(((leans - leans_before) / dt, motions[:, 2]))
        gyro = rates + self._bias + c.gyro_noise_radps * rng.standard_normal((n, 3))
        # A lean forward, and a push forward from below, both press the accelerometer's mass backwards.
        pulls = (motions[:, :2] - speeds_before) / dt + c.accelerometer_noise_mps2 * rng.standard_normal((n, 2))
        felt = leans + np.column_stack((-pulls[:, 1], pulls[:, 0])) / GRAVITY_MPS2
        share = dt / c.lean_s
        self.leans = (1.0 - share) * (self.leans + gyro[:, :2] * dt) + share * felt
        self._before = (motions[:, :2].copy(), leans.copy())

        speeds = self._scale * motions[:, :2] + c.odometer_noise_mps * rng.standard_normal((n, 2))
        self.motions = np.column_stack((speeds, gyro[:, 2] - self._known_bias))
        angle = self.motions[:, 2] * dt
        cos, sin = np.cos(self.poses[:, 2] + 0.5 * angle), np.sin(self.poses[:, 2] + 0.5 * angle)
        self.poses[:, 0] += (cos * speeds[:, 0] - sin * speeds[:, 1]) * dt
        self.poses[:, 1] += (sin * speeds[:, 0] + cos * speeds[:, 1]) * dt
        self.poses[:, 2] += angle
        self._tick += 1
        if c.fix_every_ticks and self._tick % c.fix_every_ticks == 0:
            sigma = np.array([c.fix_noise_m, c.fix_noise_m, c.fix_noise_rad])
            surprise = poses + sigma * rng.standard_normal((n, 3)) - self.poses
            surprise[:, 2] = wrapped_all(surprise[:, 2])
            self.poses += c.place_gain * surprise
            self._known_bias -= c.bias_gain_per_s * surprise[:, 2]
        return self.poses.copy()
