"""The search of multi-step PIBT: operations are ranked by what they leave to do, taken, and taken away from others."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planners.mapf.arrays import BoolArray, Distances, FloatArray, IntArray, SmallIntArray
from planners.mapf.chance import Chance, draw_below, mixed
from planners.mapf.kernel import Int, inlined, kernel
from planners.mapf.multi_step.operations import Operations
from planners.mapf.problem import NOBODY

SEVERAL = -2
"""More than one agent, which nobody can push at once."""
FAR = 2**20
"""More than any operation costs."""
UNRANKED = -1
_COST_BIT = 10
"""An operation's key: what is left to do behind it; then how late its last move is; then chance."""
_LATE_BIT = 6
_LUCK_BIT = np.uint64(64 - _LATE_BIT)
_PASSED_OF_TEN = 3
"""Of ten pushes that a round of improvement could make, those it passes over, so that an agent that is asked again
tries other chains."""


class Look(NamedTuple):
    """Where to look up what is left to do; S states.

    The cost from state s to the goal of row r is the least `ahead[k] + scale * table[r, key[k]]` over
    ptr[s] <= k < ptr[s + 1].
    """

    ptr: IntArray
    key: IntArray
    ahead: IntArray
    scale: int


class Costs(NamedTuple):
    """What is left to do from each state, for many goals."""

    table: Distances
    """Shape (goals, keys)."""
    look: Look


class Wishes(NamedTuple):
    """Where each agent wants to go, one entry per agent."""

    row: IntArray
    """Row of its goal in the table, -1 = rather stay."""
    cell: IntArray
    """Cell of the goal, if the agent goes on from there; -1 = it stays there."""
    next_row: IntArray
    """Row of the goal after that, -1 = none."""
    onward: IntArray
    """Cost from the goal to the next one."""


def wishes_to_stay(row: IntArray) -> Wishes:
    """Wishes of agents that go to a goal and stay there; row of each goal in the table, -1 = none, shape (n,)."""
    nowhere = np.full(len(row), -1, dtype=np.int32)
    return Wishes(row=row, cell=nowhere, next_row=nowhere, onward=np.zeros(len(row), dtype=np.int32))


class Aims(NamedTuple):
    """What makes one operation better than another."""

    table: Distances
    """What is left to do, shape (goals, keys)."""
    behind: Look
    """Where to look behind each operation, in whose last timesteps, of rest, the robot may turn; one entry each."""
    wishes: Wishes
    reach: int
    """Cost beyond which no operation comes to its goal."""
    crowd: IntArray
    """What it costs more to end in each cell, shape (n_cells,)."""
    salt: np.uint64
    """Decides between operations of an agent that cost the same: a new one in each timestep, whoever ranks them."""
    chance: Chance


class Choices(NamedTuple):
    """Who has chosen which operation, and the room the search needs; n agents, W operations at most, T timesteps."""

    state: IntArray
    """Where each agent stands, shape (n,)."""
    chosen: IntArray
    """Its operation, shape (n,)."""
    at: IntArray
    """Agent in each cell at each timestep, or `NOBODY`, shape (n_cells, T + 1)."""
    key: IntArray
    """Keys of an agent's operations, smallest best, shape (n, W)."""
    order: SmallIntArray
    """Its operations, best first as far as `n_sorted` tells, shape (n, W)."""
    n_sorted: IntArray
    """Operations of each agent that are sorted, `UNRANKED` if it has no keys yet, shape (n,)."""
    place: IntArray
    """Place of each agent in the order of priority, 0 = first, shape (n,)."""
    weight: FloatArray
    """What a unit of cost of each agent counts, shape (n,)."""
    locked: BoolArray
    """Agents that only stay, shape (n,)."""
    eager: BoolArray
    """Agents that look for another operation in this timestep, shape (n,)."""
    stack: IntArray
    """Agents of the chain of pushes, shape (n + 1,), and for each of them:"""
    tried: IntArray
    before: IntArray
    """its operation before,"""
    spent: FloatArray
    """the weighted cost of those who pushed it."""
    mark: IntArray
    """Number of the chain an agent is in, shape (n,)."""
    stamp: IntArray
    """Number of the last chain, shape (1,)."""


@kernel
def begin(ops: Operations, choices: Choices, state_cell: IntArray) -> None:  # pragma: no cover - compiled
    """Let everybody stay."""
    for cell in range(choices.at.shape[0]):
        for t in range(choices.at.shape[1]):
            choices.at[cell, t] = NOBODY
    for agent in range(len(choices.state)):
        choices.chosen[agent] = ops.ptr[choices.state[agent]]
        for t in range(choices.at.shape[1]):
            choices.at[state_cell[choices.state[agent]], t] = agent


@kernel
def lock(ops: Operations, choices: Choices, locked: BoolArray, state_cell: IntArray) -> None:  # pragma: no cover
    """Say who does not move; who was about to is stopped, and then everybody decides anew."""
    stopped = False
    for agent in range(len(locked)):
        choices.locked[agent] = locked[agent]
        stopped |= locked[agent] and choices.chosen[agent] != ops.ptr[choices.state[agent]]
    if stopped:
        begin(ops, choices, state_cell)


@kernel
def go_on(ops: Operations, choices: Choices, after: IntArray) -> None:  # pragma: no cover
    """Let a timestep pass: agents stand in `after`, and what was left of their operations goes on with a wait.

    What is left of operations free of conflicts is free of conflicts, and who waits where it ends has that cell alone.
    """
    at, last = choices.at, choices.at.shape[1] - 1
    for agent in range(len(after)):
        _lift_beside(ops, at, choices.chosen[agent])
    for cell in range(len(at)):
        for t in range(last):
            at[cell, t] = at[cell, t + 1]
    for agent in range(len(after)):
        choices.state[agent] = after[agent]
        op = ops.then[choices.chosen[agent]]
        choices.chosen[agent] = op if op >= 0 else ops.ptr[after[agent]]
        _place_beside(ops, at, agent, choices.chosen[agent])


@kernel
def left(costs: Costs, state: Int, row: Int) -> Int:  # pragma: no cover - compiled
    """What is left to do from a state."""
    best = FAR
    for k in range(costs.look.ptr[state], costs.look.ptr[state + 1]):
        best = min(best, costs.look.ahead[k] + costs.look.scale * np.int64(costs.table[row, costs.look.key[k]]))
    return best


@kernel
def reconsider(ops: Operations, choices: Choices, patience: Int) -> None:  # pragma: no cover - compiled
    """Forget what operations were worth; agents that rest for `patience` timesteps behind theirs look for another."""
    for agent in range(len(choices.state)):
        choices.n_sorted[agent] = UNRANKED
        choices.eager[agent] = ops.ending[choices.chosen[agent], 1] >= patience and not choices.locked[agent]


@kernel
def rank(ops: Operations, choices: Choices, aims: Aims, begin: Int, end: Int) -> None:  # pragma: no cover - compiled
    """Rank the operations of the eager ones among agents `begin` to `end` - 1."""
    for agent in range(begin, end):
        if choices.eager[agent]:
            _rank(ops, choices, aims, agent)


@kernel
def _rank(ops: Operations, choices: Choices, aims: Aims, agent: Int) -> None:  # pragma: no cover - compiled
    """Compute the keys of an agent's operations: what is left to do behind each; all take the same time."""
    length = ops.cell.shape[1]
    table, behind, wishes = aims.table, aims.behind, aims.wishes
    first = ops.ptr[choices.state[agent]]
    row = wishes.row[agent]
    choices.n_sorted[agent] = 0
    luck = mixed(aims.salt + np.uint64(agent))
    # Only who is near may pass its goal; all others need not look at the cells of their operations.
    near = row >= 0 and wishes.cell[agent] >= 0 and _left_behind(table, behind, first, row) <= aims.reach
    for op in range(first, ops.ptr[choices.state[agent] + 1]):
        at_row, total = row, np.int64(0)
        if row >= 0:
            total = np.int64(wishes.onward[agent])
            for t in range(length if near else 0):
                if ops.cell[op, t] == wishes.cell[agent]:
                    at_row, total = wishes.next_row[agent], np.int64(t)
                    break
        if at_row >= 0:
            total += _left_behind(table, behind, op, at_row)
        total += aims.crowd[ops.cell[op, length - 1]]
        k = op - first
        choices.order[agent, k] = k
        choices.key[agent, k] = (
            (total << _COST_BIT) + (np.int64(length - ops.ending[op, 1]) << _LATE_BIT) + np.int64(luck >> _LUCK_BIT)
        )
        luck = mixed(luck)


@inlined
def _left_behind(table: Distances, behind: Look, op: Int, row: Int) -> Int:  # pragma: no cover - compiled
    """What an operation leaves to do."""
    best = FAR
    for k in range(behind.ptr[op], behind.ptr[op + 1]):
        best = min(best, behind.ahead[k] + behind.scale * np.int64(table[row, behind.key[k]]))
    return best


@kernel
def sweep(
    ops: Operations,
    choices: Choices,
    aims: Aims,
    sequence: IntArray,
    most_tries: Int,
    state_cell: IntArray,
    allow_rotation: bool,
) -> None:  # pragma: no cover - compiled
    """Offer each eager agent a better operation, in order of priority; it may push all who come after it."""
    for k in range(len(sequence)):
        if choices.eager[sequence[k]]:
            _push(ops, choices, aims, sequence[k], k, most_tries, state_cell, allow_rotation, False)


@kernel
def draw_agents(choices: Choices, chance: Chance, drawn: IntArray) -> None:  # pragma: no cover - compiled
    """Draw agents for a round of improvement, with repetition; the eager ones are then those who have no keys yet."""
    choices.eager[:] = False
    for k in range(len(drawn)):
        agent = draw_below(chance, len(choices.state))
        drawn[k] = agent
        choices.eager[agent] = choices.n_sorted[agent] == UNRANKED and not choices.locked[agent]


@kernel
def polish(
    ops: Operations,
    choices: Choices,
    aims: Aims,
    drawn: IntArray,
    most_tries: Int,
    state_cell: IntArray,
    allow_rotation: bool,
) -> None:  # pragma: no cover - compiled
    """Offer agents a better operation wherever that, weighted, costs the others no more than it gains."""
    for agent in drawn:
        if not choices.locked[agent]:
            _push(ops, choices, aims, agent, 0, most_tries, state_cell, allow_rotation, True)


@kernel
def first_states(
    ops: Operations, choices: Choices, costs: Costs, wishes: Wishes, after: IntArray
) -> None:  # pragma: no cover - compiled
    """Where each agent stands after the first timestep; who stays may turn to where its way goes on."""
    for agent in range(len(after)):
        state = choices.state[agent]
        after[agent] = state
        if ops.first[choices.chosen[agent]] >= 0:
            after[agent] = ops.first[choices.chosen[agent]]
        elif wishes.row[agent] >= 0 and not choices.locked[agent]:
            best = FAR
            for turn in range(ops.turn_ptr[state], ops.turn_ptr[state + 1]):
                cost = ops.turn_steps[turn] + left(costs, ops.turn_state[turn], wishes.row[agent])
                if cost <= best:  # a turn that must be made anyway is made while there is nothing else to do
                    best = cost
                    after[agent] = ops.turn_first[turn]


@kernel
def _nth(choices: Choices, agent: Int, n: Int, n_ops: Int) -> Int:  # pragma: no cover - compiled
    """An agent's n-th best operation; sorted only as far as somebody asked."""
    while choices.n_sorted[agent] <= n:
        first = choices.n_sorted[agent]
        best = first
        for k in range(first + 1, n_ops):
            if choices.key[agent, choices.order[agent, k]] < choices.key[agent, choices.order[agent, best]]:
                best = k
        chosen = choices.order[agent, best]
        choices.order[agent, best] = choices.order[agent, first]
        choices.order[agent, first] = chosen
        choices.n_sorted[agent] = first + 1
    return np.int64(choices.order[agent, n])


@kernel
def _in_the_way(ops: Operations, at: IntArray, agent: Int, op: Int, home: Int) -> Int:  # pragma: no cover
    """The one agent whose operation is in conflict with this one, `NOBODY`, or `SEVERAL`."""
    found = NOBODY
    before = home
    for t in range(ops.cell.shape[1]):
        cell = ops.cell[op, t]
        other = at[cell, t + 1]
        if other != NOBODY and other != agent and other != found:  # noqa: PLR1714
            if found != NOBODY:
                return SEVERAL
            found = other
        if cell != before:
            other = at[cell, t]
            if other != NOBODY and other != agent and other != found and at[before, t + 1] == other:  # noqa: PLR1714
                if found != NOBODY:
                    return SEVERAL
                found = other
        before = cell
    for k in range(ops.beside_ptr[op], ops.beside_ptr[op + 1]):
        for t in range(ops.beside_time[k], ops.beside_time[k] + 2):
            other = at[ops.beside_cell[k], t]
            if other != NOBODY and other != agent:  # noqa: PLR1714
                if t == 0 or (found != NOBODY and found != other):  # noqa: PLR1714
                    return SEVERAL  # whoever stands there now cannot be made to have stood elsewhere
                found = other
    return found


@kernel
def _closes_ring(
    ops: Operations, choices: Choices, agent: Int, op: Int, state_cell: IntArray
) -> bool:  # pragma: no cover - compiled
    """Whether in some timestep the agent would follow somebody who follows ... who follows the agent."""
    before = state_cell[choices.state[agent]]
    for t in range(ops.cell.shape[1]):
        cell = ops.cell[op, t]
        at = cell
        for _ in range(len(choices.state)):
            ahead = choices.at[at, t]
            if cell == before or ahead == NOBODY or ahead == agent:  # noqa: PLR1714, SIM109
                break
            to = ops.cell[choices.chosen[ahead], t]
            if to == at or choices.at[to, t + 1] != ahead:
                break
            at = to
            if at == before:
                return True
        before = cell
    return False


@kernel
def _place(ops: Operations, choices: Choices, agent: Int, op: Int) -> None:  # pragma: no cover - compiled
    for t in range(ops.cell.shape[1]):
        choices.at[ops.cell[op, t], t + 1] = agent
    _place_beside(ops, choices.at, agent, op)


@kernel
def _lift(ops: Operations, choices: Choices, agent: Int) -> None:  # pragma: no cover - compiled
    op = choices.chosen[agent]
    for t in range(ops.cell.shape[1]):
        choices.at[ops.cell[op, t], t + 1] = NOBODY
    _lift_beside(ops, choices.at, op)


@kernel
def _place_beside(ops: Operations, at: IntArray, agent: Int, op: Int) -> None:  # pragma: no cover - compiled
    for k in range(ops.beside_ptr[op], ops.beside_ptr[op + 1]):
        at[ops.beside_cell[k], ops.beside_time[k]] = agent
        at[ops.beside_cell[k], ops.beside_time[k] + 1] = agent


@kernel
def _lift_beside(ops: Operations, at: IntArray, op: Int) -> None:  # pragma: no cover - compiled
    for k in range(ops.beside_ptr[op], ops.beside_ptr[op + 1]):
        at[ops.beside_cell[k], ops.beside_time[k]] = NOBODY
        at[ops.beside_cell[k], ops.beside_time[k] + 1] = NOBODY


@kernel
def _join(ops: Operations, choices: Choices, depth: Int, agent: Int, price: float) -> None:  # pragma: no cover
    """Make an agent the end of the chain: it gives its operation up and must find another."""
    choices.stack[depth] = agent
    choices.tried[depth] = 0
    choices.before[depth] = choices.chosen[agent]
    choices.spent[depth] = price
    choices.mark[agent] = choices.stamp[0]
    _lift(ops, choices, agent)


@kernel
def _push(
    ops: Operations,
    choices: Choices,
    aims: Aims,
    root: Int,
    bound: Int,
    most_tries: Int,
    state_cell: IntArray,
    allow_rotation: bool,
    frugal: bool,
) -> bool:  # pragma: no cover - compiled
    """Try to give an agent a better operation. Whoever is in its way must find another one, at most one at each step.

    With `frugal` the chain as a whole must not lose: moves to the side lead out of local optima. Otherwise agents from
    place `bound` on pay whatever it takes.

    Returns:
        Whether it has a better operation now; if not, nothing has changed.
    """
    choices.stamp[0] += 1
    _join(ops, choices, 0, root, 0.0)
    depth, tries = 0, 0
    while depth >= 0:
        agent = choices.stack[depth]
        first = ops.ptr[choices.state[agent]]
        n_ops = ops.ptr[choices.state[agent] + 1] - first
        home = state_cell[choices.state[agent]]
        if choices.n_sorted[agent] == UNRANKED:
            _rank(ops, choices, aims, agent)
        key_before = choices.key[agent, choices.before[depth] - first]
        pushed, settled = NOBODY, False
        while choices.tried[depth] < n_ops and tries < most_tries:
            k = _nth(choices, agent, choices.tried[depth], n_ops)
            choices.tried[depth] += 1
            tries += 1
            op = first + k
            key = choices.key[agent, k]
            change = (key >> _COST_BIT) - (key_before >> _COST_BIT)
            price = choices.spent[depth]
            if frugal:
                price += choices.weight[agent] * change
            # The root itself must gain; where the chain must not lose, a move made earlier is gain enough.
            dear = price > 0.0 if frugal else depth == 0 and change >= 0
            if dear or (depth == 0 and key >= key_before):
                choices.tried[depth] = n_ops  # all others are worse
                break
            if op == choices.before[depth]:
                continue
            other = _in_the_way(ops, choices.at, agent, op, home)
            if other == SEVERAL:
                continue
            if other != NOBODY:
                fixed = choices.locked[other] or (not frugal and choices.place[other] < bound)
                if fixed or choices.mark[other] == choices.stamp[0]:
                    continue
                if frugal and draw_below(aims.chance, 10) < _PASSED_OF_TEN:
                    continue
            if not allow_rotation and _closes_ring(ops, choices, agent, op, state_cell):
                continue
            pushed = other
            if pushed != NOBODY:
                depth += 1
                _join(ops, choices, depth, pushed, price)
            _place(ops, choices, agent, op)
            choices.chosen[agent] = op
            settled = pushed == NOBODY
            break
        if settled:
            return True
        if pushed == NOBODY:
            # Nothing fits: it gets its operation back, and who pushed it tries on.
            if depth > 0:
                _lift(ops, choices, choices.stack[depth - 1])
            choices.chosen[agent] = choices.before[depth]
            _place(ops, choices, agent, choices.chosen[agent])
            choices.mark[agent] = 0
            depth -= 1
    return False
