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
from planners.mapf.arrays import BoolArray, IntArray
from planners.mapf.distance_table import UNREACHABLE
from planners.mapf.kernel import kernel
from planners.mapf.lanes import Lanes, lanes_of


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


class Seeker(NamedTuple):
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


class Bans(NamedTuple):
    """What an agent must not do, by timestep."""

    fact: IntArray
    """Facts, shape (k, 4)."""
    first: IntArray
    """Bans of timestep t: fact[first[t]:first[t + 1]], shape (t_max + 2,); none after the last entry."""


class LayerSearch(NamedTuple):
    """Memory of a search for paths of one cost."""

    alive: BoolArray
    """States that paths pass at each timestep, shape (cost + 1, S)."""
    via: IntArray
    """Move that leads there, -1 = wait, on the path that meets fewest others, same shape; and on that path:"""
    origin: IntArray
    """the state before,"""
    meets: IntArray
    """how many others it has met."""
    free_from: IntArray
    """First timestep from which nothing bans standing in each cell, shape (n_cells,)."""


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
    most = last + seeker.farthest
    lanes = lanes_of(graph, seeker.may_move)
    cost, states, moves, layers = _cheapest(lanes, seeker, Bans(table, first_ban), met, graph.n_cells, least, most)
    return Diagram(cost=cost, states=states, moves=moves, layers=layers) if cost <= most else None


@kernel
def _banned(lanes: Lanes, bans: Bans, move: int, here: int, there: int, t: int) -> bool:  # pragma: no cover - compiled
    """Whether a step between t and t + 1 is banned; move -1 = wait."""
    last = len(bans.first) - 1
    for k in range(bans.first[min(t, last)], bans.first[min(t + 1, last)]):
        if bans.fact[k, 0] == ENTER and bans.fact[k, 2] == here and bans.fact[k, 3] == there:
            return True
        if bans.fact[k, 0] == SWEEP and move >= 0 and bans.fact[k, 2] != here and bans.fact[k, 2] != there:
            for i in range(lanes.swept_ptr[move], lanes.swept_ptr[move + 1]):
                if lanes.swept_cell[i] == bans.fact[k, 2]:
                    return True
    for k in range(bans.first[min(t + 1, last)], bans.first[min(t + 2, last)]):
        if bans.fact[k, 0] == STAND and bans.fact[k, 2] == there:
            return True
    return False


@kernel
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
def _cheapest(
    lanes: Lanes, seeker: Seeker, bans: Bans, met: IntArray, n_cells: int, least: int, most: int
) -> tuple[int, IntArray, IntArray, BoolArray]:  # pragma: no cover - compiled
    """The least cost for which there are paths, above `most` for none; one of the paths, its moves, and the layers."""
    n_states = len(lanes.state_cell)
    cost = least
    while True:
        search = LayerSearch(
            np.zeros((cost + 1, n_states), dtype=np.bool_),
            np.empty((cost + 1, n_states), dtype=np.int32),
            np.empty((cost + 1, n_states), dtype=np.int32),
            np.zeros((cost + 1, n_states), dtype=np.int32),
            np.zeros(n_cells, dtype=np.int32),
        )
        states, moves = np.empty(cost + 1, dtype=np.int32), np.empty(cost, dtype=np.int32)
        if _layers(lanes, seeker, bans, met, search, states, moves):
            return cost, states, moves, search.alive
        if cost >= most:
            return most + 1, states, moves, search.alive
        cost += 1


@kernel
def _layers(
    lanes: Lanes, seeker: Seeker, bans: Bans, met: IntArray, search: LayerSearch, states: IntArray, moves: IntArray
) -> bool:  # pragma: no cover - compiled
    """Find all paths that stand still for good after exactly as many timesteps as there are moves.

    This is what A* in space and time expands with f <= cost: forward, whatever can still arrive in time, with the
    path that meets fewest others; backward, whatever does arrive.
    """
    state_cell, start, goal, stay = lanes.state_cell, seeker.start, seeker.goal, seeker.stay
    alive, via, origin, meets, free_from = search.alive, search.via, search.origin, search.meets, search.free_from
    cost, n_states = len(moves), len(state_cell)
    alive[0, start] = True
    for t in range(cost):
        for s in range(n_states):
            if not alive[t, s] or (stay and s == goal):
                continue
            here = state_cell[s]
            for k in range(lanes.out_ptr[s] - 1, lanes.out_ptr[s + 1]):
                move, after = -1, s
                if k >= lanes.out_ptr[s]:
                    move = lanes.out_move[k]
                    after = lanes.move_to[move]
                    if not lanes.is_open[move]:
                        continue
                there = state_cell[after]
                if goal >= 0 and t + 1 + seeker.distance[after] > cost:
                    continue
                if _banned(lanes, bans, move, here, there, t):
                    continue
                meetings = meets[t, s] + _meetings(here, there, t, met)
                if not alive[t + 1, after] or meetings < meets[t + 1, after]:
                    alive[t + 1, after] = True
                    via[t + 1, after] = move
                    origin[t + 1, after] = s
                    meets[t + 1, after] = meetings

    # The last layer keeps what may stand still from now on.
    for k in range(len(bans.fact)):
        if bans.fact[k, 0] == STAND:
            free_from[bans.fact[k, 2]] = max(free_from[bans.fact[k, 2]], bans.fact[k, 1] + 1)
    best = -1
    for s in range(n_states):
        if alive[cost, s]:
            alive[cost, s] = (goal < 0 or s == goal) and cost >= free_from[state_cell[s]]
            if alive[cost, s] and (best < 0 or meets[cost, s] < meets[cost, best]):
                best = s
    if best < 0:
        return False
    states[cost] = best
    for t in range(cost, 0, -1):
        moves[t - 1] = via[t, states[t]]
        states[t - 1] = origin[t, states[t]]

    _trim(lanes, seeker, bans, alive)
    return True


@kernel
def _trim(lanes: Lanes, seeker: Seeker, bans: Bans, alive: BoolArray) -> None:  # pragma: no cover - compiled
    """Take out of the layers whatever does not lead to the last one."""
    state_cell, goal, stay = lanes.state_cell, seeker.goal, seeker.stay
    for t in range(len(alive) - 2, -1, -1):
        for s in range(len(state_cell)):
            if not alive[t, s]:
                continue
            here = state_cell[s]
            arrives = False
            for k in range(lanes.out_ptr[s] - 1, lanes.out_ptr[s + 1]):
                move, after = -1, s
                if k >= lanes.out_ptr[s]:
                    move = lanes.out_move[k]
                    after = lanes.move_to[move]
                    if not lanes.is_open[move]:
                        continue
                if alive[t + 1, after] and not (stay and s == goal):
                    there = state_cell[after]
                    if not _banned(lanes, bans, move, here, there, t):
                        arrives = True
                        break
            alive[t, s] = arrives
