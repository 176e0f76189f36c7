"""What sets the allocators apart, on matrices small enough to solve by hand."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from planners.allocation.auction import Auction
from planners.allocation.cbba import Cbba
from planners.allocation.fifo import Fifo
from planners.allocation.greedy import Greedy
from planners.allocation.hungarian import Hungarian, HungarianConfig
from planners.allocation.matching.dense_matching import match_all
from planners.allocation.matching.prune import UNREACHABLE, nearest, travel_cost
from planners.allocation.problem import AllocationProblem, CostError
from planners.allocation.shop import Shop
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


def test_fifo_serves_the_oldest_first_by_the_nearest_vehicle() -> None:
    problem = AllocationProblem(cost=np.array([[1.0, 2.0], [1.0, 3.0]]), since_s=np.array([9.0, 4.0]))
    assert Fifo().allocate(problem).pairs.tolist() == [[0, 1], [1, 0]]


def test_classes_are_strict_and_do_not_cost_pairs() -> None:
    cost = np.array([[1.0, 50.0, 2.0], [1.0, INF, 90.0]])
    for allocator in (Hungarian(), Hungarian(HungarianConfig(dense_work=0.0))):
        pairs = allocator.allocate(AllocationProblem(cost=cost, class_of=np.array([2, 0, 1], dtype=np.int32))).pairs
        assert pairs.tolist() == [[0, 1], [1, 2]], "the urgent task is served, then the next class, at any cost"


@pytest.mark.parametrize("dear", [1e6, 1e15, 1e100])
def test_what_calls_itself_optimal_is_beside_costs_that_drown_all_others(dear: float) -> None:
    """Of costs of 1e15 and classes every sixth answer was not the best one, and called itself so."""
    said = set()
    for seed in range(60):
        rng = np.random.default_rng(seed)
        cost = rng.uniform(0.0, 10.0, (4, 4))
        cost[rng.random((4, 4)) < 0.3] = dear
        answer = Hungarian().allocate(AllocationProblem(cost=cost, class_of=np.array([0, 1, 2, 0], dtype=np.int32)))
        least = min(cost[range(4), order].sum() for order in permutations(range(4)))
        said.add(answer.status)
        assert len(answer.pairs) == 4
        assert answer.status is Status.FEASIBLE or answer.cost == pytest.approx(least)
    assert said == ({Status.OPTIMAL} if dear == 1e6 else {Status.OPTIMAL, Status.FEASIBLE})


def test_costs_that_leave_no_room_for_a_step_are_refused() -> None:
    cost, classes = np.array([[1.0, 1.7e308], [2.0, 3.0]]), np.array([0, 1], dtype=np.int32)
    for problem in (AllocationProblem(cost=cost, class_of=classes), AllocationProblem(cost=np.c_[cost, [INF, 1.0]])):
        with pytest.raises(CostError, match=r"costs are from 1 to 1\.7e\+308; valid: a difference of at most 1e\+200"):
            Hungarian().allocate(problem)
    assert Hungarian().allocate(AllocationProblem(cost=cost)).pairs.tolist() == [[0, 0], [1, 1]]


@pytest.mark.parametrize("shape", [(40, 60), (60, 40), (40, 40)])
@pytest.mark.parametrize("forbidden", [0.0, 0.7])
@pytest.mark.parametrize("n_nearest", [1, 8, 60])
def test_a_pruned_matching_that_calls_itself_optimal_is(
    shape: tuple[int, int], forbidden: float, n_nearest: int
) -> None:
    rng = np.random.default_rng(0)
    cost = rng.uniform(0.0, 100.0, shape)
    cost[rng.random(shape) < forbidden] = INF
    problem = AllocationProblem(cost=cost)
    exact = Hungarian().allocate(problem)
    pruned = Hungarian(HungarianConfig(nearest_n=n_nearest, dense_work=0.0)).allocate(problem)
    assert len(pruned.pairs) <= len(exact.pairs)
    if pruned.status is Status.OPTIMAL:
        assert pruned.cost == pytest.approx(exact.cost)
    elif len(pruned.pairs) == len(exact.pairs):
        assert pruned.cost >= exact.cost - 1e-9
    assert (pruned.status is Status.OPTIMAL) or n_nearest < 60 or forbidden


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (30, 30), (40, 60), (90, 400)])
@pytest.mark.parametrize("n_different", [3, 50, 100_000])
def test_a_whole_matrix_is_matched_at_the_least_cost(shape: tuple[int, int], n_different: int) -> None:
    cost = np.random.default_rng(n_different).integers(-n_different, n_different, shape).astype(float)
    column_of = match_all(cost)
    assert len(set(column_of.tolist())) == len(cost)
    rows, columns = linear_sum_assignment(cost)
    assert cost[np.arange(len(cost)), column_of].sum() == cost[rows, columns].sum()


def test_small_and_large_matrices_are_matched_at_the_same_cost() -> None:
    cost = np.random.default_rng(3).uniform(0.0, 100.0, (120, 90))
    cost[np.random.default_rng(4).random(cost.shape) < 0.97] = INF
    found = Hungarian().allocate(AllocationProblem(cost=cost))
    rows, columns = linear_sum_assignment(np.where(np.isfinite(cost), cost, 1e5))
    taken = cost[rows, columns]
    assert len(found.pairs) == np.isfinite(taken).sum()
    assert found.cost == pytest.approx(taken[np.isfinite(taken)].sum())


@pytest.mark.parametrize("allocator", [Auction(), Cbba()])
def test_bids_count_the_way_from_the_task_before(allocator: Auction | Cbba) -> None:
    """Two tasks lie together, one lies apart: the vehicle that gets one of the two gets both."""
    place_m = np.array([0.0, 100.0, 10.0, 11.0, 95.0])
    shop = Shop(
        travel_s=np.abs(place_m[:, None] - place_m[None]),
        start=np.array([0, 1]),
        ready_s=np.zeros(2),
        first_errand=np.arange(4),
        place=np.array([2, 3, 4]),
        station=np.full(3, -1),
        service_s=np.ones(3),
    )
    problem = AllocationProblem(cost=shop.travel_s[:2, 2:], shop=shop)
    assert allocator.allocate(problem).sequence == ((0, 1), (2,))


@pytest.mark.parametrize("allocator", [Auction(), Cbba()])
@pytest.mark.parametrize("held", [0, 1])
def test_two_tasks_of_one_place_are_not_exchanged_for_nothing(allocator: Auction | Cbba, held: int) -> None:
    """Both begin and end at the same places; the only vehicle that is near does the one that it holds first."""
    place_m = np.array([0.0, 500.0, 10.0, 30.0])
    shop = Shop(
        travel_s=np.abs(place_m[:, None] - place_m[None]),
        start=np.array([0, 1]),
        ready_s=np.zeros(2),
        first_errand=np.array([0, 2, 4]),
        place=np.array([2, 3, 2, 3]),
        station=np.full(4, -1),
        service_s=np.ones(4),
    )
    cost = shop.travel_s[:2, [2, 2]]
    problem = AllocationProblem(cost=cost, shop=shop, held=np.array([held, -1], dtype=np.int32), keep_gain=5.0)
    assert allocator.allocate(problem).sequence == ((held, 1 - held), ())


@pytest.mark.parametrize("seed", range(5))
def test_talking_ends_where_one_auctioneer_would(seed: int) -> None:
    """With one task each, the agreement is the greedy choice, as its authors prove."""
    problem = AllocationProblem(cost=np.random.default_rng(seed).uniform(0.0, 9.0, (5, 8)))
    assert Cbba().allocate(problem).pairs.tolist() == Greedy().allocate(problem).pairs.tolist()


def test_costs_from_tables_are_the_distances() -> None:
    rng = np.random.default_rng(0)
    distances = rng.integers(0, 50, (7, 30)).astype(np.uint16)
    distances[2, 3] = UNREACHABLE
    state, few, many = np.array([3, 9, 20, 3]), np.arange(7), rng.integers(0, 7, 100)
    for row in (few, many):
        expected = distances[np.ix_(row, state)].T.astype(np.float64)
        expected[expected == UNREACHABLE] = INF
        np.testing.assert_array_equal(travel_cost(distances, row, state), expected)
        candidates = nearest(distances, row, state, 3)
        for vehicle, costs in enumerate(expected):
            of_vehicle = candidates.vehicle == vehicle
            assert sorted(candidates.cost[of_vehicle]) == sorted(costs)[:3]
            assert (costs[candidates.task[of_vehicle]] == candidates.cost[of_vehicle]).all()
