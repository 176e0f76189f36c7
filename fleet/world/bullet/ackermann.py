"""Ackermann: how the wheels of a car on one curve differ, from the bicycle's command to its motors and back."""

from __future__ import annotations

import numpy as np
from numba import njit

from fleet.arrays import FloatArray
from fleet.robots.racecar import wheel_places
from fleet.robots.spec import CarSpec


class Ackermann:
    """The wheels of a car model, in the order of `fleet.robots.racecar.WHEELS`: rear left, rear right, front ones.

    Tangents and arc tangents are numpy's: those of kernels differ in the last bit.

    Args:
        spec: Car model.
    """

    def __init__(self, spec: CarSpec) -> None:
        self._wheelbase_m = spec.wheelbase_m
        self._radius_m = spec.wheel_radius_m
        self._places = wheel_places(spec)

    def motions(self, steering: FloatArray, speeds: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Let every wheel roll on its own circle.

        Args:
            steering: Angles of bicycles [rad], shape (n,).
            speeds: Of the middle of the rear axles [m/s], shape (n,).

        Returns:
            Speeds of the wheels [rad/s], shape (n, 4), and angles of the front wheels [rad], shape (n, 2).
        """
        spins, sides, heads = np.empty((len(speeds), 4)), np.empty((len(speeds), 2)), np.empty((len(speeds), 2))
        _roll(np.tan(steering), speeds, self._places, self._wheelbase_m, self._radius_m, spins, sides, heads)
        return spins, np.arctan2(sides, heads)

    def bicycles(self, angles: FloatArray) -> FloatArray:
        """Find the bicycle in a car's front wheels, both of which know the curvature.

        Args:
            angles: Of the front wheels, left first [rad], shape (n, 2).

        Returns:
            Steering angles [rad], shape (n,).
        """
        slopes = np.empty(len(angles))
        _slopes(np.tan(angles), self._places, self._wheelbase_m, slopes)
        return np.arctan(slopes)


@njit(cache=True)
def _roll(
    tangents: FloatArray,
    speeds: FloatArray,
    places: FloatArray,
    wheelbase: float,
    radius: float,
    spins: FloatArray,
    sides: FloatArray,
    heads: FloatArray,
) -> None:
    """Fill in the wheels' speeds, and how far the front wheels go sideways and ahead per metre of the rear axle."""
    for car in range(len(speeds)):
        curvature, spin = tangents[car] / wheelbase, speeds[car] / radius
        for wheel in range(4):
            side = curvature * places[wheel, 0]
            head = 1.0 - curvature * places[wheel, 1]
            spins[car, wheel] = spin * np.hypot(side, head)
            if wheel >= 2:
                sides[car, wheel - 2], heads[car, wheel - 2] = side, head


@njit(cache=True)
def _slopes(tangents: FloatArray, places: FloatArray, wheelbase: float, slopes: FloatArray) -> None:
    """Tangents of the bicycles' angles.

    The curvature is 1 / (L / tan(angle) -+ t/2), written so that straight ahead is no exception.
    """
    for car in range(len(slopes)):
        left, right = tangents[car]
        left_curvature = left / (wheelbase + left * places[2, 1])
        right_curvature = right / (wheelbase + right * places[3, 1])
        slopes[car] = wheelbase * ((left_curvature + right_curvature) / 2)
