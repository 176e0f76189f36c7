"""Reorder: let an agent that waits at a free cell go before those whose turn it is and who are late."""

from __future__ import annotations

import numpy as np
from numba import njit

from planners.precedence.arrays import BoolArray, Int64Array
from planners.precedence.queues import NOBODY, NONE, Queues, move_at, run_through


def go_first(q: Queues, agent: int, late: BoolArray) -> bool:
    """Move an agent's next visits ahead of those it waits for, wherever both still have to pass.

    The agents that are overtaken stand before the agent's next cells in line although nobody is in them. Their turns
    are exchanged along the whole stretch that they share with the agent; first along the cells that follow each other,
    and if they meet again later, up to there. A stretch ends where the agent has left it: who comes after must not wait
    for a way out that is not planned yet.

    Args:
        q: The queues; changed only if the answer is yes.
        agent: The agent; it has a queued move.
        late: Agents that will not move for a while, shape (n,). Others are overtaken only if they are farther from
            where they meet the agent than the agent is from having left the stretch, in moves.

    Returns:
        Whether the agent may start its next move now. Everybody still comes through then, and no grant is touched.

    Source: the idea of exchanging the order of two visits while the graph stays acyclic, from Berndt, van Duijkeren,
    Palmieri, Keviczky, "A Feedback Scheme to Reorder a Multi-Agent Execution Schedule by Persistently Optimizing a
    Switchable Action Dependency Graph", arXiv 2010.05254, 2020. Which visits to exchange, and when, is our own.
    """
    everything = np.full(len(q.state), np.iinfo(np.int64).max)
    nowhere = np.zeros(len(q.line_first), dtype=np.bool_)
    for far in (False, True):
        trial = q._replace(line_first=q.line_first.copy(), line_last=q.line_last.copy(), visit_next=q.visit_next.copy())
        if not _move_ahead(trial, agent, late, far):
            continue
        if (run_through(trial, everything, nowhere) < q.queued - q.granted).any():
            continue  # a cycle
        q.line_first[:], q.line_last[:], q.visit_next[:] = trial.line_first, trial.line_last, trial.visit_next
        return True
    return False


@njit(cache=True, nogil=True)
def held_up(q: Queues) -> BoolArray:  # pragma: no cover - compiled
    """Agents without a grant whose next cells are free, but not their turn, shape (n,)."""
    found = np.zeros(len(q.state), dtype=np.bool_)
    for agent in range(len(found)):
        if q.finished[agent] < q.granted[agent] or q.granted[agent] == q.queued[agent]:
            continue
        move = move_at(q, agent, q.granted[agent])
        waits, free = False, True
        for k in range(q.swept_ptr[move], q.swept_ptr[move + 1]):
            cell = q.swept_cell[k]
            waits |= q.visit_agent[q.line_first[cell]] != agent
            free &= q.holder[cell] == NOBODY or q.holder[cell] == agent
        found[agent] = waits and free
    return found


@njit(cache=True, nogil=True)
def _move_ahead(q: Queues, agent: int, late: BoolArray, far: bool) -> bool:  # pragma: no cover - compiled
    """Exchange the turns along the stretch, to its end or (`far`) to the end of what is queued; False = impossible."""
    first = q.granted[agent]
    move = move_at(q, agent, first)
    overtaken = np.zeros(len(q.state), dtype=np.bool_)
    for k in range(q.swept_ptr[move], q.swept_ptr[move + 1]):
        cell = q.swept_cell[k]
        if q.holder[cell] != NOBODY and q.holder[cell] != agent:
            return False
        visit = q.line_first[cell]
        while q.visit_agent[visit] != agent:
            overtaken[q.visit_agent[visit]] = True
            visit = q.visit_next[visit]
    meets = np.full(len(overtaken), np.iinfo(np.int64).max)  # moves until another one would be at the stretch
    left = 0  # moves until the agent has left the stretch
    for number in range(first, q.queued[agent]):
        move = move_at(q, agent, number)
        home, to = q.state_cell[q.move_from[move]], q.state_cell[q.move_to[move]]
        exchanged = False
        for k in range(q.swept_ptr[move], q.swept_ptr[move + 1]):
            cell = q.swept_cell[k]
            if cell == home:
                continue  # its turn there came with the turn to enter
            out = number
            if cell == to:
                out += 1
                while out < q.queued[agent] and q.state_cell[q.move_to[move_at(q, agent, out)]] == cell:
                    out += 1  # turns on the spot
            found = _exchange(q, cell, agent, number, out, overtaken, meets)
            if found < 0:
                return False
            if found > 0:
                exchanged = True
                left = max(left, out + 1 - first)
        if not exchanged and not far:
            break
    for other in range(len(overtaken)):
        if not late[other] and meets[other] < left:
            return False
    return left > 0


@njit(cache=True, nogil=True)
def _exchange(
    q: Queues, cell: int, agent: int, number: int, out: int, overtaken: BoolArray, meets: Int64Array
) -> int:  # pragma: no cover - compiled
    """Take the agent's visits `number` to `out` at a cell before the first one of an overtaken agent.

    Returns:
        1 when done, 0 when none of them is before it, -1 when one of them is there already or the agent does not leave.
    """
    before, place = NONE, q.line_first[cell]  # the first visit of an overtaken agent, and the one before
    while q.visit_agent[place] != agent or q.visit_number[place] != number:
        if overtaken[q.visit_agent[place]]:
            break
        before, place = place, q.visit_next[place]
    if not overtaken[q.visit_agent[place]]:
        return 0
    theirs = move_at(q, q.visit_agent[place], q.visit_number[place])
    if out >= q.queued[agent] or q.state_cell[q.move_from[theirs]] == cell:
        return -1
    previous, block = before, place
    while q.visit_agent[block] != agent or q.visit_number[block] != number:
        other = q.visit_agent[block]
        meets[other] = min(meets[other], q.visit_number[block] - q.finished[other])
        previous, block = block, q.visit_next[block]
    last = block
    while q.visit_number[last] != out:
        last = q.visit_next[last]
    q.visit_next[previous] = q.visit_next[last]
    if q.line_last[cell] == last:
        q.line_last[cell] = previous
    q.visit_next[last] = place
    if before == NONE:
        q.line_first[cell] = block
    else:
        q.visit_next[before] = block
    return 1
