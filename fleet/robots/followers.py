"""Followers: drive the cars of a fleet along their paths, each by the follower that its drive asks for."""

from __future__ import annotations

import numpy as np

from fleet.arrays import BoolArray, FloatArray
from fleet.robots.cars.models import CarModels
from fleet.robots.pursuit import Follower, PathBuffer
from fleet.robots.twist.follower import TwistFollower


class Followers:
    """`Follower` for cars that steer and `TwistFollower` for those that are told a yaw rate, over the same cars.

    Attributes: as those of `Follower`; rows of all cars.

    Args:
        models: Models of the cars.
        tick_s: Control period [s].
    """

    def __init__(self, models: CarModels, tick_s: float) -> None:
        n_cars, steers = len(models), models.each("turn_base_m") > 0.0
        self._steered = Follower(models, tick_s, cars=np.flatnonzero(steers))
        self._twisted = []
        for number, kind in enumerate(models.kinds):
            if kind.differential is not None:
                cars = models.cars_of(number)
                drive = kind.differential
                own = TwistFollower(drive.limits, n_cars, tick_s, drive.follower, robots=cars)
                self._twisted.append((cars, own))
        self._own: list[Follower | TwistFollower] = [self._steered] * n_cars
        for cars, own in self._twisted:
            for car in cars.tolist():
                self._own[car] = own

    @property
    def progress(self) -> FloatArray:
        """See `Follower`."""
        return self._steered.progress

    @property
    def cross_track(self) -> FloatArray:
        """See `Follower`."""
        return self._steered.cross_track

    @property
    def heading_error(self) -> FloatArray:
        """See `Follower`."""
        return self._steered.heading_error

    @property
    def standing(self) -> BoolArray:
        """See `Follower`."""
        return self._steered.standing

    def brake(self, car: int, on: bool) -> None:
        """See `Follower`."""
        self._own[car].brake(car, on)

    def reset(self, car: int) -> None:
        """See `Follower`."""
        self._own[car].reset(car)
        self._steered.reset(car)

    def commands(
        self, paths: PathBuffer, poses: FloatArray, speeds: FloatArray, stop_s: FloatArray, speed_cap: FloatArray
    ) -> FloatArray:
        """Say what every car does this tick.

        Args:
            paths: Paths ahead; cursor and progress in it move on.
            poses: Estimated poses x, y, yaw, shape (n_cars, 3).
            speeds: Measured signed forward speeds [m/s], shape (n_cars,).
            stop_s: Arc length where each car must stand [m], shape (n_cars,).
            speed_cap: Greatest speed [m/s], >= 0, shape (n_cars,).

        Returns:
            Steering [rad] or yaw rate [rad/s], and signed speed [m/s], shape (n_cars, 2).
        """
        commands = self._steered.commands(paths, poses, speeds, stop_s, speed_cap)
        for cars, own in self._twisted:
            commands[cars] = own.commands(paths, poses, speeds, stop_s, speed_cap)[cars][:, ::-1]
            for name in ("cross_track", "heading_error", "standing"):
                getattr(self._steered, name)[cars] = getattr(own, name)[cars]
        self.progress[:] = paths.progress
        return commands


def follower_of(models: CarModels, tick_s: float) -> Follower | Followers:
    """Give the follower of a fleet.

    Args:
        models: Models of the cars.
        tick_s: Control period [s].
    """
    return Follower(models, tick_s) if all(kind.steers for kind in models.kinds) else Followers(models, tick_s)
