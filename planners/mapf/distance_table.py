"""Distance table: timesteps from every state to a goal, one breadth-first search per distinct goal."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from maps.lane_graph import LaneGraph
from planners.errors import PlanningError
from planners.mapf.arrays import BoolArray, Distances, IntArray
from planners.mapf.options import open_moves
from planners.mapf.problem import Instance

UNREACHABLE = 65_535
"""Distance of a state that has no way to the goal; every real distance is smaller."""
MEMORY_CAP_BYTES = 2 * 2**30
"""What a table may hold unless it is told otherwise."""
MOST_COST = 1_000
"""The most that a move may cost."""
_EVICTED_AT_ONCE = 16
"""A full table gives up one part in so many of its rows, so that not every new goal looks for the oldest row."""
_WORTH_THREADS = 500_000
"""States to search from which on threads pay."""


class DistanceTableFull(PlanningError):
    """One call asks for more goals than the memory cap has room for."""


class DistanceTooLong(PlanningError):
    """A goal is further from a state than a row can hold."""


class DistanceTable:
    """Exact distances to the goals that were asked for, kept until others need their memory more.

    A distance takes two bytes. Rows are searched when their goal is first asked for, many at once on all cores, and
    the ones not asked for longest go when the cap is reached.

    Args:
        graph: Lane graph.
        blocked: Cells nobody may enter, shape (n_cells,).
        memory_cap: Memory for distances [bytes]; a goal costs two per state.
        memory_kept: Memory beyond which goals that are not asked for any more make room [bytes], so that more is taken
            only for goals that are needed at once; None = `memory_cap`.
        costs: What it costs to leave each cell, in timesteps of a usual one, shape (n_cells,), 1 to `MOST_COST`; None =
            1 each. A way costs the sum over its cells but the last, so that what is dear is gone round, and whoever
            stands there leaves it.
        move_costs: What each move costs, shape (n_moves,), 1 to `MOST_COST`; in place of `costs`.
        surcharges: What each move costs beyond `costs`, whatever these become, shape (n_moves,), >= 0, with them at
            most `MOST_COST`; None = nothing.

    Raises:
        PlanningError: `blocked`, `costs`, `move_costs` or `surcharges` has the wrong length, a cost is out of range,
            both kinds of costs are given, surcharges without `costs`, or `memory_cap` does not hold one goal.
    """

    def __init__(
        self,
        graph: LaneGraph,
        blocked: BoolArray,
        *,
        memory_cap: int = MEMORY_CAP_BYTES,
        memory_kept: int | None = None,
        costs: npt.NDArray[np.int64] | None = None,
        move_costs: npt.NDArray[np.integer[Any]] | None = None,
        surcharges: npt.NDArray[np.integer[Any]] | None = None,
    ) -> None:
        if np.shape(blocked) != (graph.n_cells,):
            raise PlanningError(f"distance table: blocked has shape {np.shape(blocked)}; valid: ({graph.n_cells},)")
        row_bytes = 2 * max(graph.n_states, 1)
        if memory_cap < row_bytes:
            raise PlanningError(
                f"distance table: memory_cap = {memory_cap}; valid: at least {row_bytes} bytes, one goal of this graph"
            )
        self.graph = graph
        if costs is not None and move_costs is not None:
            raise PlanningError("distance table: costs and move_costs are both given; valid: one of them")
        if surcharges is not None and costs is None:
            raise PlanningError("distance table: surcharges are given without costs; valid: both, or no surcharges")
        self._surcharges = surcharges
        self._before, self._move_before = _states_before(graph, open_moves(graph, blocked))
        self._price: npt.NDArray[np.uint16] | None = None
        """What the moves cost that lead from `_before`, of the same shape; None = 1 each."""
        if costs is not None:
            self._price = self._price_of(self._of_moves(costs))
        elif move_costs is not None:
            self._price = self._price_of(_checked("move_costs", move_costs, graph.n_moves))
        # The system hands out memory when it is first written to, so rows that are never filled cost nothing.
        self._rows: Distances = np.empty((min(graph.n_states, memory_cap // row_bytes), graph.n_states), np.uint16)
        kept = memory_cap if memory_kept is None else memory_kept
        self._n_kept = min(len(self._rows), kept // row_bytes)
        self._free = np.arange(len(self._rows) - 1, -1, -1, dtype=np.int32)  # a stack, its top at the end
        self._row_of = np.full(graph.n_states, -1, dtype=np.int32)
        self._goal_of = np.full(len(self._rows), -1, dtype=np.int32)
        self._asked = np.zeros(len(self._rows), dtype=np.int64)  # number of the call that last asked for the row
        self._call = 0
        self._queues = [self._queue()]  # one for each thread of the largest search so far

    @property
    def capacity(self) -> int:
        """Goals whose distances can be held at once."""
        return len(self._rows)

    @property
    def n_goals(self) -> int:
        """Goals whose distances are held."""
        return len(self._rows) - len(self._free)

    @property
    def keeps_all(self) -> bool:
        """Whether no goal ever has to make room for another."""
        return self._n_kept == self.graph.n_states

    def after(self, state: int) -> IntArray:
        """States that a move leads to from a state, open or not."""
        graph = self.graph
        states: IntArray = graph.move_to[graph.out_move[graph.out_ptr[state] : graph.out_ptr[state + 1]]]
        return states

    def to(self, goal: int) -> Distances:
        """Timesteps from each state to a goal state, shape (n_states,), read-only; `UNREACHABLE` = no way.

        A view that holds until its goal has to make room for others.

        Raises:
            PlanningError: The goal is not a state of the graph.
            DistanceTooLong: A way to the goal takes more than 65,534 timesteps.
        """
        if goal < 0:
            raise PlanningError(f"distance table: goal {goal}; valid: states 0..{self.graph.n_states - 1}")
        index = int(self._row_of[goal]) if goal < self.graph.n_states else -1
        if index < 0:
            index = int(self.rows(np.array([goal], dtype=np.int32))[1][0])
        else:
            self._call += 1
            self._asked[index] = self._call
        row: Distances = self._rows[index]
        row.flags.writeable = False
        return row

    def rows(self, goals: IntArray) -> tuple[Distances, IntArray]:
        """All distances that an instance needs, without copying them.

        Args:
            goals: Goal states, shape (n,); negative = none.

        Returns:
            The table, shape (n_rows, n_states), and the row of each goal, shape (n,), -1 for none. Rows stay where
            they are until their goal has to make room.

        Raises:
            PlanningError: A goal is not a state of the graph.
            DistanceTableFull: The distinct goals of this call alone need more memory than the cap.
            DistanceTooLong: A way to a goal takes more than 65,534 timesteps.
        """
        index: IntArray = np.empty(len(goals), dtype=np.int32)
        greatest, n_missing = _look_up(goals, self._row_of, index)
        if greatest >= self.graph.n_states:
            raise PlanningError(f"distance table: goal {greatest}; valid: states 0..{self.graph.n_states - 1}")
        self._call += 1
        _note(index, self._asked, self._call)
        if n_missing:
            self._search(np.unique(goals[(goals >= 0) & (index < 0)]))
            _look_up(goals, self._row_of, index)
        return self._rows, index

    def next_states(self, states: IntArray, goals: IntArray) -> IntArray:
        """The state that comes next on the shortest way from each state to the goal beside it, shape (n,).

        Of several it is the one whose move comes first; from a goal the way leads round to it. -1 = no way.

        Raises:
            PlanningError: As from `rows`.
        """
        rows, row = self.rows(goals)
        after: IntArray = np.empty(len(states), dtype=np.int32)
        graph = self.graph
        _next_states(states, row, rows, (graph.out_ptr, graph.out_move, graph.move_to), after)
        return after

    def next_state(self, state: int, goal: int) -> int:
        """The same for one state and one goal."""
        states, left = self.after(state), self.to(goal)
        return int(states[left[states].argmin()]) if states.size and left[state] < UNREACHABLE else -1

    def reprice(self, costs: npt.NDArray[np.int64], goals: IntArray) -> None:
        """Let cells cost something else from now on.

        Args:
            costs: As in the constructor, which must have been given costs of one kind or the other.
            goals: Goals whose ways are searched again if they are held, shape (n,); those of others stay as they are.

        Raises:
            PlanningError: The table has no costs, `costs` has the wrong length, or one is out of range.
            DistanceTooLong: A way to a goal costs more than 65,534.
        """
        if self._price is None:
            raise PlanningError("distance table: reprice of a table without costs; valid: one that was made with costs")
        self._price = self._price_of(self._of_moves(costs))
        self._queues = [self._queue()]
        rows = self._row_of[goals]
        held = rows >= 0
        _check_length(
            _fill_by_cost(goals[held], rows[held], self._before, self._rows, self._price, self._queues[0]), goals
        )

    def _search(self, goals: IntArray) -> None:
        """Fill a row for each of these goals, which are distinct and have none yet."""
        if self.n_goals + len(goals) > self._n_kept:
            self._make_room(len(goals))
        rows = self._free[len(self._free) - len(goals) :].copy()
        parts = 1
        if len(goals) * self.graph.n_states >= _WORTH_THREADS:
            parts = min(len(goals), os.cpu_count() or 1)
        while len(self._queues) < parts:
            self._queues.append(self._queue())

        def fill(part: int) -> int:
            of_part = slice(len(goals) * part // parts, len(goals) * (part + 1) // parts)
            asked = goals[of_part], rows[of_part], self._before, self._rows
            if self._price is None:
                return int(_fill(*asked, self._queues[part]))
            return int(_fill_by_cost(*asked, self._price, self._queues[part]))

        if parts == 1:
            furthest = fill(0)
        else:
            with ThreadPoolExecutor(parts) as pool:
                furthest = max(pool.map(fill, range(parts)))
        _check_length(furthest, goals)
        self._free = self._free[: len(self._free) - len(goals)]
        self._row_of[goals] = rows
        self._goal_of[rows] = goals
        self._asked[rows] = self._call

    def _of_moves(self, costs: npt.NDArray[np.int64]) -> npt.NDArray[np.integer[Any]]:
        """What each move costs, from what it costs to leave each cell and the surcharges."""
        of_cells = _checked("costs", costs, self.graph.n_cells)
        of_moves: npt.NDArray[np.integer[Any]] = of_cells[self.graph.state_cell[self.graph.move_from]]
        if self._surcharges is None:
            return of_moves
        return _checked("costs with surcharges", of_moves + self._surcharges, self.graph.n_moves)

    def _price_of(self, move_costs: npt.NDArray[np.integer[Any]]) -> npt.NDArray[np.uint16]:
        """What each move costs, in the order of `_before`; what fills that up costs anything."""
        return np.append(move_costs, 1).astype(np.uint16)[self._move_before]

    def _queue(self) -> npt.NDArray[np.uint32]:
        """Working memory of a search."""
        n_states = self.graph.n_states
        if self._price is None:
            return np.empty(n_states + 1, dtype=np.uint32)
        return np.empty(2 * n_states + int(self._price.max(initial=0)) + 1, dtype=np.uint32)

    def _make_room(self, n: int) -> None:
        """Give up the goals not asked for longest, so that there is room for `n`; never those of this call.

        More rows than are kept are held only where this call needs them.
        """
        old = np.flatnonzero((self._goal_of >= 0) & (self._asked < self._call))
        short = n - len(self._free)
        if short > len(old):
            row_bytes = 2 * self.graph.n_states
            needed = len(self._rows) - len(self._free) - len(old) + n
            raise DistanceTableFull(
                f"distance table: {needed} distinct goals need {needed * row_bytes} bytes at once; valid: at most "
                f"{len(self._rows)} goals in a memory_cap of {len(self._rows) * row_bytes} bytes"
            )
        many = min(len(old), max(self.n_goals + n - self._n_kept, self._n_kept // _EVICTED_AT_ONCE))
        gone = old[np.argsort(self._asked[old], kind="stable")[:many]].astype(np.int32)
        self._row_of[self._goal_of[gone]] = -1
        self._goal_of[gone] = -1
        self._free = np.concatenate((self._free, gone))


def tables_of(instance: Instance, tables: DistanceTable | None, planner: str) -> DistanceTable:
    """Take the caller's distance table, or make one.

    Raises:
        PlanningError: The table belongs to another graph; names the planner.
    """
    if tables is None:
        return DistanceTable(instance.graph, instance.blocked)
    if tables.graph is not instance.graph:
        raise PlanningError(f"{planner}: the distance table is of another graph than the instance; valid: the same one")
    return tables


def _check_length(furthest: int, goals: IntArray) -> None:
    if furthest >= UNREACHABLE:
        raise DistanceTooLong(
            f"distance table: a way to one of the goals {goals[:5].tolist()}... takes {furthest} timesteps; "
            f"valid: at most {UNREACHABLE - 1}"
        )


def _checked(name: str, costs: npt.NDArray[np.integer[Any]], n: int) -> npt.NDArray[np.integer[Any]]:
    """The costs, if they are as many as they should be and in range.

    Raises:
        PlanningError: They are not.
    """
    if np.shape(costs) != (n,):
        raise PlanningError(f"distance table: {name} has shape {np.shape(costs)}; valid: ({n},)")
    wrong = ((costs < 1) | (costs > MOST_COST)).nonzero()[0]
    if wrong.size:
        k = int(wrong[0])
        raise PlanningError(f"distance table: {name}[{k}] = {costs[k]}; valid: whole numbers from 1 to {MOST_COST}")
    return costs


def _states_before(graph: LaneGraph, is_open: BoolArray) -> tuple[npt.NDArray[np.uint32], IntArray]:
    """States from which an open move leads to each state, and the moves, shape (n_states, widest) each.

    Filled up with the state itself, and with no move, -1.
    """
    move = graph.in_move[is_open[graph.in_move]]
    to = graph.move_to[move]
    counts = np.bincount(to, minlength=graph.n_states)
    place = np.arange(len(to)) - np.repeat(np.cumsum(counts) - counts, counts)
    widest = max(counts.max(initial=0), 1)
    before = np.repeat(np.arange(graph.n_states, dtype=np.uint32)[:, None], widest, axis=1)
    moves = np.full((graph.n_states, widest), -1, dtype=np.int32)
    before[to, place] = graph.move_from[move]
    moves[to, place] = move
    return before, moves


@njit(cache=True, nogil=True)
def _look_up(goals: IntArray, row_of: IntArray, index: IntArray) -> tuple[int, int]:  # pragma: no cover - compiled
    """Fill in the row of each goal, -1 for none; returns the greatest goal and how many have no row yet."""
    greatest, n_missing = -1, 0
    for k in range(len(goals)):
        goal = goals[k]
        greatest = max(greatest, goal)
        index[k] = row_of[goal] if 0 <= goal < len(row_of) else -1
        if goal >= 0 and index[k] < 0:
            n_missing += 1
    return greatest, n_missing


@njit(cache=True, nogil=True)
def _note(index: IntArray, asked: npt.NDArray[np.int64], call: int) -> None:  # pragma: no cover - compiled
    """Note that some rows were asked for in a call."""
    for row in index:
        if row >= 0:
            asked[row] = call


@njit(cache=True, nogil=True)
def _fill(
    goals: IntArray, rows: IntArray, before: npt.NDArray[np.uint32], table: Distances, queue: npt.NDArray[np.uint32]
) -> int:  # pragma: no cover - compiled
    """Breadth-first search against the moves from each goal, level by level; returns the longest distance found.

    The innermost loop has no branch to guess wrong: each state is written behind the queue, which grows only if it was
    new. Unsigned indices spare numba the question whether they are negative.
    """
    widest = before.shape[1]
    furthest = 0
    for k in range(len(goals)):
        distance = table[rows[k]]
        distance[:] = UNREACHABLE
        distance[goals[k]] = 0
        queue[0] = goals[k]
        head, tail = np.uint64(0), np.uint64(1)
        level = np.uint16(0)
        while head < tail:
            end = tail
            if level == UNREACHABLE - 1:
                for i in range(head, end):
                    for j in range(widest):
                        if distance[before[queue[i], j]] == UNREACHABLE:
                            return UNREACHABLE
            level = np.uint16(level + np.uint16(1))
            while head < end:
                state = queue[head]
                head += np.uint64(1)
                for j in range(widest):
                    other = before[state, np.uint64(j)]
                    known = distance[other]
                    queue[tail] = other
                    tail += np.uint64(known > level)
                    distance[other] = min(known, level)
        furthest = max(furthest, int(level) - 1)
    return furthest


@njit(cache=True, nogil=True)
def _next_states(
    states: IntArray, row: IntArray, rows: Distances, moves: tuple[IntArray, IntArray, IntArray], after: IntArray
) -> None:  # pragma: no cover - compiled
    """Choose the move that leaves least to go."""
    out_ptr, out_move, move_to = moves
    for k in range(len(states)):
        state, after[k], least = states[k], -1, UNREACHABLE + 1
        if row[k] < 0 or rows[row[k], state] >= UNREACHABLE:
            continue
        for out in range(out_ptr[state], out_ptr[state + 1]):
            left = int(rows[row[k], move_to[out_move[out]]])
            if left < least:
                after[k], least = move_to[out_move[out]], left


@njit(cache=True, nogil=True)
def _fill_by_cost(
    goals: IntArray,
    rows: IntArray,
    before: npt.NDArray[np.uint32],
    table: Distances,
    price: npt.NDArray[np.uint16],
    queue: npt.NDArray[np.uint32],
) -> int:  # pragma: no cover - compiled
    """Search from each goal by ascending cost, in a ring of buckets; returns the greatest cost found.

    A state waits in the bucket of the least cost known; it is taken out of it when a cheaper way is found.

    Source: R. B. Dial, "Algorithm 360: shortest-path forest with topological ordering", Communications of the ACM
    12(11), 1969, https://doi.org/10.1145/363269.363610.
    """
    n_states = len(before)
    nobody = np.uint32(n_states)
    # Behind and before each state the next one of its bucket; the buckets, by their first state, after the states.
    following, leading, bucket = queue[:n_states], queue[n_states : 2 * n_states], queue[2 * n_states :]
    furthest = 0
    for k in range(len(goals)):
        distance = table[rows[k]]
        distance[:] = UNREACHABLE
        distance[goals[k]] = 0
        bucket[:] = nobody
        bucket[0] = goals[k]
        following[goals[k]] = nobody
        n_waiting, cost, beyond = 1, 0, False
        while n_waiting:
            at = cost % len(bucket)
            state = bucket[at]
            if state == nobody:
                cost += 1
                continue
            bucket[at] = following[state]
            n_waiting -= 1
            for j in range(before.shape[1]):
                other = before[state, j]
                known, far = int(distance[other]), cost + price[state, j]
                if far >= known:
                    beyond |= known == UNREACHABLE
                    continue
                if known == UNREACHABLE:
                    n_waiting += 1
                else:
                    behind = following[other]
                    if bucket[known % len(bucket)] == other:
                        bucket[known % len(bucket)] = behind
                    else:
                        following[leading[other]] = behind
                        if behind != nobody:
                            leading[behind] = leading[other]
                distance[other] = far
                first = bucket[far % len(bucket)]
                following[other] = first
                if first != nobody:
                    leading[first] = other
                bucket[far % len(bucket)] = other
        furthest = max(furthest, cost)
        if beyond:  # unless what a row cannot hold was reached by a cheaper way later
            for state in range(n_states):
                for j in range(before.shape[1]):
                    if distance[state] != UNREACHABLE and distance[before[state, j]] == UNREACHABLE:
                        return UNREACHABLE
    return furthest
