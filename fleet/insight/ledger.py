"""Ledger: where the time of every car and every station went; each tick of a car is in exactly one account."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.roster import PHASES, CarPhase
from fleet.world.protocol import FloatArray

STANDING_MPS = 0.05
"""Below this speed a car stands."""
QUEUE_M = 4.0
"""A car that stands this near the busy dock it is bound for is in its queue; farther away it waits in traffic [m]."""

Ticks = npt.NDArray[np.int64]


class Account(IntEnum):
    """What a car's time is spent on."""

    DRIVING_LOADED = 0
    DRIVING_EMPTY = 1
    TRAFFIC = 2
    """Stands on its way."""
    QUEUE = 3
    """Stands before a busy station, or is held back until its station has room."""
    SERVED = 4
    CHARGING = 5
    FAULT = 6
    """Dead, off its lane, or out of service with a parcel that could not be unloaded."""
    IDLE = 7
    VISITING = 8
    """Stands where a visit takes it."""


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


@dataclass(frozen=True, kw_only=True)
class StationTime:
    """Where the time of one station went."""

    busy: int
    """Ticks in which its arm was at work for a car."""
    contended: int
    """Ticks of these in which another car waited for it."""
    waiting: int
    """Ticks that cars waited for it while it was busy, all cars together."""


class Ledger:
    """Accounts of all cars and stations, in ticks.

    Args:
        n_cars: Number of cars.
        dock_xy: Centre of each station's dock [m], shape (n_stations, 2).
    """

    def __init__(self, n_cars: int, dock_xy: FloatArray) -> None:
        self.cars: Ticks = np.zeros((len(Account), n_cars), dtype=np.int64)
        """Ticks in each account, shape (n_accounts, n_cars)."""
        self.stations: Ticks = np.zeros((3, len(dock_xy)), dtype=np.int64)
        """Ticks busy, contended, and of waiting cars, shape (3, n_stations)."""
        self._dock_xy = np.ascontiguousarray(dock_xy, dtype=np.float64)

    def tick(
        self, phase: Ticks, loaded: Ticks, place: Ticks, served: Ticks, speeds: FloatArray, xy: FloatArray
    ) -> None:
        """Book one tick.

        Args:
            phase: Index of each car's phase in `PHASES`, shape (n_cars,).
            loaded: 1 for a car with a parcel, else 0, shape (n_cars,).
            place: Station each car is booked at or waits for, -1 for none, shape (n_cars,).
            served: Car each arm is at work on, -1 for none, shape (n_stations,).
            speeds: Signed speeds [m/s], shape (n_cars,).
            xy: Rear axles, x, y first [m], shape (n_cars, 2 or more).
        """
        _book(self.cars, self.stations, _RULES, self._dock_xy, phase, loaded, place, served, speeds, xy)

    def car_time(self, car: int) -> CarTime:
        """Accounts of one car."""
        return _car_time(self.cars[:, car])

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
    return CarTime(**{account.name.lower(): int(ticks[account]) for account in Account})


@njit(cache=True)
def _book(cars, stations, rules, dock_xy, phase, loaded, place, served, speeds, xy):  # one kernel, on flat arrays
    n_stations = len(dock_xy)
    waiting = np.zeros(n_stations, dtype=np.int64)
    for car in range(len(phase)):
        rule = rules[phase[car]]
        if rule >= 0:
            cars[rule, car] += 1
            continue
        if abs(speeds[car]) >= STANDING_MPS:
            cars[0 if loaded[car] else 1, car] += 1
            continue
        if rule == _IDLE:
            cars[7, car] += 1
            continue
        station = place[car]
        queues = rule == _HELD
        if not queues and 0 <= station < n_stations:
            dx, dy = xy[car, 0] - dock_xy[station, 0], xy[car, 1] - dock_xy[station, 1]
            away_m = math.hypot(dx, dy)
            # Nobody else is served when a car at the dock waits for a slot, or for an arm on its way home from it.
            queues = away_m < 1.0 or (away_m < QUEUE_M and served[station] >= 0)
        cars[3 if queues else 2, car] += 1
        if queues and 0 <= station < n_stations:
            waiting[station] += 1
    for station in range(n_stations):
        if served[station] >= 0:
            stations[0, station] += 1
            stations[1, station] += waiting[station] > 0
            stations[2, station] += waiting[station]
