"""CP-SAT: the next few tasks planned by a constraint solver, from the plan of `regret_lns` and against it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from planners.allocation.arrays import Int64Array
from planners.allocation.job_shop.shop_kernel import Arrays, empty_schedule, evaluate
from planners.allocation.job_shop.shop_plan import arrays_of, planned
from planners.allocation.problem import AllocationProblem, Assignment
from planners.allocation.regret_lns import RegretLns, RegretLnsConfig
from planners.errors import PlanningError

TICK_S = 0.1
"""The solver counts in whole ticks; ways and services are rounded up, so that what it plans can be done."""


@dataclass(frozen=True, kw_only=True)
class CpSatConfig:
    """Settings of `CpSat`."""

    window_n: int = 12
    """Tasks given to the solver at most; from about 20 on it falls behind local search."""
    budget: float = 0.2
    """Deterministic time of the solver, in its own unit, about a second."""
    iterations: int = RegretLnsConfig.iterations
    """Of `regret_lns`."""
    seed: int = 0
    """Of both."""

    def __post_init__(self) -> None:
        for name, least in (("window_n", 1), ("iterations", 0), ("seed", 0)):
            if getattr(self, name) < least:
                raise PlanningError(f"cpsat: {name} = {getattr(self, name)}; valid: at least {least}")
        if not self.budget > 0:
            raise PlanningError(f"cpsat: budget = {self.budget}; valid: a number > 0")


class CpSat:
    """Plans the first tasks of a plan by `regret_lns` anew, and keeps whatever is better by the shop's objective.

    Needs the optional package `ortools`. Without it, without a shop, or when the solver finds nothing better within
    its budget, the answer is that of `regret_lns`, and the note of the assignment says so. One worker and a budget
    of deterministic time: the same problem gives the same answer, however busy the machine.

    Source: Perron, Didier, "CP-SAT", https://developers.google.com/optimization/cp/cp_solver; the vehicles' lists are
    one circuit through all of them.

    Args:
        config: Settings.
    """

    plans_ahead = True

    def __init__(self, config: CpSatConfig | None = None) -> None:
        self.config = CpSatConfig() if config is None else config
        self._regret_lns = RegretLns(RegretLnsConfig(iterations=self.config.iterations, seed=self.config.seed))

    def allocate(self, problem: AllocationProblem) -> Assignment:
        """Allocate; takes about the budget."""
        if problem.shop is None:
            return replace(self._regret_lns.allocate(problem), note=_note("there are no stations to plan"))
        order, vehicle = self._regret_lns.plan(problem, problem.shop)
        ahead = planned(problem, problem.shop, order, vehicle)
        if not len(order):
            return ahead
        try:
            from ortools.sat.python import cp_model
        except ImportError:
            return replace(ahead, note=_note("the package ortools is not installed (pip install '.[cpsat]')"))
        arrays = arrays_of(problem, problem.shop)
        solver = cp_model.CpSolver()
        solver.parameters.max_deterministic_time = self.config.budget
        solver.parameters.num_workers = 1
        solver.parameters.random_seed = self.config.seed
        model = _Model(cp_model.CpModel(), arrays, order[: self.config.window_n], vehicle)
        if solver.solve(model.model) not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
            return replace(ahead, note=_note("the solver found no plan within its budget"))
        window, solved = model.plan(solver, vehicle)
        whole = np.concatenate((window, order[self.config.window_n :]))
        schedule = empty_schedule(arrays)
        if evaluate(arrays, schedule, whole, solved, np.inf) >= evaluate(arrays, schedule, order, vehicle, np.inf):
            return replace(ahead, note=_note("the solver found nothing better within its budget"))
        return planned(problem, problem.shop, whole, solved)


def _note(cause: str) -> str:
    return f"cpsat: {cause}; regret_lns answered"


class _Model:
    """The first jobs of a plan as a constraint model, with the plan as a hint.

    Args:
        model: An empty `CpModel`.
        shop: The shop.
        jobs: Jobs to plan, in the order of the plan, shape (n,).
        vehicle: Vehicle of each job in the plan, shape (n_jobs,).
    """

    def __init__(self, model: Any, shop: Arrays, jobs: Int64Array, vehicle: Int64Array) -> None:
        self.model = model
        self._shop = shop
        self._jobs = [int(job) for job in jobs]
        self._horizon = self._one_after_the_other()
        self._begin: list[Any] = []  # arrival at the first errand, by position in `jobs`
        self._key: list[Any] = []  # start at the first station, or that arrival
        self._end: list[Any] = []
        self._done_by: list[Any] = []
        self._book_stations()
        self._link_vehicles()
        for k, job in enumerate(self._jobs):
            model.add_hint(self._done_by[k], int(vehicle[job]))
        self._aim()

    def plan(self, solver: Any, vehicle: Int64Array) -> tuple[Int64Array, Int64Array]:
        """Order of the jobs and vehicles of all, as solved."""
        solved = vehicle.copy()
        for job, done_by in zip(self._jobs, self._done_by, strict=True):
            solved[job] = solver.value(done_by)
        by_start = sorted(
            range(len(self._jobs)), key=lambda k: (solver.value(self._key[k]), solver.value(self._end[k]))
        )
        return np.array([self._jobs[k] for k in by_start], dtype=np.int64), solved

    def _one_after_the_other(self) -> int:
        """A time by which all is done, however badly it is planned [ticks]."""
        shop, jobs = self._shop, self._jobs
        ways_s = shop.travel_s[:, shop.first_place[jobs]]
        latest_s = [*shop.ready_s, *shop.free_s, *shop.release_s[jobs]]
        longest_s = np.max(ways_s, initial=0.0, where=np.isfinite(ways_s)) * len(jobs)
        inside_s = sum(shop.lead_s) + sum(shop.service_s) + sum(shop.tail_s[jobs])
        return _ticks(max(latest_s) + longest_s + inside_s) + 10 * len(shop.lead_s) + 10 * len(jobs)

    def _book_stations(self) -> None:
        model, shop = self.model, self._shop
        served: dict[int, list[Any]] = {}
        for job in self._jobs:
            begin = now = model.new_int_var(_ticks(shop.release_s[job]), self._horizon, "")
            key = None
            for number in range(int(shop.first_service[job]), int(shop.first_service[job + 1])):
                station, service = int(shop.station[number]), _ticks(shop.service_s[number])
                start = model.new_int_var(_ticks(shop.free_s[station]), self._horizon, "")
                model.add(start >= now + _ticks(shop.lead_s[number]))
                served.setdefault(station, []).append(model.new_fixed_size_interval_var(start, service, ""))
                now = start + service
                key = start if key is None else key
            end = model.new_int_var(0, self._horizon, "")
            model.add(end == now + _ticks(shop.tail_s[job]))
            self._begin.append(begin)
            self._key.append(begin if key is None else key)
            self._end.append(end)
        for intervals in served.values():
            model.add_no_overlap(intervals)

    def _link_vehicles(self) -> None:
        """One circuit: from a vehicle through its jobs to any other vehicle, and so on; idle ones go to the next."""
        model, shop = self.model, self._shop
        n_vehicles, n = len(shop.start), len(self._jobs)
        arcs = [(v, (v + 1) % n_vehicles, model.new_bool_var("")) for v in range(n_vehicles) if n_vehicles > 1]
        for k, job in enumerate(self._jobs):
            allowed = np.flatnonzero(np.isfinite(shop.extra[:, job])).tolist()
            done_by = model.new_int_var_from_domain(_domain(allowed), "")
            self._done_by.append(done_by)
            for v in range(n_vehicles):
                arcs.append((n_vehicles + k, v, model.new_bool_var("")))
                way_s = shop.ready_s[v] + shop.travel_s[shop.start[v], shop.first_place[job]]
                if v in allowed and np.isfinite(way_s):
                    first = model.new_bool_var("")
                    arcs.append((v, n_vehicles + k, first))
                    model.add(done_by == v).only_enforce_if(first)
                    model.add(self._begin[k] >= _ticks(way_s)).only_enforce_if(first)
        for before in range(n):
            for k, job in enumerate(self._jobs):
                way_s = shop.travel_s[shop.last_place[self._jobs[before]], shop.first_place[job]]
                if before != k and np.isfinite(way_s):
                    follows = model.new_bool_var("")
                    arcs.append((n_vehicles + before, n_vehicles + k, follows))
                    model.add(self._done_by[before] == self._done_by[k]).only_enforce_if(follows)
                    model.add(self._begin[k] >= self._end[before] + _ticks(way_s)).only_enforce_if(follows)
        model.add_circuit(arcs)

    def _aim(self) -> None:
        model, shop = self.model, self._shop
        last = model.new_int_var(0, self._horizon, "")
        terms = [float(shop.makespan_weight) * last]
        for k, job in enumerate(self._jobs):
            model.add(last >= self._end[k])
            terms.append(float(shop.weight[job]) * self._end[k])
            if np.isfinite(shop.due_s[job]) and shop.late_weight[job] > 0.0:
                late = model.new_int_var(0, self._horizon + _ticks(abs(shop.due_s[job])), "")
                model.add(late >= self._end[k] - int(shop.due_s[job] / TICK_S))
                terms.append(float(shop.late_weight[job]) * late)
            if np.isfinite(shop.due_s[job]) and shop.late_cost[job] > 0.0:
                in_time = model.new_bool_var("")
                model.add(self._end[k] <= int(shop.due_s[job] / TICK_S)).only_enforce_if(in_time)
                terms.append(float(shop.late_cost[job] / TICK_S) * (1 - in_time))
            for v in np.flatnonzero(np.isfinite(shop.extra[:, job]) & (shop.extra[:, job] > 0.0)).tolist():
                taken = model.new_bool_var("")
                model.add(self._done_by[k] != v).only_enforce_if(~taken)
                terms.append(float(shop.extra[v, job] / TICK_S) * taken)
        model.minimize(sum(terms))


def _domain(values: list[int]) -> Any:
    from ortools.sat.python import cp_model

    return cp_model.Domain.from_values(values)


def _ticks(time_s: float) -> int:
    return math.ceil(time_s / TICK_S - 1e-9)
