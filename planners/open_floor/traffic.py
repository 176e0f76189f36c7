"""FloorTraffic: cars on an open floor that get one way after another, while the others are driving.

A new way is planned at once to its end, around where all others will be as far as can be foreseen. Then only the order
in which ways cross counts: a car that is late is waited for, and can collide with nobody.

Source: the order of crossing ways is the action dependency graph of W. Hönig et al., "Persistent and Robust Execution
of MAPF Schedules in Warehouses", IEEE RA-L 4(2), 2019, for samples of ways in place of cells.
"""

from __future__ import annotations

import math

import numpy as np

from planners.errors import PlanningError
from planners.open_floor.arrays import FloatArray
from planners.open_floor.car_search import CarSearch, OpenFloorConfig
from planners.open_floor.kernels.body import body_of
from planners.open_floor.kernels.crossings import NO_ROOM, STUCK, CrossingWays, foresee, grant, order
from planners.open_floor.kernels.standing import KeptMargins, margins_kept
from planners.open_floor.plan import CarWay
from planners.open_floor.problem import OpenFloorError, OpenFloorProblem

_FIRST_SAMPLES = 512
"""Samples of a way that there is room for at first; it doubles when one is longer."""
_NEARLY = 0.9
"""A car has come to a sample that is this share of the way between two samples ahead, which the margin has room for."""


class FloorTraffic:
    """Ways of cars that are on their way or stand.

    Args:
        problem: Floor and cars; they stand at their starts, and the goals say nothing.
        config: Settings.
        ahead_m: How far ahead of itself a car is granted its way: at least as far as it needs to stop.

    Raises:
        OpenFloorError: The cars stand nearer to each other, or to obstacles, than the margin; or that is less than what
            a corner of a car moves from sample to sample.
    """

    def __init__(
        self, problem: OpenFloorProblem, config: OpenFloorConfig | None = None, *, ahead_m: float = 0.6
    ) -> None:
        config, n = config or OpenFloorConfig(), problem.n_cars
        car = problem.car
        self._body, margin = body_of(car), config.margin_radii * car.turning_radius_m
        if margins_kept(problem, self._body, margin) != KeptMargins(margin, margin):
            raise OpenFloorError(f"open floor: cars stand nearer than {margin:g} m to something; valid: further off")
        self._config, self._hard = config, np.full(n, np.inf)
        self._search = CarSearch(problem, self._body, KeptMargins(margin, margin), config)
        self._span = config.step_radii * car.turning_radius_m / config.checks
        # Ways that are a margin apart at equal times must not be in conflict a tick earlier or later: else two cars
        # could have to wait for each other.
        swing = math.hypot(max(car.front_m, car.rear_m), car.turning_radius_m + car.half_width_m)
        self._conflict = margin - swing / car.turning_radius_m * self._span
        if self._conflict < 0:
            raise OpenFloorError(f"open floor: margin_radii = {config.margin_radii}; valid: more, or more checks")
        self._ahead = math.ceil(ahead_m / self._span)
        self._ways = CrossingWays(
            pose=np.zeros((n, _FIRST_SAMPLES, 4)),
            n_samples=np.ones(n, dtype=np.int64),
            need=np.zeros((n, n, _FIRST_SAMPLES), dtype=np.int32),
        )
        self._along = np.zeros((n, _FIRST_SAMPLES))
        self._now, self._granted, self._arrival = np.zeros((3, n), dtype=np.int64)
        x, y, yaw = problem.starts.T
        self._ways.pose[:, 0] = np.column_stack((x, y, np.cos(yaw), np.sin(yaw)))

    @property
    def looked(self) -> int:
        """Poses that all searches have looked at."""
        return self._search.looked

    def arrived(self, car: int) -> bool:
        """Whether a car has come to the end of its way."""
        return bool(self._now[car] == self._ways.n_samples[car] - 1)

    def send(self, car: int, pose: FloatArray, goal: FloatArray) -> CarWay | None:
        """Give a car that has arrived a way, around all others.

        Args:
            car: Which.
            pose: Where it stands, x, y, yaw, shape (3,).
            goal: Where it is to go and stay until it is sent on, shape (3,).

        Returns:
            The way; None if there is none now, and then nothing has changed.

        Raises:
            PlanningError: The car is on its way.
        """
        if not self.arrived(car):
            raise PlanningError(f"open floor: car {car} is on its way; valid: a car that has arrived")
        at, n_ticks = self._foreseen()
        for other in range(len(self._now)):
            self._search.give_up(other)
            if other != car:
                last = min(int(self._arrival[other]), n_ticks)
                self._search.occupy(other, self._ways.pose[other, at[other, : last + 1]])
        legs, _ = self._search.find(pose, goal, self._hard, self._config.most_poses)
        if legs is None:
            return None
        samples = self._search.sampled(car, pose, legs)
        self._reserve(len(samples))
        n = len(samples)
        kept = self._ways.pose[car].copy(), int(self._ways.n_samples[car])
        self._ways.pose[car, :n] = samples
        self._ways.n_samples[car] = n
        self._ways.need[:, car] = 0  # it has come to the end of its last way
        if not order(self._ways, car, self._granted, at, n_ticks, self._span, self._body, self._conflict):
            self._ways.pose[car], self._ways.n_samples[car] = kept
            return None
        self._now[car] = self._granted[car] = 0
        ends = np.concatenate([[0.0], np.cumsum(legs[:, 0])])
        driven = np.concatenate([[0.0], np.cumsum(np.abs(legs[:, 1]))])
        self._along[car, :n] = np.interp(np.arange(n) / self._config.checks, ends, driven)
        return CarWay(start=pose.copy(), legs=legs * [self._search.step_s, 1.0, 1.0])

    def granted_m(self, driven_m: FloatArray) -> FloatArray:
        """How far cars may drive along their ways.

        Args:
            driven_m: How far each has come along its way, backwards counted like forwards [m], shape (n_cars,).

        Returns:
            Length from the start of the way at which each has to stop [m], shape (n_cars,).
        """
        for car, driven in enumerate(driven_m):
            row = self._along[car, : self._ways.n_samples[car]]
            # A car stands where it has come almost to its stop, and nobody goes back.
            come = int(np.searchsorted(row, driven + _NEARLY * self._span, side="right")) - 1
            self._now[car] = max(self._now[car], min(come, self._granted[car]))
        grant(self._ways, self._now, self._granted, self._ahead)
        return self._along[np.arange(len(driven_m)), self._granted]

    def _foreseen(self) -> tuple[np.ndarray, int]:
        """Sample of each car at each tick from now on, and how many ticks until all stand."""
        n_ticks, room = NO_ROOM, 2 * self._along.shape[1]
        while n_ticks == NO_ROOM:
            at = np.empty((len(self._now), room), dtype=np.int32)
            n_ticks = foresee(self._ways, self._now, at, self._arrival)
            room *= 2
        if n_ticks == STUCK:
            raise OpenFloorError("open floor: cars wait for each other in a ring, which the order of crossings forbids")
        return at, n_ticks

    def _reserve(self, n_samples: int) -> None:
        """Make room for ways of so many samples."""
        more = max(n_samples, 2 * self._along.shape[1]) - self._along.shape[1]
        if n_samples <= self._along.shape[1]:
            return
        ways = self._ways
        self._ways = ways._replace(
            pose=np.pad(ways.pose, ((0, 0), (0, more), (0, 0))), need=np.pad(ways.need, ((0, 0), (0, 0), (0, more)))
        )
        self._along = np.pad(self._along, ((0, 0), (0, more)))
