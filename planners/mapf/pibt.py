"""PIBT: every agent takes its best step, and pushes whoever stands there out of the way first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from planners.deadline import Deadline
from planners.errors import PlanningError
from planners.mapf.distance_table import UNREACHABLE, DistanceTable, open_moves
from planners.mapf.problem import NO_GOAL, BoolArray, Instance, IntArray, Plan
from planners.status import Status

Floats = npt.NDArray[np.float64]

_WAIT_KEY = 0.4
_OCCUPIED_KEY = 0.6
_NOISE_KEY = 0.3


@dataclass(frozen=True, kw_only=True)
class PibtConfig:
    """Settings of `Pibt`."""

    impatience: float = 1.0
    """Priority an agent gains with each timestep of the window that ends away from its goal."""

    def __post_init__(self) -> None:
        if not self.impatience >= 0:
            raise PlanningError(f"pibt: impatience = {self.impatience}; valid: a number >= 0")


class Pibt:
    """Priority inheritance with backtracking on lane-graph states, one agent per cell.

    Greedy: complete for none of the hard instances, but a step costs microseconds, and every plan is legal whatever
    the instance. Steps are ordered by the distance that is left after them. A wait counts at the agent's own
    distance, so an agent waits before it takes a detour, and takes a free step sideways before it waits.

    Args:
        config: Settings.
        seed: Seed of the tie-breaking. Each call draws on: the same sequence of calls gives the same plans.

    Source: Okumura, Machida, Défago, Tamura, "Priority Inheritance with Backtracking for Iterative Multi-agent Path
    Finding", Artificial Intelligence 310, 2022, algorithm 1. Refusing closed rings, the swept cells and the waits
    that beat a detour are additions.
    """

    def __init__(self, config: PibtConfig | None = None, *, seed: int | np.random.Generator = 0) -> None:
        self.config = PibtConfig() if config is None else config
        self._rng = np.random.default_rng(seed)

    def plan(self, instance: Instance, tables: DistanceTable | None = None, deadline: Deadline | None = None) -> Plan:
        """Plan one window.

        Args:
            instance: The window.
            tables: Distances on the same graph, kept from call to call; None = built here.
            deadline: Budget; an iteration is one timestep of all agents.

        Returns:
            A plan that is legal from its first row to its last, whatever its status.

        Raises:
            PlanningError: `tables` belong to another graph.
        """
        graph = instance.graph
        if tables is None:
            tables = DistanceTable(graph, instance.blocked)
        elif tables.graph is not graph:
            raise PlanningError("pibt: the distance table is of another graph than the instance; valid: the same one")
        deadline = Deadline() if deadline is None else deadline
        distances, row = tables.rows(instance.goals)
        is_open = open_moves(graph, instance.blocked)
        widest = int(np.diff(graph.out_ptr).max(initial=0))

        n = instance.n_agents
        states = np.empty((instance.horizon + 1, n), dtype=np.int32)
        states[0] = instance.starts
        has_goal = instance.goals != NO_GOAL
        been_there = np.zeros(n, dtype=np.bool_)
        priority = np.array(instance.priorities, dtype=np.float64)
        done = 0
        while done < instance.horizon and deadline.spend():
            now = states[done]
            been_there |= now == instance.goals
            locked = instance.fixed | (instance.stay & (now == instance.goals))
            content = been_there | ~has_goal
            order = np.lexsort((-priority, content))
            noise = self._rng.random((n, widest))
            _step(
                graph.out_ptr,
                graph.out_move,
                graph.move_to,
                graph.state_cell,
                graph.swept_ptr,
                graph.swept_cell,
                is_open,
                graph.n_cells,
                distances,
                row,
                order,
                locked,
                noise,
                instance.allow_rotation,
                now,
                states[done + 1],
            )
            done += 1
            priority += self.config.impatience * ~content
        return Plan(states=states[: done + 1], status=_status(instance, distances, row, done), iterations=done)


def _status(instance: Instance, distances: IntArray, row: IntArray, done: int) -> Status:
    has_goal = row >= 0
    left = distances[row[has_goal], instance.starts[has_goal]]
    if (left >= UNREACHABLE).any():
        return Status.INFEASIBLE
    return Status.FEASIBLE if done == instance.horizon else Status.TIMEOUT


@njit(cache=True)
def _allowed(
    agent: int,
    home: int,
    move: int,
    move_to: IntArray,
    state_cell: IntArray,
    swept_ptr: IntArray,
    swept_cell: IntArray,
    allow_rotation: bool,
    occupant: IntArray,
    taken: IntArray,
    crossed: IntArray,
    after: IntArray,
) -> bool:  # pragma: no cover - compiled
    """Whether a move agrees with all that is decided so far."""
    to = state_cell[move_to[move]]
    if taken[to] != -1 or crossed[to] != -1:
        return False
    for k in range(swept_ptr[move], swept_ptr[move + 1]):
        cell = swept_cell[k]
        if cell not in (home, to) and (occupant[cell] != -1 or taken[cell] != -1 or crossed[cell] != -1):
            return False
    ahead = occupant[to]
    if to == home or ahead < 0 or after[ahead] < 0:
        return True
    if state_cell[after[ahead]] == home:
        return False  # swap
    return allow_rotation or not _closes_ring(agent, ahead, occupant, after, state_cell)


@njit(cache=True)
def _closes_ring(
    agent: int, ahead: int, occupant: IntArray, after: IntArray, state_cell: IntArray
) -> bool:  # pragma: no cover - compiled
    """Whether following `ahead`, who follows somebody in turn, ends at `agent` again."""
    while after[ahead] >= 0:
        beyond = occupant[state_cell[after[ahead]]]
        if beyond == agent:
            return True
        if beyond < 0 or beyond == ahead:
            return False
        ahead = beyond
    return False


@njit(cache=True)
def _step(
    out_ptr: IntArray,
    out_move: IntArray,
    move_to: IntArray,
    state_cell: IntArray,
    swept_ptr: IntArray,
    swept_cell: IntArray,
    is_open: BoolArray,
    n_cells: int,
    distances: IntArray,
    row: IntArray,
    order: npt.NDArray[np.int64],
    locked: BoolArray,
    noise: Floats,
    allow_rotation: bool,
    now: IntArray,
    after: IntArray,
) -> None:  # pragma: no cover - compiled
    """Decide one timestep: fill `after`, shape (n,), from `now`, shape (n,).

    An agent is undecided while after[agent] is -1. The push chain is an explicit stack: each frame is an agent
    that tries its candidates in turn, and a frame is put on top when the candidate's cell holds somebody undecided.
    """
    n = len(now)
    widest = noise.shape[1] + 1
    occupant = np.full(n_cells, -1, dtype=np.int32)  # who stands there now
    taken = np.full(n_cells, -1, dtype=np.int32)  # who stands there after the timestep
    crossed = np.full(n_cells, -1, dtype=np.int32)  # who sweeps over it on the way, neither from nor to
    candidates = np.empty((n, widest), dtype=np.int32)  # moves, -1 = wait
    keys = np.empty(widest, dtype=np.float64)
    n_candidates = np.zeros(n, dtype=np.int32)
    tried = np.zeros(n, dtype=np.int32)
    stack = np.empty(n, dtype=np.int32)
    after[:] = -1
    for agent in range(n):
        cell = state_cell[now[agent]]
        occupant[cell] = agent
        if locked[agent]:
            after[agent] = now[agent]
            taken[cell] = agent

    for first in order:
        if after[first] >= 0:
            continue
        depth = 0
        stack[0] = first
        fresh = True  # the frame on top has no candidates yet
        while depth >= 0:
            agent = stack[depth]
            home = state_cell[now[agent]]
            if fresh:
                fresh = False
                _rank(
                    agent, now[agent], home, out_ptr, out_move, move_to, state_cell, is_open, distances, row,
                    noise, occupant, keys, candidates, n_candidates,
                )  # fmt: skip
                tried[agent] = 0
            else:  # the pushed agent could not move: take the step back
                last = candidates[agent, tried[agent] - 1]
                after[agent] = -1
                for k in range(swept_ptr[last], swept_ptr[last + 1]):
                    if crossed[swept_cell[k]] == agent:
                        crossed[swept_cell[k]] = -1

            pushed = -1
            moved = False
            while tried[agent] < n_candidates[agent] and not moved:
                move = candidates[agent, tried[agent]]
                tried[agent] += 1
                if move < 0:
                    if taken[home] == -1:
                        after[agent] = now[agent]
                        taken[home] = agent
                        moved = True
                    continue
                if not _allowed(
                    agent, home, move, move_to, state_cell, swept_ptr, swept_cell,
                    allow_rotation, occupant, taken, crossed, after,
                ):  # fmt: skip
                    continue
                to = state_cell[move_to[move]]
                after[agent] = move_to[move]
                taken[to] = agent
                for k in range(swept_ptr[move], swept_ptr[move + 1]):
                    cell = swept_cell[k]
                    if cell not in (home, to):
                        crossed[cell] = agent
                moved = True
                ahead = occupant[to]
                if to != home and ahead >= 0 and after[ahead] < 0:
                    pushed = ahead

            if pushed >= 0:
                depth += 1
                stack[depth] = pushed
                fresh = True
            elif moved:
                break  # the whole chain moves
            else:
                after[agent] = now[agent]
                taken[home] = agent
                depth -= 1


@njit(cache=True)
def _rank(
    agent: int,
    state: int,
    home: int,
    out_ptr: IntArray,
    out_move: IntArray,
    move_to: IntArray,
    state_cell: IntArray,
    is_open: BoolArray,
    distances: IntArray,
    row: IntArray,
    noise: Floats,
    occupant: IntArray,
    keys: Floats,
    candidates: IntArray,
    n_candidates: IntArray,
) -> None:  # pragma: no cover - compiled
    """Sort an agent's open moves and its wait (-1) by the distance left after them.

    Distances are whole numbers; the fractions order equal ones: free cell, wait, occupied cell, and chance.
    """
    goal_row = row[agent]
    content = goal_row < 0 or distances[goal_row, state] >= UNREACHABLE
    keys[0] = -1.0 if content else distances[goal_row, state] + _WAIT_KEY
    candidates[agent, 0] = -1
    count = 1
    for k in range(out_ptr[state + 1] - out_ptr[state]):
        move = out_move[out_ptr[state] + k]
        if not is_open[move]:
            continue
        to = move_to[move]
        key = _NOISE_KEY * noise[agent, k]
        if goal_row >= 0:
            key += distances[goal_row, to]
        if state_cell[to] != home and occupant[state_cell[to]] != -1:
            key += _OCCUPIED_KEY
        place = count
        while place > 0 and keys[place - 1] > key:
            keys[place] = keys[place - 1]
            candidates[agent, place] = candidates[agent, place - 1]
            place -= 1
        keys[place] = key
        candidates[agent, place] = move
        count += 1
    n_candidates[agent] = count
