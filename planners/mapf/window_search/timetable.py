"""Timetable of a window: where everybody will be in each of its timesteps, and what that costs them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planners.mapf.arrays import BoolArray, Distances, Int64Array, IntArray
from planners.mapf.kernel import Int, kernel
from planners.mapf.multi_step.multi_step_kernel import Wishes
from planners.mapf.problem import NOBODY
from planners.mapf.roads import Roads

TO_GOAL, TO_NEXT, FREE = 0, 1, 2
"""What an agent is up to: on its way to its goal, to the goal after that, or nothing that is known."""
SIDE_STEP = 1
"""What a move costs that leads an agent without a goal somewhere; a wait costs it nothing."""


class WindowTimetable(NamedTuple):
    """The plan; n agents, T timesteps."""

    path: IntArray
    """State of each agent at each timestep, shape (n, T + 1)."""
    occupant: IntArray
    """Agent in each cell at each timestep, or `NOBODY`, shape (T + 1, n_cells). Who sweeps over a cell beside its way
    is in it before and after that."""
    loss: Int64Array
    """What each agent does beyond a direct way to its goals, in units of cost, shape (n,)."""


class WayCosts(NamedTuple):
    """What ways cost, and where they shall lead; n agents."""

    move_cost: IntArray
    """Cost of each move of the roads."""
    unit: int
    """Cost of a wait."""
    table: Distances
    """What is left to do from each state to each goal, shape (goals, n_states)."""
    wishes: Wishes
    """Where each agent wants to go."""
    stay: BoolArray
    """Whether the agent is immovable once it is at its goal, shape (n,)."""
    locked: BoolArray
    """Agents that do not move, shape (n,)."""


@kernel
def first_leg(ways: WayCosts, agent: Int) -> Int:  # pragma: no cover - compiled
    """What an agent is up to at first."""
    return TO_GOAL if ways.wishes.row[agent] >= 0 else FREE


@kernel
def price_of(ways: WayCosts, agent: Int, leg: Int, state: Int, to: Int, move_cost: Int) -> Int:  # pragma: no cover
    """What a timestep loses, from a state to another or to itself; compiled."""
    if leg == FREE:
        return SIDE_STEP if to != state else 0
    row = ways.wishes.row[agent] if leg == TO_GOAL else ways.wishes.next_row[agent]
    here = np.int64(ways.table[row, state])
    if to == state:
        return 0 if here == 0 and leg == TO_GOAL and ways.wishes.cell[agent] < 0 else np.int64(ways.unit)
    # Where the distances know of fewer moves than there are, one may lead nearer than they say.
    return max(np.int64(move_cost) + np.int64(ways.table[row, to]) - here, np.int64(0))


@kernel
def leg_after(ways: WayCosts, agent: Int, leg: Int, to: Int) -> Int:  # pragma: no cover - compiled
    """What an agent is up to once it is in a state."""
    if leg == TO_GOAL and ways.wishes.cell[agent] >= 0 and ways.table[ways.wishes.row[agent], to] == 0:
        return TO_NEXT if ways.wishes.next_row[agent] >= 0 else FREE
    if leg == TO_NEXT and ways.table[ways.wishes.next_row[agent], to] == 0:
        return FREE
    return leg


@kernel
def loss_of(roads: Roads, ways: WayCosts, table: WindowTimetable, agent: Int) -> Int:  # pragma: no cover - compiled
    """What the path of an agent loses."""
    path = table.path[agent]
    leg, loss = first_leg(ways, agent), np.int64(0)
    for t in range(len(path) - 1):
        state, to = np.int64(path[t]), np.int64(path[t + 1])
        loss += price_of(ways, agent, leg, state, to, ways.move_cost[move_of(roads, state, to)] if to != state else 0)
        leg = leg_after(ways, agent, leg, to)
    return loss


@kernel
def move_of(roads: Roads, state: Int, to: Int) -> Int:  # pragma: no cover - compiled
    """The move from a state to another."""
    for move in range(roads.ptr[state], roads.ptr[state + 1]):
        if roads.to[move] == to:
            return np.int64(move)
    return np.int64(roads.ptr[state])


@kernel
def write(roads: Roads, table: WindowTimetable, agent: Int, who: Int) -> None:  # pragma: no cover - compiled
    """Write somebody, or nobody, wherever the path of an agent leads after the present."""
    path = table.path[agent]
    for t in range(1, len(path)):
        table.occupant[t, roads.cell[path[t]]] = who
        if len(roads.beside) and path[t] != path[t - 1]:
            move = move_of(roads, np.int64(path[t - 1]), np.int64(path[t]))
            for k in range(roads.beside_ptr[move], roads.beside_ptr[move + 1]):
                table.occupant[t, roads.beside[k]] = who
                if t > 1:
                    table.occupant[t - 1, roads.beside[k]] = who


@kernel
def begin(roads: Roads, table: WindowTimetable, states: IntArray) -> None:  # pragma: no cover - compiled
    """Let everybody stay where it stands."""
    for t in range(table.occupant.shape[0]):
        for cell in range(table.occupant.shape[1]):
            table.occupant[t, cell] = NOBODY
    for agent in range(len(states)):
        for t in range(table.path.shape[1]):
            table.path[agent, t] = states[agent]
            table.occupant[t, roads.cell[states[agent]]] = agent


@kernel
def go_on(roads: Roads, table: WindowTimetable) -> None:  # pragma: no cover - compiled
    """Let a timestep pass; the plan goes on with a wait, which hinders nobody where everybody is alone at the end."""
    last = table.path.shape[1] - 1
    for agent in range(len(table.path)):
        table.occupant[0, roads.cell[table.path[agent, 0]]] = NOBODY
        write(roads, table, agent, NOBODY)
    for agent in range(len(table.path)):
        for t in range(last):
            table.path[agent, t] = table.path[agent, t + 1]
        table.occupant[0, roads.cell[table.path[agent, 0]]] = agent
        write(roads, table, agent, agent)


@kernel
def extend(
    roads: Roads, ways: WayCosts, table: WindowTimetable, agent: Int, allow_rotation: bool
) -> None:  # pragma: no cover - compiled
    """Use the last timestep of a path for a move, where it is a wait, a move is better, and its cell is empty."""
    path, last = table.path[agent], table.path.shape[1] - 1
    state = np.int64(path[last])
    if path[last - 1] != state or ways.locked[agent]:
        return
    leg = first_leg(ways, agent)
    for t in range(1, last):
        leg = leg_after(ways, agent, leg, np.int64(path[t]))
    wait = price_of(ways, agent, leg, state, state, 0)
    best, further = wait, np.int64(-1)
    for move in range(roads.ptr[state], roads.ptr[state + 1]):
        to = np.int64(roads.to[move])
        price = price_of(ways, agent, leg, state, to, ways.move_cost[move])
        if price < best and _is_empty(roads, table, last, move, to, agent):
            here, there = np.int64(roads.cell[state]), np.int64(roads.cell[to])
            if allow_rotation or not closes_ring(roads, table, agent, last - 1, here, there):
                best, further = price, to
    if further >= 0:
        write(roads, table, agent, NOBODY)
        path[last] = further
        write(roads, table, agent, agent)
        table.loss[agent] += best - wait


@kernel
def _is_empty(
    roads: Roads, table: WindowTimetable, last: Int, move: Int, to: Int, agent: Int
) -> bool:  # pragma: no cover
    """Whether an agent can make a move in the last timestep without anybody's noticing; compiled."""
    other = table.occupant[last, roads.cell[to]]
    if other != NOBODY and other != agent:  # noqa: PLR1714
        return False
    for k in range(roads.beside_ptr[move], roads.beside_ptr[move + 1]):
        for t in range(last - 1, last + 1):
            other = table.occupant[t, roads.beside[k]]
            if other != NOBODY and other != agent:  # noqa: PLR1714
                return False
    return True


@kernel
def closes_ring(
    roads: Roads, table: WindowTimetable, agent: Int, t: Int, here: Int, there: Int
) -> bool:  # pragma: no cover - compiled
    """Whether somebody who goes from a cell to another follows one who follows ... one who goes where it came from."""
    path, at = table.path, there
    for _ in range(len(path)):
        ahead = np.int64(table.occupant[t, at])
        if at == here or ahead == NOBODY or ahead == agent:  # noqa: PLR1714, SIM109
            break
        to = np.int64(roads.cell[path[ahead, t + 1]])
        if to == at or roads.cell[path[ahead, t]] != at or table.occupant[t + 1, to] != ahead:
            break
        at = to
    return bool(at == here and here != there)
