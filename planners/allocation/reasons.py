"""Reasons: why each pair of a vehicle and a task was chosen or not, told from the problem and its assignment alone."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum, unique
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from planners.allocation.problem import NO_TASK, AllocationProblem, Assignment


@unique
class Reason(IntEnum):
    """Why a pair was chosen or not; of several that hold, the first of this list."""

    CHOSEN = 0
    NOT_ALLOWED = 1
    PLANNED_LATER = 2
    CLASS_FIRST = 3
    KEPT = 4
    TASK_GOT_NEARER = 5
    VEHICLE_GOT_BETTER = 6
    BETTER_FOR_ALL = 7
    LEFT_FOR_LATER = 8

    def __str__(self) -> str:
        """The reason as a half-sentence that begins with the vehicle."""
        return _SENTENCES[self]


# Kernels know plain numbers only.
_CHOSEN, _NOT_ALLOWED, _PLANNED_LATER = int(Reason.CHOSEN), int(Reason.NOT_ALLOWED), int(Reason.PLANNED_LATER)
_CLASS_FIRST, _KEPT, _TASK_GOT_NEARER = int(Reason.CLASS_FIRST), int(Reason.KEPT), int(Reason.TASK_GOT_NEARER)
_VEHICLE_GOT_BETTER, _BETTER_FOR_ALL = int(Reason.VEHICLE_GOT_BETTER), int(Reason.BETTER_FOR_ALL)
_LEFT_FOR_LATER = int(Reason.LEFT_FOR_LATER)
_SENTENCES = {
    Reason.CHOSEN: "takes the task",
    Reason.NOT_ALLOWED: "is not allowed to do it, or has no way there",
    Reason.PLANNED_LATER: "is to take it after its next task",
    Reason.CLASS_FIRST: "takes a task of a more urgent class",
    Reason.KEPT: "would do it at too small a gain for what is under way to change hands",
    Reason.TASK_GOT_NEARER: "would do it at a higher cost than the vehicle that takes it, or at the same",
    Reason.VEHICLE_GOT_BETTER: "takes another task at a lower cost, or at the same",
    Reason.BETTER_FOR_ALL: "would do it at a lower cost, but then others would pay more or have nothing to do",
    Reason.LEFT_FOR_LATER: "is free, but is not to take it now",
}


def reasons(
    problem: AllocationProblem, assignment: Assignment, tasks: Sequence[int] | None = None
) -> npt.NDArray[np.int8]:
    """Reason of every pair.

    Args:
        problem: The problem.
        assignment: A legal assignment of it.
        tasks: The tasks that are asked about; None = all.

    Returns:
        Values of `Reason`, shape (n_vehicles, n_tasks) with the tasks that are asked about.
    """
    n_vehicles, n_tasks = problem.cost.shape
    asked = np.arange(n_tasks) if tasks is None else np.array(tasks, dtype=np.int64)
    found = np.zeros((n_vehicles, len(asked)), dtype=np.int8)
    if not found.size:
        return found
    vehicles, taken = assignment.pairs.T
    task_of, vehicle_of = np.full(n_vehicles, NO_TASK), np.full(n_tasks, -1)
    task_of[vehicles], vehicle_of[taken] = taken, vehicles
    # What each vehicle pays, and what is paid for each task; inf if it has none, nobody takes it.
    pays, paid = np.full(n_vehicles, np.inf), np.full(n_tasks, np.inf)
    pays[vehicles] = paid[taken] = problem.cost[vehicles, taken]

    later_for = np.full(n_tasks, -1)
    for vehicle, sequence in enumerate(assignment.sequence):
        later_for[list(sequence[1:])] = vehicle
    same = np.zeros(n_tasks, dtype=np.int32)
    nothing = np.full(n_vehicles, NO_TASK - 1, dtype=np.int32)
    _tell(
        problem.cost,
        asked,
        _Outcome(later_for, task_of, vehicle_of, pays, paid),
        same if problem.class_of is None else problem.class_of,
        nothing if problem.held is None else problem.held,
        found,
    )
    return found


class _Outcome(NamedTuple):
    """What became of vehicles and tasks."""

    later_for: npt.NDArray[np.int64]
    """The vehicle that does a task after its first one, -1 for none, shape (n_tasks,)."""
    task_of: npt.NDArray[np.int64]
    """First task of each vehicle, `NO_TASK` for none, shape (n_vehicles,)."""
    vehicle_of: npt.NDArray[np.int64]
    """Vehicle of each task, -1 for none, shape (n_tasks,)."""
    pays: npt.NDArray[np.float64]
    """What each vehicle pays, inf without a task, shape (n_vehicles,)."""
    paid: npt.NDArray[np.float64]
    """What is paid for each task, inf if nobody takes it, shape (n_tasks,)."""


@njit(cache=True)
def _tell(
    cost: npt.NDArray[np.float64],
    asked: npt.NDArray[np.int64],
    outcome: _Outcome,
    class_of: npt.NDArray[np.int32],
    held: npt.NDArray[np.int32],
    found: npt.NDArray[np.int8],
) -> None:  # pragma: no cover - compiled
    """Fill in the reason of every pair that is asked about, the first of `Reason` that holds."""
    for vehicle in range(cost.shape[0]):
        first = outcome.task_of[vehicle]
        has_task = first != NO_TASK
        keeps = has_task and held[vehicle] == first
        for k, task in enumerate(asked):
            taker = outcome.vehicle_of[task]
            taken = taker >= 0
            stays = taken and held[taker] == task
            cheaper_for_vehicle = cost[vehicle, task] < outcome.pays[vehicle]
            cheaper_for_task = cost[vehicle, task] < outcome.paid[task]
            taken_for_less = taken and not cheaper_for_task
            if first == task:
                reason = _CHOSEN
            elif not np.isfinite(cost[vehicle, task]):
                reason = _NOT_ALLOWED
            elif outcome.later_for[task] == vehicle:
                reason = _PLANNED_LATER
            elif has_task and class_of[first] < class_of[task]:
                reason = _CLASS_FIRST
            elif (keeps and cheaper_for_vehicle and not taken_for_less) or (stays and cheaper_for_task):
                reason = _KEPT
            elif taken_for_less:
                reason = _TASK_GOT_NEARER
            elif has_task and not cheaper_for_vehicle:
                reason = _VEHICLE_GOT_BETTER
            elif has_task or taken:
                reason = _BETTER_FOR_ALL
            else:
                reason = _LEFT_FOR_LATER
            found[vehicle, k] = reason
