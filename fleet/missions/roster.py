"""Roster: what every car is about, which task it has, and which place it has booked."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

import numpy as np

from fleet.stations.booking import Bookings
from fleet.tasks.board import DONE_STATES, Task, TaskBoard, TaskState
from fleet.traffic.executor import Executor
from fleet.traffic.replanning import Traffic


class CarPhase(StrEnum):
    """What a car is about."""

    IDLE = "idle"
    TO_PICK = "to_pick"
    LOADING = "loading"
    HELD = "held"
    """Waits where it is in nobody's way: its station has no room, or the arm will not be free when it comes."""
    TO_DROP = "to_drop"
    UNLOADING = "unloading"
    TO_CHARGER = "to_charger"
    CHARGING = "charging"
    TO_PLACE = "to_place"
    """On a visit, on the way."""
    STANDING = "standing"
    """On a visit, where it was to go."""
    RECOVERING = "recovering"
    RETIRED = "retired"
    """Drives, but takes no task: a parcel that could not be unloaded lies in its tray."""
    DEAD = "dead"


PHASES = tuple(CarPhase)
AT_CHARGER = frozenset({CarPhase.TO_CHARGER, CarPhase.CHARGING})
ON_VISIT = frozenset({CarPhase.TO_PLACE, CarPhase.STANDING})
PARKED = frozenset({CarPhase.IDLE, CarPhase.RETIRED, CarPhase.HELD})
"""Phases of a car that waits in a parking place."""
_BOUND = frozenset({CarPhase.TO_PICK, CarPhase.TO_DROP, CarPhase.TO_CHARGER, CarPhase.TO_PLACE})
_AT_STATION = frozenset({CarPhase.TO_PICK, CarPhase.LOADING, CarPhase.HELD, CarPhase.TO_DROP, CarPhase.UNLOADING})
_BOOKED = AT_CHARGER | ON_VISIT | _AT_STATION
"""Phases of a car that has a booking or waits for one."""
_GONE = frozenset({CarPhase.RETIRED, CarPhase.DEAD})
_MAY_STAND_DOWN = ON_VISIT | {CarPhase.TO_PICK, CarPhase.HELD, CarPhase.CHARGING}


class Roster:
    """Phase, task and booking of all cars.

    Args:
        board: The tasks.
        bookings: Who has which place.
        place_cells: Cells of the places that are booked until the car has gone, stations first.
        n_stations: How many of them are stations.
        executor: Tells which cells cars hold.
        traffic: Told who goes first, and who can move.
    """

    def __init__(
        self,
        board: TaskBoard,
        bookings: Bookings,
        place_cells: Sequence[int],
        n_stations: int,
        executor: Executor,
        traffic: Traffic,
    ) -> None:
        n_cars = len(bookings.place_of)
        self.phase = [CarPhase.IDLE] * n_cars
        self.phase_index = np.zeros(n_cars, dtype=np.int64)
        """The same as an index into `PHASES`, shape (n_cars,)."""
        self.task_of: list[Task | None] = [None] * n_cars
        self.loaded = np.zeros(n_cars, dtype=np.int64)
        """1 for a car with a parcel, else 0."""
        self.load_kg = np.zeros(n_cars)
        """Mass of the parcel in each car's tray [kg], shape (n_cars,)."""
        self.awake = np.zeros(n_cars, dtype=np.bool_)
        """True for a car that is not parked, shape (n_cars,)."""
        self.charges = np.zeros(n_cars, dtype=np.bool_)
        """True for a car that stands at a charger and charges, shape (n_cars,)."""
        self.bound = np.zeros(n_cars, dtype=np.bool_)
        """True for a car on its way to a station, charger or place, shape (n_cars,)."""
        self.served = np.full(n_stations, -1, dtype=np.int64)
        """The car each arm is at work on, or on its way home from, -1 for none, shape (n_stations,)."""
        self.changes_n = 0
        """How often a car has begun a phase."""
        self.changed = True
        """Whether a car or a task has become free since tasks were last given out."""
        self._board = board
        self._bookings = bookings
        self._place_cells = tuple(place_cells)
        self._executor = executor
        self._traffic = traffic

    def enter(self, car: int, phase: CarPhase) -> None:
        """Let a car begin a phase; one in which it needs no place gives up what it has booked."""
        self.changes_n += 1
        self.phase[car] = phase
        self.phase_index[car] = PHASES.index(phase)
        task = self.task_of[car]
        waits = phase in AT_CHARGER or phase is CarPhase.HELD
        carries = waits and task is not None and task.state is TaskState.CARRIED
        self.loaded[car] = carries or phase in (CarPhase.TO_DROP, CarPhase.UNLOADING)
        self.load_kg[car] = task.delivery.mass_kg if self.loaded[car] and task is not None else 0.0
        self.awake[car] = phase not in PARKED and phase is not CarPhase.DEAD
        self.charges[car] = phase is CarPhase.CHARGING
        self.bound[car] = phase in _BOUND
        if phase not in _BOOKED:
            self.leave(car)

    def leave(self, car: int) -> None:
        """Give up what a car has booked; nobody takes its place before it has gone."""
        place = int(self._bookings.place_of[car])
        self._bookings.leave(car, stands_there=place >= 0 and self._stands_at(car, place))

    def clear_left(self) -> None:
        """Free the places of cars that have given them up and gone."""
        self.changed |= self._bookings.clear(self._stands_at)

    def unassign(self, task: Task, now_s: float, reason: str) -> None:
        """Take a task from the car that is to pick it, or visits; what the car does next is the caller's to say."""
        if task.car is not None:
            self.task_of[task.car] = None
        task.car, task.place = None, ""
        self._board.move(task, TaskState.READY, now_s, reason)
        self.changed = True

    def stand_down(self, car: int) -> None:
        """Free a car that was to pick a task, or that visited."""
        self.forget(car)
        self.changed = True
        if self.phase[car] in _MAY_STAND_DOWN:
            self.enter(car, CarPhase.IDLE)

    def release(self, car: int, phase: CarPhase = CarPhase.IDLE) -> None:
        """Free a car whose task has ended, or is another's now."""
        self.forget(car)
        self.changed = True
        if self.phase[car] not in (CarPhase.DEAD, CarPhase.RECOVERING):
            self.enter(car, phase)
            self._traffic.set_fixed(car, False)

    def forget(self, car: int) -> None:
        """Leave a car without a task and without a task's right of way."""
        self.task_of[car] = None
        self._traffic.rank[car] = 0.0

    def kept(self) -> dict[int, Task]:
        """Cars that have done one leg of an order and are kept for the next, by car.

        A leg that was taken from its car, or whose car is out of service for good, is any car's.
        """
        kept = {}
        for task in self._board.legs:
            if task.state not in (TaskState.BACKLOG, TaskState.READY, TaskState.ASSIGNED):
                continue
            before = self._board.named(task.order.same_car_as)
            car = before.car
            if before.state not in DONE_STATES or car is None or car in task.shunned:
                continue
            if self.phase[car] not in _GONE:
                kept[car] = task
        return kept

    def _stands_at(self, car: int, place: int) -> bool:
        """Whether a car still holds the cell of a place; who only parks makes room, and holds nothing."""
        return place < len(self._place_cells) and self._place_cells[place] in self._executor.dependencies.held_cells(
            car
        )
