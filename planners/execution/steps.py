"""Steps: the moves that a plan makes, refused where no order of execution could make them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from maps.lane_graph import LaneGraph
from planners.execution.errors import CyclicPlanError, IllegalPlanError

IntArray = npt.NDArray[np.int32]
IndexArray = npt.NDArray[np.intp]


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
    _check_states(graph, states)
    cells = graph.state_cell[states]
    _check_cells(cells)
    timestep, agent = np.nonzero(states[:-1] != states[1:])
    move = _moves(graph, states, timestep, agent)
    _check_rings(cells, timestep, agent, graph.n_cells)
    return Steps(timestep=timestep, agent=agent, move=move)


def _check_states(graph: LaneGraph, states: IntArray) -> None:
    outside = np.argwhere((states < 0) | (states >= graph.n_states))
    if outside.size:
        t, agent = (int(i) for i in outside[0])
        raise IllegalPlanError(
            t - 1, f"plan: agent {agent} at timestep {t} in state {states[t, agent]}; valid: 0..{graph.n_states - 1}"
        )


def _check_cells(cells: IntArray) -> None:
    ordered = np.sort(cells, axis=1)
    twice = np.argwhere(ordered[:, 1:] == ordered[:, :-1])
    if twice.size:
        t, k = (int(i) for i in twice[0])
        cell = int(ordered[t, k])
        agents = np.flatnonzero(cells[t] == cell).tolist()
        raise IllegalPlanError(
            t - 1, f"plan: agents {agents} at timestep {t} all in cell {cell}; valid: one agent per cell"
        )


def _moves(graph: LaneGraph, states: IntArray, timestep: IndexArray, agent: IndexArray) -> IndexArray:
    """Move of each step, shape (k,)."""
    origin, target = states[timestep, agent], states[timestep + 1, agent]
    first, last = graph.out_ptr[origin], graph.out_ptr[origin + 1]
    moves = np.full(len(origin), -1, dtype=np.intp)
    for k in range(int((last - first).max(initial=0))):
        tried = np.flatnonzero(first + k < last)
        candidate = graph.out_move[first[tried] + k]
        hit = graph.move_to[candidate] == target[tried]
        moves[tried[hit]] = candidate[hit]
    wrong = np.flatnonzero(moves < 0)
    if wrong.size:
        k = int(wrong[0])
        raise IllegalPlanError(
            int(timestep[k]),
            f"plan: agent {agent[k]} at timestep {timestep[k]} steps from state {origin[k]} to {target[k]}; "
            "valid: a move of the lane graph",
        )
    return moves


def _check_rings(cells: IntArray, timestep: IndexArray, agent: IndexArray, n_cells: int) -> None:
    """Let every step look ahead to the step it follows, twice as far each time; in a ring this never ends."""
    origin, target = cells[timestep, agent], cells[timestep + 1, agent]
    changes = np.flatnonzero(origin != target)  # turning on the spot follows nobody
    step_at = np.full((len(cells) - 1) * n_cells, -1, dtype=np.intp)  # the step that leaves (timestep, cell)
    step_at[timestep[changes] * n_cells + origin[changes]] = changes
    follows = np.full(len(timestep) + 1, -1, dtype=np.intp)  # the extra last entry is where -1 leads
    follows[changes] = step_at[timestep[changes] * n_cells + target[changes]]
    far = follows
    for _ in range(int(cells.shape[1]).bit_length()):
        if (far < 0).all():
            return
        far = far[far]
    ring = np.flatnonzero(far >= 0)
    if ring.size:
        members = [int(ring[0])]
        while follows[members[-1]] != members[0]:
            members.append(int(follows[members[-1]]))
        raise CyclicPlanError(int(timestep[members[0]]), agent[members].tolist())
