"""Distance table: timesteps from every state to a goal, one breadth-first search per distinct goal."""

from __future__ import annotations

from collections import OrderedDict

import numpy as np
import numpy.typing as npt
from numba import njit

from maps.lane_graph import LaneGraph
from planners.errors import PlanningError
from planners.mapf.problem import BoolArray, IntArray

UNREACHABLE = 2**30
"""Distance of a state that has no way to the goal; a few of them still add up inside an int32."""


def open_moves(graph: LaneGraph, blocked: BoolArray) -> BoolArray:
    """Which moves enter no blocked cell, shape (n_moves,); leaving a blocked cell is open."""
    counts = np.diff(graph.swept_ptr)
    of_move = np.repeat(np.arange(len(counts)), counts)
    entered = graph.swept_cell != graph.state_cell[graph.move_from][of_move]
    is_open = np.ones(len(counts), dtype=np.bool_)
    is_open[of_move[entered & blocked[graph.swept_cell]]] = False
    return is_open


class DistanceTable:
    """Exact distances to the goals that were asked for, kept until others are needed more.

    Args:
        graph: Lane graph.
        blocked: Cells nobody may enter, shape (n_cells,).
        capacity: Goals to keep; beyond it the one that was not asked for longest makes room. One goal costs
            4 bytes per state.

    Raises:
        PlanningError: `blocked` has the wrong length or `capacity` is not positive.
    """

    def __init__(self, graph: LaneGraph, blocked: BoolArray, *, capacity: int = 4096) -> None:
        if np.shape(blocked) != (graph.n_cells,):
            raise PlanningError(f"distance table: blocked has shape {np.shape(blocked)}; valid: ({graph.n_cells},)")
        if capacity < 1:
            raise PlanningError(f"distance table: capacity = {capacity}; valid: an integer >= 1")
        self.graph = graph
        self._open = open_moves(graph, blocked)
        self._capacity = capacity
        self._row_of: OrderedDict[int, int] = OrderedDict()
        self._rows = np.empty((min(capacity, 8), graph.n_states), dtype=np.int32)

    def to(self, goal: int) -> IntArray:
        """Timesteps from each state to a goal state, shape (n_states,), read-only; `UNREACHABLE` = no way.

        A view that holds until `capacity` other goals have been asked for.

        Raises:
            PlanningError: The goal is not a state of the graph.
        """
        index = self._row(int(goal), frozenset())
        row: IntArray = self._rows[index]
        row.flags.writeable = False
        return row

    def rows(self, goals: IntArray) -> tuple[IntArray, IntArray]:
        """All distances that an instance needs, without copying them.

        Args:
            goals: Goal states, shape (n,); negative = none.

        Returns:
            The table, shape (n_rows, n_states), and the row of each goal, shape (n,), -1 for none. Both hold
            until the next call.
        """
        wanted = {int(goal) for goal in goals if goal >= 0}
        row_of = {goal: self._row(goal, wanted) for goal in sorted(wanted)}
        index = np.array([row_of.get(int(goal), -1) for goal in goals], dtype=np.int32)
        return self._rows, index

    def _row(self, goal: int, keep: frozenset[int] | set[int]) -> int:
        row = self._row_of.get(goal)
        if row is None:
            if not 0 <= goal < self.graph.n_states:
                raise PlanningError(f"distance table: goal {goal}; valid: states 0..{self.graph.n_states - 1}")
            row = self._free_row(keep)
            graph = self.graph
            _fill(goal, graph.in_ptr, graph.in_move, graph.move_from, self._open, self._rows[row])
            self._row_of[goal] = row
        self._row_of.move_to_end(goal)
        return row

    def _free_row(self, keep: frozenset[int] | set[int]) -> int:
        used = len(self._row_of)
        if used >= self._capacity:
            for goal in self._row_of:
                if goal not in keep:
                    return self._row_of.pop(goal)
        if used == len(self._rows):
            grown = np.empty((2 * used, self.graph.n_states), dtype=np.int32)
            grown[:used] = self._rows
            self._rows = grown
        return used


@njit(cache=True)
def _fill(
    goal: int,
    in_ptr: npt.NDArray[np.int32],
    in_move: npt.NDArray[np.int32],
    move_from: npt.NDArray[np.int32],
    is_open: npt.NDArray[np.bool_],
    distance: npt.NDArray[np.int32],
) -> None:
    """Breadth-first search against the moves, from the goal."""
    distance[:] = UNREACHABLE
    distance[goal] = 0
    queue = np.empty(len(distance), dtype=np.int32)
    queue[0] = goal
    head, tail = 0, 1
    while head < tail:
        state = queue[head]
        head += 1
        for k in range(in_ptr[state], in_ptr[state + 1]):
            move = in_move[k]
            before = move_from[move]
            if is_open[move] and distance[before] == UNREACHABLE:
                distance[before] = distance[state] + 1
                queue[tail] = before
                tail += 1
