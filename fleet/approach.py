"""Approach: when a car with a task sets off to its station, and when it is held back where it is in nobody's way."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from fleet.executor import Executor
from fleet.roster import CarPhase, Roster
from fleet.stations.booking import Bookings
from fleet.stations.service_time import ServiceTimes
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskState
from fleet.tasks.order import Priority
from fleet.traffic import Traffic

MOVE_S = 1.1
"""Time of a move without traffic: a cell of 1 m at 1 m/s, and some turns [s]."""
EARLY_S = 4.0
"""A car should come to its station this long before the arm is free, so that traffic does not let the arm wait [s]."""
LOADED_RANK_S = 30.0
"""Head start of a loaded car over an empty one in the right of way, as seconds of waiting."""
EMERGENCY_RANK_S = 60.0
"""Head start of a car with a task of the class `emergency` [s]."""


class Approach:
    """The way of cars to their stations.

    Args:
        stations: By name.
        roster: What cars are about.
        bookings: Room at the stations.
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
        """Send a loaded car to its drop station, or hold it back while there is no room."""
        station = self._stations[task.delivery.drop]
        self._roster.leave(car)
        if not self._bookings.waiting(station.arm) and self._bookings.book(car, station.arm):
            self.begin(car, task, tick, now_s)
            return
        self._bookings.wait(car, station.arm)
        there = ", ".join(f"car_{other}" for other in self._bookings.cars(station.arm))
        self._hold(car, task, f"{station.name} is full ({there})")

    def begin(self, car: int, task: Task, tick: int, now_s: float) -> None:
        """Send a car with a booking on its way, unless it would only stand in the lanes before a busy arm."""
        picks = task.state is not TaskState.CARRIED
        station = self._stations[task.pick if picks else task.delivery.drop]
        early_s = self._free_s(car, station, now_s) - self._way_s(car, station)
        if early_s <= EARLY_S:
            if self._roster.phase[car] is CarPhase.HELD:
                self._log("called", car=f"car_{car}", task=task.order.name, station=station.name)
            self._roster.enter(car, CarPhase.TO_PICK if picks else CarPhase.TO_DROP)
            self._send(car, task, station, tick)
        elif self._roster.phase[car] is not CarPhase.HELD:
            self._hold(car, task, f"{station.name} is busy and it would come {early_s:.0f} s too early")

    def wait(self, car: int, task: Task, why: str) -> None:
        """Hold a loaded car back until there is room at its drop station."""
        self._bookings.wait(car, self._stations[task.delivery.drop].arm)
        self._hold(car, task, why)

    def call(self, tick: int, now_s: float) -> None:
        """Let cars that are held back go on when their time has come."""
        for car, place in self._bookings.callable_cars():
            self._bookings.book(car, place)
        for car, phase in enumerate(self._roster.phase):
            task = self._roster.task_of[car]
            if phase is CarPhase.HELD and task is not None and task.visit is None and self._bookings.has(car):
                self.begin(car, task, tick, now_s)

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

    def _way_s(self, car: int, station: Station) -> float:
        """Time a car needs to a station without traffic [s]."""
        tail = int(self._executor.tail_states()[car])
        return MOVE_S * int(self._traffic.tables.to(station.dock_state)[tail])

    def _free_s(self, car: int, station: Station, now_s: float) -> float:
        """Time until the arm has done with everybody who comes before a car [s]."""
        arm = station.arm
        service_s = self._service_times.of(arm, station.direction).recent_s
        free_s = self._service_times.left_s(arm, now_s)
        own_s = self._way_s(car, station)
        here = (car, self._roster.served[arm])
        for other in self._bookings.cars(arm):
            comes_s = 0.0 if other in here else self._way_s(other, station)
            if other not in here and comes_s <= own_s and self._bookings.place_of[other] == arm:
                free_s = max(free_s, comes_s) + service_s
        return free_s
