"""Missions: the one state of what every car and station is about; phases, tasks and bookings change here together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from fleet.missions.phases import (
    AT_CHARGER,
    AT_DOCK,
    BOOKED,
    BOUND,
    GONE,
    MAY_STAND_DOWN,
    NUMBER_OF_PHASE,
    PARKED,
    PHASES,
    STATES_IN,
    CarPhase,
)
from fleet.stations.booking import Bookings
from fleet.stations.stations import Stations
from fleet.tasks.board import DONE_STATES, NUMBER_OF_STATE, TASK_STATES, UNDER_WAY, Task, TaskBoard, TaskState
from fleet.traffic.replanning import Traffic

NOBODY = -1
"""No car, in arrays."""
NO_TASK = -1
"""State of no task, in arrays."""
_BOUND, _PARKED = (np.array([phase in group for phase in PHASES]) for group in (BOUND, PARKED))
_UNDER_WAY = np.zeros(len(TASK_STATES) + 1, dtype=np.bool_)  # the last entry stands for no task
_UNDER_WAY[[NUMBER_OF_STATE[state] for state in UNDER_WAY]] = True
_KEPT_STATES = (TaskState.BACKLOG, TaskState.READY, TaskState.ASSIGNED)


class Missions:
    """Phase, task and booking of all cars, and which car each arm serves.

    Args:
        board: The tasks.
        stations: The stations.
        bookings: Who has which place.
        place_cells: Cells of the places that are booked until the car has gone, stations first.
        traffic: Told who goes first, and who can move.
    """

    def __init__(
        self,
        board: TaskBoard,
        stations: Stations,
        bookings: Bookings,
        place_cells: Sequence[int],
        traffic: Traffic,
    ) -> None:
        n_cars = len(bookings.place_of)
        self.board = board
        self.stations = stations
        self.bookings = bookings
        self.phase = [CarPhase.IDLE] * n_cars
        self.phase_index = np.zeros(n_cars, dtype=np.int64)
        """The same as an index into `PHASES`, shape (n_cars,)."""
        self.task_of: list[Task | None] = [None] * n_cars
        self.task_state = np.full(n_cars, NO_TASK, dtype=np.int64)
        """State of each car's task as an index into `TASK_STATES`, -1 for none, shape (n_cars,)."""
        self.task_index = np.full(n_cars, NO_TASK, dtype=np.int64)
        """Index of each car's task, -1 for none, shape (n_cars,)."""
        self.pick_of = np.full(n_cars, -1, dtype=np.int64)
        """Pick station of each car's task, -1 where it has no delivery, shape (n_cars,)."""
        self.drop_of = np.full(n_cars, -1, dtype=np.int64)
        """Drop station, in the same way."""
        self.aboard: list[list[Task]] = [[] for _ in range(n_cars)]
        """Deliveries that each car carries beside the one it is about."""
        self.loaded = np.zeros(n_cars, dtype=np.int64)
        """1 for a car with a parcel, else 0."""
        self.load_kg = np.zeros(n_cars)
        """Mass of the parcels in each car's tray [kg], shape (n_cars,)."""
        self.awake = np.zeros(n_cars, dtype=np.bool_)
        """True for a car that is not parked, shape (n_cars,)."""
        self.charges = np.zeros(n_cars, dtype=np.bool_)
        """True for a car that stands at a charger and charges, shape (n_cars,)."""
        self.bound = np.zeros(n_cars, dtype=np.bool_)
        """True for a car on its way to a station, charger or place, shape (n_cars,)."""
        self.served = np.full(len(stations), NOBODY, dtype=np.int64)
        """The car each arm is at work on, or on its way home from, -1 for none, shape (n_stations,)."""
        self.leaving: dict[int, bool] = {}
        """Cars that leave service as planned, and whether for good: they take no more tasks."""
        self.n_changes = 0
        """How often a car has begun a phase."""
        self.changed = True
        """Whether a car or a task has become free since tasks were last given out."""
        self.lost_a_car = False
        """Whether a task was taken from its car since then, and may do better with a car that has another one."""
        self._place_cells = tuple(place_cells)
        self._traffic = traffic
        board.subscribe(self._task_moved)

    # --- questions

    @property
    def n_cars(self) -> int:
        """Number of cars."""
        return len(self.phase)

    def cars_in(self, *phases: CarPhase) -> list[int]:
        """Cars in any of some phases, in ascending order."""
        wanted = self.phase_index == NUMBER_OF_PHASE[phases[0]]
        for phase in phases[1:]:
            wanted |= self.phase_index == NUMBER_OF_PHASE[phase]
        found: list[int] = wanted.nonzero()[0].tolist()
        return found

    def is_held_back(self, task: Task) -> bool:
        """Whether a car has a task, and is held back."""
        car = task.car
        return car is not None and self.task_of[car] is task and self.phase[car] is CarPhase.HELD

    def under_way(self) -> npt.NDArray[np.int64]:
        """Index of the task that each car works on, -1 for none, shape (n_cars,)."""
        return np.where(_UNDER_WAY[self.task_state], self.task_index, NO_TASK)

    def parked(self) -> npt.NDArray[np.intp]:
        """Cars that wait in a parking place, ascending."""
        return _PARKED[self.phase_index].nonzero()[0]

    def kept(self) -> dict[int, Task]:
        """Cars that have done one leg of an order and are kept for the next, by car.

        A leg that was taken from its car, or whose car is out of service for good, is any car's.
        """
        kept = {}
        for task in self.board.legs:
            if task.state not in _KEPT_STATES:
                continue
            before = self.board.named(task.order.same_car_as)
            car = before.car
            if before.state not in DONE_STATES or car is None or car in task.shunned:
                continue
            if self.phase[car] not in GONE:
                kept[car] = task
        return kept

    def faults(self) -> list[str]:
        """One line for each car whose phase and task do not go together; see `STATES_IN`."""
        found = []
        for car, (phase, task) in enumerate(zip(self.phase, self.task_of, strict=True)):
            state = None if task is None else task.state
            if state not in STATES_IN[phase]:
                found.append(f"car_{car} is {phase} with a task that is {state}")
            if task is not None and task.car != car:
                found.append(f"car_{car} has {task.order.name}, which has car {task.car}")
        return found

    # --- changes

    def enter(self, car: int, phase: CarPhase) -> None:
        """Let a car begin a phase; one in which it needs no place gives up what it has booked."""
        self.n_changes += 1
        if phase is CarPhase.IDLE and car in self.leaving:
            phase = CarPhase.RETIRED
        number = NUMBER_OF_PHASE[phase]
        self.phase[car] = phase
        self.phase_index[car] = number
        task = self.task_of[car]
        waits = phase in AT_CHARGER or phase is CarPhase.HELD
        carries = waits and task is not None and task.state is TaskState.CARRIED
        loaded = carries or phase is CarPhase.TO_DROP or phase is CarPhase.UNLOADING
        self.loaded[car] = loaded or bool(self.aboard[car]) or (task is not None and task.lifted)
        self.load_kg[car] = task.delivery.mass_kg if loaded and task is not None else 0.0
        self.load_kg[car] += sum(other.delivery.mass_kg for other in self.aboard[car])
        self.awake[car] = not _PARKED[number] and phase is not CarPhase.DEAD
        self.charges[car] = phase is CarPhase.CHARGING
        self.bound[car] = _BOUND[number]
        # An arm reaches into its tray: the car stays where it stands, though it is measured badly.
        self._traffic.executor.driver.brake(car, phase in AT_DOCK)
        if phase not in BOOKED:
            self.leave(car)

    def assign(self, car: int, task: Task, now_s: float, why: str = "") -> None:
        """Give a task to a car, and say why in words; what the car does first is the caller's to say."""
        task.car = car
        self._hold(car, task)
        self.board.move(task, TaskState.ASSIGNED, now_s, why or f"it was given to car_{car}")

    def stow(self, car: int) -> None:
        """Let a car be about nothing, with what it carries aboard; what it does next is the caller's to say."""
        task = self.task_of[car]
        if task is not None:
            self.aboard[car].append(task)
            self._take(car)

    def take_up(self, car: int, task: Task) -> None:
        """Let a car that is about nothing bring away a delivery that it has aboard."""
        self.aboard[car].remove(task)
        self._hold(car, task)

    def unassign(self, task: Task, now_s: float, reason: str) -> None:
        """Take a task from the car that is to pick it, or visits; what the car does next is the caller's to say."""
        if task.car is not None:
            self._take(task.car)
        task.car, task.place = None, ""
        if task.visit is not None and task.visit.pod:
            task.n_errands_done = 0  # who fetches the pod has to come to it first
        self.board.move(task, TaskState.READY, now_s, reason)
        self.changed = self.lost_a_car = True

    def stand_down(self, car: int) -> None:
        """Free a car that was to pick a task, or that visited."""
        self.forget(car)
        self.changed = True
        if self.phase[car] in MAY_STAND_DOWN:
            self.enter(car, CarPhase.IDLE)

    def release(self, car: int, phase: CarPhase = CarPhase.IDLE) -> None:
        """Free a car whose task has ended, or is another's now."""
        self.forget(car)
        self.changed = True
        if self.phase[car] not in (CarPhase.DEAD, CarPhase.RECOVERING):
            self.enter(car, phase)
            self._traffic.set_served(car, False)

    def forget(self, car: int) -> None:
        """Leave a car without a task and without a task's right of way."""
        self._take(car)
        self._traffic.rank[car] = 0.0

    def hold(self, car: int, task: Task, why: str) -> None:
        """Let a car with a task wait in a parking place."""
        self.enter(car, CarPhase.HELD)
        self.changed = True
        task.reason = f"car_{car} is held: {why}"

    def bind(self, car: int, place: int) -> None:
        """Let a car be bound for a place, instead of what it was bound for."""
        self.leave(car)
        self.bookings.bind(car, place)

    def leave(self, car: int) -> None:
        """Give up what a car has booked; nobody takes its place before it has gone."""
        place = int(self.bookings.place_of[car])
        self.bookings.leave(car, stands_there=place >= 0 and self._stands_at(car, place))

    def clear_left(self) -> None:
        """Free the places of cars that have given them up and gone."""
        self.changed |= self.bookings.clear(self._stands_at)

    def _hold(self, car: int, task: Task) -> None:
        self.task_of[car] = task
        self.task_index[car] = task.index
        self.task_state[car] = NUMBER_OF_STATE[task.state]
        if task.visit is None:
            self.pick_of[car] = self.stations.named(task.pick).arm
            self.drop_of[car] = self.stations.named(task.delivery.drop).arm

    def _take(self, car: int) -> None:
        self.task_of[car] = None
        self.task_state[car] = self.task_index[car] = self.pick_of[car] = self.drop_of[car] = NO_TASK

    def _task_moved(self, task: Task, before: TaskState, now_s: float) -> None:
        del before, now_s
        if task.car is not None and self.task_of[task.car] is task:
            self.task_state[task.car] = NUMBER_OF_STATE[task.state]

    def _stands_at(self, car: int, place: int) -> bool:
        """Whether a car still holds the cell of a place; who only parks makes room, and holds nothing."""
        return place < len(self._place_cells) and self._traffic.executor.holds(car, self._place_cells[place])
