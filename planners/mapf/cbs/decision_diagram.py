"""Decision diagram: all cheapest paths of one agent under bans, as layers of states, one layer per timestep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from maps.lane_graph import LaneGraph
from planners.mapf.distance_table import UNREACHABLE
from planners.mapf.problem import BoolArray, IntArray


class Does(IntEnum):
    """What an agent can be banned from."""

    STAND = 0
    """In `cell` at timestep t."""
    ENTER = 1
    """From `cell` to `next_cell` between t and t + 1."""
    SWEEP = 2
    """Over `cell` on the way between t and t + 1, neither from it nor to it."""


STAND, ENTER, SWEEP = Does


class Fact(NamedTuple):
    """Something that an agent does on its path, and may be banned from."""

    does: int
    timestep: int
    cell: int
    next_cell: int
    """-1 unless it enters one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Seeker:
    """One agent of an instance, as the search for its paths sees it."""

    start: int
    goal: int
    """Negative = anywhere."""
    stay: bool
    """The goal is never left again once it is entered."""
    may_move: BoolArray
    """Moves it may use, shape (M,)."""
    distance: npt.NDArray[np.integer]
    """Timesteps to the goal from every state, shape (S,); not read without a goal."""
    farthest: int
    """The greatest of them that is finite."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagram:
    """The cheapest paths of one agent."""

    cost: int
    """Timesteps until it stands still for good."""
    states: IntArray
    """One of the paths, shape (cost + 1,)."""
    moves: IntArray
    """Its moves, shape (cost,), -1 = wait."""
    layers: BoolArray
    """States that a cheapest path passes at each timestep, shape (cost + 1, S)."""

    def forced(self, graph: LaneGraph, fact: Fact) -> bool:
        """Whether every cheapest path does this, so that a ban would cost something."""
        now = np.flatnonzero(self.layers[min(fact.timestep, self.cost)])
        if fact.does != SWEEP and (graph.state_cell[now] != fact.cell).any():
            return False
        if fact.does == STAND:
            return True
        if fact.timestep >= self.cost:
            return False
        later = self.layers[fact.timestep + 1]
        if fact.does == ENTER:
            return bool((graph.state_cell[np.flatnonzero(later)] == fact.next_cell).all())
        for state in now.tolist():
            if later[state]:
                return False
            for move in graph.out_move[graph.out_ptr[state] : graph.out_ptr[state + 1]].tolist():
                if later[graph.move_to[move]] and not _sweeps_beside(graph, move, fact.cell):
                    return False
        return True


def _sweeps_beside(graph: LaneGraph, move: int, cell: int) -> bool:
    ends = graph.state_cell[graph.move_from[move]], graph.state_cell[graph.move_to[move]]
    return cell not in ends and cell in graph.swept_cell[graph.swept_ptr[move] : graph.swept_ptr[move + 1]]


def draw(
    graph: LaneGraph, seeker: Seeker, bans: Sequence[Fact], others: Sequence[IntArray], *, least: int = 0
) -> Diagram | None:
    """Find the cheapest paths of an agent.

    Args:
        graph: Lane graph.
        seeker: The agent.
        bans: What it must not do.
        others: States of the other agents from timestep 0 until they stand still; of the cheapest paths the one that
            meets them least is taken.
        least: No path costs less, as is known from fewer bans.

    Returns:
        The diagram, or None if the bans leave no path.
    """
    table = np.array(sorted(bans, key=lambda ban: ban.timestep), dtype=np.int32).reshape(-1, 4)
    last = int(table[-1, 1]) + 1 if len(table) else 0
    first_ban = np.searchsorted(table[:, 1], np.arange(last + 2)).astype(np.int32)
    rows = max(map(len, others), default=0)
    met = np.full((rows, len(others)), -1, dtype=np.int32)
    for k, path in enumerate(others):
        met[: len(path), k] = graph.state_cell[path]
        met[len(path) :, k] = met[len(path) - 1, k]
    if seeker.goal >= 0:
        stands = (table[:, 0] == STAND) & (table[:, 2] == graph.state_cell[seeker.goal])
        least = max(least, int(seeker.distance[seeker.start]), int(table[stands, 1].max(initial=-1)) + 1)
    if least >= UNREACHABLE or (table[:, :3] == (STAND, 0, graph.state_cell[seeker.start])).all(axis=1).any():
        return None
    # Once no ban is left in force, the goal is at most the farthest state away.
    for cost in range(least, last + seeker.farthest + 1):
        found, states, moves, layers = _layers(
            graph.out_ptr,
            graph.out_move,
            graph.move_to,
            graph.state_cell,
            graph.swept_ptr,
            graph.swept_cell,
            seeker.may_move,
            seeker.distance,
            table,
            first_ban,
            met,
            graph.n_cells,
            seeker.start,
            seeker.goal,
            seeker.stay,
            cost,
        )
        if found:
            return Diagram(cost=cost, states=states, moves=moves, layers=layers)
    return None


@njit(cache=True, nogil=True)
def _banned(
    move: int,
    here: int,
    there: int,
    t: int,
    swept_ptr: IntArray,
    swept_cell: IntArray,
    bans: IntArray,
    first_ban: IntArray,
) -> bool:  # pragma: no cover - compiled
    """Whether a step between t and t + 1 is banned; move -1 = wait."""
    last = len(first_ban) - 1
    for k in range(first_ban[min(t, last)], first_ban[min(t + 1, last)]):
        if bans[k, 0] == ENTER and bans[k, 2] == here and bans[k, 3] == there:
            return True
        if bans[k, 0] == SWEEP and move >= 0 and bans[k, 2] != here and bans[k, 2] != there:
            for i in range(swept_ptr[move], swept_ptr[move + 1]):
                if swept_cell[i] == bans[k, 2]:
                    return True
    for k in range(first_ban[min(t + 1, last)], first_ban[min(t + 2, last)]):
        if bans[k, 0] == STAND and bans[k, 2] == there:
            return True
    return False


@njit(cache=True, nogil=True)
def _meetings(here: int, there: int, t: int, met: IntArray) -> int:  # pragma: no cover - compiled
    """Other agents that a step between t and t + 1 runs into or swaps with."""
    if len(met) == 0:
        return 0
    now, after = min(t, len(met) - 1), min(t + 1, len(met) - 1)
    count = 0
    for k in range(met.shape[1]):
        if met[after, k] == there or (here != there and met[now, k] == there and met[after, k] == here):
            count += 1
    return count


@njit(cache=True, nogil=True)
def _layers(
    out_ptr: IntArray,
    out_move: IntArray,
    move_to: IntArray,
    state_cell: IntArray,
    swept_ptr: IntArray,
    swept_cell: IntArray,
    may_move: BoolArray,
    distance: npt.NDArray[np.integer],
    bans: IntArray,
    first_ban: IntArray,
    met: IntArray,
    n_cells: int,
    start: int,
    goal: int,
    stay: bool,
    cost: int,
) -> tuple[bool, IntArray, IntArray, BoolArray]:  # pragma: no cover - compiled
    """All paths that stand still for good after exactly `cost` timesteps.

    This is what A* in space and time expands with f <= cost: forward, whatever can still arrive in time, with the
    path that meets fewest others; backward, whatever does arrive.
    """
    n_states = len(state_cell)
    alive = np.zeros((cost + 1, n_states), dtype=np.bool_)
    via = np.empty((cost + 1, n_states), dtype=np.int32)
    origin = np.empty((cost + 1, n_states), dtype=np.int32)
    meets = np.zeros((cost + 1, n_states), dtype=np.int32)
    states = np.empty(cost + 1, dtype=np.int32)
    moves = np.empty(cost, dtype=np.int32)
    alive[0, start] = True
    for t in range(cost):
        for s in range(n_states):
            if not alive[t, s] or (stay and s == goal):
                continue
            here = state_cell[s]
            for k in range(out_ptr[s] - 1, out_ptr[s + 1]):
                move, after = -1, s
                if k >= out_ptr[s]:
                    move = out_move[k]
                    after = move_to[move]
                    if not may_move[move]:
                        continue
                there = state_cell[after]
                if goal >= 0 and t + 1 + distance[after] > cost:
                    continue
                if _banned(move, here, there, t, swept_ptr, swept_cell, bans, first_ban):
                    continue
                meetings = meets[t, s] + _meetings(here, there, t, met)
                if not alive[t + 1, after] or meetings < meets[t + 1, after]:
                    alive[t + 1, after] = True
                    via[t + 1, after] = move
                    origin[t + 1, after] = s
                    meets[t + 1, after] = meetings

    # The last layer keeps what may stand still from now on.
    free_from = np.zeros(n_cells, dtype=np.int32)
    for k in range(len(bans)):
        if bans[k, 0] == STAND:
            free_from[bans[k, 2]] = max(free_from[bans[k, 2]], bans[k, 1] + 1)
    best = -1
    for s in range(n_states):
        if alive[cost, s]:
            alive[cost, s] = (goal < 0 or s == goal) and cost >= free_from[state_cell[s]]
            if alive[cost, s] and (best < 0 or meets[cost, s] < meets[cost, best]):
                best = s
    if best < 0:
        return False, states, moves, alive
    states[cost] = best
    for t in range(cost, 0, -1):
        moves[t - 1] = via[t, states[t]]
        states[t - 1] = origin[t, states[t]]

    _trim(out_ptr, out_move, move_to, state_cell, swept_ptr, swept_cell, may_move, bans, first_ban, goal, stay, alive)
    return True, states, moves, alive


@njit(cache=True, nogil=True)
def _trim(
    out_ptr: IntArray,
    out_move: IntArray,
    move_to: IntArray,
    state_cell: IntArray,
    swept_ptr: IntArray,
    swept_cell: IntArray,
    may_move: BoolArray,
    bans: IntArray,
    first_ban: IntArray,
    goal: int,
    stay: bool,
    alive: BoolArray,
) -> None:  # pragma: no cover - compiled
    """Take out of the layers whatever does not lead to the last one."""
    for t in range(len(alive) - 2, -1, -1):
        for s in range(len(state_cell)):
            if not alive[t, s]:
                continue
            here = state_cell[s]
            arrives = False
            for k in range(out_ptr[s] - 1, out_ptr[s + 1]):
                move, after = -1, s
                if k >= out_ptr[s]:
                    move = out_move[k]
                    after = move_to[move]
                    if not may_move[move]:
                        continue
                if alive[t + 1, after] and not (stay and s == goal):
                    there = state_cell[after]
                    if not _banned(move, here, there, t, swept_ptr, swept_cell, bans, first_ban):
                        arrives = True
                        break
            alive[t, s] = arrives
