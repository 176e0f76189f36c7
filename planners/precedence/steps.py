"""Steps: the moves that a plan makes, refused where no order of execution could make them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from maps.lane_graph import LaneGraph
from planners.precedence.arrays import IndexArray, IntArray
from planners.precedence.errors import CyclicPlanError, IllegalPlanError

_NO_STATE, _ONE_CELL, _NO_MOVE = 1, 2, 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Steps:
    """All moves of a plan, by timestep and then by agent; waits are left out."""

    timestep: IndexArray
    """Row of the plan the move starts from, shape (k,)."""
    agent: IndexArray
    """Shape (k,)."""
    move: IndexArray
    """Move of the lane graph, shape (k,)."""


def legal_steps(graph: LaneGraph, states: IntArray) -> Steps:
    """Read the moves out of a plan.

    Args:
        graph: Lane graph.
        states: State of each agent at each timestep, shape (T + 1, n).

    Raises:
        IllegalPlanError: A state does not exist, a step is no move of the graph, or two agents share a cell.
        CyclicPlanError: A closed ring of followers, two agents that swap included.
    """
    room = max(len(states) - 1, 0) * states.shape[1]
    timestep, agent, move = (np.empty(room, dtype=np.intp) for _ in range(3))
    fault, n = _read(
        states, graph.state_cell, graph.out_ptr, graph.out_move, graph.move_to, graph.n_cells, timestep, agent, move
    )
    if fault:
        raise _refusal(fault, graph, states, *divmod(n, states.shape[1]))
    steps = Steps(timestep=timestep[:n], agent=agent[:n], move=move[:n])
    _check_rings(graph, states, steps)
    return steps


def _refusal(fault: int, graph: LaneGraph, states: IntArray, t: int, agent: int) -> IllegalPlanError:
    """What to say of the first fault of a kind, that of an agent in a row of the plan."""
    if fault == _NO_STATE:
        return IllegalPlanError(
            t - 1, f"plan: agent {agent} at timestep {t} in state {states[t, agent]}; valid: 0..{graph.n_states - 1}"
        )
    if fault == _ONE_CELL:
        cell = int(graph.state_cell[states[t, agent]])
        agents = np.flatnonzero(graph.state_cell[states[t]] == cell).tolist()
        return IllegalPlanError(
            t - 1, f"plan: agents {agents} at timestep {t} all in cell {cell}; valid: one agent per cell"
        )
    return IllegalPlanError(
        t,
        f"plan: agent {agent} at timestep {t} steps from state {states[t, agent]} to {states[t + 1, agent]}; "
        "valid: a move of the lane graph",
    )


def _check_rings(graph: LaneGraph, states: IntArray, steps: Steps) -> None:
    t, first = _ring(states, graph.state_cell, graph.n_cells, steps.timestep, steps.agent)
    if t < 0:
        return
    before, after = graph.state_cell[states[t]], graph.state_cell[states[t + 1]]
    members = [first]
    while (follows := int(np.flatnonzero(before == after[members[-1]])[0])) != first:
        members.append(follows)
    raise CyclicPlanError(t, members)


@njit(cache=True, nogil=True)
def _read(  # pragma: no cover - compiled
    states: IntArray,
    state_cell: IntArray,
    out_ptr: IntArray,
    out_move: IntArray,
    move_to: IntArray,
    n_cells: int,
    timestep: IndexArray,
    agent: IndexArray,
    move: IndexArray,
) -> tuple[int, int]:
    """Fill in the steps; returns 0 and their number, or the kind of a fault and the entry of the plan that has it."""
    rows, n = states.shape
    for t in range(rows):
        for k in range(n):
            if states[t, k] < 0 or states[t, k] >= len(state_cell):
                return _NO_STATE, t * n + k
    agents_in = np.zeros(n_cells, np.int32)
    for t in range(rows):
        # Most agents wait: only the cells of those that have moved are looked at.
        if t > 0:
            for k in range(n):
                if states[t, k] != states[t - 1, k]:
                    agents_in[state_cell[states[t - 1, k]]] -= 1
        shared = -1
        for k in range(n):
            if t > 0 and states[t, k] == states[t - 1, k]:
                continue
            cell = state_cell[states[t, k]]
            agents_in[cell] += 1
            if agents_in[cell] > 1 and (shared < 0 or cell < state_cell[states[t, shared]]):
                shared = k
        if shared >= 0:
            return _ONE_CELL, t * n + shared
    count = 0
    for t in range(rows - 1):
        for k in range(n):
            origin, target = states[t, k], states[t + 1, k]
            if origin == target:
                continue
            found = -1
            for out in range(out_ptr[origin], out_ptr[origin + 1]):
                if move_to[out_move[out]] == target:
                    found = out_move[out]
            if found < 0:
                return _NO_MOVE, t * n + k
            timestep[count], agent[count], move[count] = t, k, found
            count += 1
    return 0, count


@njit(cache=True, nogil=True)
def _ring(
    states: IntArray, state_cell: IntArray, n_cells: int, timestep: IndexArray, agent: IndexArray
) -> tuple[int, int]:  # pragma: no cover - compiled
    """Find the first closed ring: its timestep and lowest agent, or -1, -1. No two agents share a cell.

    Who enters a cell follows the one that leaves it; turning on the spot follows nobody, and leads nobody.

    Args:
        states: The plan, shape (T + 1, n).
        state_cell: Cell of each state.
        n_cells: Number of cells.
        timestep: Of each step of the plan, ascending.
        agent: Of each step, ascending in each timestep.
    """
    leaver = np.full(n_cells, -1, np.int32)  # the agent that leaves each cell, in the timestep that is looked at
    seen = np.full(states.shape[1], -1, np.int32)
    begin = 0
    while begin < len(agent):
        t, end = timestep[begin], begin
        while end < len(agent) and timestep[end] == t:
            k = agent[end]
            before = state_cell[states[t, k]]
            if state_cell[states[t + 1, k]] != before:
                leaver[before] = k
            end += 1
        for first in agent[begin:end]:
            k = first
            while seen[k] != t:
                seen[k] = t
                after = state_cell[states[t + 1, k]]
                if after == state_cell[states[t, k]]:
                    break
                k = leaver[after]
                if k == first:
                    return t, first
                if k < 0:
                    break
        for k in agent[begin:end]:
            leaver[state_cell[states[t, k]]] = -1
        begin = end
    return -1, -1
