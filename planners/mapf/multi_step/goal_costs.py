"""Goal costs: what is left to do from every state to every goal cell that anybody may ask for."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from maps.lane_graph import TURN, LaneGraph
from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.arrays import Distances, IntArray
from planners.mapf.distance_table import MOST_COST, UNREACHABLE, DistanceTable, DistanceTooLong
from planners.mapf.kernel import Int, kernel
from planners.mapf.multi_step import multi_step_kernel
from planners.mapf.multi_step.crew import Crew
from planners.mapf.multi_step.multi_step_kernel import Costs, Look
from planners.mapf.multi_step.multi_step_pibt import look_of_states

EXACT_BYTES = 64 * 2**20
"""Floors whose costs between all states and cells take no more are kept whole, with weighted moves and turns."""
COARSE_UNIT = 2
"""Times that costs of moves count on a large floor, where a turn ahead counts as the cheapest move: only the first turn
is seen, and a move that ends before the next one must still be worth more than waiting."""


class GoalCosts:
    """Costs to goal cells on a rotating lane graph, entered in any heading.

    A small floor is kept whole: turns are counted exactly. On a large one a table knows the costs from cell to cell
    without turns, filled as goals are asked for; the turns before the first move are counted, those after it are not.
    That takes an eighth of the memory and of the time.

    Args:
        rotating: Lane graph that the robots move on; where they have no heading, `pebble` itself.
        pebble: The same floor without headings.
        move_cost: Cost of each move of `rotating`, shape (n_moves,); None = 1 each.
        memory_cap: Memory for a large floor's table [bytes].
    """

    def __init__(
        self, rotating: LaneGraph, pebble: LaneGraph, *, move_cost: IntArray | None = None, memory_cap: int = 7 * 2**29
    ) -> None:
        self._rotating, self._pebble = rotating, pebble
        self._memory_cap = memory_cap
        self.exact = 2 * rotating.n_states * pebble.n_states <= EXACT_BYTES
        """Whether the floor is kept whole."""
        self._tables: DistanceTable | None = None
        self._table: Distances = np.empty((0, 0), dtype=np.uint16)
        self.look = look_of_states(rotating.n_states)
        """Where to look costs up."""
        self.unit = 1
        """Least cost of a move."""
        self.dearest = 1
        """Largest cost of a move."""
        self.weigh(np.ones(rotating.n_moves, dtype=np.int32) if move_cost is None else move_cost)

    @property
    def costs(self) -> Costs:
        """The table in the form kernels read; holds until the next call of `rows` or `weigh`."""
        return Costs(table=self._table, look=self.look)

    def weigh(self, move_cost: IntArray) -> None:
        """Give the moves other costs.

        Args:
            move_cost: Whole numbers >= 1, shape (n_moves,). On a large floor turns cost what they do there, and the
                drives from a cell into another cost the same from every state.

        Raises:
            PlanningError: A cost is not positive, or too large for the table of a large floor.
            DistanceTooLong: A way on a small floor costs more than its table can hold; on a large one that is found
                out when its goal is asked for.
        """
        if move_cost.min(initial=1) < 1:
            raise PlanningError(f"goal costs: move_cost holds {move_cost.min()}; valid: integers >= 1")
        drives = np.flatnonzero(self._rotating.move_kind != TURN)
        self.unit = int(move_cost[drives].min(initial=2**16))
        if not self.exact:
            cost: IntArray = move_cost[drives]
            self._tables = _coarse_table(self._rotating, self._pebble, drives, cost, self._memory_cap)
            self.look = _look_ahead(self._rotating, self._pebble, drives, cost)
            self.unit *= COARSE_UNIT
            self.dearest = COARSE_UNIT * int(cost.max(initial=1))
            return
        graph, n_goals = self._rotating, self._pebble.n_states
        self._table = np.empty((n_goals, graph.n_states), dtype=np.uint16)
        self.dearest = int(move_cost.max(initial=1))
        heads = np.empty(self.dearest + 1, dtype=np.int32)
        pool = np.empty((2, graph.n_states * 4 + graph.n_moves), dtype=np.int32)
        states = graph.state_index[self._pebble.state_cell]
        goal = _fill_all(
            states, graph.in_ptr, graph.in_move, graph.move_from, move_cost.astype(np.int32), self._table, heads, pool
        )
        if goal >= 0:
            raise DistanceTooLong(
                f"goal costs: a way to cell {self._pebble.state_cell[goal]} costs more than {UNREACHABLE - 1}; "
                f"valid: lower costs of moves, of which the dearest is {self.dearest}"
            )

    def weigh_drives(self, cost: IntArray) -> None:
        """Give the drives other costs, whatever the heading; turns cost as much as the cheapest drive.

        Args:
            cost: Cost of each move of the pebble graph, whole numbers >= 1, shape (n_moves of it,).

        Raises:
            PlanningError: As in `weigh`.
        """
        rotating, pebble = self._rotating, self._pebble
        move_cost = np.full(rotating.n_moves, cost.min(initial=MOST_COST), dtype=np.int32)
        drives = np.flatnonzero(rotating.move_kind != TURN)
        move_cost[drives] = cost[_same(_ends(rotating, drives), _ends(pebble, np.arange(pebble.n_moves)))]
        self.weigh(move_cost)

    def rows(self, cells: IntArray) -> IntArray:
        """Row of each goal cell in the table, shape (n,); -1 for a negative cell."""
        goals = np.where(cells >= 0, self._pebble.state_index[cells, 0], np.int32(-1))
        if self._tables is None:
            return goals
        self._table, rows = self._tables.rows(goals)
        return rows

    def expect(self, cells: IntArray, deadline: Deadline) -> int:
        """Fill the table with goals that may be asked for, as far as time and memory go.

        Args:
            cells: Goal cells, the likeliest first, shape (n,).
            deadline: Budget; an iteration is a batch of goals.

        Returns:
            How many of them are there.
        """
        if self._tables is None:
            return len(cells)
        ready = 0
        room = self._tables.capacity
        while ready < min(len(cells), room) and deadline.spend():
            batch = cells[ready : min(ready + 256, room)]
            self._tables.rows(self._pebble.state_index[batch, 0])
            ready += len(batch)
        return ready

    def between(self, rows: IntArray, cells: IntArray) -> IntArray:
        """Cost from each cell, in the best heading there, to the goal of each row, both of shape (n,)."""
        if self._tables is not None:
            direct: IntArray = self._table[rows, self._pebble.state_index[cells, 0]].astype(np.int32)
            return COARSE_UNIT * direct
        states = self._rotating.state_index[cells]
        in_heading = np.where(states >= 0, self._table[rows[:, None], states], np.uint16(UNREACHABLE))
        least: IntArray = in_heading.min(axis=1).astype(np.int32)
        return least


def _coarse_table(
    rotating: LaneGraph, pebble: LaneGraph, drives: npt.NDArray[np.int64], cost: IntArray, memory_cap: int
) -> DistanceTable:
    """A table of the floor without headings, with the costs of these drives."""
    nobody = np.zeros(pebble.n_cells, dtype=np.bool_)
    if cost.max(initial=1) == 1:
        return DistanceTable(pebble, nobody, memory_cap=memory_cap)
    place = _same(_ends(pebble, np.arange(pebble.n_moves)), _ends(rotating, drives))
    return DistanceTable(pebble, nobody, memory_cap=memory_cap, move_costs=cost[place])


def _ends(graph: LaneGraph, moves: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """A number for the two cells that each of these moves leads from and to, the same in both graphs."""
    origin, target = graph.state_cell[graph.move_from[moves]], graph.state_cell[graph.move_to[moves]]
    ends: npt.NDArray[np.int64] = origin.astype(np.int64) * graph.n_cells + target
    return ends


def _same(wanted: npt.NDArray[np.int64], ends: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Where in `ends` each of the numbers stands that are wanted; all of them do."""
    order = np.argsort(ends)
    place: npt.NDArray[np.int64] = order[np.searchsorted(ends[order], wanted)]
    return place


def _look_ahead(rotating: LaneGraph, pebble: LaneGraph, drives: npt.NDArray[np.int64], cost: IntArray) -> Look:
    """Every state looks into the cells around it: the turns towards each, the drive, and what is left from there."""
    origin, target = rotating.move_from[drives], rotating.move_to[drives]
    turn = int(cost.min(initial=2**16))
    cell, heading = rotating.state_cell[origin], rotating.state_heading[origin].astype(np.int64)
    found = []
    for turned in range(4):
        state = rotating.state_index[cell, (heading + turned) % 4]
        ahead = COARSE_UNIT * cost + turn * min(turned, 4 - turned)
        found.append(np.column_stack((state, pebble.state_index[rotating.state_cell[target], 0], ahead)))
    rows = np.concatenate(found)
    rows = rows[rows[:, 0] >= 0]  # who has no heading has one state in a cell
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    ptr = np.concatenate(([0], np.cumsum(np.bincount(rows[:, 0], minlength=rotating.n_states))))
    return Look(
        ptr=ptr.astype(np.int32), key=rows[:, 1].astype(np.int32), ahead=rows[:, 2].astype(np.int32), scale=COARSE_UNIT
    )


@kernel
def _fill_all(
    goal_states: IntArray,
    in_ptr: IntArray,
    in_move: IntArray,
    move_from: IntArray,
    move_cost: IntArray,
    table: Distances,
    heads: IntArray,
    pool: IntArray,
) -> int:  # pragma: no cover - compiled
    """Shortest paths against the moves from each goal, shape (n_goals, 4) states of which -1 are none.

    Returns a goal to which a way costs more than the table can hold, -1 if there is none.

    Dijkstra with a ring of buckets, one per cost up to the largest of a move (Dial, "Algorithm 360", Communications of
    the ACM 12(11), 1969). A bucket is a list threaded through `pool`: states, and where the list goes on.
    """
    n_buckets = len(heads)
    for goal in range(len(goal_states)):
        for state in range(table.shape[1]):
            table[goal, state] = UNREACHABLE
        for bucket in range(n_buckets):
            heads[bucket] = -1
        used, spare = 0, -1
        for k in range(goal_states.shape[1]):
            if goal_states[goal, k] >= 0:
                table[goal, goal_states[goal, k]] = 0
                pool[0, used], pool[1, used] = goal_states[goal, k], heads[0]
                heads[0] = used
                used += 1
        level, empty, beyond = 0, 0, False
        while empty < n_buckets:
            bucket = level % n_buckets
            empty += 1
            while heads[bucket] >= 0:
                empty = 0
                item = heads[bucket]
                heads[bucket] = pool[1, item]
                state = pool[0, item]
                pool[1, item] = spare
                spare = item
                if table[goal, state] != level:
                    continue
                for k in range(in_ptr[state], in_ptr[state + 1]):
                    cost = level + move_cost[in_move[k]]
                    before = move_from[in_move[k]]
                    if cost < table[goal, before]:
                        table[goal, before] = cost
                        item = spare
                        if spare >= 0:
                            spare = pool[1, spare]
                        else:
                            item = used
                            used += 1
                        pool[0, item], pool[1, item] = before, heads[cost % n_buckets]
                        heads[cost % n_buckets] = item
                    elif table[goal, before] == UNREACHABLE:
                        beyond = True
            level += 1
        if beyond:  # unless what the table cannot hold was reached by a cheaper way later
            for state in range(table.shape[1]):
                for k in range(in_ptr[state], in_ptr[state + 1]):
                    if table[goal, state] != UNREACHABLE and table[goal, move_from[in_move[k]]] == UNREACHABLE:
                        return goal
    return -1


@kernel
def _left_of(
    costs: Costs, states: IntArray, rows: IntArray, out: IntArray, begin: Int, end: Int
) -> None:  # pragma: no cover - compiled
    """What is left from states `begin` to `end` - 1 to their rows' goals."""
    for k in range(begin, end):
        out[k] = min(multi_step_kernel.left(costs, states[k], rows[k]), UNREACHABLE) if rows[k] >= 0 else 0


def left(costs: Costs, states: IntArray, rows: IntArray, crew: Crew | None = None) -> IntArray:
    """What is left from each state to its row's goal, shape (n,); 0 for a negative row; a crew of n shares the work."""
    out = np.empty(len(states), dtype=np.int32)
    if crew is None:
        _left_of(costs, states, rows, out, 0, len(states))
    else:
        crew.each(lambda begin, end: _left_of(costs, states, rows, out, begin, end))
    return out
