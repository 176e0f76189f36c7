"""Accounts: where the time of an abstract fleet's cars and stations goes, by the names that whole runs have for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fleet.abstract.compiled import compiled
from fleet.abstract.fleet import GridFleet
from fleet.abstract.kernel import FREE, LOADING, NONE, OUT, TO_PICK, UNLOADING, CarTable, Floor, StationTable
from fleet.insight.time_accounts import QUEUE_M, Account, CarTime

QUEUE_MOVES = round(QUEUE_M)
"""A car that stands so few moves before a busy dock is in its queue, as in whole runs."""
# Kernels know plain numbers only.
_LOADED, _EMPTY, _TRAFFIC = map(int, (Account.DRIVING_LOADED, Account.DRIVING_EMPTY, Account.TRAFFIC))
_QUEUE, _SERVED, _FAULT, _IDLE = map(int, (Account.QUEUE, Account.SERVED, Account.FAULT, Account.IDLE))


class _Steps(NamedTuple):
    cars: npt.NDArray[np.int64]
    """Timesteps of all cars in each account, shape (n_accounts,)."""
    stations: npt.NDArray[np.int64]
    """Timesteps busy, and contended, shape (2, k)."""
    waiting: npt.NDArray[np.int64]
    """Working memory: cars that wait for each station, shape (k,)."""
    serves: npt.NDArray[np.bool_]
    """Working memory: whether the arm of each station is at work on a car, shape (k,)."""
    handling: npt.NDArray[np.int32]
    """The last timesteps of a service, in which the arm is at work: to load and to unload, shape (2, k)."""


@dataclass(frozen=True, kw_only=True)
class StationShare:
    """Where the time of one station went, as shares of it."""

    busy: float
    """Its arm is at work on a car."""
    contended: float
    """It is, and others wait for it."""


class Accounts:
    """Counts the timesteps of a fleet.

    Args:
        fleet: The fleet.
        handling: Timesteps in which the arm of each station is at work on a car, to load and to unload, shape (2, k);
            what is left of a service is braking into the dock.
    """

    def __init__(self, fleet: GridFleet, handling: npt.NDArray[np.int32]) -> None:
        k = len(fleet.place.floor.dock_state)
        self._fleet = fleet
        self._steps = _Steps(
            cars=np.zeros(len(Account), dtype=np.int64),
            stations=np.zeros((2, k), dtype=np.int64),
            waiting=np.zeros(k, dtype=np.int64),
            serves=np.zeros(k, dtype=np.bool_),
            handling=handling,
        )
        self.n_steps = 0

    def take(self, after: npt.NDArray[np.int32]) -> None:
        """Take in the timestep that begins now.

        Args:
            after: State of each car at its end, shape (n_cars,).
        """
        fleet = self._fleet
        _take(fleet.place.floor, fleet.cars, fleet.stations, after, fleet.now, self._steps)
        self.n_steps += 1

    def car_time(self) -> CarTime:
        """Timesteps of all cars in each account."""
        return CarTime(**{name: int(self._steps.cars[Account[name.upper()]]) for name in CarTime.__annotations__})

    def station_shares(self) -> list[StationShare]:
        """Where the time of each station went."""
        shares = self._steps.stations / max(self.n_steps, 1)
        return [StationShare(busy=busy, contended=contended) for busy, contended in shares.T.tolist()]


@compiled
def _take(
    floor: Floor, cars: CarTable, stations: StationTable, after: npt.NDArray[np.int32], now: int, steps: _Steps
) -> None:  # pragma: no cover - compiled
    waiting, serves = steps.waiting, steps.serves
    waiting[:], serves[:] = 0, False
    for car in range(len(after)):
        phase, station = cars.phase[car], cars.station[car]
        if phase in (LOADING, UNLOADING):
            handling = steps.handling[0 if phase == LOADING else 1, station]
            account = _SERVED
            if cars.left[car] > handling:
                account = _EMPTY if phase == LOADING else _LOADED
            serves[station] |= account == _SERVED
        elif phase == OUT:
            account = _FAULT
        elif after[car] != cars.state[car]:
            account = _EMPTY if phase in (FREE, TO_PICK) else _LOADED
        elif phase == FREE or station == NONE:
            account = _IDLE
        elif cars.held[car]:
            account = _QUEUE
        else:
            away = floor.distance[floor.dock_row[station], cars.state[car]]
            busy = now < stations.free_at[station]
            account = _QUEUE if away < 1 or (away <= QUEUE_MOVES and busy) else _TRAFFIC
        steps.cars[account] += 1
        if account == _QUEUE:
            waiting[station] += 1
    for station in range(len(waiting)):
        if serves[station]:
            steps.stations[0, station] += 1
            steps.stations[1, station] += waiting[station] > 0
