"""Every allocator gives legal, complete assignments; the referee, who shares no code with them, is the judge."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from planners.allocation import ALLOCATORS
from planners.allocation.problem import AllocationProblem, Assignment
from planners.allocation.shop import Shop
from planners.allocation.validate import faults
from planners.status import Status

INF = np.inf

PROBLEMS: dict[str, np.ndarray] = {
    "nobody": np.zeros((0, 4)),
    "nothing_to_do": np.zeros((4, 0)),
    "one": np.array([[3.0]]),
    "nothing_allowed": np.full((3, 2), INF),
    "idle_vehicle": np.array([[INF, INF], [1.0, 2.0]]),
    "orphan_task": np.array([[INF, 1.0], [INF, 2.0]]),
    "all_equal": np.ones((4, 4)),
    "all_free": np.zeros((3, 5)),
    "negative": np.array([[-5.0, 1.0], [-6.0, -1.0]]),
    "hall": np.array([[1.0, INF, INF], [1.0, INF, INF], [5.0, 6.0, 7.0]]),
    "more_vehicles": np.arange(12.0).reshape(6, 2),
    "more_tasks": np.arange(12.0).reshape(2, 6),
}
for seed, shape in enumerate([(4, 4), (3, 5), (5, 3), (5, 5), (4, 6)]):
    rng = np.random.default_rng(seed)
    cost = rng.uniform(-10.0, 100.0, shape)
    PROBLEMS[f"dense_{seed}"] = cost
    PROBLEMS[f"sparse_{seed}"] = np.where(rng.random(shape) < 0.5, INF, cost)

allocators = pytest.mark.parametrize("allocator", ALLOCATORS)
problems = pytest.mark.parametrize("name", PROBLEMS)


def allocate(allocator: str, name: str) -> tuple[AllocationProblem, Assignment]:
    problem = AllocationProblem(cost=PROBLEMS[name].copy())
    return problem, ALLOCATORS[allocator]().allocate(problem)


def best(cost: np.ndarray) -> tuple[int, float]:
    """Most pairs and their least cost, by trying everything."""
    if cost.shape[0] > cost.shape[1]:
        cost = cost.T
    found = (0, 0.0)
    for tasks in itertools.permutations(range(cost.shape[1]), cost.shape[0]):
        entries = [cost[vehicle, task] for vehicle, task in enumerate(tasks) if cost[vehicle, task] < INF]
        choice = (-len(entries), float(sum(entries)))
        found = min(found, choice)
    return -found[0], found[1]


@allocators
@problems
def test_an_assignment_is_legal(allocator: str, name: str) -> None:
    problem, assignment = allocate(allocator, name)
    assert faults(problem, assignment) == []
    assert assignment.pairs.dtype == np.int32
    assert assignment.pairs.shape == (len(assignment.pairs), 2)
    assert (np.diff(assignment.pairs[:, 0]) > 0).all(), "by vehicle"


@allocators
@problems
def test_no_allowed_pair_is_left_over(allocator: str, name: str) -> None:
    problem, assignment = allocate(allocator, name)
    left = problem.cost.copy()
    left[assignment.pairs[:, 0]] = INF
    left[:, assignment.pairs[:, 1]] = INF
    assert np.isinf(left).all()


@allocators
@problems
def test_who_says_optimal_is(allocator: str, name: str) -> None:
    problem, assignment = allocate(allocator, name)
    most, least = best(problem.cost)
    if assignment.status is Status.OPTIMAL:
        assert len(assignment.pairs) == most
        assert assignment.cost == pytest.approx(least)
    else:
        assert len(assignment.pairs) <= most


@allocators
def test_nothing_allowed_is_a_status(allocator: str) -> None:
    assert allocate(allocator, "nothing_allowed")[1].status is Status.INFEASIBLE
    assert allocate(allocator, "nobody")[1].status is not Status.INFEASIBLE


@allocators
@problems
def test_the_input_is_not_changed(allocator: str, name: str) -> None:
    problem, _ = allocate(allocator, name)
    np.testing.assert_array_equal(problem.cost, PROBLEMS[name])


@allocators
@pytest.mark.parametrize("name", ["all_equal", "all_free", "dense_0"])
def test_the_same_problem_gives_the_same_assignment(allocator: str, name: str) -> None:
    assert allocate(allocator, name)[1].pairs.tolist() == allocate(allocator, name)[1].pairs.tolist()


@allocators
@pytest.mark.parametrize("name", ["more_tasks", "dense_1", "sparse_1", "dense_4", "sparse_4"])
def test_an_urgent_task_is_not_left_for_a_less_urgent_one(allocator: str, name: str) -> None:
    """Taken one at a time: no vehicle with a less urgent task may do an urgent one that nobody got."""
    n_tasks = PROBLEMS[name].shape[1]
    class_of = np.arange(n_tasks, dtype=np.int32)[::-1] % 3
    problem = AllocationProblem(cost=PROBLEMS[name], class_of=class_of)
    assignment = ALLOCATORS[allocator]().allocate(problem)
    assert faults(problem, assignment) == []
    left = np.setdiff1d(np.arange(n_tasks), assignment.pairs[:, 1])
    for vehicle, task in assignment.pairs:
        more_urgent = left[class_of[left] < class_of[task]]
        assert np.isinf(problem.cost[vehicle, more_urgent]).all()


@allocators
def test_a_held_task_goes_to_another_only_for_a_gain(allocator: str) -> None:
    cost, held = np.array([[8.0, 30.0], [9.0, 31.0]]), np.array([-1, 0], dtype=np.int32)
    for keep_gain, holder in ((0.0, 0), (2.0, 1)):
        problem = AllocationProblem(cost=cost[:, :1], held=held, keep_gain=keep_gain)
        assert ALLOCATORS[allocator]().allocate(problem).pairs.tolist() == [[holder, 0]]


def shop_problem(seed: int, n_vehicles: int = 4, n_jobs: int = 9, n_stations: int = 3) -> AllocationProblem:
    """Jobs with a pick at one station and a drop at another or at none, and everything else a shop may have."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0.0, 30.0, (12, 2))
    n_errands = rng.integers(1, 4, n_jobs)
    first_errand = np.concatenate(([0], np.cumsum(n_errands)))
    total = int(first_errand[-1])
    shop = Shop(
        travel_s=np.linalg.norm(places[:, None] - places[None], axis=2),
        start=rng.integers(0, 12, n_vehicles),
        ready_s=rng.uniform(100.0, 120.0, n_vehicles),
        first_errand=first_errand,
        place=rng.integers(0, 12, total),
        station=rng.integers(-1, n_stations, total),
        service_s=rng.uniform(0.0, 15.0, total),
        free_s=rng.uniform(90.0, 130.0, n_stations),
        n_buffer_places=rng.integers(1, 3, n_stations),
        release_s=rng.uniform(90.0, 150.0, n_jobs),
        due_s=np.where(rng.random(n_jobs) < 0.5, np.inf, rng.uniform(100.0, 300.0, n_jobs)),
        weight=rng.uniform(0.0, 2.0, n_jobs),
        late_weight=rng.uniform(0.0, 5.0, n_jobs),
        late_cost=rng.uniform(0.0, 100.0, n_jobs),
        makespan_weight=float(n_jobs),
    )
    cost = shop.travel_s[shop.start][:, shop.place[first_errand[:-1]]]
    cost[rng.random(cost.shape) < 0.2] = INF
    held = np.full(n_vehicles, -1, dtype=np.int32)
    held[0] = 3
    return AllocationProblem(cost=cost, shop=shop, class_of=rng.integers(0, 2, n_jobs), held=held, keep_gain=5.0)


@allocators
@pytest.mark.parametrize("seed", range(8))
def test_what_is_planned_ahead_is_legal(allocator: str, seed: int) -> None:
    problem = shop_problem(seed)
    assignment = ALLOCATORS[allocator]().allocate(problem)
    assert faults(problem, assignment) == []
    assert len(assignment.pairs)
    again = ALLOCATORS[allocator]().allocate(problem)
    assert again.pairs.tolist() == assignment.pairs.tolist()
    assert again.sequence == assignment.sequence


@allocators
def test_a_task_that_nobody_may_do_is_left_out_of_plans(allocator: str) -> None:
    problem = shop_problem(0)
    problem.cost[:, 4] = INF
    assignment = ALLOCATORS[allocator]().allocate(problem)
    assert faults(problem, assignment) == []
    assert 4 not in assignment.pairs[:, 1]


@allocators
def test_who_does_not_plan_ahead_needs_no_shop(allocator: str) -> None:
    with_shop = ALLOCATORS[allocator]().allocate(shop_problem(0))
    assert bool(with_shop.sequence) == getattr(ALLOCATORS[allocator], "plans_ahead", False)
