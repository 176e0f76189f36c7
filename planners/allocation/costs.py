"""What a task costs a vehicle, as seconds of travel: the way to it, lateness, and what the task presses for."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from planners.allocation.arrays import FloatArray

LOOK_AHEAD = 2.0
"""Due dates begin to press so many mean times of a task before time is up; the rule's authors advise 1 to 3."""


class CostWeights(NamedTuple):
    """What things are worth, in seconds of travel."""

    lateness: float
    """A second that a task is later with the vehicle in question than with the best one."""
    ageing: float
    """A second that a task has waited so far."""
    due: float
    """A task of mean length whose time is used up is worth so many times that length."""


class TaskCosts(NamedTuple):
    """Costs of tasks, and the part of them that no choice of a vehicle changes."""

    cost_s: npt.NDArray[np.float64]
    """What each task costs each vehicle, shape (n_vehicles, n_tasks) [s]; inf where travel is."""
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
    later after its due date than with the best vehicle, less what the task presses for: a weight times its age, and
    what its due date presses. So of the tasks the one whose time runs out goes first, and of the vehicles the one that
    brings it in time.

    How much a due date presses is told by the apparent tardiness cost rule (`urgency`); a late task presses no more
    than one that is just in time, so that a fleet with more work than it can do does not give up what could still be
    done in time for what is late anyway.

    Args:
        travel_s: Time until each vehicle is where each task begins, shape (n_vehicles, n_tasks);
            inf = not allowed.
        rest_s: Travel from there to where the task ends, shape (n_tasks,).
        service_s: Time that vehicles stand for it, shape (n_tasks,).
        since_s: Since when each task waits, shape (n_tasks,).
        due_s: When it should be done, inf = no matter, shape (n_tasks,).
        now_s: The time, on the clock of `since_s` and `due_s`.
        weights: What each is worth.
    """
    by_task = np.ascontiguousarray(travel_s.T)
    cost_s, best_s = np.empty_like(by_task), np.empty(len(by_task))
    _late_costs(by_task, np.array([rest_s, service_s, due_s]), now_s, weights.lateness, cost_s, best_s)
    takes_s = best_s - now_s
    mean_s = mean_time(takes_s)
    slack_s = np.subtract(due_s, best_s, out=np.full(len(due_s), np.inf), where=np.isfinite(takes_s))
    # As in the rule, of tasks that press alike the shorter one goes first.
    due_worth_s = weights.due * mean_s * mean_s / np.maximum(takes_s, 1.0)
    pressure_s = weights.ageing * _age_s(since_s, due_s, now_s) + due_worth_s * urgency(slack_s, mean_s)
    cost_s -= pressure_s[:, None]
    return TaskCosts(cost_s=cost_s.T, pressure_s=pressure_s)


def mean_time(takes_s: FloatArray) -> float:
    """Mean of the finite times [s], 0 if there are none."""
    known = takes_s[np.isfinite(takes_s)]
    return float(known.mean()) if len(known) else 0.0


def urgency(slack_s: npt.NDArray[np.float64], mean_s: float) -> npt.NDArray[np.float64]:
    """How much due dates press: 1 without any time to spare, falling by e with each `LOOK_AHEAD` mean times of a task.

    The exponential of the apparent tardiness cost rule (Vepsalainen, Morton, "Priority rules for job shops with
    weighted tardiness costs", Management Science 33(8), 1987).

    Args:
        slack_s: Time to spare of each task if it was begun now, negative = it will be late, inf = it has no due date,
            any shape.
        mean_s: Time that tasks take on average, >= 0.
    """
    return np.exp(-np.maximum(slack_s, 0.0) / max(LOOK_AHEAD * mean_s, 1e-9))


def _age_s(since_s: FloatArray, due_s: FloatArray, now_s: float) -> FloatArray:
    """How long tasks have waited [s]: those with a due date were told how long they may, so they age from that on."""
    return np.maximum(now_s - np.where(np.isfinite(due_s), due_s, since_s), 0.0)


@njit(cache=True, nogil=True)
def _late_costs(
    travel_s: FloatArray, work_s: FloatArray, now_s: float, lateness: float, cost_s: FloatArray, best_s: FloatArray
) -> None:
    """Travel and lateness of each task (row) with each vehicle (column), and the soonest end of each task."""
    for task in range(travel_s.shape[0]):
        begin_s = now_s + work_s[0, task] + work_s[1, task]
        least_s = np.inf
        for vehicle in range(travel_s.shape[1]):
            least_s = min(least_s, travel_s[task, vehicle])
        best_s[task] = begin_s + least_s
        from_s = max(best_s[task], work_s[2, task])
        for vehicle in range(travel_s.shape[1]):
            end_s = begin_s + travel_s[task, vehicle]
            cost_s[task, vehicle] = travel_s[task, vehicle]
            if end_s > from_s:
                cost_s[task, vehicle] += lateness * (end_s - from_s)
