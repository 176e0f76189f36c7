"""First in, first out: the oldest task takes the vehicle that is cheapest for it."""

from __future__ import annotations

import numpy as np

from planners.allocation.problem import AllocationProblem, Assignment, assignment
from planners.status import Status


class Fifo:
    """Goes through the tasks by class, then by age; equal ages go by task, equal costs by vehicle.

    No task is passed over for a younger one of its class that it could have gone before.
    """

    def allocate(self, problem: AllocationProblem) -> Assignment:
        """Allocate; takes O(v t) for v vehicles and t tasks."""
        cost = problem.choice_cost()
        n_vehicles, n_tasks = cost.shape
        class_of = np.zeros(n_tasks) if problem.class_of is None else problem.class_of
        since_s = np.zeros(n_tasks) if problem.since_s is None else problem.since_s
        free = np.ones(n_vehicles, dtype=np.bool_)
        pairs: list[tuple[int, int]] = []
        for task in np.lexsort((since_s, class_of)).tolist():
            if len(pairs) == n_vehicles:
                break
            bids = np.where(free, cost[:, task], np.inf)
            vehicle = int(bids.argmin())
            if bids[vehicle] < np.inf:
                free[vehicle] = False
                pairs.append((vehicle, task))
        return assignment(problem, pairs, Status.FEASIBLE)
