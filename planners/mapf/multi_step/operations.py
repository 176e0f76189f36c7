"""Operations: for every state of a lane graph, all useful ways to spend the next few timesteps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from maps.lane_graph import LaneGraph
from planners.errors import PlanningError
from planners.mapf.arrays import BoolArray, IntArray, SmallIntArray
from planners.mapf.lanes import Lanes, lanes_of

LONGEST = 6
"""Most timesteps of an operation; beyond it their number grows out of hand."""


class Operations(NamedTuple):
    """All operations of one length on a lane graph, state by state; O operations in total.

    An operation is a row of states, one per timestep. After its last change of cell the robot may still turn: which
    way, is left open, so operations that differ in nothing else are one. Before a move a robot turns first and waits
    then. The first operation of a state is to stay.
    """

    ptr: IntArray
    """Operations of state s: ptr[s] .. ptr[s + 1] - 1, shape (S + 1,)."""
    cell: IntArray
    """Cell at the end of each timestep, shape (O, length)."""
    ending: IntArray
    """State in which the last cell is entered, and timesteps left after that, in one piece of memory, shape (O, 2)."""
    first: IntArray
    """State after the first timestep, -1 where that is left open, shape (O,)."""
    then: IntArray
    """The operation that is left after the first timestep, with a wait at its end; -1 where left open, shape (O,)."""
    turn_ptr: IntArray
    """States that state s can turn into without leaving its cell: turn_ptr[s] .. turn_ptr[s + 1] - 1, itself first."""
    turn_state: IntArray
    turn_steps: SmallIntArray
    """Timesteps that the turn takes."""
    turn_first: IntArray
    """State after the turn's first timestep."""
    beside_ptr: IntArray
    """Cells that operation o sweeps besides those it stands in: beside_ptr[o] .. beside_ptr[o + 1] - 1."""
    beside_cell: IntArray
    beside_time: IntArray
    """Timestep at whose beginning the sweep begins."""


class Turns(NamedTuple):
    """Turns on the spot, state by state; see `Operations`."""

    ptr: IntArray
    state: IntArray
    steps: SmallIntArray
    first: IntArray


def operations_of(graph: LaneGraph, length: int, is_open: BoolArray) -> Operations:
    """List the operations of every state.

    Args:
        graph: Lane graph.
        length: Timesteps of an operation, 1 to 6.
        is_open: Which moves may be used, shape (n_moves,).

    Raises:
        PlanningError: The length is out of range.

    Source: Yukhnevich, Andreychuk, "Enhancing PIBT via Multi-Action Operations", 2025, https://arxiv.org/abs/2511.09193.
    """
    if not 1 <= length <= LONGEST:
        raise PlanningError(f"operations: length = {length}; valid: 1 to {LONGEST}")
    lanes = lanes_of(graph, is_open)
    turns = Turns(*_turns(lanes, length))
    ptr = _count(lanes, turns, length)
    cell, entry, rest, first, then, trunk, last = _list(lanes, turns, ptr, length)
    beside_ptr, beside_cell, beside_time = _beside(graph, trunk, last, length - rest)
    return Operations(
        ptr=ptr,
        cell=cell,
        ending=np.column_stack((entry, rest)).astype(np.int32),
        first=first,
        then=then,
        turn_ptr=turns.ptr,
        turn_state=turns.state,
        turn_steps=turns.steps,
        turn_first=turns.first,
        beside_ptr=beside_ptr,
        beside_cell=beside_cell,
        beside_time=beside_time,
    )


@njit(cache=True)
def _turns(
    lanes: Lanes, length: int
) -> tuple[IntArray, IntArray, SmallIntArray, IntArray]:  # pragma: no cover - compiled
    """Breadth-first search from every state over the moves that stay in its cell."""
    n_states = len(lanes.out_ptr) - 1
    ptr = np.zeros(n_states + 1, dtype=np.int32)
    reached = np.empty(64, dtype=np.int32)
    steps = np.empty(64, dtype=np.int8)
    first = np.empty(64, dtype=np.int32)
    for fill in range(2):
        if fill == 0:
            state_out, steps_out, first_out = np.empty(0, np.int32), np.empty(0, np.int8), np.empty(0, np.int32)
        else:
            state_out = np.empty(ptr[n_states], dtype=np.int32)
            steps_out = np.empty(ptr[n_states], dtype=np.int8)
            first_out = np.empty(ptr[n_states], dtype=np.int32)
        for state in range(n_states):
            reached[0], steps[0], first[0] = state, 0, state
            count, head = 1, 0
            while head < count:
                at = reached[head]
                if steps[head] < length:
                    for k in range(lanes.out_ptr[at], lanes.out_ptr[at + 1]):
                        to = lanes.move_to[lanes.out_move[k]]
                        if (
                            not lanes.is_open[lanes.out_move[k]]
                            or lanes.state_cell[to] != lanes.state_cell[state]
                            or count == 64
                        ):
                            continue
                        known = False
                        for other in range(count):
                            known |= reached[other] == to
                        if not known:
                            reached[count], steps[count] = to, steps[head] + 1
                            first[count] = to if head == 0 else first[head]
                            count += 1
                head += 1
            if fill == 0:
                ptr[state + 1] = ptr[state] + count
            else:
                for k in range(count):
                    state_out[ptr[state] + k] = reached[k]
                    steps_out[ptr[state] + k] = steps[k]
                    first_out[ptr[state] + k] = first[k]
    return ptr, state_out, steps_out, first_out


@njit(cache=True)
def _count(lanes: Lanes, turns: Turns, length: int) -> IntArray:  # pragma: no cover - compiled
    """Number of operations per state as running sum: ways[left][s] = operations of `left` timesteps from s."""
    n_states = len(lanes.out_ptr) - 1
    ways = np.ones((length + 1, n_states), dtype=np.int64)
    for left in range(1, length + 1):
        for state in range(n_states):
            total = 1
            for turn in range(turns.ptr[state], turns.ptr[state + 1]):
                turned = turns.state[turn]
                for k in range(lanes.out_ptr[turned], lanes.out_ptr[turned + 1]):
                    move = lanes.out_move[k]
                    if lanes.is_open[move] and lanes.state_cell[lanes.move_to[move]] != lanes.state_cell[state]:
                        for after in range(left - turns.steps[turn]):
                            total += ways[after, lanes.move_to[move]]
            ways[left, state] = total
    ptr = np.zeros(n_states + 1, dtype=np.int32)
    for state in range(n_states):
        ptr[state + 1] = ptr[state] + ways[length, state]
    return ptr


@njit(cache=True)
def _list(
    lanes: Lanes, turns: Turns, ptr: IntArray, length: int
) -> tuple[IntArray, IntArray, SmallIntArray, IntArray, IntArray, IntArray, IntArray]:  # pragma: no cover - compiled
    """Fill the arrays of `Operations`; a state's list is its own queue, each entry followed by its continuations.

    The last two arrays tell which operation each one continues, and by which move; -1 for staying.
    """
    n_states = len(lanes.out_ptr) - 1
    n_ops = ptr[n_states]
    cell = np.empty((n_ops, length), dtype=np.int32)
    entry = np.empty(n_ops, dtype=np.int32)
    rest = np.empty(n_ops, dtype=np.int8)
    first = np.empty(n_ops, dtype=np.int32)
    then = np.full(n_ops, -1, dtype=np.int32)
    trunk = np.full(n_ops, -1, dtype=np.int32)
    last = np.full(n_ops, -1, dtype=np.int32)
    for state in range(n_states):
        op = ptr[state]
        cell[op, :] = lanes.state_cell[state]
        entry[op], rest[op], first[op] = state, length, -1
        count = op + 1
        while op < count:
            at, begun = entry[op], length - rest[op]
            for turn in range(turns.ptr[at], turns.ptr[at + 1]):
                turned, steps = turns.state[turn], turns.steps[turn]
                for k in range(lanes.out_ptr[turned], lanes.out_ptr[turned + 1]):
                    move = lanes.out_move[k]
                    to = lanes.move_to[move]
                    if not lanes.is_open[move] or lanes.state_cell[to] == lanes.state_cell[at]:
                        continue
                    for arrive in range(begun + steps + 1, length + 1):
                        for t in range(length):
                            if t < begun:
                                cell[count, t] = cell[op, t]
                            elif t < arrive - 1:
                                cell[count, t] = lanes.state_cell[at]
                            else:
                                cell[count, t] = lanes.state_cell[to]
                        entry[count], rest[count] = to, length - arrive
                        trunk[count], last[count] = op, move
                        if begun > 0:
                            first[count] = first[op]
                        elif arrive == 1:
                            first[count] = to
                        else:
                            first[count] = turns.first[turn]
                        count += 1
            op += 1
    for state in range(n_states):
        for op in range(ptr[state] + 1, ptr[state + 1]):
            for other in range(ptr[first[op]], ptr[first[op] + 1]):
                same = entry[other] == entry[op] and cell[other, length - 1] == cell[op, length - 1]
                for t in range(length - 1):
                    same &= cell[other, t] == cell[op, t + 1]
                if same:
                    then[op] = other
                    break
    return cell, entry, rest, first, then, trunk, last


def _beside(
    graph: LaneGraph, trunk: IntArray, last: IntArray, arrive: SmallIntArray
) -> tuple[IntArray, IntArray, IntArray]:
    """Cells swept on the way that are neither left nor entered; the motion models of `maps` have none."""
    beside = {}
    for move in np.flatnonzero(np.diff(graph.swept_ptr) > 2).tolist():
        ends = (graph.state_cell[graph.move_from[move]], graph.state_cell[graph.move_to[move]])
        swept = graph.swept_cell[graph.swept_ptr[move] : graph.swept_ptr[move + 1]]
        beside[move] = [int(cell) for cell in swept if cell not in ends]
    if not beside:
        return np.zeros(len(trunk) + 1, dtype=np.int32), np.empty(0, np.int32), np.empty(0, np.int32)
    found: list[list[tuple[int, int]]] = []
    for op, (before, move) in enumerate(zip(trunk.tolist(), last.tolist(), strict=True)):
        crossed = [(cell, int(arrive[op]) - 1) for cell in beside.get(move, [])]
        found.append((found[before] if before >= 0 else []) + crossed)
    ptr = np.concatenate(([0], np.cumsum([len(cells) for cells in found]))).astype(np.int32)
    flat = np.array([pair for cells in found for pair in cells], dtype=np.int32).reshape(-1, 2)
    return ptr, flat[:, 0].copy(), flat[:, 1].copy()
