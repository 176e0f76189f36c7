"""Distances are exact and leave blocked cells out."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest

from maps.lane_graph import LaneGraph
from planners.errors import PlanningError
from planners.mapf.distance_table import (
    MOST_COST,
    UNREACHABLE,
    DistanceTable,
    DistanceTableFull,
    DistanceTooLong,
)
from tests.unit.planners.mapf.lanes import graph_of, one_way_grid, one_way_loop, open_grid


def nothing_blocked(n: int) -> np.ndarray:
    return np.zeros(n, dtype=np.bool_)


def test_distances_follow_the_lanes() -> None:
    assert DistanceTable(one_way_loop(5), nothing_blocked(5)).to(2).tolist() == [2, 1, 0, 4, 3]


def test_distances_equal_networkx() -> None:
    graph = one_way_grid(6, 8)
    table = DistanceTable(graph, nothing_blocked(graph.n_cells))
    lanes = nx.DiGraph(zip(graph.move_to.tolist(), graph.move_from.tolist(), strict=True))
    for goal in (0, 17, graph.n_states - 1):
        expected = nx.single_source_shortest_path_length(lanes, goal)
        assert table.to(goal).tolist() == [expected[state] for state in range(graph.n_states)]


def test_a_blocked_cell_is_left_but_never_entered() -> None:
    blocked = nothing_blocked(4)
    blocked[1] = True
    assert DistanceTable(open_grid(1, 4), blocked).to(3).tolist() == [UNREACHABLE, 2, 1, 0]


def test_a_move_that_sweeps_a_blocked_cell_is_closed() -> None:
    graph = graph_of([0, 1, 2], [(0, 2)], sweeps={(0, 2): (1,)})
    blocked = nothing_blocked(3)
    blocked[1] = True
    assert DistanceTable(graph, blocked).to(2).tolist() == [UNREACHABLE, UNREACHABLE, 0]


def test_a_goal_is_searched_once() -> None:
    table = DistanceTable(one_way_loop(5), nothing_blocked(5))
    assert np.shares_memory(table.to(2), table.to(2))


def test_rows_point_at_the_goals_of_an_instance() -> None:
    table = DistanceTable(one_way_loop(50), nothing_blocked(50))
    goals = np.array([7, -1, 3, 7, *range(20)], dtype=np.int32)
    distances, row = table.rows(goals)
    assert row[1] == -1
    assert row[0] == row[3]
    assert all(distances[row[k], goals[k]] == 0 for k in range(len(goals)) if goals[k] >= 0)


def test_the_next_state_is_the_first_of_those_from_which_least_is_left() -> None:
    graph, rng = one_way_grid(6, 8), np.random.default_rng(0)
    blocked = nothing_blocked(graph.n_cells)
    blocked[9] = True
    table = DistanceTable(graph, blocked)
    states, goals = rng.integers(graph.n_states, size=(2, 400)).astype(np.int32)
    goals[:5] = -1
    after = table.next_states(states, goals)
    for state, goal, found in zip(states.tolist(), goals.tolist(), after.tolist(), strict=True):
        if goal < 0 or table.to(goal)[state] == UNREACHABLE:
            assert found == -1
        else:
            assert found == min(table.after(state).tolist(), key=lambda other: table.to(goal)[other])
    assert {-1} < set(after.tolist())


def test_the_goal_that_was_not_asked_for_longest_makes_room() -> None:
    table = DistanceTable(one_way_loop(9), nothing_blocked(9), memory_cap=2 * 9 * 2)
    table.to(0)
    first = table.to(0).copy()
    table.to(1)
    distances, row = table.rows(np.array([1, 2], dtype=np.int32))
    assert len(distances) == 2
    assert distances[row[0], 1] == 0
    assert distances[row[1], 2] == 0
    assert table.to(0).tolist() == first.tolist()


def test_what_was_asked_for_last_stays() -> None:
    table = DistanceTable(one_way_loop(9), nothing_blocked(9), memory_cap=3 * 9 * 2)
    for goal in (0, 1, 2, 0, 3):
        table.to(goal)
    before = table.n_goals
    table.to(0)
    assert (before, table.n_goals) == (3, 3), "goal 0 was asked for after 1 and had not to make room"


def test_one_call_for_more_goals_than_the_cap_holds_is_refused_with_the_numbers() -> None:
    table = DistanceTable(one_way_loop(9), nothing_blocked(9), memory_cap=2 * 9 * 2)
    with pytest.raises(
        DistanceTableFull, match=r"9 distinct goals need 162 bytes .* 2 goals in a memory_cap of 36 bytes"
    ):
        table.rows(np.arange(9, dtype=np.int32))
    distances, row = table.rows(np.array([4, 5], dtype=np.int32))
    assert distances[row, [4, 5]].tolist() == [0, 0], "the table is as good as before"


def test_more_goals_than_are_kept_are_held_only_as_long_as_they_are_asked_for() -> None:
    table = DistanceTable(one_way_loop(9), nothing_blocked(9), memory_kept=3 * 9 * 2)
    goals = np.arange(6, dtype=np.int32)
    distances, row = table.rows(goals)
    assert distances[row, goals].tolist() == [0] * 6
    assert (table.n_goals, table.capacity, table.keeps_all) == (6, 9, False)
    distances, row = table.rows(np.array([6, 7], dtype=np.int32))
    assert distances[row, [6, 7]].tolist() == [0, 0]
    assert table.n_goals == 3, "the goals asked for longest ago made room"


def test_a_cap_that_holds_no_goal_is_refused() -> None:
    with pytest.raises(PlanningError, match="memory_cap = 17; valid: at least 18"):
        DistanceTable(one_way_loop(9), nothing_blocked(9), memory_cap=17)


def test_many_goals_at_once_equal_one_at_a_time() -> None:
    """Enough of them for threads."""
    graph = one_way_grid(40, 60)
    goals = np.arange(graph.n_states, dtype=np.int32)
    distances, row = DistanceTable(graph, nothing_blocked(graph.n_cells)).rows(goals)
    single = DistanceTable(graph, nothing_blocked(graph.n_cells))
    assert sorted(row.tolist()) == goals.tolist()
    for goal in range(0, graph.n_states, 97):
        assert (distances[row[goal]] == single.to(goal)).all()


def test_a_way_that_is_too_long_is_refused() -> None:
    n = UNREACHABLE + 1
    table = DistanceTable(one_way_loop(n), nothing_blocked(n), memory_cap=2 * n)
    with pytest.raises(DistanceTooLong, match="takes 65535 timesteps; valid: at most 65534"):
        table.to(0)


def test_the_longest_way_that_fits_is_exact() -> None:
    n = UNREACHABLE
    assert DistanceTable(one_way_loop(n), nothing_blocked(n), memory_cap=2 * n).to(0).max() == UNREACHABLE - 1


def test_the_table_is_read_only() -> None:
    with pytest.raises(ValueError, match="read-only"):
        DistanceTable(one_way_loop(5), nothing_blocked(5)).to(2)[0] = 7


@pytest.mark.parametrize("goal", [-1, 5])
def test_a_goal_that_does_not_exist_is_refused(goal: int) -> None:
    with pytest.raises(PlanningError, match=r"valid: states 0\.\.4"):
        DistanceTable(one_way_loop(5), nothing_blocked(5)).to(goal)


def priced(graph: LaneGraph, dear: dict[int, int]) -> DistanceTable:
    return DistanceTable(graph, nothing_blocked(graph.n_cells), costs=costs_of(graph, dear))


def costs_of(graph: LaneGraph, dear: dict[int, int]) -> np.ndarray:
    costs = np.ones(graph.n_cells, dtype=np.int64)
    costs[list(dear)] = list(dear.values())
    return costs


def least_costs(graph: LaneGraph, costs: np.ndarray, goal: int) -> list[int]:
    """What ways cost, found by a library; a move costs what its first cell does."""
    lanes = nx.DiGraph()
    lanes.add_nodes_from(range(graph.n_states))
    for before, after in zip(graph.move_from.tolist(), graph.move_to.tolist(), strict=True):
        lanes.add_edge(after, before, weight=int(costs[graph.state_cell[before]]))
    found = nx.single_source_dijkstra_path_length(lanes, goal)
    return [found.get(state, UNREACHABLE) for state in range(graph.n_states)]


def test_ways_lead_round_dear_cells() -> None:
    """Straight on from 0 to 2 leads through 1; the other row is longer."""
    row = priced(open_grid(2, 3), {1: 30}).to(2)
    assert [int(row[state]) for state in (2, 5, 4, 3, 0)] == [0, 1, 2, 3, 4]
    assert row[1] == 30, "who stands there leaves it, nobody enters it"


def test_a_way_may_end_in_a_dear_cell() -> None:
    assert priced(open_grid(1, 3), {2: 30}).to(2).tolist() == [2, 1, 0]


def test_where_there_is_no_other_way_it_leads_through() -> None:
    assert priced(one_way_loop(5), {1: 30}).to(2).tolist() == [31, 30, 0, 33, 32]


@pytest.mark.parametrize("seed", range(5))
def test_costs_equal_networkx(seed: int) -> None:
    graph = one_way_grid(6, 8)
    rng = np.random.default_rng(seed)
    costs = rng.integers(1, 40, graph.n_cells)
    table = DistanceTable(graph, nothing_blocked(graph.n_cells), costs=costs)
    for goal in rng.integers(graph.n_states, size=4).tolist():
        assert table.to(goal).tolist() == least_costs(graph, costs, goal)


def test_new_prices_are_those_of_the_goals_that_were_named_and_of_new_ones() -> None:
    graph = one_way_grid(6, 8)
    table = priced(graph, {9: 30})
    before = table.to(3).copy()
    table.to(17)
    costs = np.random.default_rng(0).integers(1, MOST_COST, graph.n_cells)
    table.reprice(costs, np.array([17, 30], dtype=np.int32))
    assert table.n_goals == 2, "no way was asked for to goal 30"
    assert table.to(17).tolist() == least_costs(graph, costs, 17)
    assert table.to(20).tolist() == least_costs(graph, costs, 20)
    assert table.to(3).tolist() == before.tolist()


@pytest.mark.parametrize("cost", [0, MOST_COST + 1])
def test_a_cost_out_of_range_is_refused(cost: int) -> None:
    with pytest.raises(PlanningError, match=rf"costs\[3\] = {cost}; valid: whole numbers from 1 to 1000"):
        priced(one_way_loop(5), {3: cost})


def test_costs_of_other_cells_are_refused() -> None:
    with pytest.raises(PlanningError, match=r"costs has shape \(4,\); valid: \(5,\)"):
        DistanceTable(one_way_loop(5), nothing_blocked(5), costs=np.ones(4, dtype=np.int64))


def test_a_table_without_costs_has_none_to_change() -> None:
    with pytest.raises(PlanningError, match="valid: one that was made with costs"):
        DistanceTable(one_way_loop(5), nothing_blocked(5)).reprice(np.ones(5, dtype=np.int64), np.array([0]))


def test_a_way_that_costs_too_much_is_refused() -> None:
    n = 80
    table = DistanceTable(one_way_loop(n), nothing_blocked(n), costs=np.full(n, MOST_COST))
    with pytest.raises(DistanceTooLong, match="valid: at most 65534"):
        table.to(0)


@pytest.mark.parametrize("seed", range(5))
def test_costs_of_moves_equal_networkx(seed: int) -> None:
    graph = one_way_grid(6, 8)
    rng = np.random.default_rng(seed)
    cost = rng.integers(1, (2, 9, 40, 300, MOST_COST)[seed], graph.n_moves)
    lanes = nx.DiGraph()
    lanes.add_nodes_from(range(graph.n_states))
    lanes.add_weighted_edges_from(zip(graph.move_to.tolist(), graph.move_from.tolist(), cost.tolist(), strict=True))
    table = DistanceTable(graph, nothing_blocked(graph.n_cells), move_costs=cost)
    for goal in rng.integers(graph.n_states, size=4).tolist():
        found = nx.single_source_dijkstra_path_length(lanes, goal)
        assert table.to(goal).tolist() == [found.get(state, UNREACHABLE) for state in range(graph.n_states)]


def test_the_same_floor_costs_one_thing_one_way_and_another_the_other() -> None:
    graph = open_grid(1, 3)
    east = graph.move_to > graph.move_from
    table = DistanceTable(graph, nothing_blocked(3), move_costs=np.where(east, 1, 24))
    assert table.to(2).tolist() == [2, 1, 0]
    assert table.to(0).tolist() == [0, 24, 48]


def test_costs_of_one_kind_are_given() -> None:
    graph = open_grid(1, 3)
    with pytest.raises(PlanningError, match="costs and move_costs are both given; valid: one of them"):
        DistanceTable(
            graph,
            nothing_blocked(3),
            costs=np.ones(3, dtype=np.int64),
            move_costs=np.ones(graph.n_moves, dtype=np.int64),
        )


def test_costs_of_other_moves_are_refused() -> None:
    graph = open_grid(1, 3)
    with pytest.raises(PlanningError, match=r"move_costs has shape \(3,\); valid: \(4,\)"):
        DistanceTable(graph, nothing_blocked(3), move_costs=np.ones(3, dtype=np.int64))


@pytest.mark.parametrize("cost", [-1, 0, MOST_COST + 1])
def test_a_cost_of_a_move_out_of_range_is_refused(cost: int) -> None:
    graph = open_grid(1, 3)
    with pytest.raises(PlanningError, match=rf"move_costs\[2\] = {cost}; valid: whole numbers from 1 to 1000"):
        DistanceTable(graph, nothing_blocked(3), move_costs=np.where(np.arange(4) == 2, cost, 1))


def test_ways_that_cost_too_much_are_refused() -> None:
    n = 80
    with pytest.raises(DistanceTooLong, match="valid: at most 65534"):
        DistanceTable(one_way_loop(n), nothing_blocked(n), move_costs=np.full(n, MOST_COST)).to(0)


def test_surcharges_are_paid_beyond_costs_whatever_these_become() -> None:
    graph = open_grid(1, 4)
    east = graph.move_to > graph.move_from
    costs = np.ones(4, dtype=np.int64)
    table = DistanceTable(graph, nothing_blocked(4), costs=costs, surcharges=np.where(east, 0, 5))
    assert table.to(3).tolist() == [3, 2, 1, 0]
    assert table.to(0).tolist() == [0, 6, 12, 18]
    table.reprice(2 * costs, np.array([0], dtype=np.int32))
    assert table.to(0).tolist() == [0, 7, 14, 21]


def test_surcharges_need_costs() -> None:
    graph = open_grid(1, 3)
    with pytest.raises(PlanningError, match="surcharges are given without costs"):
        DistanceTable(graph, nothing_blocked(3), surcharges=np.ones(graph.n_moves, dtype=np.int64))
