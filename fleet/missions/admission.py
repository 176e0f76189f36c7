"""Admission: when a car with a task sets off to its station, and when it is held back where it is in nobody's way."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fleet.missions.parcels.slots import Slots
from fleet.missions.phases import NUMBER_OF_PHASE, CarPhase
from fleet.missions.state import Missions
from fleet.missions.turns import TurnBook, line_up
from fleet.missions.ways import EMERGENCY_RANK_S, LOADED_RANK_S, MOVE_S, Ways
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskState
from fleet.tasks.order import Priority

EARLY_S = 20.0
"""A car that would come longer than that before its turn waits where it is, if it is near [s]."""
CALL_EARLY_S = 12.0
"""It goes on when it comes at most so long before: two cars wait then, so that traffic does not let the arm wait; and
later than it could have set off, so that it does not go to and fro [s]."""
NEAR_S = 12.0
"""A car that could be at its station in so short a time needs a booking to set off, so that it is not turned back. Who
is further away sets off: much will have changed when it comes [s]."""
NEAR_MOVES = 5
"""A car that has so many moves left to its station needs a booking to go on: nearer, it would stand in others' way."""
_HELD = NUMBER_OF_PHASE[CarPhase.HELD]


class Admission:
    """The way of cars to their stations.

    A car needs a booking, and its parcel a slot, to come near its station; who finds it full turns aside. Who is near
    before it sets off, and would come too early for its turn, is held back where it is. Who is held back goes on with a
    booking only, so that nobody is turned back twice.

    Args:
        missions: What cars and stations are about.
        ways: How far cars are from stations.
        turns: Tells when their turns come.
        slots: Has slots for the parcels of cars that come near.
        log: Called as ``log(kind, **facts)`` when a car is held, and when it may go on.
    """

    def __init__(self, missions: Missions, ways: Ways, turns: TurnBook, slots: Slots, log: Callable[..., None]) -> None:
        self._missions = missions
        self._ways = ways
        self._turns = turns
        self._slots = slots
        self._log = log

    def set_off(self, car: int, task: Task, tick: int, now_s: float) -> None:
        """Send a car to the next station of its task, or hold it back until its turn comes."""
        station = self._station(task)
        self._missions.bind(car, station.arm)
        arrivals, line = self._turns.line_of(station.arm, now_s)
        # Who has just been bound is the last.
        early_s = float(line.turn_s[-1] - arrivals.comes_s[-1])
        near = bool(arrivals.comes_s[-1] <= NEAR_S)
        if near and early_s > EARLY_S:
            self._hold(car, task, f"{station.name} is busy and it would come {early_s:.0f} s too early")
        elif near and not self._book(car, task, station, now_s):
            self._hold(car, task, self._full_words(task, station))
        else:
            if self._missions.phase[car] is CarPhase.CHARGING:
                task.reason = f"car_{car} may go on to {station.name}"
            self._send(car, task, station, tick)

    def wait(self, car: int, task: Task, why: str) -> None:
        """Hold a car back that is to go to the next station of its task; `call` lets it go."""
        self._missions.bind(car, self._station(task).arm)
        self._hold(car, task, why)

    def call(self, tick: int, now_s: float) -> None:
        """Let cars that are held back go when their time has come, and those that come near only if there is room."""
        missions = self._missions
        arrivals = self._turns.bound()
        if not len(arrivals.car):
            return
        early_s = line_up(arrivals, self._turns.pace(now_s)).turn_s - arrivals.comes_s
        held = missions.phase_index[arrivals.car] == _HELD
        near = ~arrivals.waits & (arrivals.comes_s <= NEAR_MOVES * MOVE_S) & ~missions.bookings.booked[arrivals.car]
        concerned = ((held & (early_s <= CALL_EARLY_S)) | near).nonzero()[0]
        # The nearest first: nobody is to stand before a full dock while others book its room from afar.
        for k in concerned[np.argsort(arrivals.comes_s[concerned], kind="stable")].tolist():
            car = int(arrivals.car[k])
            task = missions.task_of[car]
            if task is None or task.visit is not None:
                continue
            station = missions.stations[int(arrivals.station[k])]
            if not self._book(car, task, station, now_s):
                if missions.phase[car] is not CarPhase.HELD:
                    self._hold(car, task, self._full_words(task, station))
            elif missions.phase[car] is CarPhase.HELD:
                task.reason = f"car_{car} may go on to {station.name}"
                self._log("called", car=f"car_{car}", task=task.order.name, station=station.name)
                self._send(car, task, station, tick)

    def _book(self, car: int, task: Task, station: Station, now_s: float) -> bool:
        """Book the station for a car, and a slot for its parcel if it is to be picked there."""
        bookings = self._missions.bookings
        if bookings.has(car):
            return True
        if bookings.room(station.arm) <= 0:
            return False
        if task.state is TaskState.ASSIGNED and not self._slots.take(task, now_s):
            return False
        return bookings.book(car)

    def _full_words(self, task: Task, station: Station) -> str:
        """What to say to a car that could not book."""
        if self._missions.bookings.room(station.arm) > 0:
            return f"no slot of {station.name} is free for {task.order.name}"
        return self._missions.bookings.full_words(station.arm, station.name)

    def _send(self, car: int, task: Task, station: Station, tick: int) -> None:
        loaded = task.state is TaskState.CARRIED
        self._missions.enter(car, CarPhase.TO_DROP if loaded else CarPhase.TO_PICK)
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
