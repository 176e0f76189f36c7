"""YardDriver: ways become paths, and cars are driven along them as far as they may."""

from __future__ import annotations

import itertools

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.cars.models import CarModels
from fleet.robots.pursuit import Follower, FollowerConfig, PathBuffer
from fleet.robots.spec import CarSpec
from planners.open_floor import CarWay

_SPACING_M = 0.04
"""Between points of a path."""
_LATERAL_MPS2 = 1.5
"""Sideways acceleration on curves, less than on lanes: here curves to both sides follow each other without a straight
line between them, on which a car that drove wide would come back to its way."""


class YardDriver:
    """Follows the ways of all cars.

    Args:
        spec: The car model.
        poses: Where the cars stand, shape (n_cars, 3).
        tick_s: Control period [s].
        speed_mps: Fastest that cars drive.
        backwards_mps: The same backwards, where the steered wheels are behind and errors grow.
    """

    def __init__(self, spec: CarSpec, poses: FloatArray, tick_s: float, speed_mps: float, backwards_mps: float) -> None:
        n = len(poses)
        self._paths = PathBuffer(n)
        self._follower = Follower(CarModels.alike(spec, n), tick_s, FollowerConfig(max_lateral_mps2=_LATERAL_MPS2))
        self._paths.points[:, 0] = poses
        self._begin_s = np.zeros(n)
        self._speed_mps, self._backwards_mps = speed_mps, backwards_mps

    @property
    def driven_m(self) -> FloatArray:
        """How far each car has come along its way [m], shape (n_cars,)."""
        return self._follower.progress - self._begin_s

    @property
    def beside_m(self) -> float:
        """How far the car furthest from its path is beside it [m]."""
        return float(np.abs(self._follower.cross_track).max(initial=0.0))

    def take(self, car: int, way: CarWay) -> None:
        """Let a car that stands have a new way, which begins where it stands."""
        self._paths.reset(car, way.start)
        self._follower.reset(car)
        self._begin_s[car] = self._paths.progress[car]
        for direction, legs in itertools.groupby(
            (leg for leg in way.legs if leg[1] != 0.0), key=lambda leg: int(np.sign(leg[1]))
        ):
            driven = np.array(list(legs))
            driven[:, 0] = np.abs(driven[:, 1])  # one metre in a second: time is length
            start = self._paths.points[car, self._paths.count[car] - 1].copy()
            length = driven[:, 0].sum()
            s = np.linspace(0.0, length, max(2, int(np.ceil(length / _SPACING_M)) + 1))
            self._paths.append(car, CarWay(start=start, legs=driven).poses(s), s, direction)

    def ahead(self, stop_m: FloatArray) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
        """What is left of the ways, as polylines of shape (k, 2) [m].

        Args:
            stop_m: Where along its way each has to stop [m], shape (n_cars,).

        Returns:
            For each car the part that it may drive, and the part behind that.
        """
        paths, granted, planned = self._paths, [], []
        for car, stop_s in enumerate(self._begin_s + stop_m):
            n = int(paths.count[car])
            points, s = paths.points[car, :n, :2], paths.s[car, :n]
            here, stop = np.searchsorted(s, (self._follower.progress[car], stop_s + 1e-9))
            granted.append(points[here:stop].copy())
            planned.append(points[max(here, stop - 1) :].copy())
        return tuple(granted), tuple(planned)

    def commands(self, poses: FloatArray, speeds: FloatArray, stop_m: FloatArray) -> FloatArray:
        """Say what every car does this tick.

        Args:
            poses: Rear-axle poses, shape (n_cars, 3).
            speeds: Signed speeds [m/s], shape (n_cars,).
            stop_m: Where along its way each has to stop [m], shape (n_cars,).

        Returns:
            Steering [rad] and speed [m/s], shape (n_cars, 2).
        """
        paths = self._paths
        cars, ahead = np.arange(len(poses)), np.minimum(paths.cursor + 1, paths.count - 1)
        cap = np.where(paths.direction[cars, ahead] < 0, self._backwards_mps, self._speed_mps)
        return self._follower.commands(paths, poses, speeds, self._begin_s + stop_m, cap)
