"""CarRamp: what agents tell their cars, approached within the limits of their models."""

from __future__ import annotations

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.cars.models import CarModels
from fleet.robots.speed_ramp import SpeedRamp
from fleet.world.protocol import World


class CarRamp:
    """Lets cars approach told speeds by what their models accelerate and brake, and told yaw rates likewise.

    Legs that are told to go at full speed at once fall, and wheels that do not steer slip on the way to a yaw rate, so
    cars that do not steer are always held to it.

    Args:
        models: Models of the cars.
        tick_s: Length of a tick [s].
        of_all: Whether cars that steer are held to it, too.
    """

    def __init__(self, models: CarModels, tick_s: float, *, of_all: bool) -> None:
        self._twists = models.each("turn_base_m") == 0.0
        self._held = self._twists | of_all
        self._ramp = SpeedRamp(models, tick_s) if self._held.any() else None
        per_s2 = [
            0.0 if kind.differential is None else kind.differential.limits.max_yaw_accel_radps2 for kind in models.kinds
        ]
        self._most = tick_s * np.array(per_s2)[models.kind_of]
        self._rates = np.zeros(len(models))

    def tick(self, told: FloatArray, world: World) -> FloatArray:
        """Command a tick.

        Args:
            told: Steering [rad] or yaw rate [rad/s], and speed [m/s], shape (n_cars, 2).
            world: Measures the speeds of these cars, the first ones; a blocked car does not wind up.

        Returns:
            What is to be commanded, of the same shape.
        """
        if self._ramp is None:
            return told
        speeds = self._ramp.tick(told[:, 1], world.car_speeds()[: len(told)])
        self._rates = np.clip(told[:, 0], self._rates - self._most, self._rates + self._most)
        turns = np.where(self._twists, self._rates, told[:, 0])
        return np.column_stack((turns, np.where(self._held, speeds, told[:, 1])))
