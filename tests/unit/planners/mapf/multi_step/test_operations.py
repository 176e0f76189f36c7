"""Operations: all that are useful, each of them legal, and what is left of them is one of them too."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from maps.grid import EAST, NORTH, SOUTH, GridMap
from maps.lane_graph import LaneGraph, grid_lane_graph
from planners.errors import PlanningError
from planners.mapf.multi_step.operations import LONGEST, Operations, operations_of
from tests.unit.planners.mapf.lanes import graph_of, king_grid, one_way_grid, one_way_loop, open_grid, rotating_grid


def unit_operations(graph: LaneGraph, length: int, closed: npt.NDArray[np.intp] | None = None) -> Operations:
    """All operations but those with `closed` moves."""
    is_open = np.ones(graph.n_moves, dtype=np.bool_)
    if closed is not None:
        is_open[closed] = False
    return operations_of(graph, length, is_open)


def rows_of(ops: Operations, state: int) -> list[list[int]]:
    """Cells of the operations of a state."""
    rows: list[list[int]] = ops.cell[ops.ptr[state] : ops.ptr[state + 1]].tolist()
    return rows


def next_states(graph: LaneGraph, state: int) -> set[int]:
    """States after one timestep."""
    moves = graph.out_move[graph.out_ptr[state] : graph.out_ptr[state + 1]]
    return {state, *graph.move_to[moves].tolist()}


def drives(graph: LaneGraph, state: int, cells: list[int]) -> set[int]:
    """States in which a robot can be that has passed through these cells, one per timestep; empty = nobody can."""
    states = {state}
    for cell in cells:
        states = {to for at in states for to in next_states(graph, at) if graph.state_cell[to] == cell}
    return states


GRAPHS = {
    "pebble": open_grid(3, 4),
    "rotating": rotating_grid(3, 3),
    "one_way": one_way_grid(4, 4),
    "loop": one_way_loop(5),
    "wide": king_grid(3, 3),
}
cases = pytest.mark.parametrize(("name", "length"), [(name, length) for name in GRAPHS for length in (1, 2, 3)])


@pytest.mark.parametrize(("length", "count"), [(1, 2), (2, 6), (3, 17), (4, 48), (5, 136)])
def test_their_number_on_an_open_floor(length: int, count: int) -> None:
    """With w(0) = 1 it is w(n) = 1 + w(0) + ... + w(n-1), twice w(0) + ... + w(n-2) and once w(0) + ... + w(n-3).

    These are the ways on that begin without a turn, with one to either side, or with two.
    """
    graph = rotating_grid(11, 11)
    ops = unit_operations(graph, length)
    middle = graph.state_index[60]
    assert np.diff(ops.ptr)[middle].tolist() == [count] * 4
    assert len(set(map(tuple, rows_of(ops, int(middle[EAST]))))) == count


@cases
def test_every_operation_can_be_driven_and_ends_where_it_says(name: str, length: int) -> None:
    graph = GRAPHS[name]
    ops = unit_operations(graph, length)
    for state in range(graph.n_states):
        for op in range(ops.ptr[state], ops.ptr[state + 1]):
            cells, arrive = ops.cell[op].tolist(), length - int(ops.ending[op, 1])
            assert int(ops.ending[op, 0]) in drives(graph, state, cells[:arrive])
            assert cells[arrive:] == [int(graph.state_cell[ops.ending[op, 0]])] * int(ops.ending[op, 1])
            assert int(ops.first[op]) in {-1, *drives(graph, state, cells[:1])}


@cases
def test_every_way_through_the_cells_is_among_them(name: str, length: int) -> None:
    """Whatever a robot can do in so many timesteps, the cells it passes are those of an operation."""
    graph = GRAPHS[name]
    ops = unit_operations(graph, length)
    for state in range(graph.n_states):
        ways: list[tuple[int, tuple[int, ...]]] = [(state, ())]
        for _ in range(length):
            ways = [(to, (*cells, int(graph.state_cell[to]))) for at, cells in ways for to in next_states(graph, at)]
        assert {tuple(row) for row in rows_of(ops, state)} == {cells for _, cells in ways}


@cases
def test_no_operation_is_listed_twice_and_the_first_is_to_stay(name: str, length: int) -> None:
    graph = GRAPHS[name]
    ops = unit_operations(graph, length)
    for state in range(graph.n_states):
        span = slice(ops.ptr[state], ops.ptr[state + 1])
        listed = list(zip(map(tuple, rows_of(ops, state)), ops.ending[span, 0].tolist(), strict=True))
        assert len(set(listed)) == len(listed)
        assert listed[0] == ((int(graph.state_cell[state]),) * length, state)
        assert (ops.first[ops.ptr[state]], ops.then[ops.ptr[state]]) == (-1, -1)


@cases
def test_what_is_left_after_a_timestep_is_an_operation_too(name: str, length: int) -> None:
    graph = GRAPHS[name]
    ops = unit_operations(graph, length)
    of_state = np.repeat(np.arange(graph.n_states), np.diff(ops.ptr))
    for op in np.flatnonzero(ops.first >= 0).tolist():
        tail = int(ops.then[op])
        assert of_state[tail] == ops.first[op]
        assert ops.ending[tail, 0] == ops.ending[op, 0]
        assert ops.cell[tail].tolist() == [*ops.cell[op, 1:].tolist(), int(ops.cell[op, -1])]


def test_a_robot_before_a_wall_turns_first() -> None:
    """A corner of three cells: one way on needs two turns, the others one turn or none."""
    graph = grid_lane_graph(GridMap(np.array([[True, True], [True, False]])), "rotating")
    end, corner = int(graph.state_at(1, EAST)), int(graph.state_at(0, EAST))
    ops = unit_operations(graph, 3)
    assert rows_of(ops, end) == [[1, 1, 1], [1, 1, 0]]
    assert ops.first[ops.ptr[end] + 1] in graph.state_index[1, [NORTH, SOUTH]]
    assert sorted(rows_of(ops, corner)) == [[0, 0, 0], [0, 0, 1], [0, 0, 2], [0, 1, 1], [0, 2, 2], [1, 1, 1]]


def test_closed_moves_are_not_used() -> None:
    graph = open_grid(1, 3)
    into_last = np.flatnonzero(graph.move_to == 2)
    assert sorted(rows_of(unit_operations(graph, 2, into_last), 1)) == [[0, 0], [0, 1], [1, 0], [1, 1]]
    nothing = unit_operations(graph, 2, np.arange(graph.n_moves))
    assert nothing.cell.tolist() == [[0, 0], [1, 1], [2, 2]]


def test_cells_swept_on_the_way_are_told_with_their_time() -> None:
    graph = graph_of(range(5), [(0, 1), (1, 2)], sweeps={(0, 1): (3,), (1, 2): (4,)})
    ops = unit_operations(graph, 3)
    beside = {}
    for op in range(ops.ptr[0], ops.ptr[1]):
        span = slice(ops.beside_ptr[op], ops.beside_ptr[op + 1])
        beside[tuple(ops.cell[op].tolist())] = list(
            zip(ops.beside_cell[span].tolist(), ops.beside_time[span].tolist(), strict=True)
        )
    assert beside == {
        (0, 0, 0): [],
        (1, 1, 1): [(3, 0)],
        (0, 1, 1): [(3, 1)],
        (0, 0, 1): [(3, 2)],
        (1, 2, 2): [(3, 0), (4, 1)],
        (1, 1, 2): [(3, 0), (4, 2)],
        (0, 1, 2): [(3, 1), (4, 2)],
    }


@pytest.mark.parametrize("length", [-1, 0, LONGEST + 1])
def test_a_length_out_of_range_is_refused(length: int) -> None:
    with pytest.raises(PlanningError, match=f"operations: length = {length}; valid: 1 to {LONGEST}"):
        unit_operations(open_grid(1, 2), length)
