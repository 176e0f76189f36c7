"""Options are the moves of a graph, and beyond turns on the spot the cells that they lead to."""

from __future__ import annotations

import numpy as np

from maps.grid import EAST, GridMap
from maps.lane_graph import grid_lane_graph
from planners.mapf.options import Options, options_of
from tests.unit.planners.mapf.lanes import king_grid, one_way_grid


def nothing_blocked(n: int) -> np.ndarray:
    return np.zeros(n, dtype=np.bool_)


def listed(options: Options, state: int) -> np.ndarray:
    """Rows (state aimed at, its cell, state after the first timestep, turns) of the options of a state."""
    rows = np.concatenate((options.aim[state], options.start[state]), axis=1)
    return rows[rows[:, 0] >= 0]


def test_without_turns_options_are_the_moves() -> None:
    graph = one_way_grid(6, 8)
    options = options_of(graph, nothing_blocked(graph.n_cells))
    for state in range(graph.n_states):
        moves = graph.out_move[graph.out_ptr[state] : graph.out_ptr[state + 1]]
        assert listed(options, state)[:, 0].tolist() == graph.move_to[moves].tolist()
        assert listed(options, state)[:, 2].tolist() == graph.move_to[moves].tolist()
    assert not options.has_turns
    assert not options.has_sweeps


def test_a_cell_behind_a_turn_is_an_option() -> None:
    """In the middle of nine cells, heading east: ahead at once, aside after one turn, back after two."""
    graph = grid_lane_graph(GridMap(np.ones((3, 3), dtype=np.bool_)), "rotating")
    options = options_of(graph, nothing_blocked(9))
    state = graph.state_at(4, EAST)
    turns = {cell: delay for _, cell, _, delay in listed(options, state).tolist()}
    assert turns == {5: 0, 1: 1, 7: 1, 3: 2, 4: 0}
    assert options.widest == 6, "four cells and two turns"
    for _, cell, first, delay in listed(options, state).tolist():
        assert (graph.state_cell[first] == cell) == (delay == 0)


def test_blocked_cells_are_no_options() -> None:
    graph = grid_lane_graph(GridMap(np.ones((3, 3), dtype=np.bool_)), "rotating")
    blocked = nothing_blocked(9)
    blocked[[3, 5]] = True
    options = options_of(graph, blocked)
    state = graph.state_at(4, EAST)
    assert set(listed(options, state)[:, 1].tolist()) == {1, 4, 7}


def test_moves_that_sweep_beside_are_named() -> None:
    graph = king_grid(3, 3)
    options = options_of(graph, nothing_blocked(9))
    wide = options.sweep >= 0
    assert options.has_sweeps
    assert np.count_nonzero(wide) == 16, "two diagonals in each of four squares, both ways"
    assert (graph.move_to[options.sweep[wide]] == options.aim[wide, 0]).all()
