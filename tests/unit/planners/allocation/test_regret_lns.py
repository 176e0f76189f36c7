"""Plans over vehicles and stations: never worse than greedy, and the best there is where all can be tried."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from planners.allocation.job_shop.shop_kernel import dispatch, empty_schedule, evaluate
from planners.allocation.job_shop.shop_plan import arrays_of, timetable
from planners.allocation.problem import AllocationProblem
from planners.allocation.regret_lns import RegretLns, RegretLnsConfig
from planners.allocation.shop import Shop, ShopError
from planners.allocation.validate import faults
from planners.errors import PlanningError


def problem_of(seed: int, n_jobs: int, n_vehicles: int, n_stations: int, errands: int = 3) -> AllocationProblem:
    """Fetch, be served by an arm, bring away; whole seconds, so that sums are exact."""
    rng = np.random.default_rng(seed)
    places = rng.integers(0, 30, (3 * n_jobs + n_vehicles, 2))
    travel_s = np.abs(places[:, None] - places[None]).sum(axis=2).astype(np.float64)
    station = np.full((n_jobs, errands), -1)
    station[:, 1:3] = rng.integers(0, n_stations, (n_jobs, 2))
    shop = Shop(
        travel_s=travel_s,
        start=np.arange(n_vehicles),
        ready_s=np.full(n_vehicles, 50.0),
        first_errand=errands * np.arange(n_jobs + 1),
        place=n_vehicles + np.arange(3 * n_jobs),
        station=station.ravel(),
        service_s=rng.integers(8, 16, errands * n_jobs).astype(np.float64),
        free_s=np.full(n_stations, 60.0),
        n_buffer_places=np.full(n_stations, 2),
        makespan_weight=float(n_jobs),
    )
    return AllocationProblem(cost=travel_s[:n_vehicles, shop.place[::errands]], shop=shop)


def objective_of(problem: AllocationProblem, iterations: int) -> float:
    assignment = RegretLns(RegretLnsConfig(iterations=iterations)).allocate(problem)
    assert faults(problem, assignment) == []
    assert assignment.timetable is not None
    return assignment.timetable.objective


@pytest.mark.parametrize("seed", range(4))
def test_it_is_never_worse_than_greedy_and_better_with_more_work(seed: int) -> None:
    problem = problem_of(seed, n_jobs=12, n_vehicles=4, n_stations=2)
    assert problem.shop is not None
    arrays = arrays_of(problem, problem.shop)
    order, vehicle = np.arange(12), np.full(12, -1)
    assert dispatch(arrays, empty_schedule(arrays), 0.0, order, vehicle) == 12
    greedy = timetable(problem.shop, order, vehicle).objective
    assert objective_of(problem, 0) <= greedy
    assert objective_of(problem, 5000) < greedy


@pytest.mark.parametrize("seed", range(3))
def test_a_small_plan_is_the_best_there_is(seed: int) -> None:
    problem = problem_of(seed, n_jobs=4, n_vehicles=2, n_stations=1)
    assert problem.shop is not None
    plans = itertools.product(itertools.permutations(range(4)), itertools.product(range(2), repeat=4))
    best = min(timetable(problem.shop, np.array(order), np.array(vehicle)).objective for order, vehicle in plans)
    assert objective_of(problem, 5000) == best


@pytest.mark.parametrize("seed", range(5))
def test_the_kernel_and_the_timetable_agree(seed: int) -> None:
    problem = problem_of(seed, n_jobs=20, n_vehicles=3, n_stations=2)
    assert problem.shop is not None
    rng = np.random.default_rng(seed)
    order, vehicle = rng.permutation(20), rng.integers(0, 3, 20)
    arrays = arrays_of(problem, problem.shop)
    from_zero = evaluate(arrays, empty_schedule(arrays), order, vehicle, np.inf)
    since_ready_s = 50.0 * (20 + 20)  # each end, and the last one twenty times over
    assert timetable(problem.shop, order, vehicle).objective == from_zero + since_ready_s


def test_an_urgent_task_is_served_first() -> None:
    problem = problem_of(0, n_jobs=10, n_vehicles=1, n_stations=1)
    class_of = np.ones(10, dtype=np.int32)
    class_of[7] = 0
    urgent = AllocationProblem(cost=problem.cost, shop=problem.shop, class_of=class_of)
    assert RegretLns().allocate(urgent).sequence[0][0] == 7


def test_a_window_holds_what_is_held_and_then_the_oldest() -> None:
    problem = problem_of(0, n_jobs=10, n_vehicles=2, n_stations=1)
    windowed = AllocationProblem(
        cost=problem.cost, shop=problem.shop, since_s=-np.arange(10.0), held=np.array([2, -1], dtype=np.int32)
    )
    sequence = RegretLns(RegretLnsConfig(window_n=4)).allocate(windowed).sequence
    assert sorted(itertools.chain(*sequence)) == [2, 7, 8, 9]


@pytest.mark.parametrize("setting", ["iterations", "window_n", "seed"])
def test_a_setting_out_of_range_is_refused(setting: str) -> None:
    with pytest.raises(PlanningError, match=f"{setting} = -1"):
        RegretLnsConfig(**{setting: -1})


@pytest.mark.parametrize(("keep_gain", "taker"), [(5.0, 1), (0.5, 0)])
def test_a_held_task_changes_hands_only_if_the_plan_gains_enough(keep_gain: float, taker: int) -> None:
    """Vehicle 1 holds the task and is 9 s away, vehicle 0 is 8 s away."""
    shop = Shop(
        travel_s=np.array([[0.0, np.inf, np.inf], [8.0, 0.0, np.inf], [9.0, np.inf, 0.0]]),
        start=np.array([1, 2], dtype=np.int32),
        ready_s=np.zeros(2),
        first_errand=np.array([0, 1], dtype=np.int32),
        place=np.zeros(1, dtype=np.int32),
        station=np.zeros(1, dtype=np.int32),
        service_s=np.ones(1),
        free_s=np.zeros(1),
        n_buffer_places=np.ones(1, dtype=np.int32),
    )
    held = np.array([-1, 0], dtype=np.int32)
    problem = AllocationProblem(cost=np.array([[8.0], [9.0]]), shop=shop, held=held, keep_gain=keep_gain)
    assert RegretLns().allocate(problem).pairs.tolist() == [[taker, 0]]


def test_a_plan_that_is_proposed_is_not_lost() -> None:
    problem = problem_of(1, n_jobs=12, n_vehicles=4, n_stations=2)
    assert problem.shop is not None
    order, vehicle = RegretLns(RegretLnsConfig(iterations=20_000)).plan(problem, problem.shop)
    arrays = arrays_of(problem, problem.shop)
    known = evaluate(arrays, empty_schedule(arrays), order, vehicle, np.inf)
    found, by = RegretLns(RegretLnsConfig(iterations=0)).plan(problem, problem.shop)
    assert known < evaluate(arrays, empty_schedule(arrays), found, by, np.inf)
    # A job that is new since then comes last.
    proposed = replace(problem.shop, first_order=order[:-1].astype(np.int32), first_vehicle=vehicle.astype(np.int32))
    found, by = RegretLns(RegretLnsConfig(iterations=0)).plan(replace(problem, shop=proposed), proposed)
    assert evaluate(arrays, empty_schedule(arrays), found, by, np.inf) <= known


@pytest.mark.parametrize(
    ("order", "vehicle", "what"),
    [
        ([0, 1], None, "both"),
        ([0, 0], [0, 0, 0], "twice"),
        ([0, 3], [0, 0, 0], r"first_order\[1\] = 3"),
        ([0, 1], [0, 2, 0], r"first_vehicle\[1\] = 2"),
    ],
)
def test_a_proposal_that_means_nothing_is_refused(order: list[int], vehicle: list[int] | None, what: str) -> None:
    problem = problem_of(0, n_jobs=3, n_vehicles=2, n_stations=1)
    assert problem.shop is not None
    of_job = None if vehicle is None else np.array(vehicle, dtype=np.int32)
    with pytest.raises(ShopError, match=what):
        replace(problem.shop, first_order=np.array(order, dtype=np.int32), first_vehicle=of_job)


def test_as_many_as_possible_are_in_time_if_being_late_costs_much() -> None:
    """One vehicle, one place, ten jobs of 10 s each; in the order of their names only the last five could be late."""
    n = 10
    shop = Shop(
        travel_s=np.zeros((1, 1)),
        start=np.zeros(1, dtype=np.int32),
        ready_s=np.zeros(1),
        first_errand=np.arange(n + 1),
        place=np.zeros(n, dtype=np.int32),
        station=np.full(n, -1),
        service_s=np.full(n, 10.0),
        due_s=10.0 * np.arange(n, 0, -1) - 15.0,
        late_cost=np.full(n, 1000.0),
    )
    problem = AllocationProblem(cost=np.zeros((1, n)), shop=shop)
    assignment = RegretLns().allocate(problem)
    assert faults(problem, assignment) == []
    assert assignment.timetable is not None
    # Due at 85, 75, ..., 5, -5 s: two can never be in time, all others if the most urgent goes first.
    assert np.count_nonzero(assignment.timetable.end_s > shop.due_s) == 2
