"""Successors: a next configuration of all agents, drawn by PIBT under constraints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planners.mapf.arrays import BoolArray, Distances, IntArray
from planners.mapf.chance import Chance, draw
from planners.mapf.distance_table import DistanceTable
from planners.mapf.inheritance import (
    PUSHED,
    STUCK,
    UNDECIDED,
    Claims,
    claims_of,
    enter,
    go,
    is_allowed,
    push,
    stay,
)
from planners.mapf.kernel import Int, kernel
from planners.mapf.options import Options
from planners.mapf.problem import NOBODY, Instance
from planners.mapf.roads import Roads, options_of_roads

_WAIT_KEY = 0.4
_OCCUPIED_KEY = 0.2
_NOISE_KEY = 0.39


class Guide(NamedTuple):
    """Who wants to go where, and how far it is."""

    distances: Distances
    """Timesteps to each goal, shape (n_rows, n_states)."""
    row: IntArray
    """Row of `distances` of each agent, -1 = no goal, shape (n,)."""
    goals: IntArray
    """Goal state, -1 = none, shape (n,)."""
    fixed: BoolArray
    stay: BoolArray
    allow_rotation: bool


def guide_of(instance: Instance, tables: DistanceTable) -> Guide:
    """Goals and distances of an instance."""
    distances, row = tables.rows(instance.goals)
    return Guide(
        distances=distances,
        row=row,
        goals=np.array(instance.goals),
        fixed=np.array(instance.fixed),
        stay=np.array(instance.stay),
        allow_rotation=instance.allow_rotation,
    )


class Board(NamedTuple):
    """Working memory of one timestep; between calls all cells are empty."""

    options: Options
    """What agents can aim at: the roads that leave their states, in that order."""
    claims: Claims
    keys: npt.NDArray[np.float64]
    """The lower, the sooner an option is tried; by agent and number, 0 = to wait; shape (n, widest + 1)."""
    first: IntArray
    """Number of the option that an agent tries first, shape (n,)."""
    partner: IntArray
    """With whom an agent trades places, `NOBODY` = none, shape (n,)."""


def board_of(roads: Roads, n: int) -> Board:
    """Working memory for `n` agents."""
    options = options_of_roads(roads)
    return Board(
        options=options,
        claims=claims_of(options, roads.n_cells, n),
        keys=np.empty((n, options.widest + 1)),
        first=np.zeros(n, dtype=np.int32),
        partner=np.full(n, NOBODY, dtype=np.int32),
    )


@kernel
def set_out(roads: Roads, guide: Guide, board: Board, now: IntArray, after: IntArray) -> None:  # pragma: no cover
    """Put all agents on the board; decide those that must not move. Compiled."""
    for agent in range(len(now)):
        enter(board.claims, agent, roads.cell[now[agent]])
        if guide.fixed[agent] or (guide.stay[agent] and now[agent] == guide.goals[agent]):
            stay(board.claims, now, after, agent)


@kernel
def constrain(
    guide: Guide, board: Board, now: IntArray, after: IntArray, agent: Int, to: Int
) -> bool:  # pragma: no cover - compiled
    """Decide an agent's next state; False, with nothing changed, when that contradicts what is decided."""
    claims = board.claims
    if claims.goes[agent] != UNDECIDED:
        return bool(after[agent] == to)
    if to == now[agent]:
        if claims.cells[claims.home[agent], 1] != NOBODY:
            return False
        stay(claims, now, after, agent)
        return True
    return bool(_step_to(guide, board, now, after, agent, to))


@kernel
def _step_to(
    guide: Guide, board: Board, now: IntArray, after: IntArray, agent: Int, to: Int
) -> bool:  # pragma: no cover - compiled
    """Decide for an option that leads to a state, if one is allowed."""
    options, claims = board.options, board.claims
    for option in range(options.aim.shape[1]):
        if options.aim[now[agent], option, 0] == to and is_allowed(
            options, claims, now, agent, option + 1, guide.allow_rotation
        ):
            go(options, claims, now, after, agent, option + 1)
            return True
    return False


@kernel
def complete(
    roads: Roads,
    guide: Guide,
    board: Board,
    now: IntArray,
    after: IntArray,
    order: IntArray,
    chance: Chance,
) -> bool:  # pragma: no cover - compiled
    """Decide everybody who is undecided, in an order; False when the constraints leave somebody no place.

    Priority inheritance with backtracking, and trading places where the roads are two-way: an agent that must let
    another one pass and stands in a corridor leads the way out of it, and pulls the other one along.

    Source: Okumura et al., "Priority Inheritance with Backtracking for Iterative Multi-agent Path Finding", Artificial
    Intelligence 310, 2022, algorithm 1; the trade of places: Okumura, "Improving LaCAM for scalable eventually optimal
    multi-agent pathfinding", IJCAI 2023, section 4, https://arxiv.org/abs/2305.03632.
    """
    claims = board.claims
    for k in range(2 * len(now)):
        agent = np.int64(order[k % len(now)])
        if k < len(now):  # whoever stands where a constrained agent goes must leave, so it chooses first
            if claims.goes[agent] == UNDECIDED:
                continue
            agent = np.int64(claims.cells[claims.goes[agent], 0])
        if agent < 0 or claims.goes[agent] != UNDECIDED:
            continue
        claims.stack[0] = agent
        end, depth = PUSHED, np.int64(0)
        while end == PUSHED:
            _rank(roads, guide, board, now, np.int64(claims.stack[depth]), chance)
            end, depth = push(board.options, claims, board.keys, np.inf, now, after, depth, guide.allow_rotation)
        if end == STUCK:
            return False
        while depth >= 0:  # the whole chain moves; partners close up from its head on
            agent = np.int64(claims.stack[depth])
            if board.partner[agent] != NOBODY and claims.number[agent] == board.first[agent]:
                _pull(guide, board, now, after, agent)
            depth -= 1
    return True


@kernel
def _pull(guide: Guide, board: Board, now: IntArray, after: IntArray, agent: Int) -> None:  # pragma: no cover
    """Let the partner follow into the cell that an agent leaves, if nobody else does. Compiled."""
    claims = board.claims
    partner = np.int64(board.partner[agent])
    if (
        claims.number[agent] > 0
        and claims.goes[partner] == UNDECIDED
        and claims.cells[claims.home[agent], 1] == NOBODY
        and claims.cells[claims.home[partner], 1] == NOBODY
    ):
        _step_to(guide, board, now, after, partner, np.int64(now[agent]))


@kernel
def _rank(
    roads: Roads, guide: Guide, board: Board, now: IntArray, agent: Int, chance: Chance
) -> None:  # pragma: no cover - compiled
    """Give an agent's options their keys, by the distance left after them; backwards where it trades places."""
    _give_keys(guide, board, now, agent, 1.0, chance)
    board.partner[agent] = NOBODY
    wish = np.int64(board.first[agent])
    if roads.two_way and guide.row[agent] >= 0 and wish > 0:
        partner = _partner(roads, guide, board, now, agent, np.int64(board.options.aim[now[agent], wish - 1, 0]))
        if partner >= 0:
            _give_keys(guide, board, now, agent, -1.0, chance)
            board.partner[agent] = partner


@kernel
def _give_keys(
    guide: Guide, board: Board, now: IntArray, agent: Int, sign: float, chance: Chance
) -> None:  # pragma: no cover - compiled
    """Distances are whole numbers; the fractions order equal ones: chance, with a liking for free cells."""
    aim, claims, keys = board.options.aim, board.claims, board.keys
    state = np.int64(now[agent])
    row = guide.row[agent]
    first = 0
    keys[agent, 0] = -1.0 if row < 0 else sign * guide.distances[row, state] + _WAIT_KEY
    for option in range(aim.shape[1]):
        to, cell = np.int64(aim[state, option, 0]), aim[state, option, 1]
        if to < 0:
            keys[agent, option + 1] = np.inf
            continue
        key = _NOISE_KEY * draw(chance)
        if row >= 0:
            key += sign * guide.distances[row, to]
        if cell != claims.home[agent] and claims.cells[cell, 0] != NOBODY:
            key += _OCCUPIED_KEY
        keys[agent, option + 1] = key
        if key < keys[agent, first]:
            first = option + 1
    board.first[agent] = first


@kernel
def _partner(
    roads: Roads, guide: Guide, board: Board, now: IntArray, agent: Int, wish: Int
) -> Int:  # pragma: no cover - compiled
    """Who must trade places with an agent that wants to go to `wish`, and can; -1 = nobody."""
    cells, goes = board.claims.cells, board.claims.goes
    here: Int = np.int64(now[agent])
    pusher: Int
    puller: Int
    for move in range(roads.ptr[here] - 1, roads.ptr[here + 1]):
        if move < roads.ptr[here]:  # the agent itself pushes the one ahead
            other = np.int64(cells[roads.cell[wish], 0])
            if other >= 0 and goes[other] != UNDECIDED:
                continue
            pusher, puller = agent, other
        else:  # it stands in the way of one behind it, and makes room
            behind = np.int64(roads.to[move])
            other = np.int64(cells[roads.cell[behind], 0])
            if behind == wish:
                continue
            pusher, puller = other, agent
        if (
            other >= 0
            and _must_trade(roads, guide, board, pusher, puller, here, wish)
            and _can_trade(roads, guide, board, wish, here)
        ):
            return other
    return -1


@kernel
def _left(guide: Guide, agent: Int, state: Int) -> Int:  # pragma: no cover - compiled
    row = guide.row[agent]
    return np.int64(0) if row < 0 else np.int64(guide.distances[row, state])


@kernel
def _exits(
    roads: Roads, guide: Guide, board: Board, state: Int, without: Int
) -> tuple[Int, Int]:  # pragma: no cover - compiled
    """Ways out of a state but the one to `without` and dead ends that hold whoever belongs there; and one of them."""
    n, last = np.int64(0), np.int64(-1)
    for move in range(roads.ptr[state], roads.ptr[state + 1]):
        to = np.int64(roads.to[move])
        if to == without:
            continue
        holder = board.claims.cells[roads.cell[to], 0]
        if holder >= 0:
            if guide.fixed[holder]:
                continue
            if guide.goals[holder] == to and (guide.stay[holder] or roads.ptr[to + 1] - roads.ptr[to] == 1):
                continue
        n += 1
        last = to
    return n, last


@kernel
def _must_trade(
    roads: Roads, guide: Guide, board: Board, pusher: Int, puller: Int, pusher_at: Int, puller_at: Int
) -> bool:  # pragma: no cover - compiled
    """Whether two agents face each other in a corridor that has no room to pass on the pusher's way."""
    closer = _left(guide, pusher, puller_at) < _left(guide, pusher, pusher_at)
    while closer:
        n, further = _exits(roads, guide, board, puller_at, pusher_at)
        if n >= 2:
            return False
        if n == 0:
            break
        pusher_at, puller_at = puller_at, further
        closer = _left(guide, pusher, puller_at) < _left(guide, pusher, pusher_at)
    at_goal = _left(guide, pusher, pusher_at) == 0
    return bool((closer or at_goal) and _left(guide, puller, pusher_at) < _left(guide, puller, puller_at))


@kernel
def _can_trade(
    roads: Roads, guide: Guide, board: Board, pusher_at: Int, puller_at: Int
) -> bool:  # pragma: no cover - compiled
    """Whether the corridor behind the puller opens somewhere, so that the two can pass each other there."""
    start = pusher_at
    while puller_at != start:
        n, further = _exits(roads, guide, board, puller_at, pusher_at)
        if n >= 2:
            return True
        if n == 0:
            return False
        pusher_at, puller_at = puller_at, further
    return False
