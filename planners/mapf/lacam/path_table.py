"""PathTable: who is where when, and the cheapest way of one agent through what the others leave free."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planners.mapf.arrays import Int64Array, IntArray
from planners.mapf.chance import Chance, draw_below
from planners.mapf.kernel import Int, kernel
from planners.mapf.lacam.successors import Guide
from planners.mapf.roads import Roads

_POOL = 2**17
"""Nodes of one search; one that needs more is given up."""


class PathTable(NamedTuple):
    """The paths of all agents, and the same cell by cell."""

    path: IntArray
    """State of each agent at each timestep, shape (n, T + 1)."""
    occupant: IntArray
    """Who stands in a cell at a timestep, -1 = nobody, shape (n_cells, T + 1)."""
    crossed: IntArray
    """Who sweeps over a cell from a timestep to the next, neither from nor to; no rows where no move is that wide."""
    loss: Int64Array
    """Timesteps of each agent that it does not spend at its goal, shape (n,)."""


class Frontier(NamedTuple):
    """Working memory of a search; between searches the hash table is empty."""

    state: IntArray
    timestep: IntArray
    loss: IntArray
    parent: IntArray
    below: IntArray
    """The next node in the same bucket."""
    slot: IntArray
    buckets: IntArray
    """Node on top of the stack of each estimate above the least, shape (T + 2,)."""
    slot_key: Int64Array
    slot_loss: IntArray
    expanded: Int64Array
    """Nodes expanded so far in all searches, shape (1,)."""


def path_table_of(roads: Roads, guide: Guide, states: IntArray) -> PathTable:
    """Read a plan, shape (T + 1, n)."""
    n = states.shape[1]
    rows = len(states)
    table = PathTable(
        path=np.ascontiguousarray(states.T),
        occupant=np.full((roads.n_cells, rows), -1, dtype=np.int32),
        crossed=np.full((roads.n_cells if len(roads.beside) else 0, rows), -1, dtype=np.int32),
        loss=np.zeros(n, dtype=np.int64),
    )
    for agent in range(n):
        enter(roads, guide, table, agent)
    return table


def frontier_of(table: PathTable) -> Frontier:
    """Working memory for searches in a timetable."""

    def ints(length: int) -> IntArray:
        return np.full(length, -1, dtype=np.int32)

    return Frontier(
        state=ints(_POOL),
        timestep=ints(_POOL),
        loss=ints(_POOL),
        parent=ints(_POOL),
        below=ints(_POOL),
        slot=ints(_POOL),
        buckets=ints(table.path.shape[1] + 2),
        slot_key=np.full(2 * _POOL, -1, dtype=np.int64),
        slot_loss=ints(2 * _POOL),
        expanded=np.zeros(1, dtype=np.int64),
    )


@kernel
def enter(roads: Roads, guide: Guide, table: PathTable, agent: Int) -> None:  # pragma: no cover - compiled
    """Write the path of an agent into the cells, and add up its loss."""
    path, goal = table.path[agent], guide.goals[agent]
    last = len(path) - 1
    table.loss[agent] = 0
    for t in range(last + 1):
        table.occupant[roads.cell[path[t]], t] = agent
        if t < last:
            if goal >= 0 and (path[t] != goal or path[t + 1] != goal):
                table.loss[agent] += 1
            if len(table.crossed) and path[t + 1] != path[t]:
                _sweep(roads, table, t, path[t], path[t + 1], agent)


@kernel
def withdraw(roads: Roads, table: PathTable, agent: Int) -> None:  # pragma: no cover - compiled
    """Take an agent out of the cells; its path stays."""
    path = table.path[agent]
    last = len(path) - 1
    for t in range(last + 1):
        table.occupant[roads.cell[path[t]], t] = -1
        if t < last and len(table.crossed) and path[t + 1] != path[t]:
            _sweep(roads, table, t, path[t], path[t + 1], -1)


@kernel
def _sweep(
    roads: Roads, table: PathTable, t: Int, state: Int, to: Int, who: Int
) -> None:  # pragma: no cover - compiled
    for move in range(roads.ptr[state], roads.ptr[state + 1]):
        if roads.to[move] == to:
            for k in range(roads.beside_ptr[move], roads.beside_ptr[move + 1]):
                table.crossed[roads.beside[k], t] = who


@kernel
def _is_free(
    roads: Roads, guide: Guide, table: PathTable, t: Int, state: Int, move: Int, to: Int
) -> bool:  # pragma: no cover - compiled
    """Whether an agent that is not in the timetable can make a move (-1 = wait) from a timestep to the next."""
    home, cell = roads.cell[state], roads.cell[to]
    if table.occupant[cell, t + 1] >= 0:
        return False
    if len(table.crossed):
        if table.crossed[cell, t] >= 0 or table.crossed[home, t] >= 0:
            return False
        if move >= 0:
            for k in range(roads.beside_ptr[move], roads.beside_ptr[move + 1]):
                beside = roads.beside[k]
                if table.occupant[beside, t] >= 0 or table.occupant[beside, t + 1] >= 0:
                    return False
                if table.crossed[beside, t] >= 0:
                    return False
    ahead = table.occupant[cell, t]
    if cell == home or ahead < 0:
        return True
    beyond = roads.cell[table.path[ahead, t + 1]]
    if beyond == home or guide.allow_rotation:
        return bool(beyond != home)  # swap
    while beyond != home and ahead >= 0:  # follow those who follow: a ring comes back to the cell this agent leaves
        ahead = table.occupant[beyond, t]
        if ahead >= 0:
            beyond = roads.cell[table.path[ahead, t + 1]]
    return bool(beyond != home)


@kernel
def _free_from(roads: Roads, table: PathTable, state: Int) -> Int:  # pragma: no cover - compiled
    """First timestep from which on nobody else uses the cell of a state."""
    cell = roads.cell[state]
    for t in range(table.path.shape[1] - 1, -1, -1):
        if table.occupant[cell, t] >= 0:
            return t + 1
        if len(table.crossed) and table.crossed[cell, t] >= 0:
            return t + 2
    return 0


@kernel
def reroute(
    roads: Roads,
    guide: Guide,
    table: PathTable,
    frontier: Frontier,
    agent: Int,
    start: Int,
    most: Int,
    chance: Chance,
) -> bool:  # pragma: no cover - compiled
    """Give an agent that has withdrawn its cheapest path among the others.

    A* over (state, timestep) with exact distances. Timesteps at the goal cost nothing, also when the agent makes room
    there later; the same (state, timestep) can then cost less on another way. Equal estimates are taken last in first
    out, which leads straight to the goal where the way is free.

    Args:
        roads: Open moves.
        guide: Goals and distances.
        table: PathTable of all others; the agent's path is written to, not entered.
        frontier: Working memory.
        agent: Who.
        start: Its state at timestep 0.
        most: Loss beyond which no path is wanted.
        chance: Source of the tie-breaking.

    Returns:
        Whether there is such a path.

    Source: Silver, "Cooperative pathfinding", AIIDE 2005.
    """
    goal = np.int64(guide.goals[agent])
    row = guide.row[agent]
    last = table.path.shape[1] - 1
    least = np.int64(guide.distances[row, start])
    highest = min(np.int64(most) - least, np.int64(last) + 1)
    if highest < 0:
        return False
    free_from = _free_from(roads, table, goal)
    for bucket in range(highest + 1):
        frontier.buckets[bucket] = -1
    count = _push(roads, frontier, np.int64(0), np.int64(start), np.int64(0), np.int64(0), np.int64(-1), np.int64(0))
    level: Int = np.int64(0)
    end = np.int64(-1)
    while level <= highest:
        node = np.int64(frontier.buckets[level])
        if node < 0:
            level += 1
            continue
        frontier.buckets[level] = frontier.below[node]
        state, t, loss = np.int64(frontier.state[node]), np.int64(frontier.timestep[node]), frontier.loss[node]
        if frontier.slot_loss[frontier.slot[node]] != loss:
            continue  # a cheaper way has been found since
        frontier.slot_loss[frontier.slot[node]] = -2 - loss  # expanded
        if state == goal and t >= free_from:
            end = node
            break
        if t == last:
            continue
        frontier.expanded[0] += 1
        n_moves = roads.ptr[state + 1] - roads.ptr[state]
        if state == goal and guide.stay[agent]:
            n_moves = 0
        turn = draw_below(chance, n_moves + 1)
        for k in range(n_moves + 1):
            which = (k + turn) % (n_moves + 1)
            move = roads.ptr[state] + which if which < n_moves else np.int64(-1)
            to = np.int64(roads.to[move]) if move >= 0 else state
            loss_then = np.int64(loss) if state == goal and to == goal else np.int64(loss) + 1
            above = loss_then + np.int64(guide.distances[row, to]) - least
            if above > highest or t + 1 + np.int64(guide.distances[row, to]) > last:
                continue
            if not _is_free(roads, guide, table, t, state, move, to):
                continue
            if count == len(frontier.state):
                level = highest + 1
                break
            count = _push(roads, frontier, count, to, t + 1, loss_then, node, above)
    if end >= 0:
        for after in range(frontier.timestep[end], last + 1):
            table.path[agent, after] = goal
        node = end
        while node >= 0:
            table.path[agent, frontier.timestep[node]] = frontier.state[node]
            node = np.int64(frontier.parent[node])
    for k in range(count):
        frontier.slot_key[frontier.slot[k]] = -1
    return bool(end >= 0)


@kernel
def _push(
    roads: Roads, frontier: Frontier, count: Int, state: Int, t: Int, loss: Int, parent: Int, level: Int
) -> Int:  # pragma: no cover - compiled
    """Queue a node unless its (state, timestep) has been reached as cheaply; returns the new number of nodes."""
    key = t * len(roads.cell) + state
    mask = len(frontier.slot_key) - 1
    slot = ((key * 0x9E3779B1) >> 7) & mask
    while frontier.slot_key[slot] >= 0 and frontier.slot_key[slot] != key:
        slot = (slot + 1) & mask
    if frontier.slot_key[slot] == key and frontier.slot_loss[slot] <= loss:
        return count
    frontier.slot_key[slot] = key
    frontier.slot_loss[slot] = loss
    frontier.slot[count] = slot
    frontier.state[count] = state
    frontier.timestep[count] = t
    frontier.loss[count] = loss
    frontier.parent[count] = parent
    frontier.below[count] = frontier.buckets[level]
    frontier.buckets[level] = count
    return count + 1
