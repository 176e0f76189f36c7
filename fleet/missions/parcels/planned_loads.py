"""PlannedLoads: what cars with room for several parcels are to take along from the station they are bound for."""

from __future__ import annotations

from collections.abc import Container, Sequence

from fleet.arrays import IntArray
from fleet.missions.state import Missions
from fleet.tasks.board import Task, TaskState

_TO_BE_LOADED = (TaskState.ASSIGNED, TaskState.LOADING)


class PlannedLoads:
    """Loads of several parcels, as allocators that look ahead have planned them.

    A car is given the first of them. The others stay open, and are kept for it while it goes for the first and is being
    loaded.

    Args:
        missions: What cars are about.
        n_places: Places in each car's tray, shape (n_cars,).
    """

    def __init__(self, missions: Missions, n_places: IntArray) -> None:
        self._missions = missions
        self.n_places = n_places
        self._plans: dict[int, tuple[Task, ...]] = {}

    def plan(self, car: int, tasks: Sequence[Task]) -> None:
        """Let a car be loaded with some tasks, in order, instead of what was planned for it before."""
        if len(tasks) > 1:
            self._plans[car] = tuple(tasks)
        else:
            self._plans.pop(car, None)

    def of(self, car: int) -> list[Task]:
        """What is planned for a car beside what it goes for or has, and no car has yet."""
        plan, task = self._plans.get(car), self._missions.task_of[car]
        if plan is None or (task is not plan[0] and plan[0] not in self._missions.aboard[car]):
            return []
        return [other for other in plan[1:] if other.state is TaskState.READY]

    def spoken_for(self, but: Container[int]) -> set[int]:
        """Indices of the tasks that are kept for cars, but for some cars."""
        kept: set[int] = set()
        for car in self._plans:
            task = self._missions.task_of[car]
            if car not in but and task is not None and task.state in _TO_BE_LOADED:
                kept.update(other.index for other in self.of(car))
        return kept
