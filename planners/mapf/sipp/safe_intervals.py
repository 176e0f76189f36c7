"""Safe intervals: which cells are reserved when, and the earliest path of one agent through the time that is left."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from maps.lane_graph import LaneGraph
from planners.mapf.arrays import BoolArray, Int64Array, IntArray
from planners.mapf.distance_table import UNREACHABLE
from planners.mapf.kernel import kernel
from planners.mapf.lanes import Lanes, lanes_of

FOREVER = 2**30
"""End of a reservation that is never given back: later than any timestep of a path."""
FIRST_ROOM = 1024
"""Nodes of a search that memory is kept for at first."""
_NONE = -1
_FULL = -2


class Book(NamedTuple):
    """Reservations as one linked list per cell, by time; entry c is the head of cell c's list and reserves nothing."""

    begin: IntArray
    end: IntArray
    """First and last timestep; a move over a cell reserves both ends of its timestep."""
    cell: IntArray
    following: IntArray
    """Next entry of the cell, -1 = none."""
    onward: IntArray
    """Entry of the cell where the agent stands afterwards; -1 = nowhere else, or a move over the cell."""
    crossing: BoolArray
    """The agent only moves over the cell."""


class Nodes(NamedTuple):
    """Memory of a search."""

    state: IntArray
    gap: IntArray
    """Entry before the safe interval."""
    time: IntArray
    """Timestep of arrival."""
    via: IntArray
    """Move of the last timestep, -1 at the start."""
    parent: IntArray
    """-1 at the start."""
    heap: IntArray
    """Nodes that are open."""
    keys: Int64Array
    """Their keys."""


class Arrivals(NamedTuple):
    """The best arrival of a search in each state and safe interval."""

    slot: IntArray
    """Number of each state among the states of its cell, shape (S,)."""
    n_slots: int
    """Most states of a cell."""
    soonest: IntArray
    """By entry before the interval and slot: entry * n_slots + slot; `FOREVER` = none, as everywhere before and after a
    search."""


class Rules(NamedTuple):
    """What binds a path beside the reservations."""

    waiting: BoolArray
    """Cells of agents that are not planned yet, shape (n_cells,)."""
    grace: int
    """Timesteps for which these cells are left to them."""
    latest: int
    """No reservation of a move ends later."""
    allow_rotation: bool
    """Whether a closed ring of followers is legal."""


class AgentTrip(NamedTuple):
    """Whose path is looked for."""

    start: int
    goal: int
    """Negative = anywhere."""
    distance: npt.NDArray[np.integer]
    """Timesteps to the goal from every state, shape (S,); not read without a goal."""
    stay: bool
    """The goal is never left again once it is entered."""


class Reservations:
    """The paths of the agents that are planned already.

    Args:
        graph: Lane graph.
        is_open: Moves that may be used, shape (M,).
        starts: States in which agents stand at timestep 0. The cell of one that is not planned yet is left to it for as
            long as it takes to turn and leave, or those that come late would be overrun.
        allow_rotation: Whether a closed ring of followers is legal.
    """

    def __init__(self, graph: LaneGraph, is_open: BoolArray, starts: IntArray, *, allow_rotation: bool) -> None:
        order = np.argsort(graph.state_cell, kind="stable")
        cells = graph.state_cell[order]
        slot = np.empty(graph.n_states, dtype=np.int32)
        slot[order] = np.arange(graph.n_states) - np.searchsorted(cells, cells)
        self._lanes = lanes_of(graph, is_open)
        self._slot = slot
        self._n_slots = int(slot.max(initial=0)) + 1
        self._n_cells = graph.n_cells
        self._start_cells = graph.state_cell[starts]
        self._grace = _longest_turn(graph)
        self._allow_rotation = allow_rotation
        self._nodes = _empty_nodes(FIRST_ROOM)
        self._widest = int(np.diff(graph.swept_ptr).max(initial=0))
        self.clear()

    def clear(self) -> None:
        """Forget all paths."""
        n = self._n_cells
        self._waiting = np.zeros(n, dtype=np.bool_)  # cells of agents that are not planned yet
        self._waiting[self._start_cells] = True
        self._used = n
        self._latest = 0
        self._book = _empty_book(2 * n)
        self._soonest = np.full(2 * n * self._n_slots, FOREVER, dtype=np.int32)

    def add(self, states: IntArray, moves: IntArray) -> None:
        """Reserve a path: states at timesteps 0..T, shape (T + 1,), and moves, shape (T,), -1 = wait.

        The last cell stays reserved for good.
        """
        room = self._used + 1 + len(moves) * max(self._widest, 1)
        if room > len(self._book.begin):
            old, self._book = self._book, _empty_book(2 * room)
            for column, grown in zip(old, self._book, strict=True):
                grown[: len(column)] = column
            self._soonest = np.full(2 * room * self._n_slots, FOREVER, dtype=np.int32)
        self._waiting[self._lanes.state_cell[states[0]]] = False
        self._used = _reserve(self._lanes, self._book, self._used, states, moves)
        self._latest = max(self._latest, len(moves) + 1)

    def earliest_path(
        self, start: int, goal: int, distance: npt.NDArray[np.integer], *, stay: bool
    ) -> tuple[IntArray, IntArray] | None:
        """Find the path that stands at its goal for good as early as possible.

        Args:
            start: First state.
            goal: Goal state; negative = anywhere.
            distance: Timesteps to the goal from every state, shape (S,); not read without a goal.
            stay: The goal is never left again once it is entered.

        Returns:
            States at timesteps 0..T, shape (T + 1,), and moves, shape (T,), -1 = wait; None if there is no path.
        """
        self._waiting[self._lanes.state_cell[start]] = False
        trip = AgentTrip(start=start, goal=goal, distance=distance, stay=stay)
        rules = Rules(
            waiting=self._waiting, grace=self._grace, latest=self._latest, allow_rotation=self._allow_rotation
        )
        while True:
            arrivals = Arrivals(slot=self._slot, n_slots=self._n_slots, soonest=self._soonest)
            node = _search(self._lanes, self._book, arrivals, self._nodes, rules, trip)
            if node != _FULL:
                return None if node < 0 else self._trace(node)
            self._nodes = _empty_nodes(2 * len(self._nodes.state))

    def _trace(self, node: int) -> tuple[IntArray, IntArray]:
        """States and moves from the start to a node."""
        nodes = self._nodes
        moves = np.full(nodes.time[node], _NONE, dtype=np.int32)
        states = np.full(len(moves) + 1, nodes.state[node], dtype=np.int32)
        while nodes.parent[node] >= 0:
            arrival = nodes.time[node]
            moves[arrival - 1] = nodes.via[node]
            node = int(nodes.parent[node])
            states[:arrival] = nodes.state[node]
        return states, moves


def _empty_book(room: int) -> Book:
    """Heads of lists that end before timestep 0."""
    begin, end, cell, following, onward = np.full((5, room), _NONE, dtype=np.int32)
    return Book(begin, end, cell, following, onward, np.zeros(room, dtype=np.bool_))


def _empty_nodes(room: int) -> Nodes:
    state, gap, time, via, parent, heap = np.empty((6, room), dtype=np.int32)
    return Nodes(state, gap, time, via, parent, heap, np.empty(room, dtype=np.int64))


def _longest_turn(graph: LaneGraph) -> int:
    """Timesteps that it takes at most before the cell can be left; 0 where nobody turns on the spot."""
    leaves = graph.state_cell[graph.move_from] != graph.state_cell[graph.move_to]
    ready = np.zeros(graph.n_states, dtype=np.bool_)
    ready[graph.move_from[leaves]] = True
    turns = 0
    while True:
        more = ready.copy()
        more[graph.move_from[ready[graph.move_to]]] = True
        if (more == ready).all():
            return turns
        ready, turns = more, turns + 1


@kernel
def _insert(
    book: Book, used: int, cell: int, begin: int, end: int, crossing: bool
) -> None:  # pragma: no cover - compiled
    """Write entry `used` into its cell's list."""
    before = cell
    while book.following[before] >= 0 and book.begin[book.following[before]] < begin:
        before = book.following[before]
    book.begin[used] = begin
    book.end[used] = end
    book.cell[used] = cell
    book.crossing[used] = crossing
    book.onward[used] = _NONE
    book.following[used] = book.following[before]
    book.following[before] = used


@kernel
def _reserve(
    lanes: Lanes, book: Book, used: int, states: IntArray, moves: IntArray
) -> int:  # pragma: no cover - compiled
    """Enter a path; the number of entries afterwards."""
    begin, last = 0, _NONE
    for t in range(len(moves) + 1):
        here = lanes.state_cell[states[t]]
        there = lanes.state_cell[states[t + 1]] if t < len(moves) else np.int32(_NONE)
        if there != here:
            _insert(book, used, here, begin, t if there >= 0 else FOREVER, False)
            if last >= 0:
                book.onward[last] = used
            last = used
            used += 1
            begin = t + 1
        if t < len(moves) and moves[t] >= 0:
            for k in range(lanes.swept_ptr[moves[t]], lanes.swept_ptr[moves[t] + 1]):
                cell = lanes.swept_cell[k]
                if cell not in (here, there):
                    _insert(book, used, cell, t, t + 1, True)
                    used += 1
    return used


@kernel
def _standing(book: Book, cell: int, t: int) -> int:  # pragma: no cover - compiled
    """Entry of the agent that stands in a cell at a timestep, or -1."""
    entry = book.following[cell]
    while entry >= 0 and book.begin[entry] <= t:
        if book.end[entry] >= t and not book.crossing[entry]:
            return int(entry)
        entry = book.following[entry]
    return _NONE


@kernel
def _ring(book: Book, home: int, cell: int, t: int) -> int:  # pragma: no cover - compiled
    """Agents in the ring that going from `home` to `cell` after timestep t would close, 0 = none."""
    size = 1
    while True:
        entry = _standing(book, cell, t)
        if entry < 0 or book.end[entry] != t:
            return 0
        cell = book.cell[book.onward[entry]]
        size += 1
        if cell == home:
            return size


@kernel
def _may_cross(
    lanes: Lanes, book: Book, rules: Rules, move: int, home: int, to: int, t: int
) -> bool:  # pragma: no cover - compiled
    """Whether nobody uses the cells that a move sweeps on its way, in the timestep after t."""
    for k in range(lanes.swept_ptr[move], lanes.swept_ptr[move + 1]):
        cell = lanes.swept_cell[k]
        if cell in (home, to):
            continue
        if rules.waiting[cell] and t <= rules.grace:
            return False
        entry = book.following[cell]
        while entry >= 0 and book.begin[entry] <= t + 1:
            if book.crossing[entry]:
                if book.begin[entry] == t:
                    return False
            elif book.end[entry] >= t:
                return False
            entry = book.following[entry]
    return True


@kernel
def _push(keys: Int64Array, heap: IntArray, size: int, key: np.int64, node: int) -> None:  # pragma: no cover - compiled
    """Put a node on the heap of `size` nodes."""
    k = size
    while k > 0 and keys[(k - 1) // 2] > key:
        keys[k], heap[k] = keys[(k - 1) // 2], heap[(k - 1) // 2]
        k = (k - 1) // 2
    keys[k], heap[k] = key, node


@kernel
def _pop(keys: Int64Array, heap: IntArray, size: int) -> int:  # pragma: no cover - compiled
    """Take the node with the least key off the heap of `size` nodes."""
    top = int(heap[0])
    key, node = keys[size - 1], heap[size - 1]
    k = 0
    while 2 * k + 1 < size - 1:
        child = 2 * k + 1
        if child + 1 < size - 1 and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[k], heap[k] = keys[child], heap[child]
        k = child
    keys[k], heap[k] = key, node
    return top


@kernel
def _search(
    lanes: Lanes, book: Book, arrivals: Arrivals, nodes: Nodes, rules: Rules, trip: AgentTrip
) -> int:  # pragma: no cover - compiled
    """A* over (state, safe interval); returns the node at the goal, -1 for none, -2 for not enough memory.

    An interval is named by the entry before it. Within it the earliest arrival is the best one: whatever can be done
    later can be waited for. Keys order nodes by arrival at the goal, no earlier than it is free for good, and equal
    ones by what is left.
    """
    start, goal, distance = trip.start, trip.goal, trip.distance
    soonest, n_slots, slot = arrivals.soonest, arrivals.n_slots, arrivals.slot
    goal_from = 0  # first timestep from which the goal is free for good
    if goal >= 0:
        if distance[start] >= UNREACHABLE:
            return _NONE
        entry = book.following[lanes.state_cell[goal]]
        while entry >= 0:
            goal_from = max(goal_from, book.end[entry] + 1)
            entry = book.following[entry]
        if goal_from > FOREVER:
            return _NONE

    nodes.state[0], nodes.gap[0], nodes.time[0] = start, lanes.state_cell[start], 0
    nodes.via[0], nodes.parent[0] = _NONE, _NONE
    soonest[nodes.gap[0] * n_slots + slot[start]] = 0
    n_nodes, size, found = 1, 1, _NONE
    nodes.keys[0], nodes.heap[0] = 0, 0
    while size > 0 and found == _NONE:
        node = _pop(nodes.keys, nodes.heap, size)
        size -= 1
        s, p, t0 = nodes.state[node], nodes.gap[node], nodes.time[node]
        if soonest[p * n_slots + slot[s]] < t0:
            continue
        free_until = FOREVER if book.following[p] < 0 else book.begin[book.following[p]] - 1
        if free_until == FOREVER and (goal < 0 or s == goal):
            found = node
            continue
        if trip.stay and s == goal:
            continue
        home = lanes.state_cell[s]
        for k in range(lanes.out_ptr[s], lanes.out_ptr[s + 1]):
            move = lanes.out_move[k]
            after = lanes.move_to[move]
            if not lanes.is_open[move] or (goal >= 0 and distance[after] >= UNREACHABLE):
                continue
            to = lanes.state_cell[after]
            before = to
            while before >= 0 and book.end[before] <= free_until:
                next_entry = book.following[before]
                opens = book.end[before] + 1
                shuts = FOREVER if next_entry < 0 else book.begin[next_entry] - 1
                t = max(t0, opens - 1, rules.grace if rules.waiting[to] else 0)
                until = min(free_until, shuts - 1, max(t0, rules.latest, rules.grace) + 1)
                if to != home and t <= until and t == free_until and t == opens - 1:
                    # Somebody comes in as this agent leaves, and somebody leaves as it comes in.
                    ring = _ring(book, home, to, t)
                    if ring == 2 or (ring > 2 and not rules.allow_rotation):
                        t += 1
                while t <= until and not _may_cross(lanes, book, rules, move, home, to, t):
                    t += 1
                place = before * n_slots + slot[after]
                if opens <= shuts and t <= until and t + 1 < soonest[place]:
                    if n_nodes == len(nodes.state):
                        found = _FULL
                        break
                    soonest[place] = t + 1
                    nodes.state[n_nodes], nodes.gap[n_nodes], nodes.time[n_nodes] = after, before, t + 1
                    nodes.via[n_nodes], nodes.parent[n_nodes] = move, node
                    left = np.int64(distance[after]) if goal >= 0 else np.int64(0)
                    key = max(np.int64(t + 1) + left, np.int64(goal_from)) * FOREVER + left
                    _push(nodes.keys, nodes.heap, size, key, n_nodes)
                    n_nodes += 1
                    size += 1
                before = next_entry

    for node in range(n_nodes):
        soonest[nodes.gap[node] * n_slots + slot[nodes.state[node]]] = FOREVER
    return found
