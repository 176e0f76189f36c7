"""Referee: lists everything that is wrong with an assignment. Shares no code with the allocators."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from planners.allocation.problem import AllocationProblem, Assignment


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One thing that is wrong with an assignment."""

    kind: str
    """unknown, vehicle_twice, task_twice, not_allowed, cost."""
    pair: tuple[int, int] | None
    """(vehicle, task); for vehicle_twice and task_twice the other one is -1; None where no pair is to blame."""


def faults(problem: AllocationProblem, assignment: Assignment) -> list[Fault]:
    """Check an assignment against its problem; empty = legal."""
    n_vehicles, n_tasks = problem.cost.shape
    pairs = [(int(vehicle), int(task)) for vehicle, task in assignment.pairs]
    found = []
    total = 0.0
    for vehicle, task in pairs:
        if not (0 <= vehicle < n_vehicles and 0 <= task < n_tasks):
            found.append(Fault(kind="unknown", pair=(vehicle, task)))
        elif problem.cost[vehicle, task] == math.inf:
            found.append(Fault(kind="not_allowed", pair=(vehicle, task)))
        else:
            total += float(problem.cost[vehicle, task])
    for vehicle, times in Counter(vehicle for vehicle, _ in pairs).items():
        if times > 1:
            found.append(Fault(kind="vehicle_twice", pair=(vehicle, -1)))
    for task, times in Counter(task for _, task in pairs).items():
        if times > 1:
            found.append(Fault(kind="task_twice", pair=(-1, task)))
    if not found and not math.isclose(total, assignment.cost, rel_tol=1e-9, abs_tol=1e-9):
        found.append(Fault(kind="cost", pair=None))
    return found
