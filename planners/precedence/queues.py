"""Queues: moves in flight per agent and visitors to come per cell, as flat arrays, and the kernels on them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from maps.lane_graph import LaneGraph
from planners.precedence.arrays import BoolArray, Int64Array, IntArray

NOBODY = -1
NONE = -1


class Queues(NamedTuple):
    """What is in flight; n agents, C cells, V visits.

    The moves of an agent are numbered from the beginning; number k lies at `moves[agent, k % capacity]`. Numbers from
    `finished` to before `granted` are granted, those from `granted` to before `queued` wait. A **visit** is one queued
    move at one cell that it sweeps; the visits of a cell form a line in the order in which they may happen. Visits are
    taken from a pool and go back to it when their move is granted or dropped.
    """

    state_cell: IntArray
    move_from: IntArray
    move_to: IntArray
    swept_ptr: IntArray
    swept_cell: IntArray
    """These five are the lane graph's."""
    state: IntArray
    """Last state reached, shape (n,)."""
    moves: IntArray
    """Shape (n, capacity), a power of two."""
    finished: Int64Array
    granted: Int64Array
    queued: Int64Array
    """Numbers, shape (n,)."""
    holder: IntArray
    """Agent that has the cell, or `NOBODY`, shape (C,)."""
    holds: IntArray
    """Reasons to hold it: the agent's position, granted moves, a reservation, shape (C,)."""
    line_first: IntArray
    line_last: IntArray
    """Visits at the ends of a cell's line, or `NONE`, shape (C,)."""
    visit_agent: IntArray
    visit_number: Int64Array
    visit_next: IntArray
    """Shape (V,); the next visit in the line, or in the pool."""
    pool: IntArray
    """First visit in the pool and how many it holds, shape (2,)."""


def empty_queues(graph: LaneGraph, states: IntArray) -> Queues:
    """Agents that stand in given states and have nothing to do; nobody holds a cell yet."""
    n = len(states)
    return Queues(
        state_cell=graph.state_cell,
        move_from=graph.move_from,
        move_to=graph.move_to,
        swept_ptr=graph.swept_ptr,
        swept_cell=graph.swept_cell,
        state=states,
        moves=np.zeros((n, 1), dtype=np.int32),
        finished=np.zeros(n, dtype=np.int64),
        granted=np.zeros(n, dtype=np.int64),
        queued=np.zeros(n, dtype=np.int64),
        holder=np.full(graph.n_cells, NOBODY, dtype=np.int32),
        holds=np.zeros(graph.n_cells, dtype=np.int32),
        line_first=np.full(graph.n_cells, NONE, dtype=np.int32),
        line_last=np.full(graph.n_cells, NONE, dtype=np.int32),
        visit_agent=np.empty(0, dtype=np.int32),
        visit_number=np.empty(0, dtype=np.int64),
        visit_next=np.empty(0, dtype=np.int32),
        pool=np.array([NONE, 0], dtype=np.int32),
    )


def with_room(q: Queues, n_moves: int, n_visits: int) -> Queues:
    """The same queues with room for `n_moves` in flight per agent and `n_visits` more visits."""
    capacity = q.moves.shape[1]
    if n_moves > capacity:
        wider = 1 << (n_moves - 1).bit_length()
        agent, number = np.nonzero(np.ones((len(q.moves), capacity), dtype=np.bool_))
        number = q.finished[agent] + number
        moves = np.zeros((len(q.moves), wider), dtype=np.int32)
        moves[agent, number % wider] = q.moves[agent, number % capacity]
        q = q._replace(moves=moves)
    missing = n_visits - int(q.pool[1])
    if missing > 0:
        old, extra = len(q.visit_next), max(missing, len(q.visit_next))
        chain = np.arange(old + 1, old + extra + 1, dtype=np.int32)
        chain[-1] = q.pool[0]
        q = q._replace(
            visit_agent=np.append(q.visit_agent, np.zeros(extra, dtype=np.int32)),
            visit_number=np.append(q.visit_number, np.zeros(extra, dtype=np.int64)),
            visit_next=np.append(q.visit_next, chain),
            pool=np.array([old, q.pool[1] + extra], dtype=np.int32),
        )
    return q


@njit(cache=True, nogil=True)
def move_at(q: Queues, agent: int, number: int) -> int:  # pragma: no cover - compiled
    """The agent's move with that number."""
    move: int = q.moves[agent, number & (q.moves.shape[1] - 1)]
    return move


@njit(cache=True, nogil=True)
def tails(q: Queues) -> IntArray:  # pragma: no cover - compiled
    """State each agent stands in when all its moves are done, shape (n,)."""
    states = q.state.copy()
    for agent in range(len(states)):
        if q.queued[agent] > q.finished[agent]:
            states[agent] = q.move_to[move_at(q, agent, q.queued[agent] - 1)]
    return states


@njit(cache=True, nogil=True)
def granted_tails(q: Queues) -> IntArray:  # pragma: no cover - compiled
    """State each agent stands in when all it was granted is done, shape (n,)."""
    states = q.state.copy()
    for agent in range(len(states)):
        if q.granted[agent] > q.finished[agent]:
            states[agent] = q.move_to[move_at(q, agent, q.granted[agent] - 1)]
    return states


@njit(cache=True, nogil=True)
def append(q: Queues, timestep: Int64Array, agent: Int64Array, move: Int64Array) -> None:  # pragma: no cover - compiled
    """Queue moves, ordered by timestep; there is room. In one timestep whoever leaves a cell is before who enters."""
    begin = 0
    while begin < len(move):
        end = begin
        while end < len(move) and timestep[end] == timestep[begin]:
            end += 1
        for entering in (False, True):
            for k in range(begin, end):
                home = q.state_cell[q.move_from[move[k]]]
                for i in range(q.swept_ptr[move[k]], q.swept_ptr[move[k] + 1]):
                    cell = q.swept_cell[i]
                    if (cell != home) == entering:
                        _line_up(q, cell, agent[k])
        for k in range(begin, end):
            who = agent[k]
            q.moves[who, q.queued[who] & (q.moves.shape[1] - 1)] = move[k]
            q.queued[who] += 1
        begin = end


@njit(cache=True, nogil=True)
def _line_up(q: Queues, cell: int, agent: int) -> None:  # pragma: no cover - compiled
    visit = q.pool[0]
    q.pool[0] = q.visit_next[visit]
    q.pool[1] -= 1
    q.visit_agent[visit] = agent
    q.visit_number[visit] = q.queued[agent]
    q.visit_next[visit] = NONE
    if q.line_first[cell] == NONE:
        q.line_first[cell] = visit
    else:
        q.visit_next[q.line_last[cell]] = visit
    q.line_last[cell] = visit


@njit(cache=True, nogil=True)
def may_start(q: Queues, agent: int) -> bool:  # pragma: no cover - compiled
    """Whether the agent's next queued move finds it first in line at every cell, and no cell held by another."""
    if q.granted[agent] == q.queued[agent]:
        return False
    move = move_at(q, agent, q.granted[agent])
    for k in range(q.swept_ptr[move], q.swept_ptr[move + 1]):
        cell = q.swept_cell[k]
        if q.visit_agent[q.line_first[cell]] != agent:
            return False
        if q.holder[cell] != NOBODY and q.holder[cell] != agent:
            return False
    return True


@njit(cache=True, nogil=True)
def start(q: Queues, agent: int) -> int:  # pragma: no cover - compiled
    """Grant the agent's next queued move, which may start; returns the move."""
    move = move_at(q, agent, q.granted[agent])
    q.granted[agent] += 1
    for k in range(q.swept_ptr[move], q.swept_ptr[move + 1]):
        cell = q.swept_cell[k]
        visit = q.line_first[cell]
        q.line_first[cell] = q.visit_next[visit]
        if q.line_first[cell] == NONE:
            q.line_last[cell] = NONE
        q.visit_next[visit] = q.pool[0]
        q.pool[0] = visit
        q.pool[1] += 1
        hold(q, agent, cell)
    return move


@njit(cache=True, nogil=True)
def start_all(
    q: Queues, most: int, closed: BoolArray, agents: IntArray, moves: IntArray
) -> int:  # pragma: no cover - compiled
    """Grant what may start, agent by agent.

    Args:
        q: The queues.
        most: Moves that an agent may hold a grant for.
        closed: Cells nobody may be sent into, shape (C,).
        agents: Receives who was granted something, room for `most` per agent.
        moves: Receives the moves.

    Returns:
        How many were granted.
    """
    count = 0
    for agent in range(len(q.state)):
        while q.granted[agent] - q.finished[agent] < most and may_start(q, agent):
            if closed[q.state_cell[q.move_to[move_at(q, agent, q.granted[agent])]]]:
                break
            agents[count] = agent
            moves[count] = start(q, agent)
            count += 1
    return count


@njit(cache=True, nogil=True)
def end(q: Queues, agent: int) -> int:  # pragma: no cover - compiled
    """Finish the agent's oldest granted move and let go of what it left; returns the move."""
    move = move_at(q, agent, q.finished[agent])
    q.finished[agent] += 1
    before, state = q.state[agent], q.move_to[move]
    q.state[agent] = state
    hold(q, agent, q.state_cell[state])
    for k in range(q.swept_ptr[move], q.swept_ptr[move + 1]):
        let_go(q, q.swept_cell[k])
    let_go(q, q.state_cell[before])
    return move


@njit(cache=True, nogil=True)
def end_all(q: Queues, agents: IntArray) -> int:  # pragma: no cover - compiled
    """Finish one move for each entry; returns how many were done before an agent had none granted."""
    for k in range(len(agents)):
        if q.finished[agents[k]] == q.granted[agents[k]]:
            return k
        end(q, agents[k])
    return len(agents)


@njit(cache=True, nogil=True)
def hold(q: Queues, agent: int, cell: int) -> None:  # pragma: no cover - compiled
    """Give an agent one more reason to hold a cell."""
    q.holder[cell] = agent
    q.holds[cell] += 1


@njit(cache=True, nogil=True)
def take_places(q: Queues) -> int:  # pragma: no cover - compiled
    """Let every agent hold the cell of its state; returns the first one whose cell is another's, n if there is none."""
    for agent in range(len(q.state)):
        cell = q.state_cell[q.state[agent]]
        if q.holder[cell] != NOBODY:
            return agent
        hold(q, agent, cell)
    return len(q.state)


@njit(cache=True, nogil=True)
def let_go(q: Queues, cell: int) -> None:  # pragma: no cover - compiled
    """Take one reason to hold a cell away; without any the cell is free."""
    q.holds[cell] -= 1
    if q.holds[cell] == 0:
        q.holder[cell] = NOBODY


@njit(cache=True, nogil=True)
def first_in_line(q: Queues) -> IntArray:  # pragma: no cover - compiled
    """The agent of the first visit in each cell's line, or `NOBODY`, shape (C,)."""
    agents = np.full(len(q.line_first), NOBODY, np.int32)
    for cell in range(len(agents)):
        if q.line_first[cell] != NONE:
            agents[cell] = q.visit_agent[q.line_first[cell]]
    return agents


@njit(cache=True, nogil=True)
def run_through(q: Queues, limits: Int64Array, closed: BoolArray) -> Int64Array:  # pragma: no cover - compiled
    """Run the queues without their timing: which moves come through when each agent does at most `limits`.

    The order in which they are tried does not matter: a move that can be executed stays so.

    Args:
        q: The queues; nothing is changed.
        limits: Queued moves per agent, shape (n,).
        closed: Cells through which nothing comes, shape (C,).

    Returns:
        Moves that come through, shape (n,). At each cell they are the first ones in line.
    """
    n = len(q.state)
    at = q.line_first.copy()
    done = np.zeros(n, dtype=np.int64)
    todo = np.empty(n, dtype=np.int32)
    listed = np.ones(n, dtype=np.bool_)
    for agent in range(n):
        todo[agent] = agent
    count = n
    while count > 0:
        count -= 1
        agent = todo[count]
        listed[agent] = False
        while done[agent] < min(limits[agent], q.queued[agent] - q.granted[agent]):
            move = move_at(q, agent, q.granted[agent] + done[agent])
            first, last = q.swept_ptr[move], q.swept_ptr[move + 1]
            through = True
            for k in range(first, last):
                cell = q.swept_cell[k]
                if closed[cell] or q.visit_agent[at[cell]] != agent:
                    through = False
            if not through:
                break
            done[agent] += 1
            for k in range(first, last):
                cell = q.swept_cell[k]
                at[cell] = q.visit_next[at[cell]]
                if at[cell] != NONE:
                    other = q.visit_agent[at[cell]]
                    if other != agent and not listed[other]:
                        listed[other] = True
                        todo[count] = other
                        count += 1
    return done


@njit(cache=True, nogil=True)
def timesteps_left(q: Queues) -> Int64Array:  # pragma: no cover - compiled
    """Timesteps until each agent has made all its moves, shape (n,), if each takes one as soon as it may start.

    Args:
        q: The queues; nothing is changed. Everybody comes through.
    """
    n = len(q.state)
    at = q.line_first.copy()
    free = np.zeros(len(at), dtype=np.int64)  # timestep at which whoever came last in a cell has left it
    done = q.granted.copy()
    left = np.zeros(n, dtype=np.int64)
    todo = np.empty(n, dtype=np.int32)
    listed = np.ones(n, dtype=np.bool_)
    for agent in range(n):
        todo[agent] = agent
        for number in range(q.finished[agent], q.granted[agent]):
            left[agent] += 1
            move = move_at(q, agent, number)
            for k in range(q.swept_ptr[move], q.swept_ptr[move + 1]):
                free[q.swept_cell[k]] = left[agent]
    count = n
    while count > 0:
        count -= 1
        agent = todo[count]
        listed[agent] = False
        while done[agent] < q.queued[agent]:
            move = move_at(q, agent, done[agent])
            first, last = q.swept_ptr[move], q.swept_ptr[move + 1]
            is_first, begin = True, left[agent]
            for k in range(first, last):
                is_first &= q.visit_agent[at[q.swept_cell[k]]] == agent
                begin = max(begin, free[q.swept_cell[k]])
            if not is_first:
                break
            done[agent] += 1
            left[agent] = begin + 1
            for k in range(first, last):
                cell = q.swept_cell[k]
                free[cell] = left[agent]
                at[cell] = q.visit_next[at[cell]]
                if at[cell] != NONE:
                    other = q.visit_agent[at[cell]]
                    if other != agent and not listed[other]:
                        listed[other] = True
                        todo[count] = other
                        count += 1
    return left


@njit(cache=True, nogil=True)
def cut_off(q: Queues, kept: Int64Array) -> None:  # pragma: no cover - compiled
    """Drop all queued moves but the first `kept` of each agent, which come through without the others."""
    for cell in range(len(q.line_first)):
        before, visit = NONE, q.line_first[cell]
        while visit != NONE:
            agent = q.visit_agent[visit]
            if q.visit_number[visit] >= q.granted[agent] + kept[agent]:
                break
            before, visit = visit, q.visit_next[visit]
        if visit == NONE:
            continue
        if before == NONE:
            q.line_first[cell] = NONE
        else:
            q.visit_next[before] = NONE
        q.line_last[cell] = before
        while visit != NONE:
            following = q.visit_next[visit]
            q.visit_next[visit] = q.pool[0]
            q.pool[0] = visit
            q.pool[1] += 1
            visit = following
    for agent in range(len(kept)):
        q.queued[agent] = q.granted[agent] + kept[agent]
