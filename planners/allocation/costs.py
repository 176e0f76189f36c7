"""What a task costs a vehicle, as seconds of travel: the way to it, lateness, and what the task presses for."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt


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
    end_s = now_s + travel_s + rest_s + service_s
    late_s = np.maximum(0.0, end_s - due_s)
    best_s = end_s.min(axis=0)
    late_next_turn_s = np.maximum(0.0, best_s + (best_s - now_s) - due_s)
    pressure_s = weights.ageing * (now_s - since_s) + weights.next_turn * late_next_turn_s
    return TaskCosts(cost_s=travel_s + weights.lateness * late_s - pressure_s, pressure_s=pressure_s)
