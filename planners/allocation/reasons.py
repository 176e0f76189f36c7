"""Reasons: why each pair of a vehicle and a task was chosen or not, told from the problem and its assignment alone."""

from __future__ import annotations

from enum import IntEnum, unique

import numpy as np
import numpy.typing as npt

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


def reasons(problem: AllocationProblem, assignment: Assignment) -> npt.NDArray[np.int8]:
    """Reason of every pair.

    Args:
        problem: The problem.
        assignment: A legal assignment of it.

    Returns:
        Values of `Reason`, shape (n_vehicles, n_tasks).
    """
    n_vehicles, n_tasks = problem.cost.shape
    if not problem.cost.size:
        return np.zeros((n_vehicles, n_tasks), dtype=np.int8)
    vehicles, tasks = assignment.pairs.T
    task_of, vehicle_of = np.full(n_vehicles, NO_TASK), np.full(n_tasks, -1)
    task_of[vehicles], vehicle_of[tasks] = tasks, vehicles
    # What each vehicle pays, and what is paid for each task; inf if it has none, nobody takes it.
    pays, paid = np.full(n_vehicles, np.inf), np.full(n_tasks, np.inf)
    pays[vehicles] = paid[tasks] = problem.cost[vehicles, tasks]

    has_task, is_taken = (task_of != NO_TASK)[:, None], (vehicle_of >= 0)[None]
    later, first = np.zeros(problem.cost.shape, dtype=np.bool_), np.zeros(problem.cost.shape, dtype=np.bool_)
    for vehicle, sequence in enumerate(assignment.sequence):
        later[vehicle, list(sequence[1:])] = True
    if problem.class_of is not None:
        first = has_task & (problem.class_of[task_of][:, None] < problem.class_of[None])
    keeps, stays = np.zeros((n_vehicles, 1), dtype=np.bool_), np.zeros((1, n_tasks), dtype=np.bool_)
    if problem.held is not None:
        keeps = has_task & (problem.held == task_of)[:, None]
        stays = is_taken & (problem.held[vehicle_of] == np.arange(n_tasks))[None]
    cheaper_for_vehicle, cheaper_for_task = problem.cost < pays[:, None], problem.cost < paid[None]

    pair = np.zeros(problem.cost.shape, dtype=np.bool_)
    pair[vehicles, tasks] = True
    found = np.select(
        [
            pair,
            ~np.isfinite(problem.cost),
            later,
            first,
            (keeps & cheaper_for_vehicle & ~(is_taken & ~cheaper_for_task)) | (stays & cheaper_for_task),
            is_taken & ~cheaper_for_task,
            has_task & ~cheaper_for_vehicle,
            has_task | is_taken,
        ],
        list(Reason)[:-1],
        default=Reason.LEFT_FOR_LATER,
    )
    return found.astype(np.int8)
