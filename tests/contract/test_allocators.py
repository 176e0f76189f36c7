"""Every allocator gives legal, complete assignments; the referee, who shares no code with them, is the judge."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from planners.allocation import ALLOCATORS
from planners.allocation.problem import AllocationProblem, Assignment
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
