"""Admission: when a car with a task sets off to its station, and when it is held back where it is in nobody's way."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.missions.phases import NUMBER_OF_PHASE, TO_STATION, CarPhase
from fleet.missions.state import Missions
from fleet.missions.ways import EMERGENCY_RANK_S, LOADED_RANK_S, MOVE_S, Ways
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskState
from fleet.tasks.order import Priority

EARLY_S = 4.0
"""A car should come to its station this long before the arm is free, so that traffic does not let the arm wait [s]."""
NEAR_MOVES = 10
"""A car that has so many moves left to its station needs a booking to go on: the way back is not longer yet, and two
cars within it keep an arm busy that takes 7 s."""
_HELD = NUMBER_OF_PHASE[CarPhase.HELD]
_TO_PICK, _TO_DROP = NUMBER_OF_PHASE[CarPhase.TO_PICK], NUMBER_OF_PHASE[CarPhase.TO_DROP]

Cars = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]


class Admission:
    """The way of cars to their stations.

    Turns at a station are given in the order in which cars were bound for it, those near it first as they come: each
    gets the first time in which the arm is free for long enough after it can be there.

    Args:
        missions: What cars and stations are about.
        ways: How far cars are from stations.
        log: Called as ``log(kind, **facts)`` when a car is held, and when it may go on.
    """

    def __init__(self, missions: Missions, ways: Ways, log: Callable[..., None]) -> None:
        self._missions = missions
        self._ways = ways
        self._log = log

    def set_off(self, car: int, task: Task, tick: int, now_s: float) -> None:
        """Send a car to the next station of its task, or hold it back until its turn comes."""
        station = self._station(task)
        self._missions.bind(car, station.arm)
        cars = np.array(self._missions.bookings.bound(station.arm))
        arrivals = self._arrivals(cars, np.array([0, len(cars)]), [station.arm], now_s)
        # Who has just been bound is the last.
        self._begin(car, task, float(arrivals.early_s[-1]), int(arrivals.moves[-1]), tick)

    def wait(self, car: int, task: Task, why: str) -> None:
        """Hold a car back that is to go to the next station of its task; `call` lets it go."""
        self._missions.bind(car, self._station(task).arm)
        self._hold(car, task, why)

    def call(self, tick: int, now_s: float) -> None:
        """Let cars that are held back go when their time has come, and those that come near only if there is room."""
        missions, stations = self._missions, self._missions.stations
        cars, first = missions.bookings.in_line(len(stations))
        if not len(cars):
            return
        arrivals = self._arrivals(cars, first, slice(None), now_s)
        # Most cars are on their way and have their booking, or wait for a time that has not come.
        concerned = _concerned(missions.phase_index[cars], missions.bookings.booked[cars], arrivals)
        for arm in np.unique(np.searchsorted(first, concerned.nonzero()[0], side="right") - 1).tolist():
            part = slice(first[arm], first[arm + 1])
            self._call_at(stations[arm], cars[part], arrivals.of(part), tick, now_s)

    def _call_at(self, station: Station, cars: Cars, arrivals: StationArrivals, tick: int, now_s: float) -> None:
        """Do `call` for the cars that are bound for one station, in the order in which they were bound."""
        missions, bookings = self._missions, self._missions.bookings
        n_changes = bookings.n_changes
        for k, car in enumerate(cars.tolist()):
            task = missions.task_of[car]
            if task is None or task.visit is not None:
                continue
            if bookings.n_changes != n_changes:
                # Who has just booked takes its turn before the others.
                n_changes = bookings.n_changes
                arrivals = self._arrivals(cars, np.array([0, len(cars)]), [station.arm], now_s)
            if missions.phase[car] is CarPhase.HELD:
                self._begin(car, task, float(arrivals.early_s[k]), int(arrivals.moves[k]), tick)
            elif missions.phase[car] in TO_STATION and arrivals.moves[k] <= NEAR_MOVES and not bookings.book(car):
                self._hold(car, task, bookings.full_words(station.arm, station.name))

    def _begin(self, car: int, task: Task, early_s: float, moves: int, tick: int) -> None:
        """Send a bound car on its way, unless it would only stand in the lanes before a busy arm."""
        missions, station = self._missions, self._station(task)
        held = missions.phase[car] is CarPhase.HELD
        full = False
        if early_s <= EARLY_S:
            full = moves <= NEAR_MOVES and not missions.bookings.book(car)
        if early_s > EARLY_S or full:
            if not held:
                busy = f"{station.name} is busy and it would come {early_s:.0f} s too early"
                self._hold(car, task, missions.bookings.full_words(station.arm, station.name) if full else busy)
            return
        if held or missions.phase[car] is CarPhase.CHARGING:
            task.reason = f"car_{car} may go on to {station.name}"
        if held:
            self._log("called", car=f"car_{car}", task=task.order.name, station=station.name)
        loaded = task.state is TaskState.CARRIED
        missions.enter(car, CarPhase.TO_DROP if loaded else CarPhase.TO_PICK)
        urgent = task.order.priority is Priority.EMERGENCY
        rank_s = LOADED_RANK_S * loaded + EMERGENCY_RANK_S * urgent
        self._ways.send(car, station.dock_state, rank_s=rank_s, stay=True, tick=tick)

    def _hold(self, car: int, task: Task, why: str) -> None:
        """Let a car wait in a parking place."""
        self._missions.hold(car, task, why)
        self._log("held", car=f"car_{car}", task=task.order.name, cause=why)

    def _station(self, task: Task) -> Station:
        """Where a car with a task goes next."""
        return self._missions.stations.named(task.delivery.drop if task.state is TaskState.CARRIED else task.pick)

    def _arrivals(self, cars: Cars, first: Cars, arms: list[int] | slice, now_s: float) -> StationArrivals:
        """When cars could come to the stations they are bound for, and how long before their turns.

        Args:
            cars: The cars bound for each station, one station after the other, shape (n,).
            first: Where those of each station begin, and the end, shape (n_stations + 1,).
            arms: Arms of the stations.
            now_s: Simulated time [s].
        """
        missions, stations = self._missions, self._missions.stations
        queues = StationQueues(
            cars=cars,
            first=first,
            served=missions.served[arms],
            service_s=stations.recent_s()[arms],
            free_s=stations.times.all_left_s(now_s)[arms],
        )
        goals = np.repeat(stations.dock_states[arms], np.diff(first))
        moves = self._ways.moves_each(self._ways.tails[cars], goals)
        early_s = np.zeros(len(cars))
        _give_turns(queues, moves, missions.bookings.booked, early_s)
        return StationArrivals(moves=moves, early_s=early_s)


class StationQueues(NamedTuple):
    """Cars bound for some stations."""

    cars: Cars
    """The cars of one station after the other, in the order in which they were bound, shape (n,)."""
    first: Cars
    """Where those of each station begin, and the end, shape (n_stations + 1,)."""
    served: Cars
    """The car that is being served, -1 = none, shape (n_stations,)."""
    service_s: Floats
    """How long a transfer takes, shape (n_stations,) [s]."""
    free_s: Floats
    """Time until the arm is free, shape (n_stations,) [s]."""


class StationArrivals(NamedTuple):
    """How near cars are to the stations they are bound for."""

    moves: npt.NDArray[np.uint16]
    """Moves of each car to its station, shape (n,)."""
    early_s: Floats
    """How long before its turn each would come if it went now, and found no traffic, shape (n,) [s]."""

    def of(self, part: slice) -> StationArrivals:
        """Those of a part of the cars."""
        return StationArrivals(self.moves[part], self.early_s[part])


def _concerned(phase: Cars, booked: npt.NDArray[np.bool_], arrivals: StationArrivals) -> npt.NDArray[np.bool_]:
    """Cars that may set off, or have come near without a booking, shape (n,)."""
    due = (phase == _HELD) & (arrivals.early_s <= EARLY_S)
    near = ((phase == _TO_PICK) | (phase == _TO_DROP)) & (arrivals.moves <= NEAR_MOVES) & ~booked
    return due | near


@njit(cache=True)
def _give_turns(
    queues: StationQueues, moves: npt.NDArray[np.uint16], booked: npt.NDArray[np.bool_], early_s: Floats
) -> None:  # pragma: no cover - compiled
    """Fill in how long before its turn each car would come; 0 for a car that is being served."""
    for station in range(len(queues.service_s)):
        begin, end = queues.first[station], queues.first[station + 1]
        service_s = queues.service_s[station]
        keys = np.empty(end - begin)
        for k in range(begin, end):
            keys[k - begin] = MOVE_S * moves[k] if booked[queues.cars[k]] else np.inf
        turns = np.empty(end - begin)  # ascending
        n = 0
        for at in np.argsort(keys, kind="mergesort"):
            k = begin + at
            if queues.cars[k] == queues.served[station]:
                continue
            comes_s = MOVE_S * moves[k]
            turn_s = max(queues.free_s[station], comes_s)
            for j in range(n):
                if turns[j] < turn_s + service_s and turn_s < turns[j] + service_s:
                    turn_s = turns[j] + service_s
            early_s[k] = turn_s - comes_s
            j = n
            while j > 0 and turns[j - 1] > turn_s:
                turns[j] = turns[j - 1]
                j -= 1
            turns[j] = turn_s
            n += 1
