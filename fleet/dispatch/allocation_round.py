"""AllocationRound: how one allocation judged the cars for each task, told when somebody asks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from fleet.dispatch.cost_model import CostMatrix
from fleet.dispatch.situation import CAN_TAKE
from fleet.tasks.board import Task
from fleet.tasks.reasons import CODE_OF_REASON, Decision, PairReason
from planners.allocation.problem import AllocationProblem, Assignment
from planners.allocation.reasons import Reason, reasons

_PAIR_REASON = {
    Reason.CHOSEN: PairReason.CHOSEN,
    Reason.NOT_ALLOWED: PairReason.NO_WAY,
    Reason.PLANNED_LATER: PairReason.PLANNED_LATER,
    Reason.CLASS_FIRST: PairReason.CLASS_FIRST,
    Reason.KEPT: PairReason.KEPT,
    Reason.TASK_GOT_NEARER: PairReason.TASK_GOT_BETTER,
    Reason.VEHICLE_GOT_BETTER: PairReason.CAR_GOT_BETTER,
    Reason.BETTER_FOR_ALL: PairReason.BETTER_FOR_ALL,
    Reason.LEFT_FOR_LATER: PairReason.LEFT_OVER,
}
_CODE_OF = np.array([CODE_OF_REASON[_PAIR_REASON[reason]] for reason in Reason], dtype=np.int8)
"""What the planners' reasons are called here, by their value."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Answer:
    """What the allocator was asked, and what it said."""

    problem: AllocationProblem
    assignment: Assignment
    cars: npt.NDArray[np.intp]
    """Car of each row of the problem, ascending."""
    columns: list[int]
    """Column of each of its tasks among all tasks of the round."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AllocationRound:
    """One allocation.

    Most rounds are never asked about most tasks, so that pairs are judged when they are asked for.
    """

    costs: CostMatrix
    answer: Answer | None
    """None = no car could take any task."""
    full: frozenset[int]
    """Columns of tasks that had to wait for room."""
    soon: npt.NDArray[np.bool_]
    """Cars that were still busy with another task, shape (n_cars,)."""
    taker_of: npt.NDArray[np.int64]
    """The car that got each task, -1 = none, shape (n_tasks,)."""
    later: Mapping[int, int]
    """By column, the car that is to take a task when it is free."""
    took: npt.NDArray[np.int64]
    """Task that each car has after it, -1 = none, shape (n_cars,)."""
    name_of: Callable[[int], str]
    """Names a task."""

    @property
    def tasks(self) -> list[Task]:
        """The tasks that were considered."""
        return self.costs.tasks

    def decisions(self, columns: list[int]) -> list[Decision]:
        """How the cars were judged for the tasks in some columns."""
        return [
            Decision(
                time_s=self.costs.now_s,
                codes=codes,
                cars=self.costs.cars,
                cost_s=self.costs.cost_s[:, column].copy(),
                took=self.took,
                name_of=self.name_of,
                taker=int(self.taker_of[column]),
            )
            for column, codes in zip(columns, self.codes(columns), strict=True)
        ]

    def codes(self, columns: list[int]) -> npt.NDArray[np.int8]:
        """Index into `PAIR_REASONS` of each car for the tasks in some columns, shape (n_columns, n_cars)."""
        codes = self.costs.codes.T[columns]
        if self.answer is not None:
            asked = [(k, self._task_at[column]) for k, column in enumerate(columns) if column in self._task_at]
            if asked:
                _tell(codes, self.answer, *(list(numbers) for numbers in zip(*asked, strict=True)))
            busy = codes[:, self.soon]
            codes[:, self.soon] = np.where(
                busy == CODE_OF_REASON[PairReason.NO_WAY], busy, np.int8(CODE_OF_REASON[PairReason.CAR_BUSY])
            )
        for k, column in enumerate(columns):
            if self.taker_of[column] >= 0:
                codes[k, self.taker_of[column]] = CODE_OF_REASON[PairReason.CHOSEN]
            if column in self.later:
                codes[k, self.later[column]] = CODE_OF_REASON[PairReason.PLANNED_LATER]
            if column in self.full:
                codes[k, codes[k] == CAN_TAKE] = CODE_OF_REASON[PairReason.NOT_OFFERED]
        return codes

    @cached_property
    def _task_at(self) -> dict[int, int]:
        """Number of a column's task in the problem."""
        return {} if self.answer is None else {column: k for k, column in enumerate(self.answer.columns)}


def _tell(codes: npt.NDArray[np.int8], answer: Answer, rows: list[int], tasks: list[int]) -> None:
    """Write down in some rows what the allocator's answer means for some of its tasks."""
    allowed = np.isfinite(answer.problem.cost.T[tasks])
    told = _CODE_OF[reasons(answer.problem, answer.assignment, tasks)].T
    of_cars = np.ix_(np.array(rows), answer.cars)
    codes[of_cars] = np.where(allowed, told, codes[of_cars])
