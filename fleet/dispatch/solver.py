"""Solver: the allocator that a run names, posed with a problem."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from fleet.config import AllocationConfig
from fleet.dispatch.cost_model import CostMatrix
from fleet.dispatch.horizon import RollingHorizon
from fleet.tasks.board import Task, TaskState
from planners.allocation.problem import NO_TASK, AllocationProblem, Assignment


class Solver:
    """An allocator.

    Args:
        config: Its name, and how much must be gained for a task to change hands.
        log: Called as ``log("allocator_note", **facts)`` when it has something new to say.
    """

    def __init__(self, config: AllocationConfig, log: Callable[..., None]) -> None:
        self._log = log
        self._notes: set[str] = set()
        self._config = config
        self._begin()

    def change(self, config: AllocationConfig) -> None:
        """Go on with other settings; another allocator begins anew."""
        old, self._config = self._config, config
        if (old.allocator, old.allocator_settings) != (config.allocator, config.allocator_settings):
            self._begin()

    def _begin(self) -> None:
        self._allocator = self._config.make_allocator()
        self.plans_ahead = bool(getattr(self._allocator, "plans_ahead", False))
        """Whether it gives cars several tasks, one after the other."""
        self.soon_s = np.inf if self.plans_ahead else float(getattr(self._allocator, "soon_s", 0.0))
        """It is also given the cars that will be free in so many seconds [s]."""

    def problem(
        self,
        costs: CostMatrix,
        columns: list[int],
        rows: npt.NDArray[np.intp],
        held: Mapping[int, Task],
        horizon: RollingHorizon | None,
    ) -> AllocationProblem:
        """Some tasks and cars as allocators read them.

        Args:
            costs: What tasks cost.
            columns: Columns of the tasks among them.
            rows: Rows of the cars among them, ascending.
            held: Tasks that cars have already and may still give away, by car.
            horizon: Makes the job shop for allocators that plan ahead.
        """
        tasks = [costs.tasks[column] for column in columns]
        at = {task.index: k for k, task in enumerate(tasks)}
        cars = costs.cars[rows]
        has_of = np.full(len(costs.codes), NO_TASK, dtype=np.int32)
        has_of[list(held)] = [at.get(task.index, NO_TASK) for task in held.values()]
        return AllocationProblem(
            cost=costs.cost_s.T[columns].take(rows, axis=1).T,  # tasks are contiguous, and stay so
            class_of=np.array([task.order.rank for task in tasks], dtype=np.int32),
            since_s=np.array([task.since_s[TaskState.BACKLOG] for task in tasks]),
            held=has_of[cars],
            keep_gain=self._config.keep_gain_s,
            keep_share=self._config.keep_share,
            shop=horizon.shop(costs, columns, cars) if horizon is not None else None,
        )

    def solve(self, problem: AllocationProblem) -> Assignment:
        """What the allocator says; a note is logged once.

        Raises:
            PlanningError: An allocator of one's own gave an answer that is not legal.
        """
        found = self._allocator.allocate(problem)
        if found.note and found.note not in self._notes:
            self._notes.add(found.note)
            self._log("allocator_note", allocator=self._config.allocator, note=found.note)
        return found
