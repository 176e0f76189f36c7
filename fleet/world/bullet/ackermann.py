"""Ackermann: how the wheels of a car on one curve differ, from the bicycle's command to its motors and back."""

from __future__ import annotations

import numpy as np
from numba import njit

from fleet.arrays import FloatArray, IntArray
from fleet.robots.cars.models import CarModels


class Ackermann:
    """The wheels of cars, in the order of `fleet.robots.spec.WHEELS`: rear left, rear right, front ones.

    Tangents and arc tangents are numpy's: those of kernels differ in the last bit.

    Args:
        models: Models of the cars.
    """

    def __init__(self, models: CarModels) -> None:
        self._wheelbase_m = models.each("wheelbase_m")
        self._radius_m = models.each("wheel_radius_m")
        self._places = np.array([kind.wheel_places for kind in models.kinds])[models.kind_of]

    def motions(self, cars: IntArray, steering: FloatArray, speeds: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Let every wheel roll on its own circle.

        Args:
            cars: Which of the cars, shape (n,).
            steering: Angles of bicycles [rad], shape (n,).
            speeds: Of the middle of the rear axles [m/s], shape (n,).

        Returns:
            Speeds of the wheels [rad/s], shape (n, 4), and angles of the front wheels [rad], shape (n, 2).
        """
        spins, sides, heads = np.empty((len(speeds), 4)), np.empty((len(speeds), 2)), np.empty((len(speeds), 2))
        bodies = (self._places, self._wheelbase_m, self._radius_m)
        _roll(cars, np.tan(steering), speeds, bodies, spins, sides, heads)
        return spins, np.arctan2(sides, heads)

    def bicycles(self, cars: IntArray, angles: FloatArray) -> FloatArray:
        """Find the bicycle in a car's front wheels, both of which know the curvature.

        Args:
            cars: Which of the cars, shape (n,).
            angles: Of the front wheels, left first [rad], shape (n, 2).

        Returns:
            Steering angles [rad], shape (n,).
        """
        slopes = np.empty(len(angles))
        _slopes(cars, np.tan(angles), self._places, self._wheelbase_m, slopes)
        return np.arctan(slopes)


@njit(cache=True)
def _roll(
    cars: IntArray,
    tangents: FloatArray,
    speeds: FloatArray,
    bodies: tuple[FloatArray, FloatArray, FloatArray],
    spins: FloatArray,
    sides: FloatArray,
    heads: FloatArray,
) -> None:
    """Fill in the wheels' speeds, and how far the front wheels go sideways and ahead per metre of the rear axle."""
    places, wheelbase, radius = bodies
    for row, car in enumerate(cars):
        curvature, spin = tangents[row] / wheelbase[car], speeds[row] / radius[car]
        for wheel in range(4):
            side = curvature * places[car, wheel, 0]
            head = 1.0 - curvature * places[car, wheel, 1]
            spins[row, wheel] = spin * np.hypot(side, head)
            if wheel >= 2:
                sides[row, wheel - 2], heads[row, wheel - 2] = side, head


@njit(cache=True)
def _slopes(
    cars: IntArray, tangents: FloatArray, places: FloatArray, wheelbase: FloatArray, slopes: FloatArray
) -> None:
    """Tangents of the bicycles' angles.

    The curvature is 1 / (L / tan(angle) -+ t/2), written so that straight ahead is no exception.
    """
    for row, car in enumerate(cars):
        left, right = tangents[row]
        left_curvature = left / (wheelbase[car] + left * places[car, 2, 1])
        right_curvature = right / (wheelbase[car] + right * places[car, 3, 1])
        slopes[row] = wheelbase[car] * ((left_curvature + right_curvature) / 2)
