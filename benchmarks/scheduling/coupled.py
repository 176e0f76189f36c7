"""Plans for cars and arms at once: how good after a second and after ten, against the best that is known.

A car fetches a parcel, brings it to an arm that serves one car at a time, and brings it away; Manhattan distances,
one second per cell. What is to be small: jobs x makespan + the sum of all ends.
"""

from __future__ import annotations

import time
from collections.abc import Iterable

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from planners.allocation.job_shop.shop_kernel import dispatch, empty_schedule
from planners.allocation.job_shop.shop_plan import arrays_of, planned
from planners.allocation.problem import AllocationProblem, Assignment
from planners.allocation.regret_lns import RegretLns, RegretLnsConfig
from planners.allocation.shop import Shop
from planners.allocation.validate import faults

CASES = ((6, 3, 1, 1566.0), (10, 4, 2, 3263.0), (20, 5, 2, 10515.0), (40, 8, 3, 23125.0), (80, 16, 4, 49770.0))
"""Jobs, cars, arms, best objective known before: of greedy with local search and of CP-SAT, 10 s each, 2 cores."""
WITHIN = 1.01
BUDGET_S, QUICK_BUDGET_S = 10.0, 1.0
N_CALIBRATION_PLANS = 50_000
"""Plans by which it is told how many fit into the budget."""
FLOOR_CELLS = 30
N_BUFFER_PLACES = 2


def coupled_problem(n_jobs: int, n_cars: int, n_arms: int, seed: int) -> AllocationProblem:
    """The instance of a size and seed; the draws, in this order, are part of the benchmark."""
    rng = np.random.default_rng(seed)
    pick = rng.integers(0, FLOOR_CELLS, (n_jobs, 2))
    arm_place = np.stack([rng.integers(0, FLOOR_CELLS, n_arms), np.zeros(n_arms, dtype=np.int64)], axis=1)
    drop = rng.integers(0, FLOOR_CELLS, (n_jobs, 2))
    start = rng.integers(0, FLOOR_CELLS, (n_cars, 2))
    service_s = rng.integers(8, 16, n_jobs)
    arm = rng.integers(0, n_arms, n_jobs)

    places = np.concatenate((pick, drop, arm_place, start))
    travel_s = np.abs(places[:, None] - places[None]).sum(axis=2).astype(np.float64)
    jobs, nowhere = np.arange(n_jobs), np.full(n_jobs, -1)
    shop = Shop(
        travel_s=travel_s,
        start=(2 * n_jobs + n_arms + np.arange(n_cars)).astype(np.int32),
        ready_s=np.zeros(n_cars),
        first_errand=(3 * np.arange(n_jobs + 1)).astype(np.int32),
        place=np.stack((jobs, 2 * n_jobs + arm, n_jobs + jobs), axis=1).ravel().astype(np.int32),
        station=np.stack((nowhere, arm, nowhere), axis=1).ravel().astype(np.int32),
        service_s=np.stack((0 * jobs, service_s, 0 * jobs), axis=1).ravel().astype(np.float64),
        free_s=np.zeros(n_arms),
        n_buffer_places=np.full(n_arms, N_BUFFER_PLACES, dtype=np.int32),
        makespan_weight=float(n_jobs),
    )
    return AllocationProblem(cost=travel_s[shop.start][:, :n_jobs], shop=shop)


def measure_coupled(trial: Trial) -> Iterable[Row]:
    """The instance of seed 0 for each size, whose best is known; the search starts from as many seeds as there are."""
    RegretLns(RegretLnsConfig(iterations=1)).allocate(coupled_problem(3, 2, 1, 0))  # compiles
    budget_s = QUICK_BUDGET_S if trial.quick else BUDGET_S
    for n_jobs, n_cars, n_arms, known in CASES:
        problem = coupled_problem(n_jobs, n_cars, n_arms, 0)
        size = f"{n_jobs}/{n_cars}/{n_arms}"
        greedy = _objective(trial, problem, _greedy(problem), size)
        _, spent_s = _search(trial, problem, N_CALIBRATION_PLANS, 0, size)
        iterations = round(N_CALIBRATION_PLANS * budget_s / spent_s)
        found, spent = zip(*(_search(trial, problem, iterations, seed, size) for seed in trial.seeds), strict=True)
        trial.check(max(found) <= greedy, f"{size}: {max(found)} is worse than greedy, {greedy}")
        yield Row(
            name=f"{size} jobs/cars/arms, worst of {len(found)}",
            value=max(found),
            unit="s",
            kind=Kind.PLAIN,
            target=f"<= {known * WITHIN:.10g}",
        )
        yield Row(name="  mean", value=float(np.mean(found)), unit="s", kind=Kind.PLAIN)
        yield Row(name="  best", value=min(found), unit="s", kind=Kind.PLAIN)
        yield Row(name="  greedy", value=greedy, unit="s", kind=Kind.PLAIN)
        yield Row(name="  mean below the best known before", value=100.0 * (1.0 - np.mean(found) / known), unit="%")
        yield Row(name="  plans tried", value=iterations, unit="")
        yield Row(
            name="  time of one plan", value=1e6 * float(np.mean(spent)) / iterations, unit="us CPU", kind=Kind.TIME
        )
        yield Row(name="  time of a search", value=float(np.mean(spent)), unit="s CPU", kind=Kind.TIME)


def _search(trial: Trial, problem: AllocationProblem, iterations: int, seed: int, size: str) -> tuple[float, float]:
    """Objective and CPU time [s] of one search."""
    begin_s = time.process_time()
    assignment = RegretLns(RegretLnsConfig(iterations=iterations, seed=seed)).allocate(problem)
    spent_s = time.process_time() - begin_s
    return _objective(trial, problem, assignment, size), spent_s


def _greedy(problem: AllocationProblem) -> Assignment:
    assert problem.shop is not None
    arrays = arrays_of(problem, problem.shop)
    n_jobs = problem.shop.n_jobs
    order, vehicle = np.arange(n_jobs), np.full(n_jobs, -1)
    dispatch(arrays, empty_schedule(arrays), 0.0, order, vehicle)
    return planned(problem, problem.shop, order, vehicle)


def _objective(trial: Trial, problem: AllocationProblem, assignment: Assignment, size: str) -> float:
    """Objective of a plan that the referee has replayed."""
    found = faults(problem, assignment)
    trial.check(found == [], f"{size}: {found[:3]}")
    done = sum(map(len, assignment.sequence))
    trial.check(done == problem.cost.shape[1], f"{size}: {done} of {problem.cost.shape[1]} jobs are planned")
    return assignment.timetable.objective if assignment.timetable is not None else np.inf
