"""SpeedRamp: speeds that cars are told become commands that their limits of acceleration allow."""

from __future__ import annotations

import numpy as np
from numba import njit

from fleet.arrays import FloatArray
from fleet.robots.cars.models import CarModels
from fleet.robots.pursuit import SPEED_SLACK_MPS


class SpeedRamp:
    """Lets cars approach told speeds by what their models accelerate and brake, whatever motors and tyres could do.

    So a car in physics answers as one without: its tyres do not slip, and what lies in its tray stays there.

    Args:
        models: Models of the cars.
        tick_s: Length of a tick [s].
    """

    def __init__(self, models: CarModels, tick_s: float) -> None:
        self._rates = tick_s * np.stack((models.each("max_accel_mps2"), models.each("max_brake_mps2")), axis=1)
        self._last = np.zeros(len(models))

    def tick(self, told: FloatArray, measured: FloatArray) -> FloatArray:
        """Command a tick's speeds.

        Args:
            told: Signed speeds that are wanted [m/s], shape (n_cars,).
            measured: Signed speeds of the cars [m/s], shape (n_cars,); a blocked car does not wind up.

        Returns:
            Signed speeds to be commanded [m/s], shape (n_cars,).
        """
        _approach(told, measured, self._rates, self._last)
        return self._last.copy()


@njit(cache=True)
def _approach(
    told: FloatArray, measured: FloatArray, rates: FloatArray, last: FloatArray
) -> None:  # pragma: no cover - compiled
    """Bring commands nearer to what is told; a change of direction brakes to a stand first."""
    for car in range(len(last)):
        before = min(max(last[car], measured[car] - SPEED_SLACK_MPS), measured[car] + SPEED_SLACK_MPS)
        goal = told[car] if told[car] * before >= 0.0 else 0.0
        rate = rates[car, 1] if abs(goal) < abs(before) else rates[car, 0]
        last[car] = min(max(goal, before - rate), before + rate)
