"""BookCheck: what cars are about, the states of tasks, and who has booked which place."""

from __future__ import annotations

from collections import Counter

import numpy as np

from fleet.run.view import RunView
from fleet.safety.breach import Breach, Invariant
from fleet.tasks.board import TASK_STATES, UNDER_WAY


class BookCheck:
    """Phases, tasks and bookings of a run.

    Args:
        run: The run.
    """

    def __init__(self, run: RunView) -> None:
        self._run = run
        self._caps = np.array(run.bookings.caps)
        self._n_changes = -1

    def look(self) -> Breach | None:
        """What can be told at once, in every tick."""
        return self._phases() or self._booked()

    def audit(self) -> Breach | None:
        """Whether every task is in one state, the one that it says, and has one car if it is under way; slow."""
        board, n_listed = self._run.board, 0
        for state in TASK_STATES:
            for task in board.in_state(state):
                n_listed += 1
                if task.state is not state:
                    return _task_breach(task.order.name, f"is {task.state} and is listed as {state}")
        if n_listed == len(board.tasks):
            return self._owners()
        listed = Counter(task.index for task in board.in_state(*TASK_STATES))
        task = next(task for task in board.tasks if listed[task.index] != 1)
        return _task_breach(task.order.name, f"is {task.state} and is listed {listed[task.index]} times")

    def _phases(self) -> Breach | None:
        faults = self._run.missions.faults()
        if not faults:
            return None
        return Breach(
            invariant=Invariant.PHASES,
            words="; ".join(faults),
            valid="phases that fit the tasks' states",
            robots=tuple(dict.fromkeys(fault.split()[0] for fault in faults)),
        )

    def _owners(self) -> Breach | None:
        """A task that is under way is one car's, which has it."""
        run = self._run
        task_of = run.missions.task_of
        had: dict[int, int] = {}
        for car, task in enumerate(task_of):
            if task is None:
                continue
            if task.index in had:
                return _task_breach(task.order.name, "has two cars", f"car_{had[task.index]}", f"car_{car}")
            had[task.index] = car
        for car, carried in enumerate(run.missions.aboard):
            for task in carried:
                if task.index in had or task.car != car:
                    return _task_breach(task.order.name, "is aboard and has another car", f"car_{car}")
                had[task.index] = car
        for task in run.board.in_state(*UNDER_WAY):
            if task.index not in had:
                holder = f"car_{task.car}, which does not have it" if task.car is not None else "no car"
                return _task_breach(task.order.name, f"is {task.state} with {holder}")
        return None

    def _booked(self) -> Breach | None:
        """No place has more cars than it takes, and its list of them is what the cars say."""
        bookings = self._run.bookings
        said = np.bincount(bookings.place_of[bookings.booked], minlength=len(self._caps))
        if bookings.n_changes == self._n_changes and (said <= self._caps).all():
            return None
        self._n_changes = bookings.n_changes
        for place, cap in enumerate(bookings.caps):
            cars = bookings.cars(place)
            if len(cars) > cap:
                return self._overbooked(place, cars, f"is booked by {len(cars)} cars", f"at most {cap}")
            if said[place] > len(cars):
                return self._overbooked(
                    place, cars, f"is booked by {said[place]} cars by what they say, {len(cars)} by its list", "as many"
                )
        return None

    def _overbooked(self, place: int, cars: list[int], words: str, valid: str) -> Breach:
        run = self._run
        names = [station.name for station in run.stations]
        names += [f"charger_{k}" for k in range(len(run.places.chargers))]
        name = names[place] if place < len(names) else f"place {place}"
        return Breach(
            invariant=Invariant.BOOKINGS,
            words=f"{name} {words}",
            valid=valid,
            robots=tuple(f"car_{car}" for car in cars),
            place=name,
            values={"capacity": run.bookings.caps[place], "cars": cars},
        )


def _task_breach(name: str, words: str, *robots: str) -> Breach:
    return Breach(
        invariant=Invariant.TASKS,
        words=f"task {name} {words}" + (f": {', '.join(robots)}" if robots else ""),
        valid="one state, and one car while it is under way",
        robots=robots,
        values={"task": name},
    )
