"""Vehicles that may carry several tasks: those that begin at one station are loaded together, and it pays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from planners.allocation import ALLOCATORS
from planners.allocation.job_shop.shop_kernel import empty_schedule, evaluate
from planners.allocation.job_shop.shop_plan import arrays_of, timetable
from planners.allocation.problem import AllocationProblem, Assignment
from planners.allocation.regret_lns import RegretLns
from planners.allocation.shop import Shop, ShopError
from planners.allocation.validate import faults

PICK, DROPS = 2, (3, 4)
"""Places: two vehicles, one pick station, two drop stations."""


def shop_of(jobs: list[int], n_carried: tuple[int, ...] | None, **changes: object) -> Shop:
    """Jobs from one station to others, by place; everything is 10 s apart on a line but the ways to the pick: 100 s."""
    travel_s = np.full((5, 5), 10.0)
    travel_s[:, PICK] = 100.0
    np.fill_diagonal(travel_s, 0.0)
    shop = Shop(
        travel_s=travel_s,
        start=np.array([0, 1], dtype=np.int32),
        ready_s=np.zeros(2),
        first_errand=2 * np.arange(len(jobs) + 1, dtype=np.int32),
        place=np.array([place for drop in jobs for place in (PICK, drop)], dtype=np.int32),
        station=np.array([place - PICK for drop in jobs for place in (PICK, drop)], dtype=np.int32),
        service_s=np.full(2 * len(jobs), 5.0),
        free_s=np.zeros(3),
        n_buffer_places=np.full(3, 4, dtype=np.int32),
        n_carried=None if n_carried is None else np.array(n_carried, dtype=np.int32),
    )
    return replace(shop, **changes)  # type: ignore[arg-type]


def problem_of(shop: Shop, cost: object = 1.0) -> AllocationProblem:
    return AllocationProblem(cost=np.broadcast_to(cost, (2, shop.n_jobs)).astype(np.float64), shop=shop)


def test_what_begins_at_one_station_is_loaded_together() -> None:
    shop = shop_of([3, 4, 3], (3, 1))
    times = timetable(shop, np.arange(3), np.zeros(3, dtype=np.int64))
    assert times.start_s.tolist() == [100.0, 125.0, 105.0, 140.0, 110.0, 155.0]
    assert times.objective == 130.0 + 145.0 + 160.0
    problem = problem_of(shop)
    arrays = arrays_of(problem, shop)
    kernel = evaluate(arrays, empty_schedule(arrays), np.arange(3), np.zeros(3, dtype=np.int64), np.inf)
    assert kernel == times.objective


def test_a_tray_of_two_goes_twice_for_three() -> None:
    shop = shop_of([3, 4, 3], (2, 1))
    times = timetable(shop, np.arange(3), np.zeros(3, dtype=np.int64))
    assert times.start_s.tolist() == [100.0, 120.0, 105.0, 135.0, 240.0, 255.0]


@pytest.mark.parametrize("seed", range(6))
def test_kernel_and_timetable_agree_on_any_plan(seed: int) -> None:
    rng = np.random.default_rng(seed)
    jobs = rng.integers(3, 5, 9).tolist()
    shop = shop_of(jobs, (3, 2), release_s=rng.uniform(0.0, 200.0, 9), due_s=rng.uniform(100.0, 900.0, 9))
    problem = problem_of(shop)
    arrays = arrays_of(problem, shop)
    order, vehicle = rng.permutation(9), rng.integers(0, 2, 9)
    kernel = evaluate(arrays, empty_schedule(arrays), order, vehicle, np.inf)
    assert kernel == pytest.approx(timetable(shop, order, vehicle).objective)


@pytest.mark.parametrize("name", ["regret_lns", "apparent_tardiness", "cbba", "cpsat"])
def test_plans_with_trays_are_legal(name: str) -> None:
    rng = np.random.default_rng(3)
    shop = shop_of(rng.integers(3, 5, 12).tolist(), (3, 1))
    problem = problem_of(shop, rng.uniform(0.0, 9.0, (2, 12)))
    found = ALLOCATORS.make(name, {}).allocate(problem)
    assert faults(problem, found) == []


def test_regret_lns_sends_one_vehicle_for_three_tasks_and_the_other_for_what_it_alone_may_do() -> None:
    shop = shop_of([3, 3, 3, 4], (3, 1))
    cost = np.ones((2, 4))
    cost[0, 3] = np.inf
    found = RegretLns().allocate(problem_of(shop, cost))
    assert [sorted(tasks) for tasks in found.sequence] == [[0, 1, 2], [3]]
    alone = RegretLns().allocate(problem_of(replace(shop, n_carried=None), cost))
    assert found.timetable is not None
    assert alone.timetable is not None
    assert found.timetable.objective < alone.timetable.objective - 100.0


def test_the_referee_counts_what_is_aboard() -> None:
    shop = shop_of([3, 4, 3], (3, 1))
    found = RegretLns().allocate(problem_of(shop, np.array([[1.0], [np.inf]])))
    assert faults(problem_of(shop, np.array([[1.0], [np.inf]])), found) == []
    smaller = problem_of(replace(shop, n_carried=np.array([2, 1], dtype=np.int32)), np.array([[1.0], [np.inf]]))
    assert {fault.kind for fault in faults(smaller, found)} == {"load"}
    assert {fault.kind for fault in faults(problem_of(shop, np.array([[1.0], [np.inf]])), dropped_first(found))} >= {
        "errands"
    }


def dropped_first(found: Assignment) -> Assignment:
    """The same plan, in which the first task is brought before it is picked."""
    times = found.timetable
    assert times is not None
    task = found.sequence[0][0]
    swapped = times.start_s.copy()
    swapped[[2 * task, 2 * task + 1]] = swapped[[2 * task + 1, 2 * task]]
    return replace(found, timetable=replace(times, start_s=swapped))


def test_vehicles_carry_one_at_least() -> None:
    with pytest.raises(ShopError, match=r"shop: n_carried\[1\] = 0; valid: at least 1"):
        shop_of([3], (1, 0))
