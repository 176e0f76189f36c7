"""Regret insertion and large-neighbourhood search: sequences of tasks, planned with the stations they book."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from planners.allocation.arrays import Int64Array
from planners.allocation.hungarian import Hungarian
from planners.allocation.job_shop.shop_kernel import (
    Arrays,
    Cooling,
    JobPlan,
    anneal,
    append,
    dispatch,
    empty_schedule,
    evaluate,
)
from planners.allocation.job_shop.shop_plan import arrays_of, planned
from planners.allocation.problem import AllocationProblem, Assignment
from planners.allocation.shop import Shop
from planners.errors import PlanningError

REGRETS = (0.0, 0.5, 1.0, 2.0)
"""Weights of regret of the plans made first; 0 is greedy."""
HOT, COLD = 5e-3, 1e-4
"""First and last temperature, as shares of the objective of the plan that is to be improved."""


@dataclass(frozen=True, kw_only=True)
class RegretLnsConfig:
    """Settings of `RegretLns`."""

    iterations: int = 2000
    """Plans to try after the first four: 2,000 take 2.8 ms for 10 tasks, 20.6 ms for 80."""
    window_n: int = 100
    """Tasks planned at most."""
    seed: int = 0
    """Of the random changes."""

    def __post_init__(self) -> None:
        for name, least in (("iterations", 0), ("window_n", 1), ("seed", 0)):
            if getattr(self, name) < least:
                raise PlanningError(f"regret_lns: {name} = {getattr(self, name)}; valid: at least {least}")


class RegretLns:
    """Plans all tasks over vehicles and stations at once, and gives each vehicle the first of its list.

    It makes a greedy plan, one by due dates, and three by regret (Potvin, Rousseau, "A parallel route building
    algorithm for the vehicle routing and scheduling problem with time windows", European Journal of Operational
    Research 66, 1993) or the one that the shop proposes, and improves the best of them in its order, its vehicles and
    whole ends of lists. It is never worse than greedy by the objective of the shop, classes weighed. A budget of
    iterations, no clock: the same problem gives the same answer.

    Of more tasks than `window_n` those held and the most urgent and oldest are planned. Without a shop there is
    nothing to plan ahead, and the matching is exact: `Hungarian` answers. Held tasks change hands only if the plan
    gains more by it than what they are kept for.

    Args:
        config: Settings.
    """

    plans_ahead = True

    def __init__(self, config: RegretLnsConfig | None = None) -> None:
        self.config = RegretLnsConfig() if config is None else config

    def allocate(self, problem: AllocationProblem) -> Assignment:
        """Allocate; takes about a microsecond per iteration and 30 tasks."""
        if problem.shop is None:
            return Hungarian().allocate(problem)
        free = planned(problem, problem.shop, *self.plan(problem, problem.shop))
        holders, tasks, worth = problem.kept()
        got = {(vehicle, task) for vehicle, task in free.pairs.tolist()}
        moved = [(vehicle, task) not in got for vehicle, task in zip(holders.tolist(), tasks.tolist(), strict=True)]
        if not any(moved):
            return free
        pinned = replace(problem, cost=_pinned(problem.cost, holders, tasks))
        kept = planned(problem, problem.shop, *self.plan(pinned, problem.shop))
        return free if _gain(kept, free) > worth[moved].sum() else kept

    def plan(self, problem: AllocationProblem, shop: Shop) -> tuple[Int64Array, Int64Array]:
        """The order of the jobs that are planned, shape (n,), and the vehicle of each job, shape (n_jobs,)."""
        arrays = arrays_of(problem, shop)
        order, vehicle = _first_plan(arrays, _window(problem, self.config.window_n), shop)
        if len(order) and self.config.iterations:
            # How hot is told by the objective in which all classes weigh the same: the weight of one urgent task
            # would melt the order of all others.
            level = evaluate(arrays_of(problem, shop, 1.0), empty_schedule(arrays), order, vehicle, np.inf)
            if level > 0.0:
                order, vehicle = self._improve(arrays, order, vehicle, level)
        return order, vehicle

    def _improve(
        self, arrays: Arrays, order: Int64Array, vehicle: Int64Array, level: float
    ) -> tuple[Int64Array, Int64Array]:
        best = JobPlan(np.empty_like(order), np.empty_like(vehicle))
        state = np.random.SeedSequence(self.config.seed).generate_state(1, np.uint64) | np.uint64(1)
        cooling = Cooling(iterations=self.config.iterations, hot=HOT * level, cold=COLD * level)
        anneal(arrays, empty_schedule(arrays), JobPlan(order, vehicle), best, cooling, state)
        return best.order, best.vehicle


def _pinned(
    cost: npt.NDArray[np.float64], holders: npt.NDArray[np.intp], tasks: npt.NDArray[np.int32]
) -> npt.NDArray[np.float64]:
    """Costs that leave every holder its task, and nothing else."""
    pinned = cost.copy()
    pinned[holders, :] = np.inf
    pinned[:, tasks] = np.inf
    pinned[holders, tasks] = cost[holders, tasks]
    return pinned


def _gain(kept: Assignment, free: Assignment) -> float:
    """What is gained by leaving held tasks to others; infinite if more gets done."""
    if kept.timetable is None or free.timetable is None:
        return 0.0
    more = np.count_nonzero(free.timetable.vehicle >= 0) > np.count_nonzero(kept.timetable.vehicle >= 0)
    return np.inf if more else kept.timetable.objective - free.timetable.objective


def _first_plan(arrays: Arrays, jobs: Int64Array, shop: Shop) -> tuple[Int64Array, Int64Array]:
    """The best of the greedy plan, the one by due dates, and those by regret or the proposed one."""
    schedule = empty_schedule(arrays)
    plans: list[tuple[int, float, int, Int64Array, Int64Array]] = []

    def keep(n_planned: int, order: Int64Array, vehicle: Int64Array) -> None:
        order = order[:n_planned]
        plans.append((-n_planned, evaluate(arrays, schedule, order, vehicle, np.inf), len(plans), order, vehicle))

    for regret in REGRETS if shop.first_order is None else REGRETS[:1]:
        order, vehicle = jobs.copy(), np.full(len(arrays.weight), -1, dtype=np.int64)
        keep(dispatch(arrays, schedule, regret, order, vehicle), order, vehicle)
    due_s = arrays.due_s[jobs]
    # What is late already is not urgent any more.
    urgent = jobs[np.lexsort((np.where(due_s < 0.0, np.inf, due_s), arrays.class_of[jobs]))]
    vehicle = np.full(len(arrays.weight), -1, dtype=np.int64)
    keep(append(arrays, schedule, 0, urgent, vehicle), urgent, vehicle)
    if shop.first_order is not None and shop.first_vehicle is not None:
        proposed = shop.first_order[np.isin(shop.first_order, jobs)].astype(np.int64)
        order = np.concatenate((proposed, urgent[~np.isin(urgent, proposed)]))
        vehicle = shop.first_vehicle.astype(np.int64)
        keep(append(arrays, schedule, len(proposed), order, vehicle), order, vehicle)
    *_, order, vehicle = min(plans, key=lambda plan: plan[:3])
    return order, vehicle


def _window(problem: AllocationProblem, n_window: int) -> Int64Array:
    """The tasks to plan, by index: those held, then by class and age."""
    n = problem.cost.shape[1]
    held = np.zeros(n, dtype=np.bool_)
    if problem.held is not None:
        held[problem.held[problem.held >= 0]] = True
    class_of = np.zeros(n) if problem.class_of is None else problem.class_of
    since_s = np.zeros(n) if problem.since_s is None else problem.since_s
    return np.sort(np.lexsort((since_s, class_of, ~held))[:n_window]).astype(np.int64)
