"""Approach: when a car with a task sets off to its station, and when it is held back where it is in nobody's way."""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable, Mapping

import numpy as np

from fleet.missions.roster import CarPhase, Roster
from fleet.stations.booking import Bookings
from fleet.stations.service_time import ServiceTimes
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskState
from fleet.tasks.order import Priority
from fleet.traffic.executor import Executor
from fleet.traffic.replanning import Traffic

MOVE_S = 1.1
"""Time of a move without traffic: a cell of 1 m at 1 m/s, and some turns [s]."""
EARLY_S = 4.0
"""A car should come to its station this long before the arm is free, so that traffic does not let the arm wait [s]."""
NEAR_N = 10
"""A car that has so many moves left to its station needs a booking to go on: the way back is not longer yet, and two
cars within it keep an arm busy that takes 7 s."""
LOADED_RANK_S = 30.0
"""Head start of a loaded car over an empty one in the right of way, as seconds of waiting."""
EMERGENCY_RANK_S = 60.0
"""Head start of a car with a task of the class `emergency` [s]."""

_DRIVING = (CarPhase.TO_PICK, CarPhase.TO_DROP)


class Admission:
    """The way of cars to their stations.

    Args:
        stations: By name.
        roster: What cars are about.
        bookings: Who is bound for the stations, and room at them.
        service_times: How long the arms take.
        traffic: Takes goals and gives distances.
        executor: Tells where cars are.
        log: Called as ``log(kind, **facts)`` when a car is held, and when it may go on.
    """

    def __init__(
        self,
        stations: Mapping[str, Station],
        roster: Roster,
        bookings: Bookings,
        service_times: ServiceTimes,
        traffic: Traffic,
        executor: Executor,
        log: Callable[..., None],
    ) -> None:
        self._stations = stations
        self._roster = roster
        self._bookings = bookings
        self._service_times = service_times
        self._traffic = traffic
        self._executor = executor
        self._log = log

    def set_off(self, car: int, task: Task, tick: int, now_s: float) -> None:
        """Send a car to the next station of its task, or hold it back until its turn comes."""
        self._bind(car, task)
        self._begin(car, task, tick, now_s)

    def wait(self, car: int, task: Task, why: str) -> None:
        """Hold a car back that is to go to the next station of its task; `call` lets it go."""
        self._bind(car, task)
        self._hold(car, task, why)

    def call(self, tick: int, now_s: float) -> None:
        """Let cars that are held back go when their time has come, and those that come near only if there is room."""
        for station in self._stations.values():
            for car in self._bookings.bound(station.arm):
                task, phase = self._roster.task_of[car], self._roster.phase[car]
                if task is None or task.visit is not None:
                    continue
                if phase is CarPhase.HELD:
                    self._begin(car, task, tick, now_s)
                elif phase in _DRIVING and self._is_near(car, station) and not self._bookings.book(car):
                    self._hold(car, task, self._bookings.full_words(station.arm, station.name))

    def _begin(self, car: int, task: Task, tick: int, now_s: float) -> None:
        """Send a bound car on its way, unless it would only stand in the lanes before a busy arm."""
        station = self._station(task)
        early_s = self._early_s(car, station, now_s)
        why = ""
        if early_s > EARLY_S:
            why = f"{station.name} is busy and it would come {early_s:.0f} s too early"
        elif self._is_near(car, station) and not self._bookings.book(car):
            why = self._bookings.full_words(station.arm, station.name)
        if why:
            if self._roster.phase[car] is not CarPhase.HELD:
                self._hold(car, task, why)
            return
        if self._roster.phase[car] in (CarPhase.HELD, CarPhase.CHARGING):
            task.reason = f"car_{car} may go on to {station.name}"
        if self._roster.phase[car] is CarPhase.HELD:
            self._log("called", car=f"car_{car}", task=task.order.name, station=station.name)
        self._roster.enter(car, CarPhase.TO_DROP if task.state is TaskState.CARRIED else CarPhase.TO_PICK)
        self._send(car, task, station, tick)

    def _bind(self, car: int, task: Task) -> None:
        self._roster.leave(car)
        self._bookings.bind(car, self._station(task).arm)

    def _station(self, task: Task) -> Station:
        """Where a car with a task goes next."""
        return self._stations[task.delivery.drop if task.state is TaskState.CARRIED else task.pick]

    def _is_near(self, car: int, station: Station) -> bool:
        return self._moves(car, station) <= NEAR_N

    def _hold(self, car: int, task: Task, why: str) -> None:
        """Let a car wait in a parking place."""
        self._roster.enter(car, CarPhase.HELD)
        self._roster.changed = True
        task.reason = f"car_{car} is held: {why}"
        self._log("held", car=f"car_{car}", task=task.order.name, cause=why)

    def _send(self, car: int, task: Task, station: Station, tick: int) -> None:
        urgent = task.order.priority is Priority.EMERGENCY
        loaded = self._roster.phase[car] is CarPhase.TO_DROP
        self._traffic.rank[car] = LOADED_RANK_S * loaded + EMERGENCY_RANK_S * urgent
        self._traffic.send(car, station.dock_state, stay=True, tick=tick)

    def _moves(self, car: int, station: Station) -> int:
        """Moves from where a car's way ends as far as it is granted."""
        tail = int(self._executor.tail_states()[car])
        return int(self._traffic.tables.to(station.dock_state)[tail])

    def _early_s(self, car: int, station: Station, now_s: float) -> float:
        """How long before its turn a car would come if it went now, and found no traffic [s].

        Turns are given in the order in which cars were bound for the station, those near it first as they come: each
        gets the first time in which the arm is free for long enough after it can be there.
        """
        arm = station.arm
        service_s = self._service_times.of(arm, station.direction).recent_s
        free_s = self._service_times.left_s(arm, now_s)
        bound = [other for other in self._bookings.bound(arm) if other != self._roster.served[arm]]
        comes_s = {other: MOVE_S * self._moves(other, station) for other in bound}
        turns: list[float] = []
        for other in sorted(bound, key=lambda other: comes_s[other] if self._bookings.has(other) else np.inf):
            turn_s = max(free_s, comes_s[other])
            for taken_s in turns:
                if taken_s < turn_s + service_s and turn_s < taken_s + service_s:
                    turn_s = taken_s + service_s
            if other == car:
                return turn_s - comes_s[other]
            insort(turns, turn_s)
        return 0.0
