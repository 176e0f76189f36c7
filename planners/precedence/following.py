"""Following: grant moves into cells that are being left, right behind whoever drives ahead the same way."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from planners.precedence.queues import NOBODY, NONE, Queues, move_at, start

Headings = npt.NDArray[np.int8]


@njit(cache=True, nogil=True)
def start_behind(q: Queues, heading: Headings) -> int:  # pragma: no cover - compiled
    """Grant the next move of agents whose turn it is in a cell that somebody leaves straight ahead of them.

    From then on the cell is held by both, and free when both have left it.

    Args:
        q: The queues, changed in place.
        heading: Heading of each state.

    Returns:
        How many were granted.
    """
    count = 0
    for first in range(len(q.state)):
        agent = first
        while _may_follow(q, agent, heading):
            home = q.state_cell[q.state[agent]]
            start(q, agent)
            count += 1
            visit = q.line_first[home]
            if visit == NONE:
                break
            agent = q.visit_agent[visit]
    return count


@njit(cache=True, nogil=True)
def _may_follow(q: Queues, agent: int, heading: Headings) -> bool:  # pragma: no cover - compiled
    if q.finished[agent] < q.granted[agent] or q.granted[agent] == q.queued[agent]:
        return False
    move = move_at(q, agent, q.granted[agent])
    cell = q.state_cell[q.move_to[move]]
    leader = q.holder[cell]
    # An agent that turns holds its cell itself, and follows nobody.
    if leader == NOBODY or not _is_straight(q, move, heading) or q.finished[leader] == q.granted[leader]:
        return False
    away = move_at(q, leader, q.finished[leader])
    if q.state_cell[q.move_from[away]] != cell or not _is_straight(q, away, heading):
        return False
    if heading[q.move_from[away]] != heading[q.move_from[move]]:
        return False
    for k in range(q.swept_ptr[move], q.swept_ptr[move + 1]):
        swept = q.swept_cell[k]
        if q.visit_agent[q.line_first[swept]] != agent:
            return False
        if swept != cell and q.holder[swept] != NOBODY and q.holder[swept] != agent:
            return False
    return True


@njit(cache=True, nogil=True)
def _is_straight(q: Queues, move: int, heading: Headings) -> bool:  # pragma: no cover - compiled
    origin, target = q.move_from[move], q.move_to[move]
    straight: bool = q.state_cell[origin] != q.state_cell[target] and heading[origin] == heading[target]
    return straight
