"""Greedy allocation: the cheapest pair first, then the cheapest of what is left."""

from __future__ import annotations

import numpy as np

from planners.allocation.problem import AllocationProblem, Assignment, assignment
from planners.status import Status


class Greedy:
    """Takes pairs by class of the task, then by rising cost; equal costs go by vehicle, then by task.

    It may use fewer pairs than there could be: the cheapest pair can take the only task another vehicle is allowed.
    """

    def allocate(self, problem: AllocationProblem) -> Assignment:
        """Allocate; takes O(v t log(v t)) for v vehicles and t tasks."""
        cost = problem.choice_cost()
        vehicles, tasks = np.nonzero(np.isfinite(cost))
        class_of = np.zeros(cost.shape[1]) if problem.class_of is None else problem.class_of
        by_cost = np.lexsort((cost[vehicles, tasks], class_of[tasks]))
        vehicle_free, task_free = [True] * cost.shape[0], [True] * cost.shape[1]
        left = min(cost.shape)
        pairs: list[tuple[int, int]] = []
        for vehicle, task in zip(vehicles[by_cost].tolist(), tasks[by_cost].tolist(), strict=True):
            if len(pairs) == left:
                break
            if vehicle_free[vehicle] and task_free[task]:
                vehicle_free[vehicle] = task_free[task] = False
                pairs.append((vehicle, task))
        return assignment(problem, pairs, Status.FEASIBLE)
