"""Sequential single-item auction: vehicles bid what one more task would cost them, and the lowest bid wins it."""

from __future__ import annotations

import numpy as np

from planners.allocation.job_shop.tours import Tours, planned_tours
from planners.allocation.problem import AllocationProblem, Assignment, assignment
from planners.allocation.shop import Shop
from planners.status import Status


class Auction:
    """One task is sold per round, of the most urgent class first: to the lowest of all bids for all open tasks.

    A bid needs nothing but what the bidder knows itself. With a shop it is the way that the task adds to the bidder's
    tour where it fits best, stations not counted, and the round goes on until all tasks are sold; without one a
    vehicle takes one task, and its bid is its cost. Ties go to the lowest vehicle, then the lowest task.

    Source: Lagoudakis et al., "Auction-based multi-robot routing", Robotics: Science and Systems, 2005 (rule MiniSum).
    """

    plans_ahead = True

    def allocate(self, problem: AllocationProblem) -> Assignment:
        """Allocate; O(t) rounds for t tasks, each over all vehicles and open tasks."""
        if problem.shop is not None:
            return self._tours(problem, problem.shop)
        bids = problem.choice_cost().copy()
        class_of = np.zeros(bids.shape[1]) if problem.class_of is None else problem.class_of
        pairs: list[tuple[int, int]] = []
        for urgency in np.unique(class_of):
            open_tasks = np.flatnonzero(class_of == urgency)
            while (sale := _lowest(bids[:, open_tasks])) is not None:
                vehicle, task = sale[0], int(open_tasks[sale[1]])
                pairs.append((vehicle, task))
                bids[vehicle] = np.inf
                bids[:, task] = np.inf
        return assignment(problem, pairs, Status.FEASIBLE)

    @staticmethod
    def _tours(problem: AllocationProblem, shop: Shop) -> Assignment:
        tours = Tours(problem, shop)
        class_of = np.zeros(shop.n_jobs) if problem.class_of is None else problem.class_of
        for urgency in np.unique(class_of):
            tasks = np.flatnonzero(class_of == urgency)
            bids = np.array([[tours.best_place(v, int(task))[0] for task in tasks] for v in range(shop.n_vehicles)])
            bids = bids.reshape(shop.n_vehicles, len(tasks))
            while (sale := _lowest(bids)) is not None:
                vehicle, column = sale
                tours.insert(vehicle, int(tasks[column]))
                bids[:, column] = np.inf
                for other in np.flatnonzero(np.isfinite(bids[vehicle])):
                    bids[vehicle, other] = tours.best_place(vehicle, int(tasks[other]))[0]
        return planned_tours(problem, shop, tours.tasks)


def _lowest(bids: np.ndarray) -> tuple[int, int] | None:
    """Row and column of the least bid, None if nobody bids."""
    if not bids.size:
        return None
    row, column = np.unravel_index(bids.argmin(), bids.shape)
    return (int(row), int(column)) if bids[row, column] < np.inf else None
