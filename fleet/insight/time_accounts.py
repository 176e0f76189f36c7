"""TimeAccounts: where the time of every robot and station went; each tick of a robot is in exactly one account."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray
from fleet.insight.causes import DETAIL_OF, DETAILS, NONE, NOT_KEPT_BY_PLACE, WITHOUT_TASK, Cause, CauseRows, Column
from fleet.missions.phases import PHASES, CarPhase

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
    """Stands before a busy station, or below an arm that is dead or told to stand still, or is held back until its
    station has room, or waits for a charger."""
    SERVED = 4
    """A car at a dock with an arm at work on it; an arm at work."""
    CHARGING = 5
    FAULT = 6
    """Dead, off its lane, told to stand still, or out of service with a parcel or pod that it could not bring where it
    belongs; an arm that is dead or told to stand still."""
    IDLE = 7
    """Has no task, as one that was taken out of service; an arm for which no car is bound."""
    VISITING = 8
    """Stands where a visit takes it."""
    PLAN_LATE = 9
    """Stands because its plan has not landed yet."""
    AWAITING = 10
    """An arm that waits for a car that is bound for it."""

    @property
    def words(self) -> str:
        """What it is called where people read it, such as "driving loaded"."""
        return self.name.lower().replace("_", " ")


WAITING = (Account.TRAFFIC, Account.QUEUE, Account.PLAN_LATE)
"""Those in which a robot with a task waits."""


_DRIVES = -1  # an account is found from speed, load and station
_HELD = -2
_IDLE = -3
_OUT = -4
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
    CarPhase.RETIRED: _OUT,
    CarPhase.DEAD: Account.FAULT,
}
_RULES = np.array([_RULE[phase] for phase in PHASES], dtype=np.int64)
_ARM_RULE = {
    Cause.WORKS: Account.SERVED,
    Cause.AWAITS: Account.AWAITING,
    Cause.OTHER_ARM: Account.TRAFFIC,
    Cause.PLAN_LATE: Account.PLAN_LATE,
    Cause.FAULT: Account.FAULT,
}
_ARM_RULES = np.array([_ARM_RULE.get(cause, Account.IDLE) for cause in Cause], dtype=np.int64)
_HAS_PLACE = np.array([cause not in NOT_KEPT_BY_PLACE for cause in Cause])
_ENDS_CHAIN = np.array([cause in WITHOUT_TASK for cause in Cause])
# Kernels know plain numbers only.
_PLAN_LATE, _CHARGER, _FAULT, _ARM = map(int, (Cause.PLAN_LATE, Cause.CHARGER, Cause.FAULT, Cause.ARM))
_TAKEN_OUT = DETAIL_OF["out"]
_NOT_KNOWN = -2
_CAUSE, _BY, _CELL, _PLACE, _DETAIL = (
    int(c) for c in (Column.CAUSE, Column.BY, Column.CELL, Column.PLACE, Column.DETAIL)
)


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
    fault: int
    """Dead, or told to stand still."""
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


class _Booked(NamedTuple):
    """What is booked, as in `TimeAccounts`."""

    now: Ticks
    robots: Ticks
    stations: Ticks
    by_robot: Ticks
    by_cell: Ticks
    by_place: Ticks
    idle: Ticks


class _Rules(NamedTuple):
    """What decides about a tick besides the tick itself."""

    cars: Ticks
    """Rule of each phase, shape (n_phases,)."""
    arms: Ticks
    """Account of each cause, shape (n_causes,)."""
    has_place: npt.NDArray[np.bool_]
    ends_chain: npt.NDArray[np.bool_]
    """Shape (n_causes,)."""
    dock_xy: FloatArray


class _Tick(NamedTuple):
    """What is booked from, as in `TimeAccounts.tick`."""

    causes: CauseRows
    phase: Ticks
    loaded: Ticks
    place: Ticks
    served: Ticks
    paces: FloatArray
    xy: FloatArray


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
        self.now: Ticks = np.full(n_robots, Account.IDLE, dtype=np.int64)
        """Account that the last tick of each robot is in, cars first, then arms, shape (n_robots,)."""
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
        self.idle: Ticks = np.zeros(len(DETAILS), dtype=np.int64)
        """Ticks that cars were idle, by why they had no task, shape (n_details,)."""
        self._n_cars = n_cars
        self._booked = _Booked(
            self.now, self.robots, self.stations, self.by_robot, self.by_cell, self.by_place, self.idle
        )
        docks = np.ascontiguousarray(dock_xy, dtype=np.float64)
        self._rules = _Rules(_RULES, _ARM_RULES, _HAS_PLACE, _ENDS_CHAIN, docks)

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
        paces: FloatArray,
        xy: FloatArray,
    ) -> None:
        """Book one tick.

        Args:
            causes: What each robot is about, shape (n_robots, len(Column)).
            phase: Index of each car's phase in `PHASES`, shape (n_cars,).
            loaded: 1 for a car with a parcel, else 0, shape (n_cars,).
            place: Station each car is booked at or waits for, -1 for none, shape (n_cars,).
            served: Car each arm is at work on, -1 for none, shape (n_stations,).
            paces: How fast the cars move along their paths, by turns on the spot, too [m/s], shape (n_cars,).
            xy: Rear axles, x, y first [m], shape (n_cars, 2 or more).
        """
        _book(self._booked, self._rules, _Tick(causes, phase, loaded, place, served, paces, xy))

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


# Each kernel has a loop of its own: bundles of arrays are slow to hand on, robot by robot.


@njit(cache=True)
def _book(booked: _Booked, rules: _Rules, tick: _Tick) -> None:
    n_robots = len(tick.causes)
    accounts, ends = booked.now, np.full(n_robots, _NOT_KNOWN, dtype=np.int64)
    _find_accounts(rules, tick, accounts)
    _find_ends(tick.causes, rules.ends_chain, ends)
    _put_down(booked, rules.has_place, tick.causes, accounts, ends)
    _count_waiting(booked.stations, tick, accounts)
    _count_idle(booked.idle, tick, accounts)


@njit(cache=True)
def _find_accounts(rules: _Rules, tick: _Tick, accounts: Ticks) -> None:
    """The account that a tick of each robot belongs to."""
    car_rules, arm_rules, _, _, dock_xy = rules
    causes, phase, loaded, place, served, paces, xy = tick
    n_cars = len(phase)
    for robot in range(n_cars, len(causes)):
        accounts[robot] = arm_rules[causes[robot, _CAUSE]]
    for car in range(n_cars):
        rule, cause, station = car_rules[phase[car]], causes[car, _CAUSE], place[car]
        if rule >= 0:
            accounts[car] = 3 if cause == _ARM else rule
        elif rule == _OUT and causes[car, _DETAIL] != _TAKEN_OUT:
            accounts[car] = 6
        elif abs(paces[car]) >= STANDING_MPS:
            accounts[car] = 0 if loaded[car] else 1
        elif rule == _OUT:
            accounts[car] = 7
        elif rule == _IDLE:
            accounts[car] = 3 if cause == _CHARGER else 7
        elif cause == _FAULT:
            accounts[car] = 6
        elif cause == _PLAN_LATE:
            accounts[car] = 9
        elif rule == _HELD:
            accounts[car] = 3
        elif 0 <= station < len(dock_xy):
            away_m = math.hypot(xy[car, 0] - dock_xy[station, 0], xy[car, 1] - dock_xy[station, 1])
            # Nobody else is served when a car at the dock waits for a slot, or for an arm on its way home from it.
            accounts[car] = 3 if away_m < 1.0 or (away_m < QUEUE_M and served[station] >= 0) else 2
        else:
            accounts[car] = 2


@njit(cache=True)
def _find_ends(causes: CauseRows, ends_chain: npt.NDArray[np.bool_], ends: Ticks) -> None:
    """Where the chain ends that leads on from each robot, `NONE` if in a circle; `ends` comes as `_NOT_KNOWN`."""
    for first in range(len(causes)):
        robot = first
        while ends[robot] == _NOT_KNOWN:
            if causes[robot, _BY] == NONE or ends_chain[causes[robot, _CAUSE]]:
                ends[robot] = robot
            else:
                ends[robot] = NONE  # as it stays if the walk comes back here
                robot = causes[robot, _BY]
        end, robot = ends[robot], first
        while ends[robot] != end:
            ends[robot] = end
            robot = causes[robot, _BY]


@njit(cache=True)
def _put_down(
    booked: _Booked, has_place: npt.NDArray[np.bool_], causes: CauseRows, accounts: Ticks, ends: Ticks
) -> None:
    """Put one tick of each robot down to a robot, a cell and a place; the last of each stands for none."""
    _, robots, _, by_robot, by_cell, by_place, _ = booked
    for robot in range(len(causes)):
        account = accounts[robot]
        root, cell, at = len(causes), NONE, NONE
        if account > 1:
            root, by = robot, causes[robot, _BY]
            if by != NONE:
                root = ends[by] if ends[by] != NONE else by
            cell = causes[robot, _CELL]
            at = causes[root, _PLACE] if has_place[causes[root, _CAUSE]] else NONE
            if at == NONE and has_place[causes[robot, _CAUSE]]:
                at = causes[robot, _PLACE]
        robots[account, robot] += 1
        by_robot[account, root] += 1
        by_cell[account, cell] += 1
        by_place[account, at] += 1


@njit(cache=True)
def _count_waiting(stations: Ticks, tick: _Tick, accounts: Ticks) -> None:
    """Count the ticks in which stations were busy, and what cars waited for them meanwhile."""
    first_arm = len(tick.phase)
    place, served = tick.place, tick.served
    waiting = np.zeros(stations.shape[1], dtype=np.int64)
    for car in range(len(place)):
        if accounts[car] == 3 and 0 <= place[car] < len(waiting):
            waiting[place[car]] += 1
    for station in range(len(waiting)):
        if served[station] >= 0 and accounts[first_arm + station] != 6:
            stations[0, station] += 1
            stations[1, station] += waiting[station] > 0
            stations[2, station] += waiting[station]


@njit(cache=True)
def _count_idle(idle: Ticks, tick: _Tick, accounts: Ticks) -> None:
    """Count why cars have no task."""
    for car in range(len(tick.place)):
        if accounts[car] == 7:
            idle[tick.causes[car, _DETAIL]] += 1
