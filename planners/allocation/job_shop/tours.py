"""Tours: lists of tasks of vehicles that know of each other's tasks, but not of each other's turns at the stations."""

from __future__ import annotations

import math

import numpy as np

from planners.allocation.job_shop.shop_plan import planned
from planners.allocation.problem import AllocationProblem, Assignment
from planners.allocation.shop import Shop


class Tours:
    """A list of tasks for each vehicle, and what it costs to put in one more.

    Args:
        problem: Says who may do what, and who holds what.
        shop: Its shop.
    """

    def __init__(self, problem: AllocationProblem, shop: Shop) -> None:
        first, last = shop.first_errand[:-1], shop.first_errand[1:] - 1
        self.tasks: list[list[int]] = [[] for _ in range(shop.n_vehicles)]
        """Tasks of each vehicle, in order."""
        inside_s = shop.service_s.copy()
        inside_s[1:] += shop.travel_s[shop.place[:-1], shop.place[1:]]
        inside_s[first] = shop.service_s[first]
        gained = np.zeros(problem.cost.shape)
        holders, held, worth = problem.kept()
        gained[holders, held] = worth
        self._worth_s = gained
        inside = np.add.reduceat(inside_s, first) if shop.n_jobs else np.zeros(0)
        self._own_s = np.where(np.isinf(problem.cost), np.inf, inside - gained).tolist()
        self._from_start_s = shop.travel_s[np.ix_(shop.start, shop.place[first])].tolist()
        self._between_s = shop.travel_s[np.ix_(shop.place[last], shop.place[first])].tolist()

    def best_place(self, vehicle: int, task: int) -> tuple[float, int]:
        """The least time that a task adds to a tour [s], inf = not allowed or no way, and at which position."""
        tour, between_s = self.tasks[vehicle], self._between_s
        least, where = math.inf, 0
        for position in range(len(tour) + 1):
            ways_s = self._from_start_s[vehicle] if position == 0 else between_s[tour[position - 1]]
            added = self._own_s[vehicle][task] + ways_s[task]
            if position < len(tour):
                added += between_s[task][tour[position]] - ways_s[tour[position]]
            if position == 0 and tour:
                # What goes before a held task lets it change hands as well.
                added += float(self._worth_s[vehicle, tour[0]])
            if added < least:
                least, where = added, position
        return least, where

    def insert(self, vehicle: int, task: int) -> None:
        """Put a task into a tour where it adds least."""
        self.tasks[vehicle].insert(self.best_place(vehicle, task)[1], task)


def planned_tours(problem: AllocationProblem, shop: Shop, tours: list[list[int]]) -> Assignment:
    """The assignment that tours come to: stations serve in the order of the tours' positions, first tasks first."""
    turns = sorted((position, v, task) for v, tour in enumerate(tours) for position, task in enumerate(tour))
    vehicle = np.full(shop.n_jobs, -1, dtype=np.int64)
    for _, v, task in turns:
        vehicle[task] = v
    return planned(problem, shop, np.array([task for _, _, task in turns], dtype=np.int64), vehicle)
