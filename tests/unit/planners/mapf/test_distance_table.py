"""Distances are exact and leave blocked cells out."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest

from planners.errors import PlanningError
from planners.mapf.distance_table import UNREACHABLE, DistanceTable
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


def test_the_goal_that_was_not_asked_for_longest_makes_room() -> None:
    table = DistanceTable(one_way_loop(9), nothing_blocked(9), capacity=2)
    table.to(0)
    first = table.to(0).copy()
    table.to(1)
    distances, row = table.rows(np.array([1, 2], dtype=np.int32))
    assert len(distances) == 2
    assert distances[row[0], 1] == 0
    assert distances[row[1], 2] == 0
    assert table.to(0).tolist() == first.tolist()


def test_an_instance_with_more_goals_than_the_capacity_gets_them_all() -> None:
    table = DistanceTable(one_way_loop(9), nothing_blocked(9), capacity=2)
    goals = np.arange(9, dtype=np.int32)
    distances, row = table.rows(goals)
    assert (distances[row, goals] == 0).all()


def test_the_table_is_read_only() -> None:
    with pytest.raises(ValueError, match="read-only"):
        DistanceTable(one_way_loop(5), nothing_blocked(5)).to(2)[0] = 7


@pytest.mark.parametrize("goal", [-1, 5])
def test_a_goal_that_does_not_exist_is_refused(goal: int) -> None:
    with pytest.raises(PlanningError, match=r"valid: states 0\.\.4"):
        DistanceTable(one_way_loop(5), nothing_blocked(5)).to(goal)
