"""Ledger: where the time of every robot and station went; each tick of a robot is in exactly one account."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.insight.causes import NONE, NOT_KEPT_BY_PLACE, WITHOUT_TASK, Cause, CauseRows, Column
from fleet.missions.phases import PHASES, CarPhase
from fleet.world.protocol import FloatArray

STANDING_MPS = 0.05
"""Below this speed a car stands."""
QUEUE_M = 4.0
"""A car that stands this near the busy dock it is bound for is in its queue; farther away it waits in traffic [m]."""

Ticks = npt.NDArray[np.int64]


class Account(IntEnum):
    """What a robot's time is spent on."""

    DRIVING_LOADED = 0
    DRIVING_EMPTY = 1
    TRAFFIC = 2
    """A car that stands on its way; an arm that waits until its sibling is out of the way."""
    QUEUE = 3
    """Stands before a busy station, or is held back until its station has room, or waits for a charger."""
    SERVED = 4
    """A car at a dock with an arm at work on it; an arm at work."""
    CHARGING = 5
    FAULT = 6
    """Dead, off its lane, or out of service with a parcel that could not be unloaded."""
    IDLE = 7
    """Has no task; an arm for which no car is bound."""
    VISITING = 8
    """Stands where a visit takes it."""
    PLAN_LATE = 9
    """Stands because its plan has not landed yet."""
    AWAITING = 10
    """An arm that waits for a car that is bound for it."""


_DRIVES = -1  # an account is found from speed, load and station
_HELD = -2
_IDLE = -3
_RULE = {
    CarPhase.IDLE: _IDLE,
    CarPhase.TO_PICK: _DRIVES,
    CarPhase.LOADING: Account.SERVED,
    CarPhase.HELD: _HELD,
    CarPhase.TO_DROP: _DRIVES,
    CarPhase.UNLOADING: Account.SERVED,
    CarPhase.TO_CHARGER: _DRIVES,
    CarPhase.CHARGING: Account.CHARGING,
    CarPhase.TO_PLACE: _DRIVES,
    CarPhase.STANDING: Account.VISITING,
    CarPhase.RECOVERING: Account.FAULT,
    CarPhase.RETIRED: Account.FAULT,
    CarPhase.DEAD: Account.FAULT,
}
_RULES = np.array([_RULE[phase] for phase in PHASES], dtype=np.int64)
_ARM_RULE = {
    Cause.WORKS: Account.SERVED,
    Cause.AWAITS: Account.AWAITING,
    Cause.OTHER_ARM: Account.TRAFFIC,
    Cause.PLAN_LATE: Account.PLAN_LATE,
}
_ARM_RULES = np.array([_ARM_RULE.get(cause, Account.IDLE) for cause in Cause], dtype=np.int64)
_HAS_PLACE = np.array([cause not in NOT_KEPT_BY_PLACE for cause in Cause])
_ENDS_CHAIN = np.array([cause in WITHOUT_TASK for cause in Cause])
_PLAN_LATE, _CHARGER = int(Cause.PLAN_LATE), int(Cause.CHARGER)  # kernels know plain numbers only
_CAUSE, _BY, _CELL, _PLACE = (int(c) for c in (Column.CAUSE, Column.BY, Column.CELL, Column.PLACE))


@dataclass(frozen=True, kw_only=True)
class CarTime:
    """Where the time of one car, or of all, went: ticks in each account; they add up to the ticks of the run."""

    driving_loaded: int
    driving_empty: int
    traffic: int
    queue: int
    served: int
    charging: int
    fault: int
    idle: int
    visiting: int
    plan_late: int


@dataclass(frozen=True, kw_only=True)
class ArmTime:
    """Where the time of one arm went: ticks in each account; they add up to the ticks of the run."""

    served: int
    """At work."""
    awaiting: int
    traffic: int
    """Waiting until its sibling was out of the way."""
    plan_late: int
    idle: int


@dataclass(frozen=True, kw_only=True)
class StationTime:
    """Where the time of one station went."""

    busy: int
    """Ticks in which its arm was at work for a car."""
    contended: int
    """Ticks of these in which another car waited for it."""
    waiting: int
    """Ticks that cars waited for it while it was busy, all cars together."""


class TimeAccounts:
    """Accounts of all robots and stations, in ticks, and whom and what each tick is put down to.

    Each tick is put down to one robot, one cell and one place, or to none. The **robot** is the root: the end of the
    chain of who waits for whom, in a circle the one that is waited for; who waits for none is its own root, and time
    spent driving is put down to nobody. The **cell** is the one that the robot itself cannot enter: there the time is
    lost. The **place** is that of the root if a station or charger is what the root is about, else the robot's own.

    Args:
        n_cars: Number of cars.
        dock_xy: Centre of each station's dock [m], shape (n_stations, 2); each has one arm.
        n_cells: Cells of the floor.
        n_places: Stations, chargers and parking places.
    """

    def __init__(self, n_cars: int, dock_xy: FloatArray, n_cells: int, n_places: int) -> None:
        n_robots = n_cars + len(dock_xy)
        self.robots: Ticks = np.zeros((len(Account), n_robots), dtype=np.int64)
        """Ticks in each account, cars first, then arms, shape (n_accounts, n_robots)."""
        self.stations: Ticks = np.zeros((3, len(dock_xy)), dtype=np.int64)
        """Ticks busy, contended, and of waiting cars, shape (3, n_stations)."""
        self.by_robot: Ticks = np.zeros((len(Account), n_robots + 1), dtype=np.int64)
        """Ticks of all robots put down to each robot, the last column to none, shape (n_accounts, n_robots + 1)."""
        self.by_cell: Ticks = np.zeros((len(Account), n_cells + 1), dtype=np.int64)
        """The same for cells, shape (n_accounts, n_cells + 1)."""
        self.by_place: Ticks = np.zeros((len(Account), n_places + 1), dtype=np.int64)
        """The same for stations, chargers and parking places, shape (n_accounts, n_places + 1)."""
        self._n_cars = n_cars
        self._dock_xy = np.ascontiguousarray(dock_xy, dtype=np.float64)

    @property
    def cars(self) -> Ticks:
        """Ticks in each account, shape (n_accounts, n_cars)."""
        return self.robots[:, : self._n_cars]

    def tick(
        self,
        causes: CauseRows,
        phase: Ticks,
        loaded: Ticks,
        place: Ticks,
        served: Ticks,
        speeds: FloatArray,
        xy: FloatArray,
    ) -> None:
        """Book one tick.

        Args:
            causes: What each robot is about, shape (n_robots, len(Column)).
            phase: Index of each car's phase in `PHASES`, shape (n_cars,).
            loaded: 1 for a car with a parcel, else 0, shape (n_cars,).
            place: Station each car is booked at or waits for, -1 for none, shape (n_cars,).
            served: Car each arm is at work on, -1 for none, shape (n_stations,).
            speeds: Signed speeds [m/s], shape (n_cars,).
            xy: Rear axles, x, y first [m], shape (n_cars, 2 or more).
        """
        _book(
            self.robots,
            self.stations,
            self.by_robot,
            self.by_cell,
            self.by_place,
            _RULES,
            _ARM_RULES,
            _HAS_PLACE,
            _ENDS_CHAIN,
            self._dock_xy,
            causes,
            phase,
            loaded,
            place,
            served,
            speeds,
            xy,
        )

    def car_time(self, car: int) -> CarTime:
        """Accounts of one car."""
        return _car_time(self.cars[:, car])

    def arm_time(self, arm: int) -> ArmTime:
        """Accounts of one arm."""
        ticks = self.robots[:, self._n_cars + arm]
        return ArmTime(**{field.name: int(ticks[Account[field.name.upper()]]) for field in fields(ArmTime)})

    def fleet_time(self) -> CarTime:
        """Accounts of all cars together."""
        return _car_time(self.cars.sum(axis=1))

    def station_time(self, station: int) -> StationTime:
        """Accounts of one station."""
        busy, contended, waiting = self.stations[:, station].tolist()
        return StationTime(busy=busy, contended=contended, waiting=waiting)

    def bottleneck(self) -> int | None:
        """The station that was busy, and busy with a car waiting for it, for the greatest sum of times.

        The first counts too because cars come when it is about to be free: then few wait for an arm that always works.

        Returns:
            The station; None if no car ever waited for a busy one.
        """
        busy, contended, _ = self.stations
        return int(np.argmax(busy + contended)) if contended.any() else None


def percentages(ticks: Sequence[int]) -> list[float]:
    """Shares in per cent with one decimal that add up to 100, by the largest remainder; all zero for no ticks."""
    total = sum(ticks)
    if total == 0:
        return [0.0] * len(ticks)
    tenths = [1000 * tick // total for tick in ticks]
    by_remainder = sorted(range(len(ticks)), key=lambda k: (-(1000 * ticks[k] % total), k))
    for k in by_remainder[: 1000 - sum(tenths)]:
        tenths[k] += 1
    return [tenth / 10 for tenth in tenths]


def _car_time(ticks: Ticks) -> CarTime:
    return CarTime(**{field.name: int(ticks[Account[field.name.upper()]]) for field in fields(CarTime)})


@njit(cache=True)
def _book(
    robots,
    stations,
    by_robot,
    by_cell,
    by_place,
    rules,
    arm_rules,
    has_place,
    ends_chain,
    dock_xy,
    causes,
    phase,
    loaded,
    place,
    served,
    speeds,
    xy,
):  # one kernel, on flat arrays
    n_cars, n_stations = len(phase), len(dock_xy)
    waiting = np.zeros(n_stations, dtype=np.int64)
    for robot in range(len(causes)):
        if robot >= n_cars:
            account = arm_rules[causes[robot, _CAUSE]]
        else:
            car = robot
            account = _account(car, rules, dock_xy, causes, phase, loaded, place, served, speeds, xy)
            if account == 3 and 0 <= place[car] < n_stations:
                waiting[place[car]] += 1
        robots[account, robot] += 1
        _put_down(robot, account, by_robot, by_cell, by_place, has_place, ends_chain, causes)
    for station in range(n_stations):
        if served[station] >= 0:
            stations[0, station] += 1
            stations[1, station] += waiting[station] > 0
            stations[2, station] += waiting[station]


@njit(cache=True)
def _account(car, rules, dock_xy, causes, phase, loaded, place, served, speeds, xy):
    """The account that a tick of a car belongs to."""
    rule = rules[phase[car]]
    if rule >= 0:
        return rule
    if abs(speeds[car]) >= STANDING_MPS:
        return 0 if loaded[car] else 1
    cause = causes[car, _CAUSE]
    if rule == _IDLE:
        return 3 if cause == _CHARGER else 7
    if cause == _PLAN_LATE:
        return 9
    station = place[car]
    queues = rule == _HELD
    if not queues and 0 <= station < len(dock_xy):
        dx, dy = xy[car, 0] - dock_xy[station, 0], xy[car, 1] - dock_xy[station, 1]
        away_m = math.hypot(dx, dy)
        # Nobody else is served when a car at the dock waits for a slot, or for an arm on its way home from it.
        queues = away_m < 1.0 or (away_m < QUEUE_M and served[station] >= 0)
    return 3 if queues else 2


@njit(cache=True)
def _put_down(robot, account, by_robot, by_cell, by_place, has_place, ends_chain, causes):
    """Put one tick down to a robot, a cell and a place; the last of each stands for none."""
    n_robots = len(causes)
    root, cell, at = n_robots, NONE, NONE
    if account > 1:
        root = robot
        for k in range(n_robots):
            if causes[root, _BY] == NONE or (k > 0 and ends_chain[causes[root, _CAUSE]]):
                break
            root = causes[root, _BY]
        else:  # a circle
            root = causes[robot, _BY]
        cell = causes[robot, _CELL]
        at = causes[root, _PLACE] if has_place[causes[root, _CAUSE]] else NONE
        if at == NONE and has_place[causes[robot, _CAUSE]]:
            at = causes[robot, _PLACE]
    by_robot[account, root] += 1
    by_cell[account, cell] += 1
    by_place[account, at] += 1
