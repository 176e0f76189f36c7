"""Goal costs: the exact ones are Dijkstra's, the coarse ones never say more, and say the same where nobody turns."""

from __future__ import annotations

import heapq
from typing import Literal

import numpy as np
import numpy.typing as npt
import pytest

from maps.grid import EAST, NORTH, GridMap
from maps.lane_graph import TURN, LaneGraph, grid_lane_graph
from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.arrays import IntArray
from planners.mapf.distance_table import UNREACHABLE, DistanceTooLong
from planners.mapf.multi_step import goal_costs
from planners.mapf.multi_step.goal_costs import COARSE_UNIT, GoalCosts, left

FLOOR = GridMap(np.random.default_rng(4).random((5, 6)) > 0.25)


def both_graphs(grid: GridMap) -> tuple[LaneGraph, LaneGraph]:
    return grid_lane_graph(grid, "rotating"), grid_lane_graph(grid, "pebble")


def by_hand(graph: LaneGraph, goal_cell: int, move_cost: npt.NDArray[np.int32]) -> list[int]:
    """Cost from each state to a cell, with a heap over the list of moves."""
    cost = [UNREACHABLE] * graph.n_states
    queue = [(0, state) for state in range(graph.n_states) if graph.state_cell[state] == goal_cell]
    for _, state in queue:
        cost[state] = 0
    while queue:
        so_far, state = heapq.heappop(queue)
        for move in np.flatnonzero(graph.move_to == state).tolist():
            before, total = int(graph.move_from[move]), so_far + int(move_cost[move])
            if total < cost[before]:
                cost[before] = total
                heapq.heappush(queue, (total, before))
    return cost


def costs_to(costs: GoalCosts, graph: LaneGraph, cell: int) -> list[int]:
    """Cost from each state to a cell, as kernels read it."""
    rows = costs.rows(np.full(graph.n_states, cell, dtype=np.int32))
    found: list[int] = left(costs.costs, np.arange(graph.n_states, dtype=np.int32), rows).tolist()
    return found


def free_cells(grid: GridMap) -> IntArray:
    return np.flatnonzero(grid.free).astype(np.int32)


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every floor is too large."""
    monkeypatch.setattr(goal_costs, "EXACT_BYTES", 0)


@pytest.mark.parametrize("largest", [1, 9])
def test_exact_costs_are_those_of_dijkstra(largest: int) -> None:
    rotating, pebble = both_graphs(FLOOR)
    move_cost = np.random.default_rng(largest).integers(1, largest + 1, size=rotating.n_moves).astype(np.int32)
    costs = GoalCosts(rotating, pebble, move_cost=move_cost)
    assert costs.exact
    for cell in free_cells(FLOOR).tolist():
        assert costs_to(costs, rotating, cell) == by_hand(rotating, cell, move_cost)


def test_moves_can_be_weighed_anew() -> None:
    rotating, pebble = both_graphs(FLOOR)
    costs = GoalCosts(rotating, pebble)
    move_cost = np.random.default_rng(1).integers(1, 30, size=rotating.n_moves).astype(np.int32)
    costs.weigh(move_cost)
    cell = int(free_cells(FLOOR)[7])
    assert costs_to(costs, rotating, cell) == by_hand(rotating, cell, move_cost)


def test_a_cell_without_a_way_is_far_and_no_cell_is_near() -> None:
    rotating, pebble = both_graphs(GridMap(np.array([[True, False, True]])))
    costs = GoalCosts(rotating, pebble)
    rows = costs.rows(np.array([2, -1], dtype=np.int32))
    states = rotating.state_index[[0, 0], EAST]
    assert rows[1] == -1
    assert left(costs.costs, states, rows).tolist() == [UNREACHABLE, 0]


def test_a_way_that_costs_more_than_a_table_holds_is_told() -> None:
    """It was no way at all: robots stood for ever."""
    rotating, pebble = both_graphs(GridMap(np.ones((1, 4), dtype=np.bool_)))
    costs = GoalCosts(rotating, pebble, move_cost=np.full(rotating.n_moves, 13_000, dtype=np.int32))
    furthest = costs_to(costs, rotating, 0)[rotating.state_index[3, EAST]]
    assert furthest == 5 * 13_000  # two turns and three moves
    with pytest.raises(DistanceTooLong, match=r"way to cell 0 costs more than 65534; .* dearest is 14000"):
        costs.weigh(np.full(rotating.n_moves, 14_000, dtype=np.int32))
    dear_way_round = np.full(rotating.n_moves, 13_000, dtype=np.int32)
    dear_way_round[np.flatnonzero(rotating.move_kind == TURN)[0]] = 70_000
    costs.weigh(dear_way_round)
    assert max(costs_to(costs, rotating, 0)) < UNREACHABLE


@pytest.mark.parametrize("motion", ["rotating", "pebble"])
def test_the_cost_between_cells_is_that_of_the_best_heading(motion: Literal["rotating", "pebble"]) -> None:
    graph, pebble = grid_lane_graph(FLOOR, motion), grid_lane_graph(FLOOR, "pebble")
    costs = GoalCosts(graph, pebble)
    cells = free_cells(FLOOR)
    for cell in cells.tolist():
        to_cell = by_hand(graph, cell, np.ones(graph.n_moves, dtype=np.int32))
        rows = costs.rows(np.full(len(cells), cell, dtype=np.int32))
        assert costs.between(rows, cells).tolist() == [
            min(to_cell[state] for state in graph.state_index[other] if state >= 0) for other in cells
        ]


@pytest.mark.usefixtures("coarse")
def test_coarse_costs_of_robots_without_headings_are_exact() -> None:
    pebble = grid_lane_graph(FLOOR, "pebble")
    costs = GoalCosts(pebble, pebble)
    for cell in free_cells(FLOOR).tolist():
        away = pebble.state_cell != cell  # costs of a large floor begin with a drive
        exact = np.array(by_hand(pebble, cell, np.full(pebble.n_moves, COARSE_UNIT, dtype=np.int32)))
        assert (np.array(costs_to(costs, pebble, cell))[away] == np.minimum(exact, UNREACHABLE)[away]).all()


def coarse_costs(rotating: LaneGraph) -> IntArray:
    """Moves cost a coarse unit, turns half of it."""
    return np.where(rotating.move_kind == TURN, 1, COARSE_UNIT).astype(np.int32)


@pytest.mark.usefixtures("coarse")
def test_coarse_costs_never_exceed_the_exact_ones() -> None:
    rotating, pebble = both_graphs(FLOOR)
    costs = GoalCosts(rotating, pebble)
    assert not costs.exact
    one = coarse_costs(rotating)
    less = 0
    for cell in free_cells(FLOOR).tolist():
        exact = np.array(by_hand(rotating, cell, one))
        found = np.array(costs_to(costs, rotating, cell))
        at_goal = rotating.state_cell == cell
        assert (found <= exact)[~at_goal].all()
        assert ((found >= UNREACHABLE) == (exact >= UNREACHABLE))[~at_goal].all()
        less += int((found < exact)[~at_goal].sum())
    assert less > 0  # turns on the way are not counted


@pytest.mark.usefixtures("coarse")
def test_coarse_costs_are_exact_where_nobody_turns_after_the_first_move() -> None:
    """In a corridor every way is straight once a robot has turned into it."""
    rotating, pebble = both_graphs(GridMap(np.ones((1, 7), dtype=np.bool_)))
    costs = GoalCosts(rotating, pebble)
    one = coarse_costs(rotating)
    for cell in range(7):
        away = rotating.state_cell != cell
        assert (np.array(costs_to(costs, rotating, cell)) == by_hand(rotating, cell, one))[away].all()
    assert costs_to(costs, rotating, 6)[rotating.state_at(2, NORTH)] == 1 + 4 * COARSE_UNIT


@pytest.mark.usefixtures("coarse")
def test_expected_goals_are_there_before_they_are_asked_for() -> None:
    rotating, pebble = both_graphs(FLOOR)
    cells = free_cells(FLOOR)
    costs = GoalCosts(rotating, pebble)
    assert costs.expect(cells, Deadline(0)) == 0
    assert costs.expect(cells, Deadline(10)) == len(cells)
    rows = costs.rows(cells)
    assert (costs.between(rows, cells) == 0).all()


def weighted_drives(rotating: LaneGraph, seed: int) -> IntArray:
    """Costs of 2 to 9 for driving from a cell into another, the same from every heading; a turn costs 2."""
    between = np.random.default_rng(seed).integers(2, 10, size=(rotating.n_cells, rotating.n_cells))
    cost = between[rotating.state_cell[rotating.move_from], rotating.state_cell[rotating.move_to]]
    return np.where(rotating.move_kind == TURN, 2, cost).astype(np.int32)


@pytest.mark.usefixtures("coarse")
def test_weights_on_a_large_floor_are_those_of_the_drives_and_the_turns_before_the_first() -> None:
    rotating, pebble = both_graphs(FLOOR)
    move_cost = weighted_drives(rotating, 3)
    costs = GoalCosts(rotating, pebble, move_cost=move_cost)
    drives = np.flatnonzero(rotating.move_kind != TURN)
    assert (costs.unit, costs.dearest) == (2 * COARSE_UNIT, 9 * COARSE_UNIT)
    for cell in free_cells(FLOOR).tolist():
        # A robot may turn for nothing once it has left its cell: turns that cost nothing say what is left from there.
        no_turns = np.where(rotating.move_kind == TURN, 0, move_cost * COARSE_UNIT).astype(np.int32)
        left_then = by_hand(rotating, cell, no_turns)
        expected = [UNREACHABLE] * rotating.n_states
        for move in drives.tolist():
            begin, end = int(rotating.move_from[move]), int(rotating.move_to[move])
            for turned in range(4):
                heading = (int(rotating.state_heading[begin]) + turned) % 4
                state = int(rotating.state_at(int(rotating.state_cell[begin]), heading))
                ahead = 2 * min(turned, 4 - turned) + COARSE_UNIT * int(move_cost[move])
                expected[state] = min(expected[state], ahead + left_then[end])
        found = costs_to(costs, rotating, cell)
        away = np.flatnonzero(rotating.state_cell != cell).tolist()
        assert [min(found[state], UNREACHABLE) for state in away] == [expected[state] for state in away]


@pytest.mark.usefixtures("coarse")
def test_a_large_floor_can_be_weighed_anew_and_back() -> None:
    rotating, pebble = both_graphs(FLOOR)
    costs = GoalCosts(rotating, pebble)
    cell = int(free_cells(FLOOR)[7])
    before = costs_to(costs, rotating, cell)
    costs.weigh(weighted_drives(rotating, 5))
    assert costs_to(costs, rotating, cell) != before
    costs.weigh(np.ones(rotating.n_moves, dtype=np.int32))
    assert costs_to(costs, rotating, cell) == before


@pytest.mark.usefixtures("coarse")
def test_weights_too_large_for_the_table_are_refused() -> None:
    rotating, pebble = both_graphs(FLOOR)
    with pytest.raises(PlanningError, match="valid: whole numbers from 1 to 1000"):
        GoalCosts(rotating, pebble, move_cost=np.full(rotating.n_moves, 1001, dtype=np.int32))


def test_a_move_that_costs_nothing_is_refused() -> None:
    rotating, pebble = both_graphs(FLOOR)
    move_cost = np.ones(rotating.n_moves, dtype=np.int32)
    move_cost[3] = 0
    with pytest.raises(PlanningError, match="goal costs: move_cost holds 0; valid: integers >= 1"):
        GoalCosts(rotating, pebble, move_cost=move_cost)
