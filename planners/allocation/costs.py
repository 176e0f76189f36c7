"""What a task costs a vehicle, as seconds of travel: the way to it, lateness, and what the task presses for."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from planners.allocation.arrays import FloatArray


class CostWeights(NamedTuple):
    """What a second of each is worth, in seconds of travel."""

    lateness: float
    """Of the time a task is late with the vehicle in question."""
    ageing: float
    """Of the time it has waited so far."""
    next_turn: float
    """Of the time it would be late if it were left to the next turn."""


class TaskCosts(NamedTuple):
    """Costs of tasks, and the part of them that no choice of a vehicle changes."""

    cost_s: npt.NDArray[np.float64]
    """What each task costs each vehicle, shape (n_vehicles, n_tasks) [s]."""
    pressure_s: npt.NDArray[np.float64]
    """How much each task presses for being served, already taken off its costs, shape (n_tasks,) [s]."""


def task_costs(
    *,
    travel_s: npt.NDArray[np.float64],
    rest_s: npt.NDArray[np.float64],
    service_s: npt.NDArray[np.float64],
    since_s: npt.NDArray[np.float64],
    due_s: npt.NDArray[np.float64],
    now_s: float,
    weights: CostWeights,
) -> TaskCosts:
    """Price tasks.

    What a task costs a vehicle is its travel to where the task begins, plus a weight times the time the task would be
    late with it, less what the task presses for: a weight times its age, and a weight times the time it would be late
    if it were left to the next turn, as long as itself, even with the best vehicle. So of the tasks a late one goes
    first, and of the vehicles the one that brings it in time. That a late task must get cheaper, not dearer, by waiting
    is the idea of the apparent tardiness cost rule: Vepsalainen, Morton, "Priority rules for job shops with weighted
    tardiness costs", Management Science 33(8), 1987.

    Args:
        travel_s: Time until each vehicle is where each task begins, shape (n_vehicles, n_tasks), at least one vehicle;
            a pair that is not allowed has a large one, and is left to the caller to refuse.
        rest_s: Travel from there to where the task ends, shape (n_tasks,).
        service_s: Time that vehicles stand for it, shape (n_tasks,).
        since_s: Since when each task waits, shape (n_tasks,).
        due_s: When it should be done, inf = no matter, shape (n_tasks,).
        now_s: The time, on the clock of `since_s` and `due_s`.
        weights: What each second is worth.
    """
    by_task = np.ascontiguousarray(travel_s.T)
    cost_s, best_s = np.empty_like(by_task), np.empty(len(by_task))
    work_s = np.array([rest_s, service_s, due_s])
    _late_costs(by_task, work_s, now_s, weights.lateness, cost_s, best_s)
    late_next_turn_s = np.maximum(0.0, best_s + (best_s - now_s) - due_s)
    pressure_s = weights.ageing * (now_s - since_s) + weights.next_turn * late_next_turn_s
    cost_s -= pressure_s[:, None]
    return TaskCosts(cost_s=cost_s.T, pressure_s=pressure_s)


@njit(cache=True, nogil=True)
def _late_costs(
    travel_s: FloatArray, work_s: FloatArray, now_s: float, lateness: float, cost_s: FloatArray, best_s: FloatArray
) -> None:
    """Travel and lateness of each task (row) with each vehicle (column), and the soonest end of each task."""
    for task in range(travel_s.shape[0]):
        rest_s, service_s, due_s = work_s[0, task], work_s[1, task], work_s[2, task]
        best = np.inf
        for vehicle in range(travel_s.shape[1]):
            end_s = now_s + travel_s[task, vehicle] + rest_s + service_s
            best = min(best, end_s)
            cost_s[task, vehicle] = travel_s[task, vehicle] + lateness * max(0.0, end_s - due_s)
        best_s[task] = best
