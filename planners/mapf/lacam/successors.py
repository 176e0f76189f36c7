"""Successors: a next configuration of all agents, drawn by PIBT under constraints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planners.mapf.chance import Chance, draw
from planners.mapf.distance_table import Distances, DistanceTable
from planners.mapf.kernel import Int, kernel
from planners.mapf.problem import BoolArray, Instance, IntArray
from planners.mapf.roads import Roads

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

    occupant: IntArray
    """Who stands in a cell before the timestep, -1 = nobody, shape (n_cells,)."""
    taken: IntArray
    """Who stands there after it."""
    crossed: IntArray
    """Who sweeps over it on the way, neither from nor to."""
    options: IntArray
    """Next states of an agent in the order it tries them, shape (n, widest)."""
    option_move: IntArray
    """The move of each option, -1 = wait."""
    n_options: IntArray
    tried: IntArray
    partner: IntArray
    """With whom an agent trades places, -1 = nobody."""
    stack: IntArray
    keys: npt.NDArray[np.float64]


def board_of(roads: Roads, n: int) -> Board:
    """Working memory for `n` agents."""
    widest = int(np.diff(roads.ptr).max(initial=0)) + 1
    return Board(
        occupant=np.full(roads.n_cells, -1, dtype=np.int32),
        taken=np.full(roads.n_cells, -1, dtype=np.int32),
        crossed=np.full(roads.n_cells, -1, dtype=np.int32),
        options=np.empty((n, widest), dtype=np.int32),
        option_move=np.empty((n, widest), dtype=np.int32),
        n_options=np.zeros(n, dtype=np.int32),
        tried=np.zeros(n, dtype=np.int32),
        partner=np.full(n, -1, dtype=np.int32),
        stack=np.empty(n + 1, dtype=np.int32),
        keys=np.empty(widest, dtype=np.float64),
    )


@kernel
def set_out(roads: Roads, guide: Guide, board: Board, now: IntArray, after: IntArray) -> None:  # pragma: no cover
    """Put all agents on the board; decide those that must not move. Compiled."""
    for agent in range(len(now)):
        cell = roads.cell[now[agent]]
        board.occupant[cell] = agent
        if guide.fixed[agent] or (guide.stay[agent] and now[agent] == guide.goals[agent]):
            after[agent] = now[agent]
            board.taken[cell] = agent
        else:
            after[agent] = -1


@kernel
def clear(roads: Roads, board: Board, now: IntArray, after: IntArray) -> None:  # pragma: no cover - compiled
    """Take all agents off the board again."""
    for agent in range(len(now)):
        board.occupant[roads.cell[now[agent]]] = -1
        board.taken[roads.cell[now[agent]]] = -1
        if after[agent] >= 0:
            board.taken[roads.cell[after[agent]]] = -1
    if len(roads.beside):
        for cell in range(roads.n_cells):
            board.crossed[cell] = -1


@kernel
def constrain(
    roads: Roads, guide: Guide, board: Board, now: IntArray, after: IntArray, agent: Int, to: Int
) -> bool:  # pragma: no cover - compiled
    """Decide an agent's next state; False, with nothing changed, when that contradicts what is decided."""
    if after[agent] >= 0:
        return bool(after[agent] == to)
    home = np.int64(roads.cell[now[agent]])
    if to == now[agent]:
        if board.taken[home] != -1:
            return False
        after[agent] = to
        board.taken[home] = agent
        return True
    for move in range(roads.ptr[now[agent]], roads.ptr[now[agent] + 1]):
        if roads.to[move] == to and _allowed(roads, guide, board, agent, home, move, after):
            _go(roads, board, agent, home, move, after)
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
    for k in range(2 * len(now)):
        agent = np.int64(order[k % len(now)])
        if k < len(now):  # whoever stands where a constrained agent goes must leave, so it chooses first
            if after[agent] < 0:
                continue
            agent = np.int64(board.occupant[roads.cell[after[agent]]])
        if agent >= 0 and after[agent] < 0 and not _decide(roads, guide, board, now, after, agent, chance):
            return False
    return True


@kernel
def _decide(
    roads: Roads, guide: Guide, board: Board, now: IntArray, after: IntArray, first: Int, chance: Chance
) -> bool:  # pragma: no cover - compiled
    """Move an agent and everybody it pushes. The chain of pushed agents is an explicit stack."""
    depth = 0
    stack = board.stack
    stack[0] = first
    fresh = True  # the agent on top has no options yet
    while depth >= 0:
        agent = np.int64(stack[depth])
        home = np.int64(roads.cell[now[agent]])
        if fresh:
            fresh = False
            _rank(roads, guide, board, now, after, agent, home, chance)
            board.tried[agent] = 0
        else:  # the pushed agent stays, so take the step back
            move = np.int64(board.option_move[agent, board.tried[agent] - 1])
            after[agent] = -1
            for k in range(roads.beside_ptr[move], roads.beside_ptr[move + 1]):
                board.crossed[roads.beside[k]] = -1
        pushed = -1
        moved = False
        while board.tried[agent] < board.n_options[agent] and not moved:
            move = np.int64(board.option_move[agent, board.tried[agent]])
            board.tried[agent] += 1
            if move < 0:
                if board.taken[home] == -1:
                    after[agent] = now[agent]
                    board.taken[home] = agent
                    moved = True
            elif _allowed(roads, guide, board, agent, home, move, after):
                _go(roads, board, agent, home, move, after)
                moved = True
                cell = roads.cell[roads.to[move]]
                ahead = board.occupant[cell]
                if cell != home and ahead >= 0 and after[ahead] < 0:
                    pushed = ahead
        if pushed >= 0:
            depth += 1
            stack[depth] = pushed
            fresh = True
        elif moved:
            while depth >= 0:  # the whole chain moves; partners close up from its head on
                agent = np.int64(stack[depth])
                if board.partner[agent] >= 0 and board.tried[agent] == 1 and after[agent] != now[agent]:
                    _pull(roads, guide, board, now, after, agent)
                depth -= 1
            return True
        elif depth == 0 and board.taken[home] != -1:
            return False
        else:
            after[agent] = now[agent]
            board.taken[home] = agent
            depth -= 1
    return True


@kernel
def _pull(
    roads: Roads, guide: Guide, board: Board, now: IntArray, after: IntArray, agent: Int
) -> None:  # pragma: no cover - compiled
    """Let the partner follow into the cell that an agent leaves, if nobody else does."""
    partner = np.int64(board.partner[agent])
    home = np.int64(roads.cell[now[agent]])
    if after[partner] >= 0 or board.taken[home] != -1:
        return
    partner_home = np.int64(roads.cell[now[partner]])
    if board.taken[partner_home] != -1:
        return
    for move in range(roads.ptr[now[partner]], roads.ptr[now[partner] + 1]):
        if roads.to[move] == now[agent] and _allowed(roads, guide, board, partner, partner_home, move, after):
            _go(roads, board, partner, partner_home, move, after)
            return


@kernel
def _go(
    roads: Roads, board: Board, agent: Int, home: Int, move: Int, after: IntArray
) -> None:  # pragma: no cover - compiled
    after[agent] = roads.to[move]
    board.taken[roads.cell[roads.to[move]]] = agent
    for k in range(roads.beside_ptr[move], roads.beside_ptr[move + 1]):
        board.crossed[roads.beside[k]] = agent


@kernel
def _allowed(
    roads: Roads, guide: Guide, board: Board, agent: Int, home: Int, move: Int, after: IntArray
) -> bool:  # pragma: no cover - compiled
    """Whether a move agrees with all that is decided so far."""
    to = roads.cell[roads.to[move]]
    if board.taken[to] != -1 or board.crossed[to] != -1:
        return False
    for k in range(roads.beside_ptr[move], roads.beside_ptr[move + 1]):
        cell = roads.beside[k]
        if board.occupant[cell] != -1 or board.taken[cell] != -1 or board.crossed[cell] != -1:
            return False
    ahead = board.occupant[to]
    if to == home or ahead < 0 or after[ahead] < 0:
        return True
    if roads.cell[after[ahead]] == home:
        return False  # swap
    if guide.allow_rotation:
        return True
    while after[ahead] >= 0:  # follow those who follow: a ring comes back to this agent
        beyond = board.occupant[roads.cell[after[ahead]]]
        if beyond == agent:
            return False
        if beyond < 0 or beyond == ahead:
            return True
        ahead = beyond
    return True


@kernel
def _rank(
    roads: Roads, guide: Guide, board: Board, now: IntArray, after: IntArray, agent: Int, home: Int, chance: Chance
) -> None:  # pragma: no cover - compiled
    """Sort an agent's next states, waiting among them, by the distance left after them; backwards to trade places."""
    _sort_options(roads, guide, board, now, agent, home, 1.0, chance)
    board.partner[agent] = -1
    wish = np.int64(board.options[agent, 0])
    if roads.two_way and guide.row[agent] >= 0 and wish != now[agent]:
        partner = _partner(roads, guide, board, now, after, agent, wish)
        if partner >= 0:
            _sort_options(roads, guide, board, now, agent, home, -1.0, chance)
            board.partner[agent] = partner


@kernel
def _sort_options(
    roads: Roads, guide: Guide, board: Board, now: IntArray, agent: Int, home: Int, sign: float, chance: Chance
) -> None:  # pragma: no cover - compiled
    """Distances are whole numbers; the fractions order equal ones: chance, with a liking for free cells."""
    state = np.int64(now[agent])
    row = guide.row[agent]
    keys, options, option_move = board.keys, board.options, board.option_move
    keys[0] = -1.0 if row < 0 else sign * guide.distances[row, state] + _WAIT_KEY
    options[agent, 0] = state
    option_move[agent, 0] = -1
    count = 1
    for move in range(roads.ptr[state], roads.ptr[state + 1]):
        to = np.int64(roads.to[move])
        key = _NOISE_KEY * draw(chance)
        if row >= 0:
            key += sign * guide.distances[row, to]
        if roads.cell[to] != home and board.occupant[roads.cell[to]] != -1:
            key += _OCCUPIED_KEY
        place = count
        while place > 0 and keys[place - 1] > key:
            keys[place] = keys[place - 1]
            options[agent, place] = options[agent, place - 1]
            option_move[agent, place] = option_move[agent, place - 1]
            place -= 1
        keys[place] = key
        options[agent, place] = to
        option_move[agent, place] = move
        count += 1
    board.n_options[agent] = count


@kernel
def _partner(
    roads: Roads, guide: Guide, board: Board, now: IntArray, after: IntArray, agent: Int, wish: Int
) -> Int:  # pragma: no cover - compiled
    """Who must trade places with an agent that wants to go to `wish`, and can; -1 = nobody."""
    here: Int = np.int64(now[agent])
    pusher: Int
    puller: Int
    for move in range(roads.ptr[here] - 1, roads.ptr[here + 1]):
        if move < roads.ptr[here]:  # the agent itself pushes the one ahead
            other = np.int64(board.occupant[roads.cell[wish]])
            if other >= 0 and after[other] >= 0:
                continue
            pusher, puller = agent, other
        else:  # it stands in the way of one behind it, and makes room
            behind = np.int64(roads.to[move])
            other = np.int64(board.occupant[roads.cell[behind]])
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
        holder = board.occupant[roads.cell[to]]
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
