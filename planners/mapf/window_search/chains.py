"""Chains: an agent is led anew through the window, then all whom it drives out of their way, until nobody is left."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planners.mapf.arrays import Int64Array, IntArray
from planners.mapf.chance import Chance, draw_below
from planners.mapf.kernel import Int, kernel
from planners.mapf.problem import NOBODY
from planners.mapf.roads import Roads
from planners.mapf.window_search.timetable import (
    FREE,
    TO_GOAL,
    WayCosts,
    WindowTimetable,
    closes_ring,
    extend,
    first_leg,
    leg_after,
    loss_of,
    move_of,
    price_of,
    write,
)

FRUGAL = -1
"""In place of a place in the order: whoever is driven out, all together must lose no more than before."""
_PUSH_WAITS = 8
"""Waits that a search counts at most for driving somebody out of its way."""
_EXTENSIONS = 3
"""Times that everybody is asked whether there is room now for another move at the end of its path."""


class WindowFrontier(NamedTuple):
    """Working memory of the search for one path; between searches the buckets are empty."""

    state: IntArray
    timestep: IntArray
    leg: IntArray
    parent: IntArray
    below: IntArray
    """The next node in the same bucket."""
    buckets: IntArray
    """Node on top of the stack of each loss."""
    seen: IntArray
    """Number of the search that reached a leg, timestep and state last,"""
    least: IntArray
    """and what it lost by then."""
    stamp: IntArray
    """Number of the search, shape (1,)."""
    expanded: Int64Array
    """Nodes expanded so far in all searches, shape (1,)."""


class Chain(NamedTuple):
    """Working memory of a chain."""

    member: IntArray
    """Agents that are led anew, in this order, `NOBODY` behind the last, shape (most,)."""
    kept: IntArray
    """Their paths before, shape (most, T + 1)."""
    kept_loss: Int64Array
    mark: IntArray
    """Number of the chain that an agent is a member of, shape (n,)."""
    stamp: IntArray
    """Number of the chain, shape (1,)."""
    place: IntArray
    """Place of each agent in the order of priority, shape (n,)."""


class ChainSearch(NamedTuple):
    """All that the search in a window works with."""

    roads: Roads
    ways: WayCosts
    table: WindowTimetable
    frontier: WindowFrontier
    chain: Chain
    chance: Chance
    allow_rotation: bool
    """Whether a closed ring of followers is legal."""


@kernel
def work(search: ChainSearch, sequence: IntArray, most_nodes: Int) -> None:  # pragma: no cover - compiled
    """Bring the plan up to date with what everybody wants now, use the timestep that is new in it, and improve it.

    Args:
        search: The plan, and what it is for.
        sequence: Agents, the one that goes first in front, shape (n,).
        most_nodes: Nodes that searches expand; half of them at most go to those who get nowhere.
    """
    roads, ways, table, frontier = search.roads, search.ways, search.table, search.frontier
    for agent in range(len(table.loss)):
        table.loss[agent] = loss_of(roads, ways, table, agent)
    for _ in range(_EXTENSIONS):
        for agent in sequence:
            extend(roads, ways, table, np.int64(agent), search.allow_rotation)
    begun = frontier.expanded[0]
    _free_the_stuck(search, sequence, begun + most_nodes // 2)
    _improve(search, begun + most_nodes)


@kernel
def _free_the_stuck(search: ChainSearch, sequence: IntArray, end: Int) -> None:  # pragma: no cover - compiled
    """Let those who come no nearer in the whole window drive out whoever comes after them in the order.

    Thrift alone comes to a stand where two queues meet and the shorter one would have to go back.
    """
    table, ways = search.table, search.ways
    stuck = ways.unit * (table.path.shape[1] - 1)
    for k in range(len(sequence)):
        agent = np.int64(sequence[k])
        if search.frontier.expanded[0] >= end:
            break
        if table.loss[agent] >= stuck and not ways.locked[agent]:
            lead_chain(search, agent, np.int64(k), np.int64(ways.unit))


@kernel
def _improve(search: ChainSearch, end: Int) -> None:  # pragma: no cover - compiled
    """Begin chains with random agents that lose something."""
    table, locked, n = search.table, search.ways.locked, len(search.table.loss)
    while n > 0 and search.frontier.expanded[0] < end:
        root = draw_below(search.chance, n)
        for _ in range(n):
            if table.loss[root] > 0 and not locked[root]:
                break
            root = root + 1 if root + 1 < n else 0
        if table.loss[root] == 0 or locked[root]:
            break
        price = draw_below(search.chance, search.ways.unit * _PUSH_WAITS + 1)
        lead_chain(search, root, np.int64(FRUGAL), price)


@kernel
def lead_chain(search: ChainSearch, root: Int, bound: Int, price: Int) -> bool:  # pragma: no cover - compiled
    """Lead an agent anew, and all whom it drives out of their way.

    Args:
        search: The plan.
        root: The agent.
        bound: Whoever has this place in the order or a later one can be driven out whatever it costs, if the root loses
            less than before; `FRUGAL` = anybody can, but all members together must lose no more than before.
        price: What driving somebody out counts in the search for a path.

    Returns:
        Whether it is done; if not, nothing has changed.
    """
    roads, table, chain = search.roads, search.table, search.chain
    chain.stamp[0] += 1
    _join(search, np.int64(0), root)
    count, done, total = np.int64(1), 0, np.int64(0)
    ok = True
    while ok and done < count:
        agent, before = np.int64(chain.member[done]), np.int64(chain.kept_loss[done])
        limit = np.int64(len(search.frontier.buckets))
        if bound == FRUGAL:
            limit = before - total
        elif done == 0:
            limit = before - 1
        ok = False
        if _lead(search, agent, limit, bound, price):
            count = _drive_out(search, agent, count)
            if count >= 0:
                write(roads, table, agent, agent)
                table.loss[agent] = loss_of(roads, search.ways, table, agent)
                total += table.loss[agent] - before
                done += 1
                ok = bound != FRUGAL or total <= 0
    if not ok:
        _undo(search, done)
    return ok


@kernel
def _join(search: ChainSearch, k: Int, agent: Int) -> None:  # pragma: no cover - compiled
    """Take an agent out of the timetable as the k-th member of a chain."""
    table, chain = search.table, search.chain
    chain.member[k] = agent
    if k + 1 < len(chain.member):
        chain.member[k + 1] = NOBODY
    chain.mark[agent] = chain.stamp[0]
    chain.kept_loss[k] = table.loss[agent]
    for t in range(table.path.shape[1]):
        chain.kept[k, t] = table.path[agent, t]
    write(search.roads, table, agent, NOBODY)


@kernel
def _undo(search: ChainSearch, done: Int) -> None:  # pragma: no cover - compiled
    """Give all members of a chain their paths back, of whom the first `done` are in the timetable."""
    table, chain = search.table, search.chain
    for k in range(done):
        write(search.roads, table, np.int64(chain.member[k]), NOBODY)
    for k in range(len(chain.member)):
        agent = np.int64(chain.member[k])
        if agent == NOBODY:
            break
        for t in range(table.path.shape[1]):
            table.path[agent, t] = chain.kept[k, t]
        table.loss[agent] = chain.kept_loss[k]
        chain.mark[agent] = 0
        write(search.roads, table, agent, agent)


@kernel
def _drive_out(search: ChainSearch, agent: Int, count: Int) -> Int:  # pragma: no cover - compiled
    """Let all join whom the path of an agent is in conflict with; returns the new count, -1 if they are too many."""
    roads, occupant = search.roads, search.table.occupant
    path = search.table.path[agent]
    for t in range(1, len(path)):
        here, there = np.int64(path[t - 1]), np.int64(path[t])
        count = _join_if_other(search, agent, np.int64(occupant[t, roads.cell[there]]), count)
        if roads.cell[here] != roads.cell[there]:
            ahead = np.int64(occupant[t - 1, roads.cell[there]])
            if ahead == occupant[t, roads.cell[here]]:
                count = _join_if_other(search, agent, ahead, count)
        if len(roads.beside) and here != there:
            move = move_of(roads, here, there)
            for k in range(roads.beside_ptr[move], roads.beside_ptr[move + 1]):
                for when in range(max(t - 1, 1), t + 1):
                    count = _join_if_other(search, agent, np.int64(occupant[when, roads.beside[k]]), count)
    return count


@kernel
def _join_if_other(search: ChainSearch, agent: Int, other: Int, count: Int) -> Int:  # pragma: no cover - compiled
    if count < 0 or other == NOBODY or other == agent:  # noqa: PLR1714, SIM109
        return count
    if count == len(search.chain.member):
        return np.int64(-1)
    _join(search, count, other)
    return count + 1


@kernel
def _lead(search: ChainSearch, agent: Int, limit: Int, bound: Int, price: Int) -> bool:  # pragma: no cover - compiled
    """Find the path of least loss, at most `limit`, and write it down but for the cells.

    A* over legs, timesteps and states. A direct way loses nothing, so what is lost is all there is to a cost, and the
    cheapest node is the deepest of those that have lost least.

    Source: Silver, "Cooperative Pathfinding", AIIDE 2005 (windowed search in space and time, reserved cells).
    """
    roads, ways, table, frontier = search.roads, search.ways, search.table, search.frontier
    frontier.stamp[0] += 1
    last = np.int64(table.path.shape[1] - 1)
    limit = min(limit, np.int64(len(frontier.buckets) - 1))
    if limit < 0:
        return False
    start = np.int64(table.path[agent, 0])
    count = _push(roads, frontier, np.int64(0), start, np.int64(0), first_leg(ways, agent), np.int64(-1), np.int64(0))
    level: Int = np.int64(0)
    end = np.int64(-1)
    while level <= limit:
        node = np.int64(frontier.buckets[level])
        if node < 0:
            level += 1
            continue
        frontier.buckets[level] = frontier.below[node]
        state, t, leg = np.int64(frontier.state[node]), np.int64(frontier.timestep[node]), np.int64(frontier.leg[node])
        if frontier.least[_key(roads, leg, t, state)] < level:
            continue
        if t == last:
            end = node
            break
        frontier.expanded[0] += 1
        n_moves = np.int64(roads.ptr[state + 1] - roads.ptr[state])
        if leg == TO_GOAL and ways.stay[agent] and ways.table[ways.wishes.row[agent], state] == 0:
            n_moves = np.int64(0)
        turn = draw_below(search.chance, n_moves + 1)
        for k in range(n_moves + 1):
            which = k + turn if k + turn <= n_moves else k + turn - n_moves - 1
            move = roads.ptr[state] + which if which < n_moves else np.int64(-1)
            to = np.int64(roads.to[move]) if move >= 0 else state
            loss = np.int64(level) + price_of(ways, agent, leg, state, to, ways.move_cost[move] if move >= 0 else 0)
            if loss > limit:
                continue
            pushed = _pushed(search, agent, t, state, move, to, bound)
            loss += price * pushed
            if pushed < 0 or loss > limit:
                continue
            if count == len(frontier.state):
                level = limit + 1
                break
            count = _push(roads, frontier, count, to, t + 1, leg_after(ways, agent, leg, to), node, loss)
    for bucket in range(limit + 1):
        frontier.buckets[bucket] = -1
    node = end
    while node >= 0:
        table.path[agent, frontier.timestep[node]] = frontier.state[node]
        node = np.int64(frontier.parent[node])
    return bool(end >= 0)


@kernel
def _key(roads: Roads, leg: Int, t: Int, state: Int) -> Int:  # pragma: no cover - compiled
    return (t * (FREE + 1) + leg) * len(roads.cell) + state


@kernel
def _push(
    roads: Roads, frontier: WindowFrontier, count: Int, state: Int, t: Int, leg: Int, parent: Int, loss: Int
) -> Int:  # pragma: no cover - compiled
    """Queue a node unless it has been reached with as little loss; returns the new number of nodes."""
    key = _key(roads, leg, t, state)
    if frontier.seen[key] == frontier.stamp[0] and frontier.least[key] <= loss:
        return count
    frontier.seen[key] = frontier.stamp[0]
    frontier.least[key] = loss
    frontier.state[count], frontier.timestep[count], frontier.leg[count] = state, t, leg
    frontier.parent[count] = parent
    frontier.below[count] = frontier.buckets[loss]
    frontier.buckets[loss] = count
    return count + 1


@kernel
def _pushed(
    search: ChainSearch, agent: Int, t: Int, state: Int, move: Int, to: Int, bound: Int
) -> Int:  # pragma: no cover - compiled
    """How many agents a step drives out of their way; -1 if one of them cannot be, or the step closes a ring."""
    roads, occupant = search.roads, search.table.occupant
    cell, here = roads.cell[to], roads.cell[state]
    found = np.int64(0)
    other = np.int64(occupant[t + 1, cell])
    if other != NOBODY and other != agent:  # noqa: PLR1714
        if _is_firm(search, other, bound):
            return np.int64(-1)
        found += 1
    if cell != here:
        ahead = np.int64(occupant[t, cell])
        swaps = ahead != NOBODY and ahead != agent and occupant[t + 1, here] == ahead  # noqa: PLR1714
        if swaps and ahead != other:
            if _is_firm(search, ahead, bound):
                return np.int64(-1)
            found += 1
        if not search.allow_rotation and closes_ring(roads, search.table, agent, t, here, cell):
            return np.int64(-1)
    if move >= 0:
        for k in range(roads.beside_ptr[move], roads.beside_ptr[move + 1]):
            for when in range(t, t + 2):
                other = np.int64(occupant[when, roads.beside[k]])
                if other != NOBODY and other != agent:  # noqa: PLR1714
                    if when == 0 or _is_firm(search, other, bound):
                        return np.int64(-1)
                    found += 1
    return found


@kernel
def _is_firm(search: ChainSearch, other: Int, bound: Int) -> bool:  # pragma: no cover - compiled
    """Whether an agent cannot be driven out of its way."""
    chain = search.chain
    return bool(search.ways.locked[other] or chain.mark[other] == chain.stamp[0] or chain.place[other] < bound)
