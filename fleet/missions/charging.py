"""Charging: which task a car has the charge for, which car charges where, and how long it stays."""

from __future__ import annotations

from collections.abc import Callable, Set

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.missions.admission import Admission
from fleet.missions.phases import AT_CHARGER, ON_VISIT, CarPhase
from fleet.missions.state import Missions
from fleet.missions.ways import LOADED_RANK_S, SLOW_MOVE_S, Ways
from fleet.robots.battery import Batteries
from fleet.stations.service_time import Direction
from fleet.stations.station import Station
from fleet.tasks.board import Task, TaskState
from planners.mapf.distance_table import UNREACHABLE

_MAY_BREAK_OFF = ON_VISIT | {CarPhase.TO_PICK, CarPhase.HELD}


class Charging:
    """Chargers as places with room for one car each.

    The rule that a task must leave enough charge to reach a charger is that of Open-RMF (rmf_ros2, pull request 423).

    Args:
        batteries: State of charge of the cars.
        states: Lane-graph state of each charger in use.
        first_place: Number of the first charger among the places that are booked.
        missions: What cars and stations are about.
        ways: How far cars are from chargers.
        admission: Sends cars with parcels on.
        log: Called as ``log(kind, **facts)`` when a car goes to charge, and when it has.
    """

    def __init__(
        self,
        batteries: Batteries,
        states: tuple[int, ...],
        first_place: int,
        missions: Missions,
        ways: Ways,
        admission: Admission,
        log: Callable[..., None],
    ) -> None:
        self.batteries = batteries
        self.states = states
        self.n_sessions = 0
        """How often a car began to charge."""
        self._first = first_place
        self._missions = missions
        self._ways = ways
        self._admission = admission
        self._log = log

    @property
    def places(self) -> range:
        """Numbers of the chargers in use among the places that are booked."""
        return range(self._first, self._first + len(self.states))

    def spares(self, car: int) -> bool:
        """Whether a car without a task, as far as its battery goes, may be given one."""
        if self._missions.phase[car] in AT_CHARGER:
            return self._has_enough(car)
        return not self._is_critical(car)

    def plug_in(self) -> None:
        """Begin to charge cars that have come to their charger, and free those that have no way to theirs."""
        missions = self._missions
        for car in missions.cars_in(CarPhase.TO_CHARGER):
            goal = self._state_of(int(missions.bookings.place_of[car]))
            if self._ways.stands_at(car, goal):
                self.begin(car)
            elif not self._ways.reaches(car, goal):
                missions.changed = True
                task = missions.task_of[car]
                missions.enter(car, CarPhase.IDLE)
                if task is not None:
                    self._admission.wait(car, task, "no way to its charger")

    def begin(self, car: int) -> None:
        """Begin to charge a car that stands at a charger."""
        self._missions.enter(car, CarPhase.CHARGING)
        self.n_sessions += 1

    def is_full(self, car: int) -> bool:
        """Whether there is nothing more to wait for at the charger."""
        return bool(self.batteries.charge[car] >= self.batteries.config.full)

    def send_low(self, tick: int, now_s: float, wanted: Set[int]) -> None:
        """Send cars with low batteries to chargers, emptiest first, and those that have enough away from them.

        Args:
            tick: Present tick.
            now_s: Simulated time [s].
            wanted: Chargers to be left to visits.
        """
        missions, charge, config = self._missions, self.batteries.charge, self.batteries.config
        for car in (charge < config.critical).nonzero()[0].tolist():
            task = missions.task_of[car]
            if task is not None and missions.phase[car] in _MAY_BREAK_OFF and _can_wait(task):
                missions.unassign(task, now_s, f"the battery of car_{car} is at {100.0 * charge[car]:.0f} %")
                missions.release(car)
        low = [car for car in (charge < config.low).nonzero()[0].tolist() if self._may_charge(car)]
        low = [car for car in low if self._has_way(car)]
        sent = [self._send(car, tick, wanted) for car in self._by_need(low)]
        short = not all(sent) or bool(wanted)
        for car in missions.cars_in(CarPhase.CHARGING):
            if not (self.is_full(car) or (short and self._has_enough(car))):
                continue
            task = missions.task_of[car]
            if task is not None and task.visit is not None:
                continue  # was ordered to charge until it is full
            self._log("charged", car=f"car_{car}", charge=round(float(self.batteries.charge[car]), 3))
            if task is not None:
                self._admission.set_off(car, task, tick, now_s)
            else:
                missions.enter(car, CarPhase.IDLE)

    def send_idle(self, tick: int, wanted: Set[int]) -> None:
        """Let parked cars that nobody needs at present charge where there is room."""
        below = self.batteries.config.idle_below
        idle = [
            car
            for car in self._missions.cars_in(CarPhase.IDLE)
            if self.batteries.charge[car] < below and self._ways.idle(car)
        ]
        for car in self._by_need(idle):
            self._send(car, tick, wanted)

    def allows(
        self, cars: list[int], to_pick: FloatArray, pick: Station, drop: Station, load_kg: float
    ) -> npt.NDArray[np.bool_]:
        """Which cars could do a task and still reach a charger.

        Args:
            cars: The cars.
            to_pick: Moves of each to the pick station, shape (k,).
            pick: Where the parcel is.
            drop: Where it goes.
            load_kg: Its mass.

        Returns:
            The verdict on each car, shape (k,).
        """
        n_loaded_moves = self._moves(pick, drop)
        served_s = self._missions.stations.times.of(pick.arm, Direction.TO_CAR).p90_s
        # At the drop station those before it are served first.
        served_s += (
            self._missions.bookings.caps[drop.arm]
            * self._missions.stations.times.of(drop.arm, Direction.FROM_CAR).p90_s
        )
        loaded_s = SLOW_MOVE_S * n_loaded_moves + served_s
        loaded = self.batteries.share(cars, self._ways.move_m * n_loaded_moves, loaded_s, load_kg)
        n_home_moves = float(self.moves_home(np.array([drop.dock_state]))[0])
        return self.allows_way(cars, to_pick + n_home_moves, 0.0, loaded)

    def allows_way(
        self, cars: list[int], moves: FloatArray, stand_s: float, more: FloatArray | float = 0.0
    ) -> npt.NDArray[np.bool_]:
        """Which cars have the charge for a way without a load, that to a charger included.

        Args:
            cars: The cars.
            moves: Moves of each, shape (k,).
            stand_s: How long it stands on the way [s].
            more: Share of the charge that is spent besides, one for all or shape (k,).

        Returns:
            The verdict on each car, shape (k,).
        """
        empty = self.batteries.share(cars, self._ways.move_m * moves, SLOW_MOVE_S * moves + stand_s)
        spare = self.batteries.charge[cars] - empty - more
        return np.asarray(spare >= self.batteries.config.margin)

    def moves_home(self, states: npt.NDArray[np.int32] | npt.NDArray[np.int64]) -> FloatArray:
        """Moves to the nearest charger, occupied or not, inf where there is no way, shape of `states`."""
        moves = np.full(len(states), np.inf)
        for goal in self.states:
            row = self._ways.moves(states, goal).astype(np.float64)
            moves = np.minimum(moves, np.where(row >= UNREACHABLE, np.inf, row))
        return moves

    def _is_critical(self, car: int) -> bool:
        """Below the second threshold."""
        return bool(self.batteries.charge[car] < self.batteries.config.critical)

    def _has_enough(self, car: int) -> bool:
        """Whether a charging car may be given a task, or make room."""
        return bool(self.batteries.charge[car] >= self.batteries.config.enough)

    def _has_way(self, car: int) -> bool:
        """Whether a car can come to a charger at all; nobody has to make room for one that cannot."""
        return bool(np.isfinite(self.moves_home(self._ways.tails[[car]])[0]))

    def _may_charge(self, car: int) -> bool:
        """Whether a car is free to go to a charger: without a task, or held back with its parcel."""
        task, phase = self._missions.task_of[car], self._missions.phase[car]
        held = phase is CarPhase.HELD and task is not None and task.state is TaskState.CARRIED
        return held or phase is CarPhase.IDLE

    def _send(self, car: int, tick: int, wanted: Set[int]) -> bool:
        """Send a car to a charger that no visit wants; False if none that it can come to is free."""
        place = self._free_charger(car, wanted)
        if place is None:
            return False
        missions = self._missions
        missions.bind(car, place)
        missions.bookings.book(car)
        missions.enter(car, CarPhase.TO_CHARGER)
        task = missions.task_of[car]
        if task is not None:
            task.reason = f"car_{car} charges meanwhile: {task.reason}"
        self._ways.send(car, self._state_of(place), rank_s=LOADED_RANK_S, stay=True, tick=tick)
        self._log("to_charger", car=f"car_{car}", charge=round(float(self.batteries.charge[car]), 3))
        return True

    def _free_charger(self, car: int, wanted: Set[int]) -> int | None:
        """The nearest charger that is free and that a car can come to, as a place; None if there is none."""
        best, fewest = None, UNREACHABLE
        for number in self.places:
            if number in wanted or self._missions.bookings.room(number) <= 0:
                continue
            n_moves = self._ways.of_car(car, self._state_of(number))
            if n_moves < fewest:
                best, fewest = number, n_moves
        return best

    def _state_of(self, place: int) -> int:
        """Lane-graph state of a charger."""
        return self.states[place - self._first]

    def _by_need(self, cars: list[int]) -> list[int]:
        """Cars, emptiest first."""
        return sorted(cars, key=lambda car: (float(self.batteries.charge[car]), car))

    def _moves(self, start: Station, goal: Station) -> float:
        n_moves = self._ways.between(start.dock_state, goal.dock_state)
        return float("inf") if n_moves >= UNREACHABLE else float(n_moves)


def _can_wait(task: Task) -> bool:
    """Whether a task can be done later, by whatever car: nothing is picked or lifted, and it is not to charge."""
    if task.visit is not None:
        return not task.visit.until_full and not task.lifted
    return task.state is TaskState.ASSIGNED
