"""Apparent tardiness cost: the rule of job shops with due dates, which trades short tasks against urgent ones."""

from __future__ import annotations

import numpy as np

from planners.allocation.arrays import FloatArray
from planners.allocation.costs import mean_time, urgency
from planners.allocation.greedy import Greedy
from planners.allocation.job_shop.shop_plan import origin_s, planned
from planners.allocation.problem import AllocationProblem, Assignment
from planners.allocation.shop import Shop

FAR_OFF = 10.0
"""Due date of jobs that have none, in mean times of a job from now."""


class ApparentTardiness:
    """Takes the pair with the greatest urgency of the task over the time it takes with the vehicle, then the next.

    Classes are strict; equal pairs go by vehicle, then by task. It sees neither queues at stations nor a second task of
    a vehicle. Source: `planners.allocation.costs.urgency`; all tasks weigh the same.

    Without a shop due dates are not known, and the cheapest pair goes first, as with `Greedy`.
    """

    plans_ahead = True

    def allocate(self, problem: AllocationProblem) -> Assignment:
        """Allocate; takes O(v t log(v t)) for v vehicles and t tasks."""
        if problem.shop is None:
            return Greedy().allocate(problem)
        allowed = np.isfinite(problem.cost)
        takes_s = np.where(allowed, _takes_s(problem.shop), np.inf)
        holders, tasks, worth = problem.kept()
        takes_s[holders, tasks] -= worth
        due_s = problem.shop.due_s
        left_s = np.full(problem.shop.n_jobs, np.inf) if due_s is None else due_s - origin_s(problem.shop)
        index = tardiness_index(takes_s, left_s)
        ranked = AllocationProblem(cost=np.where(allowed, -index, np.inf), class_of=problem.class_of)
        pairs = Greedy().allocate(ranked).pairs
        vehicle = np.full(problem.shop.n_jobs, -1, dtype=np.int64)
        vehicle[pairs[:, 1]] = pairs[:, 0]
        return planned(problem, problem.shop, pairs[:, 1].astype(np.int64), vehicle)


def _takes_s(shop: Shop) -> FloatArray:
    """Time until each vehicle has done each job, if it never waits, shape (n_vehicles, n_jobs) [s]."""
    first = shop.first_errand[:-1]
    way_s = np.zeros(len(shop.place))
    way_s[1:] = shop.travel_s[shop.place[:-1], shop.place[1:]]
    way_s[first] = 0.0
    work_s = np.add.reduceat(way_s + shop.service_s, first) if len(first) else np.zeros(0)
    there_s = shop.travel_s[shop.start[:, None], shop.place[first]]
    takes_s: FloatArray = (shop.ready_s - origin_s(shop))[:, None] + there_s + work_s
    return takes_s


def tardiness_index(takes_s: FloatArray, due_s: FloatArray) -> FloatArray:
    """How good each pair is by the rule, larger is better; 0 where there is no way.

    Args:
        takes_s: Time until each vehicle has done each job, inf = it cannot, shape (n_vehicles, n_jobs) [s].
        due_s: Time until each job should have ended, inf = it has no due date, shape (n_jobs,) [s].
    """
    mean_s = mean_time(takes_s.min(axis=0, initial=np.inf))
    # A job without a due date has one far off: else none would ever be begun before one that has.
    due_s = np.where(np.isfinite(due_s), due_s, FAR_OFF * mean_s)
    return urgency(due_s - takes_s, mean_s) / np.maximum(takes_s, 1e-3)
