"""What sets the two allocators apart, on matrices small enough to solve by hand."""

from __future__ import annotations

import numpy as np

from planners.allocation.greedy import Greedy
from planners.allocation.hungarian import Hungarian
from planners.allocation.problem import AllocationProblem
from planners.status import Status

INF = np.inf


def test_greedy_takes_the_cheapest_pair_first_and_pays_for_it() -> None:
    problem = AllocationProblem(cost=np.array([[1.0, 2.0], [2.0, 9.0]]))
    greedy, hungarian = Greedy().allocate(problem), Hungarian().allocate(problem)
    assert (greedy.pairs.tolist(), greedy.cost, greedy.status) == ([[0, 0], [1, 1]], 10.0, Status.FEASIBLE)
    assert (hungarian.pairs.tolist(), hungarian.cost, hungarian.status) == ([[0, 1], [1, 0]], 4.0, Status.OPTIMAL)


def test_hungarian_takes_the_most_pairs_before_the_least_cost() -> None:
    problem = AllocationProblem(cost=np.array([[1.0, 1000.0], [1.0, INF]]))
    assert Hungarian().allocate(problem).pairs.tolist() == [[0, 1], [1, 0]]
    assert len(Greedy().allocate(problem).pairs) == 1


def test_hungarian_takes_the_most_pairs_whatever_the_size_of_the_costs() -> None:
    cost = np.full((4, 4), INF)
    cost[np.arange(4), np.arange(4)] = 1e9
    cost[np.arange(3), np.arange(1, 4)] = -1e9
    assert Hungarian().allocate(AllocationProblem(cost=cost)).pairs.tolist() == [[k, k] for k in range(4)]


def test_greedy_breaks_ties_by_vehicle_and_task() -> None:
    assert Greedy().allocate(AllocationProblem(cost=np.ones((2, 3)))).pairs.tolist() == [[0, 0], [1, 1]]
